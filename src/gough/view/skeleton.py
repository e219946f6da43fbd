"""A mechanism at one configuration as points: what a picture of it is drawn from."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from gough.description.frames import transform
from gough.description.parts import Constraint, Joint
from gough.description.values import scalar
from gough.robot import Robot

Array = NDArray[np.float64]

Kind = Literal["base", "link", "platform"]
SLIDING = ("prismatic", "cylindrical", "planar")
"""Joints whose frames move apart: the way between them is drawn."""
SAME = 1e-6
"""Points nearer than this times the characteristic length are one."""


@dataclass(frozen=True)
class Shape:
    """A body as the points where joints and constraints hold it."""

    body: str
    kind: Kind
    points: Array
    """Distinct points in axes of the root, m, (k, 3)."""


@dataclass(frozen=True)
class Mark:
    """A joint or a constraint, where it is."""

    name: str
    type: str
    """The joint type, or ``constraint``."""
    actuated: bool
    at: Array
    """Middle between the origins of its two frames, in axes of the root, m, (3,)."""
    rails: Array
    """Closed outline of the way between its frames, in axes of the root, m, (k, 3); k is 0 where
    the frames have one origin, 2 for a slide, 4 for a parallelogram."""
    on_base: bool


@dataclass(frozen=True)
class Skeleton:
    """Bodies and joints of a mechanism at one configuration, in axes of the root."""

    shapes: tuple[Shape, ...]
    marks: tuple[Mark, ...]
    planar: bool
    """Whether every body moves parallel to the x-y plane."""
    length: float
    """The characteristic length, m."""

    @property
    def points(self) -> Array:
        """Every point there is to draw, m, (k, 3); the origin if there is none."""
        parts = [shape.points for shape in self.shapes]
        parts += [mark.at[None] for mark in self.marks] + [mark.rails for mark in self.marks]
        stacked = np.vstack([np.zeros((0, 3)), *parts])
        return stacked if len(stacked) else np.zeros((1, 3))


def skeleton(robot: Robot, q: Array | None = None) -> Skeleton:
    """The points of a robot at one configuration.

    Args:
        robot: the robot.
        q: positions of the joints of the tree, (positions,); the home configuration by default.

    Raises:
        ClosureError: q is left out and the loops do not close.
    """
    return _Reader(robot, robot.home.q if q is None else q).read()


class _Reader:
    def __init__(self, robot: Robot, q: Array) -> None:
        self.structure, self.mechanism = robot.structure, robot.mechanism
        self.length = robot.assembler.length
        self.values = robot.assembler.values
        poses = robot.models.poses(q, robot.assembler.p)
        self.poses = dict(zip(self.structure.bodies, poses, strict=True))
        self.poses[self.structure.root] = np.eye(4)

    def read(self) -> Skeleton:
        flat = self.structure.flat
        parts: dict[str, Joint | Constraint] = {**flat.joints, **flat.constraints}
        ends: dict[str, list[Array]] = {}
        for part in parts.values():
            for k, body in enumerate(part.bodies):
                ends.setdefault(body, []).append(self._frame(part, k)[:3, 3])
        shapes = [Shape(body, self._kind(body), self._distinct(p)) for body, p in ends.items()]
        marks = [mark for name, part in parts.items() for mark in self._marks(name, part)]
        planar = self.mechanism.motion == "planar"
        return Skeleton(tuple(shapes), tuple(marks), planar, self.length)

    def _kind(self, body: str) -> Kind:
        if body == self.mechanism.base:
            return "base"
        return "platform" if body == self.mechanism.platform else "link"

    def _frame(self, part: Joint | Constraint, k: int) -> Array:
        """T_root_frame of a part's frame on its first or second body, (4, 4)."""
        R, p = transform(part.frames[k], self.values)
        T = np.eye(4)
        T[:3, :3], T[:3, 3] = R, p
        return np.asarray(self.poses[part.bodies[k]] @ T)

    def _distinct(self, points: list[Array]) -> Array:
        kept: list[Array] = []
        for point in points:
            if all(np.linalg.norm(point - other) > SAME * self.length for other in kept):
                kept.append(point)
        return np.array(kept)

    def _marks(self, name: str, part: Joint | Constraint) -> Iterator[Mark]:
        a, b = self._frame(part, 0), self._frame(part, 1)
        kind = part.type if isinstance(part, Joint) else "constraint"
        if kind == "free":
            return
        actuated = isinstance(part, Joint) and part.actuated
        rails = self._rails(part, kind, a, b)
        on_base = self.mechanism.base in part.bodies
        yield Mark(name, kind, actuated, (a[:3, 3] + b[:3, 3]) / 2, rails, on_base)

    def _rails(self, part: Joint | Constraint, kind: str, a: Array, b: Array) -> Array:
        apart = float(np.linalg.norm(b[:3, 3] - a[:3, 3])) > SAME * self.length
        if kind == "parallelogram" and isinstance(part, Joint) and apart:
            half = float(scalar(part.dimensions.get("width", 0.0), self.values)) / 2 * a[:3, 1]
            near, far = a[:3, 3], b[:3, 3]
            return np.array([near + half, far + half, far - half, near - half])
        if kind in SLIDING and apart:
            return np.array([a[:3, 3], b[:3, 3]])
        return np.zeros((0, 3))
