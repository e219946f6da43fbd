"""Dynamics of rigid bodies in maximal coordinates: slow, plain, and independent of the library.

Every body but a fixed base has six rates w, its twist (velocity of its origin, angular velocity;
root axes). Every joint, constraint and coupling is rows φ = 0 on the poses of the bodies, with
J w = 0 and J a = -b, where b is φ̈ for a = 0. With the Newton-Euler equations W a + Jᵀ λ = f,
Z a basis of the motions J leaves, and a0 the least solution of J a = -b,

    a = a0 + Z (Zᵀ W Z)⁻¹ Zᵀ (f - W a0)

holds whatever rows are redundant. J and b come from jets (value, first and second derivative by
time) of points and axes fixed in bodies, so nothing is a finite difference. Only poses and twists
of the bodies, and the names of the variables, are taken from the library.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gough.algebra import Transform
from gough.description.frames import transform
from gough.description.parts import Coupling, Frame
from gough.description.values import scalar, vector
from gough.joints.free import POSE, Free
from gough.robot import Robot

Array = NDArray[np.float64]

RANK = 1e-9
"""Singular values of the scaled J below this part of the largest count as zero."""
INERT = 1e-13
"""A motion whose inertia is below this part of the largest has none."""
CONTRADICTION = 1e-7
"""Part of the rates by which they may break the rows, and part of b that may stay unsolved."""

HOLDS: dict[str, tuple[str, ...]] = {
    "revolute": ("point", "axis"),
    "prismatic": ("line", "orientation"),
    "helical": ("line", "axis", "advance"),
    "cylindrical": ("line", "axis"),
    "universal": ("point", "crossed"),
    "spherical": ("point",),
    "planar": ("level", "axis"),
    "parallelogram": ("circle", "level", "orientation"),
    "free": ("held shifts", "held turns"),
    "fixed": ("point", "orientation"),
    "points-coincide": ("point",),
    "directions-parallel": ("axis",),
    "frames-coincide": ("point", "orientation"),
    "in-plane": ("level", "axis"),
}
"""What each type of link says of its frames a and b."""


# jets


@dataclass(frozen=True)
class Jet:
    """A number or a vector with its derivatives by time; batches of motions stand first."""

    x: Array
    """() or (3,)."""
    d: Array
    """(*batch,) or (*batch, 3)."""
    dd: Array

    def __add__(self, other: Jet) -> Jet:
        return Jet(self.x + other.x, self.d + other.d, self.dd + other.dd)

    def __sub__(self, other: Jet) -> Jet:
        return self + other.scaled(-1.0)

    def __matmul__(self, other: Jet) -> Jet:
        """Product of two vectors."""
        d = self.d @ other.x + other.d @ self.x
        twice = 2 * np.sum(self.d * other.d, axis=-1)
        return Jet(self.x @ other.x, d, self.dd @ other.x + twice + other.dd @ self.x)

    def scaled(self, factor: float) -> Jet:
        return Jet(factor * self.x, factor * self.d, factor * self.dd)


def angle(s: Jet, c: Jet) -> Jet:
    """The angle of the vector (c, s): θ' = n / r², n = c s' - s c', r² = c² + s²."""
    n, dn = c.x * s.d - s.x * c.d, c.x * s.dd - s.x * c.dd
    r2, dr2 = c.x**2 + s.x**2, 2 * (c.x * c.d + s.x * s.d)
    return Jet(np.arctan2(s.x, c.x), n / r2, dn / r2 - n * dr2 / r2**2)


@dataclass(frozen=True)
class Placed:
    """A frame that moves with a body, in root axes."""

    origin: Jet
    axes: tuple[Jet, Jet, Jet]


def placed(T_root_body: Array, twist: Array, acceleration: Array, T_body_frame: Array) -> Placed:
    """A frame of a body that moves with a twist and an acceleration, (*batch, 6), root axes.

    A vector r fixed in the body has r' = ω×r and r'' = α×r + ω×(ω×r).
    """
    R, p = T_root_body[:3, :3], T_root_body[:3, 3]
    omega, alpha = twist[..., 3:], acceleration[..., 3:]

    def fixed(r: Array) -> Jet:
        turning = np.cross(omega, r)
        return Jet(r, turning, np.cross(alpha, r) + np.cross(omega, turning))

    arm = fixed(R @ T_body_frame[:3, 3])
    origin = Jet(p + arm.x, twist[..., :3] + arm.d, acceleration[..., :3] + arm.dd)
    x, y, z = (fixed(R @ T_body_frame[:3, k]) for k in range(3))
    return Placed(origin, (x, y, z))


# links


@dataclass(frozen=True)
class Link:
    """A joint, a constraint, or what holds a free link that does not move in all ways."""

    name: str
    type: str
    bodies: tuple[str, str]
    T_body_frame: tuple[Array, Array]
    dimensions: Mapping[str, float]
    moves: tuple[str, ...] = POSE
    """The freedoms of a link of type free."""


def rows(link: Link, a: Placed, b: Placed, length: float) -> list[Jet]:
    """The rows that hold the frames of a link, lengths divided by a length."""
    return [row for hold in HOLDS[link.type] for row in _held(hold, link, a, b, length)]


def _held(hold: str, link: Link, a: Placed, b: Placed, length: float) -> list[Jet]:
    (x, y, z), across = a.axes, b.origin - a.origin
    match hold:
        case "axis":
            return [x @ b.axes[2], y @ b.axes[2]]
        case "crossed":
            return [x @ b.axes[1]]
        case "orientation":
            return [x @ b.axes[2], y @ b.axes[2], x @ b.axes[1]]
        case "held turns":
            return _held_turns(link.moves, a, b)
        case "point" | "line":
            found = [axis @ across for axis in (a.axes if hold == "point" else (x, y))]
        case "level":
            found = [z @ across]
        case "held shifts":
            found = [
                axis @ across for axis, k in zip(a.axes, "xyz", strict=True) if k not in link.moves
            ]
        case "circle":
            found = [(across @ across).scaled(0.5 / link.dimensions["length"])]
        case "advance":
            lead = link.dimensions["pitch"] / (2 * np.pi)
            found = [z @ across - turned(a, b, 2).scaled(lead)]
        case _:
            raise KeyError(hold)
    return [row.scaled(1 / length) for row in found]


def _held_turns(moves: tuple[str, ...], a: Placed, b: Placed) -> list[Jet]:
    """Rows that keep a body from the rotations it has not: it has none, one or all."""
    free = [k for k, move in enumerate(("rx", "ry", "rz")) if move in moves]
    if len(free) == 3:
        return []
    if not free:
        return [a.axes[0] @ b.axes[2], a.axes[1] @ b.axes[2], a.axes[0] @ b.axes[1]]
    return [a.axes[i] @ b.axes[free[0]] for i in range(3) if i != free[0]]


# rates of the joint variables


def turned(a: Placed, b: Placed, k: int) -> Jet:
    """The angle of b about axis k of a, which they share."""
    i, j = (k + 1) % 3, (k + 2) % 3
    return angle(a.axes[j] @ b.axes[i], a.axes[i] @ b.axes[i])


def spin(a: Placed, b: Placed) -> list[Jet]:
    """Angular velocity of b relative to a in axes of a; the values have no meaning.

    With R = R_aᵀ R_b it is the axial vector of R' Rᵀ, and its derivative that of R'' Rᵀ.
    """
    R = [[p @ q for q in b.axes] for p in a.axes]
    found = []
    for i, j in ((2, 1), (0, 2), (1, 0)):
        pairs = list(zip(R[i], R[j], strict=True))
        d = sum(0.5 * (p.d * q.x - q.d * p.x) for p, q in pairs)
        dd = sum(0.5 * (p.dd * q.x - q.dd * p.x) for p, q in pairs)
        found.append(Jet(np.zeros(()), np.asarray(d), np.asarray(dd)))
    return found


def variables(link: Link, a: Placed, b: Placed) -> list[Jet]:
    """The variables of a joint, whose derivatives are its rates and accelerations."""
    (x, y, z), across = a.axes, b.origin - a.origin
    match link.type:
        case "fixed":
            return []
        case "revolute" | "helical":
            return [turned(a, b, 2)]
        case "prismatic":
            return [z @ across]
        case "cylindrical":
            return [turned(a, b, 2), z @ across]
        case "universal":
            first = angle(z @ b.axes[1], y @ b.axes[1])
            return [first, angle(x @ b.axes[2], x @ b.axes[0])]
        case "spherical":
            return spin(a, b)
        case "planar":
            return [x @ across, y @ across, turned(a, b, 2)]
        case "parallelogram":
            return [angle(y @ across, x @ across)]
        case "free":
            shifts = [a.axes["xyz".index(k)] @ across for k in link.moves if k in "xyz"]
            turns = [("rx", "ry", "rz").index(k) for k in link.moves if k not in "xyz"]
            return shifts + (spin(a, b) if len(turns) == 3 else [turned(a, b, k) for k in turns])
    raise KeyError(link.type)


# the mechanism


@dataclass(frozen=True)
class State:
    """Poses and twists of all bodies, the root among them."""

    T_root: Mapping[str, Array]
    twists: Mapping[str, Array]


@dataclass(frozen=True)
class Inertia:
    """Mass, and centre of mass and inertia at it in body axes."""

    mass: float
    com: Array
    moments: Array


@dataclass(frozen=True)
class System:
    """The rows J a = -b of one state by their singular values, in scaled rates."""

    J: Array
    b: Array
    gap: float
    """Largest entry of J w, as a part of the largest scaled rate."""
    Z: Array
    """Orthonormal basis of the motions that the rows leave."""
    least: Array
    """The least scaled accelerations that obey the rows."""


class Maximal:
    """One mechanism in maximal coordinates, with the live parameters of a robot.

    Attributes:
        bodies: the bodies that move, each with six rates, in order.
        links: joints, constraints, held free links and, in planar motion, each body's plane.
        length: what lengths are divided by, m.
    """

    def __init__(self, robot: Robot) -> None:
        self.robot = robot
        self.values = robot.assembler.values
        self.length = robot.assembler.length
        flat, self.root = robot.structure.flat, robot.structure.root
        self.base = robot.structure.mechanism.base
        base = [self.base] if robot.structure.mechanism.floating else []
        self.bodies = [*base, *(body for body in flat.bodies if body != self.base)]
        self.inertias = {body: self._inertia(body) for body in self.bodies}
        self.joints = {
            name: self._link(name, joint.type, joint.bodies, joint.frames, joint.dimensions)
            for name, joint in flat.joints.items()
        }
        self.links = [*self.joints.values(), *self._other_links()]
        self.tree = [self._tree_link(k) for k in range(len(robot.structure.edges))]
        self.scale = np.tile(np.repeat([self.length, 1.0], 3), len(self.bodies))

    # what the description says

    @property
    def rotors(self) -> dict[str, float]:
        """ratio² · inertia of every motor with a rotor, inertia/radius² of reels, by joint."""
        found = {}
        for name, joint in self.robot.structure.flat.joints.items():
            if joint.motor is not None:
                ratio, inertia = (
                    float(scalar(x, self.robot.assembler.values))
                    for x in (joint.motor.ratio, joint.motor.inertia)
                )
                found[name] = ratio**2 * inertia
            for actuator in joint.actuators.values():
                if actuator.law == "reel":
                    inertia, radius = (
                        float(scalar(actuator.numbers[x], self.robot.assembler.values))
                        for x in ("inertia", "radius")
                    )
                    found[name] = found.get(name, 0.0) + inertia / radius**2
        return found

    def _inertia(self, body: str) -> Inertia:
        part = self.robot.structure.flat.bodies.get(body)
        if part is None:
            return Inertia(0.0, np.zeros(3), np.zeros((3, 3)))
        given = vector(part.inertia, self.values, 3, 6)
        xx, yy, zz, xy, xz, yz = (float(x) for x in (*given, 0.0, 0.0, 0.0)[:6])
        moments = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        return Inertia(float(scalar(part.mass, self.values)), self._vector(part.com), moments)

    def _vector(self, given: object) -> Array:
        """Three numbers; in the plane z may be missing."""
        return np.array([*vector(given, self.values, 2, 3), 0.0][:3], dtype=float)

    def _link(
        self,
        name: str,
        kind: str,
        bodies: tuple[str, str],
        frames: Iterable[Frame],
        dimensions: Mapping[str, Any] | None = None,
        moves: tuple[str, ...] = POSE,
    ) -> Link:
        T_a, T_b = (_matrix(transform(frame, self.values)) for frame in frames)
        numbers = {
            key: float(scalar(value, self.values)) for key, value in (dimensions or {}).items()
        }
        return Link(name, kind, bodies, (T_a, T_b), numbers, moves)

    def _other_links(self) -> list[Link]:
        """Constraints, free links with some freedoms only, and the plane of planar motion."""
        flat, here = self.robot.structure.flat, (np.eye(4), np.eye(4))
        found = [
            self._link(name, part.type, part.bodies, part.frames)
            for name, part in flat.constraints.items()
        ]
        for body, part in flat.bodies.items():
            if part.free:
                found.append(Link(body, "free", (self.base, body), here, {}, part.free))
        if self.robot.mechanism.motion == "planar":
            found += [Link(body, "in-plane", (self.root, body), here, {}) for body in self.bodies]
        return found

    def _tree_link(self, k: int) -> Link:
        """A joint of the library's tree; pieces of a cut platform are the platform."""
        edge = self.robot.structure.edges[k]
        a, b = (_whole(body) for body in edge.bodies)
        moves = edge.type.moves if isinstance(edge.type, Free) else POSE
        return self._link(
            edge.name, edge.type.name, (a, b), edge.frames, edge.dimensions, tuple(moves)
        )

    # one state

    def state(self, q: ArrayLike, v: ArrayLike) -> State:
        """Poses and twists of all bodies at a configuration with the rates of all variables."""
        q, v = np.asarray(q, dtype=float), np.asarray(v, dtype=float)
        models, p = self.robot.models, self.robot.assembler.p
        names = self.robot.structure.bodies
        poses = dict(zip(names, models.poses(q, p), strict=True))
        twists = {body: models.body_jacobian(body)(q, p) @ v for body in self.bodies}
        return State(poses | {self.root: np.eye(4)}, twists | {self.root: np.zeros(6)})

    def _expanded(
        self, state: State, link: Link, jets: Callable[[Placed, Placed], Sequence[Jet]]
    ) -> tuple[Array, Array]:
        """Of numbers that frames of a link give: gradient by w, and second derivative for a = 0.

        Twelve unit twists, six of either body, and the twists of the state are one batch.
        """
        frames = []
        for k, (body, T) in enumerate(zip(link.bodies, link.T_body_frame, strict=True)):
            batch = np.zeros((13, 6))
            batch[6 * k : 6 * k + 6] = np.eye(6)
            batch[12] = state.twists[body]
            frames.append(placed(state.T_root[body], batch, np.zeros((13, 6)), T))
        found = jets(*frames)
        gradient = np.zeros((len(found), 6 * len(self.bodies)))
        bias = np.array([jet.dd[12] for jet in found])
        for k, body in enumerate(link.bodies):
            if body != self.root:
                for row, jet in zip(gradient, found, strict=True):
                    row[self._columns(body)] += jet.d[6 * k : 6 * k + 6]
        return gradient, bias

    def _columns(self, body: str) -> slice:
        k = 6 * self.bodies.index(body)
        return slice(k, k + 6)

    def _stacked(self, per_body: Mapping[str, Array]) -> Array:
        return np.concatenate([per_body[body] for body in self.bodies])

    def _constraints(self, state: State) -> tuple[Array, Array]:
        """J by scaled rates, and b, of all links and couplings."""
        couplings = self.robot.structure.flat.couplings.values()
        blocks = [self._rows(state, link) for link in self.links]
        blocks += [self._coupling(state, coupling) for coupling in couplings]
        J = np.vstack([np.zeros((0, 6 * len(self.bodies))), *(block[0] for block in blocks)])
        return J * self.scale, np.concatenate([np.zeros(0), *(block[1] for block in blocks)])

    def _rows(self, state: State, link: Link) -> tuple[Array, Array]:
        return self._expanded(state, link, lambda a, b: rows(link, a, b, self.length))

    def _coupling(self, state: State, coupling: Coupling) -> tuple[Array, Array]:
        """The row Σ factor × variable, brought to norm one since its unit may be any."""
        gradient, bias = np.zeros((1, 6 * len(self.bodies))), np.zeros(1)
        for name, term in coupling.terms.items():
            factor = float(scalar(term, self.values))
            row, second = self._joint_variables(state, name)
            gradient, bias = gradient + factor * row, bias + factor * second
        size = float(np.linalg.norm(gradient * self.scale)) or 1.0
        return gradient / size, bias / size

    def _joint_variables(self, state: State, joint: str) -> tuple[Array, Array]:
        link = self.joints[joint]
        return self._expanded(state, link, lambda a, b: variables(link, a, b))

    def system(self, q: ArrayLike, v: ArrayLike) -> System:
        """The constraints at a closed configuration, with rates that obey the closure.

        Raises:
            ArithmeticError: no accelerations obey the rows, as may be at a singularity.
        """
        state = self.state(q, v)
        J, b = self._constraints(state)
        w = self._stacked(state.twists) / self.scale
        gap = float(np.max(np.abs(J @ w), initial=0.0)) / (float(np.max(np.abs(w))) or 1.0)
        U, s, Vt = np.linalg.svd(J)
        rank = int(np.sum(s > RANK * s[0])) if s.size else 0
        least = -Vt[:rank].T @ ((U[:, :rank].T @ b) / s[:rank])
        lost = float(np.max(np.abs(J @ least + b), initial=0.0))
        if gap > CONTRADICTION or lost > CONTRADICTION * max(np.max(np.abs(b), initial=0.0), 1e-3):
            raise ArithmeticError(f"the rows contradict: rates by {gap:.1e}, second by {lost:.1e}")
        return System(J, b, gap, Vt[rank:].T, least)

    # forces

    def _equations(
        self,
        state: State,
        efforts: Mapping[str, ArrayLike],
        gravity: ArrayLike | None,
        wrenches: Mapping[str, ArrayLike] | None,
    ) -> tuple[Array, Array]:
        """W and f of the Newton-Euler equations W a = f, without the forces of the rows."""
        g = self._vector(self.robot.mechanism.gravity) if gravity is None else np.asarray(gravity)
        n = 6 * len(self.bodies)
        W, f = np.zeros((n, n)), np.zeros(n)
        for body in self.bodies:
            k = self._columns(body)
            W[k, k], f[k] = newton_euler(
                self.inertias[body], state.T_root[body], state.twists[body], g
            )
        for body, wrench in (wrenches or {}).items():
            if body != self.root:
                f[self._columns(body)] += np.asarray(wrench, dtype=float)
        for joint, effort in efforts.items():
            gradient, _ = self._joint_variables(state, joint)
            f += gradient.T @ np.atleast_1d(np.asarray(effort, dtype=float))
        for joint, inertia in self.rotors.items():
            gradient, bias = self._joint_variables(state, joint)
            W += inertia * gradient.T @ gradient
            f -= inertia * gradient.T @ bias
        return W, f

    def accelerations(
        self,
        q: ArrayLike,
        v: ArrayLike,
        efforts: Mapping[str, ArrayLike],
        gravity: ArrayLike | None = None,
        wrenches: Mapping[str, ArrayLike] | None = None,
    ) -> dict[str, Array]:
        """Acceleration of every body that moves: (linear of its origin, angular), root axes.

        Args:
            q: closed configuration, (positions,).
            v: rates of all variables, which obey the closure, (variables,).
            efforts: of the motors by joint, N or N m; positive ones do positive work on positive
                rates of the joint. A joint of several freedoms takes several.
            gravity: root axes, m/s²; the mechanism's by default.
            wrenches: (force, moment about its origin) on bodies, root axes.

        Raises:
            ArithmeticError: the rows contradict, or a motion has no inertia.
        """
        system = self.system(q, v)
        W, f = self._equations(self.state(q, v), efforts, gravity, wrenches)
        W, f = self.scale[:, None] * W * self.scale, self.scale * f
        Z, inertia = system.Z, system.Z.T @ W @ system.Z
        _require_inertia(inertia)
        z = np.linalg.solve(inertia, Z.T @ (f - W @ system.least))
        a = self.scale * (system.least + Z @ z)
        return {body: a[self._columns(body)] for body in self.bodies}

    def tree_accelerations(
        self,
        q: ArrayLike,
        v: ArrayLike,
        efforts: Mapping[str, ArrayLike],
        gravity: ArrayLike | None = None,
        wrenches: Mapping[str, ArrayLike] | None = None,
    ) -> Array:
        """Accelerations v̇ of all variables of the tree, (variables,), as for `accelerations`."""
        return self.of_tree(q, v, self.accelerations(q, v, efforts, gravity, wrenches))[1]

    def of_tree(
        self, q: ArrayLike, v: ArrayLike, accelerations: Mapping[str, Array]
    ) -> tuple[Array, Array]:
        """Rates and accelerations of the tree's variables that the motion of the bodies means.

        The rates are those given, found again from the twists of the bodies.
        """
        state = self.state(q, v)
        a = {**accelerations, self.root: np.zeros(6)}
        rates, second = [], []
        for link in self.tree:
            frames = [
                placed(state.T_root[body], state.twists[body], a[body], T)
                for body, T in zip(link.bodies, link.T_body_frame, strict=True)
            ]
            found = variables(link, *frames)
            rates += [float(jet.d) for jet in found]
            second += [float(jet.dd) for jet in found]
        return np.array(rates), np.array(second)

    def reactions(
        self,
        q: ArrayLike,
        v: ArrayLike,
        efforts: Mapping[str, ArrayLike],
        gravity: ArrayLike | None = None,
        wrenches: Mapping[str, ArrayLike] | None = None,
    ) -> dict[str, Array]:
        """Wrench that every joint puts on its second body, without the motor's part.

        (force, moment about the origin of the joint's frame on that body), root axes. Where rows
        are redundant these are the reactions of the least multipliers, and not the only ones.
        """
        system, state = self.system(q, v), self.state(q, v)
        a = self._stacked(self.accelerations(q, v, efforts, gravity, wrenches))
        W, f = self._equations(state, efforts, gravity, wrenches)
        multipliers = np.linalg.lstsq(system.J.T, self.scale * (W @ a - f), rcond=RANK)[0]
        found, start = {}, 0
        for name, link in self.joints.items():
            gradient, _ = self._rows(state, link)
            own = multipliers[start : start + len(gradient)]
            start += len(gradient)
            found[name] = self._on_second(state, link, gradient.T @ own)
        return found

    def _on_second(self, state: State, link: Link, forces: Array) -> Array:
        """The wrench on the second body of a link, at its frame, from forces on all bodies."""
        a, b = link.bodies
        body, sign = (a, -1.0) if b == self.root else (b, 1.0)
        wrench = sign * forces[self._columns(body)]
        at = (state.T_root[b] @ link.T_body_frame[1])[:3, 3] - state.T_root[body][:3, 3]
        return np.concatenate([wrench[:3], wrench[3:] - np.cross(at, wrench[:3])])

    def energy_rate(
        self,
        q: ArrayLike,
        v: ArrayLike,
        accelerations: Mapping[str, Array],
        gravity: ArrayLike | None = None,
    ) -> tuple[float, float]:
        """d/dt of kinetic plus potential energy, watts, and the sum of the sizes of its parts."""
        state = self.state(q, v)
        W, f = self._equations(state, {}, gravity, None)
        w, a = self._stacked(state.twists), self._stacked(accelerations)
        parts = w * (W @ a - f)
        return float(parts.sum()), float(np.abs(w * (W @ a)).sum() + np.abs(w * f).sum())


def newton_euler(
    inertia: Inertia, T_root_body: Array, twist: Array, gravity: Array
) -> tuple[Array, Array]:
    """W and f of one body about its origin: W a = f with the weight and the gyroscopic part.

    With c from the origin to the centre of mass, and a, α the accelerations:

        force  = m (a + α×c + ω×(ω×c) - g)
        moment = c × force + I α + ω × I ω
    """
    R, omega, m = T_root_body[:3, :3], twist[3:], inertia.mass
    c, moments = R @ inertia.com, R @ inertia.moments @ R.T
    C = np.array([[0, -c[2], c[1]], [c[2], 0, -c[0]], [-c[1], c[0], 0]])
    W = np.block([[m * np.eye(3), -m * C], [m * C, moments - m * C @ C]])
    force = m * (gravity - np.cross(omega, np.cross(omega, c)))
    moment = np.cross(c, force) - np.cross(omega, moments @ omega)
    return W, np.concatenate([force, moment])


def _require_inertia(inertia: Array) -> None:
    spread = np.linalg.eigvalsh(inertia)
    if spread.size and spread[0] <= INERT * spread[-1]:
        raise ArithmeticError(f"a motion has no inertia: {spread[0]:.1e} of {spread[-1]:.1e}")


def _matrix(T: Transform) -> Array:
    """A transform of numbers as a 4×4 matrix."""
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = T
    return matrix


def _whole(body: str) -> str:
    """The body that a name of the tree means; a piece is ``platform@joint``."""
    return body.partition("@")[0]
