"""Outputs of an ensemble as an array, and their names.

A run that failed has NaN in its outputs; whatever is not finite counts as no value.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gough.uncertainty.errors import EnsembleError

Array = NDArray[np.float64]


def as_outputs(outputs: ArrayLike, rows: int | None = None, what: str = "outputs") -> Array:
    """Outputs as (rows, outputs), whether one or several were given.

    Raises:
        EnsembleError: there are other rows than these, or none.
    """
    values = np.asarray(outputs, np.float64)
    if values.ndim not in (1, 2) or values.size == 0:
        raise EnsembleError(f"{what} have the shape {values.shape}, expected (rows,) or (rows, m)")
    if rows is not None and len(values) != rows:
        raise EnsembleError(f"{what} have {len(values)} rows, expected {rows}")
    return values if values.ndim == 2 else values[:, None]


def output_names(values: Array, names: Sequence[str] | None, letter: str = "y") -> tuple[str, ...]:
    """The names of columns, y or y1, y2 … by default.

    Raises:
        EnsembleError: there are more or fewer names than columns.
    """
    columns = values.shape[1]
    if names is None:
        return (letter,) if columns == 1 else tuple(f"{letter}{k + 1}" for k in range(columns))
    if isinstance(names, str) or len(names) != columns:
        raise EnsembleError(f"{columns} columns are named {names!r}, expected a name for each")
    return tuple(names)


def checked_confidence(confidence: float) -> float:
    """The confidence of an interval.

    Raises:
        EnsembleError: it is not between 0 and 1.
    """
    if not 0 < confidence < 1:
        raise EnsembleError(f"confidence is {confidence}, expected a number between 0 and 1")
    return confidence
