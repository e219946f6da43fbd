"""Arc tangent, arc sine and arc cosine."""

from __future__ import annotations

import math

from gough.kernels.value import Value, polynomial, sqrt, where

PI_TAIL = float.fromhex("0x1.1a62633145c07p-53")
"""π less its float64."""
THREE_QUARTERS_TAIL = float.fromhex("0x1.a79394c9e8a0ap-54")
"""3π/4 less its float64."""
HUGE = 2.0**512
SIGN = 1 << 63
TAN_EIGHTH = math.sqrt(2.0) - 1.0
"""tan(π/8): within this the polynomial is used as it is."""

# Chebyshev interpolation of (atan y - y)/y³ in y² on |y| ≤ tan(π/8), see tools/minimax.py
ATAN = [
    *(-0.3333333333333333, 0.19999999999999804, -0.14285714285659779, 0.11111111105150588),
    *(-0.09090908753259112, 0.07692296368042296, -0.0666642476020052, 0.05878927554473807),
    *(-0.05230443640686948, 0.045515447340221615, -0.03456931506332609, 0.016284375050043393),
]
# the same of (asin y - y)/y³ on |y| ≤ 1/2
ASIN = [
    *(0.16666666666666669, 0.07499999999998433, 0.04464285714635543, 0.030381944138531247),
    *(0.02237217294214989, 0.017352392720869973, 0.013971212973552933, 0.011479177415184906),
    *(0.01032281435018578, 0.005457506718640358, 0.01740087944269402, -0.014851887071247204),
    0.028757851367421566,
]


def atan(x: Value) -> Value:
    """Arc tangent, in (-π/2, π/2) rad; 2.5 ulp."""
    size = abs(x)
    turned = _Turned(size, size.like(1.0))
    return _with_sign_of(turned.angle(0.0, 1.0), x)


def atan2(y: Value, x: Value) -> Value:
    """Angle of the vector (x, y) from the x axis in rad, with the special cases of C99; 2.5 ulp."""
    across, along = abs(y), abs(x)
    infinite = along.equals(math.inf) & across.equals(math.inf)
    still = along.equals(0.0) & across.equals(0.0)
    across, along = where(infinite, 1.0, across), where(infinite | still, 1.0, along)
    scale = where((along > HUGE) | (across > HUGE), 1.0 / HUGE, 1.0)  # the sum must stay finite
    turned = _Turned(across * scale, along * scale)
    left = (x.word() >> 63).equals(1)  # minus zero is left of zero
    angle = where(left, turned.angle(math.pi, -1.0), turned.angle(0.0, 1.0))
    angle = where(x.equals(x) & y.equals(y), angle, math.nan)
    return _with_sign_of(angle, y)


def asin(x: Value) -> Value:
    """Arc sine in rad, NaN outside [-1, 1]; 2 ulp."""
    size = abs(x)
    small, large, root = _halves(size)
    near_one = (math.pi / 2 - (root + root * large) * 2.0) + PI_TAIL * 0.5
    return _with_sign_of(where(size < 0.5, size + size * small, near_one), x)


def acos(x: Value) -> Value:
    """Arc cosine in rad, NaN outside [-1, 1]; 2 ulp."""
    small, large, root = _halves(abs(x))
    double = (root + root * large) * 2.0
    beyond = where(x < 0.0, (math.pi - double) + PI_TAIL, double)
    middle = math.pi / 2 - (x - (PI_TAIL * 0.5 - x * small))
    return where(abs(x) < 0.5, middle, beyond)


def _halves(size: Value) -> tuple[Value, Value, Value]:
    """Corrections c with asin y = y + y c, for y = size and y = √((1 - size)/2), and this root."""
    half = (1.0 - size) * 0.5
    square = where(size < 0.5, size * size, half)
    correction = square * polynomial(square, ASIN)
    return correction, correction, sqrt(half)


class _Turned:
    """atan(across/along) of numbers that are not negative, by three ranges and one division."""

    def __init__(self, across: Value, along: Value) -> None:
        self.steep = along < across * TAN_EIGHTH  # beyond 3π/8
        self.flat = across < along * TAN_EIGHTH
        top = where(self.steep, -along, where(self.flat, across, across - along))
        bottom = where(self.steep, across, where(self.flat, along, across + along))
        quotient = top / bottom
        square = quotient * quotient
        self.rest = quotient + quotient * (square * polynomial(square, ATAN))

    def angle(self, start: float, sign: float) -> Value:
        """start + sign · atan(across/along), for a start of 0 or π."""
        flat, middle, steep = (start / math.pi + sign * k / 4 for k in (0, 1, 2))
        base = where(
            self.steep, steep * math.pi, where(self.flat, flat * math.pi, middle * math.pi)
        )
        tail = where(
            self.steep, steep * PI_TAIL, where(self.flat, flat * PI_TAIL, _tail_of(middle))
        )
        return base + (self.rest * sign + tail)


def _tail_of(quarters: float) -> float:
    """A multiple of π less its float64, for 1/4 and 3/4."""
    return quarters * PI_TAIL if quarters == 0.25 else THREE_QUARTERS_TAIL


def _with_sign_of(size: Value, x: Value) -> Value:
    return (size.word() ^ (x.word() & SIGN)).real()
