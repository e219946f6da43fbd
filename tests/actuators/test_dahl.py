"""Dahl hysteresis: the reference's branches, attractors, loops and their energy, passivity."""

import json
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import quad, solve_ivp

from gough.actuators import LAWS, Situation, curves
from tests.actuators.examples import ALL, TABLE

DAHL = LAWS["dahl"]
DATA = json.loads((Path(__file__).parents[1] / "data" / "hexapod.json").read_text("utf-8"))
PARAMETERS = DATA["params"]
STRAIGHT = ALL["dahl"][1]
TABLES = ALL["dahl of tables"][1]
TIGHT = {"method": "DOP853", "rtol": 3e-14, "atol": 1e-14}


def scaled(scale):
    """The hexapod's law with its forces scaled."""
    p = PARAMETERS
    return {
        "beta": p["beta"],
        "deploying": (scale * p["b_dep"], scale * p["a_dep"]),
        "folding": (scale * p["b_fold"], scale * p["a_fold"]),
    }


def along(numbers, w0, w1, R0, pace=lambda s: (s, 1.0)):
    """Force and work at the end of a way from w0 to w1, by integration.

    ``pace`` gives the part of the way that is done at a time 0 … 1, and its rate.
    """
    corners = sorted(
        (w - w0) / (w1 - w0)
        for key in ("deploying", "folding")
        for w in curves.corners(numbers[key])
        if min(w0, w1) < w < max(w0, w1)
    )
    state = np.array([R0, 0.0])

    def rates(s, state):
        done, speed = pace(s)
        here = Situation(w0 + (w1 - w0) * done, (w1 - w0) * speed, (state[0],))
        effort = DAHL.effort(here, numbers)
        return [effort.memory_rates[0], effort.delivered]

    for start, end in zip([0.0, *corners], [*corners, 1.0], strict=True):
        state = solve_ivp(rates, (start, end), state, **TIGHT).y[:, -1]
    return state


def branch(numbers, w0, w1, R0):
    """The closed form of a monotone branch between straight envelopes."""
    b, a = numbers["deploying" if w1 > w0 else "folding"]
    beta, side = numbers["beta"], np.sign(w1 - w0)
    attractor = [b + a * w - side * a / beta for w in (w0, w1)]
    return attractor[1] + (R0 - attractor[0]) * np.exp(-beta * abs(w1 - w0))


@pytest.mark.parametrize("case", DATA["dahl_monotone"])
def test_monotone_branches_of_the_reference(case):
    numbers = scaled(case["scale"])
    assert not list(DAHL.problems(numbers))
    ends = case["w_start"], case["w_end"], case["R_start"]
    force, work = along(numbers, *ends)
    assert force == pytest.approx(case["R_end"], rel=1e-12)
    assert work == pytest.approx(case["work"], rel=1e-10)
    assert branch(numbers, *ends) == pytest.approx(case["R_end"], rel=1e-12)


def test_the_start_is_the_folding_envelope_unless_it_is_given():
    assert DAHL.start(STRAIGHT, 0.2) == pytest.approx((9 - 3 * 0.2,))
    assert DAHL.start(TABLES, 0.2) == (7.5,)
    assert DAHL.start({**STRAIGHT, "start": 0.0}, 0.2) == (0.0,)
    without = {key: value for key, value in TABLES.items() if key != "start"}
    assert DAHL.start(without, 0.1) == pytest.approx((8.25,))


def test_the_envelopes_attract():
    """Whatever R was, it comes to the envelope less its slope over beta in the way of motion."""
    for start in (-20.0, 0.0, 30.0):
        force, _ = along(STRAIGHT, 0.0, 1.0, start)
        assert force == pytest.approx(6 - 3 + 3 / 50, abs=1e-12)
        force, _ = along(STRAIGHT, 1.0, 0.0, start)
        assert force == pytest.approx(9 - 3 / 50, abs=1e-12)


@pytest.mark.parametrize(
    "pace",
    [
        lambda s: (s * s, 2 * s),
        lambda s: (np.sin(np.pi / 2 * s), np.pi / 2 * np.cos(np.pi / 2 * s)),
    ],
    ids=["from rest", "to rest"],
)
def test_the_force_depends_on_the_way_and_not_on_its_pace(pace):
    steady = along(STRAIGHT, 0.05, 0.25, 8.0)
    np.testing.assert_allclose(along(STRAIGHT, 0.05, 0.25, 8.0, pace), steady, rtol=1e-12)


def loop_energy(numbers, low, high):
    """Energy that a steady loop takes."""
    R, lost = DAHL.start({**numbers, "start": None}, low)[0], 0.0
    for _ in range(200):
        R_high, up = along(numbers, low, high, R)
        after, down = along(numbers, high, low, R_high)
        lost, change, R = -up - down, abs(after - R), after
        if change < 1e-13:
            return lost
    raise AssertionError("the loop does not settle")


@pytest.mark.parametrize("width", [0.02, 0.1, 0.5])
def test_energy_of_a_steady_loop(width):
    beta, a = 50.0, -3.0
    excess = 9.0 - 6.0 + 2 * a / beta
    expected = excess * (width - 2 / beta * np.tanh(beta * width / 2))
    assert loop_energy(STRAIGHT, 0.1, 0.1 + width) == pytest.approx(expected, rel=1e-10)


@pytest.mark.parametrize("ends", [(0.0, 0.5), (0.25, 0.35), (-0.2, 0.8)])
def test_energy_of_a_steady_loop_between_tables(ends):
    """E = ∫ Δ' c dw, which is why Δ' ≥ 0 is asked for."""
    low, high = ends
    beta, middle = TABLES["beta"], sum(ends) / 2

    def gain(w):
        slopes = [curves.slopes_beside(TABLES[key], w)[1] for key in ("deploying", "folding")]
        gap = curves.value(TABLES["folding"], w) - curves.value(TABLES["deploying"], w)
        weight = 1 - np.cosh(beta * (w - middle)) / np.cosh(beta * (high - low) / 2)
        return (gap + sum(slopes) / beta) * weight

    corners = {w for key in ("deploying", "folding") for w, _ in TABLES[key]}
    stops = [low, *sorted(w for w in corners if low < w < high), high]
    pieces = pairwise(stops)
    expected = sum(quad(gain, *piece, epsabs=1e-14, epsrel=1e-13)[0] for piece in pieces)
    assert loop_energy(TABLES, low, high) == pytest.approx(expected, rel=1e-9)


def test_a_table_of_a_straight_line_is_the_line():
    rng = np.random.default_rng(2)
    positions = np.sort(rng.uniform(-0.5, 0.5, 7))
    for b, a in ((6.0, -3.0), (2.0, 5.0)):
        table = tuple((float(w), float(b + a * w)) for w in positions)
        for w in (-2.0, *rng.uniform(-0.6, 0.6, 20), 3.0):
            assert curves.value(table, w) == pytest.approx(b + a * w, abs=1e-13)
            assert curves.slopes_beside(table, w) == pytest.approx((a, a))
    numbers = {
        "beta": 50.0,
        "deploying": ((0.0, 6.0), (0.2, 5.4), (0.7, 3.9)),
        "folding": ((0.1, 8.7), (0.5, 7.5)),
    }
    np.testing.assert_allclose(
        along(numbers, 0.05, 0.65, 8.0), along(STRAIGHT, 0.05, 0.65, 8.0), rtol=1e-12
    )


def test_a_table_is_linear_between_its_rows_and_extended():
    inside = np.linspace(0, 0.6, 61)
    expected = np.interp(inside, *np.transpose(TABLE))
    np.testing.assert_allclose([curves.value(TABLE, w) for w in inside], expected, rtol=1e-14)
    assert curves.value(TABLE, -1.0) == pytest.approx(7.0 + 10.0)
    assert curves.value(TABLE, 1.6) == pytest.approx(4.0 - 5.0)
    assert curves.slopes_beside(TABLE, 0.1) == pytest.approx((-10.0, -2.5))
    assert curves.slopes_beside(TABLE, 0.0) == pytest.approx((-10.0, -10.0))
    assert curves.slopes_beside(TABLE, 0.6) == pytest.approx((-5.0, -5.0))


def told(**numbers):
    return dict(DAHL.problems({"beta": 50.0, **numbers}))


def test_loops_that_give_energy_are_refused():
    """Δ' = 0.1 - 6/50 < 0; the energy of such a loop has the wrong sign, and the ways out do."""
    active = {"beta": 50.0, "deploying": (6.0, -3.0), "folding": (6.1, -3.0)}
    message = dict(DAHL.problems(active))["beta"]
    assert "raise the folding envelope by 0.02, or beta to 60" in message
    assert loop_energy(active, 0.1, 0.3) < 0
    assert not list(DAHL.problems({**active, "folding": (6.12, -3.0)}))
    assert not list(DAHL.problems({**active, "beta": 60.0}))
    # no beta helps where the envelopes cross
    assert "beta to" not in told(deploying=(6.0, -3.0), folding=(5.9, -3.0))["beta"]


def test_tables_are_judged_beside_every_corner():
    """The steep piece of the deploying envelope begins at 0.2: -40/50 beside a gap of 0.7."""
    flat, steep = ((0.0, 6.0), (0.2, 6.0)), (0.3, 2.0)
    assert not told(deploying=flat, folding=((0.0, 6.7), (0.3, 6.7)))
    message = told(deploying=(*flat, steep), folding=((0.0, 6.7), (0.3, 6.7)))["beta"]
    assert "loops near w = 0.2 give energy" in message
    assert "0.7 + (-40)/50, is -0.1," in message
    assert "raise the folding envelope by 0.1, or beta to 57.15" in message
    numbers = {"deploying": (*flat, steep), "folding": ((0.0, 6.7), (0.3, 6.7))}
    assert not list(DAHL.problems({"beta": 57.15, **numbers}))
    # loops that stay away from the piece take energy
    assert not told(**numbers, range=(0.0, 0.15))


def test_straight_envelopes_of_two_slopes_need_a_range():
    numbers = {"deploying": (6.0, -3.0), "folding": (9.0, -6.0)}
    assert told(**numbers).keys() == {"range"}
    assert not told(**numbers, range=(0.0, 0.9))
    assert "loops near w = 1 give energy" in told(**numbers, range=(0.0, 1.0))["beta"]
    assert told(**numbers, range=(0.5, 0.5)).keys() == {"range"}
    # equal slopes need none, whatever the last bit of an expression says
    assert not told(deploying=(6.0, -3.0), folding=(9.0, -3.0 * (1 + 4e-16)))
