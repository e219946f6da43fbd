"""Small matrices written out with their zeros: solutions of A x = b and of Aᵀ x = b.

Up to three rows by cofactors, which branch nowhere; more by elimination with partial pivoting, rows
exchanged by selections.
"""

from __future__ import annotations

from collections.abc import Sequence

import casadi

from gough import algebra as al
from gough.algebra import Scalar

Grid = list[list[Scalar]]
COFACTORS = 3
"""Largest number of rows that cofactors are used for."""


class Factors:
    """A regular matrix, ready to solve with.

    Args:
        A: its rows.

    Attributes:
        determinant: of A.
        pivot: what every solution is divided by: the determinant, or the last pivot.
    """

    def __init__(self, A: Sequence[Sequence[Scalar]]) -> None:
        self.size = len(A)
        self.determinant: Scalar = 1.0
        self._by_cofactors = self.size <= COFACTORS
        rows = [list(row) for row in A]
        if self._by_cofactors:
            self._adjugate, self.determinant = _adjugate(rows)
            self._inverse = reciprocal(self.determinant)
            self.pivot = self.determinant
        else:
            self._eliminate(rows)

    def solve(self, b: Sequence[Scalar]) -> list[Scalar]:
        """x with A x = b."""
        if self._by_cofactors:
            return [al.mul(self._inverse, al.dot(row, b)) for row in self._adjugate]
        x = self._exchanged(b)
        for k in range(self.size):
            for i in range(k + 1, self.size):
                x[i] = al.sub(x[i], al.mul(self._rows[i][k], x[k]))
        for k in reversed(range(self.size)):
            rest = [al.mul(self._rows[k][j], x[j]) for j in range(k + 1, self.size)]
            x[k] = al.mul(al.sub(x[k], al.total(rest)), self._reciprocals[k])
        return x

    def solve_transposed(self, b: Sequence[Scalar]) -> list[Scalar]:
        """x with Aᵀ x = b."""
        if self._by_cofactors:
            columns = zip(*self._adjugate, strict=True)
            return [al.mul(self._inverse, al.dot(column, b)) for column in columns]
        x = list(b)
        for k in range(self.size):
            rest = [al.mul(self._rows[i][k], x[i]) for i in range(k)]
            x[k] = al.mul(al.sub(x[k], al.total(rest)), self._reciprocals[k])
        for k in reversed(range(self.size)):
            rest = [al.mul(self._rows[i][k], x[i]) for i in range(k + 1, self.size)]
            x[k] = al.sub(x[k], al.total(rest))
        for k, i, larger in reversed(self._exchanges):
            x[k], x[i] = either(larger, x[i], x[k]), either(larger, x[k], x[i])
        return x

    def _eliminate(self, rows: Grid) -> None:
        self._exchanges: list[tuple[int, int, Scalar]] = []
        self._reciprocals: list[Scalar] = []
        for k in range(self.size):
            self._largest_up(rows, k)
            self.determinant = al.mul(self.determinant, rows[k][k])
            self._reciprocals.append(reciprocal(rows[k][k]))
            for i in range(k + 1, self.size):
                factor = al.mul(rows[i][k], self._reciprocals[k])
                rows[i][k] = factor
                for j in range(k + 1, self.size):
                    rows[i][j] = al.sub(rows[i][j], al.mul(factor, rows[k][j]))
        self._rows, self.pivot = rows, rows[-1][-1]

    def _largest_up(self, rows: Grid, k: int) -> None:
        """The largest entry of a column brought up; without a choice nothing is selected."""
        for i in range(k + 1, self.size):
            if _zero(rows[i][k]):
                continue
            if _zero(rows[k][k]):
                larger: Scalar = True
            else:
                larger = casadi.fabs(rows[i][k]) > casadi.fabs(rows[k][k])
            pairs = list(zip(rows[k], rows[i], strict=True))
            rows[k] = [either(larger, y, x) for x, y in pairs]
            rows[i] = [either(larger, x, y) for x, y in pairs]
            self._exchanges.append((k, i, larger))

    def _exchanged(self, b: Sequence[Scalar]) -> list[Scalar]:
        x = list(b)
        for k, i, larger in self._exchanges:
            x[k], x[i] = either(larger, x[i], x[k]), either(larger, x[k], x[i])
        return x


def solve_definite(A: Grid, b: Sequence[Scalar]) -> tuple[list[Scalar], Scalar]:
    """x with A x = b for a symmetric positive definite A, and its determinant.

    A = L D Lᵀ (Golub and Van Loan 2013, 4.1.2); zeros of A cost nothing where they last.
    """
    n, L, x = len(A), [list(row) for row in A], list(b)
    inverse: list[Scalar] = []
    determinant: Scalar = 1.0
    for k in range(n):
        determinant = al.mul(determinant, L[k][k])
        inverse.append(reciprocal(L[k][k]))
        for i in range(k + 1, n):
            factor = al.mul(L[i][k], inverse[k])
            for j in range(k + 1, i + 1):
                L[i][j] = al.sub(L[i][j], al.mul(factor, L[j][k]))
            x[i] = al.sub(x[i], al.mul(factor, x[k]))
    for k in reversed(range(n)):
        rest = [al.mul(L[j][k], x[j]) for j in range(k + 1, n)]
        x[k] = al.mul(al.sub(x[k], al.total(rest)), inverse[k])
    return x, determinant


def either(condition: Scalar, a: Scalar, b: Scalar) -> Scalar:
    """a where the condition holds, else b."""
    if condition is True:
        return a
    if al.is_number(a) and al.is_number(b) and a == b:
        return a
    return casadi.if_else(condition, a, b)


def reciprocal(x: Scalar) -> Scalar:
    """1 / x, infinite for a zero."""
    if al.is_number(x):
        return 1.0 / x if x else float("inf")
    return 1.0 / x


def _adjugate(A: Grid) -> tuple[Grid, Scalar]:
    match len(A):
        case 0:
            return [], 1.0
        case 1:
            return [[1.0]], A[0][0]
        case 2:
            (a, b), (c, d) = A
            adjugate = [[d, al.mul(-1.0, b)], [al.mul(-1.0, c), a]]
        case _:
            x, y, z = (tuple(column) for column in zip(*A, strict=True))
            adjugate = [list(al.cross(y, z)), list(al.cross(z, x)), list(al.cross(x, y))]
    return adjugate, al.dot(adjugate[0], [row[0] for row in A])


def _zero(x: Scalar) -> bool:
    return al.is_number(x) and x == 0
