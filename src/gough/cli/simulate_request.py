"""What options of ``gough simulate`` ask for, as `Robot.simulate` takes it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click
import numpy as np
from numpy.typing import NDArray

from gough.cli.common import Numbers
from gough.dynamics.trajectory import Motion, columns_of, motion_of
from gough.errors import ConfigurationError, UnknownName
from gough.formats.trajectory import open_table
from gough.robot import Robot
from gough.simulation.controllers import ComputedTorque, Controller, JointPD, PDGravity
from gough.simulation.events import When
from gough.simulation.factors import every_parameter
from gough.simulation.trajectories import Followed, Hold, Of, Reference, Table, followed

Array = NDArray[np.float64]

CONTROLLERS = ("computed-torque", "pd-gravity", "joint-pd")
FREQUENCY = 20.0
"""Natural frequency of computed torque where nothing is said, rad/s; a guess for machines of about
a metre. It is wrong for what is much slower, such as large structures in orbit."""
DURATION = 1.0
"""Length of a run where nothing is said, s."""
EVERY = "all"
"""The name of every parameter."""


@dataclass(frozen=True)
class Gains:
    """What a controller is to be like."""

    controller: str | None
    frequency: list[float] | None
    damping_ratio: list[float] | None
    stiffness: list[float] | None
    damping: list[float] | None

    @property
    def given(self) -> list[str]:
        """Options that were given."""
        names = ("controller", "frequency", "damping_ratio", "stiffness", "damping")
        return [f"--{n.replace('_', '-')}" for n in names if getattr(self, n) is not None]


@dataclass(frozen=True)
class Asked:
    """Arguments of `Robot.simulate` that hang together."""

    duration: float
    start: dict[str, list[float] | Array | None]
    """x0, v0 and q0."""
    controller: Controller | None


def asked(
    robot: Robot,
    duration: float | None,
    start: Mapping[str, list[float] | None],
    hold: bool,
    trajectory: Path | None,
    gains: Gains,
) -> Asked:
    """Duration, start and controller.

    Raises:
        ConfigurationError: options do not fit each other.
        DescriptionError: something in the file is wrong; every problem.
        SingularError: the motion is out of reach.
    """
    if hold and trajectory is not None:
        raise ConfigurationError("give --hold or --trajectory, and not both")
    if trajectory is not None:
        return _along(robot, trajectory, duration, start, gains)
    given: dict[str, list[float] | Array | None] = dict(start)
    length = DURATION if duration is None else duration
    if hold:
        coordinates, of = _followed(robot, gains)
        begun = robot.simulator.start(start["x0"], start["v0"], start["q0"])
        return Asked(length, given, _controller(Hold(coordinates.of(begun.q)), of, gains))
    if gains.given:
        raise ConfigurationError(
            f"{', '.join(gains.given)}: a controller follows something; give --hold, to stay "
            "where the run starts, or --trajectory FILE.csv"
        )
    return Asked(length, given, None)


def _along(
    robot: Robot,
    path: Path,
    duration: float | None,
    start: Mapping[str, list[float] | None],
    gains: Gains,
) -> Asked:
    """Along a motion of a file, from its first row unless the start is given."""
    dynamics = robot.dynamics
    motion = motion_of(dynamics, open_table(path, columns_of(dynamics).known))
    if motion.time is None:
        raise ConfigurationError(f"{path} has no column time")
    if gains.controller == "joint-pd":
        coordinates, of = _followed(robot, gains)
        reference: Reference = _of_motors(robot, motion, coordinates)
    else:
        reference = Table.read(robot, path)
        of = None if motion.space == "platform" else [name for name, _ in motion.columns.positions]
    begun: dict[str, list[float] | Array | None] = dict(start)
    if all(value is None for value in start.values()):
        begun["v0"] = motion.rates[0]
        if motion.space == "platform":
            begun["x0"] = motion.at[0]
        else:
            begun["q0"] = dynamics.state(motion.at[0])
    length = float(motion.time[-1]) if duration is None else duration
    return Asked(length, begun, _controller(reference, of, gains))


def _of_motors(robot: Robot, motion: Motion, motors: Followed) -> Table:
    """The motion of the motors that goes with one of the outputs."""
    dynamics = robot.dynamics
    at = motion.at
    if motion.space == "joint":
        at = np.array([dynamics.state(row) for row in motion.at])
    q, v, a = dynamics.motion(at, motion.rates, motion.accelerations, motion.space)
    columns = list(motors.variables)
    assert motion.time is not None
    return Table(motion.time, motors.of(q), v[:, columns], a[:, columns], motors.names)


def _followed(robot: Robot, gains: Gains) -> tuple[Followed, Of]:
    outputs = robot.structure.columns("operational")
    of: Of = "inputs" if gains.controller == "joint-pd" else None
    return followed(robot.dynamics.model("platform" if outputs else "joint"), of), of


def _controller(reference: Reference, of: Of, gains: Gains) -> Controller:
    kind = gains.controller or CONTROLLERS[0]
    if kind not in CONTROLLERS:
        raise UnknownName("controller", kind, CONTROLLERS)
    values = {
        "stiffness": _one_or_all(gains.stiffness),
        "damping": _one_or_all(gains.damping),
        "frequency": _one_or_all(gains.frequency),
        "damping_ratio": _one_or_all(gains.damping_ratio),
    }
    given = {name: value for name, value in values.items() if value is not None}
    if kind == "computed-torque":
        if not given.keys() & {"stiffness", "damping"}:
            given.setdefault("frequency", FREQUENCY)
        elif "damping_ratio" in given:
            raise ConfigurationError(
                "give --frequency and --damping-ratio, or --stiffness and --damping, not both"
            )
        return ComputedTorque(reference, **given, of=of)
    wrong = [f"--{n.replace('_', '-')}" for n in given if n not in ("stiffness", "damping")]
    if wrong or len(given) < 2:
        said = f"; {' and '.join(wrong)} can be given for computed-torque" if wrong else ""
        raise ConfigurationError(
            f"{kind} takes --stiffness and --damping, in N/m and N s/m or N m/rad and N m s/rad, "
            f"one number or one for each coordinate{said}"
        )
    law = PDGravity if kind == "pd-gravity" else JointPD
    return law(reference, given["stiffness"], given["damping"], of=of)


def _one_or_all(given: list[float] | None) -> Any:
    return given[0] if given is not None and len(given) == 1 else given


# names and values


def named(option: str, form: str, example: str, texts: Iterable[str]) -> dict[str, str]:
    """Values by name from texts such as ``NAME=VALUE``.

    Raises:
        ConfigurationError: a text has no name or no value, or a name occurs twice.
    """
    found: dict[str, str] = {}
    for text in texts:
        name, equals, value = (part.strip() for part in text.partition("="))
        if not (equals and name and value):
            raise ConfigurationError(f"{option} {text!r}: expected {form}, such as {example}")
        if name in found:
            raise ConfigurationError(f"{option}: {name} occurs twice")
        found[name] = value
    return found


def inputs_of(texts: Iterable[str]) -> dict[str, Any]:
    """Inputs by name: numbers, or tables of files.

    Raises:
        ConfigurationError: a value is neither.
        DescriptionError: something in a file is wrong; every problem.
    """
    given = named("--input", "JOINT=VALUE", "leg1.slide=10, or leg1.slide=push.csv", texts)
    return {name: _input(name, text) for name, text in given.items()}


def _input(name: str, text: str) -> Any:
    if Path(text).suffix.lower() == ".csv":
        table = open_table(text, {"time": "s", "value": "1"})
        for column in ("time", "value"):
            if column not in table.columns:
                raise table.wrong_header(f"there is no column {column!r}; expected time and value")
        return table.columns["time"], table.columns["value"]
    try:
        numbers = Numbers().convert(text, None, None)
    except click.UsageError:
        numbers = []
    if len(numbers) != 1:
        raise ConfigurationError(
            f"--input {name}: {text!r} is neither a number nor a file whose name ends in .csv"
        )
    return numbers[0]


def events_of(marks: Iterable[str], stops: Iterable[str]) -> dict[str, When]:
    """Events by name.

    Raises:
        ConfigurationError: a text has no name or no expression, or a name occurs twice.
    """
    form, example = "NAME=EXPRESSION", '"half=platform.z - 0.5"'
    found = {name: When(text) for name, text in named("--event", form, example, marks).items()}
    for name, text in named("--stop-at", form, example, stops).items():
        if name in found:
            raise ConfigurationError(f"--stop-at: {name} is the name of an --event")
        found[name] = When(text, stop=True)
    return found


def vary_of(robot: Robot, texts: Iterable[str]) -> dict[str, str] | str:
    """Distributions by name; one text where it is for every parameter."""
    given = named("--vary", "NAME=DISTRIBUTION", '"mass=±5%", or "all=±10%"', texts)
    if EVERY not in given or EVERY in robot.mechanism.parameters:
        return given
    share = given.pop(EVERY)
    if not given:
        return share
    return {**every_parameter(robot.mechanism, share, {}), **given}
