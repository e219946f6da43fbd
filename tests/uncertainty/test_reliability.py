"""Requirements, quantiles and correlations: intervals that cover, and runs without a value."""

from __future__ import annotations

import json

import numpy as np
import pytest
from scipy import stats

from gough.errors import UnknownName
from gough.uncertainty import (
    Criterion,
    EnsembleError,
    correlations,
    failure_probability,
    quantiles,
    reliability,
)
from gough.uncertainty.reliability import clopper_pearson, wilson


@pytest.mark.parametrize(
    ("text", "holds"),
    [
        ("y < 2", [True, False, False, False]),
        ("y <= 2", [True, True, False, False]),
        ("y ≤ 2", [True, True, False, False]),
        ("y > 2", [False, False, True, False]),
        ("y>=2", [False, True, True, False]),
    ],
)
def test_criteria_hold_up_to_their_limit(text, holds):
    criterion = Criterion.read(text)
    assert criterion.holds([1.0, 2.0, 3.0, np.nan]).tolist() == holds
    assert Criterion.read(str(criterion)) == criterion


@pytest.mark.parametrize("text", ["y", "y = 2", "y <= many", "<= 2"])
def test_texts_that_are_no_criterion(text):
    with pytest.raises(EnsembleError, match="is no criterion"):
        Criterion.read(text)


@pytest.mark.parametrize(("x", "n"), [(0, 10), (1, 10), (7, 50), (50, 50), (3, 1000)])
@pytest.mark.parametrize("confidence", [0.9, 0.99])
def test_intervals_are_those_of_scipy(x, n, confidence):
    exact = stats.binomtest(x, n).proportion_ci(confidence, "exact")
    score = stats.binomtest(x, n).proportion_ci(confidence, "wilson")
    np.testing.assert_allclose(clopper_pearson(x, n, confidence), exact, rtol=1e-9, atol=1e-15)
    np.testing.assert_allclose(wilson(x, n, confidence), score, rtol=1e-9, atol=1e-15)


@pytest.mark.parametrize("p", [0.001, 0.03, 0.4])
def test_clopper_pearson_covers_at_least_its_confidence(p):
    n = 200
    ends = np.array([clopper_pearson(x, n, 0.95) for x in range(n + 1)])
    covers = (ends[:, 0] <= p) & (p <= ends[:, 1])
    assert stats.binom.pmf(np.arange(n + 1), n, p)[covers].sum() >= 0.95


def test_runs_without_a_value_count_as_told():
    y = np.array([0.5, 1.5, np.nan, 0.7, np.inf])
    missed = failure_probability("y <= 1", y)
    assert (missed.missed, missed.counted, missed.lost) == (3, 5, 2)
    assert missed.probability == 0.6
    assert missed.note == "y <= 1: 2 runs of 5 without a value, counted as missed"
    excluded = failure_probability("y <= 1", y, lost="excluded")
    assert (excluded.missed, excluded.counted) == (1, 3)
    assert str(excluded).endswith("2 runs of 5 without a value, left out")
    assert (excluded.low, excluded.high) == clopper_pearson(1, 3)


def test_several_requirements_and_any_of_them():
    outputs = {"a": [1.0, 2.0, 3.0, 4.0], "b": [1.0, 1.0, np.nan, 0.0]}
    found = reliability(["a <= 3", "b > 0.5"], outputs, method="wilson")
    assert [part.missed for part in found.each] == [1, 2]
    assert found.any.missed == 2
    without = reliability(["a <= 3", "b > 0.5"], outputs, lost="excluded")
    assert (without.any.missed, without.any.counted) == (1, 3)
    lines = str(found).splitlines()
    assert lines[0] == "probability of missing a requirement (95 % intervals, wilson)"
    assert lines[4].split("  ")[1] == "any of them"
    assert json.loads(json.dumps(found.as_dict()))["any"]["probability"] == 0.5


@pytest.mark.parametrize(
    ("call", "error", "message"),
    [
        (lambda: reliability(["c < 1"], {"a": [1.0]}), UnknownName, "no output is named 'c'"),
        (lambda: reliability([], {"a": [1.0]}), EnsembleError, "no criteria"),
        (
            lambda: reliability(["a < 1", "b < 1"], {"a": [1.0], "b": [1.0, 2.0]}),
            EnsembleError,
            r"\[1, 2\] runs",
        ),
        (
            lambda: failure_probability("y < 1", [np.nan], lost="excluded"),
            EnsembleError,
            "none of 1 runs has a value",
        ),
        (lambda: failure_probability("y < 1", [[1.0]]), EnsembleError, "expected .runs,."),
        (lambda: failure_probability("y < 1", [1.0], lost="miss"), UnknownName, "'missed'"),
        (lambda: failure_probability("y < 1", [1.0], method="wald"), UnknownName, "interval"),
        (lambda: Criterion("y", "==", 1.0), UnknownName, "no relation is named"),
        (lambda: Criterion("y", "<", np.nan), EnsembleError, "the limit is nan"),
        (lambda: quantiles([1.0], [1.0]), EnsembleError, "a level is 1.0"),
        (lambda: quantiles([np.nan]), EnsembleError, "0 values"),
        (lambda: quantiles([1.0], lost="left"), UnknownName, "way with runs"),
        (lambda: correlations(np.ones((3, 1)), np.ones(3)), EnsembleError, "at least 4"),
        (lambda: correlations(np.ones((3, 1)), np.ones(4)), EnsembleError, "expected 4"),
    ],
)
def test_what_does_not_fit_is_refused(call, error, message):
    with pytest.raises(error, match=message):
        call()


# quantiles


def test_quantiles_are_those_of_numpy():
    y = np.random.default_rng(0).normal(size=101)
    levels = [0.013, 0.25, 0.5, 0.99]
    np.testing.assert_allclose(quantiles(y, levels).values, np.quantile(y, levels))


@pytest.mark.parametrize(("n", "level"), [(20, 0.5), (100, 0.9), (400, 0.01)])
def test_intervals_of_quantiles_cover_by_their_coverage(n, level):
    rng = np.random.default_rng(1)
    truth = stats.expon.ppf(level)
    found = [quantiles(rng.exponential(size=n), [level]) for _ in range(1000)]
    covers = np.mean([bool(q.low[0] <= truth <= q.high[0]) for q in found])
    assert found[0].coverage[0] >= 0.95
    assert abs(covers - found[0].coverage[0]) < 0.02


def test_intervals_of_quantiles_are_as_short_as_their_tails_allow():
    found = quantiles(np.arange(1, 101.0), [0.5])
    assert (found.low[0], found.high[0]) == (40, 61)  # the table of a binomial (100, 1/2)
    np.testing.assert_allclose(
        found.coverage, stats.binom.cdf(60, 100, 0.5) - stats.binom.cdf(39, 100, 0.5)
    )


def test_few_runs_do_not_bound_a_far_quantile():
    found = quantiles(np.arange(20.0), [0.99, 0.5])
    assert found.high[0] == np.inf
    assert found.as_dict()["high"][0] is None
    assert found.low[0] > 0
    assert np.isfinite(found.high[1])


def test_runs_without_a_value_as_the_highest():
    y = np.r_[np.arange(90.0), np.full(10, np.nan)]
    assert quantiles(y, [0.95]).values[0] < 90
    found = quantiles(y, [0.5, 0.95], lost="highest", output="force")
    assert found.values.tolist() == [49.5, np.inf]
    assert quantiles(y, [0.05], lost="lowest").values[0] == -np.inf
    assert str(found).splitlines()[0] == "quantiles of force in 100 runs (95 % intervals, by order)"
    assert str(found).splitlines()[-1] == "10 runs without a value, taken as highest"


# correlations


def test_correlations_are_those_of_scipy():
    rng = np.random.default_rng(2)
    x = rng.normal(size=(60, 3))
    y = np.stack([np.exp(x[:, 0]) + 0.1 * rng.normal(size=60), x[:, 1] - x[:, 2]], axis=1)
    found = correlations(x, y)
    for k in range(2):
        for i in range(3):
            linear = stats.pearsonr(x[:, i], y[:, k]).statistic
            rank = stats.spearmanr(x[:, i], y[:, k]).statistic
            np.testing.assert_allclose([found.linear[k, i], found.rank[k, i]], [linear, rank])
    assert found.ranked("y1")[0] == "x1"


def test_a_rising_output_has_rank_correlation_1():
    x = np.linspace(-1, 1, 30)
    found = correlations(np.stack([x, -x, 0 * x], axis=1), np.exp(5 * x), ["up", "down", "flat"])
    np.testing.assert_allclose(found.rank[0, :2], [1, -1])
    assert np.isnan(found.rank[0, 2])
    assert found.linear[0, 0] < 1
    assert found.as_dict()["rank"][0][2] is None
    assert str(found).splitlines()[-1].split() == ["flat", "-", "-"]


def test_correlations_of_independent_values_stay_below_chance():
    rng = np.random.default_rng(3)
    found = correlations(rng.random((50, 400)), rng.random(50))
    assert abs(np.mean(np.abs(found.linear) < found.chance[0]) - 0.95) < 0.03


def test_correlations_leave_out_runs_without_a_value():
    rng = np.random.default_rng(4)
    x, y = rng.random((30, 2)), rng.random(30)
    holed = np.r_[y, np.nan]
    found = correlations(np.vstack([x, [0.5, 0.5]]), holed)
    np.testing.assert_allclose(found.rank, correlations(x, y).rank)
    assert found.lost.tolist() == [1]
    assert "1 run without a value left out" in str(found)
