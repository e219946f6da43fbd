"""What every law obeys: energy, the same on numbers and symbols, right examples."""

from dataclasses import replace

import casadi
import numpy as np
import pytest

from gough.actuators import LAWS, Situation
from gough.actuators.base import UNITS
from gough.kernels import Kernel
from tests.actuators.examples import (
    ALL,
    flat,
    law_of,
    power_of_storing,
    situations,
    symbols,
    values_of,
)

EVERY = pytest.mark.parametrize("name", ALL)


def test_every_law_has_an_example():
    assert {law for law, _ in ALL.values()} == set(LAWS)


@EVERY
def test_the_examples_have_no_problems(name):
    law, numbers = law_of(name)
    assert list(law.problems(numbers)) == []
    assert [law.numbers[key].problem(key, x, "m") for key, x in numbers.items()] == [None] * len(
        numbers
    )
    assert all(key in numbers for key, number in law.numbers.items() if number.required)


@pytest.mark.parametrize("law", LAWS.values(), ids=LAWS)
def test_kinds_of_units_and_names_are_known(law):
    kinds = [number.unit for number in law.numbers.values()]
    assert {*kinds, *law.memory_units, law.command or "1"} <= UNITS.keys()
    assert len(law.memory) == len(law.memory_units)


@pytest.mark.parametrize("branches", [False, True])
@EVERY
def test_force_times_rate_is_what_is_delivered_less_lost_less_stored(name, branches):
    law, numbers = law_of(name)
    situation, listed = symbols(law, branches)
    effort = law.effort(situation, numbers)
    terms = [
        effort.force * situation.rate,
        -effort.delivered,
        effort.dissipated,
        power_of_storing(situation, effort),
    ]
    found = casadi.Function("terms", listed, [casadi.vertcat(*terms)])
    for here in situations(law, 200):
        taken = tuple(float(here.rate > 0) for _ in law.switches) if branches else None
        parts = np.array(found(*flat(replace(here, branches=taken)))).ravel()
        assert abs(parts.sum()) <= 1e-12 * max(1.0, abs(parts).max())


def test_the_identity_is_not_empty():
    """Each quantity differs from zero in some law."""
    for quantity in ("force", "stored", "dissipated", "delivered"):
        values = [
            getattr(law.effort(here, numbers), quantity)
            for law, numbers in map(law_of, ALL)
            for here in situations(law, 3)
        ]
        assert np.abs(values).max() > 0.1


def replaced(numbers):
    """The numbers as symbols, the list of these, and their values."""
    listed, values = [], []

    def symbol(x):
        if isinstance(x, tuple):
            return tuple(symbol(item) for item in x)
        listed.append(casadi.SX.sym(f"p{len(listed)}"))
        values.append(x)
        return listed[-1]

    return {key: symbol(x) for key, x in numbers.items()}, listed, values


@EVERY
def test_numbers_and_symbols_agree(name):
    """Situations as symbols, and the law's numbers too as live parameters are."""
    law, numbers = law_of(name)
    situation, listed = symbols(law)
    live, more, values = replaced(numbers)
    outcome = casadi.vertcat(*values_of(law.effort(situation, live)), law.inertia(live))
    found = casadi.Function("effort", [*listed, *more], [outcome])
    start = casadi.Function(
        "start", [listed[0], *more], [casadi.vertcat(*law.start(live, listed[0]))]
    )
    for here in situations(law, 50):
        expected = [*values_of(law.effort(here, numbers)), law.inertia(numbers)]
        result = np.array(found(*flat(here), *values)).ravel()
        np.testing.assert_allclose(result, expected, rtol=1e-12, atol=1e-12)
        memory = np.array(start(here.position, *values)).ravel()
        np.testing.assert_allclose(memory, law.start(numbers, here.position), rtol=1e-13)


@EVERY
def test_kernels_of_laws_agree(name):
    law, numbers = law_of(name)
    situation, listed = symbols(law)
    outcome = casadi.vertcat(*values_of(law.effort(situation, numbers)))
    kernel = Kernel("effort", {"x": casadi.vertcat(*listed)}, outcome)
    here = list(situations(law, 64))
    expected = [values_of(law.effort(one, numbers)) for one in here]
    found = kernel(np.array([flat(one) for one in here]))[..., 0]
    np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-12)


@EVERY
def test_events_that_switch_stand_in_the_order_of_the_switches(name):
    law, numbers = law_of(name)
    effort = law.effort(next(situations(law, 1)), numbers)
    assert tuple(event.name for event in effort.events if event.kind == "switch") == law.switches
    assert len({event.name for event in effort.events}) == len(effort.events)


@pytest.mark.parametrize("name", [name for name in ALL if law_of(name)[0].switches])
def test_a_frozen_branch_is_the_law_on_its_side_and_smooth_beyond(name):
    law, numbers = law_of(name)
    for here in situations(law, 50):
        up = float(here.rate >= 0)
        frozen = replace(here, branches=(up,))
        assert law.effort(frozen, numbers) == pytest.approx(law.effort(here, numbers))
        steps = [replace(frozen, rate=here.rate + k) for k in (0.0, 0.7, -3.0)]
        rates = [law.effort(one, numbers).memory_rates[0] for one in steps]
        assert rates[1] - rates[0] == pytest.approx((rates[2] - rates[0]) * 0.7 / -3.0)


@EVERY
def test_without_motion_nothing_is_lost_or_delivered(name):
    law, numbers = law_of(name)
    for here in situations(law, 20):
        effort = law.effort(replace(here, rate=0.0), numbers)
        assert effort.dissipated == 0
        assert effort.delivered == 0
        assert all(rate == 0 for rate in effort.memory_rates)


@EVERY
def test_nothing_is_lost_with_a_negative_sign(name):
    """Passive numbers lose power in every situation the law can come to."""
    law, numbers = law_of(name)
    assert all(law.effort(here, numbers).dissipated >= 0 for here in situations(law, 300, seed=3))


@EVERY
def test_laws_of_rates_do_not_look_at_the_position(name):
    law, numbers = law_of(name)
    if not law.needs_position:
        for here in situations(law, 10):
            moved = replace(here, position=here.position + 1.0)
            assert law.effort(moved, numbers) == law.effort(here, numbers)


def test_a_reel_is_felt_as_a_mass():
    law, numbers = law_of("reel")
    assert law.inertia(numbers) == pytest.approx(2e-4 / 0.05**2)
    assert law.effort(Situation(0.3, 1.0), numbers).force == 0
    assert law.freedoms == ("m",)


def test_a_spring_with_a_preload():
    law, numbers = law_of("spring-damper")
    at_rest = law.effort(Situation(0.2, 0.0), numbers)
    assert (at_rest.force, at_rest.stored) == (-1.5, 0.0)
    assert law.effort(Situation(0.3, 2.0), numbers).force == pytest.approx(-1.5 - 4.0 - 6.0)


@pytest.mark.parametrize("law", LAWS.values(), ids=LAWS)
def test_problems_of_extreme_numbers_are_told_and_do_not_raise(law):
    rng = np.random.default_rng(6)
    sizes = [0.0, 5e-324, 1e-300, 1e-20, 1.0, 3.0, 1e12]

    def value(number):
        signed = 1.0 if number.sign == "positive" else rng.choice([-1.0, 1.0])
        size = float(signed * rng.choice(sizes[1:] if number.sign == "positive" else sizes))
        if number.shape == "number":
            return abs(size) if number.sign == "nonnegative" else size
        pairs = [tuple(map(float, rng.choice(sizes, 2))) for _ in range(3)]
        table = tuple(sorted({w: (w, F) for w, F in pairs}.values()))
        return pairs[0] if number.shape == "pair" or len(table) < 2 or size < 0 else table

    for _ in range(300):
        chosen = {
            key: value(number)
            for key, number in law.numbers.items()
            if number.required or rng.random() < 0.5
        }
        wrong = [law.numbers[key].problem(key, x, "m") for key, x in chosen.items()]
        if wrong == [None] * len(chosen):
            assert all(key in law.numbers and text for key, text in law.problems(chosen))
