"""Forces that joints and constraints transmit, from the Newton-Euler equations of all bodies.

The wrench W that a joint exerts on its second body obeys Sᵀ W = e, with S the twists that the
joint allows and e the efforts on its freedoms; what else it transmits is unknown. With X that
carries a wrench to the origin of a body, each body asks for

    Σ ± X W = what moves it - its weight - given wrenches

Where joints repeat each other these equations leave some components open: those are told, and have
the values of the least solution. In planar motion the plane holds every body too, so that all
components across the plane are open.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi
import numpy as np
from numpy.typing import ArrayLike, NDArray

from gough.algebra import Transform
from gough.description.frames import transform
from gough.description.parts import Body, Frame
from gough.description.values import scalar, vector
from gough.dynamics.dynamics import Dynamics, Wrench
from gough.dynamics.model import Space
from gough.dynamics.rotors import rotors_of
from gough.errors import ConfigurationError, UnknownName
from gough.joints import TYPES, Free, JointType
from gough.joints.base import Twist
from gough.joints.quaternion import wxyz_from_rotation
from gough.kernels import Kernel
from gough.symbolic.trees.rotations import rotation_vector, short_rotation

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
SX = casadi.SX

RANK = 1e-9
"""Singular values below this part of the largest count as zero."""
UNIQUE = 1e-9
"""Change of a component by a unit change of what is open, below which it is not open itself."""
BALANCED = 1e-7
"""Part of the forces by which bodies may miss their balance; a guess, far above rounding."""
ROUNDING = 1e-12
"""Part of the largest number of a table below which it shows 0."""
COMPONENTS = ("fx", "fy", "fz", "mx", "my", "mz")


@dataclass(frozen=True)
class Reactions:
    """What every joint and constraint transmits in one state."""

    joints: tuple[str, ...]
    """Joints, constraints, and free bodies that do not move in all ways, by name."""
    bodies: tuple[tuple[str, str], ...]
    """The two bodies of each."""
    wrench: Array
    """(force, moment about the origin of frame b) on the second body, with the motor's effort and
    without what the inertia of its rotor takes; base axes, N and N m, (joints, 6). The first body
    gets the opposite at the same point."""
    unique: Mask
    """Which components the motion determines, (joints, 6); others are those of the least wrenches,
    moments divided by the characteristic length."""
    efforts: Array
    """Of the motors, (motors,), N and N m."""
    motors: tuple[str, ...]

    def of(self, joint: str) -> Array:
        """The wrench of one joint or constraint, (6,).

        Raises:
            UnknownName: there is none of that name.
        """
        return np.asarray(self.wrench[self._row(joint)])

    def is_unique(self, joint: str) -> Mask:
        """Which components of its wrench the motion determines, (6,)."""
        return np.asarray(self.unique[self._row(joint)])

    def _row(self, joint: str) -> int:
        if joint not in self.joints:
            raise UnknownName("joint", joint, self.joints)
        return self.joints.index(joint)

    @property
    def determined(self) -> bool:
        """Whether every component is determined."""
        return bool(self.unique.all())

    def as_dict(self) -> dict[str, Any]:
        """The content as plain data."""
        return {
            "joints": list(self.joints),
            "bodies": [list(pair) for pair in self.bodies],
            "wrench": self.wrench.tolist(),
            "unique": self.unique.tolist(),
            "motors": list(self.motors),
            "efforts": self.efforts.tolist(),
        }

    def __str__(self) -> str:
        width = max(5, *(len(name) for name in self.joints)) if self.joints else 5
        lines = [" " * width + "".join(f" {name:>12}" for name in COMPONENTS) + "  on"]
        small = np.abs(self.wrench) < ROUNDING * np.abs(self.wrench).max(initial=0.0)
        shown = np.where(small, 0.0, self.wrench)
        for name, pair, row, known in zip(
            self.joints, self.bodies, shown, self.unique, strict=True
        ):
            cells = (f"{x:11.4g}{' ' if k else '?'}" for x, k in zip(row, known, strict=True))
            lines.append(f"{name:{width}} " + " ".join(cells) + f"  {pair[1]}")
        if not self.determined:
            lines.append("? is not determined by the motion: the least forces, moments by length")
        return "\n".join(lines)


@dataclass(frozen=True)
class _Hold:
    """A joint, a constraint, what holds a free body, or the plane of planar motion."""

    name: str
    kind: JointType | str
    bodies: tuple[str, str]
    T_body_frame: tuple[Array, Array]
    dimensions: Mapping[str, float]
    variables: tuple[int, ...] = ()
    """Motors of its freedoms, by their place among the efforts."""
    rotors: tuple[tuple[int, int, float], ...] = ()
    """Freedom, variable and inertia that it feels, of those with rotors or reels."""
    reported: bool = True


@dataclass(frozen=True)
class _Placed:
    """A hold in one state; scaled wrenches (force, moment / length) at the origin of frame b."""

    hold: _Hold
    origin: Array
    N: Array
    """Orthonormal basis of what it transmits without work, (6, components)."""
    along: Array
    """Least wrenches for a unit effort on each freedom, (6, freedoms)."""


@dataclass(frozen=True)
class _State:
    """One state of all bodies, root axes."""

    poses: Mapping[str, Array]
    twists: Mapping[str, Array]
    accelerations: Mapping[str, Array]
    vd: Array
    efforts: Array


class JointForces:
    """Reactions of one mechanism; what does not depend on the state is made once.

    Args:
        dynamics: the mechanism's.
    """

    def __init__(self, dynamics: Dynamics) -> None:
        self.dynamics = dynamics
        self.structure, self.assembler = dynamics.structure, dynamics.assembler
        self.length = self.assembler.length
        mechanism = self.structure.mechanism
        fixed = () if mechanism.floating else (mechanism.base,)
        self.bodies = tuple(body for body in self.structure.bodies if body in self._described)
        self.bodies = tuple(body for body in self.bodies if body not in fixed)
        self.holds = tuple(self._holds())

    @property
    def _described(self) -> Mapping[str, Body]:
        base = self.structure.mechanism.base
        return {base: Body(), **self.structure.flat.bodies}

    # what the description says

    def _holds(self) -> Iterator[_Hold]:
        mechanism, flat = self.structure.mechanism, self.structure.flat
        for name in flat.joints:
            yield self._joint(name)
        for name, part in flat.constraints.items():
            yield _Hold(name, part.type, part.bodies, self._frames(part.frames), {})
        here = (np.eye(4), np.eye(4))
        for body, described in flat.bodies.items():
            if described.free:
                name = f"{body} (free)" if body in flat.joints | flat.constraints else body
                yield _Hold(name, Free(described.free), (mechanism.base, body), here, {})
        if mechanism.motion == "planar":
            for body in self.bodies:
                pair = (self.structure.root, body)
                yield _Hold(body, "plane", pair, here, {}, reported=False)

    def _joint(self, name: str) -> _Hold:
        joint, values = self.structure.flat.joints[name], self.assembler.values
        edges, variables = self.structure.edges, self.structure.variables
        edge = next((k for k, e in enumerate(edges) if e.name == name and not e.link), None)
        own = [k for k, v in enumerate(variables) if edge is not None and v.edge == edge]
        motors = self.structure.columns("actuated")
        felt = rotors_of(joint, values)
        return _Hold(
            name,
            TYPES[joint.type],
            joint.bodies,
            self._frames(joint.frames),
            {key: float(scalar(x, values)) for key, x in joint.dimensions.items()},
            tuple(motors.index(k) for k in own if k in motors),
            tuple((k, own[k], float(x)) for k, x in felt.items() if own),
        )

    def _frames(self, frames: Iterable[Frame]) -> tuple[Array, Array]:
        a, b = (_matrix(transform(frame, self.assembler.values)) for frame in frames)
        return a, b

    # one state

    @cached_property
    def _body_motions(self) -> Kernel:
        """Twist and acceleration of every body, (bodies, 12): J v, J v̇ + J̇ v, root axes."""
        closure = self.dynamics.models.closure
        count = len(self.structure.variables)
        v, vd = SX.sym("v", count), SX.sym("vd", count)
        flow, rows = closure.position_rates @ v, []
        for body in self.bodies:
            J = closure.body_jacobian(body)
            twist = J @ v
            rows += [twist, J @ vd + casadi.jtimes(twist, closure.q, flow)]
        inputs = {"q": closure.q, "p": closure.p, "v": v, "vd": vd}
        return Kernel("body_motions", inputs, casadi.vertcat(*rows), (len(self.bodies), 12))

    def _state(self, q: Array, v: Array, vd: Array, efforts: Array) -> _State:
        models, p, root = self.dynamics.models, self.assembler.p, self.structure.root
        poses = dict(zip(self.structure.bodies, models.poses(q, p), strict=True))
        moved = self._body_motions(q, p, v, vd)
        twists = dict(zip(self.bodies, moved[:, :6], strict=True))
        accelerations = dict(zip(self.bodies, moved[:, 6:], strict=True))
        return _State({**poses, root: np.eye(4)}, twists, accelerations, vd, efforts)

    def at(
        self,
        at: ArrayLike,
        rates: ArrayLike,
        accelerations: ArrayLike | None = None,
        efforts: ArrayLike | None = None,
        space: Space = "platform",
        wrench: Wrench = None,
        gravity: ArrayLike | None = None,
    ) -> Reactions:
        """Reactions in one state.

        Args:
            at: operational coordinates x in platform space, a configuration in joint space.
            rates: ẋ in platform space, rates of ``dynamics.independent()`` in joint space.
            accelerations: their derivatives; those that follow from the efforts by default.
            efforts: of the motors, (motors,); those that the accelerations take by default, the
                smallest ones where motors are redundant.
            space: what the first three arguments are.
            wrench: what the surroundings do to the platform, (force, moment about its origin) in
                base axes, or such by the names of bodies.
            gravity: in base axes, (3,), m/s²; that of the description by default.

        Raises:
            ConfigurationError: neither accelerations nor efforts are given, or they contradict;
                an argument has the wrong shape.
            SingularError: the state is out of reach or singular.
        """
        if accelerations is None and efforts is None:
            raise ConfigurationError("give accelerations, or efforts, or both")
        if np.ndim(at) != 1 or np.ndim(rates) != 1:
            raise ConfigurationError("reactions are those of one state: positions and rates (n,)")
        outer = _Outer(wrench, gravity)
        if accelerations is None:
            q, v, vd = self._driven(at, rates, efforts, space, outer)
        else:
            q, v, vd = self.dynamics.motion(at, rates, accelerations, space)
        if efforts is None:
            efforts = self._needed(at, rates, accelerations, space, outer)
        given = np.asarray(efforts, dtype=float)
        if given.shape != (len(self.dynamics.motors),):
            raise ConfigurationError(
                f"efforts have shape {given.shape}, expected ({len(self.dynamics.motors)},)"
            )
        return self._solved(self._state(q, v, vd, given), outer)

    def _driven(
        self,
        at: ArrayLike,
        rates: ArrayLike,
        efforts: ArrayLike | None,
        space: Space,
        outer: _Outer,
    ) -> tuple[Array, Array, Array]:
        """The motion that efforts bring about, in rates that leave nothing open."""
        dynamics = self.dynamics
        if space == "platform":
            outputs = self.structure.columns("operational")
            if list(dynamics.model(space).independent) == outputs:
                moved = dynamics.direct(at, rates, efforts, outer.wrench, outer.gravity)  # type: ignore[arg-type]
                accelerations = dynamics.require(moved).accelerations
                return dynamics.motion(at, rates, accelerations, space)
            at, v, _ = dynamics.motion(at, rates, np.zeros(len(outputs)), space)
            rates = v[list(dynamics.model("joint").independent)]
        moved = dynamics.direct_joint(at, rates, efforts, outer.wrench, outer.gravity)  # type: ignore[arg-type]
        return dynamics.motion(at, rates, dynamics.require(moved).accelerations, "joint")

    def _needed(
        self, at: ArrayLike, rates: ArrayLike, accelerations: Any, space: Space, outer: _Outer
    ) -> Array:
        dynamics = self.dynamics
        if not dynamics.motors:
            return np.zeros(0)
        solve = dynamics.inverse if space == "platform" else dynamics.inverse_joint
        found = solve(at, rates, accelerations, wrench=outer.wrench, gravity=outer.gravity)
        return dynamics.require(found).efforts

    # the equations

    def _solved(self, state: _State, outer: _Outer) -> Reactions:
        holds = [self._placed(hold, state) for hold in self.holds]
        known = np.array([self._effort(placed, state) for placed in holds]).reshape(-1, 6)
        B = self._basis(holds)
        X = self._balance(holds, state)
        missing, size = self._needed_by_bodies(state, outer)
        missing = missing - X @ known.ravel()
        A = X @ B
        U, s, Vt = np.linalg.svd(A)
        rank = int(np.sum(s > RANK * s[0])) if s.size else 0
        z = Vt[:rank].T @ ((U[:, :rank].T @ missing) / s[:rank])
        lost = float(np.abs(A @ z - missing).max(initial=0.0))
        size = max(size, float(np.abs(X @ known.ravel()).max(initial=0.0)))
        if not lost <= BALANCED * size:
            raise ConfigurationError(
                f"these efforts do not give these accelerations: a body misses its balance by "
                f"{lost:.3g} N of {size:.3g} N; give accelerations or efforts alone, and ask for "
                "accelerations that the motors can give"
            )
        wrench = (known.ravel() + B @ z).reshape(-1, 6)
        wrench[:, 3:] *= self.length
        open_ = np.linalg.norm(B @ Vt[rank:].T, axis=1).reshape(-1, 6)
        return self._reported(holds, wrench, open_ < UNIQUE, state)

    def _reported(
        self, holds: Sequence[_Placed], wrench: Array, unique: Mask, state: _State
    ) -> Reactions:
        kept = [k for k, placed in enumerate(holds) if placed.hold.reported]
        return Reactions(
            tuple(holds[k].hold.name for k in kept),
            tuple(holds[k].hold.bodies for k in kept),
            wrench[kept],
            unique[kept],
            state.efforts,
            self.dynamics.motors,
        )

    def _placed(self, hold: _Hold, state: _State) -> _Placed:
        a, b = (state.poses[x] @ T for x, T in zip(hold.bodies, hold.T_body_frame, strict=True))
        if isinstance(hold.kind, JointType):
            T_a_b: Array = np.asarray(np.linalg.solve(a, b), dtype=float)
            q = np.atleast_1d(hold.kind.measured(T_a_b, hold.dimensions)).tolist()
            S = _twists(hold.kind.twists(q, hold.dimensions), a[:3, :3])
        else:
            S = _left_free(hold.kind, b[:3, :3])
        S[3:] *= self.length
        U, s, Vt = np.linalg.svd(S)
        along = U[:, : len(s)] @ np.diag(1 / s) @ Vt
        return _Placed(hold, b[:3, 3], U[:, len(s) :], along)

    @staticmethod
    def _effort(placed: _Placed, state: _State) -> Array:
        """The scaled wrench of a motor, without what the inertia of its rotor takes."""
        hold = placed.hold
        e = np.zeros(placed.along.shape[1])
        if hold.variables:
            e += state.efforts[list(hold.variables)]
        for freedom, variable, rotor in hold.rotors:
            e[freedom] -= rotor * state.vd[variable]
        return np.asarray(placed.along @ e)

    def _basis(self, holds: Sequence[_Placed]) -> Array:
        """Scaled wrenches for the unknowns: components of holds, then forces of couplings."""
        rows = 6 * len(holds)
        columns, k = [np.zeros((rows, 0))], {p.hold.name: n for n, p in enumerate(holds)}
        for n, placed in enumerate(holds):
            block = np.zeros((rows, placed.N.shape[1]))
            block[6 * n : 6 * n + 6] = placed.N
            columns.append(block)
        for coupling in self.structure.flat.couplings.values():
            column = np.zeros((rows, 1))
            for name, factor in coupling.terms.items():
                n = k[name]
                unit = holds[n].along[:, 0]
                column[6 * n : 6 * n + 6, 0] += float(scalar(factor, self.assembler.values)) * unit
            columns.append(column / np.linalg.norm(column))
        return np.hstack(columns)

    def _balance(self, holds: Sequence[_Placed], state: _State) -> Array:
        """What scaled wrenches of holds do to the bodies, about their origins, scaled."""
        X = np.zeros((6 * len(self.bodies), 6 * len(holds)))
        for n, placed in enumerate(holds):
            for body, sign in zip(placed.hold.bodies, (-1.0, 1.0), strict=True):
                if body not in self.bodies:
                    continue
                k = self.bodies.index(body)
                r = (placed.origin - state.poses[body][:3, 3]) / self.length
                block = np.eye(6)
                block[3:, :3] = _crossing(r)
                X[6 * k : 6 * k + 6, 6 * n : 6 * n + 6] += sign * block
        return X

    def _needed_by_bodies(self, state: _State, outer: _Outer) -> tuple[Array, float]:
        """Scaled wrenches that joints have to give the bodies, and the size of their parts."""
        g = outer.gravity if outer.gravity is not None else self._gravity
        given = outer.by_body(self.structure.mechanism.platform)
        rows, sizes = [], [1e-300]
        for body in self.bodies:
            moving, weight = self._newton_euler(body, state, np.asarray(g, dtype=float))
            loaded = np.asarray(given.get(body, np.zeros(6)), dtype=float)
            rows.append(moving - weight - loaded)
            for part in (moving, weight, loaded):
                sizes.append(np.abs(part[:3]).max())
                sizes.append(np.abs(part[3:]).max() / self.length)
        found = np.array(rows).reshape(-1, 6)
        found[:, 3:] /= self.length
        return found.ravel(), float(max(sizes))

    @cached_property
    def _gravity(self) -> Array:
        given = self.structure.mechanism.gravity
        return np.array([*vector(given, self.assembler.values, 2, 3), 0.0][:3], dtype=float)

    def _newton_euler(self, body: str, state: _State, g: Array) -> tuple[Array, Array]:
        """What moves a body, and its weight, about its origin: (force, moment), root axes.

        force = m (a + α×c + ω×(ω×c)),    moment = c × force + I α + ω × I ω
        """
        part, values = self._described[body], self.assembler.values
        R, w, alpha = state.poses[body][:3, :3], state.twists[body][3:], state.accelerations[body]
        m = float(scalar(part.mass, values))
        c = R @ np.array([*vector(part.com, values, 2, 3), 0.0][:3], dtype=float)
        a = alpha[:3] + np.cross(alpha[3:], c) + np.cross(w, np.cross(w, c))
        turning = self._turning(part, R, w, alpha[3:])
        moving = np.concatenate([m * a, np.cross(c, m * a) + turning])
        return moving, np.concatenate([m * g, np.cross(c, m * g)])

    def _turning(self, part: Body, R: Array, w: Array, alpha: Array) -> Array:
        """The moment that turns a body about its centre of mass."""
        values = self.assembler.values
        if part.rotation != "exact":
            phi = rotation_vector(wxyz_from_rotation(R.tolist()))
            given = (phi, tuple(w.tolist()), tuple(alpha.tolist()))
            return np.array(short_rotation(part, values).moment(*given), dtype=float)
        xx, yy, zz, xy, xz, yz = (*vector(part.inertia, values, 3, 6), 0.0, 0.0, 0.0)[:6]
        moments = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]], dtype=float)
        inertia = R @ moments @ R.T
        return np.asarray(inertia @ alpha + np.cross(w, inertia @ w))


@dataclass(frozen=True)
class _Outer:
    """What acts from outside."""

    wrench: Wrench
    gravity: ArrayLike | None

    def by_body(self, platform: str | None) -> Mapping[str, Any]:
        """Wrenches by body; `Dynamics` has judged their shapes and names."""
        if self.wrench is None:
            return {}
        if isinstance(self.wrench, Mapping):
            return self.wrench
        assert platform is not None
        return {platform: self.wrench}


def reactions(
    dynamics: Dynamics,
    at: ArrayLike,
    rates: ArrayLike,
    accelerations: ArrayLike | None = None,
    efforts: ArrayLike | None = None,
    space: Space = "platform",
    wrench: Wrench = None,
    gravity: ArrayLike | None = None,
) -> Reactions:
    """What every joint and constraint transmits in one state; see `JointForces.at`.

    Kernels are made anew; keep a `JointForces` where it is called again.
    """
    found = JointForces(dynamics)
    return found.at(at, rates, accelerations, efforts, space, wrench, gravity)


def _twists(twists: Sequence[Twist], R: Array) -> Array:
    """Twists in axes of a frame as columns in root axes, (6, freedoms)."""
    columns = [[*(R @ np.array(v, float)), *(R @ np.array(w, float))] for v, w in twists]
    return np.array(columns, dtype=float).reshape(-1, 6).T


def _left_free(kind: str, R: Array) -> Array:
    """Twists that a constraint leaves free at a closed state, (6, freedoms), root axes."""
    every = np.eye(6)
    if kind == "points-coincide":
        return every[:, 3:]
    if kind == "plane":
        return every[:, [0, 1, 5]]
    if kind == "frames-coincide":
        return every[:, :0]
    assert kind == "directions-parallel"
    return np.hstack([every[:, :3], np.concatenate([np.zeros(3), R[:, 2]])[:, None]])


def _crossing(r: Array) -> Array:
    x, y, z = r
    return np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])


def _matrix(T: Transform) -> Array:
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = np.array(T[0], dtype=float), np.array(T[1], dtype=float)
    return matrix
