"""The robot at its home configuration: views to scale, and where its joints are."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gough import view
from gough.robot import Robot
from gough.studies.context import Context
from gough.studies.numbers import NOISE, written
from gough.studies.report import Paragraph, Section, Table

MOST_ROWS = 14
"""More variables than these, and the passive ones are left to the data."""
QUATERNION = ("qw", "qx", "qy", "qz")


@dataclass(frozen=True)
class Position:
    """One number of a configuration."""

    name: str
    role: str
    value: float
    unit: str


def section(context: Context) -> Section:
    """The pictures and the positions."""
    robot, home = context.robot, context.home
    planar = robot.mechanism.motion == "planar"
    views = "x-y plane" if planar else "front, side and top view"
    caption = (
        f"{robot.name} at home, to scale: {views}. Lines join the joints of a body; the base is "
        "grey, motors are orange."
    )
    figure = view.draw_mechanism(view.skeleton(robot))
    drawn = context.picture("robot", figure, caption, f"Bodies and joints of {robot.name}")
    found = positions(robot)
    shown = [p for p in found if len(found) <= MOST_ROWS or p.role != "passive"]
    left = " Passive joints are in report.json." if len(shown) < len(found) else ""
    table = Table(
        ("position", "role", "value", "unit"),
        [(p.name, p.role, p.value, p.unit) for p in shown],
        f"Positions of the joints of the tree at home.{left}",
    )
    data = {
        "home": {
            "q": home.q,
            "q_actuated": home.q_actuated,
            "x": home.x,
            "positions": [vars(p) for p in found],
            "residual": home.assembly.residual,
            "steps": home.assembly.steps,
            "restarts": home.assembly.restarts,
        }
    }
    return Section("robot", "The robot at home", [drawn, _closing(context), table], data)


def _closing(context: Context) -> Paragraph:
    done = context.home.assembly
    again = (
        f" after {done.restarts} restarts from perturbed passive joints" if done.restarts else ""
    )
    return Paragraph(
        f"The loops close to {written(done.residual, 2)} (m, or sine of an angle) in "
        f"{done.steps} Newton steps{again} from the positions described. Everything below "
        "is said of this configuration unless it says otherwise."
    )


def positions(robot: Robot) -> list[Position]:
    """Every number of the home configuration with its name, role and unit."""
    structure, q = robot.structure, robot.home.q
    found = []
    for k, edge in enumerate(structure.edges):
        own = [v for v in structure.variables if v.edge == k]
        part = np.where(np.abs(q) < NOISE, 0.0, q)[robot.models.closure.slices[k]]
        turned = len(part) - len(own) == 1  # a unit quaternion stands for the last three freedoms
        plain = own[:-3] if turned else own
        for variable, value in zip(plain, part, strict=False):
            found.append(Position(variable.name, variable.role, float(value), variable.unit))
        if turned:
            roles = {v.role for v in own[-3:]}
            role = roles.pop() if len(roles) == 1 else "in part operational"
            for label, value in zip(QUATERNION, part[-4:], strict=True):
                found.append(Position(f"{edge.name}.{label}", role, float(value), ""))
    return found
