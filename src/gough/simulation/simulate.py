"""The face of simulation: what a person asks for becomes runs and a dataset."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gough.dynamics.dynamics import Dynamics
from gough.errors import ConfigurationError, UnknownName
from gough.numerics.newton import Ending as Closing
from gough.simulation.controllers import Controller, Sampled
from gough.simulation.equations import Asked, CommandSource, Setting
from gough.simulation.events import asked_for
from gough.simulation.forces import DRIVE, Placed, laws_of, variable_of
from gough.simulation.formulations import Formulations
from gough.simulation.inputs import Inputs, read_inputs
from gough.simulation.methods import METHODS
from gough.simulation.run import Options, Runner, Start, Trace
from gough.simulation.trajectories import Signals

if TYPE_CHECKING:
    import xarray

Array = NDArray[np.float64]

LOCATED = 1e-7
"""Relative tolerance below which steps end where a law switches, unless asked otherwise: what a
step across a switch costs in accuracy, of second order in its length, counts only then."""
TIMES = 201
"""Times that a run is seen at, unless others are asked for."""
FINEST = 1e-15


@dataclass(frozen=True)
class Request:
    """What a person asks for; see `Robot.simulate`."""

    duration: float
    x0: ArrayLike | None = None
    v0: ArrayLike | None = None
    q0: ArrayLike | None = None
    inputs: Mapping[str, Any] | None = None
    controller: CommandSource | Sampled | None = None
    events: Mapping[str, Any] | None = None
    gravity: ArrayLike | None = None
    method: str = "dormand-prince"
    rtol: float = 1e-8
    atol: float | None = None
    times: int | ArrayLike = TIMES
    max_step: float = np.inf
    max_steps: int = 10_000_000
    locate: bool | None = None


class Simulator:
    """Simulations of one mechanism.

    What they have in common (formulations, machine code) is kept between runs with the same
    inputs, controller and events.

    Args:
        dynamics: of the mechanism.
        about: attributes of every dataset.
    """

    def __init__(self, dynamics: Dynamics, about: Mapping[str, Any]) -> None:
        self.dynamics, self.about = dynamics, dict(about)
        self.laws = tuple(laws_of(dynamics.models.closure))
        self._formulations: dict[Any, Formulations] = {}

    def run(self, request: Request) -> xarray.Dataset:
        """One run as a dataset."""
        from gough.simulation.dataset import of_trace

        runner, trace = self.trace(request)
        about = {
            **self.about,
            "method": request.method,
            "rtol": request.rtol,
            "atol": runner.options.atol,
            "duration": request.duration,
        }
        return of_trace(self.dynamics, runner.formulations.setting.laws, trace, about)

    def trace(self, request: Request) -> tuple[Runner, Trace]:
        """One run, and what made it."""
        runner = self.runner(request)
        start = self.start(request.x0, request.v0, request.q0)
        times = times_of(request.times, request.duration)
        return runner, runner.go(start, request.duration, times)

    def runner(self, request: Request) -> Runner:
        """What makes the runs of a request.

        Raises:
            ConfigurationError: something asked for has the wrong form or value.
            UnknownName: a name does not exist.
        """
        options = options_of(request)
        inputs = read_inputs(request.inputs, self.laws)
        gravity = None
        if request.gravity is not None:
            gravity = numbers("gravity", request.gravity, 3)
        asked = asked_for(request.events, self.dynamics)
        source, sampled, drives = request.controller, None, {}
        if isinstance(source, Sampled):
            sampled, source, drives = source, None, self._drives()
            inputs = replace(inputs, constant=dict.fromkeys(drives, 0.0) | inputs.constant)
        signals = (
            source.signals(self.dynamics.model("joint")) if isinstance(source, Controller) else None
        )
        located = options.rtol < LOCATED if request.locate is None else bool(request.locate)
        setting = self._setting(inputs, source, signals, asked, gravity is not None, located)
        formulations = self._kept(setting)
        told = None if signals is None else (signals.breaks, signals.coefficients)
        return Runner(formulations, inputs, options, gravity, told, sampled, drives)

    def _drives(self) -> dict[str, tuple[str, Callable[[float], Any]]]:
        """Of each drive of a motor: the name of its variable, and its command for an effort."""
        structure = self.dynamics.structure
        motors = set(self.dynamics.motors)
        found: dict[str, tuple[str, Callable[[float], Any]]] = {}
        for law in self.laws:
            name = structure.variables[variable_of(structure, law.joint, law.freedom)].name
            if law.law.commanded and name in motors:
                found[law.name] = name, partial(_command, law)
        return found

    def _setting(
        self,
        inputs: Inputs,
        source: CommandSource | None,
        signals: Signals | None,
        asked: tuple[Asked, ...],
        gravity: bool,
        located: bool,
    ) -> Setting:
        names = () if signals is None else signals.names
        told = {*inputs.constant, *inputs.tabled}
        return Setting(
            self._acting(told, source is not None),
            tuple(inputs.constant),
            (*inputs.tabled, *names),
            source,
            asked,
            gravity,
            located,
        )

    def _kept(self, setting: Setting) -> Formulations:
        """The formulations for a setting; those of an equal one are used again."""
        laws = tuple(law.name for law in setting.laws)
        key = (laws, id(setting.source), replace(setting, laws=(), source=None))
        if key not in self._formulations:
            self._formulations[key] = Formulations(self.dynamics, setting)
        return self._formulations[key]

    def _acting(self, told: set[str], driven: bool) -> tuple[Placed, ...]:
        """The laws, without the drives that nobody tells anything."""
        return tuple(
            law for law in self.laws if driven or law.name in told or not is_bare_drive(law)
        )

    def start(
        self, x0: ArrayLike | None, v0: ArrayLike | None, q0: ArrayLike | None = None
    ) -> Start:
        """Where a run starts; at rest at home by default.

        Raises:
            ConfigurationError: the shape is wrong, or a configuration does not close.
            SingularError: x0 is out of reach.
        """
        dynamics = self.dynamics
        outputs = bool(dynamics.structure.columns("operational"))
        if q0 is not None and x0 is not None:
            raise ConfigurationError("give x0 or q0, and not both")
        if q0 is not None:
            q = self._closed(q0)
        elif x0 is None:
            q = dynamics.home
        elif outputs:
            q = dynamics.reached(np.asarray(x0, dtype=float))
        else:
            raise ConfigurationError(
                f"{dynamics.structure.mechanism.name} has no outputs; give the start as a "
                "configuration q0: see robot.state"
            )
        return Start(q, self._rates(q, v0, outputs))

    def _closed(self, q0: ArrayLike) -> Array:
        """A configuration that closes, to rounding, near the one given."""
        dynamics = self.dynamics
        q = numbers("q0", q0, dynamics.models.positions)
        closed = dynamics.assembler.close(q)
        moved = float(np.abs(closed.q - q).max()) if closed.ending is Closing.closed else np.inf
        if moved > 1e-6 * max(1.0, float(np.abs(q).max())):
            raise ConfigurationError(
                "q0 does not close its loops"
                + (f": a joint would have to move by {moved:.2g}" if np.isfinite(moved) else "")
                + "; close it first, by robot.state or robot.inverse_geometry"
            )
        return closed.q

    def _rates(self, q: Array, v0: ArrayLike | None, outputs: bool) -> Array:
        """Rates of all variables of the tree."""
        dynamics = self.dynamics
        space = "platform" if outputs else "joint"
        model = dynamics.model(space)  # type: ignore[arg-type]
        columns = dynamics.structure.columns("operational") if outputs else model.independent
        if v0 is None:
            return np.zeros(len(dynamics.structure.variables))
        given = dict(zip(columns, numbers("v0", v0, len(columns)), strict=True))
        y = np.array([given.get(k, 0.0) for k in model.independent])
        p = dynamics.assembler.p
        v = model.kernel("rates", "q")(q, *([p] if p.size else []), y)
        missed = max((abs(v[k] - x) for k, x in given.items()), default=0.0)
        if not np.all(np.isfinite(v)) or missed > 1e-9 * max(1.0, float(np.abs(y).max())):
            raise ConfigurationError(
                "v0 can not be had at the start: the mechanism is singular there, or these rates "
                "depend on each other"
            )
        return np.asarray(v)


def is_bare_drive(law: Placed) -> bool:
    """Whether a law is the drive that an actuated joint has without saying so."""
    return law.name.removeprefix(f"{law.joint}.").rstrip("0123456789") == DRIVE


def numbers(name: str, given: ArrayLike, count: int) -> Array:
    """Finite numbers, (count,)."""
    try:
        found = np.array(given, dtype=float)
    except (TypeError, ValueError):
        raise ConfigurationError(f"{name} is {given!r}, expected {count} numbers") from None
    if found.shape != (count,):
        raise ConfigurationError(f"{name} has shape {found.shape}, expected ({count},)")
    if not np.all(np.isfinite(found)):
        raise ConfigurationError(f"{name} has entries that are not finite")
    return found


def times_of(given: int | ArrayLike, duration: float) -> Array:
    """The times at which a run is seen: so many, or as given."""
    if isinstance(given, int | np.integer) and not isinstance(given, bool):
        if given < 2:
            raise ConfigurationError(f"times is {given}, expected 2 or more, or a list of times")
        return np.linspace(0.0, duration, int(given))
    try:
        times = np.array(given, dtype=float)
    except (TypeError, ValueError):
        raise ConfigurationError(f"times is {given!r}, expected a number or a list") from None
    good = times.ndim == 1 and times.size and np.all(np.isfinite(times))
    if not good or np.any(np.diff(times) <= 0) or times[0] < 0 or times[-1] > duration:
        raise ConfigurationError(
            f"times have to rise and to lie between 0 and the duration, {duration:g} s"
        )
    if times[0] > 0.0:  # energies are told from the start on
        times = np.concatenate([[0.0], times])
    return times


def options_of(request: Request) -> Options:
    """The options, checked."""
    if request.method not in METHODS:
        raise UnknownName("method", str(request.method), METHODS)
    positive = {"duration": request.duration, "rtol": request.rtol, "max_step": request.max_step}
    if request.atol is not None:
        positive["atol"] = request.atol
    for name, value in positive.items():
        if not isinstance(value, int | float | np.number) or not value > 0:
            raise ConfigurationError(f"{name} is {value!r}, expected a positive number")
    if not np.isfinite(request.duration):
        raise ConfigurationError("duration is infinite; give the end of the run in s")
    if request.rtol < FINEST:
        raise ConfigurationError(f"rtol is {request.rtol:g}, below the rounding of numbers")
    if request.max_steps < 1:
        raise ConfigurationError(f"max_steps is {request.max_steps}, expected 1 or more")
    return Options(
        request.method,
        float(request.rtol),
        float(request.rtol if request.atol is None else request.atol),
        float(request.max_step),
        int(request.max_steps),
    )


def _command(law: Placed, effort: float) -> Any:
    return law.law.command_for(effort, law.numbers)
