"""The models of dynamics, each written as a kernel: what it takes and what it gives."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import casadi
import numpy as np
from numpy.typing import NDArray

from gough import algebra as al
from gough.algebra import Scalar, Vector
from gough.errors import ConfigurationError
from gough.kernels import Kernel
from gough.symbolic.closing_rates import evaluated
from gough.symbolic.trees.factors import Factors, Grid, solve_definite
from gough.symbolic.trees.forces import Loads

if TYPE_CHECKING:
    from gough.dynamics.model import Model

Array = NDArray[np.float64]
SX = casadi.SX
Place = Literal["x", "q"]
"""Whether a model takes operational coordinates, or a configuration."""

UNIT = 1e-12
"""How far the square of a quaternion's length may be from 1 for it to be used as it is."""
MASSLESS = 1e-12
"""Smallest eigenvalue of a mass matrix with diagonal 1 that counts as inertia; rounding."""
HUGE = 1e300
"""Efforts and accelerations beyond this are no numbers to go on with."""


@dataclass(frozen=True)
class Inputs:
    """What a model takes besides positions and rates."""

    gravity: bool = False
    """Whether gravity is given with every call, rather than that of the description."""
    bodies: tuple[str, ...] = ()
    """Bodies on which a wrench is given."""


PLAIN = Inputs()


class Writing:
    """One model while it is written: symbols and what stands behind them."""

    def __init__(self, model: Model, place: Place, inputs: Inputs) -> None:
        self.model, self.place, self.inputs = model, place, inputs
        reduced = model.by_outputs if place == "x" else model.by_joints
        assert reduced is not None
        self.reduced = reduced
        count = len(model.given)
        self.yd = [SX.sym(f"yd{k}") for k in range(count)]
        self.tau = [SX.sym(f"tau{k}") for k in range(len(model.actuated))]
        self._gravity = SX.sym("gravity", 3)
        self._wrenches = SX.sym("wrenches", 6 * len(inputs.bodies))

    @property
    def gravity(self) -> Vector:
        """Given with the call, or described."""
        if not self.inputs.gravity:
            return self.model.gravity
        return self._gravity[0], self._gravity[1], self._gravity[2]

    @property
    def loads(self) -> Loads:
        """Inertia and given wrenches."""
        own, w = self.model.loads, self._wrenches
        wrenches = {}
        for n, body in enumerate(self.inputs.bodies):
            x = [w[6 * n + k] for k in range(6)]
            wrenches[body] = (x[0], x[1], x[2]), (x[3], x[4], x[5])
        return Loads(own.inertia, wrenches, own.rotors, own.pairs, own.rotations)

    def finish(
        self,
        name: str,
        outputs: Sequence[Scalar],
        *takes: str,
        shape: tuple[int, ...] | None = None,
    ) -> Kernel:
        """The kernel; ``takes`` names rates, accelerations or efforts that it depends on."""
        model, symbols = self.model, {}
        if self.place == "x":
            places = model.outputs.whole
            symbols["x"] = SX(casadi.vertcat(*[model.closure.q[k] for k in places]))
        else:
            symbols["q"] = model.closure.q
        if model.closure.p.numel():
            symbols["p"] = model.closure.p
        columns = {"y": self.reduced.y, "yd": self.yd, "tau": self.tau}
        for take in takes:
            if take in columns:
                symbols[take] = SX(casadi.vertcat(*columns[take], SX(0, 1)))
        if self.inputs.gravity and "gravity" in takes:
            symbols["gravity"] = self._gravity
        if self.inputs.bodies and "wrenches" in takes:
            symbols["wrenches"] = self._wrenches
        column = casadi.vertcat(*[SX(x) for x in outputs], SX(0, 1))
        return Kernel(name, symbols, column, (column.numel(),) if shape is None else shape)

    # parts

    def forces(self, yd: Sequence[Scalar]) -> list[Scalar]:
        """What y has to be given for a motion."""
        return self.reduced.forces(yd, self.gravity, self.loads)

    def motor_rows(self) -> Grid:
        """J with q̇_a = J y, (motors, y)."""
        return self.reduced.rows_of(self.model.actuated)

    def motor_forces(self) -> list[Scalar]:
        """Jᵀ τ."""
        rows = self.motor_rows()
        columns = [[row[k] for row in rows] for k in range(len(self.yd))]
        return [al.dot(column, self.tau) for column in columns]

    def motor_efforts(self, W: Sequence[Scalar]) -> tuple[list[Scalar], Scalar]:
        """Efforts τ with Jᵀ τ = W and the determinant of what was solved.

        The smallest ones where there are motors to spare, the nearest where there are too few.

        Raises:
            ConfigurationError: the motors are not independent.
        """
        rows, model = self.motor_rows(), self.model
        transposed = [list(column) for column in zip(*rows, strict=True)]
        motors, count = len(rows), len(W)
        if model.motors_rank < min(motors, count) or not motors:
            raise ConfigurationError(f"{model.structure.mechanism.name} has no such model")
        if motors == count:
            factors = Factors(transposed)
            return factors.solve(W), factors.determinant
        if motors > count:
            square = [[al.dot(a, b) for b in transposed] for a in transposed]
            multipliers, determinant = solve_definite(square, W)
            return [al.dot(row, multipliers) for row in rows], determinant
        square = [[al.dot(a, b) for b in rows] for a in rows]
        return solve_definite(square, [al.dot(row, W) for row in rows])

    def potential(self) -> Scalar:
        """Potential energy -Σ m g·x, J."""
        found: Scalar = 0.0
        frames, root = self.reduced.frames, self.model.tree.root
        for node in self.model.tree.nodes[1:]:
            own = node.inertia
            at = al.scale(own.mass, frames.root_position(node, al.ZERO))
            moment = al.plus(at, frames.turn(own.moment, node.frame, root))
            found = al.sub(found, al.dot(self.gravity, moment))
        return found

    def regularity(self, determinant: Scalar, numbers: Sequence[Scalar], name: str) -> Scalar:
        """The smaller of two measures, or -1 where a number is none."""
        found = self.reduced.regularity(numbers)
        if not al.is_number(determinant):
            typical = self._typical(determinant)
            size = casadi.fabs(determinant) * (1.0 / typical)
            found = size if al.is_number(found) else casadi.fmin(found, size)
        total = al.total(list(numbers))
        if al.is_number(total):
            return found
        sound: Scalar = casadi.fabs(total) < HUGE
        if self.place == "x" and self.model.quaternion is not None:
            square = casadi.sumsqr(self.model.closure.q[self.model.quaternion])
            sound = casadi.logic_and(sound, casadi.fabs(square - 1.0) < UNIT)
        return casadi.if_else(sound, found, -1.0)

    def require_inertia(self, A: Grid) -> None:
        """Raise where a motion moves no mass.

        Raises:
            ConfigurationError: the rates that move none, by name.
        """
        model = self.model
        flat = evaluated(model.closure, model.sampled.samples, [x for row in A for x in row])
        matrices = flat.reshape(len(flat), len(A), len(A))
        size = np.sqrt(np.abs(np.einsum("sii->si", matrices)))
        size = np.where(size > 0, size, 1.0)
        values, vectors = np.linalg.eigh(matrices / size[:, :, None] / size[:, None, :])
        lost = int(np.argmax(values[:, 0]))
        if values[lost, 0] > MASSLESS:
            return
        motion = np.abs(vectors[lost, :, 0])
        names = [model.structure.variables[k].name for k in model.independent]
        worst = [n for n, x in zip(names, motion, strict=True) if x > 0.1 * motion.max()]
        raise ConfigurationError(
            f"{model.structure.mechanism.name} has a motion without inertia, of "
            f"{', '.join(worst)}: give a body that it moves some mass or inertia"
        )

    def _typical(self, determinant: SX) -> float:
        """Median size of a determinant over the samples."""
        model = self.model
        values = np.abs(evaluated(model.closure, model.sampled.samples, [determinant]))
        return float(np.median(values)) or 1.0


# the models


def _inverse(w: Writing) -> Kernel:
    """Efforts of the motors for y, ẏ, then how regular the mechanism is there."""
    tau, determinant = w.motor_efforts(w.forces(w.yd))
    outputs = [*tau, w.regularity(determinant, tau, "inverse")]
    return w.finish("inverse", outputs, "y", "yd", "gravity", "wrenches")


def _forces(w: Writing) -> Kernel:
    """Generalised forces along y that a motion takes, (y,)."""
    return w.finish("forces", w.forces(w.yd), "y", "yd", "gravity", "wrenches")


def _direct(w: Writing) -> Kernel:
    """ẏ for y and efforts, then how regular the mechanism is there."""
    efforts = w.loads.given(dict(zip(w.model.actuated, w.tau, strict=True)))
    along, A = (
        w.reduced.forces([0.0] * len(w.yd), w.gravity, efforts),
        w.reduced.mass_matrix(w.loads),
    )
    w.require_inertia(A)
    right = [al.mul(-1.0, x) for x in along]
    yd, determinant = solve_definite(A, right)
    outputs = [*yd, w.regularity(determinant, yd, "direct")]
    return w.finish("direct", outputs, "y", "tau", "gravity", "wrenches")


def _mass_matrix(w: Writing) -> Kernel:
    """A of y, symmetric positive definite, (y, y)."""
    A = w.reduced.mass_matrix(w.loads)
    return w.finish("mass_matrix", [x for row in A for x in row], shape=(len(A), len(A)))


def _bias(w: Writing) -> Kernel:
    """Forces along y at ẏ = 0: Coriolis, centrifugal, gravity and given wrenches, (y,)."""
    return w.finish("bias", w.forces([0.0] * len(w.yd)), "y", "gravity", "wrenches")


def _gravity_load(w: Writing) -> Kernel:
    """Forces along y that hold the mechanism at rest, (y,)."""
    at_rest = casadi.vertcat(*w.reduced.y)
    forces = casadi.vertcat(*[SX(x) for x in w.forces([0.0] * len(w.yd))])
    column = casadi.substitute(forces, at_rest, SX.zeros(at_rest.numel()))
    still = [column[k] for k in range(column.numel())]
    return w.finish("gravity_load", still, "gravity", "wrenches")


def _rates(w: Writing) -> Kernel:
    """All rates v of the tree for y, (variables,)."""
    return w.finish("rates", w.reduced.all_rates(w.reduced.rates), "y")


def _accelerations(w: Writing) -> Kernel:
    """All accelerations v̇ of the tree for y, ẏ, (variables,)."""
    found = w.reduced.all_rates(w.reduced.accelerations(w.yd))
    return w.finish("accelerations", found, "y", "yd")


def _motor_jacobian(w: Writing) -> Kernel:
    """J with q̇_a = J y, (motors, y)."""
    rows = w.motor_rows()
    shape = len(rows), len(w.yd)
    return w.finish("motor_jacobian", [x for row in rows for x in row], shape=shape)


def _energy(w: Writing) -> Kernel:
    """Kinetic energy ½ yᵀ A y and potential energy -Σ m g·x, J, (2,)."""
    A, y = w.reduced.mass_matrix(w.loads), w.reduced.y
    kinetic = al.mul(0.5, al.dot(y, [al.dot(row, y) for row in A]))
    return w.finish("energy", [kinetic, w.potential()], "y", "gravity")


MODELS: dict[str, Callable[[Writing], Kernel]] = {
    "inverse": _inverse,
    "direct": _direct,
    "forces": _forces,
    "mass_matrix": _mass_matrix,
    "bias": _bias,
    "gravity_load": _gravity_load,
    "energy": _energy,
    "rates": _rates,
    "accelerations": _accelerations,
    "motor_jacobian": _motor_jacobian,
}
"""Every model by name; the first line of each says what it gives."""
