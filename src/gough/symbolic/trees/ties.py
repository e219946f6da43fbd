"""What a closing says of rates: for each of its words, rows of velocity and of acceleration.

A row is zero in every motion. Words that hold a whole vector (of the relative velocity, or of the
relative spin) may be written in the axes of any class; good axes leave few unknowns in each row.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import casadi
import numpy as np

from gough import algebra as al
from gough.algebra import Scalar, Vector
from gough.description.values import scalar
from gough.joints import TYPES
from gough.joints.base import Dimensions, Hold
from gough.joints.constraints import CONSTRAINTS
from gough.symbolic.closing_rates import evaluated
from gough.symbolic.trees.frames import Frames
from gough.symbolic.trees.motion import Motion, Twisted
from gough.symbolic.trees.nodes import EXACT, End, Node, Tree, outermost

NEVER = 1e-10
"""Distances that change by less, in characteristic lengths, are constant; a guess."""


@dataclass(frozen=True)
class Slide:
    """A slide as the length between a point of what carries it and a closing point."""

    start: End
    end: End
    unit: Vector
    """Along the length, in class axes of what carries the slide."""


@dataclass(frozen=True)
class Tie:
    """One word of one closing."""

    closing: str
    word: Hold | Literal["coupling", "distance", "length"]
    a: End
    b: End
    common: Node
    """The nearest common node: the rows see the motion relative to it."""
    dimensions: Dimensions
    ends: tuple[End, End]
    """The frames on the bodies themselves; of a point, a and b are where it is fixed to first."""
    terms: tuple[tuple[int, Scalar], ...] = ()
    """Of a coupling: variables and factors; of a length: those of its rate."""
    slide: Slide | None = None
    """Of a length: what it is as the slide has it."""

    @property
    def still(self) -> tuple[Node, ...]:
        """The nodes that do not count: the common one and what carries it."""
        return tuple(self.common.ancestors())

    @property
    def classes(self) -> list[Node]:
        """Classes in whose axes rows may be written."""
        if self.word in ("distance", "length"):
            return [self.common.frame]
        found = [end.node.frame for end in (self.a, self.b)]
        if self.word in ("point", "orientation"):
            for end in (self.a, self.b):
                for node in end.node.ancestors():
                    found.append(node.frame)
                    if node is self.common:
                        break
        return list(dict.fromkeys(found))


def ties(tree: Tree) -> list[Tie]:
    """Every word of every closing of a tree."""
    found = []
    for closing in tree.closure.structure.closings:
        a, b = tree.end(closing, 0), tree.end(closing, 1)
        kind = TYPES[closing.type] if closing.kind == "joint" else CONSTRAINTS[closing.type]
        dimensions = tree.closure.dimensions(closing)
        for word in kind.holds:
            ends = (_centre(a), _centre(b)) if word == "point" else (a, b)
            found.append(Tie(closing.name, word, *ends, _common(*ends), dimensions, (a, b)))
    return found + _couplings(tree)


def _centre(end: End) -> End:
    """The origin of a frame, on the node nearest to the root that it is fixed to, without axes."""
    node, p = outermost(end.node, end.point)
    return End(node, al.IDENTITY, p)


def distances(tree: Tree, frames: Frames) -> list[Tie]:
    """Distances between a closing point and points of its leg that are the same at every sample.

    Such a row leaves out all that turns between the two points.
    """
    samples, found = tree.samples, []
    for tie in ties(tree) if samples.telling else []:
        for own, other in ((tie.a, tie.b), (tie.b, tie.a)):
            line = list(own.node.ancestors())
            line = line[: line.index(tie.common)] if tie.word == "point" else []
            starts = {outermost(node, al.ZERO) for node in line}
            for node, p in starts:
                offset = frames.between(node, p, other.node, other.point, tree.root)
                x = evaluated(tree.closure, samples, offset)
                size = np.linalg.norm(x, axis=1)
                moves = np.ptp(x, axis=0).max() > NEVER * samples.length
                if moves and np.ptp(size) < NEVER * samples.length and other.node is not node:
                    ends = End(node, al.IDENTITY, p), other
                    found.append(Tie(tie.closing, "distance", *ends, _common(*ends), {}, ends))
    return found


def length(tie: Tie, tree: Tree, frames: Frames) -> Tie | None:
    """The length of a slide between two points, where a closing at a point makes it their distance.

    Seen so, all that turns the slide is left out: the rate of the length is that of the distance
    from where the slide is carried to the closing point on the other side.
    """
    for own, other in ((tie.a, tie.b), (tie.b, tie.a)):
        node = own.node
        if tie.word != "point" or node.kind != "slide" or node is tie.common:
            continue
        assert node.parent is not None
        carrier, axis = node.parent, al.column(node.joint_axes, node.axis)
        x = frames.between(carrier, al.ZERO, node, own.point, carrier.frame)
        if not all(al.is_number(k) and abs(k) < EXACT for k in al.cross(x, axis)):
            continue
        signs = np.sign(evaluated(tree.closure, tree.samples, [al.dot(x, axis)]))
        if not signs[0] or (signs != signs[0]).any():
            continue
        sign = float(signs[0, 0])
        slide = Slide(End(carrier, al.IDENTITY, al.ZERO), own, al.scale(sign, axis))
        terms = ((node.variables[0], al.mul(sign, node.factor)),)
        start = _centre(slide.start)
        common = _common(start, other)
        return Tie(tie.closing, "length", start, other, common, {}, (start, other), terms, slide)
    return None


def _common(a: End, b: End) -> Node:
    """The nearest node that carries both ends."""
    right = list(b.node.ancestors())
    return next(node for node in a.node.ancestors() if node in right)


def _couplings(tree: Tree) -> list[Tie]:
    structure, here = tree.closure.structure, End(tree.root, al.IDENTITY, al.ZERO)
    index = {variable.name: k for k, variable in enumerate(structure.variables)}
    found = []
    for name, coupling in structure.flat.couplings.items():
        terms = tuple(
            (index[joint], scalar(factor, tree.closure.values))
            for joint, factor in coupling.terms.items()
        )
        found.append(Tie(name, "coupling", here, here, tree.root, {}, (here, here), terms))
    return found


class Rows:
    """Rows of ties over one placing of the tree."""

    def __init__(self, frames: Frames) -> None:
        self.frames = frames

    def velocity(self, tie: Tie, motion: Motion, axes: Node) -> list[Scalar]:
        """Rates of the conditions of a tie, as components in axes of a class."""
        return _VELOCITY[tie.word](_View(self.frames, tie, motion, axes))

    def acceleration(self, tie: Tie, motion: Motion, axes: Node) -> list[Scalar]:
        """Second rates of the conditions, at rates that obey them."""
        return _ACCELERATION[tie.word](_View(self.frames, tie, motion, axes))


class _View:
    """A tie seen in the axes of one class."""

    def __init__(self, frames: Frames, tie: Tie, motion: Motion, axes: Node) -> None:
        self.frames, self.tie, self.motion, self.axes = frames, tie, motion, axes

    def _here(self, given: Twisted) -> Vector:
        return self.frames.turn(given[0], given[1], self.axes)

    def axis(self, k: int) -> Vector:
        """Axis k of frame a."""
        return self.frames.turn(al.column(self.tie.a.axes, k), self.tie.a.node.frame, self.axes)

    def normals(self) -> tuple[Vector, Vector]:
        """Two directions normal to the common z axis, fixed in the body of the chosen class."""
        end = self.tie.b if self.axes is self.tie.b.node.frame else self.tie.a
        return tuple(
            self.frames.turn(al.column(end.axes, k), end.node.frame, self.axes) for k in (0, 1)
        )  # type: ignore[return-value]

    def second_axis(self) -> Vector:
        """Axis y of frame b."""
        b = self.tie.b
        return self.frames.turn(al.column(b.axes, 1), b.node.frame, self.axes)

    def spin(self, end: End) -> Vector:
        return self._here(_spin(self.motion, end.node))

    def spin_rate(self, end: End) -> Vector:
        return self._here(_spin_rate(self.motion, end.node))

    @property
    def relative_spin(self) -> Vector:
        """ω_b - ω_a."""
        return al.minus(self.spin(self.tie.b), self.spin(self.tie.a))

    @property
    def relative_spin_rate(self) -> Vector:
        """α_b - α_a."""
        return al.minus(self.spin_rate(self.tie.b), self.spin_rate(self.tie.a))

    @property
    def offset(self) -> Vector:
        """From the origin of frame a to that of frame b."""
        a, b = self.tie.a, self.tie.b
        return self.frames.between(a.node, a.point, b.node, b.point, self.axes)

    @property
    def size(self) -> Scalar:
        """The length of the offset: of itself or as the slide has it, what is cheaper."""
        offset, slide = self.offset, self.tie.slide
        found: Scalar = al.norm(offset)
        if slide is None:
            return found
        start, end, axes = slide.start, slide.end, slide.start.node.frame
        x = self.frames.between(start.node, start.point, end.node, end.point, axes)
        own = al.dot(x, slide.unit)
        return min(own, found, key=lambda size: _instructions([*offset, size]))

    def rate(self) -> Scalar:
        """Sum of the rates of the terms."""
        rate = self.motion.variable_rate
        return al.total([al.mul(factor, rate(k)) for k, factor in self.tie.terms])

    def rate_change(self) -> Scalar:
        """Sum of the accelerations of the terms."""
        change = self.motion.variable_rate_change
        return al.total([al.mul(factor, change(k)) for k, factor in self.tie.terms])

    def closing_velocity(self) -> Vector:
        """Velocity of the origin of b less that of a."""
        a, b = (
            self._here(self.motion.point_velocity(end.node, end.point))
            for end in (self.tie.a, self.tie.b)
        )
        return al.minus(b, a)

    def closing_acceleration(self) -> Vector:
        """Acceleration of the origin of b less that of a."""
        a, b = (
            self._here(self.motion.point_acceleration(end.node, end.point))
            for end in (self.tie.a, self.tie.b)
        )
        return al.minus(b, a)

    def slip(self) -> Vector:
        """Velocity of the origin of b in the body of a."""
        return al.minus(self.closing_velocity(), al.cross(self.spin(self.tie.a), self.offset))

    def slip_rate(self) -> Vector:
        """Acceleration of the origin of b in the body of a."""
        a, e, w = self.tie.a, self.offset, self.spin(self.tie.a)
        carried = al.plus(al.cross(self.spin_rate(a), e), al.cross(w, al.cross(w, e)))
        turning = al.scale(2.0, al.cross(w, self.slip()))
        return al.minus(self.closing_acceleration(), al.plus(carried, turning))


def _spin(motion: Motion, node: Node) -> Twisted:
    if node.kind == "ball" and not node.reversed:
        return motion.outer_spin(node), node.outer
    return motion.spin(node.frame), node.frame


def _spin_rate(motion: Motion, node: Node) -> Twisted:
    if node.kind == "ball" and not node.reversed:
        return motion.outer_spin_rate(node), node.outer
    return motion.spin_rate(node.frame), node.frame


# velocities


def _distance_velocity(view: _View) -> list[Scalar]:
    return [al.dot(view.offset, view.closing_velocity())]


def _axis_velocity(view: _View) -> list[Scalar]:
    return [al.dot(n, view.relative_spin) for n in view.normals()]


def _line_velocity(view: _View) -> list[Scalar]:
    return [al.dot(view.axis(k), view.slip()) for k in (0, 1)]


def _circle_velocity(view: _View) -> list[Scalar]:
    return [*_distance_velocity(view), al.dot(view.axis(2), view.slip())]


def _crossed_velocity(view: _View) -> list[Scalar]:
    return [al.dot(al.cross(view.axis(0), view.second_axis()), view.relative_spin)]


def _advance_velocity(view: _View) -> list[Scalar]:
    z, lead = view.axis(2), _lead(view)
    return [al.sub(al.dot(z, view.slip()), al.mul(lead, al.dot(z, view.relative_spin)))]


def _length_velocity(view: _View) -> list[Scalar]:
    """e·v - l̇ with the unit vector e from a to b."""
    e = al.scale(1.0 / view.size, view.offset)
    return [al.sub(al.dot(e, view.closing_velocity()), view.rate())]


def _lead(view: _View) -> Scalar:
    return view.tie.dimensions["pitch"] / TURN


TURN = 6.283185307179586
"""rad"""


def _instructions(scalars: Sequence[Scalar]) -> int:
    """Instructions of some scalars; what they share counts once."""
    column = casadi.vertcat(*[casadi.SX(x) for x in scalars])
    return int(casadi.Function("count", casadi.symvar(column), [column]).n_instructions())


_VELOCITY: Mapping[str, Callable[[_View], list[Scalar]]] = {
    "point": lambda view: list(view.closing_velocity()),
    "orientation": lambda view: list(view.relative_spin),
    "axis": _axis_velocity,
    "line": _line_velocity,
    "level": lambda view: [al.dot(view.axis(2), view.slip())],
    "circle": _circle_velocity,
    "crossed": _crossed_velocity,
    "advance": _advance_velocity,
    "coupling": lambda view: [view.rate()],
    "distance": _distance_velocity,
    "length": _length_velocity,
}

# accelerations


def _axis_acceleration(view: _View) -> list[Scalar]:
    """n fixed in a body: n·(α_b - α_a) + (ω_b - ω_a)·(ω × n), with ω_b - ω_a along z."""
    spin, change = view.relative_spin, view.relative_spin_rate
    body = view.tie.b if view.axes is view.tie.b.node.frame else view.tie.a
    own = view.spin(body)
    return [al.add(al.dot(n, change), al.dot(spin, al.cross(own, n))) for n in view.normals()]


def _line_acceleration(view: _View) -> list[Scalar]:
    return [al.dot(view.axis(k), view.slip_rate()) for k in (0, 1)]


def _distance_acceleration(view: _View) -> list[Scalar]:
    """(e·v)˙ = e·a + v·v."""
    v = view.closing_velocity()
    return [al.add(al.dot(view.offset, view.closing_acceleration()), al.dot(v, v))]


def _length_acceleration(view: _View) -> list[Scalar]:
    """(e·v)˙ = e·a + (v·v - l̇²) / l."""
    v, rate, inverse = view.closing_velocity(), view.rate(), 1.0 / view.size
    along = al.dot(al.scale(inverse, view.offset), view.closing_acceleration())
    across = al.mul(inverse, al.sub(al.dot(v, v), al.mul(rate, rate)))
    return [al.sub(al.add(along, across), view.rate_change())]


def _circle_acceleration(view: _View) -> list[Scalar]:
    return [*_distance_acceleration(view), al.dot(view.axis(2), view.slip_rate())]


def _crossed_acceleration(view: _View) -> list[Scalar]:
    """n = x × y with ṅ = (ω_a × x) × y + x × (ω_b × y)."""
    x, y, a, b = view.axis(0), view.second_axis(), view.tie.a, view.tie.b
    change = al.plus(al.cross(al.cross(view.spin(a), x), y), al.cross(x, al.cross(view.spin(b), y)))
    turning = al.dot(change, view.relative_spin)
    return [al.add(al.dot(al.cross(x, y), view.relative_spin_rate), turning)]


def _advance_acceleration(view: _View) -> list[Scalar]:
    z, lead = view.axis(2), _lead(view)
    turning = al.dot(al.cross(view.spin(view.tie.a), z), view.relative_spin)
    change = al.add(al.dot(z, view.relative_spin_rate), turning)
    return [al.sub(al.dot(z, view.slip_rate()), al.mul(lead, change))]


_ACCELERATION: Mapping[str, Callable[[_View], list[Scalar]]] = {
    "point": lambda view: list(view.closing_acceleration()),
    "orientation": lambda view: list(view.relative_spin_rate),
    "axis": _axis_acceleration,
    "line": _line_acceleration,
    "level": lambda view: [al.dot(view.axis(2), view.slip_rate())],
    "circle": _circle_acceleration,
    "crossed": _crossed_acceleration,
    "advance": _advance_acceleration,
    "coupling": lambda view: [view.rate_change()],
    "distance": _distance_acceleration,
    "length": _length_acceleration,
}
