"""Laws of dynamics on every robot of the catalogue, against maximal coordinates."""

import casadi
import numpy as np
import pytest
from hypothesis import settings

from gough import catalogue
from gough.robot import load
from tests.dynamics.maximal import Maximal

LONG = settings.get_current_profile_name() == "long"
STATES = 200 if LONG else 6
EXACT = 1e-9
FAR = 1e-10
"""Of accelerations against maximal coordinates, where rounding grows near singularities."""


@pytest.fixture(scope="module", params=sorted(catalogue.names()))
def robot(request):
    return load(request.param)


@pytest.fixture(scope="module")
def states(robot):
    """Closed configurations near and far, home among them."""
    rng = np.random.default_rng(7)
    found = [robot.home.q]
    while len(found) < STATES:
        q = robot.assembler.wander(robot.home.q, rng, rng.uniform(0.05, 0.5))
        if q is not None:
            found.append(q)
    return np.array(found)


@pytest.fixture(scope="module")
def rates(robot, states):
    rng = np.random.default_rng(8)
    count = len(robot.dynamics.independent())
    return rng.normal(size=(2, len(states), count))


def regular(robot, q):
    """Rows that are not singular, by the model's own measure."""
    y = np.zeros((len(q), len(robot.dynamics.independent())))
    efforts = np.zeros(len(robot.dynamics.motors))
    return robot.dynamics.direct_joint(q, y, efforts).regularity > 1e-2


def scale(*arrays):
    return max(np.abs(a).max(initial=0.0) for a in arrays) or 1.0


def test_direct_dynamics_is_that_of_maximal_coordinates(robot, states, rates):
    truth, rng = Maximal(robot), np.random.default_rng(9)
    kept = regular(robot, states)
    assert kept.any()
    q, v = states[kept], rates[0][kept]
    efforts = rng.normal(size=(len(q), len(robot.dynamics.motors)))
    model, dynamics = robot.dynamics.model("joint"), robot.dynamics
    found = dynamics.direct_joint(q, v, efforts)
    assert found.solved.all()
    parameters = dynamics._parameters
    for k in range(len(q)):
        all_rates = model.kernel("rates", "q")(q[k], *parameters, v[k])
        change = model.kernel("accelerations", "q")(q[k], *parameters, v[k], found.accelerations[k])
        given = dict(zip(dynamics.motors, efforts[k], strict=True))
        expected = truth.tree_accelerations(q[k], all_rates, given)
        tolerance = FAR * scale(expected, all_rates**2)
        np.testing.assert_allclose(change, expected, rtol=0, atol=tolerance)


def test_inverse_of_direct_is_identity(robot, states, rates):
    dynamics = robot.dynamics
    kept = regular(robot, states)
    q, v, a = states[kept], rates[0][kept], rates[1][kept]
    if dynamics.model("joint").motors_rank < len(dynamics.independent()):
        pytest.skip("the motors can not give every acceleration")
    found = dynamics.inverse_joint(q, v, a)
    assert found.solved.all()
    np.testing.assert_allclose(found.residual, 0, atol=EXACT * scale(found.efforts))
    back = dynamics.direct_joint(q, v, found.efforts)
    np.testing.assert_allclose(back.accelerations, a, rtol=0, atol=EXACT * scale(a, v**2))


def test_the_mass_matrix_is_symmetric_and_positive_definite(robot, states):
    q = states[regular(robot, states)]
    A = robot.dynamics.mass_matrix(q, space="joint")
    np.testing.assert_allclose(A, np.swapaxes(A, -1, -2), rtol=0, atol=1e-12 * scale(A))
    assert np.linalg.eigvalsh(A).min() > 0


def test_power_is_the_rate_of_energy(robot, states, rates):
    """dE/dt along the motion that motors and gravity make, by automatic differentiation."""
    dynamics, model = robot.dynamics, robot.dynamics.model("joint")
    kept = regular(robot, states)
    q, v = states[kept], rates[0][kept]
    efforts = np.random.default_rng(3).normal(size=(len(q), len(dynamics.motors)))
    a = dynamics.direct_joint(q, v, efforts).accelerations
    kinetic, _ = dynamics.energy(q, v, space="joint")
    A = dynamics.mass_matrix(q, space="joint")
    np.testing.assert_allclose(kinetic, 0.5 * np.einsum("ri,rij,rj->r", v, A, v), rtol=1e-12)
    power = np.einsum("rm,rmi,ri->r", efforts, dynamics.motor_jacobian(q, space="joint"), v)
    rate = energy_rate(robot, model)
    parameters = [robot.assembler.p] * bool(robot.assembler.p.size)
    for k in range(len(q)):
        all_rates = model.kernel("rates", "q")(q[k], *parameters, v[k])
        found = float(rate(q[k], robot.assembler.p, v[k], all_rates, a[k]))
        size = np.abs(v[k]) @ np.abs(A[k]) @ np.abs(a[k]) + abs(power[k])
        assert abs(found - power[k]) < EXACT * max(size, 1e-3)


def energy_rate(robot, model):
    """dE/dt of (q, p, y, v, ẏ), with dq/dt = H v."""
    closure = model.closure
    y, v, yd = (
        casadi.SX.sym(name, n)
        for name, n in (
            ("y", len(model.given)),
            ("v", len(robot.structure.variables)),
            ("yd", len(model.given)),
        )
    )
    given = [closure.q] + [closure.p] * bool(closure.p.numel()) + [y]
    energy = casadi.sum1(casadi.vec(model.kernel("energy", "q").expression(*given)))
    along = casadi.vertcat(closure.position_rates @ v, yd)
    rate = casadi.jtimes(energy, casadi.vertcat(closure.q, y), along)
    return casadi.Function("rate", [closure.q, closure.p, y, v, yd], [rate])


def test_both_spaces_give_the_same_efforts(robot, states, rates):
    """The same motion told by outputs and by motors."""
    dynamics = robot.dynamics
    outputs = robot.structure.columns("operational")
    if not outputs or dynamics.model("platform").motors_rank < len(
        dynamics.independent("platform")
    ):
        pytest.skip("no outputs, or motors that do not give every force")
    kept = regular(robot, states)
    q, v, a = states[kept], rates[0][kept], rates[1][kept]
    _, all_rates, changes = dynamics.motion(q, v, a, space="joint")
    x = dynamics.inverse_geometry.coordinates.of(q)
    near = q
    platform = dynamics.inverse(x, all_rates[:, outputs], changes[:, outputs], near=near)
    joint = dynamics.inverse_joint(q, v, a)
    good = platform.solved & (platform.regularity > 1e-2)
    if list(dynamics.model("platform").independent) != outputs:
        pytest.skip("the outputs leave other rates open")
    assert good.any()
    difference = platform.efforts[good] - joint.efforts[good]
    null = joint.null_space[good]
    if null.shape[-1]:  # efforts that only tighten do not count
        difference -= np.einsum("rmk,rnk,rn->rm", null, null, difference)
    tolerance = 1e-8 * scale(joint.efforts[good])
    np.testing.assert_allclose(difference, 0, atol=tolerance)


def test_outputs_and_configurations_give_the_same(robot, states, rates):
    """The model that solves legs in closed form, maybe on another tree, and the one of joints."""
    dynamics = robot.dynamics
    outputs = robot.structure.columns("operational")
    if not outputs or "x" not in dynamics.model("platform").places:
        pytest.skip("no closed form")
    rng = np.random.default_rng(1)
    x = dynamics.inverse_geometry.coordinates.of(states)
    xd, xdd = rng.normal(size=(2, len(states), len(outputs)))
    by_outputs = dynamics.inverse(x, xd, xdd)
    by_joints = dynamics.inverse(x, xd, xdd, near=robot.home.q)
    good = by_outputs.solved & by_joints.solved & (by_joints.regularity > 1e-2)
    assert good.any()
    efforts = by_joints.efforts[good]
    tolerance = EXACT * scale(efforts)
    np.testing.assert_allclose(by_outputs.efforts[good], efforts, rtol=0, atol=tolerance)
    tau = rng.normal(size=(len(states), len(dynamics.motors)))
    one, other = (dynamics.direct(x, xd, tau, near=near) for near in (None, robot.home.q))
    expected = other.accelerations[good]
    tolerance = EXACT * scale(expected, xd**2)
    np.testing.assert_allclose(one.accelerations[good], expected, rtol=0, atol=tolerance)
