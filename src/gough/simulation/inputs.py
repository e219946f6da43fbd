"""What commanded laws are told: numbers that stay, and tables over time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gough.errors import ConfigurationError, UnknownName
from gough.simulation.forces import DRIVE, Placed

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Inputs:
    """Commands by name of the law."""

    constant: dict[str, float] = field(default_factory=dict)
    tabled: tuple[str, ...] = ()
    breaks: Array = field(default_factory=lambda: np.zeros(0))
    coefficients: Array = field(default_factory=lambda: np.zeros((0, 0, 6)))
    """Of powers of the time since a break, (pieces, tabled, 6)."""


def read_inputs(given: Mapping[str, Any] | None, laws: Sequence[Placed]) -> Inputs:
    """Commands that a person gives.

    Args:
        given: for a joint, or a law by its full name, a number, or a table (times, values) that is
            joined by straight lines and stays at its ends.
        laws: those of the mechanism.

    Raises:
        UnknownName: there is no such joint or law that takes a command.
        ConfigurationError: a value is neither a number nor such a table.
    """
    constant: dict[str, float] = {}
    tables: dict[str, tuple[Array, Array]] = {}
    for name, value in (given or {}).items():
        law = _law(name, laws)
        if isinstance(value, tuple | list) and len(value) == 2 and np.ndim(value[0]) == 1:
            tables[law] = _table(name, value)
        else:
            constant[law] = _number(name, value)
    if not tables:
        return Inputs(constant)
    breaks, coefficients = _pieces(list(tables.values()))
    return Inputs(constant, tuple(tables), breaks, coefficients)


def _law(name: str, laws: Sequence[Placed]) -> str:
    commanded = [law for law in laws if law.law.commanded]
    own = [law.name for law in commanded if name in (law.name, law.joint)]
    if len(own) == 1:
        return own[0]
    if own:
        raise ConfigurationError(f"{name} takes several commands; name one of {', '.join(own)}")
    known = [law.joint if law.name.endswith(f".{DRIVE}") else law.name for law in commanded]
    raise UnknownName("joint or law that takes a command", name, known)


def _number(name: str, value: Any) -> float:
    try:
        found = float(value)
    except (TypeError, ValueError):
        found = np.nan
    if not np.isfinite(found):
        raise ConfigurationError(
            f"input {name} is {value!r}, expected a number, or a table (times, values)"
        )
    return found


def _table(name: str, value: Sequence[Any]) -> tuple[Array, Array]:
    try:
        times, values = (np.asarray(x, dtype=float) for x in value)
    except (TypeError, ValueError):
        raise ConfigurationError(
            f"input {name} is a table of something that is no number"
        ) from None
    if times.ndim != 1 or times.shape != values.shape or len(times) < 2:
        raise ConfigurationError(
            f"input {name} has times of shape {times.shape} and values of shape {values.shape}; "
            "give as many values as times, two at least"
        )
    if not (np.isfinite(times).all() and np.isfinite(values).all() and np.all(np.diff(times) > 0)):
        raise ConfigurationError(f"input {name} needs finite values at times that rise")
    return times, values


def _pieces(tables: Sequence[tuple[Array, Array]]) -> tuple[Array, Array]:
    """All tables on common pieces."""
    breaks = np.unique(np.concatenate([times for times, _ in tables]))
    breaks = np.concatenate([[min(0.0, breaks[0]) - 1.0], breaks])
    coefficients = np.zeros((len(breaks), len(tables), 6))
    for k, (times, values) in enumerate(tables):
        at = np.interp(breaks, times, values)
        slopes = np.append(np.diff(at) / np.diff(breaks), 0.0)
        coefficients[:, k, 0], coefficients[:, k, 1] = at, slopes
    return breaks, coefficients
