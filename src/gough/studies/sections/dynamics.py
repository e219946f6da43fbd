"""What legs and platform ask of the motors along a path through home: pictures and a table."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gough import view
from gough.dynamics.contributions import LegContributions
from gough.errors import ConfigurationError, GoughError
from gough.robot import Robot
from gough.studies.context import Context
from gough.studies.report import Block, Cell, Paragraph, Section, Table
from gough.view import Stack

Array = NDArray[np.float64]

TITLE = "Efforts of the motors and what they are made of"
SAMPLES, PERIOD = 121, 1.0
"""Samples of the path, and how long it takes, s."""
SIZES = (0.12, 0.06, 0.03, 0.015)
"""Sizes of the path that are tried, in characteristic lengths or rad."""
AWAY = 0.1
"""Regularity that the whole path keeps; see `gough.dynamics.results`."""
MOST_MOTORS = 6
"""Motors that are drawn."""
KINDS = ("inertia", "Coriolis and centrifugal", "gravity")


@dataclass(frozen=True)
class Run:
    """A path through home and the efforts on it."""

    time: Array
    x: Array
    size: float
    moving: tuple[str, ...]
    parts: LegContributions
    shares: Array
    """Efforts by kind, part and motor, (kinds, times, parts, motors)."""


def section(context: Context) -> Section:
    """Pictures and a table, or a sentence that says why there are none."""
    context.progress("dynamics along a path")
    try:
        found = run(context.robot)
    except GoughError as error:
        text = f"There are no figures of dynamics: {error}."
        return Section("dynamics", TITLE, [Paragraph(text)], {"dynamics": None})
    return Section("dynamics", TITLE, _blocks(context, found), {"dynamics": _data(found)})


def run(robot: Robot) -> Run:
    """The largest path that keeps away from singularities, with all its efforts.

    Raises:
        ConfigurationError: there is no such path, or motors that give fewer forces than there are.
    """
    structure = robot.structure
    if structure.mechanism.platform is None or not structure.columns("operational"):
        raise ConfigurationError("the robot has no platform with outputs")
    moving, model = _moving(robot), robot.dynamics.model("platform")
    if not moving:
        raise ConfigurationError("all outputs are turns of the platform, which the path leaves")
    if model.motors_rank < len(model.independent):
        raise ConfigurationError("the motors do not give every force")
    time = np.linspace(0.0, PERIOD, SAMPLES)
    for size in SIZES:
        x, xd, xdd = _path(robot, moving, size, time)
        solution = robot.dynamics.inverse(x, xd, xdd)
        if solution.solved.all() and solution.regularity.min() > AWAY:
            break
    else:
        raise ConfigurationError("no short path through home keeps away from singularities")
    parts = robot.leg_contributions(x, xd, xdd)
    # of redundant motors the smallest efforts, as in inverse dynamics
    share = np.linalg.pinv(np.swapaxes(robot.dynamics.motor_jacobian(x), -1, -2))
    kinds = np.stack([parts.inertial, parts.velocity, parts.gravity])
    shares = np.einsum("tmi,ktpi->ktpm", share, kinds)
    names = tuple(structure.variables[k].name for k, _ in moving)
    return Run(time, x, size, names, parts, shares)


def _moving(robot: Robot) -> list[tuple[int, int]]:
    """Variables that the path moves and their places in x: those that are plain numbers."""
    model = robot.dynamics.model("platform")
    turned = {place for place, *_ in model.outputs.turned}
    places = {at: k for k, at in enumerate(model.outputs.whole) if k not in turned}
    found = []
    for variable in robot.structure.columns("operational"):
        v = robot.structure.variables[variable]
        edge, part = robot.structure.edges[v.edge], robot.models.closure.slices[v.edge]
        quaternion = edge.type.coordinates > edge.type.freedoms and v.unit == "rad"
        if not quaternion and part.start + v.freedom in places:
            found.append((variable, places[part.start + v.freedom]))
    return found


def _path(
    robot: Robot, moving: list[tuple[int, int]], size: float, time: Array
) -> tuple[Array, Array, Array]:
    """x, ẋ, ẍ of a closed path through home: output n swings n times."""
    outputs = robot.structure.columns("operational")
    x = np.tile(robot.home.x, (len(time), 1))
    xd, xdd = np.zeros((2, len(time), len(outputs)))
    for n, (variable, place) in enumerate(moving, start=1):
        unit = robot.structure.variables[variable].unit
        swing = size * (robot.assembler.length if unit == "m" else 1.0) / n
        turn = 2 * np.pi * n / PERIOD
        column = outputs.index(variable)
        x[:, place] += swing * np.sin(turn * time)
        xd[:, column] = swing * turn * np.cos(turn * time)
        xdd[:, column] = -swing * turn**2 * np.sin(turn * time)
    return x, xd, xdd


def _blocks(context: Context, found: Run) -> list[Block]:
    names, robot = found.parts.parts, context.robot
    count = min(len(found.parts.motors), MOST_MOTORS)
    by_part, by_kind = found.shares.sum(axis=0), found.shares.sum(axis=2)
    one = [Stack(m, by_part[:, :, k].T) for k, m in enumerate(found.parts.motors[:count])]
    two = [Stack(m, by_kind[:, :, k]) for k, m in enumerate(found.parts.motors[:count])]
    unit = _unit(robot)
    left = len(found.parts.motors) - count
    rest = f" {left} more motors are in report.json." if left else ""
    pictures = [
        context.picture(
            "efforts-by-part",
            view.draw_stacks(found.time, one, names, f"effort [{unit}]"),
            f"What each leg and the platform ask of each motor along the path.{rest}",
            "for each motor, shares of legs and platform stacked over time",
        ),
        context.picture(
            "efforts-by-kind",
            view.draw_stacks(found.time, two, KINDS, f"effort [{unit}]"),
            "The same efforts by what they are for.",
            "for each motor, shares of inertia, velocity and gravity stacked over time",
        ),
    ]
    return [Paragraph(_meaning(robot, found)), *pictures, _table(found, unit)]


def _unit(robot: Robot) -> str:
    units = {robot.structure.variables[k].unit for k in robot.structure.columns("actuated")}
    return "N" if units == {"m"} else "N m" if units == {"rad"} else "N, N m"


def _meaning(robot: Robot, found: Run) -> str:
    listed = ", ".join(found.moving)
    swing = found.size * robot.assembler.length
    how = "swing once, twice and so on, the first" if len(found.moving) > 1 else "swings once,"
    return (
        f"The path goes through home in {PERIOD:g} s; {listed} {how} by {1e3 * swing:.3g} mm or "
        f"{found.size:.3g} rad. Efforts are those of "
        "robot.inverse_dynamics; their shares are the forces of legs and platform, reflected to "
        "the motors (robot.leg_contributions), and add up to them."
    )


def _table(found: Run, unit: str) -> Table:
    rows: list[list[Cell]] = []
    for k, name in enumerate(found.parts.parts):
        shares = found.shares[:, :, k]
        kinds = np.sqrt((shares**2).mean(axis=(1, 2)))
        total = float(np.sqrt((shares.sum(axis=0) ** 2).mean()))
        rows.append([name, *_rounded(kinds), _short(total)])
    whole = found.shares.sum(axis=2)
    kinds = np.sqrt((whole**2).mean(axis=(1, 2)))
    total = float(np.sqrt((whole.sum(axis=0) ** 2).mean()))
    rows.append(["sum", *_rounded(kinds), _short(total)])
    caption = f"Root mean square of the shares over the path and the motors, {unit}."
    return Table(["part", *KINDS, "together"], rows, caption)


def _rounded(values: Array) -> list[Cell]:
    return [_short(float(value)) for value in values]


def _short(value: float) -> float:
    return float(f"{value:.4g}")


def _data(found: Run) -> dict[str, object]:
    return {
        "time": found.time.tolist(),
        "x": found.x.tolist(),
        "parts": list(found.parts.parts),
        "motors": list(found.parts.motors),
        "kinds": list(KINDS),
        "efforts": found.shares.tolist(),
    }
