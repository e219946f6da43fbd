import numpy as np
import pytest

import gough
from gough.description import Mechanism
from gough.dynamics.identification.base import random_states
from gough.dynamics.identification.identify import Identification
from gough.dynamics.identification.mechanism import ImpossibleParameters, pseudo_inertia
from gough.dynamics.identification.parameters import ten_numbers
from gough.dynamics.identification.regressor import States
from gough.dynamics.identification.series import series, turned
from gough.errors import ConfigurationError, UnknownName
from gough.robot import Robot

ROBOTS = {
    "orthoglide": "platform",
    "gough-stewart": "platform",
    "3-rrr": "platform",
    "biped-leg": "joint",
    "four-bar": "joint",
    "4-rpr": "platform",
}
COUNTS = {
    # inertial base parameters, changes without effect by sampling and by transfers at joints
    "orthoglide": (34, 126, 123),
    "gough-stewart": (82, 48, 48),
    "3-rrr": (19, 51, 51),
    "four-bar": (8, 22, 22),
    "4-rpr": (24, 66, 66),
}
_made = {}


def identification(name, space=None):
    key = name, space or ROBOTS[name]
    if key not in _made:
        _made[key] = Identification(gough.load(name).dynamics, key[1])
    return _made[key]


def relative(a, b):
    return np.abs(a - b).max() / np.abs(b).max()


def serial(joints, gravity=(0.0, 0.0, -9.81), seed=0):
    """A chain of bodies with random inertia: (type, point, axis) of each joint on its parent."""
    rng = np.random.default_rng(seed)
    bodies, links = {}, {}
    for k, (kind, point, axis) in enumerate(joints):
        half = rng.normal(size=(3, 3))
        J = 0.01 * (half @ half.T + np.eye(3))
        J = np.trace(J) * np.eye(3) - J
        bodies[f"b{k}"] = {
            "mass": rng.uniform(1, 2),
            "com": tuple(rng.normal(size=3) * 0.1),
            "inertia": (J[0, 0], J[1, 1], J[2, 2], J[0, 1], J[0, 2], J[1, 2]),
        }
        links[f"j{k}"] = {
            "type": kind,
            "bodies": ("base" if k == 0 else f"b{k - 1}", f"b{k}"),
            "frames": ({"point": point, "axis": axis}, {"axis": (0.0, 0.0, 1.0)}),
            "actuated": True,
            "home": 0.3,
        }
    return Mechanism(name="chain", bodies=bodies, joints=links, gravity=gravity)


def inertial_count(mechanism):
    base = Identification(Robot(mechanism).dynamics, friction=False).base
    return base.rank, base


# the regressor


@pytest.mark.parametrize("name", ROBOTS)
def test_regressor_times_parameters_is_inverse_dynamics(name):
    found = identification(name)
    states, regressor = random_states(found.regressor, 3, 20), found.regressor
    values = found.parameters.values
    take = regressor._take(states)
    forces = regressor.model.kernel("forces", "q")(*take, states.y, states.yd)
    assert relative(regressor.along_rates(states) @ values, forces) < 1e-10
    if regressor.space == "joint":
        known = found.dynamics.inverse_joint(states.q, states.y, states.yd)
        rows = found.matrix(states) @ values
        given = regressor.measured(states, known.efforts)
        assert relative(rows, given + (known.residual if name == "biped-leg" else 0)) < 1e-10


@pytest.mark.parametrize("name", ["orthoglide", "gough-stewart", "3-rrr", "4-rpr"])
def test_rows_of_operational_motions_are_efforts(name):
    found = identification(name)
    dynamics, rng = found.dynamics, np.random.default_rng(2)
    at = dynamics.inverse_geometry.coordinates.of(dynamics.home)
    rates = rng.normal(size=(2, 8, len(found.regressor.model.independent)))
    states = found.states(np.broadcast_to(at, (8, len(at))), *rates)
    efforts = dynamics.inverse(np.broadcast_to(at, (8, len(at))), *rates).efforts
    rows = found.matrix(states) @ found.parameters.values
    assert relative(rows, found.regressor.measured(states, efforts)) < 1e-10
    assert relative(found.efforts(states), efforts) < 1e-10


def test_friction_acts_against_the_rates_of_its_motor():
    found = identification("3-rrr")
    states = random_states(found.regressor, 4, 5)
    rates = np.einsum("rmi,ri->rm", found.regressor.jacobian(states), states.y)
    for symbol, law in (("fv", rates), ("fc", np.sign(rates))):
        unit = np.zeros(len(found.parameters))
        unit[found.parameters.index(f"leg2.motor.{symbol}")] = 1.0
        expected = np.zeros_like(law)
        expected[:, 1] = law[:, 1]
        np.testing.assert_allclose(found.efforts(states, unit), expected, atol=1e-12)


# base parameters


@pytest.mark.parametrize("name", ROBOTS)
def test_base_columns_carry_the_whole_model(name):
    found = identification(name)
    base = found.base
    Y = found.regressor.along_rates(random_states(found.regressor, 11, 20))
    scale = found.parameters.scale
    assert relative(base.columns(Y) @ base.matrix * scale, Y * scale) < 1e-9
    np.testing.assert_array_equal(base.matrix[:, base.kept], np.eye(base.rank))
    np.testing.assert_allclose(base.of(found.parameters.values), base.values)
    assert base.gap > 1e6


@pytest.mark.parametrize("name", ROBOTS)
def test_exact_transfers_are_without_effect(name):
    base = identification(name).base
    assert base.transfer_residual < 1e-10
    assert base.transferred <= base.sampled


@pytest.mark.parametrize("name", COUNTS)
def test_counts(name):
    found = identification(name)
    count, sampled, transferred = COUNTS[name]
    assert found.parameters.inertial - found.base.sampled == count
    assert (found.base.sampled, found.base.transferred) == (sampled, transferred)


def test_a_pendulum_has_three_base_parameters():
    axis = (0.0, 1.0, 0.0)
    count, base = inertial_count(serial([("revolute", (0, 0, 0), axis)]))
    assert count == 3
    assert {name.rstrip("*") for name in base.names} == {"b0.mx", "b0.my", "b0.zz"}
    assert base.formulas[-1] == "b0.zz* = b0.zz + j0.Ia"


def test_of_a_body_about_the_vertical_only_one_number_counts():
    count, base = inertial_count(serial([("revolute", (0, 0, 0), (0.0, 0.0, 1.0))]))
    assert count == 1
    assert base.names == ("b0.zz*",)


def test_a_plane_arm_has_six_and_the_known_regrouping():
    y = (0.0, 0.0, 1.0)
    arm = serial(
        [("revolute", (0, 0, 0), y), ("revolute", (0.5, 0, 0), y)], gravity=(0.0, -9.81, 0.0)
    )
    base = Identification(Robot(arm).dynamics, friction=False).base
    texts = dict(text.split(" = ") for text in base.formulas)
    assert texts["b0.mx*"] == "b0.mx + 0.5 b1.m"
    assert texts["b0.zz*"] == "b0.zz + 0.25 b1.m + j0.Ia"
    assert {n.rstrip("*") for n in base.names if not n.endswith("Ia")} == {
        f"b{k}.{s}" for k in (0, 1) for s in ("mx", "my", "zz")
    }
    assert base.rank == 7  # the second rotor turns on the first body: its inertia stands alone


@pytest.mark.parametrize(
    ("kinds", "gravity", "count"),
    [
        (("revolute",) * 3, (1.0, 2.0, -9.0), 17),
        (("revolute",) * 3, (0.0, 0.0, -9.81), 15),
        (("revolute", "revolute", "prismatic"), (1.0, 2.0, -9.0), 14),
    ],
)
def test_serial_arms_have_the_number_of_the_literature(kinds, gravity, count):
    """7 for each turn and 4 for each slide less 4, and 2 less with the first axis along gravity
    (Khalil and Dombre 2002, ch. 9), where no axes are parallel or at right angles."""
    points = [(0, 0, 0.1), (0.3, 0.1, 0.2), (0.2, -0.3, 0.1)]
    axes = [(0.0, 0.0, 1.0), (0.6, 0.0, 0.8), (0.48, 0.6, 0.64)]
    arm = serial(list(zip(kinds, points, axes, strict=True)), gravity)
    found = Identification(Robot(arm).dynamics, friction=False)
    assert found.parameters.inertial - found.base.sampled == count


@pytest.mark.parametrize(("name", "count"), [("bricard", 21), ("andrews-squeezer", 12)])
def test_counts_of_mechanisms_of_one_freedom_are_clear(name, count):
    base = Identification(gough.load(name).dynamics).base
    assert base.rank == count
    assert base.gap > 1e6


def test_base_parameters_print():
    base = identification("gough-stewart").base
    text = str(base)
    assert "leg1.cylinder.xx* = leg1.cylinder.xx + leg1.rod.xx" in text
    assert "platform.zz* = platform.zz + 0.36 leg1.rod.m" in text
    assert base.as_dict()["rank"] == base.rank == len(base)


# series and trajectories


def test_turned_has_exact_twists():
    rng, h, t = np.random.default_rng(0), 1e-5, 0.7
    for size in (1e-3, 0.02, 0.8):
        numbers = size * rng.normal(size=(3, 2, 3))
        before, (q, omega, alpha), after = (
            turned(*series(numbers, 0.3, np.array([at])), np.array([0.5, 0.5, -0.5, 0.5]))
            for at in (t - h, t, t + h)
        )
        qd = (after[0] - before[0]) / (2 * h)
        w, v = q[0, 0], q[0, 1:]
        spin = 2 * (w * qd[0, 1:] - qd[0, 0] * v - np.cross(qd[0, 1:], v))
        np.testing.assert_allclose(spin, omega[0], rtol=1e-6, atol=1e-7 * size)
        np.testing.assert_allclose(
            (after[1] - before[1])[0] / (2 * h), alpha[0], rtol=1e-6, atol=1e-6 * size
        )


def test_an_exciting_trajectory_is_better_than_its_start_and_keeps_limits():
    found = identification("3-rrr")
    ranges = {"platform.x": (0.4, 0.5), "leg1.motor": (1.0, 2.4)}
    names = found.dynamics.motors
    home = found.dynamics.home
    slices, model = found.dynamics.models.closure.slices, found.regressor.model
    place = slices[found.dynamics.structure.variables[model.actuated[0]].edge].start
    ranges["leg1.motor"] = (home[place] - 0.2, home[place] + 0.2)
    e = found.exciting_trajectory(
        0.5, ranges=ranges, speeds=dict.fromkeys(names, 0.8), evaluations=150
    )
    assert e.condition < 0.8 * e.before
    assert e.condition == pytest.approx(found.condition(e.states))
    assert e.x[:, 0].min() >= 0.4 - 1e-9
    assert e.x[:, 0].max() <= 0.5 + 1e-9
    assert np.abs(e.states.q[:, place] - home[place]).max() <= 0.2 + 1e-9
    rates = np.einsum("rmi,ri->rm", found.regressor.jacobian(e.states), e.states.y)
    assert np.abs(rates).max() <= 0.8
    assert e.limit_use <= 1
    assert found.dynamics.inverse(e.x, e.xd, e.xdd).solved.all()
    again = found.exciting_trajectory(
        0.5, ranges=ranges, speeds=dict.fromkeys(names, 0.8), evaluations=150
    )
    np.testing.assert_array_equal(e.x, again.x)


def test_an_exciting_trajectory_of_a_pose():
    found = identification("gough-stewart")
    e = found.exciting_trajectory(0.5, harmonics=3, evaluations=37, samples=60)
    assert e.condition < e.before
    np.testing.assert_allclose(np.linalg.norm(e.x[:, 3:], axis=1), 1, rtol=1e-12)
    assert found.dynamics.inverse(e.x, e.xd, e.xdd).solved.all()
    assert e.as_dict()["ending"] == e.ending.name


def test_an_exciting_trajectory_in_joint_space():
    found = identification("four-bar")
    e = found.exciting_trajectory(1.0, ranges={"A": (0.3, 1.8)}, samples=50, evaluations=15)
    assert e.condition <= e.before
    assert found.dynamics.assembler.gaps(e.states.q).max() < 1e-9
    assert e.x.min() >= 0.3
    assert e.x.max() <= 1.8


def test_trajectories_refuse_what_makes_no_sense():
    found = identification("3-rrr")
    with pytest.raises(UnknownName):
        found.exciting_trajectory(ranges={"leg1.motr": (0, 1)})
    with pytest.raises(ConfigurationError, match="does not hold the centre"):
        found.exciting_trajectory(ranges={"platform.x": (0.9, 1)})
    with pytest.raises(ConfigurationError, match="fewer numbers"):
        found.exciting_trajectory(samples=5)
    with pytest.raises(ConfigurationError, match="keeps the limits"):
        found.exciting_trajectory(efforts={"leg1.motor": 1e-6}, evaluations=1)
    with pytest.raises(ConfigurationError, match="floats"):
        identification("biped-leg").exciting_trajectory()


# estimates


def truth_of(found, seed=5):
    """Parameters that a robot could have beside those described: with friction."""
    values, rng = found.parameters.values.copy(), np.random.default_rng(seed)
    for k, kind in enumerate(found.parameters.kinds):
        if kind in ("fv", "fc"):
            values[k] = rng.uniform(0.02, 0.05) * found.parameters.scale[k]
    return values


@pytest.mark.parametrize("name", ["3-rrr", "orthoglide", "gough-stewart", "four-bar", "4-rpr"])
def test_estimates_lie_within_their_deviations(name):
    found, rng = identification(name), np.random.default_rng(8)
    states = random_states(found.regressor, 21, 150)
    values = truth_of(found)
    efforts = found.efforts(states, values)
    sizes = 0.01 * np.abs(efforts).mean(axis=0)
    if found.regressor.form == "shared":
        sizes[:] = sizes.mean()
    noise = rng.normal(size=efforts.shape) * sizes
    estimates = [found.estimate(states, efforts + factor * noise) for factor in (1.0, 10.0)]
    for e in estimates:
        off = (e.values - found.base.of(values)) / e.deviations
        assert np.abs(off).max() < 4
        assert 0.5 < np.sqrt(np.mean(off**2)) < 1.5
    few, many = (e.deviations for e in estimates)
    np.testing.assert_allclose(many / few, 10, rtol=0.1)
    np.testing.assert_allclose(estimates[0].noise, sizes[: len(estimates[0].noise)], rtol=0.2)


def test_known_noise_of_redundant_motors_weights_them():
    found, rng = identification("4-rpr"), np.random.default_rng(9)
    states = random_states(found.regressor, 22, 150)
    efforts = found.efforts(states, truth_of(found))
    noise = np.abs(efforts).mean() * np.array([0.001, 0.01, 0.01, 0.1])
    e = found.estimate(states, efforts + noise * rng.normal(size=efforts.shape), noise)
    off = (e.values - found.base.of(truth_of(found))) / e.deviations
    assert np.abs(off).max() < 4
    assert 0.5 < np.sqrt(np.mean(off**2)) < 1.5


def test_a_floating_mechanism_is_identified_from_free_motion():
    found, rng = identification("biped-leg"), np.random.default_rng(10)
    states = random_states(found.regressor, 23, 100)
    efforts = rng.normal(size=(100, len(found.dynamics.motors))) * 20
    direct = found.dynamics.direct_joint(states.q, states.y, efforts)
    states = States(states.q, states.y, direct.accelerations)
    noisy = efforts + 0.02 * rng.normal(size=efforts.shape)
    e = found.estimate(states, noisy)
    off = (e.values - found.base.values) / e.deviations
    assert np.abs(off).max() < 6  # noise of forces along rates is not the same at all rows
    assert e.relative_residual < 0.01


def test_what_a_motion_does_not_show_is_told():
    found = identification("3-rrr")
    states = random_states(found.regressor, 24, 60)
    still = States(states.q, 0 * states.y, 0 * states.yd)
    e = found.estimate(still, found.efforts(still))
    assert e.badly_determined.all() or np.isinf(e.deviations).sum() >= 9
    assert np.isinf(e.condition)
    assert "badly determined" in str(e)
    with pytest.raises(ConfigurationError, match="measure more rows"):
        found.estimate(states[:3], found.efforts(states[:3]))
    with pytest.raises(ConfigurationError, match="shape"):
        found.estimate(states, np.zeros((3, 3)))


def test_rows_without_weight_do_not_count():
    found = identification("four-bar")
    states = random_states(found.regressor, 25, 60)
    efforts = found.efforts(states)
    wrong, weights = efforts.copy(), np.ones(60)
    wrong[::7] += 100.0
    weights[::7] = 0.0
    e = found.estimate(states, wrong, weights=weights)
    np.testing.assert_allclose(e.values, found.base.values, atol=1e-9)
    assert e.rows == int(weights.sum())


# mechanisms from estimates


@pytest.mark.parametrize("name", ["3-rrr", "gough-stewart", "orthoglide"])
def test_a_mechanism_with_identified_parameters_moves_alike(name):
    found = identification(name)
    parameters, count = found.parameters, found.parameters.inertial
    values, rng = parameters.values.copy(), np.random.default_rng(6)
    bodies = values[:count].reshape(-1, 10)
    bodies *= rng.uniform(0.9, 1.2, size=(len(bodies), 1))
    for k in range(len(bodies)):
        bodies[k] += ten_numbers(0.05, 0.1 * rng.normal(size=3), 1e-3 * np.eye(3))
    rotors = slice(count, count + len(parameters.motors))
    values[rotors] = 0.1 * parameters.scale[rotors]
    mechanism = found.mechanism(found.base.of(values))
    dynamics = Robot(mechanism).dynamics
    states = random_states(found.regressor, 26, 10)
    model = dynamics.model(found.regressor.space)
    forces = model.kernel("forces", "q")(states.q, states.y, states.yd)
    assert relative(forces, found.regressor.along_rates(states) @ values) < 1e-9
    for body in mechanism.bodies.values():
        assert body.mass >= 0


def test_impossible_parameters_are_refused_by_name():
    found = identification("gough-stewart")
    values = found.base.values.copy()
    values[found.base.names.index("platform.m*")] = -1.0
    with pytest.raises(ImpossibleParameters, match="no distribution of mass") as error:
        found.mechanism(values)
    np.testing.assert_allclose(found.base.of(error.value.values), values, atol=1e-9)


def test_pseudo_inertia_tells_real_bodies():
    rng = np.random.default_rng(3)
    points, masses = rng.normal(size=(5, 3)), rng.uniform(0.1, 1, size=5)
    ten = sum(ten_numbers(m, p, np.zeros((3, 3))) for m, p in zip(masses, points, strict=True))
    assert np.linalg.eigvalsh(pseudo_inertia(ten))[0] > 0
    assert np.linalg.eigvalsh(pseudo_inertia(-ten))[0] < 0


def test_a_mechanism_without_motors_is_refused():
    written = gough.load("four-bar").mechanism.written_out()
    joints = {
        name: joint.model_copy(update={"actuated": False}) for name, joint in written.joints.items()
    }
    mechanism = Mechanism(**{**dict(written), "joints": joints})
    with pytest.raises(ConfigurationError, match="no motors"):
        Identification(Robot(mechanism).dynamics)
