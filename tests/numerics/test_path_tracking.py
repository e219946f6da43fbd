"""Paths of quadratic systems: their ends, how they end, and that no path sees its neighbours."""

import subprocess
import sys
from dataclasses import dataclass
from functools import cache
from itertools import pairwise, product

import numpy as np
import pytest

from gough.numerics.path_tracking import (
    CAREFUL,
    ENDINGS,
    PathEnding,
    Settings,
    track,
    track_carefully,
)
from gough.numerics.quadratics import Quadratics


def dense(n, rows=None):
    """All products in all rows."""
    i, a, b = np.array(
        [(i, a, b) for i in range(n - 1 if rows is None else rows) for a in range(n)
         for b in range(a, n)]
    ).T  # fmt: skip
    return Quadratics(n, i, a, b)


def polarised(pattern, form):
    """Coefficients of quadratic forms given as functions of x."""
    n, unit = pattern.unknowns, np.eye(pattern.unknowns)
    squares = np.array([form(unit[a]) for a in range(n)])
    mixed = np.array([[form(unit[a] + unit[b]) for b in range(n)] for a in range(n)])
    mixed -= squares[:, None] + squares[None]
    mixed[np.arange(n), np.arange(n)] = squares
    return mixed[pattern.left, pattern.right, pattern.rows]


def gaussian(rng, *shape):
    return rng.normal(size=shape) + 1j * rng.normal(size=shape)


def sine(x, y):
    """Of the angles between x and y, (*batch,)."""
    x = x / np.linalg.norm(x, axis=-1, keepdims=True)
    y = y / np.linalg.norm(y, axis=-1, keepdims=True)
    return np.linalg.norm(y - x * np.sum(x.conj() * y, axis=-1, keepdims=True), axis=-1)


def nearest(x, among):
    """The least sine of each of x with any other, (rows,)."""
    return sine(x[:, None], among[None]).min(axis=1)


def all_different(x, apart=1e-6):
    sines = sine(x[:, None], x[None]) + np.eye(len(x))
    return bool(np.all(sines > apart))


# products of linear forms: 2^(n-1) known solutions


@dataclass(frozen=True)
class Lines:
    """Row i is a product of two linear forms, (n - 1, 2, n)."""

    forms: np.ndarray

    @property
    def c(self):
        n = self.forms.shape[-1]
        pattern, (p, q) = dense(n), self.forms.transpose(1, 0, 2)
        i, a, b = pattern.rows, pattern.left, pattern.right
        return np.where(a == b, p[i, a] * q[i, a], p[i, a] * q[i, b] + p[i, b] * q[i, a])

    def solutions(self, limit=64):
        """Where one form of each row is zero; the first of them."""
        n = self.forms.shape[-1]
        chosen = [
            np.linalg.svd(self.forms[np.arange(n - 1), list(choice)])[2][-1].conj()
            for choice, _ in zip(product((0, 1), repeat=n - 1), range(limit), strict=False)
        ]
        return np.array(chosen)


@pytest.mark.parametrize("n", range(2, 14))
def test_products_of_linear_forms_lead_to_those_of_others(n):
    rng = np.random.default_rng(n)
    start, target = Lines(gaussian(rng, n - 1, 2, n)), Lines(gaussian(rng, n - 1, 2, n))
    found = track_carefully(dense(n), start.c, target.c, start.solutions())
    assert np.all(found.ended(PathEnding.arrived))
    assert np.all(found.t == 1)
    np.testing.assert_allclose(np.linalg.norm(found.x, axis=1), 1, rtol=1e-14)
    assert all_different(found.x)
    if n <= 7:  # all solutions were tracked
        assert nearest(target.solutions(), found.x).max() < 1e-12


@pytest.mark.parametrize("n", [2, 3, 5, 8, 13])
def test_ends_satisfy_the_target_equations(n):
    rng = np.random.default_rng(20 + n)
    start, pattern = Lines(gaussian(rng, n - 1, 2, n)), dense(n)
    target = gaussian(rng, len(pattern.rows))
    found = track_carefully(pattern, start.c, target, start.solutions())
    assert np.all(found.ended(PathEnding.arrived))
    size = pattern.values(abs(target), abs(found.x))
    assert np.all(abs(pattern.values(target, found.x)) < 1e-12 * size)
    assert found.correction.max() < 1e-8


def test_a_path_with_equal_ends_stays():
    rng = np.random.default_rng(3)
    lines = Lines(gaussian(rng, 3, 2, 4))
    found = track(dense(4), lines.c, lines.c, lines.solutions())
    assert np.all(found.ended(PathEnding.arrived))
    assert sine(found.x, lines.solutions()).max() < 1e-14


# conics


def affine_conics(*equations):
    """Coefficients of the pattern `dense(3)` from 1, x, y, x², x y, y² of two conics."""
    order = {(0, 0): 0, (0, 1): 1, (0, 2): 2, (1, 1): 3, (1, 2): 4, (2, 2): 5}
    pattern = dense(3)
    return np.array(
        [
            complex(equations[i][order[a, b]])
            for i, a, b in zip(pattern.rows, pattern.left, pattern.right, strict=True)
        ]
    )


@cache
def conic_start():
    lines = Lines(gaussian(np.random.default_rng(5), 2, 2, 3))
    return lines.c, lines.solutions()


def test_conics_meet_where_polynomials_say():
    # x² + 4 y² = 4 and y = x²: 4 y² + y - 4 = 0, x = ±√y
    c = affine_conics((-4, 0, 0, 1, 0, 4), (0, 0, -1, 1, 0, 0))
    found = track_carefully(dense(3), *[conic_start()[0], c, conic_start()[1]], light=1)
    assert np.all(found.ended(PathEnding.arrived))
    y = np.roots([4, 1, -4]).astype(complex)
    known = np.array([(1, s * np.sqrt(v), v) for v in y for s in (1, -1)])
    assert nearest(known, found.x).max() < 1e-12


def test_two_circles_meet_twice_at_infinity():
    c = affine_conics((-1, 0, 0, 1, 0, 1), (-1, -1, 0.5, 1, 0, 1))
    start, x0 = conic_start()
    found = track(dense(3), start, c, x0, light=1)
    assert found.ended(PathEnding.infinite).sum() == 2
    assert found.ended(PathEnding.arrived).sum() == 2
    assert np.all(found.t > 0.9)


def test_parallel_parabolas_meet_at_infinity_alone():
    c = affine_conics((0, 0, -1, 1, 0, 0), (1, 0, -1, 1, 0, 0))
    start, x0 = conic_start()
    found = track(dense(3), start, c, x0, light=1)
    assert np.all(found.ended(PathEnding.infinite))


def test_without_light_unknowns_nothing_is_infinite():
    c = affine_conics((-1, 0, 0, 1, 0, 1), (-1, -1, 0.5, 1, 0, 1))
    start, x0 = conic_start()
    found = track(dense(3), start, c, x0)
    assert np.all(found.ended(PathEnding.arrived))


def test_a_solution_far_out_is_not_infinite():
    # two lines nearly parallel meet at x = 1e5; the others of each pair are far from special
    far = 1e-5
    p = np.array([(0, 0, 1), (1, -far, 1)], complex)  # y = 0 and y = 1e-5 x - 1
    forms = np.stack([p, gaussian(np.random.default_rng(8), 2, 3)], axis=1)
    target = Lines(forms)
    start, x0 = conic_start()
    found = track_carefully(dense(3), start, target.c, x0, light=1)
    assert np.all(found.ended(PathEnding.arrived))
    assert nearest(target.solutions(), found.x).max() < 1e-11


def test_a_double_solution_is_reached_twice_and_told_by_its_correction():
    # the unit circle and its tangent x = 1, times x = 2
    c = affine_conics((-1, 0, 0, 1, 0, 1), (2, -3, 0, 1, 0, 0))
    start, x0 = conic_start()
    found = track(dense(3), start, c, x0, light=1)
    known = np.array([(1, 1, 0), (1, 2, 1j * np.sqrt(3)), (1, 2, -1j * np.sqrt(3))])
    assert np.all(found.ended(PathEnding.arrived))
    sines = sine(found.x[:, None], known[None])
    assert np.sum(sines[:, 0] < 1e-6) == 2
    assert sines[:, 1:].min(axis=0).max() < 1e-12
    assert np.array_equal(found.correction > 1e-10, sines[:, 0] < 1e-6)


# other endings

PAIR = dense(2)
"""c_0 x_0² + c_1 x_0 x_1 + c_2 x_1² in the plane: two solutions."""


def test_a_path_through_a_singular_point_is_lost():
    # x² = 1 - 2 t: both paths meet at t = 1/2
    found = track(PAIR, [-1, 0, 1], [1, 0, 1], [[1, 1], [1, -1]])
    assert np.all(found.ended(PathEnding.lost))
    np.testing.assert_allclose(found.t, 0.5, atol=1e-9)


def test_a_twist_leads_around_a_singular_point():
    found = track_carefully(PAIR, [-1, 0, 1], [1, 0, 1], [[1, 1], [1, -1]])
    assert np.all(found.ended(PathEnding.arrived))
    assert nearest(np.array([[1, 1j], [1, -1j]]), found.x).max() < 1e-14
    same = track_carefully(PAIR, [-1, 0, 1], [1, 0, 1], [[1, 1], [1, -1]], twists=0)
    assert np.all(same.ended(PathEnding.lost))


def test_a_start_that_is_no_solution_is_lost_at_once():
    found = track(PAIR, [-1, 0, 1], [-2, 0, 1], [[1, 1], [1, 3]])
    assert found.ended(PathEnding.arrived).tolist() == [True, False]
    assert found.ended(PathEnding.lost).tolist() == [False, True]
    assert found.t[1] == 0


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_numbers_that_are_not_finite_end_so(bad):
    found = track(PAIR, [-1, 0, 1], [-2, 0, bad], [[1, 1], [bad, 1], [0, 0]])
    assert np.all(found.ended(PathEnding.not_finite)[1:])
    assert not found.ended(PathEnding.arrived)[0]
    fine = track(PAIR, [-1, 0, 1], [-2, 0, 1], [[1, 1], [bad, 1], [0, 0]])
    assert fine.ended(PathEnding.arrived).tolist() == [True, False, False]


def test_steps_run_out():
    start, x0 = conic_start()
    found = track(dense(3), start, start + 1, x0, Settings(max_steps=2))
    assert np.all(found.ended(PathEnding.step_limit))
    assert np.all(found.steps + found.rejected == 2)
    assert np.all((found.t > 0) & (found.t < 1))


def test_no_paths():
    found = track(PAIR, [-1, 0, 1], [-2, 0, 1], np.zeros((0, 2)))
    assert found.x.shape == (0, 2)
    assert found.ended(PathEnding.arrived).shape == (0,)
    assert track_carefully(PAIR, [-1, 0, 1], [-2, 0, 1], np.zeros((0, 2))).x.shape == (0, 2)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"start": [1, 2]}, r"start has shape \(2,\), expected \(3,\)"),
        ({"target": [[1, 2, 3]]}, r"target has shape \(1, 3\), expected \(3,\)"),
        ({"x0": [1, 1]}, r"x0 has shape \(2,\), expected \(paths, 2\)"),
        ({"x0": [[1, 1, 1]]}, r"x0 has shape \(1, 3\), expected \(paths, 2\)"),
        ({"x0": [["a", "b"]]}, r"x0 holds <U1, expected numbers"),
        ({"light": 3}, "light is 3, expected a whole number from 0 to 2"),
        ({"light": True}, "light is True, expected a whole number from 0 to 2"),
    ],
)
@pytest.mark.parametrize("function", [track, track_carefully])
def test_wrong_arguments_are_named(function, change, message):
    given = {"start": [-1, 0, 1], "target": [-2, 0, 1], "x0": [[1, 1]], **change}
    with pytest.raises(ValueError, match=message):
        function(PAIR, **given)


# six legs: 40 postures (Ronga and Vust 1992)


def times(p, q):
    """Product of quaternions, real part first, (4,)."""
    return np.r_[p[0] * q[0] - p[1:] @ q[1:], p[0] * q[1:] + q[0] * p[1:] + np.cross(p[1:], q[1:])]


CONJUGATE = np.array([1, -1, -1, -1])


@dataclass(frozen=True)
class Platform:
    """Joints a on the platform and b on the base, (6, 3), squared lengths of the legs, (6,)."""

    a: np.ndarray
    b: np.ndarray
    squared: np.ndarray

    @classmethod
    def drawn(cls, rng, numbers):
        a, b, lengths = numbers(rng, 6, 3), numbers(rng, 6, 3), numbers(rng, 6)
        return cls(a, b, lengths**2)

    @classmethod
    def at(cls, x, rng, numbers):
        """A platform with a posture x."""
        a, b = numbers(rng, 6, 3), numbers(rng, 6, 3)
        free = cls(a, b, np.zeros(6)).legs(x)
        return cls(a, b, free / (x[:4] @ x[:4]))

    def legs(self, X):
        """Σ of a leg's squared length times x·x, minus that wanted, for a dual quaternion."""
        x, y = X[:4], X[4:]
        size, p = x @ x, 2 * times(y, x * CONJUGATE)[1:]
        turned = np.array([times(times(x, np.r_[0, a]), x * CONJUGATE)[1:] for a in self.a])
        w = 2 * times(x * CONJUGATE, y)[1:]
        squares = np.sum(self.a**2, axis=1) + np.sum(self.b**2, axis=1) - self.squared
        return (
            size * squares + 4 * (y @ y) + 2 * self.a @ w - 2 * self.b @ p
            - 2 * np.sum(self.b * turned, axis=1)
        )  # fmt: skip

    @property
    def c(self):
        """Coefficients of `six_legs`: the first leg, differences, and x·y = 0."""

        def form(X):
            legs = self.legs(X)
            return np.r_[legs[0] / 4, legs[1:] - legs[0], X[:4] @ X[4:]]

        return polarised(six_legs(), form)


@cache
def six_legs():
    """The pattern: only the first row has squares of y."""
    xx = [(a, b) for a in range(4) for b in range(a, 4)]
    xy = [(a, b) for a in range(4) for b in range(4, 8)]
    yy = [(a, a) for a in range(4, 8)]
    study = [(a, a + 4) for a in range(4)]
    rows = [sorted(xx + xy + yy)] + [sorted(xx + xy)] * 5 + [study]
    i, a, b = np.array([(i, *e) for i, row in enumerate(rows) for e in row]).T
    return Quadratics(8, i, a, b)


def merged(known, new):
    for x in new:
        if not len(known) or nearest(x[None], known)[0] > 1e-6:
            known = np.vstack([known, x[None]])
    return known


@cache
def complex_platform():
    """A platform of complex dimensions with its 40 postures, found by going round in loops."""
    rng = np.random.default_rng(4)
    x = gaussian(rng, 8)
    x[4:] -= x[:4] * (x[:4] @ x[4:]) / (x[:4] @ x[:4])
    base = Platform.at(x, rng, gaussian)
    known = x[None] / np.linalg.norm(x)
    for _ in range(40):
        corners = [base.c, *(Platform.drawn(rng, gaussian).c for _ in range(2)), base.c]
        ends = known
        for start, target in pairwise(corners):
            found = track(six_legs(), start, target, ends, CAREFUL[0], light=4)
            ends = found.x[found.ended(PathEnding.arrived)]
        known = merged(known, ends)
        if len(known) == 40:
            return base.c, known
    raise AssertionError(f"{len(known)} of 40 postures found")


def real_platform(seed):
    rng = np.random.default_rng(seed)
    x = rng.normal(size=8)
    x[4:] -= x[:4] * (x[:4] @ x[4:]) / (x[:4] @ x[:4])
    return Platform.at(x, rng, lambda rng, *shape: rng.normal(size=shape)), x


@pytest.mark.parametrize("decade", range(10))
def test_six_legs_have_forty_postures_on_a_hundred_platforms(decade):
    start, x0 = complex_platform()
    for seed in range(10 * decade, 10 * decade + 10):
        platform, known = real_platform(seed)
        found = track_carefully(six_legs(), start, platform.c, x0, light=4)
        assert found.ended(PathEnding.arrived).sum() == 40
        assert all_different(found.x)
        assert nearest(known[None], found.x)[0] < 1e-9
        # solutions of real equations come in conjugate pairs
        assert nearest(found.x.conj(), found.x).max() < 1e-8
        size = six_legs().values(abs(platform.c), abs(found.x))
        assert np.all(abs(six_legs().values(platform.c, found.x)) < 1e-12 * size)


# neighbours


def columns(paths):
    return (paths.x, paths.t, paths.ending, paths.steps, paths.rejected, paths.correction)


def test_a_path_has_the_same_bits_alone_in_any_order_and_company():
    start, x0 = complex_platform()
    target = real_platform(1)[0].c
    rng = np.random.default_rng(0)
    x0 = np.vstack([x0, gaussian(rng, 3, 8), np.full((1, 8), np.nan)])  # and some that fail
    together = track(six_legs(), start, target, x0, light=4)
    assert len(set(together.ending)) == 3
    order = rng.permutation(len(x0))
    other = track(six_legs(), start, target, x0[order], light=4)
    for first, second in zip(columns(together), columns(other), strict=True):
        np.testing.assert_array_equal(first[order], second)
    for path in (0, 7, 39, 41, 43):
        alone = track(six_legs(), start, target, x0[path : path + 1], light=4)
        for first, second in zip(columns(together), columns(alone), strict=True):
            np.testing.assert_array_equal(first[path], second[0])


def test_inputs_are_not_written_and_may_be_strided():
    start, x0 = conic_start()
    target = gaussian(np.random.default_rng(2), len(start))
    spread = np.zeros((len(x0), 6), complex)
    spread[:, ::2] = x0
    found = track(dense(3), start, target, spread[:, ::2])
    np.testing.assert_array_equal(spread[:, ::2], x0)
    for first, second in zip(
        columns(found), columns(track(dense(3), start, target, x0)), strict=True
    ):
        np.testing.assert_array_equal(first, second)


# order of the predictor


def test_the_predictor_has_order_eight():
    """Half the tolerance to the power of eight makes twice as many steps."""
    start, x0 = conic_start()
    target = gaussian(np.random.default_rng(2), len(start))
    steps = [
        track(dense(3), start, target, x0, Settings(tolerance=1e-4 / 2 ** (8 * k))).steps.sum()
        for k in (0, 1)
    ]
    assert steps[1] / steps[0] == pytest.approx(2, rel=0.15)


def test_endings_are_sentences():
    for ending in ENDINGS:
        assert len(ending.value.split()) > 4


def test_numba_is_loaded_by_tracking_alone():
    code = "import sys, gough.numerics.path_tracking; print('numba' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"
