"""Energies of a mechanism, and Lagrange's equations of its tree by automatic differentiation.

They rest on the poses of the bodies alone and share no step with the recursive models, so that
either checks the other.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi

from gough import algebra as al
from gough.algebra import Scalar
from gough.description import Body
from gough.description.values import scalar, vector
from gough.symbolic.closure import Closure
from gough.symbolic.trees.rotations import ShortRotation, rotation_vector, short_rotation

SX = casadi.SX
Gravity = SX | Sequence[float]
"""Acceleration of free fall in root axes, m/s²."""


@dataclass(frozen=True)
class _Weight:
    """A body with mass, where it stands in root axes."""

    mass: Scalar
    spread: SX
    """∫ r rᵀ dm about the centre of mass, in body axes, (3, 3)."""
    centre: SX
    rotation: SX
    short: tuple[SX, ShortRotation] | None = None
    """Its rotation vector and its energy of rotation, where that is a formula of its own."""


class Lagrange:
    """Energies and generalised forces of the tree, with all loops open.

    Positions are ``closure.q`` and live parameters ``closure.p``; rates ``v`` and accelerations
    ``vd`` are columns with one entry for each of ``structure.variables``, symbols or numbers.
    Bodies without mass, such as pieces of a cut platform, add nothing.

    Args:
        closure: where the poses come from.
    """

    def __init__(self, closure: Closure) -> None:
        self.closure = closure
        count = len(closure.structure.variables)
        self._v, self._vd = SX.sym("v", count), SX.sym("vd", count)
        self._g = SX.sym("g", 3)

    def kinetic(self, v: SX) -> SX:
        """T(q, v) = ½ Σ m |ċ|² + tr(Ṙ S Ṙᵀ) over the bodies, J.

        With c the centre of mass, R the rotation and S = ∫ r rᵀ dm about c in body axes, the second
        term is the energy of rotation ½ ωᵀ I ω: the points c + R r of the body move with ċ + Ṙ r.
        A body whose energy of rotation is a formula in its rotation vector has that instead.
        """
        return self._at(self._kinetic, v=v)

    def potential(self, gravity: Gravity) -> SX:
        """U(q) = -Σ m g·c over the bodies, J; zero for what has its centre at the root."""
        return self._at(self._potential, gravity=gravity)

    def forces(self, v: SX, vd: SX, gravity: Gravity) -> SX:
        """Generalised forces that move the tree so, a column (variables,), N and N m.

        The equations of Boltzmann and Hamel, with dq/dt = H v and the momentum p = ∂T/∂v:

            τ = ṗ - Hᵀ ∂(T - U)/∂q - ω × p_ω

        The last term stands in the rows of joints whose rates are an angular velocity ω in axes of
        frame a, the derivative of no position: there δω = d(δθ)/dt - ω × δθ.
        """
        return self._at(self._forces, v=v, vd=vd, gravity=gravity)

    def mass_matrix(self) -> SX:
        """M(q) = ∂²T/∂v², (variables, variables), symmetric."""
        return SX(casadi.jacobian(self._momentum, self._v))

    def bias(self, v: SX, gravity: Gravity) -> SX:
        """The forces without acceleration, a column: forces = M vd + bias."""
        return self.forces(v, SX.zeros(self._vd.numel()), gravity)

    # the same in symbols of our own

    @cached_property
    def _weights(self) -> tuple[_Weight, ...]:
        bodies = self.closure.structure.flat.bodies
        found = (self._weight(name, bodies[name]) for name in self.closure.poses if name in bodies)
        return tuple(weight for weight in found if not _massless(weight))

    def _weight(self, name: str, body: Body) -> _Weight:
        values = self.closure.values
        R, p = self.closure.poses[name]
        x, y, *z = vector(body.com, values, 2, 3)
        centre = al.plus(p, al.turn(R, (x, y, *z) if z else (x, y, 0.0)))
        short, moments = None, vector(body.inertia, values, 3, 6)
        if body.rotation != "exact":
            structure = self.closure.structure
            place = self.closure.slices[structure.edge_to[name]]
            quaternion = [self.closure.q[k] for k in range(place.stop - 4, place.stop)]
            phi = SX(casadi.vertcat(*rotation_vector(quaternion)))
            short, moments = (phi, short_rotation(body, values)), (0.0, 0.0, 0.0)
        xx, yy, zz, *mixed = moments
        return _Weight(
            mass=scalar(body.mass, values),
            spread=_spread((xx, yy, zz), mixed or (0.0, 0.0, 0.0)),
            centre=casadi.vertcat(*map(SX, centre)),
            rotation=casadi.vertcat(*(casadi.horzcat(*map(SX, row)) for row in R)),
            short=short,
        )

    @cached_property
    def _kinetic(self) -> SX:
        moving = [
            casadi.horzcat(weight.centre, weight.rotation).reshape((12, 1))
            for weight in self._weights
        ]
        rates = self._rate(casadi.vertcat(SX(0, 1), *moving))
        energy = SX(0)
        for k, weight in enumerate(self._weights):
            rate = rates[12 * k : 12 * (k + 1)].reshape((3, 4))
            c, R = rate[:, 0], rate[:, 1:]
            energy += weight.mass * casadi.sumsqr(c) / 2
            energy += casadi.dot(R @ weight.spread, R) / 2
            if weight.short is not None:
                phi, formula = weight.short
                energy += formula.energy(_three(phi), _three(self._rate(phi)))
        return energy

    @cached_property
    def _potential(self) -> SX:
        energy = SX(0)
        for weight in self._weights:
            energy -= weight.mass * casadi.dot(self._g, weight.centre)
        return energy

    @cached_property
    def _momentum(self) -> SX:
        """∂T/∂v, a column."""
        return SX(casadi.gradient(self._kinetic, self._v))

    @cached_property
    def _forces(self) -> SX:
        H = self.closure.position_rates
        p = self._momentum
        changes = self._rate(p) + casadi.jtimes(p, self._v, self._vd)
        slope = casadi.gradient(self._kinetic - self._potential, self.closure.q)
        forces = changes - H.T @ slope
        for rows in self._spins():
            forces[rows] -= casadi.cross(self._v[rows], p[rows])
        return SX(forces)

    def _rate(self, values: SX) -> SX:
        """Rate of a column of values along dq/dt = H v, with v held."""
        return SX(casadi.jtimes(values, self.closure.q, self.closure.position_rates @ self._v))

    def _spins(self) -> list[slice]:
        """The variables of every angular velocity: the last three of a joint with a quaternion."""
        spins, end = [], 0
        for edge in self.closure.structure.edges:
            end += edge.type.freedoms
            if edge.type.coordinates > edge.type.freedoms:
                spins.append(slice(end - 3, end))
        return spins

    def _at(
        self,
        expression: SX,
        v: SX | None = None,
        vd: SX | None = None,
        gravity: Gravity = (0, 0, 0),
    ) -> SX:
        """An expression with our symbols replaced."""
        given = [
            (symbol, SX(value) if value is not None else symbol)
            for symbol, value in ((self._v, v), (self._vd, vd), (self._g, _column(gravity)))
        ]
        closure = self.closure
        inputs = [closure.q, closure.p, *(symbol for symbol, _ in given)]
        function = casadi.Function("energy", inputs, [expression])
        return SX(function(closure.q, closure.p, *(value for _, value in given)))


def _three(column: SX) -> tuple[SX, SX, SX]:
    return column[0], column[1], column[2]


def _column(gravity: Gravity) -> SX:
    return gravity if isinstance(gravity, SX) else SX(casadi.vertcat(*gravity))


def _spread(moments: Sequence[Scalar], mixed: Sequence[Scalar]) -> SX:
    """∫ r rᵀ dm = ½ tr(I) 1 - I, from the entries xx yy zz and xy xz yz of an inertia I."""
    half: Any = sum(moments) / 2
    spread = SX(3, 3)
    for k, moment in enumerate(moments):
        spread[k, k] = half - moment
    for (i, k), entry in zip(((0, 1), (0, 2), (1, 2)), mixed, strict=True):
        spread[i, k] = spread[k, i] = -entry
    return spread


def _massless(weight: _Weight) -> bool:
    return al.is_number(weight.mass) and weight.mass == 0 and bool(weight.spread.is_zero())
