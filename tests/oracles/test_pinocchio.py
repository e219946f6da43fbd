"""Direct dynamics against Pinocchio, at random closed states."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from gough.robot import Robot, load

pytest.importorskip("pinocchio")
from tests.oracles.pinocchio_trees import PinocchioTree
from tests.oracles.trees import Array

STATES = 24
REACH = 0.1
"""How far from home states are, m and rad, or as for `Assembler.wander`."""
AGREED = 1e-8

BY_PLATFORM = ["gough-stewart", "delta", "delta-parallelogram", "orthoglide", "3-rrr", "five-bar"]
BY_JOINTS = ["biped-leg", "gough-stewart", "four-bar", "slider-crank"]
OF_PINOCCHIO = ["gough-stewart", "delta"]
"""Robots whose closings Pinocchio has: points that coincide."""


@dataclass(frozen=True)
class Sample:
    """Closed states of a robot, its efforts, and all that the library says of its motion."""

    q: Array
    v: Array
    tau: Array
    vd: Array


def by_platform(robot: Robot, rng: np.random.Generator) -> Sample:
    """States x, ẋ, τ and the accelerations that `direct_dynamics` gives."""
    outputs, motors = (len(robot.structure.columns(r)) for r in ("operational", "actuated"))
    x = robot.home.x + REACH * rng.uniform(-1, 1, size=(STATES, len(robot.home.x)))
    if x.shape[1] == 7:
        x[:, 3:] /= np.linalg.norm(x[:, 3:], axis=1, keepdims=True)
    x = x[robot.reach(x).reached]
    assert len(x) > STATES / 2
    xd, tau = rng.normal(size=(len(x), outputs)), 20 * rng.normal(size=(len(x), motors))
    xdd = robot.direct_dynamics(x, xd, tau)
    q, v, vd = robot.dynamics.motion(x, xd, xdd)
    return Sample(q, v, tau, vd)


def by_joints(robot: Robot, rng: np.random.Generator) -> Sample:
    """States q, y, τ and the accelerations that `direct_dynamics_joint` gives."""
    found = [robot.assembler.wander(robot.home.q, rng, REACH) for _ in range(STATES)]
    q = np.array([at for at in found if at is not None])
    assert len(q) > STATES / 2
    y = rng.normal(size=(len(q), len(robot.dynamics.independent())))
    tau = rng.normal(size=(len(q), len(robot.dynamics.motors)))
    yd = robot.direct_dynamics_joint(q, y, tau)
    return Sample(
        *robot.dynamics.motion(q, y, yd, "joint")[:2], tau, _accelerations(robot, q, y, yd)
    )


def _accelerations(robot: Robot, q: Array, y: Array, yd: Array) -> Array:
    return robot.dynamics.motion(q, y, yd, "joint")[2]


def require_agreement(robot: Robot, sample: Sample, constrained: bool = False) -> None:
    """Accelerations of the whole tree, by their largest in the state."""
    peer = PinocchioTree(robot)
    for q, v, tau, vd in zip(sample.q, sample.v, sample.tau, sample.vd, strict=True):
        state = peer.state(q, v, vd)
        found = peer.constrained(state, tau) if constrained else peer.projected(state, tau)
        np.testing.assert_allclose(found, state.a, rtol=0, atol=AGREED * np.abs(state.a).max())


@pytest.mark.parametrize("name", BY_PLATFORM)
def test_direct_dynamics_of_outputs(name):
    robot = load(name)
    require_agreement(robot, by_platform(robot, np.random.default_rng(1)))


@pytest.mark.parametrize("name", BY_JOINTS)
def test_direct_dynamics_of_joints(name):
    robot = load(name)
    require_agreement(robot, by_joints(robot, np.random.default_rng(2)))


@pytest.mark.parametrize("name", OF_PINOCCHIO)
def test_direct_dynamics_by_its_own_constraints(name):
    robot = load(name)
    require_agreement(robot, by_platform(robot, np.random.default_rng(3)), constrained=True)
