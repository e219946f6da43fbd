"""Arc tangent, arc sine and arc cosine."""

from __future__ import annotations

import math

from gough.kernels.functions.parts import SIGN, with_sign_of
from gough.kernels.value import Value, polynomial, sqrt, where

PI_TAIL = float.fromhex("0x1.1a62633145c07p-53")
"""π less its float64."""
SHARE = PI_TAIL / math.pi
"""A float64 of π, π/2 or π/4 times this is what it lacks."""
QUARTER = float.fromhex("0x1.921fb54442d10p-1")
"""π/4 to 50 bits, so that its multiples up to 4 are exact."""
QUARTER_TAIL = float.fromhex("0x1.08d313198a2e0p-50")
HUGE = 2.0**1000

# minimax polynomials of (atan y - y)/y³ and (asin y - y)/y³ in y² on |y| ≤ 1/2, see
# tools/minimax.py
ATAN = [
    *(-0.3333333333333298, 0.19999999999903104, -0.14285714276385453, 0.11111110659622284),
    *(-0.09090896244456002, 0.07692073908912354, -0.06663810585501499, 0.058582987347061195),
    *(-0.05122005107419915, 0.04186502707300992, -0.027434928428909294, 0.010116835883695252),
]
ASIN = [
    *(0.1666666666666676, 0.07499999999970866, 0.04464285717456112, 0.03038194270984673),
    *(0.022372214936731586, 0.0173516128329054, 0.013980811609815074, 0.011398979536263884),
    *(0.010779902541051217, 0.0037076453528907985, 0.02170461843445158, -0.020995280610194293),
    0.03262637980069294,
]


def atan(x: Value) -> Value:
    """Arc tangent in rad; 1.5 ulp.

    atan x = π/4 + atan((x - 1)/(x + 1)) for 1/2 ≤ x ≤ 2, where x - 1 is exact near 1/2, and
    π/2 - atan(1/x) above.
    """
    size = abs(x)
    steep, flat = size > 2.0, size < 0.5
    top = where(steep, -1.0, where(flat, size, size - 1.0))
    bottom = where(steep, size, where(flat, 1.0, size + 1.0))
    start = where(steep, math.pi / 2, where(flat, 0.0, size.like(math.pi / 4)))
    return with_sign_of(_turned(start, start * SHARE, top / bottom), x)


def atan2(y: Value, x: Value) -> Value:
    """Angle of the vector (x, y) from the x axis in rad, with the special cases of C99; 1.75 ulp.

    As `atan`, with the angle counted back from π for vectors to the left.
    """
    across, along = abs(y), abs(x)
    scale = where(along > HUGE, 0.25, along.like(1.0))  # the sum must stay finite
    across, along = across * scale, along * scale
    difference, total = across - along, across + along
    nowhere = total.equals(0.0)
    steep, flat = along * 2.0 < across, (across * 2.0 < along) | nowhere
    # the sum of two that are alike is infinite only if both are
    diagonal = where(total.equals(math.inf), 0.0, difference)
    top = where(steep, -along, where(flat, across, diagonal))
    bottom = where(steep, across, where(nowhere, 1.0, where(flat, along, total)))
    quotient = top / bottom
    left = (x.word() & SIGN).equals(SIGN)  # minus zero is left of zero
    quarters = where(steep, 2.0, where(flat, 0.0, total.like(1.0)))
    quarters = where(left, 4.0 - quarters, quarters)
    quotient = where(left, -quotient, quotient)
    angle = _turned(quarters * QUARTER, quarters * QUARTER_TAIL, quotient)
    return with_sign_of(angle, y)


def _turned(start: Value, tail: Value, y: Value) -> Value:
    """start + tail + atan y, for |y| ≤ 1/2; the sum of start and y is exact (Dekker 1971)."""
    square = y * y
    total = start + y
    error = (start - total) + y
    return total + (error + (square * polynomial(square, ATAN) * y + tail))


def asin(x: Value) -> Value:
    """Arc sine in rad, NaN outside [-1, 1]; 1.25 ulp.

    Above 1/2, asin x = π/2 - 2 asin √((1 - x)/2), where 1 - x is exact.
    """
    size = abs(x)
    inner = size < 0.5
    double, correction = _halved(size, inner)
    y = where(inner, size, -double)
    start = where(inner, 0.0, size.like(math.pi / 2))
    total = start + y
    error = (start - total) + y  # exact (Dekker 1971)
    return with_sign_of(total + (error + (y * correction + start * SHARE)), x)


def acos(x: Value) -> Value:
    """Arc cosine in rad, NaN outside [-1, 1]; 1.25 ulp.

    It is π/2 - asin x for |x| ≤ 1/2, else 2 asin √((1 - |x|)/2), and π less that for negative x.
    """
    size = abs(x)
    inner, left = size < 0.5, x < 0.0
    double, correction = _halved(size, inner)
    y = where(inner, x, where(left, double, -double))
    start = where(inner, math.pi / 2, where(left, math.pi, x.like(0.0)))
    return start - (y + (y * correction - start * SHARE))


def _halved(size: Value, inner: Value) -> tuple[Value, Value]:
    """2 √((1 - size)/2), and (asin y - y)/y for y = size if inner, else for half of this root."""
    half = (1.0 - size) * 0.5
    square = where(inner, size * size, half)
    return sqrt(half) * 2.0, square * polynomial(square, ASIN)
