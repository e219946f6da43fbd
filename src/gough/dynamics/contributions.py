"""What each leg and the platform add to the dynamics: Cartesian inertia and forces, part by part.

Forces are linear in the inertia of bodies. With that of one leg alone, and of its motors' rotors,
the reduced model gives that leg's inertia A_x,i and force H_x,i as the independent rates y feel
them, so that (Khalil and Guégan 2004)

    A = A_platform + Σ A_x,i,    Jᵀ τ = H_platform + Σ H_x,i,    H_x,i = A_x,i ẏ + h_x,i

The numbers belong to the bodies as they are described: inertia is not moved between them.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import casadi
import numpy as np
from numpy.typing import ArrayLike, NDArray

from gough.algebra import Scalar, Vector
from gough.dynamics.dynamics import LIMIT, Dynamics
from gough.dynamics.model import Model, Space
from gough.dynamics.results import Ending
from gough.dynamics.writing import Inputs, Writing
from gough.errors import ConfigurationError, SingularError, UnknownName
from gough.kernels import Kernel
from gough.symbolic.trees.forces import Loads
from gough.symbolic.trees.reduced import Reduced
from gough.symbolic.trees.rotations import short_rotations
from gough.topology import Structure

Array = NDArray[np.float64]
SX = casadi.SX

REST = "(rest)"
"""The name of what belongs neither to one leg nor to the platform."""
ROUNDING = 1e-12
"""Part of the largest number of a table below which it shows 0."""


@dataclass(frozen=True)
class Part:
    """A leg, the platform, or the rest: the bodies and motors that are counted together."""

    name: str
    bodies: tuple[str, ...]
    joints: tuple[str, ...]


def parts_of(structure: Structure) -> tuple[Part, ...]:
    """The legs in order, the platform, and the rest if it has bodies or motors.

    A body or a motor that several legs share belongs to the rest, as does a floating base.

    Raises:
        ConfigurationError: the mechanism has no platform, and so no legs.
    """
    mechanism, flat = structure.mechanism, structure.flat
    if mechanism.platform is None:
        raise ConfigurationError(f"{mechanism.name} has no platform, and so no legs to tell apart")
    bodies = Counter(body for leg in structure.legs for body in leg.bodies)
    joints = Counter(joint for leg in structure.legs for joint in leg.joints)
    parts = [
        Part(
            leg.name,
            tuple(body for body in leg.bodies if bodies[body] == 1),
            tuple(joint for joint in leg.joints if joints[joint] == 1),
        )
        for leg in structure.legs
    ]
    parts.append(Part(mechanism.platform, (mechanism.platform,), ()))
    taken = {name for part in parts for name in part.bodies}
    driven = {name for part in parts for name in part.joints}
    ground = set() if mechanism.floating else {mechanism.base}
    rest = tuple(body for body in flat.bodies if body not in taken | ground)
    motors = tuple(
        name
        for name, joint in flat.joints.items()
        if (joint.motor or joint.actuators) and name not in driven
    )
    return (*parts, Part(REST, rest, motors)) if rest or motors else tuple(parts)


@dataclass(frozen=True)
class LegContributions:
    """Inertia and forces of each part, along the independent rates y, which normally are ẋ.

    Linear forces are in N and belong to rates in m/s, moments are in N m; base axes where y is the
    twist of the platform.
    """

    parts: tuple[str, ...]
    """The legs, the platform, and `REST` where there is one."""
    independent: tuple[str, ...]
    """Names of y."""
    motors: tuple[str, ...]
    inertia: Array
    """A_x of each part, symmetric, (*batch, parts, m, m); kg, kg m and kg m²."""
    inertial: Array
    """A_x ẏ, (*batch, parts, m)."""
    velocity: Array
    """Coriolis and centrifugal forces, (*batch, parts, m)."""
    gravity: Array
    """Forces that carry the part's weight, (*batch, parts, m)."""
    efforts: Array | None
    """Shares of the motors' efforts, τ_i with Jᵀ τ_i = H_x,i, (*batch, parts, motors); smallest
    ones where motors are redundant, NaN at a singularity of type 2. None where motors can not
    give every force."""

    @property
    def forces(self) -> Array:
        """H_x of each part: what moves it and carries its weight, (*batch, parts, m)."""
        return self.inertial + self.bias

    @property
    def bias(self) -> Array:
        """h_x of each part: its forces without acceleration, (*batch, parts, m)."""
        return self.velocity + self.gravity

    @property
    def total_inertia(self) -> Array:
        """A of the whole robot, (*batch, m, m)."""
        return np.asarray(self.inertia.sum(axis=-3))

    @property
    def total_forces(self) -> Array:
        """A ẏ + h of the whole robot, (*batch, m)."""
        return np.asarray(self.forces.sum(axis=-2))

    @property
    def total_bias(self) -> Array:
        """h of the whole robot, (*batch, m)."""
        return np.asarray(self.bias.sum(axis=-2))

    @property
    def total_efforts(self) -> Array | None:
        """Efforts of the motors, (*batch, motors); None as for `efforts`."""
        return None if self.efforts is None else np.asarray(self.efforts.sum(axis=-2))

    def only(self, part: str) -> LegContributions:
        """The contribution of one part alone; its axis of parts has length 1.

        Raises:
            UnknownName: there is no such part.
        """
        if part not in self.parts:
            raise UnknownName("part", part, self.parts)
        k = self.parts.index(part)
        efforts = None if self.efforts is None else self.efforts[..., k : k + 1, :]
        return replace(
            self,
            parts=(part,),
            inertia=self.inertia[..., k : k + 1, :, :],
            inertial=self.inertial[..., k : k + 1, :],
            velocity=self.velocity[..., k : k + 1, :],
            gravity=self.gravity[..., k : k + 1, :],
            efforts=efforts,
        )

    def as_dict(self) -> dict[str, Any]:
        """The content as plain data."""
        shares = None
        if self.efforts is not None:
            shares = self.efforts.astype(object)
            shares[~np.isfinite(self.efforts)] = None
        return {
            "parts": list(self.parts),
            "independent": list(self.independent),
            "motors": list(self.motors),
            "inertia": self.inertia.tolist(),
            "inertial": self.inertial.tolist(),
            "velocity": self.velocity.tolist(),
            "gravity": self.gravity.tolist(),
            "efforts": None if shares is None else shares.tolist(),
        }

    def __str__(self) -> str:
        rows = int(np.prod(self.forces.shape[:-2], dtype=int))
        first = (0,) * (self.forces.ndim - 2)
        more = f" (row 1 of {rows})" if rows != 1 else ""
        if not rows:
            return "no rows"
        lines = [f"forces along {', '.join(self.independent)}, N and N m{more}"]
        lines += _table(self.parts, self.forces[first])
        if self.efforts is not None:
            lines.append(f"shares of the efforts of {', '.join(self.motors)}, N and N m")
            lines += _table(self.parts, self.efforts[first])
        return "\n".join(lines)


def _table(parts: Sequence[str], values: Array) -> Iterator[str]:
    width = max(5, *map(len, parts))
    rows = np.concatenate([values, values.sum(axis=0, keepdims=True)])
    rows = np.where(np.abs(rows) < ROUNDING * np.abs(values).max(initial=0.0), 0.0, rows)
    for name, row in zip((*parts, "total"), rows, strict=True):
        yield f"  {name:{width}}" + "".join(f" {x:11.4g}" for x in row)


class Contributions:
    """Contributions of the parts of one robot; its kernels are made once.

    Args:
        dynamics: the robot's.

    Raises:
        ConfigurationError: it has no platform.
    """

    def __init__(self, dynamics: Dynamics) -> None:
        self.dynamics = dynamics
        self.parts = parts_of(dynamics.structure)
        self._kernels: dict[tuple[Space, bool], Kernel] = {}

    def at(
        self,
        at: ArrayLike,
        rates: ArrayLike,
        accelerations: ArrayLike,
        gravity: ArrayLike | None = None,
        space: Space = "platform",
    ) -> LegContributions:
        """Contributions in a motion, row by row.

        Args:
            at: operational coordinates x in platform space, a configuration in joint space.
            rates: ẋ in platform space, rates of ``dynamics.independent()`` in joint space.
            accelerations: their derivatives.
            gravity: in base axes, (*batch, 3), m/s²; that of the description by default.
            space: whose rates y are.

        Raises:
            SingularError: a row is out of reach or singular.
            ConfigurationError: an argument has the wrong shape.
        """
        dynamics, model = self.dynamics, self.dynamics.model(space)
        q, v, vd = dynamics.motion(at, rates, accelerations, space)
        y, yd = v[..., list(model.independent)], vd[..., list(model.independent)]
        loads = () if gravity is None else (_gravity(gravity),)
        place = (q, dynamics.assembler.p) if dynamics.assembler.p.size else (q,)
        found = self._kernel(space, gravity is not None)(*place, y, *loads)
        _require_finite(found)
        A, velocity, weight = found[..., :-2], found[..., -2], found[..., -1]
        inertial = np.einsum("...pij,...j->...pi", A, yd)
        forces = inertial + velocity + weight
        efforts = _shares(model, place, forces) if model.motors_rank == y.shape[-1] else None
        return LegContributions(
            tuple(part.name for part in self.parts),
            dynamics.independent(space),
            dynamics.motors,
            A,
            inertial,
            velocity,
            weight,
            efforts,
        )

    def _kernel(self, space: Space, gravity: bool) -> Kernel:
        key = space, gravity
        if key not in self._kernels:
            writing = Writing(self.dynamics.model(space), "q", Inputs(gravity))
            self._kernels[key] = _written(writing, self.parts)
        return self._kernels[key]


def leg_contributions(
    dynamics: Dynamics,
    x: ArrayLike,
    xd: ArrayLike,
    xdd: ArrayLike,
    gravity: ArrayLike | None = None,
) -> LegContributions:
    """What each leg and the platform add in a motion of the outputs; see `Contributions.at`.

    Kernels are made anew; keep a `Contributions` where it is called again.
    """
    return Contributions(dynamics).at(x, xd, xdd, gravity)


def _written(w: Writing, parts: Sequence[Part]) -> Kernel:
    """A, velocity and gravity of every part, side by side, (parts, m, m + 2)."""
    count, found = len(w.yd), []
    for part in parts:
        loads = _loads(w.model, part)
        A = w.reduced.mass_matrix(loads)
        velocity = w.reduced.forces([0.0] * count, None, loads)
        weight = _weight(w.reduced, w.gravity, loads)
        found += [[*row, velocity[k], weight[k]] for k, row in enumerate(A)]
    shape = len(parts), count, count + 2
    outputs = [x for row in found for x in row]
    return w.finish("contributions", outputs, "y", "gravity", shape=shape)


def _loads(model: Model, part: Part) -> Loads:
    """Inertia of the bodies and rotors of one part alone, where they are."""
    names = [model.structure.edges[v.edge].name for v in model.structure.variables]
    rotors = {k: x for k, x in model.rotors.items() if names[k] in part.joints}
    rotations = short_rotations(model.tree, part.bodies)
    return Loads(model.tree.inertia_of(part.bodies), rotors=rotors, rotations=rotations)


def _weight(reduced: Reduced, gravity: Vector, loads: Loads) -> list[Scalar]:
    """Forces at rest."""
    forces = casadi.vertcat(
        *[SX(x) for x in reduced.forces([0.0] * len(reduced.y), gravity, loads)]
    )
    y = casadi.vertcat(*reduced.y)
    still = casadi.substitute(forces, y, SX.zeros(y.numel()))
    return [still[k] for k in range(still.numel())]


def _shares(model: Model, place: Sequence[Array], forces: Array) -> Array:
    """Efforts τ_i with Jᵀ τ_i = H_i for each part, smallest where some are left open.

    Where the singular values of J, in characteristic lengths and rad, are farther apart than
    `dynamics.LIMIT`, they are NaN.
    """
    J = model.kernel("motor_jacobian", "q")(*place)
    scale = model.assembler.rate_scale
    rows, columns = scale[model.actuated], scale[list(model.independent)]
    s = np.linalg.svd(J / rows[:, None] * columns, compute_uv=False)
    lost = ~(s[..., -1] > LIMIT * s[..., 0])
    J = np.where(lost[..., None, None], np.eye(*J.shape[-2:]), J)
    JT = np.swapaxes(J, -1, -2)
    multipliers = np.linalg.solve(JT @ J, np.swapaxes(forces, -1, -2))
    square = J.shape[-1] == J.shape[-2]
    efforts = np.linalg.solve(JT, np.swapaxes(forces, -1, -2)) if square else J @ multipliers
    return np.where(lost[..., None, None], np.nan, np.swapaxes(efforts, -1, -2))


def _gravity(given: ArrayLike) -> Array:
    values = np.asarray(given, dtype=float)
    if values.ndim == 0 or values.shape[-1] != 3 or not np.all(np.isfinite(values)):
        raise ConfigurationError(
            f"gravity has shape {values.shape}, expected (..., 3): finite x, y, z"
        )
    return values


def _require_finite(found: Array) -> None:
    lost = np.flatnonzero(~np.isfinite(found).all(axis=(-3, -2, -1)).ravel()).tolist()
    if lost:
        rows = int(np.prod(found.shape[:-3], dtype=int))
        raise SingularError(rows, lost, [Ending.singular.value] * len(lost))
