"""Coefficients of the polynomials in `gough.kernels.functions`: ``python tools/minimax.py``.

Chebyshev interpolation at 80 digits, rounded to float64; its largest error, relative to the
function that is interpolated, is within a small factor of the least possible. Sine and cosine have
the well-known minimax coefficients of Sun's fdlibm instead.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import mpmath as mp

SMALL = mp.mpf(10) ** -30
"""Instead of 0, where a formula would divide by it."""


def fit(name: str, function: Callable[[Any], Any], begin: Any, end: Any, count: int) -> None:
    """Print the coefficients of a polynomial, from the constant one up."""
    coefficients, error = mp.chebyfit(function, [begin, end], count, error=True)
    print(f"{name}: error {mp.nstr(error, 2)}")
    print(f"    {[float(c) for c in reversed(coefficients)]}")


def main() -> None:
    """Print all of them."""
    mp.mp.dps = 80
    root = mp.sqrt
    eighth = (mp.sqrt(2) - 1) * mp.mpf("1.0001")
    fit("ATAN", lambda z: (mp.atan(root(z)) / root(z) - 1) / z, SMALL, eighth**2, 12)
    fit("ASIN", lambda z: (mp.asin(root(z)) / root(z) - 1) / z, SMALL, mp.mpf("0.25"), 13)
    half = mp.log(2) / 2 * mp.mpf("1.001")
    fit(
        "EXP",
        lambda r: (mp.expm1(r) - r) / r**2 if abs(r) > SMALL else mp.mpf("0.5"),
        -half,
        half,
        11,
    )
    s = (mp.sqrt(2) - 1) / (mp.sqrt(2) + 1) * mp.mpf("1.001")
    fit("LOG", lambda z: (2 * mp.atanh(root(z)) / root(z) - 2) / z, SMALL, s**2, 7)
    fit("ERF", lambda z: mp.erf(root(z)) / root(z) - 1, SMALL, mp.mpf(1), 12)
    scaled = lambda t: mp.erfc(1 / t - 2) * mp.exp((1 / t - 2) ** 2)  # noqa: E731
    fit("ERFCX", scaled, mp.mpf(1) / 8, mp.mpf(1) / 3, 15)


if __name__ == "__main__":
    main()
