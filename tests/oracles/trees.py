"""The spanning tree of a robot as another engine takes it: single motions, and coordinates.

Nothing of the library's kinematics is used: the tree and its frames are read from the description,
and what a joint does is said here once more.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gough.description.frames import transform
from gough.description.values import scalar, vector
from gough.robot import Robot
from gough.topology import Closing, Edge

Array = NDArray[np.float64]

SINGLE = {
    "revolute": ["rz"],
    "prismatic": ["z"],
    "cylindrical": ["rz", "z"],
    "universal": ["rx", "ry"],
    "spherical": ["ball"],
    "fixed": [],
}
"""The motions of a joint, from frame a to frame b."""


@dataclass(frozen=True)
class Motion:
    """One motion of a tree: about or along an axis, about a point, or free."""

    kind: str
    """x, y, z, rx, ry, rz, ball or free."""
    position: slice
    """Of the library's q."""
    rate: slice
    """Of the library's v."""
    sign: float
    """-1 where the tree passes the joint from b to a."""


@dataclass(frozen=True)
class Link:
    """A body of the tree, the motions that place it, and its inertia."""

    name: str
    parent: str
    T_parent_joint: Array
    """The joint's frame on the parent, (4, 4)."""
    T_joint_body: Array
    """The body in the joint's frame on it, (4, 4)."""
    motions: tuple[Motion, ...]
    mass: float
    com: Array
    """In body axes, (3,)."""
    inertia: Array
    """At the centre of mass in body axes, (3, 3)."""


@dataclass(frozen=True)
class Closed:
    """What closes a loop."""

    type: str
    bodies: tuple[str, str]
    T_body_frame: tuple[Array, Array]


class Tree:
    """The tree of a robot, depth first, and what closes its loops.

    Pinocchio takes as beyond a joint those that follow it in the list. In another order (all feet,
    then all slides) `constraintDynamics`, and `crba` of some robots, are wrong without a word.
    """

    def __init__(self, robot: Robot) -> None:
        self.robot, self.values = robot, robot.assembler.values
        structure = robot.structure
        self.root, links = structure.root, []
        q = v = 0
        for edge in structure.edges:
            links.append(self._link(edge, q, v))
            q, v = q + edge.type.coordinates, v + edge.type.freedoms
        self.links = list(_depth_first(links, self.root))
        self.positions, self.rates = q, v
        self.closings = [self._closed(part) for part in structure.closings]

    @property
    def motions(self) -> list[Motion]:
        return [motion for link in self.links for motion in link.motions]

    @property
    def gravity(self) -> Array:
        g = vector(self.robot.mechanism.gravity, self.values, 2, 3)
        return np.array([*g, 0.0][:3], dtype=float)

    def efforts(self, tau: Array) -> Array:
        """Efforts of the motors as forces along v."""
        forces = np.zeros(self.rates)
        forces[self.robot.structure.columns("actuated")] = tau
        return forces

    def random_position(self, rng: np.random.Generator) -> Array:
        """A configuration of the open tree."""
        q = rng.normal(size=self.positions)
        for motion in self.motions:
            if motion.kind in ("ball", "free"):
                part = slice(motion.position.stop - 4, motion.position.stop)
                q[part] /= np.linalg.norm(q[part])
        return q

    def _link(self, edge: Edge, q: int, v: int) -> Link:
        at = dict(zip(edge.bodies, (self._matrix(frame) for frame in edge.frames), strict=True))
        body = self.robot.structure.flat.bodies.get(edge.child)
        inertia = _inertia(vector(body.inertia, self.values, 3, 6)) if body else np.zeros((3, 3))
        com = [*vector(body.com, self.values, 2, 3), 0.0][:3] if body else [0.0] * 3
        return Link(
            edge.child,
            edge.parent,
            at[edge.parent],
            np.asarray(np.linalg.inv(at[edge.child]), dtype=float),
            tuple(_motions(edge, q, v)),
            float(scalar(body.mass, self.values)) if body else 0.0,
            np.array(com, dtype=float),
            inertia,
        )

    def _closed(self, part: Closing) -> Closed:
        a, b = part.frames
        return Closed(part.type, part.bodies, (self._matrix(a), self._matrix(b)))

    def _matrix(self, frame: Any) -> Array:
        R, p = transform(frame, self.values)
        return matrix(np.array(R, dtype=float), np.array(p, dtype=float))


def _depth_first(links: Sequence[Link], body: str) -> Iterator[Link]:
    """What hangs on a body, each link with all beyond it."""
    for link in links:
        if link.parent == body:
            yield link
            yield from _depth_first(links, link.name)


def matrix(R: Array, p: Array) -> Array:
    """A pose as (4, 4)."""
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = R, p
    return T


def _motions(edge: Edge, q: int, v: int) -> Iterable[Motion]:
    moves = getattr(edge.type, "moves", None)
    kinds = SINGLE[edge.type.name] if moves is None else list(moves)
    if moves is not None and len(moves) == 6:
        kinds = ["free"]
    found = []
    for kind in kinds:
        n, m = {"ball": (4, 3), "free": (7, 6)}.get(kind, (1, 1))
        sign = -1.0 if edge.reversed else 1.0
        found.append(Motion(kind, slice(q, q + n), slice(v, v + m), sign))
        q, v = q + n, v + m
    return found[::-1] if edge.reversed else found


def _inertia(given: Sequence[Any]) -> Array:
    xx, yy, zz, xy, xz, yz = (float(x) for x in (*given, 0.0, 0.0, 0.0)[:6])
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


# coordinates of an engine


def rotation(wxyz: Array) -> Array:
    """R of a unit quaternion, (3, 3)."""
    w, r = wxyz[0], wxyz[1:]
    return np.asarray(np.eye(3) + 2 * w * skew(r) + 2 * skew(r) @ skew(r))


def skew(r: Array) -> Array:
    x, y, z = r
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


@dataclass(frozen=True)
class Engine:
    """How an engine numbers a tree, and what its coordinates mean.

    Both engines here give the angular velocity of balls and free bodies in the body's own axes.
    """

    sizes: tuple[int, int]
    """Of its positions and of its rates."""
    places: tuple[tuple[int, int], ...]
    """Where each motion stands in its positions and rates."""
    scalar_last: bool
    """Whether its quaternions are (x, y, z, w)."""
    linear_in_body: bool
    """Whether a free body's velocity is in the body's own axes."""


@dataclass(frozen=True)
class Moving:
    """A state in an engine's coordinates."""

    q: Array
    v: Array
    a: Array
    S: Array
    """v = S (rates of the library)."""


def moving(tree: Tree, engine: Engine, q: Array, v: Array, vd: Array) -> Moving:
    """Positions, rates and accelerations of the library in an engine's coordinates."""
    n, m = engine.sizes
    state = Moving(np.zeros(n), np.zeros(m), np.zeros(m), np.zeros((m, tree.rates)))
    for motion, place in zip(tree.motions, engine.places, strict=True):
        position, S, turning = _moved(motion, engine, q[motion.position], v[motion.rate])
        at = slice(place[1], place[1] + len(S))
        state.q[place[0] : place[0] + len(position)] = position
        state.v[at], state.S[at, motion.rate] = S @ v[motion.rate], S
        state.a[at] = S @ (vd[motion.rate] + turning)
    return state


def _moved(motion: Motion, engine: Engine, q: Array, v: Array) -> tuple[Array, Array, Array]:
    """Position, S, and S⁻¹ Ṡ v: with v' = S v is v̇' = S (v̇ + S⁻¹ Ṡ v)."""
    still = np.zeros(len(v))
    if motion.kind not in ("ball", "free"):
        return motion.sign * q, np.array([[motion.sign]]), still
    wxyz, R = q[-4:], rotation(q[-4:])
    if motion.sign < 0:
        assert motion.kind == "ball"
        # b sees a turn with -ω, and the library's axes are those of a
        return _quaternion(wxyz * [1, -1, -1, -1], engine), -np.eye(3), still
    if motion.kind == "ball":
        return _quaternion(wxyz, engine), R.T, still
    S = np.zeros((6, 6))
    S[:3, :3] = R.T if engine.linear_in_body else np.eye(3)
    S[3:, 3:] = R.T
    if engine.linear_in_body:
        still[:3] = -np.cross(v[3:], v[:3])
    return np.concatenate([q[:3], _quaternion(wxyz, engine)]), S, still


def _quaternion(wxyz: Array, engine: Engine) -> Array:
    return wxyz[[1, 2, 3, 0]] if engine.scalar_last else wxyz
