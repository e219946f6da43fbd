"""The dynamic model as a matrix times its parameters (Khalil and Dombre 2002, 12.3).

Forces along the independent rates y are linear in the inertial parameters φ, so that

    Jᵀ τ = W(q, y, ẏ) φ + Jᵀ (fv q̇_a + fc sign q̇_a),      q̇_a = J y.

W is the derivative of the recursive Newton-Euler forces by φ: exact, since nothing else is left.
What can be compared with measured efforts τ depends on the motors:

- as many as y: the efforts themselves, J⁻ᵀ times all that;
- more: with J = Q R, the efforts Qᵀ τ that the model determines, R⁻ᵀ times it; what is left of τ
  only tightens the mechanism. With noise σ of the motors, σ J = Q R and Qᵀ τ/σ;
- fewer (a floating base): the forces along y as they are, Jᵀ τ.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import casadi
import numpy as np
from numpy.typing import ArrayLike, NDArray

from gough import algebra as al
from gough.algebra import Scalar, Vector
from gough.dynamics.dynamics import Dynamics
from gough.dynamics.identification.parameters import ENTRIES, INERTIAL, Parameters
from gough.dynamics.model import Space
from gough.dynamics.writing import PLAIN, Writing
from gough.errors import ConfigurationError
from gough.kernels import Kernel
from gough.symbolic.trees.forces import Loads
from gough.symbolic.trees.nodes import Inertia, shifted

Array = NDArray[np.float64]
SX = casadi.SX
Form = Literal["efforts", "shared", "forces"]
"""Whether rows are efforts of motors, what redundant motors share, or forces along y."""


@dataclass(frozen=True)
class States:
    """Rows of a motion."""

    q: Array
    """Closed configurations, (rows, positions)."""
    y: Array
    """Independent rates, (rows, independent)."""
    yd: Array
    """Their accelerations, (rows, independent)."""

    def __len__(self) -> int:
        return len(self.q)

    def __getitem__(self, rows: slice | NDArray[np.int_]) -> States:
        return States(self.q[rows], self.y[rows], self.yd[rows])


class Regressor:
    """The matrix of one mechanism that its parameters are multiplied by.

    Args:
        dynamics: the mechanism.
        parameters: what the model is linear in.
        space: whose rates y are; platform space where there are outputs, by default.
    """

    def __init__(
        self, dynamics: Dynamics, parameters: Parameters, space: Space | None = None
    ) -> None:
        outputs = bool(dynamics.structure.columns("operational"))
        self.dynamics, self.parameters = dynamics, parameters
        self.space: Space = space or ("platform" if outputs else "joint")
        self.model = dynamics.model(self.space)
        if not self.model.actuated:
            name = dynamics.structure.mechanism.name
            raise ConfigurationError(f"{name} has no motors, so that no efforts can be measured")
        passive = [
            dynamics.structure.variables[k].name
            for k in self.model.rotors
            if k not in self.model.actuated
        ]
        if passive:
            raise ConfigurationError(
                f"{', '.join(passive)} has an actuator with inertia and no motor; its inertia "
                "would be no parameter"
            )
        short = [
            name for name, b in dynamics.structure.flat.bodies.items() if b.rotation != "exact"
        ]
        if short:
            raise ConfigurationError(
                f"{', '.join(short)} has a rotation that is not exact; identification is of rigid "
                "bodies: take the description with rotation: exact"
            )

    @cached_property
    def form(self) -> Form:
        """What rows are; see the module."""
        motors, count = len(self.model.actuated), len(self.model.independent)
        if self.model.motors_rank < count:
            return "forces"
        return "efforts" if motors == count else "shared"

    @property
    def channels(self) -> tuple[str, ...]:
        """A name for each row of one state: of its motor, or of an independent rate."""
        if self.form == "efforts":
            return self.dynamics.motors
        names = self.dynamics.independent(self.space)
        return (
            names if self.form == "forces" else tuple(f"share {k + 1}" for k in range(len(names)))
        )

    # states

    def states(self, at: ArrayLike, rates: ArrayLike, accelerations: ArrayLike) -> States:
        """Rows of a motion in the space of the regressor.

        Args:
            at: operational coordinates, or configurations q in joint space, (*batch, n).
            rates: of the outputs, or of the independent variables, (*batch, m).
            accelerations: theirs, (*batch, m).

        Raises:
            SingularError: a row is out of reach or singular.
            ConfigurationError: an argument has the wrong shape.
        """
        q, v, vd = self.dynamics.motion(at, rates, accelerations, self.space)
        y = list(self.model.independent)
        width = len(self.model.structure.variables)
        return States(
            q.reshape(-1, q.shape[-1]), v.reshape(-1, width)[:, y], vd.reshape(-1, width)[:, y]
        )

    # kernels

    @cached_property
    def kernel(self) -> Kernel:
        """W of inertia and rotors: (q, [p], y, ẏ) -> (y, parameters without friction)."""
        writing = Writing(self.model, "q", PLAIN)
        symbols = [SX.sym(f"phi{k}") for k in range(self._without_friction)]
        loads = Loads(self._inertia(symbols), rotors=self._rotors(symbols))
        forces = self.model.by_joints.forces(writing.yd, self.model.gravity, loads)
        column = casadi.vertcat(*[SX(x) for x in forces])
        W = casadi.densify(casadi.jacobian(column, casadi.vertcat(*symbols, SX(0, 1))))
        entries = [W[i, k] for i in range(W.shape[0]) for k in range(W.shape[1])]
        return writing.finish("regressor", entries, "y", "yd", shape=tuple(W.shape))

    @property
    def _without_friction(self) -> int:
        return self.parameters.inertial + len(self.parameters.motors)

    def _rotors(self, symbols: list[SX]) -> dict[int, Scalar]:
        first = self.parameters.inertial
        return {m.variable: symbols[first + k] for k, m in enumerate(self.parameters.motors)}

    def _inertia(self, symbols: list[SX]) -> dict[int, Inertia]:
        """Inertia of each node from the ten numbers of the bodies on it."""
        found: dict[int, Inertia] = {}
        for k, body in enumerate(self.parameters.bodies):
            node, *_ = self.model.tree.of_body[body]
            own = symbols[k * len(INERTIAL) : (k + 1) * len(INERTIAL)]
            placed = on_node(own, *node.bodies[body])
            found[node.index] = added(found.get(node.index, Inertia()), placed)
        return found

    # numbers

    def _take(self, states: States) -> tuple[Array, ...]:
        p = self.dynamics.assembler.p
        return (states.q, p) if p.size else (states.q,)

    def jacobian(self, states: States) -> Array:
        """J with q̇_a = J y, (rows, motors, independent)."""
        return self.model.kernel("motor_jacobian", "q")(*self._take(states))

    def along_rates(self, states: States) -> Array:
        """Forces along y of unit parameters, (rows, independent, parameters)."""
        W = self.kernel(*self._take(states), states.y, states.yd)
        if not self.parameters.friction:
            return W
        J = self.jacobian(states)
        rates = np.einsum("rmi,ri->rm", J, states.y)
        along = np.swapaxes(J, 1, 2)
        viscous, coulomb = (along * x[:, None, :] for x in (rates, np.sign(rates)))
        return np.concatenate([W, viscous, coulomb], axis=-1)

    def matrix(self, states: States, noise: Array | None = None) -> Array:
        """Y with measured rows = Y φ, (rows, channels, parameters); see `form`.

        Args:
            states: the motion.
            noise: of redundant motors, the standard deviation of each one's effort, (motors,);
                their shares are weighted by it.
        """
        W = self.along_rates(states)
        if self.form == "forces":
            return W
        if self.form == "efforts":
            return np.asarray(np.linalg.solve(np.swapaxes(self.jacobian(states), 1, 2), W))
        _, R = self._shares(states, noise)
        return np.asarray(np.linalg.solve(np.swapaxes(R, 1, 2), W))

    def measured(self, states: States, efforts: Array, noise: Array | None = None) -> Array:
        """Measured efforts as rows of the regressor, (rows, channels).

        Args:
            states: the motion.
            efforts: of the motors, (rows, motors), N and N m.
            noise: as for `matrix`.
        """
        if self.form == "efforts":
            return efforts
        if self.form == "forces":
            return np.asarray(np.einsum("rmi,rm->ri", self.jacobian(states), efforts))
        Q, _ = self._shares(states, noise)
        weight = 1.0 if noise is None else 1 / noise
        return np.asarray(np.einsum("rmi,rm->ri", Q, weight * efforts))

    def _shares(self, states: States, noise: Array | None) -> tuple[Array, Array]:
        J = self.jacobian(states)
        Q, R = np.linalg.qr(J if noise is None else J * noise[:, None])
        return Q, R

    def efforts(self, states: States, values: Array) -> Array:
        """Efforts of the motors for all parameters, the smallest ones, (rows, motors)."""
        W = self.along_rates(states) @ values
        along = np.swapaxes(self.jacobian(states), 1, 2)
        return np.asarray((np.linalg.pinv(along) @ W[..., None])[..., 0])


def on_node(ten: Sequence[Scalar], R: al.Matrix, t: Vector) -> Inertia:
    """A body's ten numbers about the origin and in the axes of its node.

    With T_node_body = (R, t): s' = R s + m t, J' = R J Rᵀ + (2 t·R s) 1 - t (R s)ᵀ - R s tᵀ
    + m (t² 1 - t tᵀ).
    """
    mass, moment = ten[0], al.turn(R, (ten[1], ten[2], ten[3]))
    rows: list[list[Scalar]] = [[0.0] * 3 for _ in range(3)]
    for (i, k), x in zip(ENTRIES, ten[4:], strict=True):
        rows[i][k] = rows[k][i] = x
    tensor = al.matmul(al.matmul(R, tuple(map(tuple, rows))), al.transpose(R))  # type: ignore[arg-type]
    parts = (tensor, _moved(t, moment), shifted(mass, t))
    total = tuple(
        tuple(al.total([part[i][k] for part in parts]) for k in range(3)) for i in range(3)
    )
    return Inertia(mass, al.plus(moment, al.scale(mass, t)), total)  # type: ignore[arg-type]


def _moved(t: Vector, s: Vector) -> al.Matrix:
    """(2 t·s) 1 - t sᵀ - s tᵀ."""
    twice = al.mul(2.0, al.dot(t, s))
    return tuple(
        tuple(
            al.sub(twice if i == k else 0.0, al.add(al.mul(t[i], s[k]), al.mul(s[i], t[k])))
            for k in range(3)
        )
        for i in range(3)
    )  # type: ignore[return-value]


def added(a: Inertia, b: Inertia) -> Inertia:
    """Both on one node."""
    tensor = tuple(al.plus(x, y) for x, y in zip(a.tensor, b.tensor, strict=True))
    return Inertia(al.add(a.mass, b.mass), al.plus(a.moment, b.moment), tensor)  # type: ignore[arg-type]
