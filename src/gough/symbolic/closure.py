"""Closure equations of a mechanism and their Jacobian as scalar expressions."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import casadi

from gough import algebra as al
from gough.algebra import Scalar, Transform
from gough.description.frames import transform
from gough.description.values import Values, evaluate_parameters, scalar
from gough.joints import TYPES
from gough.joints.base import Dimensions, Row, Twist
from gough.joints.constraints import CONSTRAINTS
from gough.topology import Closing, Edge, Structure

SX = casadi.SX


@dataclass(frozen=True)
class Block:
    """The rows that one closing or coupling gives: ``rows`` of the residual."""

    name: str
    kind: str
    rows: slice
    joints: tuple[str, ...]
    """Joints of the loop, or of the coupling."""


@dataclass
class Closure:
    """F(q) = 0 and all that follows from it, in positions ``q`` and live parameters ``p``.

    Positions are those of the tree's joints in the order of ``structure.edges``; rates ``v`` are
    one for each of ``structure.variables``. Residuals of lengths are in m, of directions sines.
    """

    structure: Structure
    q: SX = field(init=False)
    p: SX = field(init=False)
    values: Values = field(init=False)
    """Parameters, live ones as symbols."""
    nominal: Values = field(init=False)
    """Parameters as numbers."""

    def __post_init__(self) -> None:
        edges = self.structure.edges
        self.q = SX.sym("q", sum(edge.type.coordinates for edge in edges))
        parameters = self.structure.flat.parameters
        self.nominal = evaluate_parameters(parameters)
        self.live = {name: self.nominal[name] for name, part in parameters.items() if part.live}
        self.p = SX.sym("p", sum(_size(value) for value in self.live.values()))
        symbols = iter([self.p[k] for k in range(self.p.numel())])
        given = {name: filled(value, symbols) for name, value in self.live.items()}
        self.values = evaluate_parameters(parameters, given)

    # placement

    @cached_property
    def slices(self) -> tuple[slice, ...]:
        """Where the position of each edge stands in q."""
        return _slices(edge.type.coordinates for edge in self.structure.edges)

    def position(self, edge: int) -> list[SX]:
        """Symbols of the position of one edge."""
        part = self.slices[edge]
        return [self.q[k] for k in range(part.start, part.stop)]

    def dimensions(self, part: Edge | Closing) -> Dimensions:
        """The numbers a joint needs besides its frames."""
        return {key: scalar(value, self.values) for key, value in part.dimensions.items()}

    def frame(self, part: Edge | Closing, body: str) -> Transform:
        """T_body_frame of a joint's or constraint's frame on one of its bodies."""
        return transform(part.frames[part.bodies.index(body)], self.values, self.nominal)

    def step(self, index: int) -> Transform:
        """T_parent_child across one edge of the tree."""
        edge = self.structure.edges[index]
        across = edge.type.placement(self.position(index), self.dimensions(edge))
        if edge.reversed:
            across = al.inverse(across)
        at_parent, at_child = self.frame(edge, edge.parent), self.frame(edge, edge.child)
        return al.compose(al.compose(at_parent, across), al.inverse(at_child))

    @cached_property
    def steps(self) -> tuple[Transform, ...]:
        """T_parent_child of every edge."""
        return tuple(self.step(k) for k in range(len(self.structure.edges)))

    @cached_property
    def poses(self) -> dict[str, Transform]:
        """T_root_body of every body of the tree."""
        poses = {self.structure.root: al.HERE}
        for edge, step in zip(self.structure.edges, self.steps, strict=True):
            poses[edge.child] = al.compose(poses[edge.parent], step)
        return poses

    def along(self, path: Sequence[int]) -> Transform:
        """The product of the steps along a path of edges."""
        T = al.HERE
        for index in path:
            T = al.compose(T, self.steps[index])
        return T

    # equations

    @cached_property
    def blocks(self) -> tuple[Block, ...]:
        """Names and rows of the closings, then of the couplings."""
        parts: list[tuple[str, str, tuple[str, ...], int]] = [
            (closing.name, closing.kind, self.structure.loop_joints(closing), len(rows))
            for closing, (rows, _) in zip(self.structure.closings, self._closed, strict=True)
        ]
        parts += [
            (name, "coupling", tuple(coupling.terms), 1)
            for name, coupling in self.structure.flat.couplings.items()
        ]
        slices = _slices(count for *_, count in parts)
        return tuple(
            Block(name, kind, rows, joints)
            for (name, kind, joints, _), rows in zip(parts, slices, strict=True)
        )

    @cached_property
    def _closed(self) -> tuple[tuple[list[Row], list[Scalar]], ...]:
        """Rows of each closing, and the cosines that are 1 on its reachable side."""
        return tuple(self._rows(closing) for closing in self.structure.closings)

    def _rows(self, closing: Closing) -> tuple[list[Row], list[Scalar]]:
        to_a, to_b = self.structure.loop(*closing.bodies)
        (at_a, at_b), dimensions = closing.frames, self.dimensions(closing)
        a = al.compose(self.along(to_a), transform(at_a, self.values, self.nominal))
        b = al.compose(self.along(to_b), transform(at_b, self.values, self.nominal))
        planar = self.structure.mechanism.motion == "planar"
        if closing.kind == "joint":
            kind = TYPES[closing.type]
            rows = kind.planar_rows if planar else kind.rows
            return rows(a, b, dimensions), kind.alignment(a, b, dimensions)
        constraint = CONSTRAINTS[closing.type]
        return (constraint.planar_rows if planar else constraint.rows)(a, b), constraint.alignment(
            a, b
        )

    @cached_property
    def rows(self) -> tuple[Row, ...]:
        """Every closure equation in order."""
        rows = [row for closed, _ in self._closed for row in closed]
        return (*rows, *(self._coupling(name) for name in self.structure.flat.couplings))

    def _coupling(self, name: str) -> Row:
        """sum of factor × position - offset, in whatever unit the factors were written for."""
        coupling = self.structure.flat.couplings[name]
        edges = enumerate(self.structure.edges)
        index = {edge.name: k for k, edge in edges if not edge.link}
        residual: Scalar = al.mul(-1.0, scalar(coupling.offset, self.values))
        for joint, factor in coupling.terms.items():
            k = index[joint]
            residual = al.add(residual, al.mul(scalar(factor, self.values), self.position(k)[0]))
        return Row(residual, "rad")

    @cached_property
    def residual(self) -> SX:
        """F(q), a column."""
        return _column([row.residual for row in self.rows])

    @cached_property
    def sides(self) -> SX:
        """1 - cosine of each closing's alignment, a column: zero on the side it can reach.

        These vanish with zero slope at a closed configuration. They keep a search away from half
        turns and antiparallel axes, which solve F = 0 too.
        """
        return _column([1.0 - value for _, values in self._closed for value in values])

    @cached_property
    def side_closings(self) -> tuple[str, ...]:
        """The name of the closing behind each entry of ``sides``."""
        pairs = zip(self.structure.closings, self._closed, strict=True)
        return tuple(closing.name for closing, (_, values) in pairs for _ in values)

    # rates

    @cached_property
    def position_rates(self) -> SX:
        """H with dq/dt = H v, (positions, variables)."""
        blocks = []
        for k, edge in enumerate(self.structure.edges):
            rows = edge.type.position_rates(self.position(k))
            blocks.append(_matrix(rows, edge.type.coordinates, edge.type.freedoms))
        return casadi.diagcat(*blocks) if blocks else SX(0, 0)

    @cached_property
    def jacobian(self) -> SX:
        """E = [M N K] with its columns in the order of the variables: dF/dt = E v."""
        return self._slope(self.residual)

    @cached_property
    def side_jacobian(self) -> SX:
        """Derivative of ``sides`` by the rates."""
        return self._slope(self.sides)

    def _slope(self, values: SX) -> SX:
        return casadi.jacobian(values, self.q) @ self.position_rates

    @cached_property
    def body_twists(self) -> dict[str, list[Twist]]:
        """For each body, its twist for a unit rate of each variable on the way to it.

        Linear part at the origin of the body, in axes of the root.
        """
        twists: dict[str, list[Twist]] = {self.structure.root: []}
        # edges come parents first, so the twists of a body stand in the order of the variables
        for index, edge in enumerate(self.structure.edges):
            twists[edge.child] = self._carried(twists[edge.parent], edge) + self._own(index, edge)
        return twists

    def _carried(self, twists: list[Twist], edge: Edge) -> list[Twist]:
        shift = al.minus(self.poses[edge.child][1], self.poses[edge.parent][1])
        return [(al.plus(v, al.cross(w, shift)), w) for v, w in twists]

    def _own(self, index: int, edge: Edge) -> list[Twist]:
        """Twists of the child from the edge itself."""
        a = al.compose(self.poses[edge.bodies[0]], self.frame(edge, edge.bodies[0]))
        b = al.compose(self.poses[edge.bodies[1]], self.frame(edge, edge.bodies[1]))
        sign = -1.0 if edge.reversed else 1.0
        own = []
        for v, w in edge.type.twists(self.position(index), self.dimensions(edge)):
            linear, angular = al.turn(a[0], v), al.turn(a[0], w)
            reach = al.minus(self.poses[edge.child][1], b[1])
            moved = al.plus(linear, al.cross(angular, reach))
            own.append((al.scale(sign, moved), al.scale(sign, angular)))
        return own

    def body_jacobian(self, body: str) -> SX:
        """J with twist = J v, (6, variables): linear part at the body's origin, root axes."""
        path = set(self.structure.path(body))
        columns = [k for k, v in enumerate(self.structure.variables) if v.edge in path]
        J = SX(6, len(self.structure.variables))
        for k, (linear, angular) in zip(columns, self.body_twists[body], strict=True):
            for i, value in enumerate((*linear, *angular)):
                if not (al.is_number(value) and value == 0):
                    J[i, k] = value
        return J


def _size(value: Any) -> int:
    return sum(map(_size, value)) if isinstance(value, tuple) else 1


def filled(value: Any, scalars: Iterator[Scalar]) -> Any:
    """The next scalars, in the shape of a value."""
    if isinstance(value, tuple):
        return tuple(filled(item, scalars) for item in value)
    return next(scalars)


def _slices(lengths: Any) -> tuple[slice, ...]:
    slices, start = [], 0
    for length in lengths:
        slices.append(slice(start, start + length))
        start += length
    return tuple(slices)


def _column(values: Sequence[Scalar]) -> SX:
    return SX(casadi.vertcat(*values)) if values else SX(0, 1)


def _matrix(rows: Sequence[Sequence[Scalar]], n: int, m: int) -> SX:
    matrix = SX(n, m)
    for i, row in enumerate(rows):
        for k, value in enumerate(row):
            if not (al.is_number(value) and value == 0):
                matrix[i, k] = value
    return matrix
