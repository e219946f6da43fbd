"""End stops: the reference's numbers, potentials, mirror images."""

import json
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import minimize_scalar

from gough.actuators import LAWS, Situation

STOP = LAWS["end-stop"]
DATA = json.loads((Path(__file__).parents[1] / "data" / "hexapod.json").read_text("utf-8"))
P = DATA["params"]
NUMBERS = {
    "stiffness": P["K"],
    "damping": P["a"],
    "sharpness_spring": P["sK"],
    "sharpness_damper": P["sa"],
}
UPPER, LOWER = {**NUMBERS, "upper": P["wlim"]}, {**NUMBERS, "lower": -P["wlim"]}
SIDES = pytest.mark.parametrize(("numbers", "side"), [(UPPER, 1.0), (LOWER, -1.0)])


def at(numbers, x, x_rate=0.0, side=1.0):
    """Effort at a penetration and its rate."""
    return STOP.effort(Situation(side * (P["wlim"] + x), side * x_rate), numbers)


@SIDES
@pytest.mark.parametrize("case", DATA["end_stop"])
def test_the_reference(case, numbers, side):
    """At the origin, where 0.6 + x does not lose digits of x."""
    here = {key: 0.0 if key in ("upper", "lower") else x for key, x in numbers.items()}
    effort = STOP.effort(Situation(side * case["x"], side * case["wdot"]), here)
    assert -side * effort.force == pytest.approx(case["force"], rel=1e-10)
    assert effort.stored == pytest.approx(case["U"], rel=1e-10, abs=1e-16)
    assert effort.dissipated == pytest.approx(case["power_dissipated"], rel=1e-10)
    moved = at(numbers, case["x"], case["wdot"], side)
    assert -side * moved.force == pytest.approx(case["force"], rel=1e-10, abs=1e-10)


@SIDES
@pytest.mark.parametrize("one_signed", [0.0, 1.0])
def test_the_potential_is_the_integral_of_the_spring(numbers, side, one_signed):
    """From far away, where both are nothing, in units of the width 1/σ."""
    numbers = {**numbers, "one_signed": one_signed}
    for x in (-1.5e-3, -3e-4, 0.0, 4e-4, 3e-3):
        points = [-4e-3, *(edge for edge in (-1e-3, 0.0, 1e-3) if edge < x), x]
        pieces = pairwise(points)
        work = sum(
            quad(lambda s: -side * at(numbers, s, 0.0, side).force, *piece, epsrel=1e-13)[0]
            for piece in pieces
        )
        assert at(numbers, x, 0.0, side).stored == pytest.approx(work, rel=1e-9, abs=1e-12)


@SIDES
def test_the_spring_pulls_a_little_before_contact(numbers, side):
    sigma, K = P["sK"], P["K"]
    found = minimize_scalar(
        lambda x: -side * at(numbers, x / sigma, 0.0, side).force,
        bounds=(-3, 0),
        method="bounded",
        options={"xatol": 1e-9},
    )
    assert found.x == pytest.approx(-0.53160, abs=5e-6)
    assert found.fun == pytest.approx(-0.12019 * K / sigma, rel=5e-5)


@SIDES
def test_a_one_signed_spring_never_pulls_and_is_convex(numbers, side):
    numbers = {**numbers, "one_signed": 1.0}
    x = np.linspace(-4, 4, 401) / P["sK"]
    force = np.array([-side * at(numbers, one, 0.0, side).force for one in x])
    assert force.min() >= 0
    assert np.diff(force, 2).min() > -1e-9
    assert force[-1] == pytest.approx(P["K"] * x[-1])


def test_far_from_a_stop_there_is_nothing_and_far_within_a_spring_and_a_damper():
    assert at(UPPER, -0.5, 3.0).force == 0
    assert at(UPPER, -0.5, 3.0).stored == 0
    effort = at(UPPER, 0.1, 2.0)
    assert effort.force == pytest.approx(-P["K"] * 0.1 - P["a"] * 2.0)
    assert effort.stored == pytest.approx(P["K"] * 0.1**2 / 2, rel=1e-4)
    assert effort.dissipated == pytest.approx(P["a"] * 4.0)


def test_two_stops_are_the_sum_of_their_efforts():
    both = {**UPPER, "lower": 0.55, "sharpness_spring": 40.0}
    one, other = ({**both, key: None} for key in ("lower", "upper"))
    here = Situation(0.58, 0.4)
    sums = [STOP.effort(here, numbers) for numbers in (one, other)]
    found = STOP.effort(here, both)
    for name in ("force", "stored", "dissipated"):
        assert getattr(found, name) == pytest.approx(sum(getattr(e, name) for e in sums))
    marks = {event.name: event.value for event in found.events}
    assert marks == pytest.approx({"contact_upper": -0.02, "contact_lower": -0.03})
    assert [event.kind for event in found.events] == ["mark", "mark"]


def test_the_damper_sets_in_as_the_spring_where_nothing_is_said():
    without = {key: x for key, x in UPPER.items() if key != "sharpness_damper"}
    assert at(without, 1e-4, 1.0) == at(UPPER, 1e-4, 1.0)


def test_what_is_wrong_with_a_stop():
    problems = {
        "upper": NUMBERS,
        "lower": {**UPPER, "lower": 0.7},
        "one_signed": {**UPPER, "one_signed": 0.5},
    }
    for name, numbers in problems.items():
        assert dict(STOP.problems(numbers)).keys() == {name}
