"""Dynamics of the catalogue's gough-stewart by Pinocchio, called from Python.

Pinocchio takes rates of every joint of the tree and gives forces along them. What it does not know
stands around it here in numpy, written for this robot: joints, their rates and accelerations from
those of the platform, and forces of passive joints brought to the motors. All of it takes batches;
Pinocchio is called row by row.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

import gough
from tests.oracles.pinocchio_trees import PinocchioTree

Array = NDArray[np.float64]
LEGS = 6


@dataclass
class Legs:
    """Six legs that run along d = L u from A to B; their joints are rx, ry and L.

    With c = L cos(ry) and X, Y, u the axes of the leg, the rates of the joints for a velocity of B
    are those of the rows (-Y / c, X / L, u).
    """

    arms: Array
    """From the platform's origin to B, (..., 6, 3)."""
    d: Array

    def __post_init__(self) -> None:
        dx, dy, dz = self.d[..., 0], self.d[..., 1], self.d[..., 2]
        across = dy * dy + dz * dz
        self.c, self.L = np.sqrt(across), np.sqrt(across + dx * dx)
        self.position = np.empty(self.d.shape)
        self.position[..., 0] = np.arctan2(-dy, dz)
        self.position[..., 1] = np.arctan2(dx, self.c)
        self.position[..., 2] = self.L
        s1, c1, self.s2, self.c2 = -dy / self.c, dz / self.c, dx / self.L, self.c / self.L
        slope = self.s2 / self.L
        self.rows = np.zeros((*self.d.shape, 3))
        self.rows[..., 0, 1], self.rows[..., 0, 2] = -c1 / self.c, -s1 / self.c
        self.rows[..., 1, 0] = self.c2 / self.L
        self.rows[..., 1, 1], self.rows[..., 1, 2] = s1 * slope, -c1 * slope
        self.rows[..., 2, :] = self.d / self.L[..., None]

    def rates(self, velocity: Array) -> Array:
        """Rates for velocities of B, both (..., 6, 3)."""
        return np.asarray((self.rows @ velocity[..., None])[..., 0])

    def accelerations(self, rates: Array, acceleration: Array) -> Array:
        """Accelerations for those of B, (..., 6, 3)."""
        found = self.rates(acceleration)
        first, second = rates[..., 0], rates[..., 1]
        twice = 2 * rates[..., 2] / self.L
        found[..., 0] += first * (2 * second * self.s2 / self.c2 - twice)
        found[..., 1] -= twice * second + first * first * self.s2 * self.c2
        found[..., 2] += self.L * ((first * self.c2) ** 2 + second * second)
        return found


@dataclass
class State:
    """The platform, its legs, and Pinocchio's positions and rates."""

    R: Array
    W: Array
    """W r = ω × r."""
    legs: Legs
    rates: Array
    q: Array
    v: Array


class PinocchioSixUps:
    """Inverse and direct dynamics of gough-stewart, as those of `gough.Robot`."""

    def __init__(self, robot: gough.Robot) -> None:
        self.peer = PinocchioTree(robot)
        self.model, self.data = self.peer.model, self.peer.data
        tree = self.peer.tree
        self.B = np.array([part.T_body_frame[1][:3, 3] for part in tree.closings])
        feet = [link for link in tree.links if len(link.motions) == 2]
        self.A = np.array([link.T_parent_joint[:3, 3] for link in feet])
        self.contacts = self.peer.contacts
        self.settings = pin.ProximalSettings(1e-14, 0.0, 1)

    def state(self, x: Array, xd: Array) -> State:
        """Everything but accelerations."""
        batch, v = x.shape[:-1], xd[..., None, :3]
        R, W = _rotation(x), _skew(xd[..., 3:])
        RT = np.swapaxes(R, -1, -2)
        arms = self.B @ RT
        legs = Legs(arms, x[..., None, :3] + arms - self.A)
        rates = legs.rates(v + arms @ np.swapaxes(W, -1, -2))
        q, own = np.empty((*batch, 7 + 3 * LEGS)), np.empty((*batch, 6 + 3 * LEGS))
        q[..., :3], q[..., 3:6], q[..., 6] = x[..., :3], x[..., 4:], x[..., 3]
        q[..., 7:] = legs.position.reshape(*batch, 3 * LEGS)
        own[..., :6] = (xd.reshape(*batch, 2, 3) @ R).reshape(*batch, 6)
        own[..., 6:] = rates.reshape(*batch, 3 * LEGS)
        return State(R, W, legs, rates, q, own)

    def accelerations(self, state: State, xd: Array, xdd: Array) -> Array:
        """Pinocchio's accelerations."""
        batch, WT = xdd.shape[:-1], np.swapaxes(state.W, -1, -2)
        arms = state.legs.arms
        turned = arms @ (np.swapaxes(_skew(xdd[..., 3:]), -1, -2) + WT @ WT)
        legs = state.legs.accelerations(state.rates, xdd[..., None, :3] + turned)
        free = xdd.reshape(*batch, 2, 3) @ state.R
        free[..., 0, :] -= (xd[..., None, :3] @ WT @ state.R)[..., 0, :]
        found = np.empty((*batch, 6 + 3 * LEGS))
        found[..., :6], found[..., 6:] = free.reshape(*batch, 6), legs.reshape(*batch, 3 * LEGS)
        return found

    def inverse(self, x: Array, xd: Array, xdd: Array) -> Array:
        """Efforts of the motors."""
        state = self.state(x, xd)
        return self.efforts(state, self.forces(state, self.accelerations(state, xd, xdd)))

    def forces(self, state: State, a: Array) -> Array:
        """Forces along the rates of the tree, by `rnea`."""
        if a.ndim == 1:
            return np.asarray(pin.rnea(self.model, self.data, state.q, state.v, a))
        rows = zip(state.q, state.v, a, strict=True)
        return np.array([pin.rnea(self.model, self.data, *row) for row in rows])

    def efforts(self, state: State, forces: Array) -> Array:
        """Τ of the slides + J⁻ᵀ (wrench of platform and passive joints)."""
        batch, legs = forces.shape[:-1], state.legs
        own = forces[..., 6:].reshape(*batch, LEGS, 3)
        passive = (own[..., None, :2] @ legs.rows[..., :2, :])[..., 0, :]
        wrench = (forces[..., :6].reshape(*batch, 2, 3) @ np.swapaxes(state.R, -1, -2)).reshape(
            *batch, 6
        )
        wrench[..., :3] += passive.sum(axis=-2)
        wrench[..., 3:] += _cross(legs.arms, passive).sum(axis=-2)
        JT, u = np.empty((*batch, 6, LEGS)), legs.rows[..., 2, :]
        JT[..., :3, :] = np.swapaxes(u, -1, -2)
        JT[..., 3:, :] = np.swapaxes(_cross(legs.arms, u), -1, -2)
        return np.asarray(own[..., 2] + np.linalg.solve(JT, wrench[..., None])[..., 0])

    def direct(self, x: Array, xd: Array, tau: Array) -> Array:
        """Accelerations of the platform."""
        state = self.state(x, xd)
        forces = self.of_motors(tau)
        if x.ndim == 1:
            a = self.constrained(state.q, state.v, forces)[:6]
        else:
            rows = zip(state.q, state.v, forces, strict=True)
            a = np.array([self.constrained(*row)[:6] for row in rows])
        found = (a.reshape(*x.shape[:-1], 2, 3) @ np.swapaxes(state.R, -1, -2)).reshape(xd.shape)
        found[..., :3] += (state.W @ xd[..., :3, None])[..., 0]
        return np.asarray(found)

    @staticmethod
    def of_motors(tau: Array) -> Array:
        """Efforts as forces along the rates of the tree."""
        forces = np.zeros((*tau.shape[:-1], 6 + 3 * LEGS))
        forces[..., 8::3] = tau
        return forces

    def constrained(self, q: Array, v: Array, forces: Array) -> Array:
        """Accelerations of the tree by `constraintDynamics` with six points that coincide."""
        return pin.constraintDynamics(  # type: ignore[no-any-return]
            self.model, self.data, q, v, forces, *self.contacts, self.settings
        )


def _rotation(x: Array) -> Array:
    """R of a pose, (..., 3, 3)."""
    if x.ndim == 1:
        w, i, j, k = x[3:].tolist()
        return np.asarray(pin.Quaternion(w, i, j, k).toRotationMatrix())
    w, r = x[:, 3, None, None], _skew(x[:, 4:])
    return np.asarray(np.eye(3) + 2 * w * r + 2 * r @ r)


def _skew(r: Array) -> Array:
    """[r]×, (..., 3, 3)."""
    if r.ndim == 1:
        return np.asarray(pin.skew(r))
    out = np.zeros((len(r), 3, 3))
    x, y, z = r.T
    out[:, 0, 1], out[:, 0, 2], out[:, 1, 2] = -z, y, -x
    return out - np.swapaxes(out, -1, -2)


def _cross(a: Array, b: Array) -> Array:
    """Faster than `numpy.cross` on a few rows."""
    found = np.empty(b.shape)
    for k, i, j in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        found[..., k] = a[..., i] * b[..., j] - a[..., j] * b[..., i]
    return found
