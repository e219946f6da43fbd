"""Small linear systems written out as expressions, for matrices of CasADi scalars.

Nothing branches: where a pivot must be chosen, rows are exchanged by selections, so that any number
of lanes may each have their own pivots.
"""

from __future__ import annotations

import casadi

SX = casadi.SX


def ldlt_solve(A: SX, B: SX) -> SX:
    """X with A X = B for a symmetric positive definite A, by A = L D Lᵀ.

    Of A only the lower triangle is read. One reciprocal for each row, no square roots (Golub and
    Van Loan 2013, 4.1.2). Of a matrix that is not definite the result may be anything.

    Args:
        A: (n, n).
        B: (n, k), the right-hand sides.

    Returns:
        (n, k).

    Raises:
        ValueError: the shapes do not fit.
    """
    n = _size(A, B)
    lower = [[A[i, j] for j in range(i + 1)] for i in range(n)]
    right = _rows(B)
    inverse: list[SX] = []
    for k in range(n):
        inverse.append(1.0 / lower[k][k])
        for i in range(k + 1, n):
            factor = lower[i][k] * inverse[k]
            for j in range(k + 1, i + 1):
                lower[i][j] = lower[i][j] - factor * lower[j][k]
            right[i] = [x - factor * y for x, y in zip(right[i], right[k], strict=True)]
    for k in reversed(range(n)):
        for j in range(k + 1, n):
            right[k] = [x - lower[j][k] * y for x, y in zip(right[k], right[j], strict=True)]
        right[k] = [x * inverse[k] for x in right[k]]
    return _matrix(right, B)


def lu_solve(A: SX, B: SX) -> SX:
    """X with A X = B for a regular A, by elimination with partial pivoting.

    Each column takes its largest entry as pivot, brought up by comparing and exchanging rows
    (Golub and Van Loan 2013, 3.4). Of a singular matrix the result is infinite or NaN, or large.

    Args:
        A: (n, n).
        B: (n, k), the right-hand sides.

    Returns:
        (n, k).

    Raises:
        ValueError: the shapes do not fit.
    """
    return lu_solve_with_determinant(A, B)[0]


def lu_solve_with_determinant(A: SX, B: SX) -> tuple[SX, SX]:
    """The same, and the determinant of A: the product of the pivots, with the sign of the order."""
    n = _size(A, B)
    rows = [[A[i, j] for j in range(n)] + right for i, right in enumerate(_rows(B))]
    inverse: list[SX] = []
    determinant = SX(1.0)
    for k in range(n):
        determinant = determinant * _largest_up(rows, k) * rows[k][k]
        inverse.append(1.0 / rows[k][k])
        for i in range(k + 1, n):
            factor = rows[i][k] * inverse[k]
            rows[i][k + 1 :] = [x - factor * y for x, y in _pairs(rows[i], rows[k], k + 1)]
    for k in reversed(range(n)):
        right = rows[k][n:]
        for j in range(k + 1, n):
            right = [x - rows[k][j] * y for x, y in zip(right, rows[j][n:], strict=True)]
        rows[k][n:] = [x * inverse[k] for x in right]
    return _matrix([row[n:] for row in rows], B), determinant


def _largest_up(rows: list[list[SX]], k: int) -> SX:
    """Exchange rows so that none below row k has a larger entry in column k; 1 or -1 by parity."""
    parity = SX(1.0)
    for i in range(k + 1, len(rows)):
        larger = casadi.fabs(rows[i][k]) > casadi.fabs(rows[k][k])
        parity = casadi.if_else(larger, -parity, parity)
        pairs = _pairs(rows[k], rows[i], k)
        rows[k][k:] = [casadi.if_else(larger, y, x) for x, y in pairs]
        rows[i][k:] = [casadi.if_else(larger, x, y) for x, y in pairs]
    return parity


def _pairs(a: list[SX], b: list[SX], start: int) -> list[tuple[SX, SX]]:
    return list(zip(a[start:], b[start:], strict=True))


def _rows(B: SX) -> list[list[SX]]:
    return [[B[i, j] for j in range(B.shape[1])] for i in range(B.shape[0])]


def _matrix(rows: list[list[SX]], B: SX) -> SX:
    return casadi.vertcat(*[casadi.horzcat(*row) for row in rows]) if rows else SX(*B.shape)


def _size(A: SX, B: SX) -> int:
    n = int(A.shape[0])
    if A.shape[1] != n or B.shape[0] != n:
        raise ValueError(
            f"A has shape {tuple(A.shape)} and B {tuple(B.shape)}, expected (n, n) and (n, k)"
        )
    return n
