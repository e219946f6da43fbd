"""Hyperbolic functions, and exponential and logarithm near 0 and 1."""

from __future__ import annotations

import math

from gough.kernels.functions.exponentials import exp, power_of_two, reduced, series
from gough.kernels.functions.logarithms import log
from gough.kernels.value import Value, where

SIGN = 1 << 63
TINY = 2.0**-54
"""Below this these functions are their argument."""


def expm1(x: Value) -> Value:
    """eˣ - 1 without cancellation; 3 ulp.

    With x = k ln 2 + r, it is 2ᵏ (eʳ - 1) + (2ᵏ - 1).
    """
    middle = where(x < -60.0, -60.0, where(x > 40.0, 40.0, x))
    k, rest, tail = reduced(middle)
    factor = power_of_two(k)
    near = factor * series(rest, tail) + (factor - 1.0)
    return where(abs(x) < TINY, x, where(x > 40.0, exp(x), near))


def log1p(x: Value) -> Value:
    """ln(1 + x) without cancellation; 2 ulp.

    The rounding error of 1 + x is added to first order (Kahan; Higham 2002, 1.14).
    """
    near = where(abs(x) < 1.0, x, 0.0)
    whole = near + 1.0
    lost = near - (whole - 1.0)
    small = log(whole) + where(whole.equals(0.0), 0.0, lost / whole)
    large = x + 1.0
    rest = 1.0 - (large - x)
    result = where(abs(x) < 1.0, small, log(large) + where(large < math.inf, rest / large, 0.0))
    result = where(x.equals(-1.0), -math.inf, result)
    return where(abs(x) < TINY, x, result)


def sinh(x: Value) -> Value:
    """(eˣ - e⁻ˣ)/2; 4 ulp."""
    size = abs(x)
    grown = expm1(where(size > 22.0, 22.0, size))
    near = (grown + grown / (grown + 1.0)) * 0.5
    return _with_sign_of(where(size > 22.0, _half_exp(size), near), x)


def cosh(x: Value) -> Value:
    """(eˣ + e⁻ˣ)/2; 3 ulp."""
    size = abs(x)
    grown = exp(where(size > 22.0, 22.0, size))
    near = (grown + 1.0 / grown) * 0.5
    return where(size > 22.0, _half_exp(size), near)


def tanh(x: Value) -> Value:
    """(eˣ - e⁻ˣ)/(eˣ + e⁻ˣ); 4 ulp."""
    size = abs(x)
    grown = expm1(where(size > 22.0, 44.0, size + size))
    near = where(size > 22.0, 1.0, grown / (grown + 2.0))
    return _with_sign_of(where(size < TINY, size, near), x)


def _half_exp(x: Value) -> Value:
    """eˣ/2 that overflows no earlier than it must."""
    root = exp(x * 0.5)
    return (root * 0.5) * root


def _with_sign_of(size: Value, x: Value) -> Value:
    return (size.word() ^ (x.word() & SIGN)).real()
