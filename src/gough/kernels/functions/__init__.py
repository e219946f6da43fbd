"""Elementary functions written in primitives, so that every back end computes the same bits."""

from __future__ import annotations

from collections.abc import Callable

from gough.kernels.value import Value

FORMULAS: dict[str, Callable[..., Value]] = {}
"""For every function of a tape how it is written in primitives."""
