"""Derivatives of dynamics against differences and against each other."""

import numpy as np
import pytest

from gough.description import Mechanism
from gough.errors import ConfigurationError
from gough.geometry.coordinates import Coordinates
from gough.robot import Robot, load

STEP = 1e-5


def moved(robot, x, direction, size):
    """Operational coordinates a small motion further."""
    model = robot.dynamics.model("platform")
    q = Coordinates(robot.models, "operational").put(robot.home.q, x)
    rates = np.zeros(len(robot.structure.variables))
    rates[robot.structure.columns("operational")] = direction
    return model.outputs.of(robot.models.retract(q, size * rates))


@pytest.mark.parametrize("name", ["orthoglide", "gough-stewart", "3-rrr", "3-rps"])
def test_derivatives_are_limits_of_differences(name):
    robot, rng = load(name), np.random.default_rng(2)
    count = len(robot.structure.columns("operational"))
    x, xd, xdd = robot.home.x, *rng.normal(size=(2, count))
    tau = robot.inverse_dynamics(x, xd, xdd)
    inverse = robot.dynamics_derivatives.inverse(x, xd, xdd)
    direct = robot.dynamics_derivatives.direct(x, xd, tau)
    for found, function, given in (
        (inverse, robot.inverse_dynamics, xdd),
        (direct, robot.direct_dynamics, tau),
    ):
        for k, e in enumerate(np.eye(count)):
            ends = [function(moved(robot, x, e, s), xd, given) for s in (STEP, -STEP)]
            check(found.by_position[:, k], ends, found.by_position)
            ends = [function(x, xd + s * e, given) for s in (STEP, -STEP)]
            check(found.by_rates[:, k], ends, found.by_rates)
            ends = [function(x, xd, given + s * e) for s in (STEP, -STEP)]
            check(found.by_input[:, k], ends, found.by_input)


def check(derivative, ends, whole):
    difference = (ends[0] - ends[1]) / (2 * STEP)
    np.testing.assert_allclose(derivative, difference, rtol=0, atol=1e-6 * np.abs(whole).max())


@pytest.mark.parametrize("name", ["gough-stewart", "five-bar"])
def test_inverse_and_direct_derivatives_undo_each_other(name):
    """τ(ẍ(τ)) = τ: ∂τ/∂ẍ ∂ẍ/∂τ = 1 and ∂τ/∂x + ∂τ/∂ẍ ∂ẍ/∂x = 0."""
    robot, rng = load(name), np.random.default_rng(3)
    count = len(robot.structure.columns("operational"))
    x = robot.home.x
    xd, xdd = rng.normal(size=(2, 4, count))
    tau = robot.inverse_dynamics(x, xd, xdd)
    inverse = robot.dynamics_derivatives.inverse(x, xd, xdd)
    direct = robot.dynamics_derivatives.direct(x, xd, tau)
    one = inverse.by_input @ direct.by_input
    np.testing.assert_allclose(one, np.broadcast_to(np.eye(count), one.shape), atol=1e-10)
    for part in ("by_position", "by_rates"):
        left = getattr(inverse, part) + inverse.by_input @ getattr(direct, part)
        scale = np.abs(getattr(inverse, part)).max()
        np.testing.assert_allclose(left, 0, atol=1e-10 * scale)


def test_derivatives_in_joint_space_keep_the_loops_closed():
    robot, rng = load("four-bar"), np.random.default_rng(4)
    q, v, a = robot.home.q, rng.normal(size=1), rng.normal(size=1)
    found = robot.dynamics_derivatives.inverse(q, v, a, space="joint")
    angle = robot.structure.columns("actuated")[0]
    start = robot.models.closure.slices[robot.structure.variables[angle].edge].start
    ends = [robot.inverse_dynamics_joint(robot.state([q[start] + s]), v, a) for s in (STEP, -STEP)]
    check(found.by_position[:, 0], ends, found.by_position)


def test_derivatives_by_live_parameters():
    content = load("3-rrr").mechanism.model_dump(exclude_unset=True)
    content["parameters"]["l1"] |= {"live": True}
    content["parameters"]["load"] = {"value": 1.5, "live": True}
    content["bodies"]["platform"]["mass"] = "load"
    mechanism = Mechanism.model_validate(content)
    rng = np.random.default_rng(5)
    robot = Robot(mechanism)
    x, xd, xdd = robot.home.x, *rng.normal(size=(2, 3))
    found = robot.dynamics_derivatives.inverse(x, xd, xdd)
    assert set(found.parameters) == {"l1", "load"}
    for k, name in enumerate(found.parameters):
        value = float(content["parameters"][name]["value"])
        ends = [
            Robot(mechanism, live={name: value + s}).inverse_dynamics(x, xd, xdd)
            for s in (STEP, -STEP)
        ]
        check(found.by_parameters[:, k], ends, found.by_parameters)


def test_what_has_no_inverse_has_no_derivative():
    robot = load("4-rpr")
    with pytest.raises(ConfigurationError, match="not independent"):
        robot.dynamics_derivatives.inverse(robot.home.x, np.zeros(3), np.zeros(3))
