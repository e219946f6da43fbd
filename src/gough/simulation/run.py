"""One run: from a start to the end, in as many choices of coordinates as it takes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gough.dynamics.writing import Place
from gough.numerics.integration import ENDINGS, Ending, Runs, Tolerances, signal_values
from gough.simulation.controllers import Sampled, seen
from gough.simulation.formulations import Formulation, Formulations
from gough.simulation.inputs import Inputs
from gough.simulation.methods import METHODS

Array = NDArray[np.float64]

LEVEL, LOWER, LOWEST = 0.1, 0.1, 1e-9
"""Regularity of the independent rates at which better ones are looked for, in parts of that near
home; by what it is lowered where there are none; where a run ends for want of them."""

LOST = (Ending.guarded, Ending.not_finite, Ending.too_small)
"""Endings that other coordinates may help against."""


@dataclass(frozen=True)
class Options:
    """How accurately to integrate; see `simulate`."""

    method: str = "dormand-prince"
    rtol: float = 1e-8
    atol: float = 1e-8
    largest_step: float = np.inf
    max_steps: int = 10_000_000


@dataclass(frozen=True)
class Start:
    """Where a run starts."""

    q: Array
    """A closed configuration, (positions,)."""
    v: Array
    """Rates of all variables of the tree."""
    memory: Array | None = None
    """Memories of the laws; as the laws say by default."""


@dataclass
class Trace:
    """What a run went through; arrays have a row for each time reached."""

    times: Array
    x: Array
    """Operational coordinates."""
    xd: Array
    """Their rates."""
    q: Array
    """Configurations."""
    v: Array
    """Rates of all variables of the tree."""
    memory: Array
    energies: Array
    """Kinetic, potential, stored, delivered, dissipated."""
    forces: Array
    """Of the laws."""
    law_positions: Array
    law_rates: Array
    ending: Ending
    end: float
    """Time of the end, s."""
    events: list[tuple[float, str]]
    counts: dict[str, int]
    formulations: list[tuple[float, Place, tuple[str, ...]]]
    """From when on, the place and the independent rates."""

    @property
    def balance(self) -> Array:
        """Kinetic, potential and stored energy, less what they began with, less delivered energy,
        plus dissipated energy: 0 but for errors, J."""
        held = self.energies[:, :3].sum(axis=1)
        return np.asarray(held - held[0] - self.energies[:, 3] + self.energies[:, 4])


@dataclass
class Runner:
    """Runs of one mechanism under one setting.

    Args:
        formulations: its coordinates.
        inputs: commands that are numbers or tables.
        told: breaks and coefficients of the source's signals, behind those of the inputs.
        sampled: a digital controller.
        gravity: where the setting takes it.
        options: accuracy.
    """

    formulations: Formulations
    inputs: Inputs
    options: Options
    gravity: Array | None = None
    told: tuple[Array, Array] | None = None
    sampled: Sampled | None = None
    drives: dict[str, tuple[str, Callable[[float], Any]]] = field(default_factory=dict)
    """Of each law that a digital controller tells: the motor, and its command for an effort."""
    _pieces: list[dict[str, Array]] = field(default_factory=list)

    def go(self, start: Start, duration: float, times: Array) -> Trace:
        """The run from a start for a duration, seen at some times."""
        self._pieces = []
        formulation = self.formulations.first(start.q)
        now = _Now(
            0.0, formulation, self.start_state(formulation, start), start.q, first=formulation
        )
        for until in self._until(duration):
            self._tell(now)
            ending = self._stretch(now, until, times)
            if ending is not Ending.finished:
                break
        return self._trace(ending, now)

    def _until(self, duration: float) -> list[float]:
        """Times up to which nothing is told anew."""
        if self.sampled is None:
            return [duration]
        count = int(np.ceil(duration / self.sampled.period - 1e-9))
        return [*(k * self.sampled.period for k in range(1, count)), duration]

    def _tell(self, now: _Now) -> None:
        """Ask a digital controller for the efforts that are held until it is called again."""
        if self.sampled is None:
            return
        q, v = self._everything(now.formulation, now.state, now.q)
        now.q = q
        observed = seen(now.formulation.model, q, v)
        names = [name for name in self.inputs.constant if name in self.drives]
        efforts = self.sampled.efforts(now.t, observed, [self.drives[name][0] for name in names])
        for name, effort in zip(names, efforts.tolist(), strict=True):
            self.inputs.constant[name] = float(self.drives[name][1](effort))

    def _stretch(self, now: _Now, until: float, times: Array) -> Ending:
        """Go on to a time, in other coordinates where that is better."""
        level, changed = LEVEL, -1.0
        while True:
            wanted = times[(times > now.t if now.t > 0.0 else times >= 0.0) & (times <= until)]
            found = self.advance(now, until, wanted, level)
            self._look(now, wanted, found)
            now.take(found)
            ending: Ending = ENDINGS[int(found.ending[0])]
            if ending not in LOST:
                return ending
            q, v = self._everything(now.formulation, now.state, now.q)
            better = self.formulations.better(now.formulation, q)
            if better is not None and now.t > changed:
                now.change(better, q, v)
                level, changed = LEVEL, now.t
                continue
            level *= LOWER
            if ending is not Ending.guarded or level < LOWEST:
                return ending

    def start_state(self, formulation: Formulation, start: Start) -> Array:
        """The state of a formulation at a start."""
        layout = formulation.layout
        state = np.zeros(layout.states)
        state[layout.part("positions")] = formulation.positions(start.q)
        state[layout.part("rates")] = formulation.rates(start.v)
        if layout.memory:
            own = self._started(formulation, state)[: len(layout.memory)]
            state[layout.part("memory")] = own if start.memory is None else start.memory
        return state

    def _started(self, formulation: Formulation, state: Array) -> Array:
        found = formulation.equations.started(*self._arguments(formulation, state[None]))
        return np.asarray(found[0])

    def _branches(self, formulation: Formulation, state: Array) -> Array:
        """Which way each switch stands at the start."""
        values = self._started(formulation, state)[len(formulation.layout.memory) :]
        return np.where(values >= 0.0, 1.0, 0.0)[None]

    def _arguments(
        self, formulation: Formulation, states: Array, t: Array | None = None
    ) -> list[Array]:
        """Arguments of a kernel of the equations for some states."""
        equations, rows = formulation.equations, len(states)
        times = np.zeros(rows) if t is None else t
        kernel = equations.started
        values: dict[str, Array] = {"t": times[:, None], "state": states}
        values["signals"] = self.signals_at(times)
        values["branches"] = np.ones((rows, kernel.inputs.get("branches", 0)))
        values |= {k: np.broadcast_to(x, (rows, len(x))) for k, x in self._held.items()}
        return [values[name] for name in kernel.inputs]

    @property
    def _held(self) -> dict[str, Array]:
        """Numbers that stay the same in a run."""
        held = {
            "p": self.formulations.dynamics.assembler.p,
            "inputs": np.array(list(self.inputs.constant.values())),
        }
        return held if self.gravity is None else held | {"gravity": self.gravity}

    def signals_at(self, times: Array) -> Array:
        """Values of all signals at some times, (times, signals)."""
        return signal_values(*self.signals, times)

    @property
    def signals(self) -> tuple[Array, Array]:
        """Breaks and coefficients of all signals."""
        if self.told is None:
            return self.inputs.breaks, self.inputs.coefficients
        return _joined((self.inputs.breaks, self.inputs.coefficients), self.told)

    def advance(self, now: _Now, until: float, times: Array, level: float) -> Runs:
        """Integrate in one formulation to a time, or to where it ends before."""
        formulation, options, held = now.formulation, self.options, self._held
        motion = formulation.equations.motion
        prepared = motion.prepare(*[held[name] for name in motion.held]) if motion.held else None
        if now.branches is None:
            now.branches = self._branches(formulation, now.state)
        return METHODS[options.method](
            formulation.problem(now.q, *self.signals),
            now.state[None],
            (now.t, until),
            Tolerances(
                options.rtol,
                np.array([options.atol]),
                guard=level,
                exact=self.formulations.setting.located,
                largest_step=options.largest_step,
                max_steps=options.max_steps,
            ),
            prepared=None if prepared is None else prepared[None],
            branches=now.branches,
            p=held["p"][None],
            sample_times=times,
        )

    # what is seen

    def _everything(
        self, formulation: Formulation, state: Array, near: Array
    ) -> tuple[Array, Array]:
        """Configuration and rates of all variables in a state."""
        layout = formulation.layout
        q = formulation.configurations(state[..., layout.part("positions")], near)
        return q, formulation.all_rates(q, state[..., layout.part("rates")])

    def _look(self, now: _Now, times: Array, found: Runs) -> None:
        """Keep what the states at the times reached tell."""
        states, formulation, near = found.samples[0], now.formulation, now.q
        reached = np.isfinite(states).all(axis=1)
        states, at, layout = states[reached], times[reached], formulation.layout
        if not len(at):
            return
        positions, y = (states[:, layout.part(k)] for k in ("positions", "rates"))
        q, v = formulation.along(positions, y, at, near)
        now.q = q[-1]
        seen = formulation.equations.observed(*self._arguments(formulation, states, at))
        laws = len(formulation.equations.setting.laws)
        coordinates = formulation.model.outputs
        operational = self.formulations.dynamics.structure.columns("operational")
        by_outputs = formulation.place == "x"
        x = states[:, layout.part("positions")] if by_outputs else coordinates.of(q)
        if by_outputs:
            order = [formulation.model.independent.index(k) for k in operational]
            xd = states[:, layout.part("rates")][:, order]
        else:
            xd = v[:, operational]
        energies = np.concatenate([seen[:, :3], states[:, layout.part("energies")]], axis=1)
        self._pieces.append(
            {
                "times": at,
                "x": x,
                "xd": xd,
                "q": q,
                "v": v,
                "memory": states[:, layout.part("memory")],
                "energies": energies,
                "forces": seen[:, 3 : 3 + laws],
                "law_positions": seen[:, 3 + laws : 3 + 2 * laws],
                "law_rates": seen[:, 3 + 2 * laws :],
            }
        )

    def _trace(self, ending: Ending, now: _Now) -> Trace:
        names = ("steps", "refused", "evaluations", "events")
        joined = {k: np.concatenate([piece[k] for piece in self._pieces]) for k in self._pieces[0]}
        return Trace(
            **joined,
            ending=ending,
            end=now.t,
            events=now.events,
            counts=dict(zip(names, now.counts.tolist(), strict=True)),
            formulations=now.used,
        )


class _Now:
    """Where a run has come to."""

    def __init__(
        self, t: float, formulation: Formulation, state: Array, q: Array, first: Formulation
    ) -> None:
        self.t, self.formulation, self.state, self.q = t, formulation, state, q
        self.branches: Array | None = None
        self.counts = np.zeros(4, np.int64)
        self.events: list[tuple[float, str]] = []
        self.used = [(t, first.place, first.independent)]

    def take(self, found: Runs) -> None:
        """What an integration has come to."""
        names = [event.name for event, _ in self.formulation.equations.events]
        pairs = zip(found.event_times[0].tolist(), found.event_kinds[0].tolist(), strict=True)
        self.events += [(t, names[k]) for t, k in pairs if k >= 0]
        self.counts += found.counts[0]
        self.t, self.state, self.branches = float(found.times[0]), found.states[0], found.branches

    def change(self, better: Formulation, q: Array, v: Array) -> None:
        """Go on in other coordinates."""
        rest = self.state[self.formulation.layout.part("memory").start :]
        self.state = np.concatenate([better.positions(q), better.rates(v), rest])
        self.formulation, self.q = better, q
        self.used.append((self.t, better.place, better.independent))


def _joined(a: tuple[Array, Array], b: tuple[Array, Array]) -> tuple[Array, Array]:
    """Two sets of signals on common pieces."""
    if not len(a[0]):
        return b
    if not len(b[0]):
        return a
    breaks = np.unique(np.concatenate([a[0], b[0]]))
    return breaks, np.concatenate([_refined(*x, breaks) for x in (a, b)], axis=1)


def _refined(breaks: Array, coefficients: Array, new: Array) -> Array:
    """The same piecewise polynomials on more pieces."""
    piece = np.clip(np.searchsorted(breaks, new, side="right") - 1, 0, None)
    shift, found = new - breaks[piece], coefficients[piece].copy()
    for k in range(6):  # repeated synthetic division moves the origin by the shift
        for j in range(4, k - 1, -1):
            found[:, :, j] += shift[:, None] * found[:, :, j + 1]
    return found
