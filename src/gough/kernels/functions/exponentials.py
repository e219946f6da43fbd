"""The exponential function."""

from __future__ import annotations

import math

from gough.kernels.functions.logarithms import LN2_HIGH, LN2_LOW
from gough.kernels.functions.sines import MAGIC
from gough.kernels.value import Value, polynomial, where

LARGEST = 800.0
"""Beyond this the result is 0 or infinite."""

# Chebyshev interpolation of (exp r - 1 - r)/r² on |r| ≤ ln(2)/2, see tools/minimax.py
EXP = [
    *(0.5, 0.1666666666666667, 0.04166666666666667, 0.008333333333326084),
    *(0.0013888888888883711, 0.0001984126987500228, 2.480158732567746e-05),
    *(2.755725517000089e-06, 2.755727347871858e-07, 2.5105312729622103e-08, 2.09147553258932e-09),
]


def exp(x: Value) -> Value:
    """eˣ; 1 ulp, also where the result is subnormal.

    With k the whole number nearest to x/ln 2, eˣ = 2ᵏ exp(x - k ln 2) (Cody and Waite 1980).
    """
    k, rest, tail = reduced(where(x < -LARGEST, -LARGEST, where(x > LARGEST, LARGEST, x)))
    grown = 1.0 + series(rest, tail)
    # two factors, so that the second alone rounds where the result is subnormal
    first = (k * 0.5 + MAGIC) - MAGIC
    return (grown * power_of_two(first)) * power_of_two(k - first)


def reduced(x: Value) -> tuple[Value, Value, Value]:
    """k, r and the rounding error of r, with x = k ln 2 + r and k whole; |x| ≤ 800."""
    shifted = x * (1.0 / math.log(2.0)) + MAGIC
    k = shifted - MAGIC
    high, low = x - k * LN2_HIGH, k * LN2_LOW
    rest = high - low
    return k, rest, (high - rest) - low


def series(rest: Value, tail: Value) -> Value:
    """eʳ - 1 for a reduced argument."""
    return rest + (rest * rest * polynomial(rest, EXP) + tail)


def power_of_two(k: Value) -> Value:
    """2ᵏ for a whole number -1022 ≤ k ≤ 1023."""
    return (((k + MAGIC).word() + 1023) << 52).real()
