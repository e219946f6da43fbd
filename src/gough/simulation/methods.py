"""Integrators by name."""

from __future__ import annotations

from collections.abc import Callable

from gough.numerics.integration import Runs, integrate
from gough.numerics.sundials import adams, bdf

METHODS: dict[str, Callable[..., Runs]] = {
    "dormand-prince": integrate,
    "adams": adams,
    "bdf": bdf,
}
"""Dormand and Prince 5(4), compiled; Adams-Moulton of variable order (1 to 12) and backward
differences of variable order (1 to 5) of SUNDIALS CVODE, which takes scikit-sundae."""
