"""What holds for functions at all arguments."""

import numpy as np
import pytest

from tests.kernels.functions.measured import VARIANTS, values
from tests.kernels.functions.regions import arguments

ODD = ["sin", "tan", "asin", "atan", "sinh", "tanh", "erf"]
RISING = ["exp", "expm1", "log", "log1p", "sinh", "tanh", "erf", "atan", "asin"]
SATURATED = {"tanh": 22.0, "erf": 6.0}


@pytest.mark.parametrize("variant", VARIANTS)
@pytest.mark.parametrize("name", ODD)
def test_odd(name, variant):
    x = arguments(name, 300)
    odd = values(name, -x, variant=variant)
    np.testing.assert_array_equal(odd, -values(name, x, variant=variant))


@pytest.mark.parametrize("name", ["cos", "cosh"])
def test_even(name):
    x = arguments(name, 300)
    np.testing.assert_array_equal(values(name, -x), values(name, x))


@pytest.mark.parametrize("name", RISING)
def test_rising_but_for_rounding(name):
    x = np.sort(arguments(name, 3000))
    y = values(name, x)
    y = y[np.isfinite(y)]
    assert (np.diff(y) >= -3 * np.spacing(np.abs(y[1:]))).all()


@pytest.mark.parametrize("variant", VARIANTS)
@pytest.mark.parametrize("name", SATURATED)
def test_never_beyond_one_and_there_in_the_end(name, variant):
    x = np.concatenate([np.linspace(0, 25, 4000), np.linspace(5.8, 6.2, 1000)])
    y = values(name, x, variant=variant)
    assert (y <= 1).all()
    assert (y[x >= SATURATED[name]] == 1).all()


def test_inverses():
    x = np.random.default_rng(4).uniform(0.01, 1, 500)
    for name, inverse in (("exp", "log"), ("expm1", "log1p"), ("sin", "asin"), ("tan", "atan")):
        np.testing.assert_allclose(values(inverse, values(name, x)), x, rtol=4e-14)


def test_powers_of_one_argument():
    x = np.random.default_rng(5).uniform(-20, 20, 500)
    np.testing.assert_allclose(values("pow", x, 2.0), x * x, rtol=4e-16)
    np.testing.assert_allclose(values("pow", x, -1.0), 1 / x, rtol=4e-16)
    np.testing.assert_allclose(values("pow", np.abs(x), 0.5), np.sqrt(np.abs(x)), rtol=4e-16)
