"""Hyperbolic sine, cosine and tangent."""

from __future__ import annotations

from typing import NamedTuple

from gough.kernels.functions.exponentials import missing, reduced
from gough.kernels.functions.parts import with_sign_of
from gough.kernels.value import Value, polynomial, where

LARGEST = 710.6
"""Beyond this sine and cosine are infinite."""
ONE_SIDED = 40.0
"""Beyond this e⁻ˣ has no effect on them."""
TINY = 2.0**-28
"""Below this the sine is x."""

# minimax polynomials of (sinh r - r)/r³ and (cosh r - 1)/r² in r² on |r| ≤ ln(2)/2, and of
# (tanh y - y)/y³ in y² on |y| ≤ 0.55, see tools/minimax.py
SINH = [
    *(0.16666666666666677, 0.008333333333321376, 0.0001984126988686728),
    *(2.7557243376278393e-06, 2.510935510633264e-08),
]
COSH = [
    *(0.5, 0.041666666666666685, 0.0013888888888873264, 2.4801587349281982e-05),
    *(2.7557251717753207e-07, 2.0921811103752136e-09),
]
TANH = [
    *(-0.333333333333333, 0.1333333333332658, -0.05396825396373991, 0.02186948838534497),
    *(-0.008863232594201003, 0.003592091966684632, -0.0014555424851233861),
    *(0.0005884431739393422, -0.0002333785962266381, 8.331264773319991e-05),
    -1.9492587000108977e-05,
]


class _Parts(NamedTuple):
    """For |x| = k ln 2 + r: sinh and cosh of k ln 2, of r, and a high part of r."""

    sine: Value
    """sinh(k ln 2)/2"""
    cosine: Value
    """cosh(k ln 2)/2"""
    high: Value
    odd: Value
    """sinh r - high"""
    even: Value
    """cosh r - 1"""


def sinh(x: Value) -> Value:
    """Hyperbolic sine; 1.75 ulp.

    sinh(k ln 2 + r) = sinh(k ln 2) cosh r + cosh(k ln 2) sinh r, and the two largest terms of
    this are added without error (Dekker 1971).
    """
    size = abs(x)
    sine, cosine, high, odd, even = _parts(size)
    step = cosine * high
    total = sine + step
    error = (sine - total) + step
    result = (total + (error + (cosine * odd + sine * even))) * 2.0
    return with_sign_of(where(size < TINY, size, result), x)


def cosh(x: Value) -> Value:
    """Hyperbolic cosine; 1.75 ulp. Written as `sinh`, with which it shares most."""
    sine, cosine, high, odd, even = _parts(abs(x))
    return (cosine + (sine * high + (cosine * even + sine * odd))) * 2.0


def _parts(size: Value) -> _Parts:
    high, low, word = reduced(where(size > LARGEST, LARGEST, size), 1021)
    bits = word << 52
    growing = bits.real()  # 2ᵏ⁻²
    shrinking = where(size < ONE_SIDED, ((2042 << 52) - bits).real(), 0.0)
    rest = high - low
    square = rest * rest
    odd = square * polynomial(square, SINH) * rest - low
    even = square * polynomial(square, COSH)
    return _Parts(growing - shrinking, growing + shrinking, high, odd, even)


def tanh(x: Value) -> Value:
    """Hyperbolic tangent; 1.75 ulp and never beyond ±1.

    It is a polynomial up to 0.55, then 1 - 2/(e²ˣ + 1).
    """
    size = abs(x)
    square = size * size
    small = size + size * (square * polynomial(square, TANH))
    double = where(size > 22.0, 22.0, size) * 2.0
    high, low, word = reduced(double, 1023)
    grown = (1.0 + (high - missing(high, low))) * (word << 52).real()
    return with_sign_of(where(size < 0.55, small, 1.0 - 2.0 / (grown + 1.0)), x)
