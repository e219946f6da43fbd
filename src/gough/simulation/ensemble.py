"""Ensembles: many runs of one mechanism that differ in parameters, starts and inputs.

Every run is made by the compiled integrator in one choice of coordinates, eight lanes at a time.
A run that does not reach its end stays in the results as a row with the name of its ending.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import casadi
import numpy as np
from numpy.typing import NDArray

from gough.cache import digest
from gough.description import Frame, Mechanism
from gough.description.frames import transform
from gough.ensembles import Column, Coordinate, Plan
from gough.errors import ClosureError, ConfigurationError
from gough.geometry.coordinates import Coordinates
from gough.joints import Free
from gough.joints.quaternion import turned_wxyz, wxyz_from_rotations
from gough.kernels import Kernel
from gough.numerics.integration import ENDINGS, Runs, Tolerances, integrate
from gough.simulation.factors import Factors
from gough.simulation.formulations import Formulation
from gough.simulation.run import LOWEST, Runner
from gough.simulation.simulate import Request, Simulator, times_of
from gough.topology import Modelling
from gough.uncertainty import Design, SaltelliDesign

Array = NDArray[np.float64]
Arrays = dict[str, NDArray[Any]]
Measure = Callable[[Mapping[str, NDArray[Any]]], NDArray[Any]]
"""From the columns of some rows, with ``time`` and ``events``, to one number for each row."""

LARGEST, SMALLEST = 2048, 64
"""Runs of a chunk: few enough that chunks are made often, many enough that they take 0.1 s."""
NOT_CLOSED = len(ENDINGS)
"""Ending of a row whose loops do not close with its parameters."""
WORDS = (*(ending.name for ending in ENDINGS), "not_closed")
MARKS = 32
"""Below so many events only the first of each is looked for."""
NOTED = 128
"""Events of a run that are looked through for the first of each kind."""


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

    @cached_property
    def key(self) -> bytes:
        """A digest of what decides the numbers."""
        return digest(self.mechanism.model_dump_json(exclude_unset=True), repr(self.origin))

    @property
    def origin(self) -> dict[str, Any]:
        """What decides the numbers, in plain values."""
        request = self.request
        return {
            "mechanism": self.mechanism.model_dump(mode="json", exclude_unset=True),
            "modelling": self.modelling or "",
            "live": {name: _plain(value) for name, value in self.live.items()},
            "duration": float(request.duration),
            "start": [_plain(x) for x in (request.x0, request.v0, request.q0)],
            "inputs": {name: _plain(value) for name, value in (request.inputs or {}).items()},
            "controller": "" if request.controller is None else repr(request.controller),
            "events": {name: str(value) for name, value in (request.events or {}).items()},
            "gravity": _plain(request.gravity),
            "rtol": float(request.rtol),
            "atol": float(request.rtol if request.atol is None else request.atol),
            "locate": str(request.locate),
            "max_step": str(request.max_step),
            "max_steps": int(request.max_steps),
            "vary": {name: _plain(value) for name, value in self.vary.items()},
            "design": self.design.as_dict(),
            "measures": list(self.measures),
        }

    def __call__(self, start: int, stop: int) -> Arrays:
        """Rows from ``start`` to before ``stop``."""
        return _prepared(self).rows(start, stop)

    @property
    def plan(self) -> Plan:
        """Rows, columns and chunks."""
        return _prepared(self).plan


_KEPT: dict[bytes, _Prepared] = {}
_MAKING = threading.Lock()


def _prepared(ensemble: Ensemble) -> _Prepared:
    """What runs of an ensemble are made with, made once in a process."""
    with _MAKING:
        if ensemble.key not in _KEPT:
            _KEPT[ensemble.key] = _Prepared(ensemble)
        return _KEPT[ensemble.key]


class _Prepared:
    """Models and machine code of one ensemble."""

    def __init__(self, ensemble: Ensemble) -> None:
        from gough.simulation.mechanics import dynamics_of

        self.ensemble, request = ensemble, ensemble.request
        if request.method != "dormand-prince":
            raise ConfigurationError(
                f"ensembles are made by dormand-prince, and not by {request.method}"
            )
        self.dynamics = dynamics_of(ensemble.mechanism, ensemble.modelling, ensemble.live)
        self.simulator = Simulator(self.dynamics, {})
        told = self._told(request)
        self.runner: Runner = self.simulator.runner(told)
        if self.runner.sampled is not None:
            raise ConfigurationError(
                "a controller that is a Python function called every period can not run in an "
                "ensemble; give one that is compiled, such as ComputedTorque or Custom"
            )
        self.start = self.simulator.start(request.x0, request.v0, request.q0)
        outputs = Coordinates(self.dynamics.models, "operational")
        columns = self.dynamics.structure.columns("operational")
        self.x0, self.v0 = outputs.of(self.start.q), self.start.v[columns]
        self.factors = Factors(
            ensemble.vary,
            self.dynamics,
            self.x0,
            self.v0,
            self.simulator.laws,
            self.runner.inputs.constant,
        )
        self.formulation: Formulation = self.runner.formulations.first(self.start.q)
        self.times = times_of(list(ensemble.times), request.duration) if ensemble.times else ()
        self._warm()

    def _told(self, request: Request) -> Request:
        """The request with inputs that vary told as numbers."""
        prefix = "inputs."
        varied = [name.removeprefix(prefix) for name in self.ensemble.vary if prefix in name[:7]]
        missing = {name: 0.0 for name in varied if name not in (request.inputs or {})}
        return replace(request, inputs={**(request.inputs or {}), **missing})

    def _warm(self) -> None:
        """Machine code is made before threads ask for it, all at once."""
        equations = self.formulation.equations
        equations.motion.address(8)
        equations.motion.address(1)
        _ = equations.observed, equations.started

    # the plan

    @property
    def events(self) -> list[str]:
        """Names of the events whose first time is kept."""
        return [e.name for e, _ in self.formulation.equations.events if e.kind in ("mark", "stop")]

    @cached_property
    def plan(self) -> Plan:
        """Rows, columns and chunks."""
        rows = len(self.ensemble.design)
        chunk = min(LARGEST, max(SMALLEST, -(-rows // 16)))
        return Plan(rows, chunk, self._columns, self._coords, self.ensemble.origin)

    @property
    def _full(self) -> bool:
        return len(self.x0) == 7 and len(self.v0) == 6

    @property
    def _names(self) -> tuple[str, str]:
        return ("pose", "twist") if self._full else ("x", "xd")

    @property
    def _columns(self) -> dict[str, Column]:
        x, xd = self._names
        n, m = len(self.x0), len(self.v0)
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
            found[name] = Column()
        return found

    @property
    def _coords(self) -> dict[str, Coordinate]:
        x, xd = self._names
        structure = self.dynamics.structure
        outputs = Coordinates(self.dynamics.models, "operational")
        columns = structure.columns("operational")
        kinds = ["kinetic", "potential", "stored", "delivered", "dissipated"]
        found = {
            "energy_kind": Coordinate(kinds),
            "count": Coordinate(["steps", "refused", "evaluations", "events"]),
        }
        if self.factors.each:
            found["factor_name"] = Coordinate(self.factors.names)
        if len(self.x0):
            found[f"{x}_part"] = Coordinate(outputs.names)
            found[f"{xd}_part"] = Coordinate([structure.variables[k].name for k in columns])
        if self.events:
            found["event"] = Coordinate(self.events)
        if len(self.times):
            found["time"] = Coordinate(np.array(self.times), unit="s")
        return found

    # rows

    def rows(self, start: int, stop: int) -> Arrays:
        """The columns of some rows."""
        values = self.factors.values(self.ensemble.design.rows(start, stop))
        held = self._held(values)
        states, closed = self._starts(values, held)
        runs = self._integrated(states, held)
        runs.ending[~closed] = NOT_CLOSED
        found = self._seen(states, runs, held)
        if self.factors.each:
            found["factor"] = values
        for name, measure in self.ensemble.measures.items():
            given = {**found, "time": np.array(self.times), "events": np.array(self.events)}
            found[name] = np.asarray(measure(given), dtype=float)
        lost = ~np.isin(runs.ending, (0, 1))
        for name in ("end", *self.ensemble.measures):
            found[name] = np.where(lost, np.nan, found[name])
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

    def _starts(self, values: Array, held: Mapping[str, Array]) -> tuple[Array, NDArray[np.bool_]]:
        """States at the start, and which rows close."""
        layout = self.formulation.layout
        states = np.zeros((len(values), layout.states))
        x, closed = self._outputs(values, held["p"])
        if self.formulation.place == "x":
            states[:, layout.part("positions")] = x
            rates = np.tile(self.v0, (len(values), 1))
            for k, place in self.factors.place("rate"):
                rates[:, place] = values[:, k]
            columns = self.dynamics.structure.columns("operational")
            order = [columns.index(k) for k in self.formulation.model.independent]
            states[:, layout.part("rates")] = rates[:, order]
        else:
            closed &= self._closed_one_by_one(states, x, values, held["p"])
        if layout.memory:
            kernel = self.formulation.equations.started
            started = kernel(*self._arguments(states, held, 0.0))
            states[:, layout.part("memory")] = started[:, : len(layout.memory)]
        return states, closed

    def _outputs(self, values: Array, p: Array) -> tuple[Array, NDArray[np.bool_]]:
        """Outputs at the start."""
        rows = len(values)
        closed = np.ones(rows, dtype=bool)
        if self.ensemble.request.x0 is not None or not self.factors.place("parameter"):
            x = np.tile(self.x0, (rows, 1))
        elif self._home is not None:
            x = self._home(p)
        else:
            x, closed = self._homes(p)
        for k, place in self.factors.place("position"):
            x[:, place] = values[:, k]
        turns = self.factors.place("turn")
        for row in range(rows) if turns else ():
            phi = np.zeros(3)
            for k, axis in turns:
                phi[axis] = values[row, k]
            x[row, 3:] = turned_wxyz(x[row, 3:].tolist(), phi.tolist())
        return x, closed

    @cached_property
    def _home(self) -> Callable[[Array], Array] | None:
        """The described pose of the platform for live parameters, if home is that pose."""
        closure, structure = self.dynamics.models.closure, self.dynamics.structure
        columns = structure.columns("operational")
        edges = {structure.variables[k].edge for k in columns}
        if not self._full or len(edges) != 1 or self.ensemble.request.q0 is not None:
            return None
        edge = structure.edges[edges.pop()]
        if not isinstance(edge.home, Frame) or not isinstance(edge.type, Free):
            return None
        R, p = transform(edge.home, closure.values, closure.nominal)
        numbers = [*p, *(x for row in R for x in row)]
        column = casadi.vertcat(*[casadi.SX(x) for x in numbers])
        kernel = Kernel("home", {"p": closure.p}, column, (12,))

        def placed(parameters: Array) -> Array:
            found = kernel(parameters)
            turns = wxyz_from_rotations(found[:, 3:].reshape(-1, 3, 3))
            return np.concatenate([found[:, :3], turns], axis=1)

        described = placed(self.dynamics.assembler.p[None])[0]
        return placed if np.allclose(described, self.x0, rtol=0, atol=1e-9) else None

    def _homes(self, p: Array) -> tuple[Array, NDArray[np.bool_]]:
        """Outputs at the home of each row, closed one by one."""
        from gough.assembly import Assembler

        models = self.dynamics.models
        outputs = Coordinates(models, "operational")
        x, closed = np.tile(self.x0, (len(p), 1)), np.ones(len(p), dtype=bool)
        for row, parameters in enumerate(p):
            try:
                q = Assembler(models, parameters).home().require().q
            except ClosureError:
                closed[row] = False
            else:
                x[row] = outputs.of(q)
        return x, closed

    def _closed_one_by_one(
        self, states: Array, x: Array, values: Array, p: Array
    ) -> NDArray[np.bool_]:
        """Put configurations and independent rates into states; which rows close."""
        from gough.simulation.mechanics import dynamics_of

        layout, ensemble = self.formulation.layout, self.ensemble
        closed = np.ones(len(values), dtype=bool)
        moved = bool(self.factors.place("position") or self.factors.place("turn"))
        same = not self.factors.place("parameter")
        for row in range(len(values)):
            q, v = self.start.q, self.start.v
            if not same:
                from gough.assembly import Assembler

                found = Assembler(self.dynamics.models, p[row]).close(q)
                closed[row] = found.ending.name == "closed"
                q = found.q
            if moved and closed[row]:
                dynamics = self.dynamics
                if not same:
                    live = self.dynamics.models.parameter_values(p[row])
                    names = self.dynamics.models.closure.live
                    dynamics = dynamics_of(
                        ensemble.mechanism, ensemble.modelling, {k: live[k] for k in names}
                    )
                assert dynamics.inverse_geometry is not None
                reached = dynamics.inverse_geometry.solve(x[row], q)
                closed[row], q = bool(reached.reached), reached.q
            v = self._rates(q, v, values[row], p[row])
            states[row, layout.part("positions")] = q
            states[row, layout.part("rates")] = self.formulation.rates(v)
        return closed

    def _rates(self, q: Array, v: Array, values: Array, p: Array) -> Array:
        """All rates of one row for its rates of outputs."""
        places = self.factors.place("rate")
        columns = self.dynamics.structure.columns("operational")
        y0 = self.v0.copy()
        for k, place in places:
            y0[place] = values[k]
        if not np.any(y0):
            return np.zeros_like(v)
        model = self.dynamics.model("platform")
        given = dict(zip(columns, y0, strict=True))
        y = np.array([given.get(k, 0.0) for k in model.independent])
        return np.asarray(model.kernel("rates", "q")(q, *([p] if p.size else []), y))

    def _arguments(self, states: Array, held: Mapping[str, Array], t: float) -> list[Array]:
        """Arguments of a kernel of the equations."""
        kernel = self.formulation.equations.started
        rows = len(states)
        told = self.runner.signals_at(np.full(rows, t))
        values = {
            "t": np.full((rows, 1), t),
            "state": states,
            "signals": told,
            "branches": np.ones((rows, kernel.inputs.get("branches", 0))),
            **held,
        }
        return [values[name] for name in kernel.inputs]

    def _integrated(self, states: Array, held: Mapping[str, Array]) -> Runs:
        """All runs of a chunk, in one thread."""
        equations, layout = self.formulation.equations, self.formulation.layout
        motion, options = equations.motion, self.runner.options
        prepared = (
            motion.prepare(*[held[k] for k in motion.held], threads=1) if motion.held else None
        )
        started = equations.started(*self._arguments(states, held, 0.0), threads=1)
        switches = started[:, len(layout.memory) :]
        return integrate(
            self.formulation.problem(self.start.q, *self.runner.signals),
            states,
            (0.0, float(self.ensemble.request.duration)),
            Tolerances(
                options.rtol,
                np.array([options.atol]),
                guard=LOWEST,
                exact=self.runner.formulations.setting.located,
                once=len(self.events) < MARKS,
                largest_step=options.largest_step,
                max_steps=options.max_steps,
            ),
            prepared=prepared,
            branches=np.where(switches >= 0.0, 1.0, 0.0),
            p=held["p"],
            sample_times=np.array(self.times),
            room=NOTED if self.events else 0,
            threads=1,
        )

    def _seen(self, starts: Array, runs: Runs, held: Mapping[str, Array]) -> Arrays:
        """The columns of runs."""
        layout, t = self.formulation.layout, float(self.ensemble.request.duration)
        before = self._energies(starts, held, 0.0)
        after = self._energies(runs.states, held, t)
        held_energy = after[:, :3].sum(axis=1) - before[:, :3].sum(axis=1)
        found: Arrays = {
            "ending": runs.ending,
            "end": runs.times,
            "energy": after,
            "energy_balance_error": held_energy - after[:, 3] + after[:, 4],
            "counts": runs.counts,
        }
        x, xd = self._names
        if len(self.x0):
            found[x], found[xd] = self._outputs_of(runs.states)
        if len(self.times) and len(self.x0):
            found[f"{x}_over_time"], found[f"{xd}_over_time"] = self._outputs_of(runs.samples)
        if self.events:
            found["first"] = self._first(runs)
        assert layout.states == runs.states.shape[1]
        return found

    def _energies(self, states: Array, held: Mapping[str, Array], t: float) -> Array:
        seen = self.formulation.equations.observed(*self._arguments(states, held, t), threads=1)
        energies = states[:, self.formulation.layout.part("energies")]
        return np.concatenate([seen[:, :3], energies], axis=1)

    def _outputs_of(self, states: Array) -> tuple[Array, Array]:
        """Outputs and their rates, (*batch, ·)."""
        formulation, layout = self.formulation, self.formulation.layout
        positions, y = (states[..., layout.part(k)] for k in ("positions", "rates"))
        columns = self.dynamics.structure.columns("operational")
        if formulation.place == "x":
            order = [formulation.model.independent.index(k) for k in columns]
            return positions, y[..., order]
        outputs = Coordinates(self.dynamics.models, "operational")
        v = formulation.all_rates(positions, y)
        return outputs.of(positions), v[..., columns]

    def _first(self, runs: Runs) -> Array:
        """First time of each event, NaN where it did not happen."""
        events = [e for e, _ in self.formulation.equations.events]
        found = []
        for k, event in enumerate(events):
            if event.kind in ("mark", "stop"):
                times = np.where(runs.event_kinds == k, runs.event_times, np.inf).min(axis=1)
                found.append(np.where(np.isfinite(times), times, np.nan))
        return np.stack(found, axis=1)


def _plain(value: Any) -> Any:
    """A value in JSON's types."""
    if value is None or isinstance(value, str | bool | int):
        return value
    if isinstance(value, Mapping):
        return {str(k): _plain(v) for k, v in value.items()}
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, Sequence):
        return [_plain(v) for v in value]
    if isinstance(value, float | np.floating | np.integer):
        return float(value)
    return _plain(value.as_dict()) if hasattr(value, "as_dict") else str(value)
