"""Every case of the reference whose matrices M, N and K are given, to the integer and to 1e-9."""

import json
from pathlib import Path

import numpy as np
import pytest

from gough.analysis import elimination, ranks

DATA = Path(__file__).parents[1] / "data" / "systematic.json"
CASES = [case for case in json.loads(DATA.read_text("utf-8"))["cases"] if "M" in case]


@pytest.fixture(params=CASES, ids=lambda case: f"{case['robot']}, {case['label']}")
def case(request):
    return request.param


@pytest.fixture
def rates(case):
    blocks = (np.array(case[key], dtype=float).reshape(case["n"], -1) for key in "MNK")
    return ranks.Linearisation(*blocks)


def test_there_are_matrices_to_compare():
    assert len(CASES) == 24


def test_ranks_mobility_and_defects(case, rates):
    expected = case["ranks"]
    found = rates.ranks
    assert tuple(expected[key] for key in ("rN", "rMN", "rNK", "rE")) == (
        found.N,
        found.MN,
        found.NK,
        found.E,
    )
    assert ranks.mobility(found, rates.counts) == case["mobility"]
    assert case["n"] - found.E == case["redundant_equations"]
    defects = ranks.defects(found, rates.counts, found).as_dict()
    assert {key: defects[key] for key in case["dims"]} == case["dims"]


def test_conditions_as_printed(case, rates):
    assert ranks.printed_tests(rates) == case["printed_tests"]


@pytest.mark.parametrize(
    "build",
    [
        elimination.by_svd,
        elimination.by_qr,
        lambda rates: elimination.by_gram_schmidt(rates).complement,
    ],
    ids=["svd", "qr", "gram-schmidt"],
)
def test_elimination_and_maps(case, rates, build):
    O = build(rates)
    assert rates.rank(O.T @ rates.M) == case["rank_A"]
    assert rates.rank(O.T @ rates.K) == case["rank_B"]
    for key, found in (
        ("qa_dot_from_x_dot", elimination.inverse_map(rates, O)),
        ("x_dot_from_qa_dot", elimination.direct_map(rates, O)),
        ("qp_dot_from_x_dot", elimination.passive_map(rates)),
    ):
        if case.get(key) is not None:
            np.testing.assert_allclose(found.matrix, case[key], atol=1e-9)
            assert found.unique


def test_a_map_is_given_where_it_is_valid_and_unique(case, rates):
    inverse, direct = elimination.inverse_map(rates), elimination.direct_map(rates)
    assert (inverse.valid and inverse.unique) == (case.get("qa_dot_from_x_dot") is not None)
    if direct.valid and direct.unique:
        assert case.get("x_dot_from_qa_dot") is not None
