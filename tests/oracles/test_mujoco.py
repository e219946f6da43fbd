"""Inertia and velocity forces of the tree against MuJoCo, and direct dynamics made of them.

MuJoCo holds its loops softly, so it is asked for the open tree only. The library's rates at a
closed state span the motions that the loops leave, and M and h are projected on them here.
"""

from __future__ import annotations

import casadi
import numpy as np
import pytest

from gough.robot import Robot, load
from gough.symbolic.lagrange import Lagrange

pytest.importorskip("mujoco")
from tests.oracles.mujoco_trees import MujocoTree
from tests.oracles.trees import Array

ROBOTS = ["gough-stewart", "3-rrr", "biped-leg", "four-bar"]
STATES = 24
AGREED = 1e-9


def lagrange(robot: Robot) -> casadi.Function:
    """Mass matrix and forces of the open tree, of (q, p, v, v̇), by automatic differentiation."""
    closure = robot.models.closure
    count = len(robot.structure.variables)
    v, vd = casadi.SX.sym("v", count), casadi.SX.sym("vd", count)
    found, gravity = Lagrange(closure), MujocoTree(robot).tree.gravity.tolist()
    outputs = [found.mass_matrix(), found.forces(v, vd, gravity)]
    return casadi.Function(
        "tree", [closure.q, closure.p, v, vd], list(map(casadi.densify, outputs))
    )


def require_close(found: Array, expected: Array) -> None:
    np.testing.assert_allclose(found, expected, rtol=0, atol=AGREED * np.abs(expected).max())


@pytest.mark.parametrize("name", ROBOTS)
def test_open_tree_against_lagrange(name):
    robot, rng = load(name), np.random.default_rng(4)
    peer, function = MujocoTree(robot), lagrange(robot)
    for _ in range(STATES):
        q = peer.tree.random_position(rng)
        v, vd = rng.normal(size=(2, peer.tree.rates))
        state = peer.state(q, v, vd)
        M, h = peer.mass_matrix_and_bias(state)
        mass_matrix, forces = (np.array(x) for x in function(q, robot.assembler.p, v, vd))
        require_close(state.S.T @ M @ state.S, mass_matrix)
        require_close(state.S.T @ (M @ state.a + h), forces.ravel())


@pytest.mark.parametrize("name", ROBOTS)
def test_direct_dynamics_with_projected_loops(name):
    """Gᵀ (M v̇ + h - τ) = 0 for the accelerations of the library, G the rates of unit motions."""
    robot, rng = load(name), np.random.default_rng(5)
    peer = MujocoTree(robot)
    found = [robot.assembler.wander(robot.home.q, rng, 0.1) for _ in range(STATES)]
    y, tau = len(robot.dynamics.independent()), len(robot.dynamics.motors)
    for q in (at for at in found if at is not None):
        rates, efforts = rng.normal(size=y), rng.normal(size=tau)
        yd = robot.direct_dynamics_joint(q, rates, efforts)
        q, v, vd = robot.dynamics.motion(q, rates, yd, "joint")
        units = np.broadcast_to(q, (y, len(q)))
        G = robot.dynamics.motion(units, np.eye(y), np.zeros((y, y)), "joint")[1].T
        state = peer.state(q, v, vd)
        M, h = peer.mass_matrix_and_bias(state)
        forces = peer.tree.efforts(efforts)
        own = state.S.T @ (M @ state.a + h) - forces
        size = np.abs(G).T @ (np.abs(state.S.T @ M @ state.S) @ np.abs(vd) + np.abs(forces))
        np.testing.assert_allclose(G.T @ own, np.zeros(y), rtol=0, atol=AGREED * size.max())
