"""Powers with any exponent."""

from __future__ import annotations

import math

from gough.kernels.functions.exponentials import exp
from gough.kernels.functions.logarithms import log
from gough.kernels.value import Value, floor, where

SIGN = 1 << 63


def pow_(x: Value, y: Value) -> Value:
    """x to the power of y as exp(y ln x), with the special cases of C99; 2 + 2 |y ln x| ulp.

    The error grows with the logarithm of the result, to 1500 ulp at the ends of the range. Whole
    and half exponents up to 32 are multiplied out before they come here (`reading`).
    """
    whole = floor(y).equals(y)
    odd = whole & ~(floor(y * 0.5) * 2.0).equals(y)
    size = exp(y * log(abs(x)))
    size = where(y.equals(0.0) | abs(x).equals(1.0), 1.0, size)  # also of NaN and infinities
    nothing = (x < 0.0) & ~whole & (abs(x) < math.inf)
    power = where(nothing & ~abs(y).equals(math.inf), math.nan, size)
    power = where(x.equals(1.0) | y.equals(0.0), 1.0, power)
    sign = where(odd, x, 1.0).word() & SIGN
    return (power.word() ^ sign).real()
