"""The natural logarithm."""

from __future__ import annotations

import math

from gough.kernels.value import Value, polynomial, where

LN2_HIGH = float.fromhex("0x1.62e42fefa2000p-1")
"""ln 2 to 40 bits: its product with an exponent is exact."""
LN2_LOW = float.fromhex("0x1.9ef35793c7673p-41")
ROOT_HALF = 0x3FE6A09E667F3BCD
"""The bits of √½."""
MANTISSA = 2**52 - 1

# Chebyshev interpolation of (ln((1+s)/(1-s))/s - 2)/s² in s² on s² ≤ 0.0295, see tools/minimax.py
LOG = [
    *(0.666666666666667, 0.3999999999989889, 0.28571428626253836, 0.22222211089379496),
    *(0.1818289243253687, 0.15331611722055008, 0.14617807153417325),
]


def log(x: Value) -> Value:
    """Natural logarithm; -∞ at 0, NaN below; 1 ulp.

    With x = 2ᵏ m, √½ ≤ m < √2 and s = (m - 1)/(m + 1), ln m = 2 s + s³ … (Muller, Elementary
    Functions, ch. 5), summed from the small terms up.
    """
    subnormal = x < 2.0**-1022
    bits = where(subnormal, x * 2.0**54, x).word() - ROOT_HALF + (1023 << 52)
    exponent = _exponent(bits) - where(subnormal, 54.0, x.like(0.0))
    f = ((bits & MANTISSA) + ROOT_HALF).real() - 1.0
    s = f / (f + 2.0)
    square = s * s
    half = f * f * 0.5
    series = s * (half + square * polynomial(square, LOG))
    result = exponent * LN2_HIGH - ((half - (series + exponent * LN2_LOW)) - f)
    result = where(x.equals(0.0), -math.inf, where(x < 0.0, math.nan, result))
    return where(x < math.inf, result, x)  # infinity and NaN stay


def _exponent(bits: Value) -> Value:
    """The exponent of a positive number as a real."""
    return (((bits >> 52) | (0x433 << 52)).real() - 2.0**52) - 1023.0
