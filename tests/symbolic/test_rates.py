"""Rates by screws: the closure Jacobian and its rate, for random mechanisms of all joint types."""

import casadi
import numpy as np
import pytest

from gough.assembly import Assembler
from gough.geometry.samples import sample
from gough.kernels import Kernel
from gough.models import Models
from gough.numerics.newton import Ending
from gough.symbolic import plans
from gough.symbolic.block_solves import Elimination, solve_unique
from gough.symbolic.closing_rates import ClosingRates
from gough.topology import Structure
from tests.mechanisms import random_mechanism

SX = casadi.SX


def closed(seed, **options):
    """Models, samples and a kernel input for a random mechanism; None if its home is open."""
    models = Models(Structure(random_mechanism(seed, **options)))
    assembler = Assembler(models, models.parameters())
    home = assembler.home()
    if home.ending is not Ending.closed:
        return None
    return models, assembler, sample(assembler, home.q, seed)


def jacobian_of(models, rates):
    E = SX(len(models.closure.rows), rates.C.shape[1])
    for i, row in enumerate(rates.entries):
        for k, value in row.items():
            E[i, k] = value
    return Kernel("E", {"q": models.closure.q, "p": models.closure.p}, E)


def bias_of(models, rates):
    """Ė v by screws, and by differentiating the residual twice."""
    closure = models.closure
    v = SX.sym("v", rates.C.shape[1])
    inputs = {"q": closure.q, "p": closure.p, "v": v}
    ours = SX(casadi.vertcat(*rates.bias([v[k] for k in range(v.numel())])))
    slope = casadi.jtimes(closure.residual, closure.q, closure.position_rates @ v)
    twice = casadi.jtimes(slope, closure.q, closure.position_rates @ v)
    shape = (len(closure.rows),)
    return Kernel("ours", inputs, ours, shape), Kernel("twice", inputs, twice, shape)


@pytest.mark.parametrize("planar", [False, True])
@pytest.mark.parametrize("seed", range(30))
def test_rows_by_screws_are_the_closure_jacobian_and_its_rate(seed, planar):
    found = closed(seed, planar=planar)
    if found is None or not found[0].closure.rows:
        return
    models, assembler, sampled = found
    rates = ClosingRates(models.closure, sampled.samples, np.eye(sampled.E.shape[2]))
    E, (ours, twice) = jacobian_of(models, rates), bias_of(models, rates)
    for q in sampled.samples.q:
        expected = models.jacobian(q, assembler.p)
        scale = max(1.0, np.abs(expected).max())
        np.testing.assert_allclose(E(q, assembler.p), expected, atol=1e-11 * scale)
        _, s, Vt = np.linalg.svd(expected)
        motions = Vt[int(np.sum(s > 1e-9 * s[0])) :]
        v = motions.T @ np.ones(len(motions))
        np.testing.assert_allclose(
            ours(q, assembler.p, v), twice(q, assembler.p, v), atol=1e-10 * scale**2
        )


def test_relations_that_never_change_are_found_exactly():
    """A parallelogram with bars: its pins turn by plus and minus the same angle."""
    E = np.array([[[1.0, 1.0, 0.0], [0.0, x, x]] for x in (0.3, 0.7, -0.5, 0.9)])
    plan = plans.make_plan(E, [0], [], np.ones(3))
    assert plan.kept == (0,)
    np.testing.assert_array_equal(plan.C.ravel(), [1.0, -1.0, 1.0])


def test_blocks_come_in_the_order_of_solving():
    rng = np.random.default_rng(0)
    E = np.zeros((5, 4, 5))
    E[:, 0, [0, 1]] = rng.normal(size=(5, 2))
    E[:, 1, [1, 2, 3]] = rng.normal(size=(5, 3))
    E[:, 2, [1, 2, 3]] = rng.normal(size=(5, 3))
    E[:, 3, [3, 4]] = rng.normal(size=(5, 2))
    plan = plans.make_plan(E, [0], [], np.ones(5))
    assert [block.unknowns for block in plan.blocks] == [(1,), (2, 3), (4,)]
    assert (plan.restrictions, plan.freedoms) == (0, 0)


@pytest.mark.parametrize("n", [1, 2, 3, 4, 7])
def test_blocks_of_any_size_are_solved(n):
    rng = np.random.default_rng(n)
    A, B = rng.normal(size=(30, n, n)), rng.normal(size=(30, n, 2))
    A[:, :, 0] *= rng.random((30, n)) < 0.8  # a zero may stand where a pivot is looked for
    A[np.abs(np.linalg.det(A)) < 1e-3] += np.eye(n)
    a, b = SX.sym("A", n * n), SX.sym("B", 2 * n)
    rows = [{k: a[i * n + k] for k in range(n)} for i in range(n)]
    right = [[b[2 * i], b[2 * i + 1]] for i in range(n)]
    found = solve_unique(rows, right, range(n))
    X = SX(casadi.vertcat(*[casadi.horzcat(*found[k]) for k in range(n)]))
    kernel = Kernel("X", {"A": a, "B": b}, X, (n, 2))
    np.testing.assert_allclose(
        kernel(A.reshape(30, -1), B.reshape(30, -1)), np.linalg.solve(A, B), rtol=1e-8, atol=1e-9
    )


def test_elimination_keeps_apart_what_does_not_meet():
    """Two legs of two rows that share one unknown: no row of one leg gets entries of the other."""
    a = SX.sym("a", 8)
    rows = [
        {0: a[0], 4: a[1]},
        {0: a[2], 4: a[3]},
        {1: a[4], 4: a[5]},
        {1: a[6], 4: a[7]},
    ]
    elimination = Elimination(rows, [[0.0]] * 4, [0, 1])
    assert [set(row) for row in elimination.left] == [{4}, {4}]
