"""What solvers of many rows share: arrays for compiled loops, and threads that share the rows."""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

PARTS_PER_THREAD = 8
"""Parts of a batch per thread, so that a part with hard rows does not hold up the end."""


def reals(name: str, given: ArrayLike, shape: tuple[str, ...]) -> Array:
    """An array of float64 that compiled loops may read as it stands.

    Args:
        name: what messages call it.
        given: the numbers.
        shape: a word for each axis.

    Raises:
        ValueError: it has other axes, or holds no real numbers.
    """
    values = np.asarray(given)
    expected = f"({', '.join(shape)}{',' if len(shape) == 1 else ''})"
    if values.ndim != len(shape):
        raise ValueError(f"{name} has shape {values.shape}, expected {expected}")
    if not np.can_cast(values.dtype, np.float64, "same_kind"):
        raise ValueError(f"{name} holds {values.dtype}, expected real numbers")
    # one type for numba: in order, aligned and, though never written, writeable
    return np.require(values, np.float64, ["C", "A", "W"])


def check_whole(name: str, count: int) -> None:
    """Raise ValueError unless a count is a whole number from 0 up."""
    if isinstance(count, bool) or not isinstance(count, int | np.integer) or count < 0:
        raise ValueError(f"{name} is {count!r}, expected a whole number from 0 up")


def workers(worth: bool, threads: int | None) -> int:
    """How many threads work on a batch.

    Args:
        worth: whether the batch is large enough to be shared.
        threads: as asked for; None for all cores if it is worth it.

    Raises:
        ValueError: threads is no whole number from 1 up.
    """
    if threads is None:
        return cores() if worth else 1
    if isinstance(threads, bool) or not isinstance(threads, int | np.integer) or threads < 1:
        raise ValueError(f"threads is {threads!r}, expected a whole number from 1 up, or None")
    return int(threads)


def cores() -> int:
    """Cores this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def in_parts(solve: Callable[[int, int], None], rows: int, threads: int) -> None:
    """Call ``solve(first, last)`` for parts of the rows: from first to last - 1, each row once."""
    if threads == 1 or rows < 2:
        solve(0, rows)
        return
    borders = np.linspace(0, rows, min(threads * PARTS_PER_THREAD, rows) + 1).astype(int).tolist()
    with ThreadPoolExecutor(min(threads, rows)) as pool:
        list(pool.map(solve, borders[:-1], borders[1:]))
