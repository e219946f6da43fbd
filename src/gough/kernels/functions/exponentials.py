"""The exponential function, and it less one."""

from __future__ import annotations

from typing import NamedTuple

from gough.kernels.functions.parts import LN2_HIGH, LN2_INVERSE, LN2_LOW, MAGIC
from gough.kernels.value import Value, polynomial, where

LARGEST = 800.0
"""Beyond this the exponential is 0 or infinite."""
EXPONENT = 2047 << 52
"""The bits of the exponent."""
TINY = 2.0**-54
"""Below this expm1 x is x."""

# minimax polynomial of (exp r - 1 - r)/r² on |r| ≤ ln(2)/2, see tools/minimax.py
EXP = [
    *(0.5, 0.16666666666666677, 0.041666666666666685, 0.008333333333321804),
    *(0.001388888888889139, 0.00019841269885237023, 2.4801587281360382e-05),
    *(2.7557245311899995e-06, 2.7557329797438554e-07, 2.5108621871609272e-08),
    2.0893235242407974e-09,
]


class Reduced(NamedTuple):
    """x = k ln 2 + high - low for a whole number k (Cody and Waite 1980)."""

    high: Value
    """x less the most of k ln 2, exact; at most ln(2)/2."""
    low: Value
    """The rest of k ln 2."""
    word: Value
    """k plus a chosen whole number in the last 12 bits."""


def reduced(x: Value, added: int) -> Reduced:
    """The parts of x, with a number added to k in their word."""
    shifted = x * LN2_INVERSE + (MAGIC + added)
    k = shifted - (MAGIC + added)
    return Reduced(x - k * LN2_HIGH, k * LN2_LOW, shifted.word())


def missing(high: Value, low: Value) -> Value:
    """What high exceeds exp(high - low) - 1 by: small, so that its roundings are as well."""
    rest = high - low
    return low - rest * rest * polynomial(rest, EXP)


def exp(x: Value) -> Value:
    """eˣ; 1 ulp, also where the result is subnormal."""
    x = where(x < -LARGEST, -LARGEST, where(x > LARGEST, LARGEST, x))
    high, low, word = reduced(x, 2046)
    return scaled(1.0 + (high - missing(high, low)), word)


def scaled(x: Value, word: Value) -> Value:
    """x 2ᵏ for a word that ends in k + 2046: two products, of which the second alone rounds."""
    first = (word << 51) & EXPONENT  # of 2 to the power of ⌊k/2⌋
    second = (word << 52) - first
    return x * first.real() * second.real()


def expm1(x: Value) -> Value:
    """eˣ - 1; 1.25 ulp.

    With u = 2ᵏ⁻¹ and a remainder r it is 2 (u - 1/2 + u r + u (exp r - 1 - r)); the first sum is
    exact (Dekker 1971).
    """
    x = where(x < -40.0, -40.0, where(x > 710.0, 710.0, x))  # -1 and infinity beyond
    high, low, word = reduced(x, 1022)
    unit = (word << 52).real()
    start, step = unit - 0.5, unit * high
    total = start + step
    error = (start - total) + step
    result = (total + (error - unit * missing(high, low))) * 2.0
    return where(abs(x) < TINY, x, result)
