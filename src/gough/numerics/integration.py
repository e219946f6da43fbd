"""Initial value problems: many runs of one system of equations, each with steps of its own."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from enum import Enum
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from gough.numerics.batches import cores

Array = NDArray[np.float64]

MOST_STEPS = 10_000_000
"""Steps of one run at most."""
EVENTS = 64
"""Events of a run that are noted, unless more are asked for."""
LEAST_ATOL = 1e-70
"""Absolute tolerances below this would vanish when products of their squares are made."""
WIDEST = 8
"""Lanes of a loop over many runs."""


class Ending(Enum):
    """How a run ended; the text is what the user reads."""

    finished = "reached the end of its time"
    stopped = "stopped at an event"
    guarded = "stopped where the model loses its regularity"
    step_limit = "took the largest number of steps: it may be stiff, or `max_steps` too low"
    too_small = "steps became too small: the motion is not smooth there, or too stiff"
    not_finite = "numbers became infinite: the mechanism left what its model describes"
    drifted = "the loops could not be closed again: the mechanism is at a singularity"


ENDINGS = tuple(Ending)


@dataclass(frozen=True)
class Event:
    """What is looked for during a run."""

    name: str
    kind: str
    """switch, mark, stop or guard; see `integration_loops`."""
    direction: int = 0
    """1 rising, -1 falling, 0 both."""


KINDS = ("switch", "mark", "stop", "guard")


@dataclass(frozen=True)
class Constraints:
    """Equations F(q, p) = 0 that the first states obey; kernels over tiles of one lane."""

    rows: int
    """Address of (q, p) -> F, ∂F/∂δ by rows."""
    move: int
    """Address of (q, p, δ) -> q."""
    unknowns: int
    positions: int
    tolerance: float = 1e-11


@dataclass(frozen=True)
class Problem:
    """ẏ = f(t, y; signals, branches, prepared numbers), and the values of events behind ẏ.

    The owners of addresses must live as long as this does.
    """

    address: Callable[[int], int]
    """Of the kernel over tiles for a number of lanes; a tile holds t, y, signals, branches, and
    prepared numbers; switches are the first events, one branch each."""
    states: int
    events: tuple[Event, ...] = ()
    prepared: int = 0
    breaks: Array = field(default_factory=lambda: np.zeros(0))
    """Where pieces of signals begin, s, (pieces,)."""
    coefficients: Array = field(default_factory=lambda: np.zeros((0, 0, 6)))
    """Coefficients of powers of the time since then, (pieces, signals, 6)."""
    quaternions: tuple[int, ...] = ()
    """Where unit quaternions begin among the states."""
    constraints: Constraints | None = None

    @property
    def switches(self) -> int:
        """How many events are switches."""
        return sum(event.kind == "switch" for event in self.events)


def closest(rtol: float, span: tuple[float, float]) -> float:
    """How closely events are located, s: a thousandth of rtol, but not below rounding of times."""
    start, end = span
    return max(1e-3 * rtol * (end - start), 1e-14 * max(abs(start), abs(end)))


def signal_values(
    breaks: Array, coefficients: Array, t: Array, begun: Array | None = None
) -> Array:
    """Values of signals at some times, (times, signals).

    Args:
        breaks: where pieces begin, s.
        coefficients: of powers of the time since then, (pieces, signals, 6).
        t: the times, s.
        begun: times in the pieces to take, s; t by default.
    """
    begun = t if begun is None else begun
    piece = np.clip(np.searchsorted(breaks, begun, side="right") - 1, 0, None)
    if not len(breaks):
        return np.zeros((len(t), coefficients.shape[1]))
    s, found = (t - breaks[piece])[:, None], np.zeros((len(t), coefficients.shape[1]))
    for power in reversed(range(6)):
        found = found * s + coefficients[piece, :, power]
    return found


@dataclass(frozen=True)
class Tolerances:
    """How accurately to integrate, and when to give up."""

    rtol: float = 1e-6
    atol: Array = field(default_factory=lambda: np.array([1e-6]))
    """One for all states, or one for each."""
    reversal: float | None = None
    """How far a switch may be beyond zero, in its unit; 0.01 √rtol if None."""
    closeness: float | None = None
    """How closely other events are located, s; see `closest`."""
    guard: float = 0.0
    """A run ends where a guard's value falls below this."""
    exact: bool = True
    """Whether steps end at marks; else their times are interpolated, to third order of a step."""
    once: bool = False
    """Whether only the first of each interpolated mark is noted, of up to 63 marks."""
    first_step: float = 0.0
    largest_step: float = np.inf
    max_steps: int = MOST_STEPS


@dataclass(frozen=True)
class Runs:
    """Results; a row for each run."""

    states: Array
    """At the end, (runs, states)."""
    branches: Array
    times: Array
    """Of the end, s, (runs,)."""
    ending: NDArray[np.int8]
    """Index in `ENDINGS`, (runs,)."""
    counts: NDArray[np.int64]
    """Steps taken, steps refused, evaluations, events, (runs, 4)."""
    event_times: Array
    """(runs, room); those that did not happen are NaN."""
    event_kinds: NDArray[np.int64]
    """Index of the event, -1 where there is none."""
    samples: Array
    """States at the sample times, NaN behind the end, (runs, times, states)."""


def integrate(
    problem: Problem,
    states: Array,
    span: tuple[float, float],
    tolerances: Tolerances,
    prepared: Array | None = None,
    branches: Array | None = None,
    p: Array | None = None,
    sample_times: Array | None = None,
    room: int = EVENTS,
    width: int | None = None,
    threads: int | None = 1,
) -> Runs:
    """Integrate every run from its start to the end, or to where it ends before.

    The method is that of `dormand_prince`; results depend neither on ``width`` nor ``threads``.

    Args:
        problem: the equations.
        states: starts, (runs, states).
        span: first and last time, s.
        tolerances: of the local error, in the root mean square over the states.
        prepared: numbers that stay the same in a run, (runs, prepared).
        branches: 1 or 0 for each switch at the start, (runs, switches); 1 by default.
        p: parameters of the constraints, (runs, k).
        sample_times: when states are wanted, rising, s.
        room: events of a run that are noted.
        width: lanes; 1 for a single run, else 8 by default.
        threads: how many work on the runs; None for all cores.
    """
    runs = len(states)
    sample_times = np.zeros(0) if sample_times is None else np.array(sample_times, dtype=float)
    found = empty_runs(problem, states, span[0], branches, sample_times, room)
    given = np.zeros((runs, 0)) if prepared is None else np.ascontiguousarray(prepared, dtype=float)
    parameters = np.zeros((runs, 0)) if p is None else np.ascontiguousarray(p, dtype=float)
    _Loop(problem, span, tolerances, found, given, parameters, sample_times).run(width, threads)
    return found


def empty_runs(
    problem: Problem,
    states: Array,
    start: float,
    branches: Array | None,
    sample_times: Array,
    room: int,
) -> Runs:
    """Where the results of runs go, which stand at their starts."""
    runs, switches = len(states), problem.switches
    return Runs(
        np.array(states, dtype=float, order="C"),
        np.ones((runs, switches)) if branches is None else np.array(branches, dtype=float),
        np.full(runs, float(start)),
        np.zeros(runs, np.int8),
        np.zeros((runs, 4), np.int64),
        np.full((runs, room), np.nan),
        np.full((runs, room), -1, np.int64),
        np.full((runs, len(sample_times), problem.states), np.nan),
    )


class _Loop:
    """One call of the compiled loop; numba is loaded here."""

    def __init__(
        self,
        problem: Problem,
        span: tuple[float, float],
        tolerances: Tolerances,
        found: Runs,
        prepared: Array,
        p: Array,
        sample_times: Array,
    ) -> None:
        from gough.numerics import integration_loops as loops

        self.loops, self.problem, self.found = loops, problem, found
        self.given, self.p, self.sample_times = prepared, p, sample_times
        rtol = tolerances.rtol
        reversal, closeness = tolerances.reversal, tolerances.closeness
        self.rules = loops.Rules(
            float(span[0]),
            float(span[1]),
            float(rtol),
            float(tolerances.first_step),
            float(tolerances.largest_step),
            float(0.01 * np.sqrt(rtol) if reversal is None else reversal),
            float(closest(rtol, span) if closeness is None else closeness),
            float(tolerances.guard),
            bool(tolerances.exact),
            bool(tolerances.once),
            int(tolerances.max_steps),
        )
        signals = problem.coefficients.shape[1]
        self.shape = loops.Shape(
            problem.states, signals, problem.switches, len(problem.events), prepared.shape[1]
        )
        atol = np.array(np.broadcast_to(tolerances.atol, problem.states), dtype=float)
        self.atol = np.maximum(atol, LEAST_ATOL)

    def run(self, width: int | None, threads: int | None) -> None:
        """All runs, in threads that each take a part of them."""
        from concurrent.futures import ThreadPoolExecutor

        runs = len(self.found.states)
        wide = width or (1 if runs == 1 else WIDEST)
        addresses = self.problem.address(wide), self.problem.address(1)
        workers = min(threads or cores(), max(1, runs // wide))
        if workers == 1:
            self._part(wide, addresses, 0, runs)
            return
        borders = np.linspace(0, runs, workers + 1).astype(int).tolist()
        with ThreadPoolExecutor(workers) as pool:
            parts = pairwise(borders)
            list(pool.map(lambda part: self._part(wide, addresses, *part), parts))

    def _part(self, wide: int, addresses: tuple[int, int], first: int, last: int) -> None:
        loops, problem, found = self.loops, self.problem, self.found
        reals, whole = loops.room(wide, self.shape)
        c, k = problem.constraints, self.p.shape[1]
        n, m = (0, 0) if c is None else (c.positions, c.unknowns)
        arrays = loops.Arrays(
            found.states,
            self.given,
            found.branches,
            self.atol,
            found.times,
            found.ending,
            found.counts,
            found.event_times,
            found.event_kinds,
            found.samples,
            self.sample_times,
            np.ascontiguousarray(problem.breaks, dtype=float),
            np.ascontiguousarray(problem.coefficients, dtype=float),
            np.array([KINDS.index(event.kind) for event in problem.events], np.int64),
            np.array([event.direction for event in problem.events], np.int64),
            np.array(problem.quaternions, np.int64),
            self.p,
            np.zeros(n + k + m + 1),
            np.zeros(max(n, m + m * m) + 1),
        )
        equations = loops.Equations(0, 0, 0, 0, 0.0)
        if c is not None:
            equations = loops.Equations(c.rows, c.move, m, n, float(c.tolerance))
        loops.run_rows_compiled(
            (0,) * wide,
            *addresses,
            self.shape,
            self.rules,
            equations,
            first,
            last,
            arrays,
            np.zeros(reals),
            np.zeros(whole, np.int64),
        )
