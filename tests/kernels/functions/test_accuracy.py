"""Errors against mpmath, with and without fused operations, over the whole range."""

from functools import cache

import numpy as np
import pytest

from gough.kernels.functions import BOUNDS, FORMULAS
from gough.kernels.tape import FUNCTIONS
from tests.kernels.functions.measured import LONG, VARIANTS, exact, values, worst
from tests.kernels.functions.regions import REGIONS, arguments, bases_and_exponents, vectors

COUNT = 40_000 if LONG else 1500


@cache
def truth(name):
    """Arguments of a function and its values."""
    if name in REGIONS:
        points = (arguments(name, COUNT),)
    else:
        points = {"atan2": vectors, "pow": bases_and_exponents}[name](COUNT)
    function = exact(name)
    return points, [function(*row) for row in zip(*map(np.ndarray.tolist, points), strict=True)]


def test_every_function_is_written_and_has_a_bound():
    assert set(FORMULAS) == set(BOUNDS) == set(FUNCTIONS)


@pytest.mark.parametrize("variant", VARIANTS)
@pytest.mark.parametrize("name", FORMULAS)
def test_errors_stay_within_the_bound(name, variant):
    points, true = truth(name)
    error, where = worst(values(name, *points, variant=variant), true, *points)
    assert error <= BOUNDS[name], where
