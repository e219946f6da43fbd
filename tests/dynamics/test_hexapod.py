"""The deployable hexapod against its reference: reels, massive legs, feet of both kinds."""

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gough.description import Mechanism
from gough.robot import Robot, load

DATA = json.loads((Path(__file__).parents[1] / "data" / "hexapod.json").read_text("utf-8"))
LEGS = DATA["massive_legs"]


AXES = {
    "radial": [["z", "b"]],
    "tangent": [["z", "b"], ["z", "pi/2"]],
    "vertical": [["z", "b"], ["y", "-pi/2"]],
}
"""Turns that point x, the first axis of the foot, along n1."""
HOMES = {
    "radial": ["first", "second"],
    "tangent": ["atan2(radial, z)", "atan2(tangential, z)"],
    "vertical": [0, "atan2(z, -radial)"],
}


def hexapod(n1="radial", foot="universal", massless=False):
    """The catalogue's robot with other feet or legs."""
    content = load("deployable-hexapod").mechanism.model_dump(exclude_unset=True)
    leg = content["legs"]["leg"]
    joint = leg["joints"]["foot"]
    joint["type"], joint["home"] = foot, HOMES[n1] if foot == "universal" else None
    joint["frames"][0]["rotate"] = AXES[n1]
    joint["frames"][0].pop("offset")
    joint["frames"][0]["point"] = ["R*cos(b)", "R*sin(b)", 0]
    leg["joints"]["tip"].pop("home")
    if massless:
        for body in leg["bodies"].values():
            body["mass"], body["inertia"] = 0, [0, 0, 0]
    return Robot(Mechanism.model_validate(content))


def pose(v):
    x, y, z, w = Rotation.from_rotvec(v[3:]).as_quat()
    return np.array([*v[:3], w, x, y, z])


def close_to(found, expected, tolerance=1e-10):
    scale = np.abs(expected).max()
    np.testing.assert_allclose(found, expected, rtol=0, atol=tolerance * scale)


@pytest.mark.parametrize("case", LEGS["cases"], ids=lambda case: case["n1"])
def test_massive_legs_on_universal_feet(case):
    robot = hexapod(case["n1"])
    x, twist = pose(case["v"]), np.array(case["udot"] + case["omega"])
    found = robot.dynamics.direct(x, twist, case["axial_force"], near=near(robot, x))
    assert found.solved
    close_to(found.accelerations, case["nudot_U"])
    efforts = robot.dynamics.inverse(x, twist, case["nudot_U"], near=near(robot, x)).efforts
    close_to(efforts, case["axial_force"], 1e-9)
    if case["n1"] == "radial":
        close_to(robot.mass_matrix(x), case["M_U"])


def near(robot, x):
    """A configuration on home's working mode near a pose, by small steps."""
    q, start = robot.home.q, robot.home.x
    for share in np.linspace(0, 1, 11)[1:]:
        at = start + share * (x - start)
        at[3:] /= np.linalg.norm(at[3:])
        q = robot.inverse_geometry(at, near=q)
    return q


@pytest.mark.parametrize("case", LEGS["cases"][:1], ids=lambda case: case["n1"])
def test_massive_legs_on_spherical_feet(case):
    """The spin of a leg about itself starts at zero and stays; the platform feels none of it."""
    robot = hexapod(foot="spherical")
    x, twist = pose(case["v"]), np.array(case["udot"] + case["omega"])
    assert len(robot.dynamics.independent("platform")) == 12
    found = robot.direct_dynamics(x, twist, case["axial_force"])
    close_to(found, case["nudot_S"])
    A = robot.mass_matrix(x)
    outputs, spins = A[:6, :6], A[6:, 6:]
    reduced = outputs - A[:6, 6:] @ np.linalg.solve(spins, A[6:, :6])
    close_to(reduced, case["M_S"])


@pytest.fixture(scope="module")
def massless():
    return hexapod(massless=True)


@pytest.mark.parametrize("state", DATA["states"][2:], ids=lambda state: "")
def test_massless_legs_with_reels(massless, state):
    """The exact model: accelerations for the forces of actuators and stops."""
    robot = massless
    x, omega = pose(state["v"]), state["omega"]
    twist = np.array(state["vdot"][:3] + omega)
    forces = np.array(state["R"]) - state["stop_force"]
    found = robot.direct_dynamics(x, twist, forces)
    expected = state["exact"]["vddot"][:3] + state["omega_dot_exact"]
    close_to(found, expected, 1e-9)
    kinetic, _ = robot.energy(x, twist)
    np.testing.assert_allclose(kinetic, state["exact"]["T_platform"] + state["T_reels"], rtol=1e-10)
