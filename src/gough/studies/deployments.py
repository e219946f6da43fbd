"""Motions that the laws of force of a robot make from rest at home, and what is told of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gough.description.parts import Actuator
from gough.errors import GoughError
from gough.robot import Robot

Array = NDArray[np.float64]

PUSH = 1e-9
"""Force on a joint at rest, N or N m, that counts as none."""
FIRST = 1e-4
"""Length of a run that tells the acceleration at home, s; a guess."""
STILL = 1e-9
"""Comparable acceleration, 1/s², that counts as none."""
LOOK = 2.0
"""Length of the first look, in times that the first acceleration takes to move the robot by its
own size."""
DOUBLINGS = 3
"""How often the first look is made longer until every end stop has been met."""
LENGTH = 2.5
"""Length of a run, in times of the last first contact with an end stop; a guess."""
TIMES = 401
RTOL = 1e-8
ALIKE = 1e-6
"""Part of their range by which curves that are drawn as one may differ."""

NOTHING = "There is no run: no law of force moves the robot from rest at home."


@dataclass(frozen=True)
class Quantity:
    """One number over a run."""

    name: str
    unit: str
    """m or rad, or their rates."""
    values: Array
    """(times,)."""

    @property
    def shown(self) -> Array:
        """The values as they are shown: angles in degrees."""
        return np.rad2deg(self.values) if self.unit.startswith("rad") else self.values

    @property
    def shown_unit(self) -> str:
        """The unit of the values shown."""
        return self.unit.replace("rad", "°")

    @property
    def label(self) -> str:
        """Name and unit, to write beside an axis."""
        return f"{self.name} [{self.shown_unit}]"


@dataclass(frozen=True)
class Motion:
    """A run as numbers over time, most of which follow from its dataset.

    Args:
        run: the dataset of `Robot.simulate`.
        units: of the outputs, by name; not asked for where the platform has a pose.
        platform: what names of outputs begin with, which is not shown.
    """

    run: Any
    units: Mapping[str, str] = field(default_factory=dict)
    platform: str = ""

    @property
    def time(self) -> Array:
        """s."""
        return np.asarray(self.run["time"].values)

    @cached_property
    def outputs(self) -> tuple[Quantity, ...]:
        """Position of the platform and how it has turned from home, else the outputs."""
        if "pose" in self.run:
            pose = self.run["pose"].values
            turn = turns(pose[:, 3:])
            places = [Quantity(n, "m", pose[:, k]) for k, n in enumerate("xyz")]
            return (
                *places,
                *(Quantity(f"turn about {n}", "rad", turn[:, k]) for k, n in enumerate("xyz")),
            )
        if "x" not in self.run:
            return ()
        names = [str(name) for name in self.run["x_part"].values]
        return tuple(
            Quantity(name.removeprefix(f"{self.platform}."), self.units.get(name, ""), column)
            for name, column in zip(names, self.run["x"].values.T, strict=True)
        )

    @cached_property
    def travel(self) -> int | None:
        """The output that moves farthest: of a pose a translation."""
        ranges = [np.ptp(q.values) if q.unit != "rad" else -1.0 for q in self.outputs]
        if not ranges:
            return None
        if max(ranges) < 0:
            ranges = [np.ptp(q.values) for q in self.outputs]
        return int(np.argmax(ranges))

    @property
    def twist(self) -> int | None:
        """The turn about the axis of travel, where the platform has a pose."""
        return self.travel + 3 if "pose" in self.run and self.travel is not None else None

    @cached_property
    def speed(self) -> Quantity | None:
        """The rate of travel."""
        if self.travel is None:
            return None
        moved = self.outputs[self.travel]
        rates = self.run["twist" if "pose" in self.run else "xd"].values
        return Quantity(f"rate of {moved.name}", f"{moved.unit}/s", rates[:, self.travel])

    def law(self, kind: str, name: str) -> Array:
        """Force, position or rate of an actuator, (times,)."""
        return np.asarray(self.run[f"actuator_{kind}"].sel(actuator=name).values)


@dataclass(frozen=True)
class Deployment:
    """The run that a robot's laws make from rest at home."""

    robot: Robot
    motion: Motion
    duration: float
    contacts: dict[str, float]
    """Time of the first contact with each end stop that was met, s, by event."""
    stops: int
    """End stops, one for each side that a law tells."""

    @property
    def run(self) -> Any:
        """The dataset."""
        return self.motion.run

    @property
    def whole(self) -> bool:
        """Whether there are end stops and one of each law was met."""
        return bool(self.stops) and len(self.contacts) == self.stops

    @property
    def time(self) -> float:
        """When the last of the end stops was met for the first time, s; infinite without."""
        return max(self.contacts.values()) if self.whole else np.inf

    @cached_property
    def groups(self) -> dict[tuple[str, str], list[str]]:
        """Names of actuators by their own name and their law."""
        found: dict[tuple[str, str], list[str]] = {}
        for name, actuator in actuators(self.robot).items():
            own = name.rpartition(".")[2]
            if name in self.run["actuator"].values:
                found.setdefault((own, actuator.law), []).append(name)
        return found


def deployment(robot: Robot) -> Deployment | str:
    """The run from rest at home, or a sentence that says why there is none.

    It is as long as two and a half times the time of the last first contact with an end stop,
    rounded to one digit; without stops twice the time that the first acceleration takes to move the
    robot by its own size.
    """
    laws = actuators(robot)
    if not laws:
        return NOTHING
    try:
        duration = _first_look(robot)
        if duration is None:
            return NOTHING
        for _ in range(DOUBLINGS):
            found = _deployed(robot, duration, 2)
            if not found.stops or found.whole:
                break
            duration *= 2
        if found.contacts:
            duration = LENGTH * max(found.contacts.values())
        return _deployed(robot, float(f"{duration:.1g}"), TIMES)
    except GoughError as error:
        return f"There is no run: {error}."


def _first_look(robot: Robot) -> float | None:
    """A first guess of how long a run takes, s; None where nothing moves."""
    begun = robot.simulate(FIRST, times=2)
    told = [law.name for law in robot.simulator.laws if law.law.commanded]
    own = ~np.isin(begun["actuator"].values, told)
    if not np.any(np.abs(begun["actuator_force"].values[0, own]) > PUSH):
        return None
    rates = begun["v"].values[-1] / robot.assembler.rate_scale
    acceleration = float(np.abs(rates).max(initial=0.0)) / float(begun["time"].values[-1])
    return LOOK * float(np.sqrt(2 / acceleration)) if acceleration > STILL else None


def _deployed(robot: Robot, duration: float, times: int) -> Deployment:
    run = robot.simulate(duration, times=times, rtol=RTOL)
    contacts: dict[str, float] = {}
    for name, at in zip(run["event"].values, run["event_time"].values, strict=True):
        contacts.setdefault(str(name), float(at))
    stops = [name for name, part in actuators(robot).items() if part.law == "end-stop"]
    met = {name: t for name, t in contacts.items() if name.rpartition(".")[0] in stops}
    one_each = {name.rpartition(".")[0]: name for name in reversed(met)}
    met = {name: t for name, t in met.items() if name in one_each.values()}
    return Deployment(robot, motion_of(robot, run), duration, met, len(stops))


def motion_of(robot: Robot, run: Any) -> Motion:
    """A dataset of a run of a robot with the units of its outputs."""
    units = {variable.name: variable.unit for variable in robot.structure.variables}
    return Motion(run, units, robot.mechanism.platform or "")


def actuators(robot: Robot) -> dict[str, Actuator]:
    """Laws of force by joint, dot, own name."""
    return {
        f"{joint}.{name}": actuator
        for joint, part in robot.structure.flat.joints.items()
        for name, actuator in part.actuators.items()
    }


def numbers_of(robot: Robot, name: str) -> dict[str, Any]:
    """The numbers of a law as floats, or tuples of them."""
    values = robot.assembler.values

    def plain(number: Any) -> Any:
        if isinstance(number, tuple):
            return tuple(plain(item) for item in number)
        found = number.evaluate(values) if hasattr(number, "evaluate") else number
        return tuple(plain(x) for x in found) if isinstance(found, tuple) else float(found)

    return {key: plain(number) for key, number in actuators(robot)[name].numbers.items()}


def turns(wxyz: Array) -> Array:
    """Rotation vectors from the first orientation, in base axes, (times, 3).

    They go on without a jump up to a whole turn, and end there.
    """
    rel = _relative(wxyz, wxyz[0])
    back = np.sum(rel[1:] * rel[:-1], axis=1) < 0
    sides = np.cumprod(np.concatenate([[1.0], np.where(back, -1.0, 1.0)]))
    return _rotation_vectors(rel * sides[:, None])


def turned(wxyz: Array, home_wxyz: Array) -> Array:
    """Rotation vectors of at most half a turn from an orientation, in base axes, (rows, 3)."""
    rel = _relative(wxyz, home_wxyz)
    return _rotation_vectors(np.where(rel[:, :1] < 0, -rel, rel))


def _relative(wxyz: Array, home_wxyz: Array) -> Array:
    """Products with the conjugate of one quaternion, (rows, 4)."""
    w, v, w0, v0 = wxyz[:, 0], wxyz[:, 1:], home_wxyz[0], home_wxyz[1:]
    vector = w0 * v - w[:, None] * v0 - np.cross(v, v0)
    return np.column_stack([w * w0 + v @ v0, vector])


def _rotation_vectors(wxyz: Array) -> Array:
    size = np.linalg.norm(wxyz[:, 1:], axis=1)
    angle = 2 * np.arctan2(size, wxyz[:, 0])
    per = np.divide(angle, size, out=np.full(len(size), 2.0), where=size > 1e-12)
    return np.asarray(per[:, None] * wxyz[:, 1:])


def alike(curves: Sequence[Array]) -> list[list[int]]:
    """Indices of curves that are drawn as one, in groups."""
    size = max((float(np.abs(curve).max(initial=0.0)) for curve in curves), default=0.0)
    found: list[list[int]] = []
    for k, curve in enumerate(curves):
        for group in found:
            if np.abs(curve - curves[group[0]]).max(initial=0.0) <= ALIKE * size:
                group.append(k)
                break
        else:
            found.append([k])
    return found


def together(names: Sequence[str]) -> str:
    """One name for several: the first and the last."""
    if len(names) < 2:
        return names[0] if names else ""
    return f"{names[0]} … {names[-1]}" if len(names) > 2 else f"{names[0]}, {names[1]}"
