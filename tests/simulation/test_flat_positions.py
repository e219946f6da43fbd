"""Runs through positions in which coordinates, or a leg, lose their way."""

import json

import numpy as np
import pytest

from gough.robot import load

STRETCHED = [0.03266773705420994, 0.014928494646523518, -1.1266389076945076]
"""Outputs of delta within 1e-7 of a stretched leg."""


def formulations(run):
    return json.loads(run.attrs["formulations"])


def closure_gap(robot, run):
    return np.abs(robot.models.residual(run.q.values, robot.assembler.p)).max()


def rates_off(robot, run):
    """E v, in parts of the largest rate."""
    E = robot.models.jacobian(run.q.values, robot.assembler.p)
    off = np.abs(np.einsum("tij,tj->ti", E, run.v.values)).max(axis=1)
    return (off / np.maximum(np.abs(run.v.values).max(axis=1), 1.0)).max()


def turned(q):
    """Angles within half a turn."""
    return np.remainder(q + np.pi, 2 * np.pi) - np.pi


def test_a_four_bar_swings_through_its_toggle_positions():
    """The rocker, its output, stands still where crank and coupler are in line."""
    robot = load("four-bar")
    run = robot.simulate(3.0, rtol=1e-12, times=3001)
    assert str(run.ending.values) == "finished"
    used = [tuple(each["independent"]) for each in formulations(run)]
    assert used[0] == ("D",)
    assert ("A",) in used
    A, D = run.q.sel(coordinate="A").values, run.q.sel(coordinate="D").values
    assert np.ptp(A) > 1.5 * np.pi  # the crank went through both toggles
    assert np.sum(np.diff(np.sign(np.gradient(D))) != 0) >= 3  # the rocker came back each time
    largest = float(run.energy_kinetic.max())
    assert np.abs(run.energy_balance_error.values).max() < 1e-9 * max(largest, 1.0)
    assert closure_gap(robot, run) < 1e-10
    assert rates_off(robot, run) < 1e-10


def test_the_motion_does_not_depend_on_the_method():
    robot = load("four-bar")
    runs = [robot.simulate(1.0, rtol=1e-10, times=11, method=m) for m in ("dormand-prince", "bdf")]
    a, b = (turned(run.q.values) for run in runs)
    np.testing.assert_allclose(a, b, atol=1e-6)


def test_a_parallelogram_stays_one_through_its_flat_position():
    """It could fold over there; the rates that lead into the flat position lead out of it."""
    robot = load("four-bar", c=0.1, d=0.3)
    run = robot.simulate(1.0, v0=[20.0], times=1001, gravity=[0, 0, 0])
    A, D = run.q.sel(coordinate="A").values, run.q.sel(coordinate="D").values
    np.testing.assert_allclose(A, D, atol=1e-9)
    np.testing.assert_allclose(A - A[0], 20.0 * run.time.values, atol=1e-7)
    assert closure_gap(robot, run) < 1e-10


def test_a_falling_delta_goes_through_stretched_legs():
    robot = load("delta")
    run = robot.simulate(1.5, rtol=1e-12)
    assert str(run.ending.values) == "finished"
    assert len(formulations(run)) > 3
    assert np.abs(run.energy_balance_error.values).max() < 1e-9
    assert closure_gap(robot, run) < 1e-10
    assert rates_off(robot, run) < 1e-10


def test_direct_dynamics_refuses_a_stretched_leg():
    """Blocks count that results are divided by, whatever sign or product stands in them."""
    found = load("delta").dynamics.direct(STRETCHED, [1.0, 1.0, 1.0], np.zeros(3))
    assert found.regularity < 1e-6
    assert not found.solved


@pytest.mark.parametrize(
    ("name", "v0"),
    [
        ("gough-stewart", [0.1, 0.2, 0, 0.5, -0.3, 0.8]),
        ("biped-leg", [0.04, -0.04, 0.19, 0.03, -0.16, 0.11, 0.39, 0.28, -0.21, -0.38]),
    ],
)
def test_falling_robots_keep_their_energy(name, v0):
    robot = load(name)
    run = robot.simulate(10.0, v0=v0, rtol=1e-12)
    assert str(run.ending.values) == "finished"
    largest = float(run.energy_kinetic.max())
    assert np.abs(run.energy_balance_error.values).max() < 1e-9 * largest
    assert closure_gap(robot, run) < 1e-9  # at heights of 500 m


def test_tolerances_near_rounding_end():
    """Marks are located no more closely than times can be told apart."""
    run = load("deployable-hexapod", variants="dispersed").simulate(1.0, rtol=1e-13)
    assert str(run.ending.values) == "finished"
    assert run.attrs["steps"] < 10_000
    assert np.abs(run.energy_balance_error.values).max() < 1e-11
