"""Elementary functions against mpmath, over their whole ranges, fused and not."""

import math

import mpmath as mp
import numpy as np
import pytest
from hypothesis import settings

from gough.kernels.builder import Builder
from gough.kernels.functions import BOUNDS, FORMULAS
from gough.kernels.functions.sines import LIMIT
from gough.kernels.fusing import fused
from gough.kernels.tape import FUNCTIONS
from gough.kernels.value import Value
from tests.kernels.random_tapes import exact_run

MANY = 20_000 if settings.get_current_profile_name() == "long" else 1_500
LEAST, LARGEST = 5e-324, 1.7976931348623157e308
EVERYWHERE = [0.0, LEAST, 1e-310, 2.2e-308, 1e-160, 1e-20, 2.0**-54, 2.0**-27, 1e160, LARGEST]
ORACLES = {name: getattr(mp, name, None) for name in FUNCTIONS} | {"pow": mp.power}


def tape_of(name):
    arguments = len(FUNCTIONS[name][0])
    builder = Builder(arguments)
    result = FORMULAS[name](*[Value.input(builder, k) for k in range(arguments)])
    return builder.tape([result.number])


TAPES = {name: tape_of(name) for name in FORMULAS}


def values(name, points, fuse=False):
    points = np.asarray(points, float)
    rows = points[:, None] if points.ndim == 1 else points
    return exact_run(fused(TAPES[name]) if fuse else TAPES[name], rows)[:, 0]


def sizes(rng, low, high, count=MANY):
    """Numbers of both signs evenly spread over orders of magnitude."""
    return np.exp2(rng.uniform(low, high, count)) * rng.choice([-1, 1], count)


def quarter_turns(limit):
    """The float64 on either side of multiples of π/2."""
    nearest = np.arange(1, limit) * (np.pi / 2)
    return np.concatenate([nearest, np.nextafter(nearest, 0), np.nextafter(nearest, np.inf)])


def points_for(name, rng):
    normal, unit = 3 * rng.normal(size=MANY), rng.uniform(-1, 1, MANY)
    if name in ("sin", "cos", "tan"):
        small = rng.choice(quarter_turns(2**14), MANY)
        return [normal, sizes(rng, -1074, 14), rng.uniform(-LIMIT, LIMIT, MANY), small]
    if name in ("asin", "acos"):
        near_one = 1 - np.exp2(rng.uniform(-53, -1, MANY))
        return [unit, near_one, -near_one, sizes(rng, -1074, 0), rng.uniform(0.49, 0.51, MANY)]
    if name == "log":
        return [np.abs(sizes(rng, -1074, 1024)), rng.uniform(0.5, 2, MANY), 1 + 1e-8 * unit]
    if name == "log1p":
        return [sizes(rng, -60, 0) * 0.999, rng.uniform(-1, 3, MANY), np.abs(sizes(rng, 0, 1023))]
    if name in ("exp", "expm1", "sinh", "cosh"):
        return [rng.uniform(-745, 709.7, MANY), normal, unit, sizes(rng, -1074, 3)]
    if name in ("tanh", "erf"):
        return [normal, unit, sizes(rng, -1074, 5), rng.uniform(0.8, 1.2, MANY)]
    return [normal, sizes(rng, -1074, 1023), rng.uniform(0.3, 3, MANY)]


def pairs_for(name, rng):
    a, b = rng.normal(size=(2, MANY))
    if name == "pow":
        x = np.exp2(rng.uniform(-1000, 1000, MANY))
        y = rng.uniform(-1, 1, MANY) * 600 / (np.abs(np.log2(x)) + 1)
        return [np.c_[np.abs(a), 5 * b], np.c_[x, y], np.c_[-np.abs(a), rng.integers(-9, 9, MANY)]]
    scale = np.exp2(rng.uniform(-1000, 1000, MANY))
    apart = np.c_[sizes(rng, -500, 500), sizes(rng, -500, 500)]
    return [np.c_[a, b], np.c_[a * scale, b * scale], apart, np.c_[a * 4e307, b * 4e307]]


def errors(name, points, found):
    """Errors in units in the last place of the exact value."""
    with mp.workprec(160 if name not in ("sin", "cos", "tan") else 1250):
        for point, value in zip(points, found, strict=True):
            arguments = [mp.mpf(float(x)) for x in np.atleast_1d(point)]
            exact = ORACLES[name](*arguments)
            nearest = float(exact)
            if math.isinf(nearest):
                yield 0.0 if math.isinf(value) or value == math.copysign(LARGEST, nearest) else 1e99
            else:
                yield float(abs(mp.mpf(float(value)) - exact) / mp.mpf(math.ulp(nearest)))


@pytest.mark.parametrize("fuse", [False, True])
@pytest.mark.parametrize("name", sorted(FORMULAS))
def test_the_documented_bound_holds(name, fuse):
    rng = np.random.default_rng(len(name) + 100 * fuse)
    two = len(FUNCTIONS[name][0]) == 2
    points = np.concatenate(pairs_for(name, rng) if two else points_for(name, rng))
    if fuse:
        points = rng.permutation(points)[:MANY]
    points = points[np.isfinite(points.reshape(len(points), -1)).all(axis=1)]
    found = values(name, points, fuse)
    worst = max(zip(errors(name, points, found), points.tolist(), strict=True))
    assert worst[0] <= BOUNDS[name], worst


def test_every_function_has_a_formula_a_bound_and_an_oracle():
    assert set(FORMULAS) == set(BOUNDS) == set(FUNCTIONS)
    assert all(ORACLES.values())


@pytest.mark.parametrize("name", ["sin", "cos", "tan"])
@pytest.mark.parametrize("fuse", [False, True])
def test_angles_of_any_size(name, fuse):
    rng = np.random.default_rng(5)
    hardest = [6381956970095103 * 2.0**797, LARGEST, np.nextafter(LIMIT, np.inf), LIMIT, 1e22]
    points = np.concatenate([hardest, sizes(rng, 14, 1024, 600), -np.array(hardest)])
    assert max(errors(name, points, values(name, points, fuse))) <= BOUNDS[name]


@pytest.mark.parametrize("name", ["exp", "sinh", "expm1"])
def test_results_that_are_subnormal_or_overflow(name):
    rng = np.random.default_rng(6)
    points = np.concatenate([rng.uniform(-746, -707, 400), rng.uniform(709, 711, 400), [-800, 800]])
    assert max(errors(name, points, values(name, points))) <= BOUNDS[name]


INF, NAN = math.inf, math.nan
SPECIAL = {
    "sin": [(0.0, 0.0), (-0.0, -0.0), (INF, NAN), (-INF, NAN)],
    "cos": [(0.0, 1.0), (-0.0, 1.0), (INF, NAN), (-INF, NAN)],
    "tan": [(0.0, 0.0), (-0.0, -0.0), (INF, NAN)],
    "asin": [(0.0, 0.0), (-0.0, -0.0), (1.0, math.pi / 2), (1.0000001, NAN), (-INF, NAN)],
    "acos": [(1.0, 0.0), (-1.0, math.pi), (-1.0000001, NAN), (INF, NAN)],
    "atan": [(0.0, 0.0), (-0.0, -0.0), (INF, math.pi / 2), (-INF, -math.pi / 2)],
    "exp": [(0.0, 1.0), (-0.0, 1.0), (INF, INF), (-INF, 0.0), (710.0, INF), (-746.0, 0.0)],
    "expm1": [(0.0, 0.0), (-0.0, -0.0), (INF, INF), (-INF, -1.0)],
    "log": [(0.0, -INF), (-0.0, -INF), (1.0, 0.0), (-1.0, NAN), (INF, INF), (-INF, NAN)],
    "log1p": [(0.0, 0.0), (-0.0, -0.0), (-1.0, -INF), (-1.5, NAN), (INF, INF)],
    "sinh": [(0.0, 0.0), (-0.0, -0.0), (INF, INF), (-INF, -INF)],
    "cosh": [(0.0, 1.0), (INF, INF), (-INF, INF)],
    "tanh": [(0.0, 0.0), (-0.0, -0.0), (INF, 1.0), (-INF, -1.0)],
    "erf": [(0.0, 0.0), (-0.0, -0.0), (INF, 1.0), (-INF, -1.0)],
}


@pytest.mark.parametrize("fuse", [False, True])
@pytest.mark.parametrize("name", sorted(SPECIAL))
def test_special_values(name, fuse):
    given, expected = zip(*SPECIAL[name], (NAN, NAN), strict=True)
    found = values(name, given, fuse)
    np.testing.assert_array_equal(found, expected)
    numbers = ~np.isnan(expected)
    np.testing.assert_array_equal(np.signbit(found)[numbers], np.signbit(expected)[numbers])


@pytest.mark.parametrize("fuse", [False, True])
@pytest.mark.parametrize(("name", "oracle"), [("atan2", np.arctan2), ("pow", np.power)])
def test_special_pairs_are_those_of_c99(name, oracle, fuse):
    numbers = [0.0, -0.0, 1.0, -1.0, 2.0, -3.0, 0.5, -2.5, INF, -INF, NAN]
    points = np.array([(a, b) for a in numbers for b in numbers])
    found = values(name, points, fuse)
    with np.errstate(all="ignore"):
        expected = oracle(*points.T)
    np.testing.assert_allclose(found, expected, rtol=1e-14)
    numbers = ~np.isnan(expected)
    np.testing.assert_array_equal(np.signbit(found)[numbers], np.signbit(expected)[numbers])


@pytest.mark.parametrize("name", ["sin", "tan", "asin", "atan", "expm1", "sinh", "tanh"])
def test_small_arguments_are_kept(name):
    points = np.array([x for x in EVERYWHERE if x < 1e-19])
    np.testing.assert_array_equal(values(name, points), points)
    np.testing.assert_array_equal(values(name, -points), -points)


@pytest.mark.parametrize("name", ["sin", "tan", "asin", "atan", "sinh", "tanh", "erf"])
def test_odd_functions_are_odd(name):
    points = np.random.default_rng(2).normal(size=500)
    np.testing.assert_array_equal(values(name, -points), -values(name, points))
