"""Pieces that several functions need."""

from __future__ import annotations

from gough.kernels.value import Value

MAGIC = 1.5 * 2.0**52
"""Added to a small number it leaves the nearest whole number in the last bits."""
SIGN = 1 << 63
"""The bit of the sign."""
LN2_HIGH = float.fromhex("0x1.62e42fefa2000p-1")
"""ln 2 to 40 bits: its product with an exponent is exact."""
LN2_LOW = float.fromhex("0x1.9ef35793c7673p-41")
LN2_INVERSE = float.fromhex("0x1.71547652b82fep+0")
LEADING = (2**64 - 1) << 27
"""The bits that `leading` keeps."""


def with_sign_of(size: Value, x: Value) -> Value:
    """A number that is not negative, with the sign of x."""
    return (size.word() ^ (x.word() & SIGN)).real()


def leading(x: Value) -> Value:
    """x to 26 bits, towards zero: the product of two such numbers is exact (Dekker 1971)."""
    return (x.word() & LEADING).real()
