"""Platforms whose energy of rotation is a formula in their rotation vector."""

import json
from pathlib import Path

import casadi
import numpy as np
import pytest
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

from gough.description import Mechanism
from gough.errors import ConfigurationError, DescriptionError
from gough.formats.native import Source
from gough.robot import Robot, load
from gough.symbolic.trees.rotations import ShortRotation, Turning, rotation_vector

DATA = json.loads((Path(__file__).parents[1] / "data" / "hexapod.json").read_text("utf-8"))
MODELS = {"exact": (), "truncated": ("truncated",), "as_printed": ("as-printed",)}


def close_to(found, expected, tolerance=1e-10):
    np.testing.assert_allclose(found, expected, rtol=0, atol=tolerance * np.abs(expected).max())


def hat(v):
    return np.cross(np.eye(3), v)


def left_jacobian(phi):
    """∫ exp(s φ̂) ds, from one exponential of a larger matrix."""
    block = np.zeros((6, 6))
    block[:3, :3], block[:3, 3:] = hat(phi), np.eye(3)
    return expm(block)[:3, 3:]


def jacobian_rate(phi, phid):
    h = 1e-5
    steps = [left_jacobian(phi + k * h * phid) for k in (-2, -1, 1, 2)]
    return (steps[0] - 8 * steps[1] + 8 * steps[2] - steps[3]) / (12 * h)


SIZES = (0.0, 1e-300, 1e-160, 1e-12, 1e-6, 1e-3, 0.1, 1.0, 2.0, 3.0, 3.1415, np.pi - 1e-9)


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("sign", [1, -1])
def test_rotation_vectors_of_both_quaternions(size, sign):
    phi = size * np.array([2.0, -1.0, 2.0]) / 3
    w = np.cos(size / 2)
    v = np.sinc(size / 2 / np.pi) / 2 * phi
    q = [float(sign * x) for x in (w, *v)]
    np.testing.assert_allclose(rotation_vector(q), phi, rtol=4e-16 * 8, atol=0)
    x = casadi.SX.sym("q", 4)
    found = casadi.Function("f", [x], [casadi.vertcat(*rotation_vector([x[k] for k in range(4)]))])
    np.testing.assert_allclose(np.array(found(q)).ravel(), phi, rtol=4e-16 * 8, atol=0)
    slope = casadi.Function("g", [x], [casadi.jacobian(found(x), x)])
    assert np.isfinite(np.array(slope(q))).all()


@pytest.mark.parametrize("size", SIZES)
def test_rates_of_the_rotation_vector(size):
    rng = np.random.default_rng(1)
    phi = size * np.array([2.0, -1.0, 2.0]) / 3
    J = left_jacobian(phi)
    turning = Turning.at(tuple(phi))
    phid, phidd, force = rng.normal(size=(3, 3))
    omega = J @ phid
    close_to(turning.rates(tuple(omega)), phid, 1e-14)
    close_to(turning.moment(tuple(force)), np.linalg.solve(J.T, force), 1e-14)
    alpha = J @ phidd + jacobian_rate(phi, phid) @ phid
    close_to(turning.changes(tuple(phid), tuple(omega), tuple(alpha)), phidd, 1e-9)


def test_forces_are_lagranges():
    """d/dt ∂T/∂φ̇ - ∂T/∂φ of the energy, for any inertia."""
    rng = np.random.default_rng(2)
    inertia = rng.normal(size=(3, 3))
    inertia = tuple(map(tuple, inertia @ inertia.T))
    phi, phid, phidd = (casadi.SX.sym(n, 3) for n in ("phi", "phid", "phidd"))

    def three(x):
        return x[0], x[1], x[2]

    for kappa in (0.5, 1.0):
        body = ShortRotation(inertia, kappa)
        T = body.energy(three(phi), three(phid))
        p = casadi.gradient(T, phid)
        expected = casadi.jtimes(p, phi, phid) + casadi.jtimes(p, phid, phidd)
        expected -= casadi.gradient(T, phi)
        found = casadi.vertcat(*body.forces(three(phi), three(phid), three(phidd)))
        both = casadi.Function("f", [phi, phid, phidd], [found, expected])
        a, b = both(*rng.normal(size=(3, 3)))
        close_to(np.array(a), np.array(b), 1e-14)


# the reference


@pytest.fixture(scope="module")
def robots():
    return {model: load("deployable-hexapod", variants=names) for model, names in MODELS.items()}


def pose(v, sign=1.0):
    x, y, z, w = sign * Rotation.from_rotvec(v[3:]).as_quat()
    return np.array([*v[:3], w, x, y, z])


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("k", range(len(DATA["states"])))
def test_states_of_the_reference(robots, model, sign, k):
    """Rates of the reference are (u̇, φ̇), ours (u̇, ω): ω = J φ̇, and forces along φ are Jᵀ ours."""
    robot, state = robots[model], DATA["states"][k]
    expected, v, vdot = state[model], np.array(state["v"]), np.array(state["vdot"])
    x, omega = pose(v, sign), np.array(state["omega"])
    twist = np.r_[vdot[:3], omega]
    J = np.eye(6)
    J[3:, 3:] = left_jacobian(v[3:])
    turning = np.array(state["omega_dot_exact"]) - J[3:, 3:] @ np.array(state["exact"]["vddot"][3:])
    close_to(J[3:, 3:] @ vdot[3:], omega, 1e-12)

    vddot = np.array(expected["vddot"])
    acceleration = np.r_[vddot[:3], J[3:, 3:] @ vddot[3:] + turning]
    forces = np.array(state["R"]) - state["stop_force"]
    close_to(robot.direct_dynamics(x, twist, forces), acceleration)
    close_to(robot.inverse_dynamics(x, twist, acceleration), forces)
    A = robot.mass_matrix(x)
    close_to(J.T @ A @ J, expected["M"])
    bias = J.T @ (robot.bias(x, twist) + A @ np.r_[0, 0, 0, turning])
    close_to(bias, expected["bias"])
    kinetic, _ = robot.energy(x, twist)
    np.testing.assert_allclose(kinetic - state["T_reels"], expected["T_platform"], rtol=1e-10)


@pytest.mark.parametrize("model", ["truncated", "as_printed"])
def test_laws(robots, model):
    robot = robots[model]
    check = robot.check_dynamics(states=5)
    assert check.passed, str(check)
    assert any("Lagrange" in law.name for law in check.laws)


@pytest.mark.parametrize("model", ["truncated", "as_printed"])
def test_contributions_add_up(robots, model):
    robot, state = robots[model], DATA["states"][5]
    x = pose(np.array(state["v"]))
    twist = np.r_[state["vdot"][:3], state["omega"]]
    found = robot.leg_contributions(x, twist, twist)
    close_to(found.total_inertia, robot.mass_matrix(x), 1e-12)
    close_to(found.total_bias, robot.bias(x, twist), 1e-12)


@pytest.mark.parametrize("model", ["truncated", "as_printed"])
def test_reactions_balance_the_platform(robots, model):
    """The wrenches at the tips of the legs are what moves the platform."""
    robot, state = robots[model], DATA["states"][5]
    x = pose(np.array(state["v"]))
    twist = np.r_[state["vdot"][:3], state["omega"]]
    acceleration = np.linspace(1, 2, 6)
    found = robot.reaction(x, twist, acceleration)
    tips = [name for name in found.joints if name.endswith("tip")]
    force = sum(found.of(tip)[:3] for tip in tips)
    close_to(force, 3.5 * acceleration[:3], 1e-9)
    at = {f"leg{i + 1}.tip": np.array(a) for i, a in enumerate(DATA["derived"]["A"])}
    R = Rotation.from_rotvec(state["v"][3:]).as_matrix()
    moment = sum(np.cross(R @ at[tip], found.of(tip)[:3]) for tip in tips)
    platform = robot.leg_contributions(x, twist, acceleration).only("platform")
    close_to(moment, platform.forces[0, 3:], 1e-9)


def test_derivatives_of_a_live_mass_are_those_of_differences():
    robot = load("deployable-hexapod", variants=("truncated", "live"))
    at = pose(np.array(DATA["states"][3]["v"]))
    found = robot.dynamics_derivatives.inverse(at, np.ones(6), np.ones(6))
    k = found.parameters.index("mass")
    h = 1e-4
    ends = [
        Robot(robot.mechanism, live={"mass": 3.5 + d}).inverse_dynamics(at, np.ones(6), np.ones(6))
        for d in (-h, h)
    ]
    close_to(found.by_parameters[:, k], (ends[1] - ends[0]) / (2 * h), 1e-8)


def test_identification_is_refused(robots):
    with pytest.raises(ConfigurationError, match="rotation: exact"):
        _ = robots["truncated"].identification


def test_any_inertia_and_a_free_body():
    """A body alone in space, all entries of its inertia, moments by hand."""
    body = {
        "mass": 2,
        "inertia": [1, 2, 2.5, 0.1, -0.2, 0.3],
        "free": "all",
        "rotation": "truncated",
    }
    robot = Robot(
        Mechanism(
            name="stone",
            bodies={"stone": body},
            joints={"nothing": {"type": "free", "bodies": ["base", "stone"]}},
            platform="stone",
            operational=["x", "y", "z", "rx", "ry", "rz"],
        )
    )
    x = pose(np.array([0, 0, 0, 0.3, -0.2, 0.5]))
    assert robot.check_dynamics(states=5).passed
    I = np.array([[1, 0.1, -0.2], [0.1, 2, 0.3], [-0.2, 0.3, 2.5]])
    J, P = left_jacobian([0.3, -0.2, 0.5]), hat([0.3, -0.2, 0.5])
    M = I - 0.5 * (I @ P - P @ I)
    expected = np.linalg.inv(J).T @ M @ np.linalg.inv(J)
    close_to(robot.mass_matrix(x)[3:, 3:], expected)


# what is refused

TEXT = """\
name: plate
{top}
bodies:
  plate: {{mass: 1, inertia: [1, 1, 1], {more}}}
platform: {platform}
joints: {joints}
"""


@pytest.mark.parametrize(
    ("more", "top", "platform", "joints", "words"),
    [
        (
            "rotation: truncated",
            "",
            "null",
            "{a: {type: spherical, bodies: [base, plate]}}",
            "none",
        ),
        ("rotation: truncated, free: [x, rz]", "", "plate", "{}", "moves in x, rz"),
        ("rotation: as_printed", "motion: planar", "plate", "{}", "moves in x, y, rz"),
        ("rotation: as_printed, com: [0, 0, 0.1]", "", "plate", "{}", "centre of mass"),
        ("rotation: truncated", "floating: true", "plate", "{}", "floats"),
        ("rotation: cut", "", "plate", "{}", "'exact', 'truncated' or 'as_printed'"),
    ],
)
def test_other_uses_are_refused(more, top, platform, joints, words):
    text = TEXT.format(more=more, top=top, platform=platform, joints=joints)
    with pytest.raises(DescriptionError, match=words) as caught:
        Source(text.encode(), "plate.yaml").mechanism()
    assert caught.value.problems[0].line == 4
    assert "rotation" in caught.value.problems[0].path
