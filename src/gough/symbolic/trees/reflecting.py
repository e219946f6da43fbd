"""Inertia of all kept rates as the given ones feel it: A = M_yy - … + Pᵀ (J⁻ᵀ M_uu J⁻¹) P."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import casadi
import numpy as np

from gough import algebra as al
from gough.algebra import Scalar, Vector
from gough.symbolic.plans import Block
from gough.symbolic.trees.factors import Grid
from gough.symbolic.trees.frames import Rates
from gough.symbolic.trees.motion import Motion
from gough.symbolic.trees.nodes import Node
from gough.symbolic.trees.selection import Chosen
from gough.symbolic.trees.solving import Solver, is_zero

DEPTH = 20
"""How deep expressions of inertia are compared."""
Group = tuple[list[int], list[int]]
"""Rows and unknowns."""


class Reflecting:
    """Inertia of the kept rates, to be felt by the given ones.

    Args:
        solver: the given rates and how the others follow.
        M: Cᵀ M C, symmetric, (kept, kept).
    """

    def __init__(self, solver: Solver, M: Grid) -> None:
        self.solver, self.M = solver, M
        self.frames, self.selection, self.C = solver.frames, solver.selection, solver.C

    def given(self) -> Grid:
        """A of the given rates, leg by leg."""
        given = self.selection.given
        A = [[self.M[i][k] for k in given] for i in given]
        alike: list[tuple[Scalar, list[int]]] = []
        for group in self._groups():
            if (x := self._of_length(group)) is None:
                self._add_group(A, group)
            elif not is_zero(x):
                _gather(alike, x, group[0][0])
        for x, rows in alike:
            self._add_lengths(A, x, rows)
        return A

    def _of_length(self, group: Group) -> Scalar | None:
        """The inertia of a group that is one length and shares none with the given rates."""
        rows, (k, *others) = group
        if others or self.selection.rows[rows[0]].tie.word != "length":
            return None
        if any(not is_zero(self.M[k][y]) for y in self.selection.given):
            return None
        inverse = self.solver.inverse(rows)[rows[0]][k]
        return al.mul(inverse, al.mul(inverse, self.M[k][k]))

    def _add_lengths(self, A: Grid, x: Scalar, rows: Sequence[int]) -> None:
        """Add x Σ pᵀ p of rows p of P; x multiplies the sum where there are many rows."""
        P = [self.solver.unit_row(r) for r in rows]
        entries = (len(A) + 1) / 2
        late = len(rows) >= entries
        scaled = P if late else [[al.mul(x, p) for p in row] for row in P]
        for i in range(len(A)):
            for j in range(i + 1):
                s = al.total([al.mul(a[i], b[j]) for a, b in zip(P, scaled, strict=True)])
                A[i][j] = A[j][i] = al.add(A[i][j], al.mul(x, s) if late else s)

    def _groups(self) -> list[Group]:
        """Rows and unknowns that hang together by rows or by inertia: the legs."""
        left, found = list(range(len(self.selection.blocks))), []
        blocks = self.selection.blocks
        while left:
            group, rest = [left[0]], left[1:]
            grew = True
            while grew:
                grew = False
                for n in list(rest):
                    if any(self._hang_together(blocks[n], blocks[m]) for m in group):
                        group.append(n)
                        rest.remove(n)
                        grew = True
            left = rest
            rows = sorted(i for n in group for i in blocks[n].rows)
            found.append((rows, sorted(k for n in group for k in blocks[n].unknowns)))
        return found

    def _hang_together(self, a: Block, b: Block) -> bool:
        """Whether two blocks share an unknown in a row, or inertia."""
        pairs = [(i, k) for one, two in ((a, b), (b, a)) for i in one.rows for k in two.unknowns]
        if any(pair in self.solver.J for pair in pairs):
            return True
        return any(not is_zero(self.M[i][k]) for i in a.unknowns for k in b.unknowns)

    def _add_group(self, A: Grid, group: Group) -> None:
        """Add what one leg's unknown rates make of its inertia."""
        (rows, unknowns), M = group, self.M
        if all(is_zero(x) for k in unknowns for x in M[k]):
            return
        K = self.solver.inverse(rows)
        MK = {
            (i, r): al.total([al.mul(M[i][k], K[r].get(k, 0.0)) for k in unknowns])
            for i in unknowns
            for r in rows
        }
        X = {}
        for a, r in enumerate(rows):
            for s in rows[: a + 1]:
                x = al.total([al.mul(K[r].get(k, 0.0), MK[k, s]) for k in unknowns])
                X[r, s] = X[s, r] = x
        self._add_reflected(A, X, rows)
        self._add_shared(A, K, group)

    def _add_shared(self, A: Grid, K: Mapping[int, Rates], group: Group) -> None:
        """Subtract what inertia that given and unknown rates share makes."""
        (rows, unknowns), given, M = group, self.selection.given, self.M
        if all(is_zero(M[k][y]) for k in unknowns for y in given):
            return
        KM = {
            (r, j): al.total([al.mul(K[r].get(k, 0.0), M[k][y]) for k in unknowns])
            for r in rows
            for j, y in enumerate(given)
        }
        P = {r: self.solver.unit_row(r) for r in rows}
        for i in range(len(A)):
            for j in range(i + 1):
                x = al.total([al.mul(P[r][i], KM[r, j]) for r in rows])
                x = al.add(x, al.total([al.mul(P[r][j], KM[r, i]) for r in rows]))
                A[i][j] = al.sub(A[i][j], x)
                A[j][i] = A[i][j]

    def _add_reflected(self, A: Grid, X: Mapping[tuple[int, int], Scalar], rows: list[int]) -> None:
        """Add Pᵀ X P with P = L Z: first to the points where the leg closes, then to y."""
        L, Z = self._through_points(rows)
        n = len(Z)
        XL = [[al.total([al.mul(X[r, s], L[s][a]) for s in rows]) for a in range(n)] for r in rows]
        D = [[0.0] * n for _ in range(n)]
        for a in range(n):
            for b in range(a + 1):
                D[a][b] = al.total([al.mul(L[r][a], XL[k][b]) for k, r in enumerate(rows)])
                D[b][a] = D[a][b]
        DZ = [[al.dot(D[a], [z[j] for z in Z]) for j in range(len(A))] for a in range(n)]
        for i in range(len(A)):
            for j in range(i + 1):
                x = al.total([al.mul(Z[a][i], DZ[a][j]) for a in range(n)])
                A[i][j] = al.add(A[i][j], x)
                A[j][i] = A[i][j]

    def _through_points(self, rows: Sequence[int]) -> tuple[dict[int, list[Scalar]], Grid]:
        """P of some rows as L Z, with Z the velocity of the closing point for unit given rates.

        Where rows hold more than the velocity of one point that the given rates alone move, Z is
        the identity.
        """
        ends = {self._given_end(row) for row in (self.selection.rows[r] for r in rows)}
        end = ends.pop() if len(ends) == 1 else None
        count = len(self.selection.given)
        if end is None or count <= 3:
            identity = [[float(i == j) for j in range(count)] for i in range(count)]
            return {r: self.solver.unit_row(r) for r in rows}, identity
        node, point, sign = end
        Z: Grid = [[], [], []]
        for k in self.selection.given:
            v, axes = Motion(self.frames, self.C, {k: 1.0}).point_velocity(node, point)
            for a, x in enumerate(v):
                Z[a].append(x)
        L = {}
        for r in rows:
            row = self.selection.rows[r]
            turned = [self.frames.turn(unit, axes, row.axes) for unit in al.IDENTITY]
            L[r] = [al.mul(sign, t[row.component]) for t in turned]
        return L, Z

    def _given_end(self, row: Chosen) -> tuple[Node, Vector, float] | None:
        """The end of a closing point that only given rates move, if the other moves by none."""
        tie = row.tie
        if tie.word != "point" or tie.common is not self.frames.tree.root:
            return None
        given = set(self.selection.given)
        moved = [
            {
                k
                for n in end.node.ancestors()
                for v in n.variables
                for k in np.flatnonzero(self.C[v])
            }
            for end in (tie.a, tie.b)
        ]
        if moved[1] <= given and not moved[0] & given:
            return tie.b.node, tie.b.point, 1.0
        if moved[0] <= given and not moved[1] & given:
            return tie.a.node, tie.a.point, -1.0
        return None


def _gather(alike: list[tuple[Scalar, list[int]]], x: Scalar, row: int) -> None:
    """Put a row with those of the same inertia."""
    for y, rows in alike:
        if x is y or casadi.is_equal(casadi.SX(x), casadi.SX(y), DEPTH):
            rows.append(row)
            return
    alike.append((x, [row]))
