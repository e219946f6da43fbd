"""Ensembles: many runs of one mechanism that differ in parameters, starts and inputs.

Runs are made by the compiled integrator in one choice of coordinates, eight lanes at a time. Those
whose coordinates lose their regularity on the way are made again one by one, as single runs are.
A run that does not reach its end stays in the results as a row with the name of its ending.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gough.cache import digest
from gough.description import Mechanism
from gough.ensembles import Column, Coordinate, Plan
from gough.errors import ConfigurationError, GoughError
from gough.geometry.coordinates import Coordinates
from gough.numerics.integration import ENDINGS, Runs, Tolerances, integrate
from gough.simulation.factors import Factors, told_as_numbers
from gough.simulation.formulations import Formulation
from gough.simulation.mechanics import dynamics_of
from gough.simulation.onward import Onward
from gough.simulation.origin import plain
from gough.simulation.run import LEVEL, LOST
from gough.simulation.simulate import Request, Simulator, times_of
from gough.simulation.starts import Starts
from gough.topology import Modelling
from gough.uncertainty import Design, SaltelliDesign

Array = NDArray[np.float64]
Arrays = dict[str, NDArray[Any]]
Measure = Callable[[Mapping[str, NDArray[Any]]], NDArray[Any]]
"""From the columns of some rows, with ``time`` and ``events``, to one number for each row."""

LARGEST, SMALLEST = 2048, 64
"""Runs of a chunk: few enough that chunks are made often, many enough that they take 0.1 s."""
NUMBERS = 4_000_000
"""Of a chunk that is being computed, at most, as long as there is more than one run in it."""
NOT_CLOSED = len(ENDINGS)
"""Ending of a row whose loops do not close with its parameters."""
WORDS = (*(ending.name for ending in ENDINGS), "not_closed")
MARKS = 32
"""Below so many events only the first of each is looked for."""
NOTED = 128
"""Events of a run that are looked through for the first of each kind; runs with more of them are
made again."""
SIMULATORS = 4
"""Mechanisms whose machine code is kept for the next ensemble."""


@dataclass(frozen=True)
class Ensemble:
    """What decides the numbers of an ensemble; it can be sent to other processes.

    Args:
        mechanism: the description, with the varied parameters live.
        modelling: of the platform.
        live: values of live parameters by name.
        request: what all runs have in common.
        vary: distribution of each factor, as texts or mappings.
        design: which points are run.
        times: at which states are kept besides the end, s.
        measures: further columns by name, computed from the others.
    """

    mechanism: Mechanism
    modelling: Modelling | None
    live: Mapping[str, Any]
    request: Request
    vary: Mapping[str, Any]
    design: Design | SaltelliDesign
    times: tuple[float, ...] = ()
    measures: Mapping[str, Measure] = field(default_factory=dict)

    @property
    def origin(self) -> dict[str, Any]:
        """What decides the numbers, in plain values."""
        request = self.request
        return {
            "mechanism": self.mechanism.model_dump(mode="json", exclude_unset=True),
            "modelling": self.modelling or "",
            "live": plain(self.live),
            "duration": float(request.duration),
            "start": [plain(x) for x in (request.x0, request.v0, request.q0)],
            "inputs": plain(request.inputs or {}),
            "controller": plain(request.controller),
            "events": plain(request.events or {}),
            "gravity": plain(request.gravity),
            "method": request.method,
            "rtol": float(request.rtol),
            "atol": float(request.rtol if request.atol is None else request.atol),
            "locate": str(request.locate),
            "max_step": str(request.max_step),
            "max_steps": int(request.max_steps),
            "times": plain(np.array(self.times)),
            "vary": plain(self.vary),
            "design": self.design.as_dict(),
            "measures": plain(self.measures),
        }

    def __call__(self, start: int, stop: int) -> Arrays:
        """Rows from ``start`` to before ``stop``."""
        return prepared(self).rows(start, stop)

    @property
    def plan(self) -> Plan:
        """Rows, columns and chunks."""
        return prepared(self).plan

    def __getstate__(self) -> dict[str, Any]:
        """Without what is made anew in another process."""
        return {each.name: getattr(self, each.name) for each in fields(self)}


_MAKING = threading.RLock()
_SIMULATORS: dict[bytes, Simulator] = {}


def prepared(ensemble: Ensemble) -> Prepared:
    """What the runs of an ensemble are made with, made once."""
    with _MAKING:
        kept = vars(ensemble)
        if "_prepared" not in kept:
            kept["_prepared"] = Prepared(ensemble)
        found: Prepared = kept["_prepared"]
        return found


def _simulator(ensemble: Ensemble) -> Simulator:
    """The simulator of an ensemble's mechanism; the last few are kept."""
    mechanism = ensemble.mechanism.model_dump_json(exclude_unset=True)
    key = digest(mechanism, repr((ensemble.modelling, plain(ensemble.live))))
    found = _SIMULATORS.pop(key, None)
    if found is None:
        dynamics = dynamics_of(ensemble.mechanism, ensemble.modelling, ensemble.live)
        found = Simulator(dynamics, {})
    _SIMULATORS[key] = found
    while len(_SIMULATORS) > SIMULATORS:
        del _SIMULATORS[next(iter(_SIMULATORS))]
    return found


class Prepared:
    """Models and machine code of one ensemble."""

    def __init__(self, ensemble: Ensemble) -> None:
        self.ensemble, request = ensemble, ensemble.request
        if request.method != "dormand-prince":
            raise ConfigurationError(
                f"ensembles are made by dormand-prince, and not by {request.method}"
            )
        simulator = _simulator(ensemble)
        self.dynamics = simulator.dynamics
        told = told_as_numbers(request.inputs, ensemble.vary, simulator.laws)
        self.runner = simulator.runner(replace(request, inputs=told))
        if self.runner.sampled is not None:
            raise ConfigurationError(
                "a controller that is a Python function called every period can not run in an "
                "ensemble; give one that is compiled, such as ComputedTorque or Custom"
            )
        self.duration = float(request.duration)
        self.times = times_of(list(ensemble.times), self.duration) if ensemble.times else ()
        start = simulator.start(request.x0, request.v0, request.q0)
        self.outputs = Coordinates(self.dynamics.models, "operational")
        self.columns = self.dynamics.structure.columns("operational")
        self.factors = Factors(
            ensemble.vary,
            self.dynamics,
            self.outputs.of(start.q),
            start.v[self.columns],
            simulator.laws,
            self.runner.inputs.constant,
        )
        self.formulation: Formulation = self.runner.formulations.first(start.q)
        rows = len(ensemble.design)
        some = [ensemble.design.rows(k, k + 1) for k in sorted({0, rows // 2, rows - 1})]
        probes = self._held(self.factors.values(np.concatenate(some)))["p"]
        self.starts = Starts(self.dynamics, request, start, self.formulation, self.factors, probes)
        self.onward = Onward(self.runner, self.formulation)
        self.problem = self.formulation.problem(start.q, *self.runner.signals)
        self._warm()

    def _warm(self) -> None:
        """Machine code is made before threads ask for it, all at once."""
        equations = self.formulation.equations
        equations.motion.address(8)
        equations.motion.address(1)
        values = self.factors.values(self.ensemble.design.rows(0, 1))
        held = self._held(values)
        states, _ = self._states(values, held)
        self._fixed(held)
        self._energies(states, held, np.zeros(1))
        self._outputs_of(states, held["p"])

    # the plan

    @property
    def events(self) -> list[str]:
        """Names of the events whose first time is kept."""
        return [e.name for e, _ in self.formulation.equations.events if e.kind in ("mark", "stop")]

    @cached_property
    def plan(self) -> Plan:
        """Rows, columns and chunks."""
        rows = len(self.ensemble.design)
        most = max(1, NUMBERS // (self.formulation.layout.states * (len(self.times) + 8)))
        chunk = min(LARGEST, most, max(SMALLEST, -(-rows // 16)))
        return Plan(rows, chunk, self._columns, self._coords, self.ensemble.origin)

    @property
    def _names(self) -> tuple[str, str]:
        return ("pose", "twist") if len(self.outputs) == 7 else ("x", "xd")

    @property
    def _columns(self) -> dict[str, Column]:
        x, xd = self._names
        n, m = len(self.outputs), len(self.columns)
        found = {
            "ending": Column((), "i1", "", "; ".join(f"{k} {w}" for k, w in enumerate(WORDS))),
            "end": Column((), "f8", "s", "time of the end"),
            "energy": Column((5,), "f8", "J", "energies at the end", ("energy_kind",)),
            "energy_balance_error": Column((), "f8", "J", "what they miss of being in balance"),
            "counts": Column((4,), "i8", "", "steps, refused, evaluations, events", ("count",)),
        }
        if self.factors.each:
            k = len(self.factors.each)
            found["factor"] = Column((k,), "f8", "", "what was varied", ("factor_name",))
        if n:
            found[x] = Column((n,), "f8", "m, 1", "outputs at the end", (f"{x}_part",))
            found[xd] = Column((m,), "f8", "m/s, rad/s", "rates at the end", (f"{xd}_part",))
        if self.events:
            shape, dims = (len(self.events),), ("event",)
            found["first"] = Column(shape, "f8", "s", "first time of each event", dims)
        if len(self.times) and n:
            for name, count, unit in ((x, n, "m, 1"), (xd, m, "m/s, rad/s")):
                over = (len(self.times), count)
                part = ("time", f"{name}_part")
                found[f"{name}_over_time"] = Column(over, "f8", unit, "at the times kept", part)
        for name in self.ensemble.measures:
            if name in found:
                raise ConfigurationError(
                    f"measure {name!r} has the name of a column; those are {', '.join(found)}"
                )
            found[name] = Column()
        return found

    @property
    def _coords(self) -> dict[str, Coordinate]:
        x, xd = self._names
        structure = self.dynamics.structure
        kinds = ["kinetic", "potential", "stored", "delivered", "dissipated"]
        found = {
            "energy_kind": Coordinate(kinds),
            "count": Coordinate(["steps", "refused", "evaluations", "events"]),
        }
        if self.factors.each:
            found["factor_name"] = Coordinate(self.factors.names)
        if len(self.outputs):
            found[f"{x}_part"] = Coordinate(self.outputs.names)
            found[f"{xd}_part"] = Coordinate([structure.variables[k].name for k in self.columns])
        if self.events:
            found["event"] = Coordinate(self.events)
        if len(self.times) and len(self.outputs):
            found["time"] = Coordinate(np.array(self.times), unit="s")
        return found

    # rows

    def rows(self, start: int, stop: int) -> Arrays:
        """The columns of some rows."""
        values = self.factors.values(self.ensemble.design.rows(start, stop))
        held = self._held(values)
        states, closed = self._states(values, held)
        found: Arrays = {
            name: np.full((len(values), *column.shape), column.fill, column.type)
            for name, column in self._columns.items()
        }
        found["ending"][:] = NOT_CLOSED
        if closed.any():
            chosen = {name: array[closed] for name, array in held.items()}
            columns = self._run(states[closed], chosen, values[closed])
            for name, column in columns.items():
                found[name][closed] = column
        if self.factors.each:
            found["factor"] = values
        return found

    def _run(self, states: Array, held: Mapping[str, Array], values: Array) -> Arrays:
        """The columns of rows that close."""
        found = self._seen(states, held)
        lost = found["ending"] > 1
        given = dict(found)
        if self.factors.each:
            given["factor"] = values
        given |= {"time": np.array(self.times), "events": np.array(self.events)}
        for name, measure in self.ensemble.measures.items():
            found[name] = np.where(lost, np.nan, _measured(name, measure, given, len(states)))
        return found

    def _held(self, values: Array) -> dict[str, Array]:
        """Numbers that stay the same in each run, a row each."""
        rows = len(values)
        p = np.tile(self.dynamics.assembler.p, (rows, 1))
        for k, place in self.factors.place("parameter"):
            p[:, place] = values[:, k]
        inputs = np.tile(np.array(list(self.runner.inputs.constant.values())), (rows, 1))
        for k, place in self.factors.place("input"):
            inputs[:, place] = values[:, k]
        found = {"p": p, "inputs": inputs}
        if self.runner.gravity is not None:
            found["gravity"] = np.tile(self.runner.gravity, (rows, 1))
        return found

    def _states(self, values: Array, held: Mapping[str, Array]) -> tuple[Array, NDArray[np.bool_]]:
        """States at the start, and which rows close."""
        layout = self.formulation.layout
        states = np.zeros((len(values), layout.states))
        positions, rates, closed = self.starts.of(values, held["p"])
        states[:, layout.part("positions")] = positions
        states[:, layout.part("rates")] = rates
        if layout.memory:
            states[:, layout.part("memory")] = self._started(states, held)[:, : len(layout.memory)]
        return states, closed & np.isfinite(states).all(axis=1)

    def _started(self, states: Array, held: Mapping[str, Array]) -> Array:
        """Memories of laws, and values of switches, at the start."""
        kernel = self.formulation.equations.started
        return kernel(*self._arguments(states, held, np.zeros(len(states))), threads=1)

    def _arguments(self, states: Array, held: Mapping[str, Array], t: Array) -> list[Array]:
        """Arguments of a kernel of the equations."""
        kernel = self.formulation.equations.started
        values = {
            "t": t[:, None],
            "state": states,
            "signals": self.runner.signals_at(t),
            "branches": np.ones((len(states), kernel.inputs.get("branches", 0))),
            **held,
        }
        return [values[name] for name in kernel.inputs]

    def _fixed(self, held: Mapping[str, Array]) -> Array | None:
        """Numbers that need to be computed once for a run."""
        motion = self.formulation.equations.motion
        return motion.prepare(*[held[k] for k in motion.held], threads=1) if motion.held else None

    def _integrated(
        self, states: Array, held: Mapping[str, Array], room: int | None = None
    ) -> Runs:
        """All runs of a chunk, in one thread."""
        options = self.runner.options
        switches = self._started(states, held)[:, len(self.formulation.layout.memory) :]
        return integrate(
            self.problem,
            states,
            (0.0, self.duration),
            Tolerances(
                options.rtol,
                np.array([options.atol]),
                guard=LEVEL,
                exact=self.runner.formulations.setting.located,
                once=len(self.events) < MARKS,
                largest_step=options.largest_step,
                max_steps=options.max_steps,
            ),
            prepared=self._fixed(held),
            branches=np.where(switches >= 0.0, 1.0, 0.0),
            p=held["p"],
            sample_times=np.array(self.times),
            room=(NOTED if self.events else 0) if room is None else room,
            threads=1,
        )

    def _seen(self, starts: Array, held: Mapping[str, Array]) -> Arrays:
        """The columns that runs give by themselves."""
        runs = self._integrated(starts, held)
        before = self._energies(starts, held, np.zeros(len(starts)))
        after = self._energies(runs.states, held, runs.times)
        held_energy = after[:, :3].sum(axis=1) - before[:, :3].sum(axis=1)
        found: Arrays = {
            "ending": runs.ending,
            "end": runs.times,
            "energy": after,
            "energy_balance_error": held_energy - after[:, 3] + after[:, 4],
            "counts": runs.counts,
        }
        x, xd = self._names
        if len(self.outputs):
            found[x], found[xd] = self._outputs_of(runs.states, held["p"])
        if len(self.times) and len(self.outputs):
            at_times = self._outputs_of(runs.samples, held["p"][:, None])
            found[f"{x}_over_time"], found[f"{xd}_over_time"] = at_times
        if self.events:
            found["first"] = self._first(runs)
            many = runs.counts[:, 3] > NOTED
            if many.any():
                chosen = {name: array[many] for name, array in held.items()}
                room = int(runs.counts[many, 3].max())
                found["first"][many] = self._first(self._integrated(starts[many], chosen, room))
        for row in np.flatnonzero(np.isin(runs.ending, [ENDINGS.index(e) for e in LOST])).tolist():
            for name, value in self._again(starts[row], held, row).items():
                found[name][row] = value
        return found

    def _again(self, start: Array, held: Mapping[str, Array], row: int) -> dict[str, Any]:
        """The columns of a run in other coordinates on its way; none if it is lost there too."""
        times = np.unique([0.0, *self.times, self.duration])
        p, inputs = held["p"][row], held["inputs"][row]
        try:
            trace = self.onward.run(start, p, inputs, self.duration, times)
        except (GoughError, ArithmeticError):
            return {}
        if trace.ending not in ENDINGS[:2]:
            return {}
        x, xd = self._names
        found: dict[str, Any] = {
            "ending": ENDINGS.index(trace.ending),
            "end": trace.end,
            "energy": trace.energies[-1],
            "energy_balance_error": trace.balance[-1],
            "counts": list(trace.counts.values()),
        }
        for name, values in ((x, trace.x), (xd, trace.xd)) if len(self.outputs) else ():
            found[name] = values[-1]
            if len(self.times):
                over = np.full((len(self.times), values.shape[1]), np.nan)
                kept = np.isin(self.times, trace.times)
                over[kept] = values[np.isin(trace.times, self.times)]
                found[f"{name}_over_time"] = over
        if self.events:
            first = [[t for t, name in trace.events if name == event] for event in self.events]
            found["first"] = [min(times, default=np.nan) for times in first]
        return found

    def _energies(self, states: Array, held: Mapping[str, Array], t: Array) -> Array:
        seen = self.formulation.equations.observed(*self._arguments(states, held, t), threads=1)
        energies = states[:, self.formulation.layout.part("energies")]
        return np.concatenate([seen[:, :3], energies], axis=1)

    def _outputs_of(self, states: Array, p: Array) -> tuple[Array, Array]:
        """Outputs and their rates, (*batch, ·)."""
        formulation, layout = self.formulation, self.formulation.layout
        positions, y = (states[..., layout.part(k)] for k in ("positions", "rates"))
        if formulation.place == "x":
            order = [formulation.model.independent.index(k) for k in self.columns]
            return positions, y[..., order]
        kernel = formulation.model.kernel("rates", "q")
        v = kernel(positions, *([p] if p.shape[-1] else []), y, threads=1)
        return self.outputs.of(positions), v[..., self.columns]

    def _first(self, runs: Runs) -> Array:
        """First time of each event, NaN where it did not happen."""
        events = [e for e, _ in self.formulation.equations.events]
        found = []
        for k, event in enumerate(events):
            if event.kind in ("mark", "stop"):
                times = np.where(runs.event_kinds == k, runs.event_times, np.inf).min(axis=1)
                found.append(np.where(np.isfinite(times), times, np.nan))
        return np.stack(found, axis=1)


def _measured(name: str, measure: Measure, columns: Mapping[str, NDArray[Any]], rows: int) -> Array:
    """One number for each row.

    Raises:
        ConfigurationError: the function fails, or gives something else.
    """
    given = {key: array.view() for key, array in columns.items()}
    for array in given.values():
        array.flags.writeable = False  # what one measure changes, others would see
    try:
        found = np.asarray(measure(given))
    except Exception as error:  # a person's function
        raise ConfigurationError(
            f"measure {name} failed: {type(error).__name__}: {error}"
        ) from error
    if found.shape != (rows,) or found.dtype.kind not in "biuf":
        raise ConfigurationError(
            f"measure {name} gives {found.dtype} of shape {found.shape}, expected ({rows},): a "
            "number for each row"
        )
    return found.astype(float)
