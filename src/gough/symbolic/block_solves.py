"""Blocks of sparse equations solved as expressions.

Up to three unknowns by cofactors, which branch nowhere and cost little for single unknowns. More
by elimination with partial pivoting among the rows that hold a column, leg after leg.
"""

from __future__ import annotations

from collections.abc import Sequence

import casadi

from gough import algebra as al
from gough.algebra import Scalar
from gough.kernels.solves import ldlt_solve
from gough.symbolic.trees.factors import COFACTORS, Factors, either, reciprocal

SX = casadi.SX
Row = dict[int, Scalar]
"""Entries by unknown; those that are zero are absent."""


def solve_unique(
    rows: Sequence[Row],
    right: Sequence[Sequence[Scalar]],
    unknowns: Sequence[int],
    late: frozenset[int] = frozenset(),
) -> dict[int, list[Scalar]]:
    """The solution X of A X = B, a row for each unknown.

    Args:
        rows: A by rows, as many as unknowns.
        right: B, a row for each of A.
        unknowns: the columns of A.
        late: unknowns to leave to the end, so that they are the cheapest to get.
    """
    if len(unknowns) <= COFACTORS:
        return _by_cofactors(rows, right, unknowns)
    return Elimination(rows, right, _order(rows, unknowns, late)).solution()


def solve_smallest(
    rows: Sequence[Row],
    right: Sequence[Sequence[Scalar]],
    unknowns: Sequence[int],
    first: Sequence[int],
    unit: dict[int, float],
) -> dict[int, list[Scalar]]:
    """Of all solutions the one whose rates are the smallest multiples of their units.

    x = W Aᵀ (A W Aᵀ)⁻¹ b with W = unit²; rates in ``first`` are eliminated and do not count.
    """
    elimination = Elimination(rows, right, _order(rows, first, frozenset()))
    rest = [k for k in unknowns if k not in set(first)]
    A = _dense([{k: al.mul(unit[k], x) for k, x in row.items()} for row in elimination.left], rest)
    multipliers = ldlt_solve(A @ A.T, _matrix(elimination.left_right, len(right[0])))
    X = A.T @ multipliers
    for j, k in enumerate(rest):
        elimination.values[k] = [al.mul(unit[k], X[j, c]) for c in range(X.shape[1])]
    return elimination.solution()


def solve_nearest(
    rows: Sequence[Row],
    right: Sequence[Sequence[Scalar]],
    unknowns: Sequence[int],
    weights: Sequence[float],
) -> dict[int, list[Scalar]]:
    """Least squares: (Aᵀ W² A) x = Aᵀ W² b with the weights of the rows in W."""
    weighted = [
        {k: al.mul(weight, x) for k, x in row.items()}
        for row, weight in zip(rows, weights, strict=True)
    ]
    scaled = [[al.mul(weight, x) for x in row] for row, weight in zip(right, weights, strict=True)]
    A, B = _dense(weighted, unknowns), _matrix(scaled, len(right[0]))
    X = ldlt_solve(A.T @ A, A.T @ B)
    return {k: [X[j, c] for c in range(X.shape[1])] for j, k in enumerate(unknowns)}


# cofactors


def _by_cofactors(
    rows: Sequence[Row], right: Sequence[Sequence[Scalar]], unknowns: Sequence[int]
) -> dict[int, list[Scalar]]:
    """Every column of the right-hand side by the cofactors of one small matrix."""
    factors = Factors([[row.get(k, 0.0) for k in unknowns] for row in rows])
    columns = [factors.solve(column) for column in zip(*right, strict=True)]
    return {k: [column[j] for column in columns] for j, k in enumerate(unknowns)}


# elimination


class Elimination:
    """Gaussian elimination of some columns of sparse equations.

    Each column takes as pivot its largest entry among all rows that hold it, brought up by
    selections; the rows that take part get the union of their patterns.

    Attributes:
        left: what remains of the equations, in the columns that were not eliminated.
        left_right: their right-hand sides.
        values: rates of the columns that were not eliminated, to be filled in.
    """

    def __init__(
        self, rows: Sequence[Row], right: Sequence[Sequence[Scalar]], order: Sequence[int]
    ) -> None:
        table = [(dict(row), list(own)) for row, own in zip(rows, right, strict=True)]
        self._pivots: list[tuple[int, Row, list[Scalar], Scalar]] = []
        self.values: dict[int, list[Scalar]] = {}
        for column in order:
            holders = [item for item in table if column in item[0]]
            table = [item for item in table if column not in item[0]]
            holders = _largest_first(holders, column)
            pivot, own = holders[0]
            inverse = reciprocal(pivot[column])
            self._pivots.append((column, pivot, own, inverse))
            table += [_reduced(item, holders[0], column, inverse) for item in holders[1:]]
        self.left = [row for row, _ in table]
        self.left_right = [own for _, own in table]

    def solution(self) -> dict[int, list[Scalar]]:
        """All rates, with those in ``values`` given."""
        found = dict(self.values)
        for column, row, own, inverse in reversed(self._pivots):
            rest = own
            for k, x in row.items():
                if k != column:
                    rest = [al.sub(a, al.mul(x, b)) for a, b in zip(rest, found[k], strict=True)]
            found[column] = [al.mul(inverse, a) for a in rest]
        return found


Item = tuple[Row, list[Scalar]]


def _largest_first(items: list[Item], column: int) -> list[Item]:
    """The rows with the largest entry of a column brought to the front."""
    union = sorted({k for row, _ in items for k in row}) if len(items) > 1 else []
    best, rest = items[0], []
    for item in items[1:]:
        larger = casadi.fabs(item[0][column]) > casadi.fabs(best[0][column])
        rest.append(_selected(larger, best, item, union))
        best = _selected(larger, item, best, union)
    return [best, *rest]


def _selected(condition: Scalar, a: Item, b: Item, union: Sequence[int]) -> Item:
    row = {k: either(condition, a[0].get(k, 0.0), b[0].get(k, 0.0)) for k in union}
    return row, [either(condition, x, y) for x, y in zip(a[1], b[1], strict=True)]


def _reduced(item: Item, pivot: Item, column: int, inverse: Scalar) -> Item:
    factor = al.mul(item[0][column], inverse)
    keys = [k for k in dict.fromkeys([*item[0], *pivot[0]]) if k != column]
    row = {k: al.sub(item[0].get(k, 0.0), al.mul(factor, pivot[0].get(k, 0.0))) for k in keys}
    right = [al.sub(a, al.mul(factor, b)) for a, b in zip(item[1], pivot[1], strict=True)]
    return row, right


def _order(rows: Sequence[Row], columns: Sequence[int], late: frozenset[int]) -> list[int]:
    """Columns in the order of elimination: next the one that takes the fewest operations."""
    patterns = [set(row) for row in rows]
    left, order = list(columns), []

    def cost(column: int) -> tuple[int, bool]:
        holders = [pattern for pattern in patterns if column in pattern]
        union = set().union(*holders)
        return (len(holders) - 1) * len(union), column in late

    while left:
        best = min(left, key=cost)
        left.remove(best)
        order.append(best)
        holders = [pattern for pattern in patterns if best in pattern]
        union = set().union(*holders) - {best}
        patterns = [pattern for pattern in patterns if best not in pattern]
        patterns += [set(union) for _ in holders[1:]]
    return order


def _dense(rows: Sequence[Row], columns: Sequence[int]) -> SX:
    return _matrix([[row.get(k, 0.0) for k in columns] for row in rows], len(columns))


def _matrix(rows: Sequence[Sequence[Scalar]], width: int) -> SX:
    if not rows:
        return SX(0, width)
    return SX(casadi.vertcat(*[casadi.horzcat(*row) for row in rows]))
