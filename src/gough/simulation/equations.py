"""Equations of motion of a mechanism with its laws of force, as kernels for integration.

    d/dt (positions, y, memory, delivered, dissipated) = f(t, state; signals, branches, p, inputs)

Positions are operational coordinates where they place the mechanism in closed form, else a whole
configuration; y are independent rates; the last two states are energies, J.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Protocol

import casadi
import numpy as np
from numpy.typing import NDArray

from gough import algebra as al
from gough.algebra import Scalar
from gough.dynamics.model import Model
from gough.dynamics.writing import Inputs, Place, Writing
from gough.errors import ConfigurationError, UnknownName
from gough.kernels import Kernel
from gough.kernels.tiled import TiledKernel
from gough.numerics.integration import Event
from gough.simulation.forces import Acting, Placed, variable_of
from gough.symbolic.trees.factors import solve_definite

Array = NDArray[np.float64]
SX = casadi.SX

ENERGIES = ("delivered", "dissipated")
GUARD = Event("regularity", "guard")


class CommandSource(Protocol):
    """Where commands come from."""

    def commands(self, scene: Scene) -> Mapping[str, Scalar]:
        """Efforts on variables that have a drive, by name; those that are left out get none."""


@dataclass(frozen=True)
class Asked:
    """What is looked for during a run besides what laws tell."""

    name: str
    value: Callable[[Scene], Scalar]
    kind: str = "mark"
    direction: int = 0


@dataclass(frozen=True)
class Setting:
    """What acts on the mechanism in a run."""

    laws: tuple[Placed, ...]
    """In terms of the model's own parameters."""
    inputs: tuple[str, ...] = ()
    """Laws that are told a number that stays the same in a run."""
    signals: tuple[str, ...] = ()
    """Laws that are told a function of time given by a table, then those of the source."""
    source: CommandSource | None = None
    asked: tuple[Asked, ...] = ()
    gravity: bool = False
    """Whether gravity is given rather than that of the description."""
    located: bool = True
    """Whether steps end where a law's formula switches; else laws are continuous there."""


class Scene:
    """What controllers and events are written from: a model and symbols of its state.

    Attributes:
        t: time, s.
        writing: the model.
        x: operational coordinates, or positions of the independent variables.
        y: independent rates.
        told: symbols of the source's own signals, by name.
    """

    def __init__(self, writing: Writing, t: SX, told: Mapping[str, SX]) -> None:
        self.writing, self.t, self.told = writing, t, told
        self.model = writing.model
        self.y: list[Scalar] = list(writing.reduced.y)

    def variable(self, name: str) -> int:
        """Place of a variable by its name.

        Raises:
            UnknownName: there is none.
        """
        names = [v.name for v in self.model.structure.variables]
        if name not in names:
            raise UnknownName("variable", name, names)
        return names.index(name)

    def position(self, name: str) -> Scalar:
        """Position of a variable of the tree, m or rad.

        Where outputs place the mechanism, angles of joints lie within half a turn.

        Raises:
            UnknownName: there is no such variable.
            ConfigurationError: a rotation of a ball has no position.
        """
        closure, k = self.model.closure, self.variable(name)
        variable = self.model.structure.variables[k]
        edge = self.model.structure.edges[variable.edge]
        coordinate = edge.type.coordinate_of(variable.freedom)
        if coordinate is None:
            raise ConfigurationError(
                f"{name} is one of three rotations, which has a rate but no position of its own"
            )
        if self.writing.place == "q" or edge.link:
            return closure.position(variable.edge)[coordinate]
        return self.writing.reduced.position(k)

    def rate(self, name: str) -> Scalar:
        """Rate of a variable of the tree."""
        reduced = self.writing.reduced
        return reduced.all_rates(reduced.rates)[self.variable(name)]

    def efforts(self, yd: Sequence[Scalar]) -> dict[str, Scalar]:
        """Efforts of the motors that give accelerations of the independent rates, by joint."""
        tau, _ = self.writing.motor_efforts(self.writing.forces(yd))
        return self._by_motor(tau)

    def efforts_for(self, along: Sequence[Scalar]) -> dict[str, Scalar]:
        """Efforts of the motors that give forces along the independent rates, by joint."""
        tau, _ = self.writing.motor_efforts(along)
        return self._by_motor(tau)

    def _by_motor(self, tau: Sequence[Scalar]) -> dict[str, Scalar]:
        variables = self.model.structure.variables
        names = [variables[k].name for k in self.model.actuated]
        return dict(zip(names, tau, strict=True))


@dataclass(frozen=True)
class Layout:
    """Where things stand in a state."""

    positions: int
    rates: int
    memory: tuple[str, ...]
    quaternions: tuple[int, ...]

    @property
    def states(self) -> int:
        """How many there are."""
        return self.positions + self.rates + len(self.memory) + len(ENERGIES)

    def part(self, name: str) -> slice:
        """Where positions, rates, memory or energies stand."""
        ends = np.cumsum([0, self.positions, self.rates, len(self.memory), len(ENERGIES)]).tolist()
        k = ("positions", "rates", "memory", "energies").index(name)
        return slice(ends[k], ends[k + 1])


@dataclass
class Equations:
    """The equations of one model in one place under one setting.

    Args:
        model: the mechanism in independent rates.
        place: operational coordinates or a configuration.
        setting: what acts on it.
    """

    model: Model
    place: Place
    setting: Setting
    t: SX = field(init=False)

    def __post_init__(self) -> None:
        self.writing = self.model.writing(self.place, Inputs(gravity=self.setting.gravity))
        self.owner = self.writing.model
        setting = self.setting
        self.t = SX.sym("t")
        self._memory = SX.sym("memory", sum(len(law.memory) for law in setting.laws))
        switches = sum(len(p.law.switches) for p in setting.laws) if setting.located else 0
        self._branch = SX.sym("branch", switches)
        self._inputs = SX.sym("inputs", len(setting.inputs))
        self._signals = SX.sym("signals", len(setting.signals))
        self._energies = SX.sym("energies", len(ENERGIES))

    # states

    @cached_property
    def positions(self) -> list[SX]:
        """Symbols of the positions."""
        q = self.owner.closure.q
        whole = self.owner.outputs.whole if self.place == "x" else range(q.numel())
        return [q[k] for k in whole]

    @cached_property
    def layout(self) -> Layout:
        """Where things stand in a state."""
        structure, closure = self.owner.structure, self.owner.closure
        starts = [
            part.stop - 4
            for edge, part in zip(structure.edges, closure.slices, strict=True)
            if edge.type.coordinates > edge.type.freedoms
        ]
        if self.place == "x":
            whole = self.owner.outputs.whole
            starts = [whole.index(k) for k in starts if k in whole]
        names = tuple(name for law in self.setting.laws for name in law.memory)
        return Layout(len(self.positions), len(self.writing.yd), names, tuple(starts))

    # what acts

    @cached_property
    def scene(self) -> Scene:
        """What the source of commands and events are written from."""
        named = zip(self.setting.signals, range(len(self.setting.signals)), strict=True)
        return Scene(self.writing, self.t, {name: self._signals[k] for name, k in named})

    @cached_property
    def _commands(self) -> dict[str, Scalar]:
        """What laws are told, by name; sources speak of efforts on variables."""
        setting, source = self.setting, self.setting.source
        found: dict[str, Scalar] = {}
        efforts = {} if source is None else source.commands(self.scene)
        for variable, effort in efforts.items():
            law = self._drive_of(variable)
            found[law.name] = law.law.command_for(effort, law.numbers)
        for k, name in enumerate(setting.signals):
            found.setdefault(name, self._signals[k])
        return found | {name: self._inputs[k] for k, name in enumerate(setting.inputs)}

    def _drive_of(self, variable: str) -> Placed:
        """The law that drives a variable."""
        structure = self.owner.structure
        drives = [law for law in self.setting.laws if law.law.commanded]
        names = [
            structure.variables[variable_of(structure, law.joint, law.freedom)].name
            for law in drives
        ]
        if names.count(variable) > 1:
            raise ConfigurationError(
                f"{variable} has several drives, so a controller can not tell which to use; tell "
                "them apart by inputs"
            )
        if variable not in names:
            raise UnknownName("motor", variable, names)
        return drives[names.index(variable)]

    @cached_property
    def acting(self) -> Acting:
        """The laws with frozen branches."""
        commands = self._commands
        return Acting(
            self.setting.laws,
            self.owner,
            self.place,
            self.writing.reduced,
            [self._memory[k] for k in range(self._memory.numel())],
            self._branches,
            lambda name: commands.get(name, 0.0),
        )

    @property
    def _branches(self) -> list[SX] | None:
        """Symbols of the branches, if switches are located."""
        if not self.setting.located:
            return None
        return [self._branch[k] for k in range(self._branch.numel())]

    # the motion

    @cached_property
    def _accelerations(self) -> list[Scalar]:
        """ẏ for what acts."""
        w, reduced = self.writing, self.writing.reduced
        A = reduced.mass_matrix(w.loads)
        w.require_inertia(A)
        still = [0.0] * len(w.yd)
        along = reduced.forces(still, w.gravity, w.loads.given(self.acting.along))
        yd, _ = solve_definite(A, [al.mul(-1.0, x) for x in along])
        return yd

    @cached_property
    def _position_rates(self) -> list[Scalar]:
        """Rates of the positions."""
        closure, reduced = self.owner.closure, self.writing.reduced
        if self.place == "q":
            found = closure.position_rates @ casadi.vertcat(*reduced.all_rates(reduced.rates))
        else:
            columns = self.owner.structure.columns("operational")
            order = [list(self.owner.independent).index(k) for k in columns]
            H = closure.position_rates[self.owner.outputs.whole, columns]
            found = H @ casadi.vertcat(*[reduced.y[k] for k in order])
        return [found[k] for k in range(found.numel())]

    @cached_property
    def events(self) -> tuple[tuple[Event, Scalar], ...]:
        """Switches of laws, then their marks, then what was asked for, then the guard."""
        pairs = [
            (placed, event)
            for placed, effort in zip(self.setting.laws, self.acting.efforts, strict=True)
            for event in effort.events
        ]
        found = [
            (Event(f"{placed.name}.{event.name}", event.kind), event.value)
            for kind in (("switch", "mark") if self.setting.located else ("mark",))
            for placed, event in pairs
            if event.kind == kind and not al.is_number(event.value)
        ]
        for one in self.setting.asked:
            found.append((Event(one.name, one.kind, one.direction), one.value(self.scene)))
        return (*found, *self._guard)

    @cached_property
    def _guard(self) -> tuple[tuple[Event, Scalar], ...]:
        """Regularity of the independent rates, if they can lose it."""
        found = self.writing.reduced.regularity(self._accelerations)
        return () if al.is_number(found) else ((GUARD, found),)

    # kernels

    @property
    def _symbols(self) -> dict[str, SX]:
        """Inputs of the kernels: those that change in a run first."""
        state = casadi.vertcat(*self.positions, *self.writing.reduced.y, self._memory)
        symbols = {
            "t": self.t,
            "state": SX(casadi.vertcat(state, self._energies)),
            "signals": self._signals,
            "branches": self._branch,
            "p": self.owner.closure.p,
            "inputs": self._inputs,
        }
        if self.setting.gravity:
            symbols["gravity"] = SX(casadi.vertcat(*self.writing.gravity))
        return {name: column for name, column in symbols.items() if column.numel()}

    def _kernel(self, name: str, outputs: Sequence[Scalar]) -> Kernel:
        column = casadi.vertcat(*[SX(x) for x in outputs], SX(0, 1))
        return Kernel(name, self._symbols, casadi.cse(column), (column.numel(),))

    @cached_property
    def held(self) -> tuple[str, ...]:
        """Inputs that stay the same in a run."""
        return tuple(name for name in ("p", "inputs", "gravity") if name in self._symbols)

    @cached_property
    def motion(self) -> TiledKernel:
        """Rates of the states, then values of the events."""
        powers = [self.acting.power(kind) for kind in ENERGIES]
        rates = [*self._position_rates, *self._accelerations, *self.acting.memory_rates, *powers]
        kernel = self._kernel("motion", [*rates, *(value for _, value in self.events)])
        return TiledKernel(kernel, self.held)

    @cached_property
    def observed(self) -> Kernel:
        """Kinetic, potential and stored energy, then force, position and rate of each law."""
        w, acting = self.writing, self.acting
        A, y = w.reduced.mass_matrix(w.loads), w.reduced.y
        kinetic = al.mul(0.5, al.dot(y, [al.dot(row, y) for row in A]))
        values = [kinetic, w.potential(), acting.power("stored")]
        values += [effort.force for effort in acting.efforts]
        values += [seen.position for seen in acting.situations]
        values += [seen.rate for seen in acting.situations]
        return self._kernel("observed", values)

    @cached_property
    def started(self) -> Kernel:
        """Memories at the start, then the quantity of each switch."""
        memory: list[Scalar] = []
        for placed, seen in zip(self.setting.laws, self.acting.situations, strict=True):
            memory += placed.law.start(placed.numbers, seen.position)
        switches = [value for event, value in self.events if event.kind == "switch"]
        return self._kernel("started", [*memory, *switches])
