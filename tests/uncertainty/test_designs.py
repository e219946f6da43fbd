"""Designs: rows are the same in any chunks, and are spread as their kind says."""

from __future__ import annotations

import subprocess
import sys
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats
from scipy.stats import qmc

from gough.errors import UnknownName
from gough.uncertainty import Design, DesignError, Distribution, OneAtATime, SaltelliDesign
from gough.uncertainty.permutations import ROUNDS, permuted

KINDS = ["random", "latin-hypercube", "sobol"]


@pytest.mark.parametrize("kind", KINDS)
@given(n=st.integers(1, 200), columns=st.integers(1, 5), cuts=st.lists(st.integers(0, 200)))
def test_chunks_hold_the_bits_of_the_whole(kind, n, columns, cuts):
    design = Design(kind, n, columns, seed=3)
    whole = design.rows()
    assert whole.shape == (n, columns)
    assert np.all((whole > 0) & (whole < 1))
    ends = sorted({0, n, *(min(cut, n) for cut in cuts)})
    parts = [design.rows(a, b) for a, b in pairwise(ends)]
    assert np.array_equal(np.concatenate(parts), whole)


@pytest.mark.parametrize("kind", KINDS)
def test_far_rows_of_a_large_design(kind):
    design = Design(kind, 1_000_000, 90)
    part = design.rows(700_000, 700_050)
    assert part.shape == (50, 90)
    assert np.array_equal(design.rows(699_990, 700_010)[10:], part[:10])


@pytest.mark.parametrize("kind", KINDS)
def test_seeds_and_columns_differ(kind):
    rows = Design(kind, 64, 3, seed=1).rows()
    assert np.array_equal(Design(kind, 64, 3, seed=1).rows(), rows)
    assert not np.any(Design(kind, 64, 3, seed=2).rows() == rows)
    assert abs(np.corrcoef(Design(kind, 4096, 4).rows().T) - np.eye(4)).max() < 0.06


@pytest.mark.parametrize("n", [1, 2, 3, 7, 64, 1000])
def test_a_latin_hypercube_has_one_row_in_each_part(n):
    cells = np.floor(Design("latin-hypercube", n, 4).rows() * n).astype(int)
    assert np.array_equal(np.sort(cells, axis=0), np.repeat(np.arange(n)[:, None], 4, axis=1))


def test_short_permutations_are_equally_likely():
    """All 24 orders of four rows, over many keys."""
    keys = np.random.default_rng(0).integers(0, 2**64, (ROUNDS, 24_000), dtype=np.uint64)
    orders = permuted(np.arange(4), 4, keys)
    _, counts = np.unique(4 ** np.arange(4) @ orders, return_counts=True)
    assert len(counts) == 24
    assert stats.chisquare(counts).pvalue > 1e-3


@pytest.mark.parametrize("n", [5, 37, 1000])
def test_neighbours_of_a_permutation_are_independent(n):
    keys = np.random.default_rng(1).integers(0, 2**64, (ROUNDS, 4000), dtype=np.uint64)
    first, second = permuted(np.array([n // 2, n // 2 + 1]), n, keys)
    gaps = (second - first) % n
    assert not np.any(gaps == 0)
    bins = np.bincount((gaps - 1) * min(n - 1, 10) // (n - 1))
    expected = np.bincount(np.arange(n - 1) * min(n - 1, 10) // (n - 1)) * 4000 / (n - 1)
    assert stats.chisquare(bins, expected).pvalue > 1e-3


def test_a_sobol_design_is_the_sequence_of_scipy_in_the_middles_of_its_cells():
    rows = Design("sobol", 256, 6).rows()
    cells = rows * 2**30 - 0.5
    assert np.array_equal(cells, np.floor(cells))
    assert qmc.discrepancy(rows) < 0.1 * qmc.discrepancy(Design("random", 256, 6).rows())
    for column in np.floor(rows * 256).astype(int).T:
        assert np.array_equal(np.sort(column), np.arange(256))


def test_random_rows_are_uniform():
    rows = Design("random", 5000, 4).rows()
    for column in rows.T:
        assert stats.kstest(column, "uniform").pvalue > 1e-3


def test_chunks_cover_the_rows():
    assert list(Design("random", 10, 1).chunks(4)) == [(0, 4), (4, 8), (8, 10)]


def test_what_a_design_says_of_itself():
    assert str(Design("sobol", 1000, 3)) == (
        "sobol: 1000 rows, 3 columns, seed 0; 512 or 1024 rows would be balanced"
    )
    assert str(Design("random", 1, 3, 7)) == "random: 1 row, 3 columns, seed 7"
    assert Design(**Design("sobol", 8, 2).as_dict()) == Design("sobol", 8, 2)
    assert str(SaltelliDesign(8, 2)) == (
        "Saltelli design on sobol: 8 base rows × (2 + 2) = 32 rows, seed 0"
    )


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Design("random", 0, 1), "n is 0, expected a whole number, at least 1"),
        (lambda: Design("random", 4, 1, -1), "seed is -1"),
        (lambda: Design("random", 4, 1.5), "columns is 1.5"),
        (lambda: Design("sobol", 2**31, 1), r"at most 2\^30 rows"),
        (lambda: Design("sobol", 4, 30_000), "a Latin hypercube has any number"),
        (lambda: Design("random", 4, 1).rows(2, 5), "rows 2 to 5 of a design with rows 0 to 4"),
        (lambda: SaltelliDesign(0, 3), "base is 0"),
    ],
)
def test_designs_that_can_not_be(make, message):
    with pytest.raises(DesignError, match=message):
        make()


def test_unknown_designs_have_a_close_match():
    with pytest.raises(UnknownName, match="Did you mean 'latin-hypercube'"):
        Design("latin hypercube", 4, 2)


# Saltelli


@pytest.mark.parametrize("kind", KINDS)
@given(base=st.integers(1, 20), factors=st.integers(1, 5), cut=st.floats(0, 1))
def test_saltelli_chunks_hold_the_bits_of_the_whole(kind, base, factors, cut):
    design = SaltelliDesign(base, factors, kind, seed=5)
    whole, at = design.rows(), int(cut * len(design))
    assert whole.shape == (base * (factors + 2), factors)
    assert np.array_equal(np.concatenate([design.rows(0, at), design.rows(at)]), whole)


def test_saltelli_blocks_differ_from_a_in_one_column_of_b():
    design = SaltelliDesign(16, 3)
    blocks = design.rows().reshape(16, 5, 3)
    A, B = blocks[:, 0], blocks[:, 1]
    assert np.array_equal(np.hstack([A, B]), design.design.rows())
    for i in range(3):
        mixed = A.copy()
        mixed[:, i] = B[:, i]
        assert np.array_equal(blocks[:, 2 + i], mixed)
    base, block = design.place([0, 1, 4, 5, 78])
    assert base.tolist() == [0, 0, 0, 1, 15]
    assert block.tolist() == [0, 1, 4, 0, 3]
    assert [design.block_name(k) for k in range(5)] == ["A", "B", "A_B^1", "A_B^2", "A_B^3"]


def test_a_saltelli_design_goes_on():
    few, more = SaltelliDesign(8, 3), SaltelliDesign(32, 3)
    assert np.array_equal(more.rows(0, len(few)), few.rows())


# one at a time


def make():
    read = Distribution.read
    return OneAtATime.of(["a", "b"], [read("uniform(0, 1)"), read("normal(3, 1)")], [0.4, 3.0])


def test_one_factor_at_a_time():
    design = make()
    rows = design.rows()
    assert len(design) == len(rows) == 5
    np.testing.assert_allclose(rows[:, 0], [0.4, 0.05, 0.95, 0.4, 0.4])
    np.testing.assert_allclose(
        rows[:, 1], [3, 3, 3, 3 - 1.6448536269514722, 3 + 1.6448536269514722]
    )
    assert np.array_equal(design.rows(1, 3), rows[1:3])


def test_the_swings_of_a_line_are_its_slopes():
    design = make()
    found = design.tornado(design.rows() @ [[1.0, 5.0], [-1.0, 0.0]], ["y", "z"])
    np.testing.assert_allclose(found.swing, [[0.9, 2 * 1.6448536269514722], [4.5, 0]])
    assert found.ranked("y") == ("b", "a")
    assert found.ranked("z") == ("a", "b")
    assert "y: -2.6 nominal" in str(found)
    assert found.as_dict()["quantiles"] == [0.05, 0.95]
    with pytest.raises(UnknownName, match="no output is named 'w'"):
        found.ranked("w")


def test_a_swing_without_a_value_comes_last():
    found = make().tornado([1.0, np.nan, 2.0, 1.1, 0.9])
    assert found.ranked("y") == ("b", "a")
    assert found.as_dict()["swing"][0][0] is None
    assert "1 value missing: runs that gave none" in str(found)


def test_nominal_values_are_medians_by_default():
    design = OneAtATime.of(["a"], [Distribution.read("lognormal(1, 0.3)")])
    assert design.nominal == (Distribution.read("lognormal(1, 0.3)").median,)


def test_tornado_designs_that_can_not_be():
    with pytest.raises(DesignError, match="expected as many of each"):
        OneAtATime(("a", "b"), (Distribution.read("uniform(0, 1)"),), (0.5,))
    with pytest.raises(DesignError, match="expected 0 < low < high < 1"):
        OneAtATime(("a",), (Distribution.read("uniform(0, 1)"),), (0.5,), 0.5, 0.1)


def test_importing_the_room_loads_no_scipy():
    code = "import sys, gough.uncertainty; sys.exit('scipy' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
