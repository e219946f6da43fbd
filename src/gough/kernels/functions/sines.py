"""Sine, cosine and tangent."""

from __future__ import annotations

import math
from typing import NamedTuple

from gough.kernels.value import Value, polynomial, where

LIMIT = 2.0**14 * math.pi / 2
"""Angles up to this are reduced by three products; larger ones take a rare way, `large_angles`."""
MAGIC = 1.5 * 2.0**52
"""Added to a small number it leaves the nearest whole number in the last bits."""
TWO_OVER_PI = float.fromhex("0x1.45f306dc9c883p-1")
# π/2 = P1 + P2 + P3 …: 39, 39 and 53 bits, so that n P1 and n P2 are exact for |n| ≤ 2¹⁴
P1 = float.fromhex("0x1.921fb54440000p+0")
P2 = float.fromhex("0x1.68c234c4c4000p-39")
P3 = float.fromhex("0x1.3145c06e0e689p-78")
SIGN = 1 << 63
TINY = 2.0**-27
"""Below this the sine is the angle."""

# minimax polynomials of (sin y - y)/y³ and (cos y - 1 + y²/2)/y⁴ in y² on |y| ≤ π/4
SINE = [
    -1.66666666666666324348e-01,
    8.33333333332248946124e-03,
    -1.98412698298579493134e-04,
    2.75573137070700676789e-06,
    -2.50507602534068634195e-08,
    1.58969099521155010221e-10,
]
COSINE = [
    4.16666666666666019037e-02,
    -1.38888888888741095749e-03,
    2.48015872894767294178e-05,
    -2.75573143513906633035e-07,
    2.08757232129817482790e-09,
    -1.13596475577881948265e-11,
]


class Reduced(NamedTuple):
    """An angle less a whole number n of quarter turns: ``rest + tail``, |rest| ≤ π/4."""

    rest: Value
    tail: Value
    quarters: Value
    """n modulo 4 in the last two bits of a word."""


def sin_cos(x: Value) -> tuple[Value, Value]:
    """Sine and cosine of an angle in rad, to 1 ulp for every angle."""
    small, cosine = sin_cos_of(_reduced(x))
    sine = where(abs(x) < TINY, x, small)
    large = ~(abs(x) <= LIMIT)
    return large.emit("careful_sin", sine, x), large.emit("careful_cos", cosine, x)


def sin(x: Value) -> Value:
    """Sine of an angle in rad; 1 ulp."""
    return sin_cos(x)[0]


def cos(x: Value) -> Value:
    """Cosine of an angle in rad; 1 ulp."""
    return sin_cos(x)[1]


def tan(x: Value) -> Value:
    """Tangent of an angle in rad; the quotient of sine and cosine, 2.5 ulp."""
    sine, cosine = sin_cos(x)
    return sine / cosine


def _reduced(x: Value) -> Reduced:
    """Cody and Waite's reduction (1980), with the error of the second difference kept."""
    shifted = x * TWO_OVER_PI + MAGIC
    n = shifted - MAGIC
    first = x - n * P1  # exact
    second = n * P2  # exact
    difference = first - second
    back = difference - first
    error = (first - (difference - back)) - (second + back)  # of the difference, exact (Knuth)
    small = error - n * P3
    rest = difference + small
    return Reduced(rest, (difference - rest) + small, shifted.word())


def sin_cos_of(angle: Reduced) -> tuple[Value, Value]:
    """Sine and cosine from the reduced angle."""
    sine, cosine = _sine(angle.rest, angle.tail), _cosine(angle.rest, angle.tail)
    even = (angle.quarters & 1).equals(0)
    sine, cosine = where(even, sine, cosine), where(even, cosine, sine)
    return _signed(sine, angle.quarters), _signed(cosine, angle.quarters + 1)


def _signed(x: Value, quarters: Value) -> Value:
    """The opposite of x in the third and fourth quarter."""
    return (x.word() ^ ((quarters << 62) & SIGN)).real()


def _sine(y: Value, tail: Value) -> Value:
    square = y * y
    return y + (polynomial(square, SINE) * (square * y) + tail)


def _cosine(y: Value, tail: Value) -> Value:
    square = y * y
    half = square * 0.5
    first = 1.0 - half
    lost = (1.0 - first) - half
    return first + (lost + (polynomial(square, COSINE) * (square * square) - y * tail))
