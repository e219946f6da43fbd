"""Sobol' indices against analytic ones and scipy; what runs without a value do to them."""

from __future__ import annotations

import json

import numpy as np
import pytest
from scipy import stats

from gough.errors import UnknownName
from gough.uncertainty import EnsembleError, SaltelliDesign, sobol_indices

NAMES = ["x1", "x2", "x3"]


def ishigami(u, a=7.0, b=0.1):
    x = np.pi * (2 * u - 1)
    return np.sin(x[..., 0]) + a * np.sin(x[..., 1]) ** 2 + b * x[..., 2] ** 4 * np.sin(x[..., 0])


def ishigami_indices(a=7.0, b=0.1):
    """First and total (Ishigami and Homma 1990)."""
    v1 = (1 + b * np.pi**4 / 5) ** 2 / 2
    v2 = a**2 / 8
    v13 = b**2 * np.pi**8 * (1 / 18 - 1 / 50)
    total = v1 + v2 + v13
    return np.array([v1, v2, 0]) / total, np.array([v1 + v13, v2, v13]) / total


A = np.array([0.0, 1.0, 4.5, 9.0, 99.0])


def g_function(u):
    return np.prod((np.abs(4 * u - 2) + A) / (1 + A), axis=-1)


def g_indices():
    """First and total (Saltelli and Sobol' 1995)."""
    parts = 1 / (3 * (1 + A) ** 2)
    product = np.prod(1 + parts)
    variance = product - 1
    return parts / variance, parts * product / (1 + parts) / variance


@pytest.mark.parametrize(
    ("function", "indices", "factors"),
    [(ishigami, ishigami_indices, 3), (g_function, g_indices, 5)],
)
def test_indices_are_the_analytic_ones(function, indices, factors):
    design = SaltelliDesign(2**14, factors)
    found = sobol_indices(function(design.rows()), range_names(factors), resamples=100)
    first, total = indices()
    np.testing.assert_allclose(found.first[0], first, atol=0.005)
    np.testing.assert_allclose(found.total[0], total, atol=0.005)


def range_names(count):
    return [f"x{k + 1}" for k in range(count)]


def test_indices_are_those_of_scipy():
    y = ishigami(SaltelliDesign(512, 3).rows()) + 40.0
    blocks = y.reshape(-1, 5)
    outputs = {"f_A": blocks[:, 0], "f_B": blocks[:, 1], "f_AB": blocks[:, 2:].T[:, None]}
    theirs = stats.sobol_indices(func=outputs, n=512)
    ours = sobol_indices(y, NAMES)
    np.testing.assert_allclose(ours.first[0], theirs.first_order, atol=1e-12)
    np.testing.assert_allclose(ours.total[0], theirs.total_order, atol=1e-12)
    interval = theirs.bootstrap(n_resamples=1000).total_order.confidence_interval
    np.testing.assert_allclose(ours.total_interval[0, :, 0], interval.low, atol=0.03)
    np.testing.assert_allclose(ours.total_interval[0, :, 1], interval.high, atol=0.03)


@pytest.mark.parametrize("shift", [0.0, 1e4, -1e6])
def test_a_constant_on_the_output_changes_neither_indices_nor_intervals(shift):
    y = ishigami(SaltelliDesign(256, 3).rows())
    found = sobol_indices(np.stack([y, 3 * y + shift], axis=1), NAMES, ["y", "z"])
    for values in (found.first, found.total, found.first_interval, found.total_interval):
        np.testing.assert_allclose(values[1], values[0], atol=1e-7)


def test_intervals_cover_what_they_say():
    first, total = ishigami_indices()
    hits = []
    for seed in range(60):
        y = ishigami(SaltelliDesign(300, 3, "random", seed).rows())
        found = sobol_indices(y, NAMES, resamples=300, seed=seed)
        for interval, truth in ((found.first_interval, first), (found.total_interval, total)):
            hits.append((interval[0, :, 0] <= truth) & (truth <= interval[0, :, 1]))
    cover = np.mean(hits, axis=0)
    assert np.all((cover > 0.88) & (cover <= 1.0))


def test_several_outputs_are_as_one_by_one():
    rows = SaltelliDesign(64, 3).rows()
    y = np.stack([ishigami(rows), rows[:, 0] * rows[:, 1], rows.sum(axis=1)], axis=1)
    y[7, 1] = np.nan
    together = sobol_indices(y, NAMES, ["a", "b", "c"])
    for k in range(3):
        alone = sobol_indices(y[:, k], NAMES)
        np.testing.assert_allclose(together.first[k], alone.first[0], atol=1e-12)
        np.testing.assert_allclose(together.total_interval[k], alone.total_interval[0], atol=1e-12)


def test_a_run_without_a_value_drops_its_base_row():
    y = ishigami(SaltelliDesign(64, 3).rows())
    holed = y.copy()
    holed[[12, 13, 40]] = np.nan, np.inf, np.nan
    found = sobol_indices(holed, NAMES, ["force"])
    kept = np.delete(y.reshape(64, 5), [2, 8], axis=0).ravel()
    np.testing.assert_array_equal(found.total, sobol_indices(kept, NAMES).total)
    assert found.lost.tolist() == [3]
    assert found.kept.tolist() == [62]
    assert found.notes == (
        "force: 3 runs without a value; 2 base rows of 64 (3.1 %) left out in every block",
    )


def test_too_many_runs_without_a_value_are_refused():
    y = ishigami(SaltelliDesign(64, 3).rows())
    y[::20] = np.nan
    with pytest.raises(EnsembleError, match="16 of 64 base rows have a run without a value"):
        sobol_indices(y, NAMES)
    assert sobol_indices(y, NAMES, missing=0.3).kept == 48
    with pytest.raises(EnsembleError, match="too few are left"):
        sobol_indices(np.full(10, np.nan), NAMES, missing=1.0)


def test_few_base_rows_leave_the_interval_open():
    y = np.array([1.0, 2, 3, 4, 5, 1, 1, 1, 1, 1])  # a resample may draw the second row alone
    found = sobol_indices(y, NAMES)
    assert np.isfinite(found.total).all()
    assert np.isnan(found.total_interval).all()
    assert "[-, -]" in str(found)


@pytest.mark.parametrize("value", [0.0, 0.1, 1e9])
def test_an_output_that_does_not_vary_has_no_indices(value):
    found = sobol_indices(np.full(320, value), NAMES)
    assert np.isnan(found.first).all()
    assert np.isnan(found.total_interval).all()
    assert found.as_dict()["first"] == [[None] * 3]
    assert "y: does not vary, so there are no indices" in str(found)


def test_an_additive_output_has_no_interactions():
    design = SaltelliDesign(4096, 3)
    found = sobol_indices(design.rows() @ [1.0, 2.0, 3.0], NAMES)
    assert abs(found.interactions[0]) < 0.02
    np.testing.assert_allclose(found.first[0], np.array([1, 4, 9]) / 14, atol=0.01)
    assert found.ranked("y") == ("x3", "x2", "x1")
    with pytest.raises(UnknownName, match="no output is named 'z'"):
        found.ranked("z")


def test_many_outputs_in_parts_are_as_in_one(monkeypatch):
    rows = SaltelliDesign(32, 3).rows()
    y = np.stack([ishigami(rows) * k + rows[:, 0] for k in range(1, 8)], axis=1)
    whole = sobol_indices(y, NAMES)
    monkeypatch.setattr("gough.uncertainty.indices.SLAB", 400)
    parts = sobol_indices(y, NAMES)
    np.testing.assert_allclose(parts.first_interval, whole.first_interval, atol=1e-12)


def test_the_table_and_the_data():
    found = sobol_indices(ishigami(SaltelliDesign(256, 3).rows()), NAMES, ["force"])
    lines = str(found).splitlines()
    assert (
        lines[0] == "Sobol' indices from 256 base rows; 95 % intervals from 1000 resamples (seed 0)"
    )
    assert [line.split()[0] for line in lines[3:6]] == ["x1", "x2", "x3"]
    data = json.loads(json.dumps(found.as_dict()))
    assert data["kept"] == [256]
    assert np.array(data["first_interval"]).shape == (1, 3, 2)


def test_long_tables_are_cut():
    design = SaltelliDesign(8, 20)
    text = str(sobol_indices(design.rows().sum(axis=1), range_names(20)))
    assert "… and 8 factors with smaller totals" in text


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda y: sobol_indices(y[:-1], NAMES), "has a multiple of 5 rows"),
        (lambda y: sobol_indices(y, NAMES, ["a", "b"]), "expected a name for each"),
        (lambda y: sobol_indices(y, NAMES, confidence=95), "confidence is 95"),
        (lambda y: sobol_indices(y, NAMES, resamples=5), "resamples is 5, expected at least 100"),
        (lambda y: sobol_indices(y[:0], NAMES), r"shape \(0,\)"),
    ],
)
def test_what_does_not_fit_is_refused(call, message):
    with pytest.raises(EnsembleError, match=message):
        call(ishigami(SaltelliDesign(8, 3).rows()))
