"""The natural logarithm, also of one plus a small number."""

from __future__ import annotations

import math

from gough.kernels.functions.parts import LN2_HIGH, LN2_LOW
from gough.kernels.value import Value, polynomial, where

ROOT_HALF = 0x3FE6A09E667F3BCD
"""The bits of √½."""
ONE = 1023 << 52
"""The bits of 1."""
MANTISSA = 2**52 - 1
NO_EXPONENT = 2.0**52 + 1023
"""The exponent of a number between √½ and √2, as `parts` reads it from the bits."""

# minimax polynomial of (ln((1+s)/(1-s))/s - 2)/s² in s² on s² ≤ 0.0295, see tools/minimax.py
LOG = [
    *(0.6666666666666734, 0.39999999999417035, 0.28571428741894694, 0.22222198621530995),
    *(0.18183561903375964, 0.15314110646520954, 0.14795364588704568),
]


def log(x: Value) -> Value:
    """Natural logarithm; -∞ at 0, NaN below; 1 ulp.

    With x = 2ᵏ m, √½ ≤ m < √2 and s = (m - 1)/(m + 1), ln m = 2 s + 2 s³/3 … (Muller, Elementary
    Functions, ch. 5), written so that m - 1 is its largest term.
    """
    minus_k, f = parts(*normal(x))
    result = _sum(minus_k, f, -(minus_k * LN2_LOW))
    return _with_ends(x, x, result)


def log1p(x: Value) -> Value:
    """Natural logarithm of 1 + x; -∞ at -1, NaN below; 1 ulp.

    The error of 1 + x is found (Knuth) and its share of the result added, but for 1 + x near 1,
    where x itself is at hand.
    """
    total = 1.0 + x
    back = total - 1.0
    error = (1.0 - (total - back)) + (x - back)
    minus_k, f = parts(total, total.like(NO_EXPONENT))
    near = minus_k.equals(0.0)
    small = where(near, 0.0, error / total) - minus_k * LN2_LOW
    result = _sum(minus_k, where(near, x, f), small)
    return _with_ends(x, total, result)


def normal(x: Value) -> tuple[Value, Value]:
    """x, or 2⁵⁴ x if it is subnormal, and what `parts` has to know about it."""
    subnormal = x < 2.0**-1022
    offset = where(subnormal, NO_EXPONENT + 54.0, x.like(NO_EXPONENT))
    return where(subnormal, x * 2.0**54, x), offset


def parts(x: Value, offset: Value) -> tuple[Value, Value]:
    """-k and m - 1 for a normal x = 2ᵏ m; both are +0 for x = 1."""
    bits = x.word() + (ONE - ROOT_HALF)
    minus_k = offset - ((bits >> 52) | (0x433 << 52)).real()
    return minus_k, ((bits & MANTISSA) + ROOT_HALF).real() - 1.0


def _sum(minus_k: Value, f: Value, small: Value) -> Value:
    """k LN2_HIGH + ln(1 + f) + small, with the sign of f if all is zero."""
    s = f / (f + 2.0)
    square = s * s
    half = f * f * 0.5
    series = s * (half + square * polynomial(square, LOG))
    return (f - (half - (series + small))) - minus_k * LN2_HIGH


def _with_ends(x: Value, argument: Value, result: Value) -> Value:
    result = where(argument.equals(0.0), -math.inf, where(argument < 0.0, math.nan, result))
    return where(x < math.inf, result, x)  # infinity and NaN stay
