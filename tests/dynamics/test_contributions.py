"""Contributions of legs: the orthoglide's numbers, and sums on robots of the catalogue."""

import json
from pathlib import Path

import numpy as np
import pytest

from gough import load
from gough.description import Mechanism
from gough.dynamics.contributions import REST, Contributions, leg_contributions, parts_of
from gough.errors import ConfigurationError, UnknownName
from gough.topology import Structure

DATA = json.loads((Path(__file__).parents[1] / "data" / "orthoglide.json").read_text("utf-8"))
CASES = DATA["cases"]
BODY_5 = DATA["params"]["bodies"]["5"]["mass"]
GRAVITY = np.array(DATA["params"]["g"])
ROBOTS = [
    "orthoglide",
    "gough-stewart",
    "delta",
    "tricept",
    "4-rpr",
    "3-upu",
    "par4",
    "deployable-hexapod+massive-legs",
    "3-rrr",
]


def reference(key):
    return np.array([case[key] for case in CASES])


def close_to(actual, expected, tolerance=1e-10):
    scale = max(1.0, float(np.abs(expected).max(initial=0.0)))
    np.testing.assert_allclose(actual, expected, rtol=0, atol=tolerance * scale)


# the orthoglide; body 5 of each leg is part of the platform in the catalogue


@pytest.fixture(scope="module")
def glide():
    contributions = Contributions(load("orthoglide").dynamics)
    return contributions.at(reference("P"), reference("V"), reference("A"))


def test_orthoglide_forces_of_legs(glide):
    J = reference("Jinv_legs")
    expected = np.einsum("clki,clk->cli", J, reference("H_legs"))
    with_body_5 = glide.forces[:, :3] + BODY_5 * (reference("A") - GRAVITY)[:, None]
    close_to(with_body_5, expected)
    bias = np.einsum("clki,clk->cli", J, reference("h_legs"))
    J_x = np.einsum("clki,clkj,cljm->clim", J, reference("A_legs"), J)
    bias -= np.einsum("clim,clm->cli", J_x, reference("Jdot_qdot"))
    close_to(glide.bias[:, :3] - BODY_5 * GRAVITY, bias)
    close_to(glide.inertia[:, :3] + BODY_5 * np.eye(3), J_x)


def test_orthoglide_sums_are_the_robot(glide):
    assert glide.parts == ("leg1", "leg2", "leg3", "platform")
    close_to(glide.total_inertia, reference("A_robot"))
    close_to(glide.total_bias, reference("h_robot"))
    close_to(glide.total_efforts, reference("Gamma"))


def test_orthoglide_platform_is_a_mass(glide):
    mass = DATA["params"]["Mp"] + 3 * BODY_5
    platform = glide.only("platform")
    close_to(platform.forces[:, 0], mass * (reference("A") - GRAVITY))
    close_to(platform.velocity, 0 * platform.velocity)
    close_to(platform.gravity[:, 0], np.tile(-mass * GRAVITY, (24, 1)))


# laws


@pytest.fixture(scope="module", params=ROBOTS)
def motion(request):
    """A robot, and motions of its outputs near home."""
    name, *variants = request.param.split("+")
    robot = load(name, variants=variants)
    rng = np.random.default_rng(3)
    inverse = robot.dynamics.inverse_geometry
    found = []
    while len(found) < 4:
        q = robot.assembler.wander(robot.home.q, rng, 0.1)
        if q is not None and inverse.solve(inverse.coordinates.of(q)).reached:
            found.append(inverse.coordinates.of(q))
    outputs = len(robot.structure.columns("operational"))
    return robot, np.array(found), rng.normal(size=(2, 4, outputs))


def test_parts_add_up_to_the_robot(motion):
    robot, x, (xd, xdd) = motion
    dynamics = robot.dynamics
    found = Contributions(dynamics).at(x, xd, xdd)
    q, v, vd = dynamics.motion(x, xd, xdd)
    y = list(dynamics.model("platform").independent)
    kernel = dynamics.model("platform").kernel("forces", "q")
    close_to(found.total_forces, kernel(q, *dynamics._parameters, v[..., y], vd[..., y]), 1e-9)
    close_to(found.total_inertia, dynamics.mass_matrix(x), 1e-9)
    close_to(found.inertia, np.swapaxes(found.inertia, -1, -2))
    known = dynamics.inverse(x, xd, xdd)
    if found.efforts is not None:
        close_to(found.total_efforts[known.solved], known.efforts[known.solved], 1e-8)


def test_every_body_and_motor_is_in_one_part(motion):
    structure = motion[0].structure
    parts = parts_of(structure)
    bodies = [body for part in parts for body in part.bodies]
    ground = [] if structure.mechanism.floating else [structure.mechanism.base]
    assert sorted(bodies + ground) == sorted({*structure.flat.bodies, *ground})
    joints = [joint for part in parts for joint in part.joints]
    assert len(joints) == len(set(joints))
    motors = {
        name for name, joint in structure.flat.joints.items() if joint.motor or joint.actuators
    }
    assert motors <= set(joints)


def test_gravity_may_be_given_and_a_batch_is_its_rows(motion):
    robot, x, (xd, xdd) = motion
    contributions = Contributions(robot.dynamics)
    gravity = np.array([1.0, 2.0, -3.0])
    found = contributions.at(x, xd, xdd, gravity)
    alone = contributions.at(x[2], xd[2], xdd[2], gravity)
    close_to(alone.forces, found.forces[2])
    twice = contributions.at(x, xd, xdd, 2 * gravity)
    close_to(twice.gravity, 2 * found.gravity)
    close_to(twice.velocity, found.velocity)


def test_joint_space():
    robot = load("2rpr")
    dynamics = robot.dynamics
    v, a = np.random.default_rng(4).normal(size=(2, len(dynamics.independent("joint"))))
    found = Contributions(dynamics).at(robot.home.q, v, a, space="joint")
    kernel = dynamics.model("joint").kernel("forces", "q")
    close_to(found.total_forces, kernel(robot.home.q, v, a))
    close_to(found.total_efforts, dynamics.inverse_joint(robot.home.q, v, a).efforts)


def test_a_floating_base_is_the_rest():
    content = load("biped-leg").mechanism.model_dump(exclude_unset=True)
    structure = Structure(Mechanism.model_validate(content | {"platform": "foot"}))
    parts = {part.name: part for part in parts_of(structure)}
    assert structure.mechanism.base in parts[REST].bodies


def test_results_print_and_travel():
    case = CASES[1]
    found = leg_contributions(load("orthoglide").dynamics, case["P"], case["V"], case["A"])
    text = str(found)
    assert "leg2" in text
    assert "total" in text
    assert json.loads(json.dumps(found.as_dict()))["parts"][-1] == "platform"
    with pytest.raises(UnknownName, match="leg2"):
        found.only("leg4")


def test_a_mechanism_without_platform_has_no_legs():
    with pytest.raises(ConfigurationError, match="no platform"):
        parts_of(load("four-bar").structure)
