"""Sine, cosine and tangent."""

from __future__ import annotations

import math
from typing import NamedTuple

from gough.kernels.functions.parts import MAGIC, SIGN
from gough.kernels.value import Value, polynomial, where

LIMIT = 2.0**14 * math.pi / 2
"""Angles up to this are reduced by three products; larger ones take a rare way, `large_angles`."""
TWO_OVER_PI = float.fromhex("0x1.45f306dc9c883p-1")
# π/2 = P1 + P2 + P3 …: 39, 39 and 53 bits, so that n P1 and n P2 are exact for |n| ≤ 2¹⁴
P1 = float.fromhex("0x1.921fb54440000p+0")
P2 = float.fromhex("0x1.68c234c4c4000p-39")
P3 = float.fromhex("0x1.3145c06e0e689p-78")

# minimax polynomials of (y - sin y)/y³ and (cos y - 1 + y²/2)/y⁴ in y² on |y| ≤ π/4, see
# tools/minimax.py
SINE = [
    *(0.1666666666666663, -0.008333333333321842, 0.00019841269829360818, -2.755731353952932e-06),
    *(2.5050734574195567e-08, -1.5895445199564905e-10),
]
COSINE = [
    *(0.041666666666666595, -0.0013888888888873342, 2.4801587289002062e-05),
    *(-2.7557314217031814e-07, 2.0875705395187265e-09, -1.1358749216902762e-11),
]


class Reduced(NamedTuple):
    """An angle less a whole number n of quarter turns: ``rest - lost``, |rest| ≤ π/4."""

    rest: Value
    lost: Value
    """What rounding the rest has added, with zero positive."""
    quarters: Value
    """n modulo 4 in the last two bits of a word."""


def sin_cos(x: Value) -> tuple[Value, Value]:
    """Sine and cosine of an angle in rad, to 1 ulp for every angle; sin(-0.0) is -0.0."""
    sine, cosine = sin_cos_of(_reduced(x))
    large = ~(abs(x) <= LIMIT)
    return large.emit("careful_sin", sine, x), large.emit("careful_cos", cosine, x)


def sin(x: Value) -> Value:
    """Sine of an angle in rad; 1 ulp."""
    return sin_cos(x)[0]


def cos(x: Value) -> Value:
    """Cosine of an angle in rad; 1 ulp."""
    return sin_cos(x)[1]


def tan(x: Value) -> Value:
    """Tangent of an angle in rad; the quotient of sine and cosine, 3 ulp."""
    sine, cosine = sin_cos(x)
    return sine / cosine


def _reduced(x: Value) -> Reduced:
    """x - n π/2 for the nearest n (Cody and Waite 1980), with the error of one difference kept.

    The first difference is exact, being a multiple of the last place of x. That of the second one
    is found by the sum of Dekker (1971): what is taken away has no place below 2⁻⁷⁷, and the last
    place of the first difference is above.
    """
    shifted = x * TWO_OVER_PI + MAGIC
    n = shifted - MAGIC
    first = x - n * P1
    second = n * P2  # exact
    rest = first - second
    error = (rest - first) + second  # exact
    return Reduced(rest, n * P3 + error, shifted.word())


def sin_cos_of(angle: Reduced) -> tuple[Value, Value]:
    """Sine and cosine from the reduced angle."""
    sine, cosine = _sine(angle.rest, angle.lost), _cosine(angle.rest, angle.lost)
    last = angle.quarters << 63
    even = last.equals(0)
    sign = (angle.quarters << 62) & SIGN
    return (
        (where(even, sine, cosine).word() ^ sign).real(),
        (where(even, cosine, sine).word() ^ (sign ^ last)).real(),
    )


def _sine(y: Value, lost: Value) -> Value:
    """sin(y - lost) = y - (y³ P(y²) + lost); the order keeps the sign of zero."""
    square = y * y
    return y - (polynomial(square, SINE) * (square * y) + lost)


def _cosine(y: Value, lost: Value) -> Value:
    """cos(y - lost) = 1 - y²/2 + (y⁴ P(y²) + y lost), with the error of 1 - y²/2 kept."""
    square = y * y
    half = square * 0.5
    first = 1.0 - half
    error = (1.0 - first) - half
    return first + (error + (polynomial(square, COSINE) * (square * square) + y * lost))
