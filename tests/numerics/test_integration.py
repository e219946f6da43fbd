"""Initial value problems: orders, events, endings, samples, what states obey; every integrator."""

import sys

import casadi
import numpy as np
import pytest

from gough.errors import MissingExtra
from gough.numerics.integration import Event
from tests.numerics.ordinary import METHODS, Written, ending, events

EVERY = pytest.mark.parametrize("method", METHODS)
DP = "dormand-prince"
TIMES = np.linspace(0.0, 10.0, 321)

GROWTH = Written(1, lambda w: [w.y[0] * casadi.cos(w.t)])
"""y = exp(sin t) from 1."""


def circle(*values, kinds=("mark",), directions=(0,), **named):
    """Sine and cosine from (0, 1), with events."""
    found = tuple(
        Event(f"event{k}", kind, direction)
        for k, (kind, direction) in enumerate(zip(kinds, directions, strict=True))
    )
    return Written(
        2, lambda w: [w.y[1], -w.y[0]], lambda w: [value(w) for value in values], found, **named
    )


def half(w):
    return w.y[0] - 0.5


SINE = circle(half)
RISING, FALLING = np.pi / 6 + 2 * np.pi * np.arange(4), 5 * np.pi / 6 + 2 * np.pi * np.arange(4)
CROSSINGS = np.sort(np.concatenate([RISING, FALLING]))[:7]
"""Those of one half before t = 20."""


def slope(x, y):
    return np.polyfit(np.log(x), np.log(y), 1)[0]


# orders


def fixed(problem, start, end, count, **named):
    """A run with so many steps of one length."""
    step = end / count
    runs = problem.run(
        DP, start, end, rtol=1.0, atol=1e6, first_step=step, largest_step=step, **named
    )
    assert runs.counts[0, 0] in (count, count + 1)
    return runs


def test_steps_are_of_order_5_and_the_interpolant_is_no_worse():
    counts, at_steps, between = [20, 40, 80, 160], [], []
    for count in counts:
        runs = fixed(GROWTH, [1.0], 10.0, count, sample_times=np.linspace(0, 10, 8 * count + 1))
        found = runs.samples[0, :, 0] - np.exp(np.sin(np.linspace(0, 10, 8 * count + 1)))
        at_steps.append(np.abs(found[::8]).max())
        between.append(np.abs(found).max())
    assert slope(counts[1:], at_steps[1:]) == pytest.approx(-5, abs=0.25)
    assert slope(counts[1:], between[1:]) == pytest.approx(-5, abs=0.25)


@EVERY
def test_errors_are_in_proportion_to_the_tolerance(method):
    tolerances = 10.0 ** -np.arange(4, 13)
    errors = []
    for rtol in tolerances:
        runs = GROWTH.run(method, [1.0], 10.0, rtol=rtol, sample_times=TIMES)
        assert ending(runs) == "finished"
        errors.append(np.abs(runs.samples[0, :, 0] - np.exp(np.sin(TIMES))).max())
    assert np.all(errors < (60 if method == DP else 1000) * tolerances)
    assert slope(tolerances, errors) == pytest.approx(1, abs=0.2)


@pytest.mark.parametrize("order", [1, 2, 3, 4])
@pytest.mark.parametrize("method", ["adams", "bdf"])
def test_multistep_formulas_have_the_order_that_is_asked_for(method, order):
    first, last = {1: (3, 6), 2: (5, 9), 3: (6, 11), 4: (6, 12)}[order]
    counts, errors = [], []
    for rtol in 10.0 ** -np.arange(first, last):
        runs = GROWTH.run(method, [1.0], 10.0, rtol=rtol, max_order=order, sample_times=TIMES)
        counts.append(runs.counts[0, 0])
        errors.append(np.abs(runs.samples[0, :, 0] - np.exp(np.sin(TIMES))).max())
    assert order - 0.6 < -slope(counts, errors) < order + 1


@EVERY
def test_integrators_agree_on_a_stiff_problem_of_moderate_size(method):
    problem = Written(1, lambda w: [-1e3 * (w.y[0] - casadi.cos(w.t))])
    runs = problem.run(method, [1.0], 2.0, rtol=1e-9)
    exact = (np.cos(2.0) + 1e-3 * np.sin(2.0)) / (1 + 1e-6)
    assert runs.states[0, 0] == pytest.approx(exact, abs=1e-7)


# the same bits whoever stands beside

PENDULUMS = Written(
    3,
    lambda w: [w.y[1], -w.p[0] * casadi.sin(w.y[0]) - w.branches[0] * w.p[1] * w.y[1], w.y[1] ** 2],
    lambda w: [w.y[1], w.y[0] - 0.2, w.y[2] - 4.0],
    (Event("reversal", "switch"), Event("passing", "mark"), Event("far", "stop", 1)),
    p=2,
)


def same(a, b):
    for name in ("states", "branches", "times", "ending", "counts", "event_times", "event_kinds"):
        np.testing.assert_array_equal(getattr(a, name), getattr(b, name), err_msg=name)
    np.testing.assert_array_equal(a.samples, b.samples)


def many_pendulums(rows, **named):
    rng = np.random.default_rng(5)
    starts = np.column_stack([rng.uniform(-2, 2, 37), np.zeros(37), np.zeros(37)])
    p = np.column_stack([rng.uniform(0.3, 3, 37), rng.uniform(0, 0.5, 37)])
    branches = np.where(rng.random(37) < 0.5, 1.0, 0.0)[:, None]
    return PENDULUMS.run(
        DP,
        starts[rows],
        9.0,
        rtol=1e-7,
        p=p[rows],
        branches=branches[rows],
        sample_times=np.linspace(0, 9, 7),
        **named,
    )


def picked(runs, rows):
    return type(runs)(*(getattr(runs, name)[rows] for name in runs.__dataclass_fields__))


def test_bits_depend_on_neither_lanes_nor_neighbours_nor_threads():
    rows = np.arange(37)
    runs = many_pendulums(rows)
    assert {ending(runs, k) for k in rows} == {"finished", "stopped"}
    for width in (4, 8):
        same(many_pendulums(rows, width=width), runs)
    order = np.random.default_rng(1).permutation(37)
    same(many_pendulums(order, width=8), picked(runs, order))
    for chosen in (rows[:1], rows[3:8], rows[5::3], rows[:0]):
        same(many_pendulums(chosen, width=8), picked(runs, chosen))
    for threads in (2, 5, None):
        same(many_pendulums(rows, width=8, threads=threads), runs)


# events


@EVERY
def test_marks_are_where_values_vanish(method):
    for rtol in (1e-6, 1e-9, 1e-12):
        runs = SINE.run(method, [0.0, 1.0], 20.0, rtol=rtol)
        np.testing.assert_allclose(events(runs)[0], CROSSINGS, rtol=0, atol=500 * rtol)
        assert runs.counts[0, 3] == len(CROSSINGS)


def test_interpolated_marks_are_of_order_4_in_the_step():
    counts, errors = [40, 80, 160, 320], []
    for count in counts:
        runs = fixed(SINE, [0.0, 1.0], 20.0, count, exact=False)
        errors.append(np.abs(events(runs)[0] - CROSSINGS).max())
    assert slope(counts, errors) == pytest.approx(-4, abs=0.3)
    runs = SINE.run(DP, [0.0, 1.0], 20.0, rtol=1e-8, exact=False)
    np.testing.assert_allclose(events(runs)[0], CROSSINGS, atol=2e-6)
    plain = circle(kinds=(), directions=()).run(DP, [0.0, 1.0], 20.0)
    assert runs.counts[0, 0] == plain.counts[0, 0]  # marks that are interpolated cost no step
    runs = SINE.run(DP, [0.0, 1.0], 20.0, rtol=1e-8, exact=False, once=True)
    np.testing.assert_allclose(events(runs)[0], CROSSINGS[:1], atol=2e-6)


@EVERY
def test_directions(method):
    problem = circle(half, half, kinds=("mark", "mark"), directions=(1, -1))
    found = events(problem.run(method, [0.0, 1.0], 20.0))
    np.testing.assert_allclose(found[0], RISING, atol=2e-6)
    np.testing.assert_allclose(found[1], FALLING[FALLING < 20], atol=2e-6)


@EVERY
def test_a_stop_ends_the_run_there(method):
    problem = circle(half, kinds=("stop",), directions=(-1,))
    runs = problem.run(method, [0.0, 1.0], 20.0, rtol=1e-10, sample_times=[0.0, 2.0, 2.6, 2.7])
    assert ending(runs) == "stopped"
    np.testing.assert_allclose(runs.times, FALLING[:1], atol=1e-8)
    np.testing.assert_allclose(runs.states, [[0.5, -np.sqrt(0.75)]], atol=1e-8)
    np.testing.assert_array_equal(np.isnan(runs.samples[0, :, 0]), [False, False, False, True])


@EVERY
def test_a_guard_ends_the_run_behind_its_level(method):
    problem = circle(lambda w: w.y[1], kinds=("guard",))
    runs = problem.run(method, [0.0, 1.0], 20.0, guard=0.3)
    assert ending(runs) == "guarded"
    assert runs.states[0, 1] < 0.3
    assert runs.states[0, 1] > -0.3  # a step beyond at most


@EVERY
def test_events_at_one_time_all_happen(method):
    for kinds in (("mark", "mark", "mark"), ("mark", "stop", "mark"), ("stop", "mark", "guard")):
        values = half, lambda w: 0.5 - w.y[0], lambda w: 3 * (0.5 - w.y[0])
        problem = circle(*values, kinds=kinds, directions=(0, 0, 0))
        runs = problem.run(method, [0.0, 1.0], 2.0, guard=0.0)
        times = events(runs)
        watched = [k for k, kind in enumerate(kinds) if kind != "guard"]
        assert sorted(times) == watched
        for k in watched:
            np.testing.assert_allclose(times[k], RISING[:1], atol=2e-6)
        # a stop counts more than a guard
        assert ending(runs) == ("stopped" if "stop" in kinds else "finished")


@EVERY
def test_the_first_event_of_a_step_is_found_where_straight_lines_mislead(method):
    early = lambda w: casadi.exp(-10 * w.t) - np.exp(-3)  # noqa: E731
    problem = Written(
        1,
        lambda w: [1.0],
        lambda w: [0.5 - w.t, early(w)],
        (Event("late", "stop"), Event("early", "mark")),
    )
    runs = problem.run(method, [0.0], 1.0, first_step=1.0)
    np.testing.assert_allclose(events(runs)[1], [0.3], atol=1e-8)
    np.testing.assert_allclose(runs.times, 0.5, atol=1e-8)


@EVERY
@pytest.mark.parametrize("rtol", [1e-4, 1e-8, 1e-12])
def test_switches_change_the_equations(method, rtol):
    """ẍ = -sign x has pieces of parabolas, which Dormand and Prince's formulas have exactly."""
    problem = Written(
        2,
        lambda w: [w.y[1], 1 - 2 * w.branches[0]],
        lambda w: [w.y[0]],
        (Event("side", "switch"),),
    )
    runs = problem.run(method, [0.5, 0.0], 9.5, rtol=rtol, sample_times=[2.0, 9.5])
    allowed = 20 * np.sqrt(rtol) * 0.01 if method == DP else 100 * rtol + 1e-12
    np.testing.assert_allclose(events(runs)[0], [1, 3, 5, 7, 9], atol=allowed)
    expected = [[-0.5, 0.0], [-0.375, -0.5]]
    np.testing.assert_allclose(runs.samples[0], expected, atol=allowed)


def test_a_switch_there_and_back_within_a_step_is_seen():
    """Stages show a visit of the other side that neither end of the step shows."""
    problem = Written(
        1,
        lambda w: [w.branches[0]],
        lambda w: [(w.t - 0.25) * (w.t - 0.75)],
        (Event("side", "switch"),),
    )
    runs = problem.run(DP, [0.0], 1.0, rtol=1e-8, first_step=1.0)
    np.testing.assert_allclose(events(runs)[0], [0.25, 0.75], atol=1e-5)
    np.testing.assert_allclose(runs.states, 0.5, atol=1e-5)


@EVERY
def test_a_value_that_starts_at_zero_is_no_event(method):
    problem = circle(lambda w: w.y[0])
    runs = problem.run(method, [0.0, 1.0], 10.0)
    np.testing.assert_allclose(events(runs)[0], [np.pi, 2 * np.pi, 3 * np.pi], atol=2e-6)


@EVERY
def test_a_value_that_touches_zero_changes_nothing(method):
    for value in (lambda w: (w.t - 0.5) ** 2, lambda w: 1 - w.y[0] + 1e-9, lambda w: 0 * w.t):
        problem = circle(value)
        runs = problem.run(method, [0.0, 1.0], 3.0)
        assert ending(runs) == "finished"
        assert runs.counts[0, 3] <= 1
        np.testing.assert_allclose(runs.states[0], [np.sin(3), np.cos(3)], atol=1e-6)


@EVERY
def test_events_beyond_the_room_are_counted(method):
    runs = SINE.run(method, [0.0, 1.0], 20.0, room=3)
    np.testing.assert_allclose(runs.event_times[0], CROSSINGS[:3], atol=2e-6)
    assert runs.counts[0, 3] == len(CROSSINGS)
    assert SINE.run(method, [0.0, 1.0], 20.0, room=0).counts[0, 3] == len(CROSSINGS)


@pytest.mark.parametrize("rtol", [1e-4, 1e-8, 1e-12, 1e-13, 1e-15])
def test_a_mark_of_a_value_that_jumps_is_noted_once(rtol):
    problem = Written(
        1,
        lambda w: [1.0],
        lambda w: [casadi.if_else(w.y[0] < 0.337, 1, -1)],
        (Event("jump", "mark"),),
    )
    runs = problem.run(DP, [0.0], 1.0, rtol=rtol)
    assert runs.counts[0, 3] == 1
    np.testing.assert_allclose(events(runs)[0], [0.337], atol=1e-6 * np.sqrt(rtol) + 1e-13)


@EVERY
@pytest.mark.parametrize("start", [0.0, 0.5])
def test_a_switch_that_both_ways_lead_across_ends_the_run(method, start):
    """ẏ = -sign y stays at zero; no integrator hangs there."""
    problem = Written(
        1, lambda w: [1 - 2 * w.branches[0]], lambda w: [w.y[0]], (Event("side", "switch"),)
    )
    runs = problem.run(method, [start], 1.0, rtol=1e-6, first_step=0.1, max_steps=2000)
    assert ending(runs) in ("step_limit", "too_small", "finished")
    assert abs(runs.states[0, 0]) < 1e-4


# signals


def square():
    breaks = np.arange(0.0, 10.0, 0.7)
    coefficients = np.zeros((len(breaks), 1, 6))
    coefficients[:, 0, 0] = (-1.0) ** np.arange(len(breaks))
    return breaks, coefficients


@EVERY
def test_steps_end_where_signals_jump(method):
    breaks, coefficients = square()
    problem = Written(
        1, lambda w: [w.signals[0] - w.y[0]], breaks=breaks, coefficients=coefficients
    )
    exact, last = 0.0, 0.0
    for end, value in zip([*breaks[1:], 10.0], coefficients[:, 0, 0], strict=True):
        exact, last = value + (exact - value) * np.exp(last - end), end
    runs = problem.run(method, [0.0], 10.0, rtol=1e-10)
    np.testing.assert_allclose(runs.states, exact, atol=3e-9)
    if method == DP:  # a step that looks across a jump would be refused again and again
        assert runs.counts[0, 1] <= 20
        assert runs.counts[0, 0] < 400


@EVERY
def test_short_pulses_are_not_stepped_over(method):
    coefficients = np.zeros((4, 2, 6))
    coefficients[1, 0, 0], coefficients[2, 1] = 1.0, [0, 1, 2, 3, 4, 5]
    breaks = np.array([-1.0, 5.0, 5.01, 7.0])
    problem = Written(
        2, lambda w: [w.signals[0], w.signals[1]], breaks=breaks, coefficients=coefficients
    )
    runs = problem.run(method, [0.0, 0.0], 10.0, rtol=1e-9)
    area = sum(k * 1.99 ** (k + 1) / (k + 1) for k in range(6))
    np.testing.assert_allclose(runs.states, [[0.01, area]], rtol=2e-7)


def test_signals_of_powers_of_time_are_integrated_exactly():
    coefficients = np.zeros((1, 1, 6))
    coefficients[0, 0, :5] = [1, 2, 3, 4, 5]
    problem = Written(
        1, lambda w: [w.signals[0]], breaks=np.array([0.5]), coefficients=coefficients
    )
    runs = fixed(problem, [0.0], 2.0, 3)
    area = sum((k + 1) * (1.5 ** (k + 1) - (-0.5) ** (k + 1)) / (k + 1) for k in range(5))
    np.testing.assert_allclose(runs.states, area, rtol=1e-13)


# endings


@EVERY
def test_a_blow_up_ends_the_run_before_it(method):
    problem = Written(1, lambda w: [w.y[0] ** 2])
    runs = problem.run(method, [1.0], 2.0)
    assert ending(runs) in ("too_small", "not_finite")
    assert runs.times[0] == pytest.approx(1.0, abs=1e-5)
    assert np.isfinite(runs.states[0, 0])


@EVERY
def test_rates_that_stop_being_numbers_end_the_run(method):
    problem = Written(1, lambda w: [casadi.sqrt(0.5 - w.t)])
    runs = problem.run(method, [0.0], 2.0)
    assert ending(runs) in ("too_small", "not_finite")
    assert runs.times[0] == pytest.approx(0.5, abs=1e-6)
    assert runs.states[0, 0] == pytest.approx(2 / 3 * 0.5**1.5, abs=1e-6)


@EVERY
@pytest.mark.parametrize("start", [1.0, np.nan, np.inf])
def test_rates_that_are_no_numbers_at_the_start_end_it_at_once(method, start):
    problem = Written(2, lambda w: [casadi.sqrt(w.y[0] - 2) + 0 * w.y[0], w.y[1]])
    runs = problem.run(method, [start, 1.0], 2.0)
    assert ending(runs) in ("not_finite", "too_small")
    assert runs.times[0] == 0.0
    assert runs.counts[0, :3].max() < 400


@EVERY
def test_nothing_moves_where_rates_are_zero(method):
    problem = Written(2, lambda w: [0 * w.y[0], 0 * w.y[1]])
    for atol in (1e-8, 1e-100) if method == DP else (1e-8,):
        runs = problem.run(method, [0.0, 3.0], 2.0, atol=atol, sample_times=[0.0, 1.0, 2.0])
        assert ending(runs) == "finished"
        np.testing.assert_array_equal(runs.samples[0], [[0.0, 3.0]] * 3)


def test_a_stiff_problem_meets_the_step_limit_and_backward_differences_do_not():
    problem = Written(1, lambda w: [-1e6 * (w.y[0] - casadi.cos(w.t))])
    runs = problem.run(DP, [1.0], 2.0, max_steps=2000)
    assert ending(runs) == "step_limit"
    assert runs.counts[0, :2].sum() == 2000
    runs = problem.run("bdf", [1.0], 2.0, max_steps=2000)
    assert ending(runs) == "finished"
    assert runs.counts[0, 0] < 300
    assert runs.states[0, 0] == pytest.approx(np.cos(2.0), abs=2e-6)


def test_durations_of_any_size():
    for duration in (1e-300, 1e-20, 1e-3, 1e3, 1e6):
        problem = Written(1, lambda w: [-w.p[0] * w.y[0]], p=1)
        runs = problem.run(DP, [1.0], duration, p=[1 / duration])
        assert ending(runs) == "finished"
        assert runs.times[0] == duration
        assert runs.states[0, 0] == pytest.approx(np.exp(-1), abs=1e-7)
    runs = GROWTH.run(DP, [2.0], 3.0, begin=3.0, sample_times=[3.0])
    assert ending(runs) == "finished"
    assert runs.states[0, 0] == 2.0 == runs.samples[0, 0, 0]


def test_whole_numbers_as_times():
    runs = SINE.run(DP, [0, 1], 1, begin=0, max_steps=1)
    assert 0 < runs.times[0] < 1
    assert runs.times.dtype == float


@EVERY
def test_the_first_step_keeps_to_the_longest_one(method):
    runs = GROWTH.run(method, [1.0], 1.0, rtol=1e-2, largest_step=1e-3, max_steps=1)
    assert 0 < runs.times[0] <= 1.0001e-3
    if method == DP:
        runs = GROWTH.run(DP, [1.0], 1.0, first_step=0.5, largest_step=1e-3, max_steps=1)
        assert runs.times[0] <= 1.0001e-3


@EVERY
def test_tight_tolerances_start_from_zero(method):
    for rtol in (1e-12, 1e-13):
        runs = SINE.run(method, [0.0, 0.0], 20.0, rtol=rtol)
        assert ending(runs) == "finished"
        runs = circle(kinds=(), directions=()).run(method, [0.0, 1.0], 20.0, rtol=rtol)
        assert ending(runs) == "finished"
        np.testing.assert_allclose(runs.states[0], [np.sin(20), np.cos(20)], atol=1000 * rtol)


# samples


@EVERY
def test_samples_in_a_step_with_an_event(method):
    """A body that is thrown has rates that formulas of order 2 have exactly: long steps."""
    problem = Written(
        2, lambda w: [w.y[1], -1.0], lambda w: [w.y[0]], (Event("ground", "stop", -1),)
    )
    times = np.linspace(0.0, 2.0, 41)
    runs = problem.run(method, [0.0, 1.0], 9.0, rtol=1e-9, sample_times=times)
    assert ending(runs) == "stopped"
    found, seen = runs.samples[0, :, 0], times < runs.times[0]
    np.testing.assert_allclose(found[seen], (times - times**2 / 2)[seen], atol=1e-7)


@EVERY
def test_samples_at_start_and_end_and_far_more_than_steps(method):
    times = np.linspace(0.0, 10.0, 5001)
    runs = GROWTH.run(method, [1.0], 10.0, rtol=1e-9, sample_times=times)
    assert runs.counts[0, 0] < 2000
    allowed = 2e-8 if method == DP else 1e-6
    np.testing.assert_allclose(runs.samples[0, :, 0], np.exp(np.sin(times)), atol=allowed)
    np.testing.assert_array_equal(runs.samples[0, [0, -1]], [[1.0], runs.states[0]])
    alone = GROWTH.run(method, [1.0], 10.0, rtol=1e-9)
    if method == DP:  # looking on changes nothing
        np.testing.assert_array_equal(alone.states, runs.states)
    else:
        np.testing.assert_allclose(alone.states, runs.states, atol=1e-7)


# what states obey


def turning():
    def rates(w):
        q, turn = w.y, casadi.vertcat(0.3, -1.0, 2.0)
        return [
            -0.5 * casadi.dot(q[1:], turn),
            *casadi.vertsplit(0.5 * (q[0] * turn - casadi.cross(turn, q[1:]))),
        ]

    return Written(4, rates, quaternions=(0,))


@EVERY
def test_quaternions_stay_unit(method):
    times = np.linspace(0, 30, 77)
    runs = turning().run(
        method, [1.0, 0, 0, 0], 30.0, rtol=1e-4, sample_times=times, largest_step=0.5
    )
    lengths = np.linalg.norm(runs.samples[0], axis=1)
    np.testing.assert_allclose(lengths, 1.0, atol=4e-16)
    np.testing.assert_allclose(np.linalg.norm(runs.states[0]), 1.0, atol=4e-16)
    runs = turning().run(method, [1.0, 0, 0, 0], 30.0, rtol=1e-10, sample_times=times)
    size = np.linalg.norm([0.3, -1.0, 2.0])
    expected = np.outer(np.sin(size * times / 2), [0.3, -1, 2]) / size
    np.testing.assert_allclose(runs.samples[0, :, 1:], expected, atol=3e-7)


def swinging(w):
    """A pendulum of length 1 whose bob has coordinates; the third state is its turning rate."""
    x, y, turn = casadi.vertsplit(w.y)
    return [-y * turn, x * turn, -9.81 * x]


def on_the_circle(w):
    q, step = w.y[:2], casadi.SX.sym("step")
    return q, casadi.sumsqr(q) - 1, q * (1 + step), step


@pytest.mark.parametrize(("method", "end"), [(DP, 1000.0), ("adams", 100.0), ("bdf", 100.0)])
def test_a_pendulum_in_cartesian_coordinates_stays_on_its_circle(method, end):
    start, times = [0.8, -0.6, 0.0], np.linspace(0.0, end, 333)

    def gap(problem, rtol):
        runs = problem.run(method, start, end, rtol=rtol, sample_times=times)
        assert ending(runs) == "finished"
        states = np.vstack([runs.samples[0], runs.states])
        energy = 0.5 * states[:, 2] ** 2 + 9.81 * states[:, 1]
        return np.abs(np.sum(states[:, :2] ** 2, axis=1) - 1).max(), np.ptp(energy)

    rtol = 1e-8 if method == DP else 1e-7
    drift, _ = gap(Written(3, swinging), rtol)
    left, energy = gap(Written(3, swinging, equations=on_the_circle), rtol)
    assert drift > 1e-8
    assert left < 1e-11
    assert energy < 2e-3


@EVERY
def test_equations_that_roundings_keep_open_are_closed_as_far_as_they_can_be(method):
    """Two gears that have turned 1e4 rad: the gap is known to 1e-12 at best."""

    def equations(w):
        q, step = w.y[:2], casadi.SX.sym("step")
        return q, casadi.sin(q[1] - 1.1 * q[0]), casadi.vertcat(q[0], q[1] + step), step

    problem = Written(2, lambda w: [2000.0, 2200.0 + 1e-9], equations=equations)
    runs = problem.run(method, [0.0, 0.0], 10.0, rtol=1e-6, largest_step=0.01)
    assert ending(runs) == "finished"
    assert abs(runs.states[0, 1] - 1.1 * runs.states[0, 0]) < 1e-10


@EVERY
def test_equations_that_can_not_be_closed_end_the_run(method):
    def equations(w):
        q, step = w.y[:1], casadi.SX.sym("step")
        return q, q[0] ** 2 + 1 + 0 * step, q + step, step

    runs = Written(1, lambda w: [1.0], equations=equations).run(method, [0.5], 1.0)
    assert ending(runs) == "drifted"


def test_without_scikit_sundae_the_package_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "sksundae.cvode", None)
    with pytest.raises(MissingExtra, match="scikit-sundae"):
        GROWTH.run("bdf", [1.0], 1.0)
