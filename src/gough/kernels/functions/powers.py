"""Powers with any exponent."""

from __future__ import annotations

import math

from gough.kernels.functions.exponentials import LARGEST, missing, reduced, scaled
from gough.kernels.functions.logarithms import normal, parts
from gough.kernels.functions.parts import LN2_HIGH, LN2_LOW, leading, with_sign_of
from gough.kernels.value import Value, floor, polynomial, where

THIRD = float.fromhex("0x1.5555550000000p-2")
"""1/3 to 26 bits."""
THIRD_LOW = float.fromhex("0x1.5555555555555p-28")
ENORMOUS = 2.0**65
"""Exponents beyond give what this one gives."""

# minimax polynomial of (artanh(s)/s - 1 - s²/3)/s⁴ in s² on s² ≤ 0.0295, see tools/minimax.py
ATANH = [
    *(0.1999999999999999, 0.1428571428572192, 0.11111111108894885, 0.09090909421992259),
    *(0.07692279214710725, 0.06668132227194212, 0.05837890903045293, 0.0599087147018886),
]


def pow_(x: Value, y: Value) -> Value:
    """x to the power of y, with the special cases of C99; 1.25 ulp.

    It is exp(y ln |x|) with the logarithm and the product as sums of two numbers. A negative x
    has powers with whole exponents, negative ones if these are odd.
    """
    size = abs(x)
    exponent = where(y > ENORMOUS, ENORMOUS, where(y < -ENORMOUS, -ENORMOUS, y))
    high, low = _product(exponent, *_logarithm(size))
    edge = size.equals(0.0) | size.equals(math.inf)
    high = where(edge, exponent * where(size < 1.0, -math.inf, size.like(math.inf)), high)
    return _with_signs(x, y, _exponential(high, low))


def _with_signs(x: Value, y: Value, power: Value) -> Value:
    """The power of x from that of |x|."""
    half = y * 0.5
    whole = floor(y).equals(y)
    odd = whole & ~floor(half).equals(half)
    unreal = (x < 0.0) & (x > -math.inf) & ~whole
    power = with_sign_of(power, where(odd, x, x.like(1.0)))
    power = where(unreal | ~x.equals(x), math.nan, power)
    return where(y.equals(0.0) | x.equals(1.0), 1.0, power)


def _exponential(high: Value, low: Value) -> Value:
    """exp(high + low) for a small low."""
    low = where(abs(high) > LARGEST, 0.0, low)
    high = where(high < -LARGEST, -LARGEST, where(high > LARGEST, LARGEST, high))
    most, less, word = reduced(high, 2046)
    return scaled(1.0 + (most - missing(most, less - low)), word)


def _product(y: Value, high: Value, low: Value) -> tuple[Value, Value]:
    """y (high + low) as a sum of two numbers, the first one exact."""
    front = leading(high + low)
    back = (high - front) + low
    y_front = leading(y)
    return y_front * front, y * back + (y - y_front) * front


def _logarithm(x: Value) -> tuple[Value, Value]:
    """ln x as a sum of two numbers, to 2⁻⁶⁵ of its size.

    As `logarithms.log`, ln m = 2 s + 2 s w with w = s²/3 + s⁴/5 …, and s, s² and w as sums of a
    number of 26 bits and a small one.
    """
    minus_k, f = parts(*normal(x))
    s, s_low = _quotient(f)
    square = s * s
    front = leading(square)
    back = (square - front) + s_low * (s + (s + s_low))
    square = front + back
    third = front * THIRD  # exact
    w = leading(third)
    further = THIRD_LOW + square * polynomial(square, ATANH)
    w_low = (third - w) + (back * THIRD + square * further)
    first = s * 2.0
    second = first * w  # exact
    small = first * w_low + s_low * 2.0 * (1.0 + (w + w_low))
    return _sum(minus_k, first, second, small)


def _quotient(f: Value) -> tuple[Value, Value]:
    """f/(2 + f) as a sum of a number of 26 bits and a small one."""
    bottom = f + 2.0
    error = f - (bottom - 2.0)  # exact (Dekker 1971)
    inverse = 1.0 / bottom
    s = leading(f * inverse)
    front = leading(bottom)
    back = (bottom - front) + error
    return s, ((f - s * front) - s * back) * inverse


def _sum(minus_k: Value, first: Value, second: Value, small: Value) -> tuple[Value, Value]:
    """k ln 2 and three terms, ever smaller ones, as a sum of two numbers (Dekker 1971)."""
    much = minus_k * LN2_HIGH  # exact
    total = first - much
    error = first - (total + much)
    high = total + second
    return high, (second - (high - total)) + (error + (small - minus_k * LN2_LOW))
