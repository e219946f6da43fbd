"""Reactions of joints: bodies balance, maximal coordinates agree, what stays open is told."""

import json

import numpy as np
import pytest

from gough import load
from gough.dynamics.reactions import JointForces, reactions
from gough.errors import ConfigurationError, UnknownName
from tests.dynamics.maximal import Maximal, newton_euler

ROBOTS = [
    "orthoglide",
    "gough-stewart",
    "tricept",
    "four-bar",
    "3-rrr",
    "delta-parallelogram",
    "biped-leg",
    "par4",
    "bennett",
    "hexa",
    "agile-eye",
    "andrews-squeezer",
]
EFFORT = {"revolute": slice(3, 6), "prismatic": slice(0, 3)}


def close_to(actual, expected, tolerance=1e-8):
    scale = max(1.0, float(np.abs(expected).max(initial=0.0)))
    np.testing.assert_allclose(actual, expected, rtol=0, atol=tolerance * scale)


class Case:
    """A robot in a state near home, driven by efforts at random, loaded at one body."""

    def __init__(self, name):
        self.robot = load(name)
        dynamics = self.robot.dynamics
        rng = np.random.default_rng(2)
        self.q = None
        while self.q is None:
            self.q = self.robot.assembler.wander(self.robot.home.q, rng, 0.15)
        self.y = rng.normal(size=len(dynamics.independent("joint")))
        self.efforts = 3 * rng.normal(size=len(dynamics.motors))
        self.gravity = np.array([0.5, -9.0, -3.0])
        self.body = list(self.robot.structure.flat.bodies)[-1]
        self.wrench = {self.body: rng.normal(size=6)}
        self.forces = JointForces(dynamics)
        self.found = self.forces.at(
            self.q,
            self.y,
            efforts=self.efforts,
            space="joint",
            wrench=self.wrench,
            gravity=self.gravity,
        )
        model = dynamics.model("joint")
        self.v = model.kernel("rates", "q")(self.q, *dynamics._parameters, self.y)


@pytest.fixture(scope="module", params=ROBOTS)
def case(request):
    return Case(request.param)


def test_reactions_are_those_of_maximal_coordinates_where_unique(case):
    truth, found, flat = Maximal(case.robot), case.found, case.robot.structure.flat
    efforts = dict(zip(found.motors, case.efforts, strict=True))
    state = truth.state(case.q, case.v)
    if flat.couplings:
        pytest.skip("maximal coordinates give the forces of couplings apart")
    given = case.q, case.v, efforts, case.gravity, case.wrench
    expected, changes = truth.reactions(*given), truth.tree_accelerations(*given)
    index = {variable.name: k for k, variable in enumerate(case.robot.structure.variables)}
    for name, wrench in expected.items():
        joint = flat.joints[name]
        if name in efforts:
            link = truth.joints[name]
            z = (state.T_root[joint.bodies[0]] @ link.T_body_frame[0])[:3, 2]
            felt = efforts[name] - truth.rotors.get(name, 0.0) * changes[index[name]]
            wrench[EFFORT[joint.type]] += felt * z
        unique = found.is_unique(name)
        size = max(1.0, np.abs(found.wrench).max())
        close_to(found.of(name)[unique] / size, wrench[unique] / size)


def test_bodies_balance(case):
    """In the plane, only forces in it and moments about its normal."""
    robot, found, truth = case.robot, case.found, Maximal(case.robot)
    accelerations = case.forces.dynamics.direct_joint(
        case.q, case.y, case.efforts, case.wrench, case.gravity
    ).accelerations
    q, v, vd = robot.dynamics.motion(case.q, case.y, accelerations, "joint")
    state = truth.state(q, v)
    total = {body: np.zeros(6) for body in [*truth.bodies, truth.root]}
    constraints = robot.structure.flat.constraints
    for name, (a, b), wrench in zip(found.joints, found.bodies, found.wrench, strict=True):
        part = robot.structure.flat.joints.get(name) or constraints.get(name)
        T = (
            np.eye(4)
            if part is None
            else truth._link(name, "", (a, b), part.frames).T_body_frame[1]
        )
        origin = (state.T_root[b] @ T)[:3, 3]
        for body, sign in ((a, -1), (b, 1)):
            arm = origin - state.T_root[body][:3, 3]
            moment = wrench[3:] + np.cross(arm, wrench[:3])
            total[body] += sign * np.concatenate([wrench[:3], moment])
    rows = [0, 1, 5] if robot.mechanism.motion == "planar" else list(range(6))
    for body in truth.bodies:
        W, f = newton_euler(
            truth.inertias[body], state.T_root[body], state.twists[body], case.gravity
        )
        a = acceleration(case, body, v, vd)
        needed = W @ a - f - case.wrench.get(body, np.zeros(6))
        size = max(1.0, np.abs(found.wrench).max())
        close_to(total[body][rows] / size, needed[rows] / size)


def acceleration(case, body, v, vd, h=1e-6):
    """J v̇ + J̇ v, the last by differences that are exact enough beside 1e-8."""
    models, p = case.robot.models, case.robot.assembler.p
    J = models.body_jacobian(body)
    ends = [J(models.retract(case.q, s * h * v), p) @ v for s in (-2, -1, 1, 2)]
    bias = (ends[0] - 8 * ends[1] + 8 * ends[2] - ends[3]) / (12 * h)
    return J(case.q, p) @ vd + bias


def test_joints_do_no_work_but_by_their_motors(case):
    """Sᵀ W is the effort: a pin takes no moment about its axis, a slide no force along it."""
    found, flat = case.found, case.robot.structure.flat
    truth = Maximal(case.robot)
    state = truth.state(case.q, case.v)
    coupled = {name for c in flat.couplings.values() for name in c.terms}
    motors = dict(zip(found.motors, case.efforts, strict=True))
    size = max(1.0, np.abs(found.wrench).max())
    for name, joint in flat.joints.items():
        if joint.type not in EFFORT or name in coupled or truth.rotors.get(name):
            continue
        z = (state.T_root[joint.bodies[0]] @ truth.joints[name].T_body_frame[0])[:3, 2]
        along = found.of(name)[EFFORT[joint.type]] @ z
        expected = motors.get(name, 0.0)
        close_to(along / size, expected / size)


def test_accelerations_and_efforts_say_the_same(case):
    dynamics = case.robot.dynamics
    moved = dynamics.direct_joint(case.q, case.y, case.efforts, case.wrench, case.gravity)
    both = case.forces.at(
        case.q,
        case.y,
        moved.accelerations,
        case.efforts,
        "joint",
        case.wrench,
        case.gravity,
    )
    close_to(both.wrench, case.found.wrench)


# what is determined


@pytest.mark.parametrize("name", ["gough-stewart", "tricept", "3-rps", "hexa"])
def test_all_is_determined_where_no_equation_is_redundant(name):
    robot = load(name)
    redundant = robot.analyse().redundant_equations
    y = np.zeros(len(robot.dynamics.independent("joint")))
    found = reactions(robot.dynamics, robot.home.q, y, y, space="joint")
    assert found.determined == (redundant == 0)
    assert ("?" in str(found)) != found.determined


def test_out_of_plane_components_of_a_planar_mechanism_are_open():
    robot = load("four-bar")
    y = np.ones(len(robot.dynamics.independent("joint")))
    found = reactions(robot.dynamics, robot.home.q, y, y, space="joint")
    assert found.unique[:, [0, 1, 5]].all()
    assert not found.unique[:, [2, 3, 4]].any()


def test_parallelograms_leave_some_components_open():
    robot = load("orthoglide")
    found = reactions(robot.dynamics, robot.home.q[:3], np.ones(3), np.ones(3))
    assert not found.determined
    assert found.unique.any()


def test_platform_space_is_joint_space():
    robot = load("orthoglide")
    dynamics = robot.dynamics
    forces = JointForces(dynamics)
    x, xd, tau = dynamics.inverse_geometry.coordinates.of(robot.home.q), np.ones(3), np.ones(3)
    found = forces.at(x, xd, efforts=tau)
    q, v, _ = dynamics.motion(x, xd, np.zeros(3))
    y = v[list(dynamics.model("joint").independent)]
    close_to(found.wrench, forces.at(q, y, efforts=tau, space="joint").wrench)
    xdd = dynamics.direct(x, xd, tau).accelerations
    close_to(forces.at(x, xd, xdd).wrench, found.wrench)
    close_to(forces.at(x, xd, xdd).efforts, tau)


def test_the_ground_carries_the_weight():
    robot = load("gough-stewart")
    x = robot.dynamics.inverse_geometry.coordinates.of(robot.home.q)
    found = reactions(robot.dynamics, x, np.zeros(6), np.zeros(6))
    base = robot.structure.mechanism.base
    carried = sum(
        wrench[:3] * (1 if a == base else -1)
        for (a, b), wrench in zip(found.bodies, found.wrench, strict=True)
        if base in (a, b)
    )
    mass = sum(inertia.mass for body, inertia in Maximal(robot).inertias.items() if body != base)
    close_to(carried, -mass * np.array(robot.mechanism.gravity, dtype=float))


def test_contradictions_and_unknown_names_are_told():
    robot = load("orthoglide")
    x = robot.dynamics.inverse_geometry.coordinates.of(robot.home.q)
    with pytest.raises(ConfigurationError, match="misses its balance"):
        reactions(robot.dynamics, x, np.zeros(3), np.ones(3), 100 * np.ones(3))
    with pytest.raises(ConfigurationError, match="accelerations"):
        reactions(robot.dynamics, x, np.zeros(3))
    found = reactions(robot.dynamics, x, np.zeros(3), np.zeros(3))
    with pytest.raises(UnknownName, match=r"leg1\.j2"):
        found.of("leg1.j9")
    assert json.loads(json.dumps(found.as_dict()))["joints"] == list(found.joints)


@pytest.mark.parametrize("variants", [(), ("massive-legs",)])
def test_rotors_are_felt_at_their_joint_only(variants):
    """A slide passes on its motor's effort without what the inertia of its reel takes."""
    robot = load("deployable-hexapod", variants=variants)
    dynamics, truth = robot.dynamics, Maximal(robot)
    x = dynamics.inverse_geometry.coordinates.of(robot.home.q)
    xdd = np.array([0.3, -0.2, 5.0, 1.0, 2.0, -1.0])
    found = reactions(dynamics, x, np.zeros(6), xdd)
    q, v, vd = dynamics.motion(x, np.zeros(6), xdd)
    state, names = truth.state(q, v), [x.name for x in robot.structure.variables]
    values = robot.assembler.values
    rotor = values["reel_inertia"] / values["reel_radius"] ** 2
    assert rotor > 0
    for name, effort in zip(found.motors, found.efforts, strict=True):
        link = truth.joints[name]
        z = (state.T_root[link.bodies[0]] @ link.T_body_frame[0])[:3, 2]
        close_to(found.of(name)[:3] @ z, effort - rotor * vd[names.index(name)])


def test_a_floating_base_is_a_body_like_others():
    robot = load("biped-leg")
    dynamics = robot.dynamics
    y = np.zeros(len(dynamics.independent("joint")))
    tau = np.zeros(len(dynamics.motors))
    found = reactions(dynamics, robot.home.q, y, efforts=tau, space="joint")
    close_to(found.wrench, 0 * found.wrench)  # it falls freely
