"""Elementary functions written in primitives, so that every back end computes the same bits."""

from __future__ import annotations

from collections.abc import Callable

from gough.kernels.functions import (
    arcs,
    error_function,
    exponentials,
    hyperbolics,
    logarithms,
    powers,
    sines,
)
from gough.kernels.value import Value

FORMULAS: dict[str, Callable[..., Value]] = {
    "sin": sines.sin,
    "cos": sines.cos,
    "tan": sines.tan,
    "asin": arcs.asin,
    "acos": arcs.acos,
    "atan": arcs.atan,
    "atan2": arcs.atan2,
    "exp": exponentials.exp,
    "expm1": exponentials.expm1,
    "log": logarithms.log,
    "log1p": logarithms.log1p,
    "sinh": hyperbolics.sinh,
    "cosh": hyperbolics.cosh,
    "tanh": hyperbolics.tanh,
    "erf": error_function.erf,
    "pow": powers.pow_,
}
"""For every function of a tape how it is written in primitives."""

BOUNDS: dict[str, float] = {
    **{"sin": 1.0, "cos": 1.0, "tan": 3.0},
    **{"asin": 1.25, "acos": 1.25, "atan": 1.5, "atan2": 1.75},
    **{"exp": 1.0, "expm1": 1.25, "log": 1.0, "log1p": 1.0},
    **{"sinh": 1.75, "cosh": 1.75, "tanh": 1.75},
    **{"erf": 1.5, "pow": 1.25},
}
"""The largest error of each function over its whole range, in ulp."""
