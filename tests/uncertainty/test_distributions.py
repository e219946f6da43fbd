"""Distributions: what can be written, their inverses against scipy, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from gough.errors import UnknownName
from gough.uncertainty import Distribution, DistributionError, values_of

U = np.array([1e-12, 1e-6, 0.01, 0.3, 0.5, 0.75, 0.999, 1 - 1e-9])
TEXTS = [
    "uniform(0.9, 1.1)",
    "normal(1, 0.1)",
    "normal(mean=-3, sd=1e-3)",
    "truncated-normal(1, 0.1, 0.8, 1.2)",
    "truncated-normal(0, 1, 8, 9)",
    "lognormal(2, 0.5)",
    "triangular(0, 0.2, 1)",
    "triangular(0, 0, 1)",
    "triangular(0, 1, 1)",
    "beta(2, 5)",
    "beta(0.5, 0.5, -1, 3)",
    "scipy(weibull_min, c=1.5, scale=2)",
    "scipy(gumbel_r, loc=1)",
]


@pytest.mark.parametrize("text", TEXTS)
def test_inverses_agree_with_scipy(text):
    found = Distribution.read(text)
    np.testing.assert_allclose(found.of(U), found.frozen().ppf(U), rtol=2e-9, atol=1e-14)


@pytest.mark.parametrize("text", TEXTS)
def test_inverses_rise_and_undo_the_distribution_function(text):
    found = Distribution.read(text)
    u = np.linspace(0.001, 0.999, 200)
    values = found.of(u)
    assert np.all(np.diff(values) > 0)
    np.testing.assert_allclose(found.frozen().cdf(values), u, rtol=1e-7)


@pytest.mark.parametrize("text", TEXTS)
def test_texts_and_mappings_read_back(text):
    found = Distribution.read(text)
    assert Distribution.read(str(found)) == found
    assert Distribution.read(found.as_dict()) == found
    assert Distribution.read(found) is found


def test_moments_are_those_of_the_variable_itself():
    found = Distribution.read("lognormal(3, 0.5)")
    assert found.mean == pytest.approx(3, rel=1e-12)
    assert found.sd == pytest.approx(0.5, rel=1e-12)
    assert found.median == pytest.approx(stats.lognorm.median(**found.frozen().kwds))


@pytest.mark.parametrize(
    ("written", "expected"),
    [
        ("±10 %", "uniform(1.8, 2.2)"),
        ("+-10%", "uniform(1.8, 2.2)"),
        ("± 0.5", "uniform(1.5, 2.5)"),
        ("uniform 10 %", "uniform(1.8, 2.2)"),
        ({"uniform": "10 %"}, "uniform(1.8, 2.2)"),
        ({"uniform": 0.5}, "uniform(1.5, 2.5)"),
        ({"uniform": [1, 3]}, "uniform(1, 3)"),
        ({"normal": "5 %"}, "normal(2, 0.1)"),
        ({"normal": {"sd": 0.2}}, "normal(2, 0.2)"),
        ({"triangular": {"low": 0, "high": "200 %"}}, "triangular(0, 2, 4)"),
        ("lognormal(50 %)", "lognormal(2, 1)"),
        ("truncated-normal(sd=5 %, low=50 %, high=3)", "truncated-normal(2, 0.1, 1, 3)"),
        ({"scipy": {"name": "norm", "loc": "100 %"}}, "scipy(norm, loc=2, scale=1)"),
    ],
)
def test_what_is_about_a_nominal_value(written, expected):
    assert str(Distribution.read(written, 2.0)) == expected


def test_percentages_of_a_negative_nominal_value():
    assert str(Distribution.read("±10 %", -2.0)) == "uniform(-2.2, -1.8)"
    assert str(Distribution.read("normal(5 %)", -2.0)) == "normal(-2, 0.1)"
    found = Distribution.read({"uniform": {"low": "90 %", "high": "110 %"}}, -2.0)
    assert str(found) == "uniform(-2.2, -1.8)"


@pytest.mark.parametrize(
    ("written", "message"),
    [
        ("uniform(2, 1)", "uniform: low is 2 and high is 1: low has to be less than high"),
        ("uniform(nan, 1)", "low is nan, expected a finite number"),
        ("uniform(a, 1)", "low is 'a', expected a number or a percentage"),
        ("uniform(0, 1, 2)", r"3 values, expected 2: uniform\(low, high\)"),
        ({"uniform": {"low": 1}}, r"high missing, expected uniform\(low, high\)"),
        ("normal(1, -1)", "sd is -1: it has to be positive"),
        ("normal(mean=1, mean=2)", "mean is given twice"),
        ("normal(0.1)", "is sd about a nominal value, and there is none"),
        ("±10 %", "the half width about a nominal value, and there is none"),
        ("lognormal(-1, 1)", "mean is -1: it has to be positive"),
        ("triangular(0, 3, 1)", "mode is 3: it has to lie between low 0 and high 1"),
        ("triangular(2, 1, 0)", "low is 2 and high is 0"),
        ("beta(0, 1)", "a is 0: it has to be positive"),
        ("truncated-normal(0, 1, 50, 60)", "nothing of it lies between low 50 and high 60"),
        ("scipy(weibull_min)", "c missing. Known: c, loc, scale"),
        ("scipy(weibull_min, c=-1)", "weibull_min is not defined for c = -1"),
        ("scipy(norm, scale=0)", "scale is 0: it has to be positive"),
        ({"scipy": "norm"}, "expected the name of a distribution and its parameters by name"),
        ("hello", "'hello' is no distribution: expected something as uniform"),
        (3.0, "3.0 is no distribution"),
        ({"normal": 1, "uniform": 2}, "mapping with one entry"),
        ({"normal": {"mean": True, "sd": 1}}, "mean is True, expected a number"),
    ],
)
def test_what_is_wrong_is_named(written, message):
    with pytest.raises(DistributionError, match=message):
        Distribution.read(written)


@pytest.mark.parametrize("size", ["±10 %", "normal(10 %)", {"normal": {"mean": 1, "sd": "5 %"}}])
def test_a_part_of_nothing_is_refused(size):
    with pytest.raises(DistributionError, match="of the nominal value 0, which is nothing"):
        Distribution.read(size, 0.0)


@pytest.mark.parametrize(
    ("written", "message"),
    [
        ("unifrom(0, 1)", "no distribution is named 'unifrom'. Did you mean 'uniform'"),
        ("normal(mean=1, sgm=2)", "no parameter of normal is named 'sgm'"),
        ("scipy(weibul_min, c=1)", "Did you mean 'weibull_min'"),
        ("scipy(weibull_min, k=1)", "no parameter of scipy.weibull_min. is named 'k'"),
    ],
)
def test_unknown_names_have_a_close_match(written, message):
    with pytest.raises(UnknownName, match=message):
        Distribution.read(written)


@pytest.mark.parametrize("u", [0.0, 1.0, -0.1, np.nan])
def test_shares_are_between_0_and_1(u):
    with pytest.raises(DistributionError, match=r"at \(1, 0\), expected a number between 0 and 1"):
        Distribution.read("normal(0, 1)").of([[0.5], [u]])


def test_columns_go_through_their_distributions():
    both = [Distribution.read("uniform(0, 2)"), Distribution.read("normal(5, 1)")]
    np.testing.assert_allclose(values_of([[0.25, 0.5], [0.5, 0.5]], both), [[0.5, 5], [1, 5]])
    with pytest.raises(DistributionError, match="expected one column for each"):
        values_of(np.full((3, 3), 0.5), both)
