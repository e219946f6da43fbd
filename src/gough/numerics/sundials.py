"""SUNDIALS CVODE for the problems of `integration`: multistep methods of variable order.

Adams-Moulton formulas of orders 1 to 12, or backward differences of orders 1 to 5 (Hindmarsh and
others 2005), through scikit-sundae. The right-hand side is the same compiled kernel; runs are made
one after the other in Python, so this is for single runs and for comparison.
"""

from __future__ import annotations

import ctypes
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gough.errors import MissingExtra
from gough.numerics.integration import (
    ENDINGS,
    EVENTS,
    Constraints,
    Ending,
    Problem,
    Runs,
    Tolerances,
    empty_runs,
    signal_values,
)

Array = NDArray[np.float64]
Code = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_void_p)
SHORT = 40
"""Steps in a row that may be shorter than 1e-13 of the whole duration."""
FARTHEST, LOOSER = 1e-7, 100.0
"""Gap at which multistep formulas start anew on the equations, or so many relative tolerances:
they take many steps to regain their order. States that are handed out are put
back in any case; between them a gap does no more harm than the error of a step."""


def adams(*arguments: Any, **named: Any) -> Runs:
    """As `integration.integrate`, by Adams-Moulton formulas of variable order."""
    return _integrated("Adams", *arguments, **named)


def bdf(*arguments: Any, **named: Any) -> Runs:
    """As `integration.integrate`, by backward differences of variable order."""
    return _integrated("BDF", *arguments, **named)


def _integrated(
    formulas: str,
    problem: Problem,
    states: Array,
    span: tuple[float, float],
    tolerances: Tolerances,
    prepared: Array | None = None,
    branches: Array | None = None,
    p: Array | None = None,
    sample_times: Array | None = None,
    room: int = EVENTS,
    max_order: int = 0,
    **_: Any,
) -> Runs:
    """Every run, one after the other.

    Raises:
        MissingExtra: scikit-sundae is not installed.
    """
    times = np.zeros(0) if sample_times is None else np.array(sample_times, dtype=float)
    found = empty_runs(problem, states, span[0], branches, times, room)
    for k in range(len(states)):
        held = np.zeros(0) if prepared is None else prepared[k]
        parameters = np.zeros(0) if p is None else p[k]
        _Run(formulas, problem, span, tolerances, held, parameters, times, found, k, max_order).go()
    return found


@dataclass
class _Run:
    """One run."""

    formulas: str
    problem: Problem
    span: tuple[float, float]
    tolerances: Tolerances
    prepared: Array
    p: Array
    times: Array
    found: Runs
    k: int
    max_order: int

    def __post_init__(self) -> None:
        problem = self.problem
        self._code = Code(problem.address(1))
        signals = problem.coefficients.shape[1]
        n = problem.states
        self._given = np.zeros(1 + n + signals + problem.switches + len(self.prepared))
        self._signals = slice(1 + n, 1 + n + signals)
        self._branches = slice(1 + n + signals, 1 + n + signals + problem.switches)
        self._given[self._branches.stop :] = self.prepared
        self._out = np.zeros(n + len(problem.events))
        rtol, duration = self.tolerances.rtol, self.span[1] - self.span[0]
        given = self.tolerances.reversal
        self._reversal = 0.01 * np.sqrt(rtol) if given is None else given
        self._smallest, self._passed = 1e-13 * duration, 1e-12 * duration
        self._begun, self._flips, self._short = self.span[0], 0, 0
        self._farthest = max(FARTHEST, LOOSER * rtol)
        self._watched = [k for k, e in enumerate(problem.events) if e.kind != "guard"]
        self._guards = [k for k, e in enumerate(problem.events) if e.kind == "guard"]
        self._sample = 0

    # the equations

    def _evaluate(self, t: float, y: Array) -> Array:
        n = self.problem.states
        self._given[0], self._given[1 : 1 + n] = t, y
        if self._signals.stop > self._signals.start:
            self._given[self._signals] = self._told(t, self._begun)
        self._given[self._branches] = self.found.branches[self.k]
        self._code(self._given.ctypes.data, self._out.ctypes.data)
        return self._out

    def _told(self, t: float, begun: float) -> Array:
        """Signals at a time, of the piece in which another time lies."""
        problem, times = self.problem, np.array([float(t), float(begun)])
        found = signal_values(problem.breaks, problem.coefficients, times[:1], times[1:])
        return np.asarray(found[0])

    def _enter(self, t: float) -> float:
        """Where the piece of the signals that begins at a time or lies there ends, or the end."""
        self._begun = t + self._passed
        later = self.problem.breaks[self.problem.breaks > self._begun]
        return min(float(later[0]), self.span[1]) if len(later) else self.span[1]

    def _jumps(self, t: float) -> bool:
        """Whether signals jump at a time where a piece ends."""
        before, behind = self._told(t, self._begun), self._told(t, t + self._passed)
        return not np.all(np.abs(behind - before) <= 1e-12 * (np.abs(behind) + np.abs(before)))

    def _rates(self, t: float, y: Array, yp: Array) -> None:
        yp[:] = self._evaluate(t, y)[: self.problem.states]
        self.found.counts[self.k, 2] += 1

    def _values(self, t: float, y: Array, values: Array) -> None:
        values[:] = self._evaluate(t, y)[self.problem.states :][self._watched]

    def _solver(self, events: bool = True) -> Any:
        """A solver, which may stop at events."""
        try:
            from sksundae.cvode import CVODE
        except ImportError as error:
            raise MissingExtra(
                "an integration by Adams formulas or BDF", "scikit-sundae", "ode"
            ) from error
        options: dict[str, Any] = {"max_order": self.max_order} if self.max_order else {}
        if self._watched and events:
            values = lambda t, y, found: self._values(t, y, found)  # noqa: E731
            directions = [self.problem.events[k].direction for k in self._watched]
            values.terminal = [True] * len(self._watched)  # type: ignore[attr-defined]
            values.direction = directions  # type: ignore[attr-defined]
            options |= {"eventsfn": values, "num_events": len(self._watched)}
        largest = self.tolerances.largest_step
        return CVODE(
            self._rates,
            method=self.formulas,
            rtol=self.tolerances.rtol,
            atol=np.array(np.broadcast_to(self.tolerances.atol, self.problem.states), dtype=float),
            first_step=self.tolerances.first_step,
            max_step=largest if np.isfinite(largest) else 0.0,
            max_num_steps=10_000,
            **options,
        )

    # the run

    def go(self) -> None:
        """To the end, or to where it ends before."""
        found, k = self.found, self.k
        t, y = self.span[0], np.array(found.states[k])
        self._take_samples(None, t, y)
        ending: Ending | None = None
        while ending is None:
            t, y, ending = self._stretch(t, y)
        found.states[k], found.times[k], found.ending[k] = y, t, ENDINGS.index(ending)

    def _stretch(self, t: float, y: Array) -> tuple[float, Array, Ending | None]:
        """Steps from a start of the formulas to where they have to start anew, or the end."""
        end, until, seen = self.span[1], self._enter(t), False
        solver = self._solver()
        solver.init_step(t, y)
        while t < end:
            if self.found.counts[self.k, 0] >= self.tolerances.max_steps:
                return t, y, Ending.step_limit
            try:
                step = solver.step(end, "onestep", tstop=until)
            except RuntimeError:
                step = None
            if step is None or step.status < 0 or not np.all(np.isfinite(step.y)):
                finite = step is None or np.all(np.isfinite(step.y))
                return t, y, Ending.too_small if finite else Ending.not_finite
            t1, y1 = float(np.ravel(step.t)[-1]), np.array(np.atleast_2d(step.y)[-1])
            if t1 == t and seen:  # CVODE tells the end of its last step again after a look back
                seen = False
                continue
            if self._stuck(t1 - t, located=step.status == 2):
                return t, y, Ending.too_small
            if self._flipped(t, t1, y1, located=step.status == 2):
                self._flips += 1  # for ever, where both ways of a switch lead across
                often = self._flips > 2 * self.problem.switches
                return t, y, Ending.too_small if often else None
            self._flips = 0
            self.found.counts[self.k, 0] += 1
            before, self._last = self._sample, (t, y)
            self._take_samples(solver, t1, y1)
            seen = self._sample > before
            t, y = t1, y1
            if step.status == 2:
                stops = self._happen(t, y, np.ravel(step.i_events[-1]) != 0)
                return self._restart(t, y, Ending.stopped if stops else None)
            if self._fallen(t, y):
                return self._restart(t, y, Ending.guarded)
            if self._drifted(y) or (t >= until and self._jumps(t)):
                return self._restart(t, y, None)
            until = self._enter(t) if t >= until else until
        return self._restart(t, y, Ending.finished)

    def _stuck(self, step: float, located: bool) -> bool:
        """Whether steps have been very short for long; the first ones may be."""
        self._short = 0 if located or step > self._smallest else self._short + 1
        return self._short > SHORT

    def _restart(
        self, t: float, y: Array, ending: Ending | None
    ) -> tuple[float, Array, Ending | None]:
        """The state put back, or the ending of a run that can not be."""
        back = self._back(y)
        return (t, y, Ending.drifted) if back is None else (t, back, ending)

    def _take_samples(self, solver: Any, t: float, y: Array) -> None:
        """States at the sample times up to t, by the formulas' own interpolation."""
        while self._sample < len(self.times) and self.times[self._sample] <= t:
            at, state = self.times[self._sample], y
            if solver is not None and at < t:
                state = self._looked_back(solver, at)
            back = self._back(state)
            if back is not None:
                self.found.samples[self.k, self._sample] = back
            self._sample += 1

    def _looked_back(self, solver: Any, at: float) -> Array:
        """The state at a time within the last step."""
        step = solver.step(at, "normal")
        if np.ravel(step.t)[-1] != at:  # CVODE looks at the event in the step again
            solver = self._solver(events=False)
            solver.init_step(*self._last)
            step = solver.step(at, "normal", tstop=at)
        return np.array(np.atleast_2d(step.y)[-1])

    def _switches(self) -> range:
        return range(self.problem.switches)

    def _flipped(self, start: float, t: float, y: Array, located: bool) -> bool:
        """Whether a switch stood on its wrong side all along a step, and has been changed."""
        if located:
            return False
        values = self._evaluate(t, y)[self.problem.states :]
        branches, flipped = self.found.branches[self.k], False
        for i in self._switches():
            if (2 * branches[i] - 1) * values[i] < -self._reversal:
                branches[i], flipped = 1 - branches[i], True
                if start > self.span[0]:
                    self._note(i, start)
        return flipped

    def _happen(self, t: float, y: Array, roots: NDArray[np.bool_]) -> bool:
        """What the events at a time do, those with roots there, and whether the run stops."""
        values = self._evaluate(t, y)[self.problem.states :].copy()
        rates = self._event_rates(t, y)
        stops = False
        near = np.abs(values) <= np.maximum(self._reversal, 1e-7 * np.abs(rates))
        for i, root in zip(self._watched, roots, strict=True):
            event = self.problem.events[i]
            if not root and not (event.kind == "switch" and near[i]):
                continue
            if event.kind == "switch":
                rising = 1.0 if rates[i] > 0 else 0.0
                if self.found.branches[self.k, i] == rising:
                    continue
                self.found.branches[self.k, i] = rising
            self._note(i, t)
            stops = stops or event.kind == "stop"
        return stops

    def _note(self, i: int, t: float) -> None:
        """Keep the time of an event."""
        count = self.found.counts[self.k, 3]
        if count < self.found.event_times.shape[1]:
            self.found.event_times[self.k, count] = t
            self.found.event_kinds[self.k, count] = i
        self.found.counts[self.k, 3] += 1

    def _event_rates(self, t: float, y: Array) -> Array:
        """Rates of the events' values, by a difference along the motion."""
        n, out = self.problem.states, self._evaluate(t, y).copy()
        h = 1e-7 * (self.span[1] - self.span[0])
        after = self._evaluate(t + h, y + h * out[:n])
        return np.asarray((after[n:] - out[n:]) / h)

    def _fallen(self, t: float, y: Array) -> bool:
        values = self._evaluate(t, y)[self.problem.states :]
        return any(not values[k] >= self.tolerances.guard for k in self._guards)

    # what states must obey

    def _unit(self, y: Array) -> Array:
        """The state with unit quaternions."""
        for first in self.problem.quaternions:
            y[first : first + 4] /= np.linalg.norm(y[first : first + 4])
        return y

    @cached_property
    def _closing(self) -> _Closing | None:
        constraints = self.problem.constraints
        return None if constraints is None else _Closing(constraints, self.p)

    def _back(self, y: Array) -> Array | None:
        """The state on its equations, None if it can not be put back."""
        y = self._unit(y.copy())
        if self._closing is None:
            return y
        n = self._closing.constraints.positions
        q = self._closing.put_back(y[:n])[0]
        return None if q is None else np.concatenate([q, y[n:]])

    def _drifted(self, y: Array) -> bool:
        """Whether a state is so far from its equations that the formulas start anew on them."""
        if self._closing is None:
            return False
        return self._closing.gap(y[: self._closing.constraints.positions]) > self._farthest


class _Closing:
    """Newton's method on the closure equations, as `projecting` does it in loops."""

    def __init__(self, constraints: Constraints, p: Array) -> None:
        self.constraints, self.p = constraints, p
        self._rows, self._move = Code(constraints.rows), Code(constraints.move)

    def _room(self, q: Array) -> tuple[Array, Array]:
        n, m = self.constraints.positions, self.constraints.unknowns
        return np.concatenate([q, self.p, np.zeros(m)]), np.zeros(max(n, m + m * m))

    def gap(self, q: Array) -> float:
        """The largest residual."""
        given, found = self._room(q)
        self._rows(given.ctypes.data, found.ctypes.data)
        return float(np.abs(found[: self.constraints.unknowns]).max())

    def put_back(self, q: Array) -> tuple[Array | None, bool]:
        """q on the equations, and whether it had to move."""
        c, wanted, moved = self.constraints, self.constraints.tolerance, False
        before = np.inf
        n, m, k = c.positions, c.unknowns, len(self.p)
        given, found = self._room(q)
        for _ in range(8):
            self._rows(given.ctypes.data, found.ctypes.data)
            gap = np.abs(found[:m]).max()
            if gap <= wanted or (gap <= c.tolerance and gap > 0.5 * before):
                return given[:n], moved
            wanted, before, moved = 0.01 * c.tolerance, gap, True
            try:
                given[n + k :] = -np.linalg.solve(found[m : m + m * m].reshape(m, m), found[:m])
            except np.linalg.LinAlgError:
                return None, True
            self._move(given.ctypes.data, found.ctypes.data)
            given[:n] = found[:n]
        return None, True
