"""Deployments of the hexapod against the histories and the numbers of its reference."""

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gough.robot import Robot, load

DATA = json.loads((Path(__file__).parents[1] / "data" / "hexapod.json").read_text("utf-8"))
HISTORIES = {each["name"]: each for each in DATA["deployments"]}
MODELS = {"exact": (), "truncated": ("truncated",), "as_printed": ("as-printed",)}


def deployed(*variants, **asked):
    return load("deployable-hexapod", variants=variants).simulate(1.0, **asked)


def coordinates(run):
    """Position and rotation vector of the platform, (times, 6)."""
    w, x, y, z = run.pose.values[:, 3:].T
    turn = Rotation.from_quat(np.stack([x, y, z, w], axis=1)).as_rotvec()
    return np.concatenate([run.pose.values[:, :3], turn], axis=1)


CASES = [("symmetric", "exact"), *(("dispersed", model) for model in MODELS)]


@pytest.mark.parametrize(("name", "model"), CASES)
def test_histories(name, model):
    history, variants = HISTORIES[name], MODELS[model]
    if name == "dispersed":
        variants = ("dispersed", *variants)
    run = deployed(*variants, rtol=1e-10, times=history["t"])
    expected = history[model]
    within = {"rtol": 0, "atol": 1e-9}
    np.testing.assert_allclose(coordinates(run), expected["v"], **within)
    np.testing.assert_allclose(run.twist.values[:, :3], np.array(expected["vdot"])[:, :3], **within)
    np.testing.assert_allclose(run.actuator_memory.values, expected["R"], **within)
    np.testing.assert_allclose(run.energy_delivered.values, expected["energy_in"], **within)


def test_heights_and_energies_of_section_9():
    run = deployed(rtol=1e-10, times=[0, 0.2, 0.4, 0.45, 0.5, 1.0])
    heights = [0.2200, 0.3961, 0.8732, 0.8837, 0.8857, 0.8857]
    np.testing.assert_allclose(run.pose.values[:, 2], heights, atol=5e-5)
    assert float(run.energy_delivered[-1]) == pytest.approx(18.911, abs=5e-4)
    assert float(run.energy_dissipated[-1]) == pytest.approx(18.911, abs=2e-3)


@pytest.mark.parametrize("model", MODELS)
def test_energies_are_in_balance(model):
    run = deployed("dispersed", *MODELS[model], rtol=1e-10)
    assert str(run.ending.values) == "finished"
    assert np.abs(run.energy_balance_error.values).max() < 1e-8


def test_the_symmetric_run_is_straight():
    run = deployed(rtol=1e-10)
    straight = coordinates(run)
    straight[:, 2] = 0
    assert np.abs(straight).max() < 1e-9


def test_models_of_the_platform_differ_as_told():
    """Largest differences from the exact model in section 9, in mm and mrad, every 0.05 s.

    Seen every 0.001 s the largest turn about y differs by 2.03 mrad (as_printed), at 0.396 s.
    """
    exact, truncated, printed = (
        coordinates(deployed("dispersed", *MODELS[model], rtol=1e-10, times=21)) for model in MODELS
    )
    unit = 1e3
    found = np.abs(truncated - exact).max(axis=0) * unit
    np.testing.assert_allclose(found, [0.05, 0.05, 0.12, 0.15, 0.16, 1.4], rtol=0.15)
    found = np.abs(printed - exact).max(axis=0) * unit
    np.testing.assert_allclose(found, [1.2, 0.22, 0.11, 3.7, 1.3, 1.2], rtol=0.15)


def test_the_dispersed_platform_twists():
    run = deployed("dispersed", rtol=1e-9)
    assert np.degrees(coordinates(run)[-1, 5]) == pytest.approx(-79, abs=0.6)


def universal(axial):
    """Legs with mass on universal feet; moments about the leg that no body has pass unchecked."""
    mechanism = load("deployable-hexapod", variants="massive-legs").mechanism
    leg = mechanism.legs["leg"]
    reel = leg.bodies["reel"].model_copy(update={"inertia": (6e-4, 6e-4, axial)})
    leg = leg.model_copy(update={"bodies": {**leg.bodies, "reel": reel}})
    return Robot(mechanism.model_copy(update={"legs": {"leg": leg}}))


def test_universal_feet_lag_behind_spherical_ones():
    """Section 8: 0.23 mm and 2.2 mm at 0.40 s, for the moments 8e-4 and 8e-3 kg m²."""
    spherical = load("deployable-hexapod", variants=("massive-legs", "spherical"))
    feet = [spherical, universal(8e-4), universal(8e-3)]
    z = [robot.simulate(0.4, times=2).pose.values[-1, 2] for robot in feet]
    np.testing.assert_allclose(1e3 * (z[0] - np.array(z[1:])), [0.23, 2.2], rtol=0.03)


def scaled(time=1.0, length=0.45, **factors):
    """The platform's pose at the end with parameters multiplied."""
    robot = load("deployable-hexapod", variants="dispersed")
    given = robot.mechanism.parameters
    values = {
        name: np.multiply(np.array(given[name].value, dtype=float), factor).tolist()
        for name, factor in factors.items()
    }
    changed = load("deployable-hexapod", variants="dispersed", **values)
    return changed.simulate(length * time, rtol=1e-10, times=2).pose.values[-1]


def test_similarity():
    """Forces and masses alike leave the motion; masses alone stretch its time."""
    plain = scaled()
    heavy = {"mass": 4, "reel_inertia": 4}
    forces = {"deploying": 4, "folding": 4, "stop_stiffness": 4, "stop_damping": 4}
    np.testing.assert_allclose(scaled(**heavy, **forces), plain, atol=1e-8)
    np.testing.assert_allclose(scaled(time=2.0, **heavy, stop_damping=2), plain, atol=1e-8)
