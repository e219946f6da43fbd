"""Newton steps made by one kernel, for many rows (x, a) at once or for one.

A step kernel is machine code (`calling` says how it is called) of inputs x (n), a (k), p (m) and
output (n + 2): the point that a full Newton step from x leads to, the gap max |r(x)| before the
step, and a number d(x) like the determinant of the Jacobian, which changes its sign where the
Jacobian is singular. Where an equation or its derivative is not finite, the gap or d must not be.

A row takes steps until its gap is within tolerance. It never leaves the side of the singularity on
which it starts: if a step leads across, the row ends there. No step is damped, so starts must be
near; `batch_newton` is for starts that are not. A row's numbers are the same bits whatever the
other rows, their order and the number of threads, and the same as those of a `Stepper`.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

MAX_STEPS = 12
"""Steps that converge at all need about half of these; a guess."""
GROWTHS = 3
"""So many times on end the gap may grow; a guess. After a long first step it may once or twice."""
PAYS_FROM = 300_000
"""Rows times n from which threads pay: some milliseconds of work; a guess."""
PARTS_PER_THREAD = 8
"""Parts of a batch per thread, so that a part with hard rows does not hold up the end."""


class StepEnding(Enum):
    """How a row ended; the text is what the user reads."""

    closed = "every loop closes within tolerance"
    crossed = "a step led across a type 2 singularity: start nearer, or farther from it"
    not_finite = "the equations have no finite value at the start or where a step led"
    diverged = "the gap grew step by step: start nearer; there may be no solution"
    step_limit = "the gap was above tolerance when the steps ran out"


ENDINGS = tuple(StepEnding)
"""The ending of each code."""


@dataclass(frozen=True)
class Stepped:
    """Outcome of each row.

    The point of a row that did not close is the last with the smallest gap of all that it came by,
    on the side of the singularity where it started.
    """

    x: Array
    """(rows, n)."""
    gap: Array
    """max |r| there, (rows,); infinite where it is not finite at the start, which then is x."""
    ending: NDArray[np.int8]
    """How each row ended: its place in `ENDINGS`, (rows,)."""
    steps: NDArray[np.int64]
    """Steps taken, (rows,)."""

    def ended(self, ending: StepEnding) -> NDArray[np.bool_]:
        """Which rows ended so."""
        return np.asarray(self.ending == ENDINGS.index(ending))


def step_batch(
    wide_address: int,
    scalar_address: int,
    x0: ArrayLike,
    a: ArrayLike,
    p: ArrayLike,
    tolerance: float = 1e-12,
    max_steps: int = MAX_STEPS,
    threads: int | None = None,
) -> Stepped:
    """Solve r(x; a, p) = 0 from each start.

    Args:
        wide_address: of a step kernel that takes several rows at a time; its owner must live until
            this returns.
        scalar_address: of the same for one row; it must give the same bits.
        x0: starts, (rows, n), n from 1 up.
        a: what each row has for itself, (rows, k).
        p: what all rows share, (m,).
        tolerance: largest gap of a solution, in the kernel's unit.
        max_steps: steps before giving up.
        threads: how many work on it; all cores for large batches by default. Results do not
            depend on it.

    Raises:
        ValueError: an argument has the wrong shape or value; the message names it.
    """
    x, own, shared = (_reals(*named) for named in (("x0", x0, 2), ("a", a, 2), ("p", p, 1)))
    _check_steps(max_steps)
    rows, n = x.shape
    if n == 0:
        raise ValueError(f"x0 has shape {x.shape}, expected (rows, n) with n from 1 up")
    if len(own) != rows:
        raise ValueError(f"a has shape {own.shape}, expected ({rows}, k)")
    workers = _workers(rows * n, threads)
    found = Stepped(x.copy(), np.empty(rows), np.empty(rows, np.int8), np.empty(rows, np.int64))
    limits = (float(tolerance), int(max_steps), GROWTHS)
    solve = _solver((wide_address, scalar_address), limits, own, shared, found)
    if workers == 1 or rows < 2:
        solve(0, rows)
        return found
    borders = np.linspace(0, rows, min(workers * PARTS_PER_THREAD, rows) + 1).astype(int).tolist()
    with ThreadPoolExecutor(workers) as pool:
        list(pool.map(solve, borders[:-1], borders[1:]))
    return found


def _solver(
    addresses: tuple[int, int], limits: tuple[float, int, int], a: Array, p: Array, found: Stepped
) -> Callable[[int, int], None]:
    """What solves rows from one to before another in place; numba is loaded here."""
    from gough.numerics import stepping_loops as loops

    n, k = found.x.shape[1], a.shape[1]
    kernels, rules = loops.Kernels(*addresses), loops.Rules(*limits)

    def solve(first: int, last: int) -> None:
        slots = min(loops.SLOTS, max(last - first, 1))
        reals, whole = loops.room(n, k, slots)
        loops.batch_compiled(
            kernels,
            loops.Shape(n, k, len(p), slots),
            rules,
            first,
            last,
            found.x,
            a,
            p,
            found.gap,
            found.ending,
            found.steps,
            np.empty(reals),
            np.empty(whole, np.int64),
        )

    return solve


class Stepper:
    """The same for one row at a time, in about a microsecond: ``stepper(x0, a)``.

    Args:
        address: of a step kernel; its owner must live as long as this. For one row, code that takes
            one at a time is the faster mostly.
        n: numbers of a point, from 1 up.
        k: numbers of a.
        p: what all calls share, (m,); copied.
        tolerance: largest gap of a solution, in the kernel's unit.
        max_steps: steps before giving up.

    Raises:
        ValueError: an argument has the wrong shape or value; the message names it.
    """

    def __init__(
        self,
        address: int,
        n: int,
        k: int,
        p: ArrayLike,
        tolerance: float = 1e-12,
        max_steps: int = MAX_STEPS,
    ) -> None:
        from gough.numerics import stepping_loops as loops

        _check_steps(max_steps)
        if n < 1 or k < 0:
            raise ValueError(f"n is {n} and k is {k}, expected n from 1 and k from 0 up")
        self.n, self.k = n, k
        shared = _reals("p", p, 1)
        shape = loops.Shape(n, k, len(shared), 1)
        rules = loops.Rules(float(tolerance), int(max_steps), GROWTHS)
        self._reals, self._whole = loops.row_room(address, shape, rules, shared)
        self._step_row = loops.row_compiled()

    def __call__(self, x0: ArrayLike, a: ArrayLike) -> tuple[Array, int, int]:
        """The solution near a start.

        Args:
            x0: the start, (n,).
            a: (k,).

        Returns:
            x, (n,), how the row ended: its place in `ENDINGS`, and the steps taken. If it did not
            close, x is what `Stepped` says.

        Raises:
            ValueError: an argument has the wrong shape or holds no real numbers.
        """
        x, own = np.array(x0), np.array(a)  # in order and writeable, as compiled code wants them
        try:
            ending, steps = self._step_row(x, own, self._reals, self._whole)
        except TypeError:  # not float64, or not one axis
            x, own = _reals("x0", x, 1), _reals("a", own, 1)
            ending, steps = self._step_row(x, own, self._reals, self._whole)
        if ending < 0:
            raise ValueError(
                f"x0 and a have shapes {x.shape} and {own.shape}, "
                f"expected ({self.n},) and ({self.k},)"
            )
        return x, ending, steps


def _check_steps(max_steps: int) -> None:
    whole = isinstance(max_steps, int | np.integer) and not isinstance(max_steps, bool)
    if not whole or max_steps < 0:
        raise ValueError(f"max_steps is {max_steps!r}, expected a whole number from 0 up")


def _workers(numbers: int, threads: int | None) -> int:
    """How many threads work on a batch."""
    if threads is None:
        return _cores() if numbers >= PAYS_FROM else 1
    if isinstance(threads, bool) or not isinstance(threads, int | np.integer) or threads < 1:
        raise ValueError(f"threads is {threads!r}, expected a whole number from 1 up, or None")
    return int(threads)


def _cores() -> int:
    """Cores this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def _reals(name: str, given: ArrayLike, axes: int) -> Array:
    """An array of float64 that compiled loops may read as it stands."""
    values = np.asarray(given)
    if values.ndim != axes:
        raise ValueError(f"{name} has shape {values.shape}, expected {axes} axes")
    if not np.can_cast(values.dtype, np.float64, "same_kind"):
        raise ValueError(f"{name} holds {values.dtype}, expected real numbers")
    # one type for numba: in order, aligned and, though never written, writeable
    return np.require(values, np.float64, ["C", "A", "W"])
