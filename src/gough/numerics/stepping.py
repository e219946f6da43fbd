"""Newton steps made by one kernel, for many rows (x, a) at once or for one.

A step kernel is machine code (`calling` says how it is called) of inputs x (n), a (k), p (m) and
output (n + 3): the point that a full Newton step from x leads to; a gap |r(x)| before the step; a
number d(x) like the determinant of the Jacobian, which changes its sign where the Jacobian is
singular; and the length of the step, in a unit in which all numbers of x compare. Where an equation
or its derivative is not finite, the gap or d must not be: a norm of all equations is safe, a
largest number may lose a NaN.

A row takes steps until its gap is within tolerance. No step is damped, so starts must be near
(`batch_newton` is for starts that are not), and two guards end a row that might reach a solution
other than the one that belongs to its start:

- it never leaves the side of the singularity on which it starts, or that it is given;
- each step must be a quarter as long as the one before, or less. The ratio of the first two steps
  estimates Kantorovich's number h by h / (2 - 2 h), exact at a fold, where h is 1/2 if the two
  solutions meet and 1/3 if the ratio is a quarter (Deuflhard 2004, ch. 2). To first order h is
  proportional to the change of a since the start was a solution, so that all smaller changes pass
  too: the solution is the one that following a in small steps leads to. At later steps the test
  costs nothing, and sees what the estimate of the first has missed.

The equations for a smaller change may differ from those for a by more than a number to each, and
the estimate is a local one; so the first step may have a largest length.

A row's numbers are the same bits whatever the other rows, their order and the number of threads,
and the same as those of a `Stepper`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gough.numerics.batches import check_whole, in_parts, reals, workers

Array = NDArray[np.float64]

MAX_STEPS = 12
"""Steps that converge at all need about half of these; a guess."""
GROWTHS = 3
"""So many times on end the gap may grow; a guess. After a long first step it may once or twice."""
CONTRACTION = 0.25
"""Longest step, in steps before, of a row that goes on: Kantorovich's number is 1/3 by then."""
NOTHING = 1e-7
"""Steps up to this may be followed by any other: rounding is all there is. It is far above rounding
unless the Jacobian's condition is beyond 1e8."""
PAYS_FROM = 300_000
"""Rows times n from which threads pay: some milliseconds of work; a guess."""


class StepEnding(Enum):
    """How a row ended; the text is what the user reads."""

    closed = "every loop closes within tolerance"
    crossed = "a step led across a type 2 singularity: start nearer, or farther from it"
    not_finite = "the equations have no finite value at the start or where a step led"
    far = "steps shrink too little to belong to one solution: start nearer"
    diverged = "the gap grew step by step: start nearer; there may be no solution"
    step_limit = "the gap was above tolerance when the steps ran out"


ENDINGS = tuple(StepEnding)
"""The ending of each code."""


class Code(Protocol):
    """Where the machine code of a kernel is; both variants give the same bits."""

    @property
    def wide(self) -> int:
        """Address of code that takes several rows at a time."""

    @property
    def scalar(self) -> int:
        """Address of code that takes one."""


class StepKernel(Protocol):
    """What owns the code of a step kernel: it lives as long as this."""

    @property
    def addresses(self) -> Code:
        """Its code."""


@dataclass(frozen=True)
class Stepped:
    """Outcome of each row.

    The point of a row that did not close is the last with the smallest gap of all that it came by,
    on the side of the singularity where it started.
    """

    x: Array
    """(rows, n)."""
    gap: Array
    """|r| there, (rows,); infinite where it is not finite at the start, which then is x."""
    ending: NDArray[np.int8]
    """How each row ended: its place in `ENDINGS`, (rows,)."""
    steps: NDArray[np.int64]
    """Steps taken, (rows,)."""

    def ended(self, ending: StepEnding) -> NDArray[np.bool_]:
        """Which rows ended so."""
        return np.asarray(self.ending == ENDINGS.index(ending))


def step_batch(
    kernel: StepKernel,
    x0: ArrayLike,
    a: ArrayLike,
    p: ArrayLike,
    tolerance: float = 1e-12,
    max_steps: int = MAX_STEPS,
    threads: int | None = None,
    *,
    contraction: float = CONTRACTION,
    longest: float = np.inf,
    side: ArrayLike | None = None,
) -> Stepped:
    """Solve r(x; a, p) = 0 from each start.

    Args:
        kernel: makes the steps.
        x0: starts, (rows, n), n from 1 up.
        a: what each row has for itself, (rows, k).
        p: what all rows share, (m,).
        tolerance: largest gap of a solution, in the kernel's unit.
        max_steps: steps before giving up.
        threads: how many work on it; all cores for large batches by default. Results do not
            depend on it.
        contraction: longest step, in steps before, of a row that goes on; infinite for any.
        longest: length of the longest first step, in the kernel's unit.
        side: numbers with the sign that d has to have all the way, (rows,); 0, the default, for
            that at the start.

    Raises:
        ValueError: an argument has the wrong shape or value; the message names it.
    """
    x, own = reals("x0", x0, ("rows", "n")), reals("a", a, ("rows", "k"))
    shared = reals("p", p, ("m",))
    check_whole("max_steps", max_steps)
    rows, n = x.shape
    if n == 0:
        raise ValueError(f"x0 has shape {x.shape}, expected (rows, n) with n from 1 up")
    if len(own) != rows:
        raise ValueError(f"a has shape {own.shape}, expected ({rows}, k)")
    sides = reals("side", np.zeros(rows) if side is None else side, ("rows",))
    if sides.shape != (rows,):
        raise ValueError(f"side has shape {sides.shape}, expected ({rows},)")
    found = Stepped(x.copy(), np.empty(rows), np.empty(rows, np.int8), np.empty(rows, np.int64))
    limits = _limits(tolerance, max_steps, contraction, longest)
    solve = _solver(kernel.addresses, limits, (own, shared, sides), found)
    in_parts(solve, rows, workers(rows * n >= PAYS_FROM, threads))
    return found


Limits = tuple[float, int, int, float, float, float]


def _limits(tolerance: float, max_steps: int, contraction: float, longest: float) -> Limits:
    """The numbers of `stepping_loops.Rules`."""
    return float(tolerance), int(max_steps), GROWTHS, float(contraction), NOTHING, float(longest)


def _solver(
    code: Code, limits: Limits, data: tuple[Array, Array, Array], found: Stepped
) -> Callable[[int, int], None]:
    """What solves rows from one to before another in place; numba is loaded here."""
    from gough.numerics import stepping_loops as loops

    a, p, _ = data
    n, k = found.x.shape[1], a.shape[1]
    kernels, rules = loops.Kernels(code.wide, code.scalar), loops.Rules(*limits)

    def solve(first: int, last: int) -> None:
        slots = min(loops.SLOTS, max(last - first, 1))
        numbers, whole = loops.room(n, k, slots)
        loops.batch_compiled(
            kernels,
            loops.Shape(n, k, len(p), slots),
            rules,
            first,
            last,
            found.x,
            *data,
            found.gap,
            found.ending,
            found.steps,
            np.empty(numbers),
            np.empty(whole, np.int64),
        )

    return solve


class Stepper:
    """The same for one row at a time, in some microseconds: ``stepper(x0, a)``.

    It uses the code that takes one row at a time.

    Args:
        kernel: makes the steps; it is kept.
        n: numbers of a point, from 1 up.
        k: numbers of a.
        p: what all calls share, (m,); copied.
        tolerance: largest gap of a solution, in the kernel's unit.
        max_steps: steps before giving up.
        contraction: longest step, in steps before, of a row that goes on; infinite for any.
        longest: length of the longest first step, in the kernel's unit.

    Raises:
        ValueError: an argument has the wrong shape or value; the message names it.
    """

    def __init__(
        self,
        kernel: StepKernel,
        n: int,
        k: int,
        p: ArrayLike,
        tolerance: float = 1e-12,
        max_steps: int = MAX_STEPS,
        *,
        contraction: float = CONTRACTION,
        longest: float = np.inf,
    ) -> None:
        from gough.numerics import stepping_loops as loops

        check_whole("max_steps", max_steps)
        if n < 1 or k < 0:
            raise ValueError(f"n is {n} and k is {k}, expected n from 1 and k from 0 up")
        self.kernel, self.n, self.k = kernel, n, k
        shared = reals("p", p, ("m",))
        shape = loops.Shape(n, k, len(shared), 1)
        rules = loops.Rules(*_limits(tolerance, max_steps, contraction, longest))
        self._reals, self._whole = loops.row_room(kernel.addresses.scalar, shape, rules, shared)
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
            x, own = reals("x0", x, ("n",)), reals("a", own, ("k",))
            ending, steps = self._step_row(x, own, self._reals, self._whole)
        if ending < 0:
            raise ValueError(
                f"x0 and a have shapes {x.shape} and {own.shape}, "
                f"expected ({self.n},) and ({self.k},)"
            )
        return x, ending, steps
