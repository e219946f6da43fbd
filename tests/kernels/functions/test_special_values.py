"""Signed zeros, infinities, NaN and the ends of ranges, as C99 (annex F) has them."""

import itertools
import math

import numpy as np
import pytest

from tests.kernels.functions.measured import VARIANTS, values

INF, NAN, TINY, MAX = math.inf, math.nan, 5e-324, np.finfo(float).max
NUMBERS = [0.0, -0.0, 1.0, -1.0, 0.5, -2.5, 3.0, -3.0, 1e300, -1e300, TINY, -TINY, MAX, -MAX]
EXACT = {
    "sin": {0.0: 0.0, INF: NAN, -INF: NAN, TINY: TINY},
    "cos": {0.0: 1.0, INF: NAN, -INF: NAN, TINY: 1.0},
    "tan": {0.0: 0.0, INF: NAN, -INF: NAN, TINY: TINY},
    "asin": {0.0: 0.0, 1.0: math.pi / 2, -1.0: -math.pi / 2, 1.0000000000000002: NAN, INF: NAN},
    "acos": {0.0: math.pi / 2, 1.0: 0.0, -1.0: math.pi, 1.0000000000000002: NAN, -INF: NAN},
    "atan": {0.0: 0.0, 1.0: math.pi / 4, INF: math.pi / 2, -INF: -math.pi / 2, TINY: TINY},
    "exp": {0.0: 1.0, INF: INF, -INF: 0.0, 709.79: INF, MAX: INF, -745.2: 0.0, -745.1: TINY},
    "expm1": {0.0: 0.0, INF: INF, -INF: -1.0, 709.79: INF, -MAX: -1.0, TINY: TINY, -50.0: -1.0},
    "log": {1.0: 0.0, 0.0: -INF, INF: INF, -1.0: NAN, -INF: NAN, -TINY: NAN},
    "log1p": {0.0: 0.0, -1.0: -INF, INF: INF, -1.0000000000000002: NAN, -INF: NAN, TINY: TINY},
    "sinh": {0.0: 0.0, INF: INF, -INF: -INF, 710.5: INF, MAX: INF, TINY: TINY},
    "cosh": {0.0: 1.0, INF: INF, -INF: INF, 710.5: INF, -MAX: INF, TINY: 1.0},
    "tanh": {0.0: 0.0, INF: 1.0, -INF: -1.0, 20.0: 1.0, TINY: TINY},
    "erf": {0.0: 0.0, INF: 1.0, -INF: -1.0, 6.0: 1.0, MAX: 1.0, TINY: TINY},
}
ODD = ["sin", "tan", "asin", "atan", "sinh", "tanh", "erf"]
KEEPS_MINUS_ZERO = [*ODD, "expm1", "log1p"]


def assert_same(found, expected, about):
    """Equal numbers with equal signs; NaN only where it belongs."""
    found, expected = np.asarray(found), np.asarray(expected)
    same = (found == expected) & (np.signbit(found) == np.signbit(expected))
    same |= np.isnan(found) & np.isnan(expected)
    wrong = [(about[k], found[k], expected[k]) for k in np.flatnonzero(~same)]
    assert not wrong


@pytest.mark.parametrize("variant", VARIANTS)
@pytest.mark.parametrize("name", EXACT)
def test_one_argument(name, variant):
    table = EXACT[name] | {NAN: NAN}
    assert_same(values(name, list(table), variant=variant), list(table.values()), list(table))


@pytest.mark.parametrize("variant", VARIANTS)
@pytest.mark.parametrize("name", KEEPS_MINUS_ZERO)
def test_zeros_keep_their_sign(name, variant):
    assert_same(values(name, [0.0, -0.0], variant=variant), [0.0, -0.0], ["0", "-0"])


@pytest.mark.parametrize("variant", VARIANTS)
def test_angles_of_vectors(variant):
    pairs = list(itertools.product([*NUMBERS, INF, -INF, NAN], repeat=2))
    y, x = np.array(pairs).T
    found, expected = values("atan2", y, x, variant=variant), [math.atan2(*pair) for pair in pairs]
    plain = (np.abs(y) != np.abs(x)) & (y != 0) & np.isfinite(y) & np.isfinite(x) & (x != 0)
    assert_same(found[~plain], np.array(expected)[~plain], np.array(pairs)[~plain])
    np.testing.assert_allclose(found[plain], np.array(expected)[plain], rtol=4e-16, atol=TINY)


def power(x, y):
    """x to the power of y as C99 has it."""
    try:
        result = math.pow(x, y)
    except OverflowError:
        odd = y == math.floor(y) and y % 2 == 1
        return -INF if x < 0 and odd else INF
    except ValueError:  # negative base, or zero with a negative exponent
        if x != 0:
            return NAN
        return math.copysign(INF, x) if y % 2 == 1 else INF
    return result


@pytest.mark.parametrize("variant", VARIANTS)
def test_powers(variant):
    exponents = [*NUMBERS, INF, -INF, NAN, 2.0**53 - 1, 2.0**53, -(2.0**53) + 1, 0.1, 2.0**52 + 0.5]
    bases = [*NUMBERS, INF, -INF, NAN, 0.9999999999999999, -1.0000000000000002]
    pairs = list(itertools.product(bases, exponents))
    x, y = np.array(pairs).T
    found = values("pow", x, y, variant=variant)
    expected = np.array([power(*pair) for pair in pairs])
    assert_same(np.signbit(found) & ~np.isnan(found), np.signbit(expected), pairs)
    plain = np.isfinite(expected) & (expected != 0) & (np.abs(expected) != 1)
    assert_same(found[~plain], expected[~plain], np.array(pairs)[~plain])
    np.testing.assert_allclose(found[plain], expected[plain], rtol=4e-16, atol=TINY)
