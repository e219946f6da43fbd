"""Newton steps by one kernel: roots, endings, and that no row sees its neighbours."""

import gc
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from types import SimpleNamespace

import casadi as ca
import numba
import numpy as np
import pytest

from benchmarks import direct_geometry
from gough.kernels import Kernel
from gough.numerics import stepping_loops
from gough.numerics.stepping import (
    CONTRACTION,
    ENDINGS,
    GROWTHS,
    NOTHING,
    StepEnding,
    Stepper,
    step_batch,
)

ANCHORS = direct_geometry.anchors()


@cache
def platform():
    return direct_geometry.step_kernel()


def curve(equation, k=1):
    """Step kernel of one equation of one unknown."""
    x, a = ca.SX.sym("x"), ca.SX.sym("a", k)
    r = equation(x, a)
    slope = ca.jacobian(r, x)
    output = ca.vertcat(x - r / slope, ca.fabs(r), slope, ca.fabs(r / slope))
    return Kernel("curve", {"x": x, "a": a}, output, (4,))


def batch(kernel, x0, a, p=(), **options):
    return step_batch(kernel, x0, a, p, **options)


def variant(kernel, name):
    """A kernel with one variant of its code only."""
    address = getattr(kernel.addresses, name)
    return SimpleNamespace(addresses=SimpleNamespace(wide=address, scalar=address), owner=kernel)


def one_by_one(kernel, x0, a, p, contraction, tolerance=1e-12, max_steps=12):
    """The same in Python, from the whole way of each row."""
    return [way(lambda x, own=own: kernel(x, own, p), start, contraction, tolerance, max_steps)
            for start, own in zip(x0, a, strict=True)]  # fmt: skip


def way(step, x, contraction, tolerance, max_steps):
    n, points, gaps, side, before = len(x), [x], [np.inf], 0.0, 0.0
    for steps in range(max_steps + 1):
        *after, gap, d, size = step(x)
        side = d if steps == 0 else side
        if not (np.isfinite(gap) and np.isfinite(d)):
            ending = StepEnding.not_finite
            break
        if side * d < 0:
            ending = StepEnding.crossed
            break
        points.append(x)
        gaps.append(gap)
        if before > NOTHING and size > contraction * before:
            ending = StepEnding.far
            break
        before = size
        if gap <= tolerance:
            ending = StepEnding.closed
            break
        if len(gaps) > GROWTHS + 1 and all(np.diff(gaps[-GROWTHS - 1 :]) > 0):
            ending = StepEnding.diverged
            break
        ending, x = StepEnding.step_limit, np.array(after)
    assert len(x) == n
    best = max(k for k, gap in enumerate(gaps) if gap == min(gaps))
    return points[best], gaps[best], ending, steps


def rows_of(found):
    return found.x, found.gap, found.ending, found.steps


def same_bits(found, expected):
    for first, second in zip(rows_of(found), expected, strict=True):
        np.testing.assert_array_equal(first, second)


# the platform


def test_direct_geometry_undoes_inverse_geometry():
    poses, a, starts = direct_geometry.data(500)
    found = batch(platform(), starts, a, ANCHORS)
    assert found.ended(StepEnding.closed).all()
    assert found.gap.max() <= 1e-12
    assert found.steps.max() <= 4
    np.testing.assert_allclose(found.x, poses, atol=1e-11)


def scattered():
    """Starts so far away that rows end in many ways."""
    _, a, starts = direct_geometry.data(300, seed=2, displaced=1.5)
    starts[7], starts[8, 2], a[9, 3], a[11] = np.nan, np.inf, np.nan, 0.1
    return starts, a


@pytest.mark.parametrize("contraction", [CONTRACTION, np.inf])
def test_rows_end_as_told_with_the_best_point_of_their_way(contraction):
    starts, a = scattered()
    found = batch(platform(), starts, a, ANCHORS, contraction=contraction)
    expected = one_by_one(platform(), starts, a, ANCHORS, contraction)
    x, gap, ending, steps = zip(*expected, strict=True)
    same_bits(found, (x, gap, [ENDINGS.index(e) for e in ending], steps))
    ends = {StepEnding.closed, StepEnding.crossed, StepEnding.not_finite}
    assert ends | ({StepEnding.far} if contraction < 1 else set()) <= set(ending)


@pytest.mark.parametrize("rows", [1, 2, 7, 8, 9, 127, 128, 129, 300])
def test_a_row_has_the_same_bits_in_any_batch(rows):
    starts, a = scattered()
    whole = batch(platform(), starts, a, ANCHORS)
    part = batch(platform(), starts[:rows], a[:rows], ANCHORS)
    same_bits(part, [of[:rows] for of in rows_of(whole)])


@pytest.mark.parametrize("threads", [None, 1, 2, 3, 40])
def test_a_row_has_the_same_bits_in_any_order_by_any_threads(threads):
    starts, a = scattered()
    order = np.random.default_rng(0).permutation(len(a))
    whole = batch(platform(), starts, a, ANCHORS)
    mixed = batch(platform(), starts[order], a[order], ANCHORS, threads=threads)
    same_bits(mixed, [of[order] for of in rows_of(whole)])


@pytest.mark.parametrize("name", ["scalar", "wide"])
def test_a_stepper_gives_the_bits_of_a_batch(name):
    starts, a = scattered()
    whole = batch(platform(), starts, a, ANCHORS)
    stepper = Stepper(variant(platform(), name), 7, 6, ANCHORS)
    for k in range(len(a)):
        x, ending, steps = stepper(starts[k], a[k])
        np.testing.assert_array_equal(x, whole.x[k])
        assert (ending, steps) == (whole.ending[k], whole.steps[k])


def test_closed_rows_are_on_the_side_where_they_started():
    starts, a = scattered()
    found = batch(platform(), starts, a, ANCHORS, contraction=np.inf)
    closed = found.ended(StepEnding.closed)
    d = platform()(np.stack([starts, found.x]), a, ANCHORS)[..., -2]
    assert closed.sum() > 10
    assert (d[0] * d[1] > 0)[closed].all()


# endings, with one unknown


CURVES = {
    # equation, start, a, best point, ending, steps
    "straight": (lambda x, a: 2 * x - a, 1.0, 4.0, 2.0, StepEnding.closed, 1),
    "closed at the start": (lambda x, a: x**2 - a, 2.0, 4.0, 2.0, StepEnding.closed, 0),
    "closed, singular": (lambda x, a: x**2 - a, 0.0, 0.0, 0.0, StepEnding.closed, 0),
    "singular start": (lambda x, a: x**2 - a, 0.0, 1.0, 0.0, StepEnding.not_finite, 1),
    "over the fold": (lambda x, a: x**3 - 2 * x + a, 0.0, 2.0, 0.0, StepEnding.crossed, 1),
    "onto the fold": (lambda x, a: x**3 - 3 * x + a, 0.0, 3.0, 0.0, StepEnding.crossed, 1),
    "off the domain": (lambda x, a: ca.log(x) - a, 4.0, 0.0, 4.0, StepEnding.not_finite, 1),
    "not a number": (lambda x, a: x - a, np.nan, 1.0, np.nan, StepEnding.not_finite, 0),
    "too steep": (lambda x, a: ca.atan(x) - a, 1.5, 0.0, 1.5, StepEnding.diverged, GROWTHS),
    "double root": (lambda x, a: (x - a) ** 2, 1.0, 0.0, 2.0**-12, StepEnding.step_limit, 12),
}


@pytest.mark.parametrize("name", CURVES)
def test_endings(name):
    equation, start, a, best, ending, steps = CURVES[name]
    kernel = curve(equation)
    found = batch(kernel, [[start]], [[a]], contraction=np.inf)
    assert ENDINGS[found.ending[0]] is ending
    assert found.steps[0] == steps
    np.testing.assert_array_equal(found.x, [[best]])
    gap = kernel([best], [a])[1]
    np.testing.assert_array_equal(found.gap, gap if gap < np.inf else np.inf)


def test_a_gap_that_grows_once_may_fall_again():
    kernel = curve(lambda x, a: x**2 - a)
    found = batch(kernel, [[0.3]], [[1.0]], contraction=np.inf)
    assert found.ended(StepEnding.closed).all()
    assert kernel(kernel([0.3], [1.0])[:1], [1.0])[1] > kernel([0.3], [1.0])[1]


def test_of_points_with_the_same_gap_the_last_is_kept():
    kernel = curve(lambda x, a: x / ca.sqrt(ca.fabs(x)) + a)  # each step leads from x to -x
    for steps in (2, 3):
        found = batch(kernel, [[1.0], [4.0]], [[0.0], [0.0]], max_steps=steps, contraction=np.inf)
        assert found.ended(StepEnding.step_limit).all()
        assert found.x.tolist() == [[(-1.0) ** steps], [4 * (-1.0) ** steps]]


def test_no_steps_judge_the_starts():
    kernel = curve(lambda x, a: x**2 - a)
    found = batch(kernel, [[1.0], [2.0]], [[1.0], [1.0]], max_steps=0)
    assert found.ended(StepEnding.closed).tolist() == [True, False]
    assert found.ended(StepEnding.step_limit).tolist() == [False, True]


def test_a_tolerance_is_kept():
    kernel = curve(lambda x, a: x**2 - a)
    found = batch(kernel, [[1.0]], [[2.0]], tolerance=0.1)
    assert (found.steps[0], found.x[0, 0]) == (1, 1.5) or found.gap[0] <= 0.1
    assert found.steps[0] < batch(kernel, [[1.0]], [[2.0]]).steps[0]


def test_endings_tell_the_user_something():
    assert len({ending.value for ending in StepEnding}) == len(StepEnding) == 6
    for ending in StepEnding:
        assert ENDINGS.index(ending) == getattr(stepping_loops, ending.name.upper())


# guards


def ratio(start, a):
    """Of the second step to the first towards a root of x² = a."""
    first = start - (start + a / start) / 2
    after = start - first
    return abs((after - a / after) / 2) / abs(first)


@pytest.mark.parametrize("start", [0.5, 0.6, 0.7, 1.0, 1.5, 2.0, 3.0, 6.0])
def test_a_start_counts_if_its_second_step_is_a_quarter_of_the_first(start):
    found = batch(curve(lambda x, a: x**2 - a), [[start]], [[1.0]])
    near = start == 1.0 or ratio(start, 1.0) <= CONTRACTION
    assert ENDINGS[found.ending[0]] is (StepEnding.closed if near else StepEnding.far)
    assert near or found.steps[0] == 1


def test_the_steps_are_compared_after_the_first_two_as_well():
    kernel = curve(lambda x, a: ca.if_else(x > 1, x - 0.5, x**2) - a)  # steps 2, 1/4, 1/8
    found = batch(kernel, [[2.5]], [[0.0]])
    assert (ENDINGS[found.ending[0]], found.steps[0]) == (StepEnding.far, 2)
    assert found.x[0, 0] == 0.25


def test_next_to_nothing_may_be_followed_by_any_step():
    kernel = curve(lambda x, a: (x - a) ** 2)  # each step is half of the one before
    found = batch(kernel, [[NOTHING], [4 * NOTHING]], [[0.0], [0.0]], tolerance=1e-18)
    assert [ENDINGS[k] for k in found.ending] == [StepEnding.closed, StepEnding.far]


def test_the_first_step_may_have_a_longest_length():
    kernel = curve(lambda x, a: 2 * x - a)
    for longest, ending in ((0.9, StepEnding.far), (1.1, StepEnding.closed)):
        found = batch(kernel, [[1.0]], [[4.0]], longest=longest)
        assert ENDINGS[found.ending[0]] is ending
        stepper = Stepper(kernel, 1, 1, [], longest=longest)
        assert ENDINGS[stepper([1.0], [4.0])[1]] is ending


def test_a_side_may_be_given():
    kernel = curve(lambda x, a: x**2 - a)
    found = batch(kernel, [[1.1], [1.1], [1.1]], [[1.0]] * 3, side=[2.0, -1.0, 0.0])
    ends = [StepEnding.closed, StepEnding.crossed, StepEnding.closed]
    assert [ENDINGS[k] for k in found.ending] == ends
    assert found.x[1, 0] == 1.1


@pytest.mark.parametrize("wrong", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("column", range(13))
def test_what_is_not_finite_never_closes(wrong, column):
    poses, a, _ = direct_geometry.data(9)
    given = np.concatenate([poses, a], axis=1)
    given[4, column] = wrong
    found = batch(platform(), given[:, :7], given[:, 7:], ANCHORS)
    assert found.ended(StepEnding.closed).tolist() == [k != 4 for k in range(9)]
    assert not np.isfinite(platform()(given[4, :7], given[4, 7:], ANCHORS)[7:9]).all()


def test_a_kernel_lives_as_long_as_its_stepper():
    stepper = Stepper(curve(lambda x, a: x**2 - a), 1, 1, [])
    gc.collect()
    assert stepper([1.1], [1.0])[0] == pytest.approx(1.0)


# inputs


def test_inputs_without_numbers_are_left_out():
    kernel = curve(lambda x, a: x**3 - 8, k=0)
    found = batch(kernel, [[1.8], [2.2], [2.5]], np.empty((3, 0)))
    np.testing.assert_allclose(found.x, 2.0, rtol=1e-12)
    x, ending, _ = Stepper(kernel, 1, 0, [])([2.2], [])
    np.testing.assert_allclose(x, 2.0, rtol=1e-12)
    assert ENDINGS[ending] is StepEnding.closed


def test_shared_numbers_without_own_ones():
    x, p = ca.SX.sym("x"), ca.SX.sym("p", 2)
    r = p[0] * x - p[1]
    output = ca.vertcat(x - r / p[0], ca.fabs(r), p[0], ca.fabs(r / p[0]))
    kernel = Kernel("line", {"x": x, "p": p}, output, (4,))
    found = batch(kernel, np.zeros((20, 1)), np.empty((20, 0)), [2.0, 6.0])
    np.testing.assert_array_equal(found.x, np.full((20, 1), 3.0))


def test_an_empty_batch():
    found = batch(platform(), np.empty((0, 7)), np.empty((0, 6)), ANCHORS)
    assert found.x.shape == (0, 7)
    assert found.gap.shape == found.ending.shape == found.steps.shape == (0,)


def test_starts_are_left_as_they_are_and_may_be_any_arrays():
    _, a, starts = direct_geometry.data(30)
    kept = starts.copy()
    expected = rows_of(batch(platform(), starts, a, ANCHORS))
    spread = np.repeat(starts, 2, axis=1)[:, ::2]
    spread.flags.writeable = False
    same_bits(batch(platform(), spread, np.asfortranarray(a), ANCHORS.tolist()), expected)
    stepper = Stepper(platform(), 7, 6, ANCHORS)
    backwards = starts[3, ::-1].copy()[::-1]
    for start in (starts[3], spread[3], starts[3].tolist(), tuple(starts[3]), backwards):
        for own in (a[3], np.repeat(a[3], 2)[::2], a[3].tolist()):
            np.testing.assert_array_equal(stepper(start, own)[0], expected[0][3])
    np.testing.assert_array_equal(starts, kept)


def test_a_stepper_takes_whole_numbers():
    stepper = Stepper(curve(lambda x, a: x**2 - a), 1, 1, [])
    x, _, steps = stepper(np.array([2]), np.array([4]))
    assert (x.dtype, x.tolist(), steps) == (np.float64, [2.0], 0)


def test_one_stepper_serves_many_threads():
    poses, a, starts = direct_geometry.data(200)
    stepper = Stepper(platform(), 7, 6, ANCHORS)
    with ThreadPoolExecutor(8) as pool:
        found = [x for x, _, _ in pool.map(stepper, starts, a)]
    np.testing.assert_allclose(found, poses, atol=1e-11)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"x0": np.zeros(7)}, r"x0 has shape \(7,\), expected \(rows, n\)"),
        ({"x0": np.zeros((2, 0))}, r"x0 has shape \(2, 0\)"),
        ({"a": np.zeros((3, 6))}, r"a has shape \(3, 6\), expected \(2, k\)"),
        ({"a": np.zeros((2, 6), complex)}, "a holds complex128"),
        ({"p": np.zeros((2, 36))}, r"p has shape \(2, 36\)"),
        ({"side": np.zeros(3)}, r"side has shape \(3,\), expected \(2,\)"),
        ({"threads": 0}, "threads is 0"),
        ({"max_steps": -1}, "max_steps is -1"),
        ({"max_steps": 2.5}, r"max_steps is 2\.5"),
    ],
)
def test_wrong_arguments_are_named(change, message):
    given = {"x0": np.zeros((2, 7)), "a": np.zeros((2, 6)), "p": ANCHORS} | change
    with pytest.raises(ValueError, match=message):
        batch(platform(), **given)


def test_a_stepper_names_wrong_arguments():
    kernel = platform()
    with pytest.raises(ValueError, match="expected n from 1"):
        Stepper(kernel, 0, 6, ANCHORS)
    with pytest.raises(ValueError, match="max_steps is True"):
        Stepper(kernel, 7, 6, ANCHORS, max_steps=True)
    stepper = Stepper(kernel, 7, 6, ANCHORS)
    for x, a in ((np.zeros(6), np.zeros(6)), (np.zeros(7), np.zeros(5))):
        with pytest.raises(ValueError, match=r"expected \(7,\) and \(6,\)"):
            stepper(x, a)
    with pytest.raises(ValueError, match=r"x0 has shape \(1, 7\)"):
        stepper(np.zeros((1, 7)), np.zeros(6))
    with pytest.raises(ValueError, match="a holds complex128"):
        stepper(np.zeros(7), np.zeros(6, complex))


# compiling


def test_a_stepper_compiles_where_nothing_can_be_kept(monkeypatch):
    real = numba.njit

    def njit(*given, cache=False, **options):
        if cache:
            raise RuntimeError("cannot cache function: no locator available")
        return real(*given, **options)

    monkeypatch.setattr(numba, "njit", njit)
    monkeypatch.setattr(stepping_loops, "row_compiled", stepping_loops.row_compiled.__wrapped__)
    stepper = Stepper(curve(lambda x, a: x**2 - a), 1, 1, [])
    assert stepper([1.5], [4.0])[0] == pytest.approx(2.0)


def test_numba_is_loaded_by_the_first_solve_alone():
    code = "import sys, gough.numerics.stepping; print('numba' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"
