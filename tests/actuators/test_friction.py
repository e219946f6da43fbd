"""Friction with and without memory: steady motion, creep, sticking, passivity."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from gough.actuators import LAWS, Situation
from tests.actuators.examples import ALL

FRICTION, LUGRE = LAWS["friction"], LAWS["lugre"]
DRY = {"coulomb": 2.0, "static": 3.0, "stribeck": 0.3}
BRISTLES = {**DRY, "stiffness": 1e3, "damping": 10.0, "viscous": 5.0}


def steady(v, viscous):
    return -np.sign(v) * (2.0 + np.exp(-((v / 0.3) ** 2))) - viscous * v


@pytest.mark.parametrize("v", [-2.0, -0.1, 0.05, 0.3, 1.0])
def test_in_steady_motion_both_are_the_stribeck_curve(v):
    numbers = {**DRY, "velocity": 1e-3, "viscous": 0.5}
    assert FRICTION.effort(Situation(0.0, v), numbers).force == pytest.approx(steady(v, 0.5))

    def rate(t, z):
        return LUGRE.effort(Situation(0.0, v, tuple(z)), BRISTLES).memory_rates

    z = solve_ivp(rate, (0, 1.0 / abs(v)), [0.0], method="LSODA", rtol=1e-10, atol=1e-13).y[:, -1]
    effort = LUGRE.effort(Situation(0.0, v, tuple(z)), BRISTLES)
    assert effort.force == pytest.approx(steady(v, 5.0), rel=1e-6)
    assert effort.dissipated == pytest.approx(-effort.force * v, rel=1e-6)


def pushed(law, numbers, load, end):
    """Position and rate of a mass of 1 kg over time under a load, from rest."""

    def rate(t, state):
        w, v, *memory = state
        effort = law.effort(Situation(w, v, tuple(memory)), numbers)
        return [v, load + effort.force, *effort.memory_rates]

    start = [0.0, 0.0, *law.start(numbers, 0.0)]
    times = np.linspace(0, end, 201)
    found = solve_ivp(rate, (0, end), start, method="LSODA", t_eval=times, rtol=1e-10, atol=1e-13)
    return found.y[0], found.y[1]


def test_lugre_sticks_below_static_friction_and_breaks_away_above():
    w, v = pushed(LUGRE, BRISTLES, 2.9, 20.0)
    assert w[-1] < 0.025
    assert abs(w[-1] - w[100]) < 1e-9
    assert abs(v[-1]) < 1e-9
    w, v = pushed(LUGRE, BRISTLES, 3.1, 20.0)
    assert v[-1] > 0.01
    assert steady(v[-1], 5.0) == pytest.approx(-3.1, rel=1e-6)


def test_tanh_creeps_at_the_rate_its_docstring_tells():
    numbers = {"coulomb": 2.0, "velocity": 0.01}
    _, v = pushed(FRICTION, numbers, 1.5, 1.0)
    assert v[-1] == pytest.approx(0.01 * np.arctanh(1.5 / 2.0), rel=1e-6)


def test_bristles_stay_within_static_friction():
    rng = np.random.default_rng(4)
    amplitudes, rates = rng.normal(size=5), rng.uniform(1, 40, 5)

    def rate(t, z):
        v = float(amplitudes @ np.sin(rates * t))
        return LUGRE.effort(Situation(0.0, v, tuple(z)), BRISTLES).memory_rates

    z = solve_ivp(rate, (0, 5), [0.0], rtol=1e-8, atol=1e-12, max_step=1e-3).y[0]
    assert 2.0 / 1e3 < abs(z).max() <= 3.0 / 1e3


def losses(numbers):
    """Power lost over rates and all deflections that the bristles can come to."""
    largest = numbers["static"] / numbers["stiffness"]
    for v in np.r_[-np.geomspace(1e-4, 1e3, 120), np.geomspace(1e-4, 1e3, 120)]:
        for z in np.linspace(-largest, largest, 81):
            here = Situation(0.0, float(v), (float(z),))
            yield LUGRE.effort(here, numbers).dissipated


@pytest.mark.parametrize("static", [2.2, 3.0, 7.0])
def test_damping_of_bristles_is_passive_up_to_the_bound(static):
    """Barabanov and Ortega's bound is sharp; damping that fades by the other one never gives."""
    numbers = {**BRISTLES, "static": static, "viscous": 10.0 * (static / 2.0 - 1.0)}
    assert not list(LUGRE.problems(numbers))
    assert min(losses(numbers)) >= 0
    active = {**numbers, "viscous": 0.97 * numbers["viscous"]}
    message = dict(LUGRE.problems(active))["damping"]
    assert min(losses(active)) < 0
    fading = float(message.split("damping_velocity: ")[1].split()[0])
    for viscous in (0.0, active["viscous"]):
        faded = {**active, "viscous": viscous, "damping_velocity": fading}
        assert not list(LUGRE.problems(faded))
        assert min(losses(faded)) >= 0
    wide = {**active, "damping_velocity": 2 * fading}
    assert dict(LUGRE.problems(wide)).keys() == {"damping"}
    enough = float(message.split("at least ")[1].split(";")[0])
    assert not list(LUGRE.problems({**active, "viscous": enough}))


def test_friction_without_a_peak_at_rest_is_passive_with_any_damping():
    _, numbers = ALL["lugre"]
    assert not list(LUGRE.problems({**numbers, "damping": 1e4, "viscous": 0.0}))


@pytest.mark.parametrize(
    ("law", "numbers", "names"),
    [
        (FRICTION, {"coulomb": 2.0}, {"velocity"}),
        (FRICTION, {**DRY, "static": 1.0, "velocity": 0.1}, {"static"}),
        (FRICTION, {"coulomb": 2.0, "static": 3.0, "velocity": 0.1}, {"stribeck"}),
        (LUGRE, {**BRISTLES, "static": 1.0}, {"static"}),
        (LUGRE, {"stiffness": 1e3, "coulomb": 2.0, "static": 3.0}, {"stribeck"}),
        (LUGRE, {**BRISTLES, "start": 0.0031}, {"start"}),
        (LUGRE, {**BRISTLES, "start": -0.003}, set()),
        (FRICTION, {"viscous": 2.0}, set()),
    ],
)
def test_what_is_wrong_with_friction(law, numbers, names):
    assert dict(law.problems(numbers)).keys() == names
