"""Linear systems written out: against numpy, with pivots that differ from row to row."""

import casadi
import numpy as np
import pytest

from gough.kernels import Kernel
from gough.kernels.solves import ldlt_solve, lu_solve, lu_solve_with_determinant


def kernel(solve, n, k):
    A, B = casadi.SX.sym("A", n * n), casadi.SX.sym("B", n * k)
    matrices = casadi.reshape(A, n, n).T, casadi.reshape(B, k, n).T
    return Kernel(solve.__name__, {"A": A, "B": B}, solve(*matrices), (n, k))


def solved(solve, A, B):
    rows, n, k = len(A), A.shape[-1], B.shape[-1]
    return kernel(solve, n, k)(A.reshape(rows, -1), B.reshape(rows, -1))


@pytest.mark.parametrize("n", [1, 2, 3, 6, 8])
@pytest.mark.parametrize("k", [1, 3])
def test_any_regular_matrix(n, k):
    rng = np.random.default_rng(10 * n + k)
    A, B = rng.normal(size=(40, n, n)), rng.normal(size=(40, n, k))
    A[:20] *= 10.0 ** rng.uniform(-6, 6, (20, n, 1))  # rows of very different sizes
    if n > 1:
        A[20:30, 0, 0] = 0.0  # a zero first pivot
    X = solved(lu_solve, A, B)
    backward = np.abs(A @ X - B) / (np.abs(A) @ np.abs(X) + np.abs(B))
    assert backward.max() < 1e-13


@pytest.mark.parametrize("n", [1, 2, 3, 6, 8])
def test_definite_matrices(n):
    rng = np.random.default_rng(n)
    half = rng.normal(size=(30, n, n))
    A, B = half @ half.swapaxes(1, 2) + 0.1 * np.eye(n), rng.normal(size=(30, n, 2))
    upper_does_not_matter = np.tril(A) + 7 * np.triu(np.ones((n, n)), 1)
    np.testing.assert_allclose(
        solved(ldlt_solve, upper_does_not_matter, B), np.linalg.solve(A, B), rtol=1e-9
    )


def test_every_row_may_have_its_own_pivots():
    rng = np.random.default_rng(1)
    A = np.eye(4)[rng.permuted(np.tile(np.arange(4), (16, 1)), axis=1)]
    B = rng.normal(size=(16, 4, 1))
    np.testing.assert_array_equal(solved(lu_solve, A, B), np.linalg.solve(A, B))


@pytest.mark.parametrize("n", [1, 2, 3, 6])
def test_the_determinant_with_its_sign(n):
    rng = np.random.default_rng(n)
    A = rng.normal(size=(30, n, n))
    symbols = casadi.SX.sym("A", n * n)
    _, found = lu_solve_with_determinant(casadi.reshape(symbols, n, n).T, casadi.SX.ones(n, 1))
    computed = Kernel("determinant", {"A": symbols}, found)(A.reshape(30, -1))
    np.testing.assert_allclose(computed[:, 0, 0], np.linalg.det(A), rtol=1e-10)


def test_a_singular_matrix_is_no_silent_number():
    X = solved(lu_solve, np.ones((9, 2, 2)), np.array([[[1.0], [2.0]]] * 9))
    assert not np.isfinite(X).any()


@pytest.mark.parametrize("solve", [ldlt_solve, lu_solve])
def test_wrong_shapes(solve):
    with pytest.raises(ValueError, match=r"A has shape \(2, 3\) and B \(2, 1\), expected \(n, n\)"):
        solve(casadi.SX(2, 3), casadi.SX(2, 1))
