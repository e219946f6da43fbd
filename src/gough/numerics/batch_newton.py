"""Damped Newton steps for F(x; p) = 0, for many rows (x, p) at once.

Each row goes its own way: the method, the damping and the endings are those of `newton.solve`,
with the equations and their derivative given as machine code. Its numbers are the same bits
whatever the other rows, their order and the number of threads.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gough.numerics import newton
from gough.numerics.batches import check_whole, in_parts, reals, workers
from gough.numerics.newton import Ending

Array = NDArray[np.float64]

ENDINGS = tuple(Ending)
"""The ending of each code."""
TRIES = 30
"""Ever more damped steps from one point before it counts as the closest."""
PAYS_FROM = 1_000_000
"""Rows times m n min(m, n) from which threads pay: some milliseconds of work; a guess."""


@dataclass(frozen=True)
class BatchSolution:
    """Outcome of each row."""

    x: Array
    """The best point found, (rows, n)."""
    gap: Array
    """Largest absolute residual there, scaled, (rows,); infinite where it is not finite."""
    ending: NDArray[np.int8]
    """How each row ended: its place in `ENDINGS`, (rows,)."""
    steps: NDArray[np.int64]
    """Steps taken, (rows,)."""

    def ended(self, ending: Ending) -> NDArray[np.bool_]:
        """Which rows ended so."""
        return np.asarray(self.ending == ENDINGS.index(ending))


def solve_batch(
    residual: int,
    jacobian: int,
    x0: ArrayLike,
    p: ArrayLike,
    equations: int,
    tolerance: float = 1e-12,
    max_steps: int = 120,
    *,
    retraction: int = 0,
    row_scale: ArrayLike | None = None,
    x_scale: ArrayLike | None = None,
    threads: int | None = None,
) -> BatchSolution:
    """Solve F(x; p) = 0 from each start.

    Kernels are given by the addresses of their code (`calling` says how they are called); their
    owners must live until this returns. A kernel leaves out inputs without numbers.

    Args:
        residual: F of inputs x (n), p (k), output (m).
        jacobian: derivative of F by the step, of the same inputs, output (m, v) by rows.
        x0: starts, (rows, n).
        p: parameters, (rows, k), or (k,) for all rows.
        equations: m, how many.
        tolerance: largest scaled residual of a root.
        max_steps: steps before giving up.
        retraction: of inputs x (n) and step (v), output the point (n) the step leads to; 0 if
            steps are added to x, then v = n.
        row_scale: what multiplies each equation so that they compare, (m,); 1 by default.
        x_scale: what each number of a step is a multiple of, (v,); 1 by default, 0 holds it.
            Needed with a retraction: its length is v.
        threads: how many work on it; all cores for large batches by default. Results do not
            depend on it.

    Raises:
        ValueError: an argument has the wrong shape or value; the message names it.
    """
    check_whole("equations", equations)
    check_whole("max_steps", max_steps)
    x = reals("x0", x0, ("rows", "n"))
    rows, n = x.shape
    parameters = _parameters(p, rows)
    if retraction and x_scale is None:
        raise ValueError("x_scale is None, expected shape (v,): a retraction is given")
    rates = reals("x_scale", np.ones(n) if x_scale is None else x_scale, ("v",))
    if not retraction and rates.shape != (n,):
        raise ValueError(f"x_scale has shape {rates.shape}, expected {(n,)}")
    scale = reals("row_scale", np.ones(equations) if row_scale is None else row_scale, ("m",))
    if scale.shape != (equations,):
        raise ValueError(f"row_scale has shape {scale.shape}, expected {(equations,)}")
    found = BatchSolution(
        x.copy(), np.zeros(rows), np.zeros(rows, np.int8), np.zeros(rows, np.int64)
    )
    numbers = rows * equations * len(rates) * min(equations, len(rates))
    sharing = workers(numbers >= PAYS_FROM, threads)
    if rows and equations:
        kernels = (residual, jacobian, retraction)
        _run(kernels, (tolerance, max_steps), sharing, (parameters, scale, rates), found)
    return found


def _run(
    kernels: tuple[int, int, int],
    limits: tuple[float, int],
    threads: int,
    data: tuple[Array, Array, Array],
    found: BatchSolution,
) -> None:
    """Solve the rows in place; numba is loaded here."""
    from gough.numerics import newton_loops as loops

    p, row_scale, x_scale = data
    sizes = (found.x.shape[1], len(x_scale), len(row_scale), p.shape[1])
    rules = loops.Rules(
        float(limits[0]),
        int(limits[1]),
        newton.CLOSED_AT_START,
        newton.ROUNDING,
        newton.STALL,
        newton.LARGEST_STEP,
        TRIES,
    )
    reals, whole = loops.room(*sizes)

    def solve(first: int, last: int) -> None:
        loops.solve_rows_compiled(
            loops.Kernels(*kernels),
            loops.Shape(*sizes, len(p) > 1),
            rules,
            first,
            last,
            found.x,
            *data,
            found.gap,
            found.ending,
            found.steps,
            np.zeros(reals),
            np.zeros(whole, np.int64),
        )

    in_parts(solve, len(found.x), threads)


def _parameters(p: ArrayLike, rows: int) -> Array:
    """(rows, k), or (1, k) if all rows have the same."""
    values = np.asarray(p)
    if values.ndim == 1:
        return reals("p", values[None], ("1", "k"))
    if values.ndim != 2 or values.shape[0] != rows:
        raise ValueError(f"p has shape {values.shape}, expected ({rows}, k) or (k,)")
    return reals("p", values, ("rows", "k"))
