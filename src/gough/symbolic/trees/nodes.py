"""The spanning tree as a chain of single motions: turns, slides and balls, each with its own axes.

Bodies whose relative orientation never changes share one set of axes, a *class*, so that nothing is
turned between them: the two bars of a parallelogram, or a platform that translates and the base.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Literal

import casadi
import numpy as np
from numpy.typing import NDArray

from gough import algebra as al
from gough.algebra import Matrix, Scalar, Transform, Vector
from gough.description.values import scalar, vector
from gough.joints.base import Element
from gough.symbolic.closing_rates import Samples, evaluated
from gough.symbolic.closure import Closure
from gough.topology import Closing, Edge

Array = NDArray[np.float64]
SX = casadi.SX

SAME = 1e-9
"""Rotations that differ by less at every sample are the same; a guess, far above rounding."""
EXACT = 1e-11
"""Entries of constant rotations nearer to 0, 1 or -1 than this are that number."""


@dataclass(eq=False)
class Inertia:
    """Mass, first moment and inertia about the origin of a node, in its class axes."""

    mass: Scalar = 0.0
    moment: Vector = al.ZERO
    """Mass times centre of mass, kg m."""
    tensor: Matrix = (al.ZERO, al.ZERO, al.ZERO)
    """About the origin, kg m²."""

    @property
    def turns(self) -> bool:
        """Whether the tensor is not zero for certain."""
        return not all(_zero(x) for row in self.tensor for x in row)

    @property
    def leans(self) -> bool:
        """Whether the first moment is not zero for certain."""
        return not all(map(_zero, self.moment))


@dataclass(eq=False, repr=False)
class Node:
    """A frame of the tree and the single motion that carries it; numbers in class axes."""

    index: int
    name: str
    parent: Node | None
    kind: Literal["root", "turn", "slide", "ball", "rest"]
    axis: int
    factor: Scalar
    """Of the position and the rate, negative where the joint is crossed from its second body."""
    variables: tuple[int, ...]
    """The variable of a turn or a slide, the three of a ball."""
    place: slice
    """Where its position stands in q."""
    before: Matrix
    """Rotation from the axes of the parent's node to those of the joint."""
    offset: Vector
    """Origin of the joint, in the axes of the parent's node."""
    reversed: bool = False
    bodies: dict[str, Transform] = field(default_factory=dict)
    """T_node_body of the bodies that it carries, in its class axes."""
    inertia: Inertia = field(default_factory=Inertia)
    representative: Node = field(init=False)
    """The node whose axes are those of the class."""
    to_class: Matrix = al.IDENTITY

    def __post_init__(self) -> None:
        self.representative = self

    @property
    def frame(self) -> Node:
        """The representative of its class."""
        return self.representative

    @property
    def outer(self) -> Node:
        """The class in whose axes the linear motion of a ball's centre is cheapest."""
        assert self.parent is not None
        return self.parent.representative

    def ancestors(self) -> Iterator[Node]:
        """Itself, then its parents up to the root."""
        node: Node | None = self
        while node is not None:
            yield node
            node = node.parent

    @cached_property
    def unit(self) -> Vector:
        """The axis of a turn, along which positive rates point, in class axes."""
        own = al.scale(self.factor, al.column(al.IDENTITY, self.axis))
        return al.turn(self.to_class, own)

    @cached_property
    def direction(self) -> Vector:
        """The axis of a slide in the class axes of its parent, times its factor."""
        return al.scale(self.factor, al.column(self.joint_axes, self.axis))

    @cached_property
    def joint_axes(self) -> Matrix:
        """Axes of the joint before its own motion, in class axes of the parent."""
        assert self.parent is not None
        return al.matmul(self.parent.to_class, self.before)

    @cached_property
    def arm(self) -> Vector:
        """Origin of the joint in class axes of the parent, without a slide of its own."""
        assert self.parent is not None
        return al.turn(self.parent.to_class, self.offset)


@dataclass(frozen=True)
class End:
    """A frame of a closing on a node, in class axes."""

    node: Node
    axes: Matrix
    point: Vector


def outermost(node: Node, p: Vector) -> tuple[Node, Vector]:
    """A point on the node nearest to the root that it is fixed to.

    Points on the axis of a turn, and the centre of a ball, belong to what carries them too.
    """
    while node.parent is not None and _carries(node, p):
        p = al.plus(node.arm, al.turn(node.joint_axes, al.turn(al.transpose(node.to_class), p)))
        node = node.parent
    return node, p


def _carries(node: Node, p: Vector) -> bool:
    """Whether the parent of a node carries a point of it."""
    if node.kind == "rest":
        return True
    if node.kind == "ball":
        return all(map(_zero, p))
    if node.kind != "turn":
        return False
    across = al.cross(node.unit, p)
    return all(al.is_number(x) and abs(x) < EXACT for x in across)


class Tree:
    """Nodes of a mechanism.

    Args:
        closure: the mechanism.
        samples: closed configurations, from which classes are read.
        C: all rates v = C w of kept rates w, (variables, kept).

    Attributes:
        nodes: parents before children; the first is the root.
        of_body: the node that carries each body, and T_node_body in the node's own axes.
    """

    def __init__(self, closure: Closure, samples: Samples, C: Array) -> None:
        self.closure, self.samples, self.C = closure, samples, C
        structure = closure.structure
        self.nodes: list[Node] = []
        self.of_body: dict[str, tuple[Node, Matrix, Vector]] = {}
        root = self._add(structure.root, None, "root", slice(0, 0), (), al.HERE)
        self.of_body[structure.root] = root, al.IDENTITY, al.ZERO
        first = 0
        for k, edge in enumerate(structure.edges):
            self._cross(k, edge, first)
            first += edge.type.freedoms
        self._classify()
        self._load()

    @property
    def root(self) -> Node:
        """The node at rest."""
        return self.nodes[0]

    # joints as nodes

    def _add(
        self,
        name: str,
        parent: Node | None,
        kind: Literal["root", "turn", "slide", "ball", "rest"],
        place: slice,
        variables: tuple[int, ...],
        T: Transform,
        axis: int = 2,
        factor: Scalar = 1.0,
        backwards: bool = False,
    ) -> Node:
        node = Node(
            len(self.nodes), name, parent, kind, axis, factor, variables, place, *T, backwards
        )
        self.nodes.append(node)
        return node

    def _cross(self, k: int, edge: Edge, first: int) -> None:
        """Nodes for one joint of the tree; the last one has the axes of its frame on the child."""
        node, C, o = self.of_body[edge.parent]
        R, p = self.closure.frame(edge, edge.parent)
        back = al.transpose(C)
        T = al.matmul(back, R), al.turn(back, al.minus(p, o))
        elements = edge.type.chain(self.closure.dimensions(edge))
        steps, last = _reversed(elements) if edge.reversed else (elements, al.ZERO)
        for element in steps:
            T = T[0], al.plus(T[1], al.turn(T[0], element.shift))
            node = self._step(k, edge, element, first, node, T)
            T = al.HERE
        if not steps:
            node = self._add(edge.child, node, "rest", slice(0, 0), (), T)
        R_child, p_child = self.closure.frame(edge, edge.child)
        beyond = al.minus(p_child, al.turn(R_child, last))
        self.of_body[edge.child] = node, R_child, beyond

    def _step(
        self, k: int, edge: Edge, element: Element, first: int, parent: Node, T: Transform
    ) -> Node:
        start = self.closure.slices[k].start + element.freedom
        count, numbers = (3, 4) if element.kind == "ball" else (1, 1)
        return self._add(
            edge.name,
            parent,
            element.kind,
            slice(start, start + numbers),
            tuple(range(first + element.freedom, first + element.freedom + count)),
            T,
            element.axis,
            element.factor,
            edge.reversed,
        )

    # classes

    def _classify(self) -> None:
        """Give nodes that never turn against each other the axes of the first of them.

        Their orientations have to agree at every sample, and their spins for any kept rates: what
        only a closing keeps parallel has rates of its own, which the rows of that closing give.
        """
        R, spins = self._orientations()
        for node in self.nodes:
            for other in dict.fromkeys(n.representative for n in self.nodes[: node.index]):
                relative = np.swapaxes(R[:, other.index], 1, 2) @ R[:, node.index]
                apart = np.abs(spins[:, node.index] - spins[:, other.index]).max(initial=0.0)
                if np.abs(relative - relative[0]).max() < SAME and (
                    apart < SAME if self.samples.telling else self._fixed(other, node)
                ):
                    node.representative = other
                    node.to_class = _matrix(relative[0])
                    break

    @staticmethod
    def _fixed(one: Node, other: Node) -> bool:
        """Whether only slides lie between two nodes, one of them an ancestor of the other."""
        between: list[Node] = []
        for node in other.ancestors():
            if node is one:
                return all(n.kind in ("slide", "rest") for n in between)
            between.append(node)
        return False

    def _orientations(self) -> tuple[Array, Array]:
        """R_root_node and its spin for unit kept rates, over the samples.

        (samples, nodes, 3, 3) and, in root axes, (samples, nodes, 3, kept).
        """
        q, found, joints = self.closure.q, [al.IDENTITY], [al.IDENTITY]
        for node in self.nodes[1:]:
            assert node.parent is not None
            joints.append(al.matmul(found[node.parent.index], node.before))
            found.append(al.matmul(joints[-1], rotation(node, q)))
        flat = [SX(x) for R in (*found, *joints) for row in R for x in row]
        numbers = evaluated(self.closure, self.samples, flat)
        R, at_joint = np.split(numbers.reshape(len(numbers), -1, 3, 3), 2, axis=1)
        factors = evaluated(self.closure, self.samples, [SX(n.factor) for n in self.nodes])
        spins = np.zeros((*R.shape[:2], 3, len(self.C)))
        for node in self.nodes[1:]:
            assert node.parent is not None
            spins[:, node.index] = spins[:, node.parent.index]
            axes = R[:, node.index] if node.reversed else at_joint[:, node.index]
            if node.kind == "turn":
                axes = axes[:, :, [node.axis]]
            if node.kind in ("turn", "ball"):
                own = factors[:, node.index, None, None] * axes
                spins[:, node.index][:, :, list(node.variables)] += own
        return R, spins @ self.C

    def _load(self) -> None:
        """Put bodies and their inertia on nodes, in class axes."""
        for body, (node, C, o) in self.of_body.items():
            R = al.matmul(node.to_class, al.transpose(C))
            node.bodies[body] = R, al.turn(R, al.scale(-1.0, o))
        for index, inertia in self.inertia_of(self.of_body).items():
            self.nodes[index].inertia = inertia

    def inertia_of(self, bodies: Iterable[str]) -> dict[int, Inertia]:
        """Inertia of some bodies alone, by the index of the node that carries them.

        Of a body whose energy of rotation is a formula of its own (`rotations`) the mass alone.
        """
        described, values = self.closure.structure.flat.bodies, self.closure.values
        found: dict[int, Inertia] = {}
        for body in bodies:
            if body not in described:
                continue
            node, *_ = self.of_body[body]
            R, origin = node.bodies[body]
            part = described[body]
            mass, c = scalar(part.mass, values), vector(part.com, values, 2, 3)
            com = al.plus(origin, al.turn(R, (*c, 0.0)[:3]))
            exact = part.rotation == "exact"
            inertia = _tensor(vector(part.inertia, values, 3, 6) if exact else al.ZERO)
            central = al.matmul(al.matmul(R, inertia), al.transpose(R))
            own = found.get(node.index, Inertia())
            found[node.index] = with_body(own, mass, com, central)
        return found

    def end(self, closing: Closing, side: int) -> End:
        """One frame of a closing."""
        body = closing.bodies[side]
        node, *_ = self.of_body[body]
        R, p = self.closure.frame(closing, body)
        T = al.compose(node.bodies[body], (R, p))
        return End(node, _clean(T[0]), T[1])


def rotation(node: Node, q: SX) -> Matrix:
    """R of the node's own motion, from a configuration."""
    if node.kind == "turn":
        angle = al.mul(node.factor, q[node.place.start])
        return turned(node.axis, al.cos(angle), al.sin(angle))
    if node.kind == "ball":
        R = al.rotation_from_quaternion_wxyz(
            [q[k] for k in range(node.place.start, node.place.stop)]
        )
        return al.transpose(R) if node.reversed else R
    return al.IDENTITY


def turned(axis: int, c: Scalar, s: Scalar) -> Matrix:
    """Rotation about a coordinate axis by an angle with this cosine and sine."""
    i, k = (axis + 1) % 3, (axis + 2) % 3
    R = [[1.0 if a == b else 0.0 for b in range(3)] for a in range(3)]
    R[i][i], R[k][k], R[i][k], R[k][i] = c, c, al.mul(-1.0, s), s
    return tuple(tuple(row) for row in R)  # type: ignore[return-value]


def with_body(own: Inertia, mass: Scalar, com: Vector, central: Matrix) -> Inertia:
    """The inertia together with a body's; that one's tensor is about its centre of mass."""
    moment = al.scale(mass, com)
    steiner = shifted(mass, com)
    tensor = tuple(
        tuple(al.total([a, b, c]) for a, b, c in zip(*rows, strict=True))
        for rows in zip(own.tensor, central, steiner, strict=True)
    )
    return Inertia(al.add(own.mass, mass), al.plus(own.moment, moment), tensor)  # type: ignore[arg-type]


def shifted(mass: Scalar, r: Vector) -> Matrix:
    """m (r² 1 - r rᵀ), the inertia of a point."""
    square = al.dot(r, r)
    return tuple(
        tuple(al.mul(mass, al.sub(square if i == k else 0.0, al.mul(r[i], r[k]))) for k in range(3))
        for i in range(3)
    )  # type: ignore[return-value]


def _reversed(elements: Sequence[Element]) -> tuple[list[Element], Vector]:
    """The chain from b to a, and the shift left over at its end."""
    steps, shift = [], al.ZERO
    for element in reversed(elements):
        steps.append(
            Element(
                element.kind,
                element.axis,
                element.freedom,
                al.mul(-1.0, element.factor),
                shift,
            )
        )
        shift = al.scale(-1.0, element.shift)
    return steps, shift


def _tensor(entries: Sequence[Scalar]) -> Matrix:
    xx, yy, zz, xy, xz, yz = (*entries, 0.0, 0.0, 0.0)[:6]
    return (xx, xy, xz), (xy, yy, yz), (xz, yz, zz)


def _matrix(R: Array) -> Matrix:
    near = np.round(R)
    R = np.where(np.abs(R - near) < EXACT, near, R)
    return tuple(tuple(row) for row in R.tolist())  # type: ignore[return-value]


def _clean(R: Matrix) -> Matrix:
    """Numbers that are 0, 1 or -1 but for rounding made so."""

    def snapped(x: Scalar) -> Scalar:
        if al.is_number(x) and abs(x - round(x)) < EXACT:
            return float(round(x))
        return x

    return tuple(tuple(snapped(x) for x in row) for row in R)  # type: ignore[return-value]


def _zero(x: Scalar) -> bool:
    return al.is_number(x) and x == 0
