"""What ends a row, and what is refused."""

import numpy as np
import pytest

from gough.description import Mechanism
from gough.dynamics.results import ENDINGS, Ending
from gough.errors import ConfigurationError, SingularError, UnknownName
from gough.robot import Robot, load


@pytest.fixture(scope="module")
def orthoglide():
    return load("orthoglide")


@pytest.fixture(scope="module")
def gough():
    return load("gough-stewart")


def names(solution):
    return [ENDINGS[code] for code in solution.ending]


def test_rows_end_each_for_itself(orthoglide):
    x = np.tile(orthoglide.home.x, (5, 1))
    x[1] += 1.0  # no leg is that long
    xd, xdd = np.zeros((2, 5, 3))
    xdd[2, 1] = np.nan
    x[3, 0] = np.inf
    found = orthoglide.dynamics.inverse(x, xd, xdd)
    assert names(found) == [
        Ending.solved,
        Ending.out_of_reach,
        Ending.not_finite,
        Ending.not_finite,
        Ending.solved,
    ]
    assert "too short" in found.reasons[1] or "does not reach" in found.reasons[1]
    assert np.isnan(found.efforts[1:4]).all()
    alone = orthoglide.inverse_dynamics(x[0], xd[0], xdd[0])
    np.testing.assert_array_equal(found.efforts[[0, 4]], [alone, alone])
    with pytest.raises(SingularError, match="row 1 of 5") as error:
        orthoglide.inverse_dynamics(x, xd, xdd)
    assert error.value.rows == (1, 2, 3)


def test_a_singularity_of_type_2_is_told():
    """A quarter turn of yaw: the platform of this robot moves with its motors locked."""
    robot = load("gough-stewart")
    half = np.sqrt(0.5)
    x = [0, 0, 0.9, half, 0, 0, half]
    found = robot.dynamics.inverse(x, np.zeros(6), np.ones(6))
    assert ENDINGS[int(found.ending)] is Ending.singular
    assert "regularity" in found.reasons[0]
    with pytest.raises(SingularError, match="singular"):
        robot.inverse_dynamics(x, np.zeros(6), np.ones(6))
    # forces that motors can not hold are no obstacle to direct dynamics
    assert np.isfinite(robot.direct_dynamics(x, np.zeros(6), np.ones(6))).all()


def test_regularity_falls_on_the_way_to_a_singularity(gough):
    found = []
    for yaw in np.linspace(0.8, np.pi / 2, 8)[:-1]:
        x = [0, 0, 0.9, np.cos(yaw / 2), 0, 0, np.sin(yaw / 2)]
        found.append(float(gough.dynamics.inverse(x, np.zeros(6), np.zeros(6)).regularity))
    assert np.all(np.diff(found) < 0)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (([1, 2], [0] * 3, [0] * 3), r"x has shape \(2,\), expected \(\.\.\., 3\): x, y, z"),
        (([0.05, -0.03, 0.67], [0] * 2, [0] * 3), r"xd has shape \(2,\)"),
        (([0.05, -0.03, 0.67], [0] * 3, ["a", 1, 2]), "xdd is .* expected numbers"),
        ((np.zeros((4, 3)), np.zeros((5, 3)), np.zeros(3)), "batches do not go together"),
    ],
)
def test_wrong_arguments_are_named(orthoglide, arguments, message):
    with pytest.raises(ConfigurationError, match=message):
        orthoglide.dynamics.inverse(*arguments)
    with pytest.raises(ConfigurationError):
        orthoglide.inverse_dynamics(*arguments)


def test_wrenches_and_gravity_are_checked(orthoglide):
    state = orthoglide.home.x, np.zeros(3), np.zeros(3)
    with pytest.raises(ConfigurationError, match="wrench has shape"):
        orthoglide.inverse_dynamics(*state, wrench=[1, 2, 3])
    with pytest.raises(UnknownName, match=r"leg1\.slide"):
        orthoglide.inverse_dynamics(*state, wrench={"leg1.slide": np.zeros(6)})
    with pytest.raises(ConfigurationError, match="gravity has entries that are not finite"):
        orthoglide.inverse_dynamics(*state, gravity=[0, 0, np.nan])


def test_wrench_and_gravity_act_as_they_should(gough):
    """A wrench on the platform is felt along the twist; a weight is a force at its centre."""
    x, rng = gough.home.x, np.random.default_rng(1)
    w = rng.normal(size=6)
    still = np.zeros(6)
    free, held = (gough.inverse_dynamics(x, still, still, wrench=f) for f in (None, w))
    J = gough.dynamics.motor_jacobian(x)
    np.testing.assert_allclose(J.T @ (free - held), w, atol=1e-10)
    # a load of 2 kg on a rod of a leg, as a wrench of its weight
    by_body = gough.inverse_dynamics(x, still, still, wrench={"leg1.rod": [0, 0, -9.81, 0, 0, 0]})
    assert np.abs(by_body - free).max() > 0.1
    weightless = gough.inverse_dynamics(x, still, still, gravity=[0, 0, 0])
    np.testing.assert_allclose(weightless, 0, atol=1e-10)
    twice = gough.inverse_dynamics(x, still, still, gravity=[0, 0, -2 * 9.81])
    np.testing.assert_allclose(twice, 2 * free, rtol=1e-10)


def with_masses(name, change):
    content = load(name).mechanism.model_dump(exclude_unset=True)
    change(content)
    return Robot(Mechanism.model_validate(content))


def test_legs_without_mass_are_no_obstacle(gough):
    """All the mass in the platform: A is the platform's own."""

    def light(content):
        for body in content["legs"]["leg"]["bodies"].values():
            body |= {"mass": 0, "inertia": [0, 0, 0]}

    robot = with_masses("gough-stewart", light)
    A = robot.mass_matrix(robot.home.x)
    np.testing.assert_allclose(A[:3, :3], 30 * np.eye(3), atol=1e-12)
    np.testing.assert_allclose(np.linalg.eigvalsh(A[3:, 3:]), [2.7, 2.7, 5.4], rtol=1e-12)


def test_a_motion_without_inertia_is_named():
    """No mass at all: no efforts are needed, and no accelerations follow from any."""

    def nothing(content):
        content["bodies"]["platform"] |= {"mass": 0, "inertia": [0, 0, 0]}
        for body in content["legs"]["leg"]["bodies"].values():
            body |= {"mass": 0, "inertia": [0, 0, 0]}

    robot = with_masses("3-rrr", nothing)
    x, still = robot.home.x, np.zeros(3)
    np.testing.assert_array_equal(robot.inverse_dynamics(x, still, np.ones(3)), 0)
    with pytest.raises(ConfigurationError, match="without inertia"):
        robot.direct_dynamics(x, still, np.ones(3))


def test_mechanisms_without_outputs_point_to_joint_space():
    robot = load("andrews-squeezer")
    with pytest.raises(ConfigurationError, match="inverse_dynamics_joint"):
        robot.inverse_dynamics([0], [0], [0])
    q = robot.home.q
    assert robot.inverse_dynamics_joint(q, [1.0], [0.0]).shape == (1,)
    with pytest.raises(ConfigurationError, match="not closed"):
        robot.inverse_dynamics_joint(q + 0.1, [1.0], [0.0])


def test_redundant_motors_share_by_weights():
    robot = load("4-rpr")
    x, rng = robot.home.x, np.random.default_rng(4)
    xd, xdd = rng.normal(size=(2, 3))
    even = robot.dynamics.inverse(x, xd, xdd)
    weights = np.array([1.0, 4.0, 0.5, 2.0])
    other = robot.dynamics.inverse(x, xd, xdd, weights=weights)
    J, W = robot.dynamics.motor_jacobian(x), robot.dynamics.bias(x, xd)
    W = W + robot.mass_matrix(x) @ xdd
    for solution, w in ((even, np.ones(4)), (other, weights)):
        np.testing.assert_allclose(J.T @ solution.efforts, W, atol=1e-10)
        np.testing.assert_allclose(solution.residual, 0, atol=1e-10)
        null = solution.null_space[:, 0]
        np.testing.assert_allclose(J.T @ null, 0, atol=1e-12)
        # the smallest of all: no share of the null space makes it smaller
        assert abs(np.sum(solution.efforts / w**2 * null)) < 1e-9
    with pytest.raises(ConfigurationError, match="weights"):
        robot.dynamics.inverse(x, xd, xdd, weights=[1, 2])


def test_what_motors_can_not_give_is_the_residual():
    robot = load("biped-leg")
    rng = np.random.default_rng(6)
    count = len(robot.dynamics.independent())
    v, a = rng.normal(size=(2, count))
    q = robot.home.q
    found = robot.dynamics.inverse_joint(q, v, a)
    J = robot.dynamics.motor_jacobian(q, space="joint")
    A = robot.dynamics.mass_matrix(q, space="joint")
    W = A @ a + robot.dynamics.bias(q, v, space="joint")
    np.testing.assert_allclose(J.T @ found.efforts + found.residual, W, atol=1e-9)
    np.testing.assert_allclose(J @ found.residual, 0, atol=1e-9)  # the least residual


def test_states_are_closed_and_refused_with_a_reason():
    robot = load("four-bar")
    start = robot.home.q_actuated[0]
    q = robot.state([start + 0.3])
    assert robot.assembler.gaps(q[None])[0] < 1e-9
    with pytest.raises(ConfigurationError, match="positions has shape"):
        robot.state([1.0, 2.0])
    with pytest.raises(ConfigurationError, match="no position of its own"):
        load("biped-leg").state(np.zeros(10))
