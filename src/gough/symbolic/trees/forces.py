"""Recursive Newton-Euler of a tree in class axes, and its composite inertia."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from gough import algebra as al
from gough.algebra import Matrix, Scalar, Vector
from gough.symbolic.trees.frames import Frames
from gough.symbolic.trees.motion import Motion
from gough.symbolic.trees.nodes import Inertia, Node, shifted
from gough.symbolic.trees.regrouping import Pair
from gough.symbolic.trees.rotations import OnNode

Array = NDArray[np.float64]
Wrench = tuple[Vector, Vector]
"""(force, moment)"""


class Loads:
    """What acts on the nodes besides inertia."""

    def __init__(
        self,
        inertia: Mapping[int, Inertia] | None = None,
        wrenches: Mapping[str, Wrench] | None = None,
        rotors: Mapping[int, Scalar] | None = None,
        pairs: Sequence[Pair] = (),
        rotations: Mapping[int, OnNode] | None = None,
        efforts: Mapping[int, Scalar] | None = None,
    ) -> None:
        self.inertia = inertia
        """By node, where it is not the tree's own."""
        self.pairs = pairs
        """Points whose accelerations ask for forces at each other."""
        self.wrenches = wrenches or {}
        """By body: force and moment about its origin, in root axes."""
        self.rotors = rotors or {}
        """By variable, inertia of motors and reels as the joint feels it."""
        self.rotations = rotations or {}
        """By node, bodies whose energy of rotation is a formula of its own."""
        self.efforts = efforts or {}
        """By variable, forces of laws and drives on it."""

    def given(self, efforts: Mapping[int, Scalar]) -> Loads:
        """The same with efforts on variables."""
        return Loads(self.inertia, self.wrenches, self.rotors, self.pairs, self.rotations, efforts)

    def of(self, node: Node) -> Inertia:
        """Inertia of a node."""
        return node.inertia if self.inertia is None else self.inertia.get(node.index, Inertia())


def tree_forces(frames: Frames, motion: Motion, loads: Loads, variables: int) -> list[Scalar]:
    """Generalised forces of all variables, the loops open, (variables,).

    Forces run from the leaves to the root (Luh, Walker and Paul 1980).
    """
    tree = frames.tree
    found: list[Scalar] = [0.0] * variables
    carried = _pair_wrenches(frames, motion, loads)
    for node in reversed(tree.nodes[1:]):
        f, t = carried.get(node.index, (al.ZERO, al.ZERO))
        inner = _inertial(motion, node, loads.of(node))
        f, t = al.plus(f, inner[0]), al.plus(t, inner[1])
        if node.index in loads.rotations:
            t = al.plus(t, loads.rotations[node.index].moment(motion))
        for given in _outer_loads(frames, node, loads):
            f, t = al.minus(f, given[0]), al.minus(t, given[1])
        outer = handed(frames, node, f, t, found)
        assert node.parent is not None
        before = carried.get(node.parent.index, (al.ZERO, al.ZERO))
        carried[node.parent.index] = al.plus(before[0], outer[0]), al.plus(before[1], outer[1])
    for variable, rotor in loads.rotors.items():
        change = motion.variable_rate_change(variable)
        found[variable] = al.add(found[variable], al.mul(rotor, change))
    for variable, effort in loads.efforts.items():
        found[variable] = al.sub(found[variable], effort)
    return found


def _inertial(motion: Motion, node: Node, body: Inertia) -> Wrench:
    """Force and moment about the origin that move a node: f = m a + (α̂ + ω̂²) s, t = J α + ω × J ω
    + s × a."""
    f, t = al.ZERO, al.ZERO
    massive = not (al.is_number(body.mass) and body.mass == 0)
    if body.turns:
        spin = motion.spin(node.frame)
        turning = al.cross(spin, al.turn(body.tensor, spin))
        t = al.plus(al.turn(body.tensor, motion.spin_rate(node.frame)), turning)
    if massive or body.leans:
        a = motion.acceleration(node)
        f = al.scale(body.mass, a)
        if body.leans:
            f = al.plus(f, al.turn(motion.tensor(node.frame), body.moment))
            t = al.plus(t, al.cross(body.moment, a))
    return f, t


def _pair_wrenches(frames: Frames, motion: Motion, loads: Loads) -> dict[int, Wrench]:
    """What the points of pairs ask for, about the origin of their node, in class axes."""
    found: dict[int, Wrench] = {}
    for pair in loads.pairs:
        ends = ((pair.a, pair.p_a, pair.b, pair.p_b), (pair.b, pair.p_b, pair.a, pair.p_a))
        for node, p, other, at in ends:
            a, axes = motion.point_acceleration(other, at)
            force = al.scale(pair.k, frames.turn(a, axes, node.frame))
            before = found.get(node.index, (al.ZERO, al.ZERO))
            moment = al.cross(p, force)
            found[node.index] = al.plus(before[0], force), al.plus(before[1], moment)
    return found


def _outer_loads(frames: Frames, node: Node, loads: Loads) -> list[Wrench]:
    """Given wrenches on the bodies of a node, about its origin, in class axes."""
    found = []
    for body, (_, p) in node.bodies.items():
        if body in loads.wrenches:
            force, moment = (
                frames.turn(x, frames.tree.root, node.frame) for x in loads.wrenches[body]
            )
            found.append((force, al.plus(moment, al.cross(p, force))))
    return found


def handed(frames: Frames, node: Node, f: Vector, t: Vector, found: list[Scalar]) -> Wrench:
    """The wrench of a node as its parent feels it; what its own motion feels is added to found."""
    assert node.parent is not None
    above = node.parent.frame
    if node.kind == "turn":
        _count(found, node.variables[0], al.dot(node.unit, t))
    elif node.kind == "ball" and node.reversed:
        own = al.scale(node.factor, al.turn(al.transpose(node.to_class), t))
        for variable, x in zip(node.variables, own, strict=True):
            _count(found, variable, x)
    f, t = frames.turn(f, node.frame, above), frames.turn(t, node.frame, above)
    if node.kind == "slide":
        _count(found, node.variables[0], al.dot(node.direction, f))
    elif node.kind == "ball" and not node.reversed:
        own = al.turn(al.transpose(node.joint_axes), t)
        for variable, x in zip(node.variables, own, strict=True):
            _count(found, variable, x)
    return f, al.plus(t, al.cross(frames.arm(node), f))


def _count(found: list[Scalar], variable: int, x: Scalar) -> None:
    found[variable] = al.add(found[variable], x)


# composite inertia


def mass_matrix(frames: Frames, loads: Loads, variables: int) -> list[list[Scalar]]:
    """Mass matrix of the tree over all variables, symmetric, (variables, variables).

    By composite inertia: what a node carries moves as one body with it (Walker and Orin 1982).
    """
    tree = frames.tree
    M: list[list[Scalar]] = [[0.0] * variables for _ in range(variables)]
    composite = _composites(frames, loads)
    for node in tree.nodes[1:]:
        for variable, wrench in _unit_wrenches(frames, node, composite[node.index]):
            own: list[Scalar] = [0.0] * variables
            above: list[Scalar] = [0.0] * variables
            f, t = handed(frames, node, *wrench, own)
            for at in list(node.ancestors())[1:-1]:
                f, t = handed(frames, at, f, t, above)
            for k in range(variables):
                M[k][variable] = al.add(M[k][variable], al.add(own[k], above[k]))
                M[variable][k] = al.add(M[variable][k], above[k])
    for variable, rotor in loads.rotors.items():
        M[variable][variable] = al.add(M[variable][variable], rotor)
    for pair in loads.pairs:
        _add_pair(frames, pair, M)
    return M


def _add_pair(frames: Frames, pair: Pair, M: list[list[Scalar]]) -> None:
    """k (J_aᵀ J_b + J_bᵀ J_a), with the velocities of the points for unit rates."""
    variables, root = len(M), frames.tree.root
    columns = []
    for node, p in ((pair.a, pair.p_a), (pair.b, pair.p_b)):
        own: dict[int, Vector] = {}
        for k in sorted({v for n in node.ancestors() for v in n.variables}):
            motion = Motion(frames, np.eye(variables), {k: 1.0})
            v, axes = motion.point_velocity(node, p)
            own[k] = frames.turn(v, axes, root)
        columns.append(own)
    for i, v in columns[0].items():
        for k, w in columns[1].items():
            x = al.mul(pair.k, al.dot(v, w))
            M[i][k], M[k][i] = al.add(M[i][k], x), al.add(M[k][i], x)


def _composites(frames: Frames, loads: Loads) -> dict[int, Inertia]:
    """Inertia of each node with all that it carries, about its origin, in class axes."""
    found = {node.index: loads.of(node) for node in frames.tree.nodes}
    for index, body in loads.rotations.items():
        tensor = _turned(frames, body.tensor(frames), frames.tree.root, body.node.frame)
        found[index] = _joined(found[index], Inertia(tensor=tensor))
    for node in reversed(frames.tree.nodes[1:]):
        assert node.parent is not None
        above = found[node.parent.index]
        found[node.parent.index] = _joined(above, _carried(frames, node, found[node.index]))
    return found


def _joined(a: Inertia, b: Inertia) -> Inertia:
    tensor = tuple(al.plus(x, y) for x, y in zip(a.tensor, b.tensor, strict=True))
    return Inertia(al.add(a.mass, b.mass), al.plus(a.moment, b.moment), tensor)  # type: ignore[arg-type]


def _carried(frames: Frames, node: Node, body: Inertia) -> Inertia:
    """The inertia of a node about the origin and in the axes of its parent."""
    assert node.parent is not None
    above, d = node.parent.frame, frames.arm(node)
    s = frames.turn(body.moment, node.frame, above)
    tensor = _turned(frames, body.tensor, node.frame, above)
    change = _about(body.mass, s, d)
    rows = tuple(al.plus(x, y) for x, y in zip(tensor, change, strict=True))
    return Inertia(body.mass, al.plus(s, al.scale(body.mass, d)), rows)  # type: ignore[arg-type]


def _about(mass: Scalar, s: Vector, d: Vector) -> Matrix:
    """Change of a tensor from its origin to a point at -d: (2 d·s) 1 - d sᵀ - s dᵀ, and Steiner."""
    twice = al.mul(2.0, al.dot(d, s))
    own = shifted(mass, d)
    rows: list[list[Scalar]] = [[0.0] * 3 for _ in range(3)]
    for i in range(3):
        for k in range(i + 1):
            cross = al.add(al.mul(d[i], s[k]), al.mul(s[i], d[k]))
            x = al.add(own[i][k], al.sub(twice if i == k else 0.0, cross))
            rows[i][k] = rows[k][i] = x
    return tuple(map(tuple, rows))  # type: ignore[return-value]


def _turned(frames: Frames, tensor: Matrix, a: Node, b: Node) -> Matrix:
    """A symmetric tensor in the axes of another class."""
    half = al.transpose(tuple(frames.turn(row, a, b) for row in tensor))  # type: ignore[arg-type]
    rows = al.transpose(tuple(frames.turn(x, a, b) for x in half))  # type: ignore[arg-type]
    return tuple(tuple(rows[max(i, k)][min(i, k)] for k in range(3)) for i in range(3))  # type: ignore[return-value]


def _unit_wrenches(frames: Frames, node: Node, body: Inertia) -> list[tuple[int, Wrench]]:
    """For each variable of a node, what its unit acceleration needs, in class axes."""
    assert node.parent is not None
    above = node.parent.frame
    if node.kind == "slide":
        u = frames.turn(node.direction, above, node.frame)
        return [(node.variables[0], (al.scale(body.mass, u), al.cross(body.moment, u)))]
    if node.kind == "turn":
        return [(node.variables[0], _spun(node.unit, body))]
    if node.kind != "ball":
        return []
    axes: Sequence[Vector] = al.transpose(node.to_class if node.reversed else node.joint_axes)
    found = []
    for variable, axis in zip(node.variables, axes, strict=True):
        u = al.scale(node.factor, axis)
        if not node.reversed:
            u = frames.turn(u, above, node.frame)
        found.append((variable, _spun(u, body)))
    return found


def _spun(u: Vector, body: Inertia) -> Wrench:
    """f = u × s, t = J u."""
    return al.cross(u, body.moment), al.turn(body.tensor, u)
