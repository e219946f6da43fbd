"""Dynamics of a 6-UPS Gough-Stewart platform with leg masses, written by hand.

Each leg is two bodies: a cylinder turning about A_i in a universal joint, and a rod sliding in it.
Newton and Euler are written in the frame of each leg and reflected to the platform (Khalil and
Guegan 2004): F = F_platform + Σ J_i⁻ᵀ H_i, and J⁻ᵀ Γ = F; direct dynamics solve A ẍ = Jᵀ Γ - H
with the Cartesian inertia of each leg at B. All lengths and masses are numbers.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import casadi
import numpy as np

from gough.kernels import Kernel
from gough.kernels.solves import ldlt_solve, lu_solve

SX = casadi.SX
GRAVITY = np.array([0.0, 0.0, -9.80665])


@dataclass
class Leg:
    """Geometry and masses of one leg; s is along the leg, from A."""

    anchor_base: np.ndarray
    anchor_platform: np.ndarray
    turn: float
    """Angle of the first axis of the universal joint about z, rad."""
    masses: tuple[float, float] = (3.1, 1.7)
    centre_cylinder: float = 0.31
    """Centre of mass of the cylinder, from A in m."""
    centre_rod: float = 0.36
    """Centre of mass of the rod, from B back in m."""
    inertia: np.ndarray = field(default_factory=lambda: np.array([0.371, 0.368, 0.0049]))
    """Principal inertias of the cylinder about A plus those of the rod about its centre, kg m²."""

    @property
    def frame(self) -> np.ndarray:
        c, s = np.cos(self.turn), np.sin(self.turn)
        return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]])


@dataclass
class Platform:
    mass: float = 21.0
    inertia: np.ndarray = field(default_factory=lambda: np.diag([0.9, 1.0, 1.7]))


def legs() -> list[Leg]:
    """Six legs in three pairs."""
    base = np.deg2rad([-12, 12, 108, 132, 228, 252])
    platform = np.deg2rad([-48, 48, 72, 168, 192, 288])
    on_circle = lambda radius, a: radius * np.array([np.cos(a), np.sin(a), 0.0])  # noqa: E731
    return [
        Leg(on_circle(1.0, a), on_circle(0.55, b), a) for a, b in zip(base, platform, strict=True)
    ]


def rotation(q: SX) -> SX:
    """Rotation of a unit quaternion (w, x, y, z)."""
    w, x, y, z = (q[k] for k in range(4))
    rows = (
        (1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
        (2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
        (2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
    )
    return casadi.vertcat(*[casadi.horzcat(*row) for row in rows])


class LegState:
    """Where a leg is: the frame along it, its length and the angles of its universal joint."""

    def __init__(self, leg: Leg, R: SX, p: SX) -> None:
        self.leg = leg
        self.arm = R @ leg.anchor_platform
        d = leg.frame.T @ (p + self.arm - leg.anchor_base)
        across = casadi.sqrt(d[1] * d[1] + d[2] * d[2])
        self.length = casadi.sqrt(d[1] * d[1] + d[2] * d[2] + d[0] * d[0])
        self.inverse_length, inverse_across = 1 / self.length, 1 / across
        self.s2, self.c2 = d[0] * self.inverse_length, across * self.inverse_length
        s1, c1 = -d[1] * inverse_across, d[2] * inverse_across
        self.inverse_c2 = self.length * inverse_across
        x = casadi.vertcat(self.c2, s1 * self.s2, -c1 * self.s2)
        y = casadi.vertcat(0, c1, s1)
        self.axes = leg.frame @ casadi.horzcat(x, y, d * self.inverse_length)

    @property
    def direction(self) -> SX:
        """Unit vector from A to B."""
        return self.axes[:, 2]

    def force(self, velocity: SX, acceleration: SX) -> SX:
        """Force the platform exerts on the leg at B, besides the actuator's, in base axes."""
        leg, L, iL = self.leg, self.length, self.inverse_length
        v, a, g = (self.axes.T @ u for u in (velocity, acceleration, SX(GRAVITY)))
        wx, wy, Ld = -v[1] * iL, v[0] * iL, v[2]
        q1d = wx * self.inverse_c2
        wz = q1d * self.s2
        square = wx * wx + wy * wy
        ay = (a[0] - 2 * Ld * wy) * iL - wx * wz
        ax = wy * wz - (a[1] + 2 * Ld * wx) * iL
        q1dd = (ax + q1d * wy * self.s2) * self.inverse_c2
        az = q1dd * self.s2 + q1d * wy * self.c2
        s, (m1, m2) = L - leg.centre_rod, leg.masses
        fx = m2 * (2 * Ld * wy + s * (ay + wx * wz) - g[0])
        fy = m2 * (-2 * Ld * wx + s * (wy * wz - ax) - g[1])
        fz = m2 * (a[2] + L * square - s * square - g[2])
        inertia, lever = leg.inertia, m1 * leg.centre_cylinder
        Nx = inertia[0] * ax + (inertia[2] - inertia[1]) * wy * wz + lever * g[1] - s * fy
        Ny = inertia[1] * ay + (inertia[0] - inertia[2]) * wz * wx - lever * g[0] + s * fx
        Nz = inertia[2] * az + (inertia[1] - inertia[0]) * wx * wy
        H1 = self.c2 * Nx + self.s2 * Nz
        return self.axes @ casadi.vertcat(Ny * iL, -H1 * iL * self.inverse_c2, fz)

    def inertia(self) -> SX:
        """Force at B by acceleration of B, (3, 3), in base axes.

        In the leg's own axes it is diagonal: across it (I_x + m₂ s² + I_z tan² q₂) / L² and
        (I_y + m₂ s²) / L², with s from A to the rod's centre, and m₂ along it.
        """
        leg, L = self.leg, self.length
        tangent, s = self.s2 * self.inverse_c2, L - leg.centre_rod
        rod, square = leg.masses[1] * s * s, self.inverse_length * self.inverse_length
        about_x = (leg.inertia[0] + rod + leg.inertia[2] * tangent * tangent) * square
        about_y = (leg.inertia[1] + rod) * square
        y, z = self.axes[:, 1], self.axes[:, 2]
        # x xᵀ = 1 - y yᵀ - z zᵀ for the axis x, in which the motion about y moves B
        moved = (about_x - about_y) * y @ y.T + (leg.masses[1] - about_y) * z @ z.T
        return about_y * SX.eye(3) + moved


def inverse_dynamics() -> tuple[SX, SX]:
    """Inputs [quaternion wxyz, p, v, ω, a, α] (19) and the forces of the six actuators, N."""
    q, p, v, w, a, alpha = (
        SX.sym(n, 4 if n == "q" else 3) for n in ("q", "p", "v", "w", "a", "al")
    )
    R, body = rotation(q), Platform()
    states = [LegState(leg, R, p) for leg in legs()]
    inertia = R @ body.inertia @ R.T
    F = body.mass * (a - GRAVITY)
    M = inertia @ alpha + casadi.cross(w, inertia @ w)
    for state in states:
        turned = casadi.cross(w, state.arm)
        acceleration = a + casadi.cross(alpha, state.arm) + casadi.cross(w, turned)
        f = state.force(v + turned, acceleration)
        F, M = F + f, M + casadi.cross(state.arm, f)
    columns = [casadi.vertcat(s.direction, casadi.cross(s.arm, s.direction)) for s in states]
    forces = lu_solve(casadi.horzcat(*columns), casadi.vertcat(F, M))
    return casadi.vertcat(q, p, v, w, a, alpha), forces


def direct_dynamics() -> tuple[SX, SX]:
    """Inputs [quaternion wxyz, p, v, ω, Γ] (19) and the platform's accelerations (a, α)."""
    q, p, v, w, given = (
        SX.sym(n, k) for n, k in (("q", 4), ("p", 3), ("v", 3), ("w", 3), ("f", 6))
    )
    R, body = rotation(q), Platform()
    states = [LegState(leg, R, p) for leg in legs()]
    inertia = R @ body.inertia @ R.T
    F, M = -body.mass * GRAVITY, casadi.cross(w, inertia @ w)
    linear, mixed, angular = body.mass * SX.eye(3), SX(3, 3), inertia
    for k, state in enumerate(states):
        turned = casadi.cross(w, state.arm)
        f = state.force(v + turned, casadi.cross(w, turned)) - given[k] * state.direction
        F, M = F + f, M + casadi.cross(state.arm, f)
        own, arm = state.inertia(), casadi.skew(state.arm)
        turning = arm @ own
        linear, mixed, angular = linear + own, mixed + turning, angular - turning @ arm
    A = casadi.vertcat(casadi.horzcat(linear, mixed.T), casadi.horzcat(mixed, angular))
    accelerations = ldlt_solve(A, -casadi.vertcat(F, M))
    return casadi.vertcat(q, p, v, w, given), accelerations


def direct_kernel() -> Kernel:
    """The direct dynamics as a numpy function: (*batch, 19) -> (*batch, 6)."""
    x, accelerations = direct_dynamics()
    return Kernel("direct_dynamics", {"x": x}, accelerations, (6,))


def kernel() -> Kernel:
    """The inverse dynamics as a numpy function: (*batch, 19) -> (*batch, 6)."""
    x, forces = inverse_dynamics()
    return Kernel("inverse_dynamics", {"x": x}, forces, (6,))


def states(rows: int, seed: int = 0) -> np.ndarray:
    """Inputs near the middle of the workspace."""
    rng = np.random.default_rng(seed)
    q = np.c_[np.ones(rows), 0.1 * rng.normal(size=(rows, 3))]
    q /= np.linalg.norm(q, axis=1)[:, None]
    height = 1.1 + 0.1 * rng.normal(size=rows)
    return np.c_[q, 0.1 * rng.normal(size=(rows, 2)), height, rng.normal(size=(rows, 12))]
