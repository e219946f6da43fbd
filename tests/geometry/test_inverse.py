"""Inverse geometry: closed forms, working modes, reach."""

import json
from pathlib import Path

import numpy as np
import pytest

import gough
from gough import catalogue
from gough.errors import ConfigurationError, OutOfReach

DATA = Path(__file__).parents[1] / "data"
WITHOUT_OUTPUTS = {"andrews-squeezer", "biped-leg"}
ROBOTS = [name for name in catalogue.names() if name not in WITHOUT_OUTPUTS]
CLOSED_FORM = {
    "2rpr": 1, "3-prr": 8, "3-rpr": 1, "3-rrr": 8, "4-rpr": 1, "6-sps": 1, "6-ups": 1,
    "agile-eye": 8, "bennett": 1, "delta": 8, "delta-parallelogram": 8, "deployable-hexapod": 1,
    "five-bar": 4, "four-bar": 2, "gough-stewart": 1, "hexa": 64, "hexaglide": 64,
    "linear-delta": 8, "orthoglide": 8, "sarrus": 4, "slider-crank": 2, "tripteron": 8,
}  # fmt: skip
"""Working modes at home of the robots whose legs are solved in closed form."""


def walk(robot, count, reach=0.25, seed=1):
    """Closed configurations near home, on its motion."""
    rng = np.random.default_rng(seed)
    found = [robot.home.q]
    while len(found) < count:
        q = robot.assembler.wander(robot.home.q, rng, reach)
        if q is not None:
            found.append(q)
    return np.array(found)


def outputs(robot, q):
    """Operational coordinates of configurations."""
    return robot._inverse.coordinates.of(q)


@pytest.mark.parametrize("name", ROBOTS)
def test_configurations_come_back_from_their_outputs(name):
    robot = gough.load(name)
    q = walk(robot, 6)
    found = robot.inverse_geometry(outputs(robot, q), near=q)
    assert robot.assembler.gaps(found).max() < 1e-9
    np.testing.assert_allclose(outputs(robot, found), outputs(robot, q), atol=1e-9)
    if name not in ("2rpr-slider", "bricard"):  # one has more motors than outputs
        actuated = robot._direct_problem().actuated
        np.testing.assert_allclose(actuated.of(found), actuated.of(q), atol=1e-8)


@pytest.mark.parametrize("name", CLOSED_FORM)
def test_working_modes_all_close_and_home_is_one(name):
    robot = gough.load(name)
    modes = robot.working_modes(robot.home.x)
    assert len(modes) == CLOSED_FORM[name]
    assert robot.assembler.gaps(modes.q).max() < 1e-9
    np.testing.assert_allclose(
        outputs(robot, modes.q),
        np.broadcast_to(robot.home.x, (len(modes), len(robot.home.x))),
        atol=1e-9,
    )
    at = modes.words().index(modes.near)
    np.testing.assert_allclose(modes.q_actuated[at], robot.home.q_actuated, atol=1e-9)
    assert len(set(modes.words())) == len(modes)
    assert str(modes).startswith(f"{len(modes)} working mode")


def test_which_robots_have_closed_forms():
    found = {name for name in ROBOTS if gough.load(name).has_closed_form}
    assert found == CLOSED_FORM.keys()


@pytest.mark.parametrize("name", ["five-bar", "3-rrr", "orthoglide", "hexa", "agile-eye"])
def test_the_mode_of_near_is_kept(name):
    robot = gough.load(name)
    for mode in robot.working_modes(robot.home.x).q[::3]:
        x = outputs(robot, walk(robot, 20, 0.1))
        found = robot.reach(x, near=mode)
        assert found.reached.mean() > 0.5
        signs = {tuple(robot._inverse.signs(q)) for q in found.q[found.reached]}
        assert signs == {tuple(robot._inverse.signs(mode))}


def test_the_reference_geometry_of_the_orthoglide():
    robot = gough.load("orthoglide")
    names = list(robot.position_names)
    columns = [
        names.index(f"leg{leg}.{joint}") for leg in (1, 2, 3) for joint in ("slide", "j2", "j3")
    ]
    cases = json.loads((DATA / "orthoglide.json").read_text())["cases"]
    found = robot.inverse_geometry([case["P"] for case in cases])[:, columns]
    expected = np.array([np.ravel(case["q"]) for case in cases])
    np.testing.assert_allclose(found, expected, atol=1e-10)


def test_batches_have_any_leading_axes():
    robot = gough.load("3-rrr")
    x = np.broadcast_to(robot.home.x, (2, 3, 3)) + 0.01
    assert robot.inverse_geometry(x).shape == (2, 3, len(robot.home.q))
    assert robot.inverse_geometry(x[:0]).shape == (0, 3, len(robot.home.q))
    np.testing.assert_array_equal(robot.inverse_geometry(x)[1, 2], robot.inverse_geometry(x[1, 2]))


# out of reach


def test_what_is_missing_is_told_in_lengths():
    """Straight legs tell how far they are from the point, by hand."""
    robot = gough.load("hexa")
    x = robot.home.x.copy()
    x[2] -= 1.0
    with pytest.raises(
        OutOfReach, match=r"^pose is out of reach: leg1 is \d+\.?\d* mm too short; leg2"
    ):
        robot.inverse_geometry(x)
    bar = gough.load("five-bar")  # arms of 0.6 m and bars of 0.7 m on motors 1 m apart
    with pytest.raises(
        OutOfReach, match=r"leg1 is 281\.1 mm too short; leg2 is 281\.1 mm too short"
    ):
        bar.inverse_geometry([0.5, 1.5])
    with pytest.raises(OutOfReach, match=r"leg1 is 50 mm too long"):
        bar.inverse_geometry([0.05, 0.0])
    slider = gough.load("slider-crank")  # a crank of 50 mm and a rod of 180 mm
    with pytest.raises(OutOfReach, match=r"out of reach: rod is 170 mm too short$"):
        slider.inverse_geometry([0.4])


def test_a_leg_without_length_has_no_direction():
    """The point on the pin of a leg: any angle of the leg closes the loop."""
    found = gough.load("2rpr").reach([0.0, 0.0])
    assert not found.reached
    assert "direction is open" in found.reasons[0]


@pytest.mark.parametrize("near", [1.0, [np.nan] * 6, [[0.0] * 5]])
def test_near_is_a_whole_configuration(near):
    with pytest.raises(ConfigurationError, match="all joint positions, all finite"):
        gough.load("five-bar").inverse_geometry([0.5, 0.8], near=near)


def test_reach_says_which_rows_have_a_configuration():
    robot = gough.load("orthoglide")
    x = np.array([robot.home.x, [0.5, 0, 0.6], robot.home.x + 0.01])
    found = robot.reach(x)
    assert found.reached.tolist() == [True, False, True]
    assert found.reasons == ("", "leg1 is 189.4 mm too short; leg3 is 189.4 mm too short", "")
    assert np.isfinite(found.q).all()
    with pytest.raises(OutOfReach, match="pose 1 of 3 is out of reach: leg1") as error:
        robot.inverse_geometry(x)
    assert error.value.rows == (1,)


def test_a_pose_on_the_edge_is_reached():
    """Legs just stretched, where two working modes meet."""
    robot = gough.load("five-bar")
    straight = np.array([0.5, np.sqrt(1.3**2 - 0.25)])
    modes = robot.working_modes(straight * (1 - 1e-12))
    assert np.ptp(modes.q_actuated, axis=0).max() < 1e-5
    assert robot.reach(straight * (1 - 1e-12)).reached


def test_poses_that_a_mechanism_can_not_take():
    robot = gough.load("bennett")
    found = robot.reach(robot.home.x)
    assert found.reached
    with pytest.raises(ConfigurationError, match="has no operational coordinates"):
        gough.load("biped-leg").inverse_geometry([])


def test_wrong_input():
    robot = gough.load("gough-stewart")
    with pytest.raises(
        ConfigurationError, match=r"x has shape \(6,\), expected \(\.\.\., 7\): x, y, z, qw"
    ):
        robot.inverse_geometry(np.zeros(6))
    with pytest.raises(ConfigurationError, match="quaternion of x is off by 1"):
        robot.inverse_geometry(np.zeros(7))
    with pytest.raises(ConfigurationError, match="not finite"):
        robot.inverse_geometry(np.full(7, np.nan))
    with pytest.raises(ConfigurationError, match=r"near has shape \(3,\), expected \(\.\.\., 25\)"):
        robot.inverse_geometry(robot.home.x, near=[1, 2, 3])
    with pytest.raises(ConfigurationError, match="no closed form"):
        gough.load("3-rps").working_modes(gough.load("3-rps").home.x)
    with pytest.raises(ConfigurationError, match=r"x has shape \(1, 2\), expected one pose"):
        gough.load("five-bar").working_modes([[0.4, 0.8]])


def test_scaled_machines_have_scaled_solutions():
    size = 1e-4
    robot = gough.load("five-bar")
    small = gough.load(
        "five-bar", d=size, l1=0.6 * size, l2=0.7 * size, x=0.45 * size, y=0.8 * size
    )
    np.testing.assert_allclose(
        small.working_modes(robot.home.x * size).q_actuated,
        robot.working_modes(robot.home.x).q_actuated,
    )
