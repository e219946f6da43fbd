"""Large batches on several cores."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

PAYS_FROM = 50_000_000
"""Operations from which starting threads costs less than it gains: about a millisecond of work."""


def cores() -> int:
    """Cores this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def parts(operations: int, threads: int | None) -> int:
    """In how many parts a batch is done.

    Raises:
        ValueError: ``threads`` is no positive whole number.
    """
    if threads is None:
        return cores() if operations >= PAYS_FROM else 1
    if isinstance(threads, bool) or not isinstance(threads, int | np.integer) or threads < 1:
        raise ValueError(f"threads is {threads!r}, expected a whole number from 1 up, or None")
    return int(threads)


def run(
    function: Callable[..., Any],
    arrays: Sequence[Array],
    out: Array,
    batch: tuple[int, ...],
    parts: int,
) -> None:
    """Fill ``out``, its longest leading axis cut in parts; numpy lets go of the interpreter."""
    if parts == 1 or not batch:
        function(*arrays, out=out)
        return
    axis = int(np.argmax(batch))
    borders = np.linspace(0, batch[axis], min(parts, batch[axis]) + 1).astype(int)
    spread = [np.broadcast_to(array, (*batch, array.shape[-1])) for array in arrays]
    whole = (slice(None),) * axis

    def work(begin: int, end: int) -> None:
        place = (*whole, slice(begin, end))
        function(*[array[place] for array in spread], out=out[place])

    with ThreadPoolExecutor(len(borders) - 1) as pool:
        for done in [pool.submit(work, *pair) for pair in pairwise(borders)]:
            done.result()
