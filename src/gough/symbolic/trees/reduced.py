"""Dynamics of a mechanism with loops in independent rates, block by block, as scalar expressions.

With v = C w, w = (y, u), J u + P y = 0 in the chosen rows, and h the forces of the tree:

    u = -J⁻¹ P y,    h_y' = h_y - Pᵀ J⁻ᵀ h_u    (inverse dynamics: the forces that y feels)
    A = M_yy - Pᵀ J⁻ᵀ M_uy - (…)ᵀ + Pᵀ (J⁻ᵀ M_uu J⁻¹) P    (direct dynamics)

J falls into the blocks of the legs, P is used row by row and never formed with J⁻¹: the models of
Khalil and Guégan (2004) come out, each leg reflected to the platform where it closes.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property

import casadi
import numpy as np
from numpy.typing import NDArray

from gough import algebra as al
from gough.algebra import Scalar, Vector
from gough.symbolic.plans import Block
from gough.symbolic.trees.factors import Factors, Grid
from gough.symbolic.trees.forces import Loads, mass_matrix, tree_forces
from gough.symbolic.trees.frames import Frames, Rates
from gough.symbolic.trees.motion import Motion
from gough.symbolic.trees.nodes import Node
from gough.symbolic.trees.selection import Chosen, Selection
from gough.symbolic.trees.ties import Rows

Array = NDArray[np.float64]
SX = casadi.SX


class Reduced:
    """One placing of a tree, with all rates from the given ones.

    Args:
        frames: the tree where it stands.
        C: all rates v = C w, (variables, kept).
        selection: rows and blocks.
    """

    def __init__(self, frames: Frames, C: Array, selection: Selection) -> None:
        self.frames, self.C, self.selection = frames, C, selection
        self.tree = frames.tree
        self._rows = Rows(frames)
        self.y = [SX.sym(f"y{k}") for k in range(len(selection.given))]
        """Symbols of the given rates, which rows of velocity are written in."""
        self._given: Rates = dict(zip(selection.given, self.y, strict=True))

    # rows

    def _each(self, motions: Mapping[int, Motion], acceleration: bool) -> list[Scalar]:
        """The chosen rows for motions by common node."""
        written = self._rows.acceleration if acceleration else self._rows.velocity
        made: dict[tuple[int, int], list[Scalar]] = {}
        found = []
        for row in self.selection.rows:
            key = id(row.tie), row.axes.index
            if key not in made:
                made[key] = written(row.tie, motions[row.tie.common.index], row.axes)
            found.append(made[key][row.component])
        return found

    def _motions(self, w: Rates, wd: Rates | None = None) -> dict[int, Motion]:
        """A motion relative to each common node."""
        commons: dict[int, Chosen] = {row.tie.common.index: row for row in self.selection.rows}
        return {
            index: Motion(self.frames, self.C, w, wd, still=row.tie.still)
            for index, row in commons.items()
        }

    @cached_property
    def _J(self) -> dict[tuple[int, int], Scalar]:
        """Entries of the chosen rows for unit rates of the unknowns."""
        found = {}
        for k in self.selection.unknown:
            for i, x in enumerate(self._each(self._motions({k: 1.0}), False)):
                if self.selection.pattern[i, k] and not _zero(x):
                    found[i, k] = x
        return found

    @cached_property
    def _factors(self) -> list[Factors]:
        return [
            Factors([[self._J.get((i, k), 0.0) for k in block.unknowns] for i in block.rows])
            for block in self.selection.blocks
        ]

    @cached_property
    def _P(self) -> list[Scalar]:
        """The chosen rows at the given rates alone, P y."""
        return self._each(self._motions(self._given), False)

    # solving

    def solve(self, right: Sequence[Scalar], rows: frozenset[int] | None = None) -> Rates:
        """u with J u = right, by kept rate; of some rows only, which must be whole blocks."""
        found: dict[int, Scalar] = {}
        for block, factors in zip(self.selection.blocks, self._factors, strict=True):
            if rows is not None and not rows.issuperset(block.rows):
                continue
            b = [
                al.sub(
                    right[i],
                    al.total([al.mul(self._J[i, k], found[k]) for k in found if (i, k) in self._J]),
                )
                for i in block.rows
            ]
            x = [0.0] * len(b) if all(map(_zero, b)) else factors.solve(b)
            found |= dict(zip(block.unknowns, x, strict=True))
        return found

    def solve_transposed(self, h: Rates) -> list[Scalar]:
        """f with Jᵀ f = h, by row."""
        found: dict[int, Scalar] = {}
        pairs = list(zip(self.selection.blocks, self._factors, strict=True))
        for block, factors in reversed(pairs):
            b = []
            for k in block.unknowns:
                rest = [al.mul(self._J[i, k], f) for i, f in found.items() if (i, k) in self._J]
                b.append(al.sub(h.get(k, 0.0), al.total(rest)))
            x = [0.0] * len(b) if all(map(_zero, b)) else factors.solve_transposed(b)
            found |= dict(zip(block.rows, x, strict=True))
        return [found[i] for i in range(len(self.selection.rows))]

    def reflected(self, f: Sequence[Scalar]) -> list[Scalar]:
        """Pᵀ f, by a reverse sweep through the rows, by given rate."""
        pairs = [(p, x) for p, x in zip(self._P, f, strict=True) if not _zero(x) and not _zero(p)]
        if not pairs:
            return [0.0] * len(self.y)
        rows, seeds = (SX(casadi.vertcat(*column)) for column in zip(*pairs, strict=True))
        found = casadi.jtimes(rows, casadi.vertcat(*self.y), seeds, True)
        return [_number(found[k]) for k in range(len(self.y))]

    def onto_given(self, h: Sequence[Scalar]) -> list[Scalar]:
        """Generalised forces of all variables as the given rates feel them."""
        kept = self.onto_kept(h)
        unknown = {k: kept[k] for k in self.selection.unknown}
        along = self.reflected(self.solve_transposed(unknown))
        own = [kept[k] for k in self.selection.given]
        return [al.sub(a, b) for a, b in zip(own, along, strict=True)]

    def onto_kept(self, h: Sequence[Scalar]) -> list[Scalar]:
        """Cᵀ h."""
        found: list[Scalar] = []
        for column in self.C.T:
            used = np.flatnonzero(column).tolist()
            found.append(al.total([al.mul(float(column[v]), h[v]) for v in used]))
        return found

    # rates

    @cached_property
    def rates(self) -> Rates:
        """All kept rates."""
        return {**self._given, **self.solve([al.mul(-1.0, x) for x in self._P])}

    def accelerations(self, yd: Sequence[Scalar]) -> Rates:
        """All kept accelerations for those of the given rates."""
        given = dict(zip(self.selection.given, yd, strict=True))
        rows = self._each(self._motions(self.rates, given), True)
        return {**given, **self.solve([al.mul(-1.0, x) for x in rows])}

    def all_rates(self, kept: Rates) -> list[Scalar]:
        """v = C w."""
        return [
            al.total([al.mul(float(form[k]), kept[k]) for k in np.flatnonzero(form).tolist()])
            for form in self.C
        ]

    # dynamics

    def motion(self, yd: Sequence[Scalar], gravity: Vector | None) -> Motion:
        """The motion of the whole tree."""
        return Motion(self.frames, self.C, self.rates, self.accelerations(yd), gravity)

    def forces(self, yd: Sequence[Scalar], gravity: Vector | None, loads: Loads) -> list[Scalar]:
        """Generalised forces along the given rates that a motion takes."""
        motion = self.motion(yd, gravity)
        return self.onto_given(tree_forces(self.frames, motion, loads, len(self.C)))

    def rows_of(self, variables: Sequence[int]) -> Grid:
        """Rates of some variables for unit given rates, (variables, given)."""
        found: Grid = []
        for variable in variables:
            h = [0.0] * len(self.C)
            h[variable] = 1.0
            found.append(self.onto_given(h))
        return found

    def mass_matrix(self, loads: Loads) -> Grid:
        """A of the given rates, symmetric positive definite, leg by leg."""
        M = self._kept_mass(loads)
        given = self.selection.given
        A = [[M[i][k] for k in given] for i in given]
        for group in self._groups(M):
            self._add_group(A, M, group)
        return A

    def _kept_mass(self, loads: Loads) -> Grid:
        """Cᵀ M C."""
        M = mass_matrix(self.frames, loads, len(self.C))
        half = [self.onto_kept(row) for row in M]
        columns = [self.onto_kept(column) for column in zip(*half, strict=True)]
        width = self.C.shape[1]
        return [[columns[min(i, k)][max(i, k)] for k in range(width)] for i in range(width)]

    def _groups(self, M: Grid) -> list[tuple[list[int], list[int]]]:
        """Rows and unknowns that hang together by rows or by inertia: the legs."""
        left, found = list(range(len(self.selection.blocks))), []
        blocks = self.selection.blocks
        while left:
            group, rest = [left[0]], left[1:]
            grew = True
            while grew:
                grew = False
                for n in list(rest):
                    if any(self._hang_together(blocks[n], blocks[m], M) for m in group):
                        group.append(n)
                        rest.remove(n)
                        grew = True
            left = rest
            rows = sorted(i for n in group for i in blocks[n].rows)
            found.append((rows, sorted(k for n in group for k in blocks[n].unknowns)))
        return found

    def _hang_together(self, a: Block, b: Block, M: Grid) -> bool:
        """Whether two blocks share an unknown in a row, or inertia."""
        pairs = [(i, k) for one, two in ((a, b), (b, a)) for i in one.rows for k in two.unknowns]
        if any(pair in self._J for pair in pairs):
            return True
        return any(not _zero(M[i][k]) for i in a.unknowns for k in b.unknowns)

    def _add_group(self, A: Grid, M: Grid, group: tuple[list[int], list[int]]) -> None:
        """Add what one leg's unknown rates make of its inertia."""
        rows, unknowns = group
        K = self._inverse(rows)
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
        self._add_shared(A, M, K, group)

    def _add_shared(
        self, A: Grid, M: Grid, K: Mapping[int, Rates], group: tuple[list[int], list[int]]
    ) -> None:
        """Subtract what inertia that given and unknown rates share makes."""
        (rows, unknowns), given = group, self.selection.given
        if all(_zero(M[k][y]) for k in unknowns for y in given):
            return
        KM = {
            (r, j): al.total([al.mul(K[r].get(k, 0.0), M[k][y]) for k in unknowns])
            for r in rows
            for j, y in enumerate(given)
        }
        P = self._unit_rows
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
            return {r: self._unit_rows[r] for r in rows}, identity
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
        if tie.word != "point" or tie.common is not self.tree.root:
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

    def _inverse(self, rows: Sequence[int]) -> dict[int, Rates]:
        """Columns of J⁻¹ of one group, by row."""
        whole, found = frozenset(rows), {}
        for r in rows:
            right = [1.0 if i == r else 0.0 for i in range(len(self.selection.rows))]
            found[r] = self.solve(right, whole)
        return found

    @cached_property
    def _unit_rows(self) -> Grid:
        """P, (rows, given)."""
        columns = [self._each(self._motions({k: 1.0}), False) for k in self.selection.given]
        return [list(row) for row in zip(*columns, strict=True)]

    def regularity(self, results: Sequence[Scalar]) -> Scalar:
        """The smallest determinant of a block over its typical size: 0 where rates are lost.

        Blocks that results do not need do not count: rates of a passive joint that carries no
        inertia may well be lost.
        """
        found: Scalar = 1.0
        column = [SX(x) for x in results if not al.is_number(x)]
        before = _instructions(column)
        for factors, typical in zip(self._factors, self.selection.typical, strict=True):
            determinant = factors.determinant
            if al.is_number(determinant) or _instructions([*column, determinant]) > before + 1:
                continue
            size = casadi.fabs(determinant) * (1.0 / typical)
            found = size if al.is_number(found) else casadi.fmin(found, size)
        return found


def _instructions(column: Sequence[SX]) -> int:
    """Instructions of some expressions; what they share counts once."""
    whole = casadi.vertcat(*column, SX(0, 1))
    return int(casadi.Function("count", casadi.symvar(whole), [whole]).n_instructions())


def _zero(x: Scalar) -> bool:
    if al.is_number(x):
        return bool(x == 0)
    return bool(x.is_zero())


def _number(x: SX) -> Scalar:
    return float(x) if x.is_constant() else x
