"""Inertia that joints can move from one body to another without any effect on the motion.

Each joint has such transfers of its own, whatever the rest of the mechanism is (Khalil and Dombre
2002, 9.4): a mass on the axis of a pin may belong to either body, so may a moment along the axis
and a rod's inertia about it; a ball passes a mass at its centre. They are exact for every position,
so that nothing has to be found by sampling.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from gough import algebra as al
from gough.symbolic.trees.nodes import Inertia, Node, Tree, shifted
from gough.symbolic.trees.ties import Tie, ties

Array = NDArray[np.float64]
ENTRIES = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
"""Order of the six numbers of a tensor: xx, yy, zz, xy, xz, yz."""
PARALLEL = 1e-11
"""Sine of the angle between axes that count as parallel; rounding of their description."""
NUMBERS = 10
"""Of a body: mass, first moment (3), tensor about the origin of its node (6)."""


def as_vector(inertia: Inertia) -> Array:
    """The ten numbers of a body.

    Raises:
        TypeError: some are no numbers but expressions of live parameters.
    """
    tensor = [inertia.tensor[i][k] for i, k in ENTRIES]
    values = [inertia.mass, *inertia.moment, *tensor]
    if not all(map(al.is_number, values)):
        raise TypeError("inertia hangs on live parameters")
    return np.array(values, dtype=float)


def from_vector(x: Sequence[float] | Array) -> Inertia:
    """The body that ten numbers are of."""
    mass, a, b, c, *entries = (float(value) for value in x)
    rows = [[0.0] * 3 for _ in range(3)]
    for (i, k), value in zip(ENTRIES, entries, strict=True):
        rows[i][k] = rows[k][i] = value
    return Inertia(mass, (a, b, c), tuple(map(tuple, rows)))  # type: ignore[arg-type]


class Transfers:
    """Every transfer of a tree.

    Attributes:
        nodes: the nodes that can carry inertia, without the root.
        basis: changes of their numbers without effect, (10 nodes, transfers).
    """

    def __init__(self, tree: Tree) -> None:
        self.tree = tree
        self.nodes = [node for node in tree.nodes if node.parent is not None]
        self._place = {node.index: NUMBERS * k for k, node in enumerate(self.nodes)}
        self._columns: list[Array] = []
        for node in self.nodes:
            self._at_joint(node)
        self._ties = ties(tree)
        for tie in self._ties:
            self._at_closing(tie)
        for node in self.nodes:
            self._in_class(node)
        shape = (NUMBERS * len(self.nodes), len(self._columns))
        self.basis = np.array(self._columns).T.reshape(shape)

    def _add(self, *changes: tuple[Node, Inertia, float]) -> None:
        column = np.zeros(NUMBERS * len(self.nodes))
        for node, inertia, sign in changes:
            if node.index in self._place:
                start = self._place[node.index]
                column[start : start + NUMBERS] += sign * as_vector(inertia)
        if column.any():
            self._columns.append(column)

    def _at_joint(self, node: Node) -> None:
        """Between a node and its parent, across the node's own motion."""
        parent = node.parent
        assert parent is not None
        arm = numbers(node.arm)
        if arm is None:
            return
        if node.kind in ("turn", "ball", "rest"):
            self._add((node, mass_at(al.ZERO), 1), (parent, mass_at(arm), -1))
        if node.kind == "turn":
            axis = al.column(node.joint_axes, node.axis)
            own = al.turn(node.to_class, al.column(al.IDENTITY, node.axis))
            if numbers(axis) is not None and numbers(own) is not None:
                self._along(node, al.ZERO, own, parent, arm, axis)
            if node.frame is node and _has_fixed_direction(node):
                self._about_fixed_direction(node)
        elif node.kind == "rest":
            for axis in al.IDENTITY:
                self._add((node, moment_at(al.ZERO, axis), 1), (parent, moment_at(arm, axis), -1))

    def _about_fixed_direction(self, node: Node) -> None:
        """Of a body turning about a fixed direction only the inertia about it counts.

        A moment along the direction does not count either.
        """
        unit = numbers(node.unit)
        if unit is None:
            return
        u = np.array(unit, dtype=float)
        across = np.linalg.svd(u[None])[2][1:]
        for a, b in ((across[0], across[0]), (across[1], across[1]), tuple(across)):
            self._add((node, _tensor(np.outer(a, b) + np.outer(b, a)), 1))
        for a in across:
            self._add((node, _tensor(np.outer(a, u) + np.outer(u, a)), 1))
        self._add((node, moment_at(al.ZERO, unit), 1))

    def _along(
        self, a: Node, p: al.Vector, u: al.Vector, b: Node, q: al.Vector, w: al.Vector
    ) -> None:
        """A moment along a common axis, and a rod's inertia about it."""
        self._add((a, moment_at(p, u), 1), (b, moment_at(q, w), -1))
        self._add((a, rod_along(u), 1), (b, rod_along(w), -1))

    def _at_closing(self, tie: Tie) -> None:
        """Between the two bodies that a closing joins."""
        if tie.word != "point":
            return
        p, q = numbers(tie.a.point), numbers(tie.b.point)
        if p is not None and q is not None:
            self._add((tie.a.node, mass_at(p), 1), (tie.b.node, mass_at(q), -1))
        a, b = tie.ends
        p, q = numbers(a.point), numbers(b.point)
        if p is None or q is None:
            return
        if a.node.frame is b.node.frame:
            for axis in al.IDENTITY:
                self._add((a.node, moment_at(p, axis), 1), (b.node, moment_at(q, axis), -1))
        elif (axes := self._common_axis(tie)) is not None:
            self._along(a.node, p, axes[0], b.node, q, axes[1])

    def _common_axis(self, tie: Tie) -> tuple[al.Vector, al.Vector] | None:
        """The only axis that two bodies turn about each other, in the axes of either."""
        a, b = tie.ends
        words = {other.word for other in self._ties if other.closing == tie.closing}
        if "axis" in words:
            found = (al.column(end.axes, 2) for end in (a, b))
        elif (turn := self._turn_between(a.node.frame, b.node.frame)) is not None:
            carried, carrier = turn.unit, al.column(turn.joint_axes, turn.axis)
            carrier = al.scale(turn.factor, carrier)
            found = (carried, carrier) if turn is a.node.frame else (carrier, carried)  # type: ignore[assignment]
        else:
            return None
        u, w = map(numbers, found)
        return None if u is None or w is None else (u, w)

    @staticmethod
    def _turn_between(one: Node, other: Node) -> Node | None:
        """The class that turns on the other one about a single axis."""
        for turn, carrier in ((one, other), (other, one)):
            if turn.kind == "turn" and turn.parent is not None and turn.parent.frame is carrier:
                return turn
        return None

    def _in_class(self, node: Node) -> None:
        """Tensors of bodies that turn alike; all but the mass of bodies that never turn."""
        first = node.frame
        if first is node:
            return
        for i, k in ENTRIES:
            self._add((node, _entry(i, k), 1), (first, _entry(i, k), -1))
        if first.parent is None:
            for axis in al.IDENTITY:
                self._add((node, Inertia(moment=axis), 1))


def _has_fixed_direction(turn: Node) -> bool:
    """Whether a class and all that carry it turn about parallel axes."""
    assert turn.parent is not None
    above = turn.parent.frame
    if above.parent is None:
        return True
    if above.kind != "turn" or not _has_fixed_direction(above):
        return False
    across = al.cross(al.column(turn.joint_axes, turn.axis), above.unit)
    return all(al.is_number(x) and abs(x) < PARALLEL for x in across)


def numbers(v: al.Vector) -> al.Vector | None:
    """A vector if it is all numbers, so that it is the same for all live parameters."""
    return v if all(map(al.is_number, v)) else None


def mass_at(p: al.Vector) -> Inertia:
    """A unit mass at a point."""
    return Inertia(1.0, p, shifted(1.0, p))


def moment_at(p: al.Vector, s: al.Vector) -> Inertia:
    """A first moment without mass, at a point: J = (2 p·s) 1 - p sᵀ - s pᵀ."""
    twice = 2.0 * al.dot(p, s)
    tensor = tuple(
        tuple((twice if i == k else 0.0) - p[i] * s[k] - s[i] * p[k] for k in range(3))
        for i in range(3)
    )
    return Inertia(0.0, s, tensor)  # type: ignore[arg-type]


def rod_along(u: al.Vector) -> Inertia:
    """Inertia of a thin rod about its middle, without mass: 1 - u uᵀ."""
    tensor = tuple(tuple(float(i == k) - u[i] * u[k] for k in range(3)) for i in range(3))
    return Inertia(tensor=tensor)  # type: ignore[arg-type]


def _tensor(J: Array) -> Inertia:
    return Inertia(tensor=tuple(map(tuple, J.tolist())))  # type: ignore[arg-type]


def _entry(i: int, k: int) -> Inertia:
    x = [0.0] * NUMBERS
    x[4 + ENTRIES.index((i, k))] = 1.0
    return from_vector(x)


def each_node(x: Array) -> Iterator[Array]:
    """Ten numbers after ten."""
    yield from x.reshape(-1, NUMBERS)
