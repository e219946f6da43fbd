"""All rates from the given ones by chosen rows, block by block: u = -J⁻¹ P y, and transposed."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from functools import cached_property

import casadi
import numpy as np
from numpy.typing import NDArray

from gough import algebra as al
from gough.algebra import Scalar
from gough.symbolic.trees.factors import Factors, Grid
from gough.symbolic.trees.frames import Frames, Rates
from gough.symbolic.trees.motion import Motion
from gough.symbolic.trees.selection import Chosen, Selection
from gough.symbolic.trees.ties import Rows

Array = NDArray[np.float64]
SX = casadi.SX

WEIGHTS = {
    **dict.fromkeys((casadi.OP_SIN, casadi.OP_COS), 20.0),
    **{casadi.OP_DIV: 6.0, casadi.OP_INV: 6.0, casadi.OP_SQRT: 8.0},
}
"""What functions, quotients and roots count in operations, where choices of rows are compared."""


class Solver:
    """Rates of one placing of a tree by one choice of rows.

    Args:
        frames: the tree where it stands.
        C: all rates v = C w, (variables, kept).
        selection: rows and blocks.
        y: symbols of the given rates, which rows of velocity are written in.
    """

    def __init__(self, frames: Frames, C: Array, selection: Selection, y: Sequence[Scalar]) -> None:
        self.frames, self.C, self.selection, self.y = frames, C, selection, y
        self._rows = Rows(frames)
        self._unit_rows: dict[tuple[int, int], Grid] = {}
        self._given: Rates = dict(zip(selection.given, y, strict=True))

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
    def J(self) -> dict[tuple[int, int], Scalar]:
        """Entries of the chosen rows for unit rates of the unknowns."""
        found = {}
        for k in self.selection.unknown:
            for i, x in enumerate(self._each(self._motions({k: 1.0}), False)):
                if self.selection.pattern[i, k] and not is_zero(x):
                    found[i, k] = x
        return found

    @cached_property
    def factors(self) -> list[Factors]:
        """Of each block."""
        return [
            Factors([[self.J.get((i, k), 0.0) for k in block.unknowns] for i in block.rows])
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
        for block, factors in zip(self.selection.blocks, self.factors, strict=True):
            if rows is not None and not rows.issuperset(block.rows):
                continue
            b = [
                al.sub(
                    right[i],
                    al.total([al.mul(self.J[i, k], found[k]) for k in found if (i, k) in self.J]),
                )
                for i in block.rows
            ]
            x = [0.0] * len(b) if all(map(is_zero, b)) else factors.solve(b)
            found |= dict(zip(block.unknowns, x, strict=True))
        return found

    def solve_transposed(self, h: Rates) -> list[Scalar]:
        """f with Jᵀ f = h, by row."""
        found: dict[int, Scalar] = {}
        pairs = list(zip(self.selection.blocks, self.factors, strict=True))
        for block, factors in reversed(pairs):
            b = []
            for k in block.unknowns:
                rest = [al.mul(self.J[i, k], f) for i, f in found.items() if (i, k) in self.J]
                b.append(al.sub(h.get(k, 0.0), al.total(rest)))
            x = [0.0] * len(b) if all(map(is_zero, b)) else factors.solve_transposed(b)
            found |= dict(zip(block.rows, x, strict=True))
        return [found[i] for i in range(len(self.selection.rows))]

    def reflected(self, f: Sequence[Scalar]) -> list[Scalar]:
        """Pᵀ f, by given rate: by a reverse sweep through the rows, or by rows made one by one."""
        single = {i for i, row in enumerate(self.selection.rows) if row.tie.word == "length"}
        found = self._swept([0.0 if i in single else x for i, x in enumerate(f)])
        for i in single:
            if not is_zero(f[i]):
                along = [al.mul(f[i], p) for p in self.unit_row(i)]
                found = [al.add(x, y) for x, y in zip(found, along, strict=True)]
        return found

    def _swept(self, f: Sequence[Scalar]) -> list[Scalar]:
        pairs = [
            (p, x) for p, x in zip(self._P, f, strict=True) if not is_zero(x) and not is_zero(p)
        ]
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

    def inverse(self, rows: Sequence[int]) -> dict[int, Rates]:
        """Columns of J⁻¹ of one group, by row."""
        whole, found = frozenset(rows), {}
        for r in rows:
            right = [1.0 if i == r else 0.0 for i in range(len(self.selection.rows))]
            found[r] = self.solve(right, whole)
        return found

    def operations(self, rows: Collection[int]) -> float:
        """About how many operations it takes to solve for what stands in some rows, both ways.

        Rates, accelerations, and forces along them as the given rates feel them.
        """
        blocks = [block for block in self.selection.blocks if set(rows) & set(block.rows)]
        unknowns = [k for block in blocks for k in block.unknowns]
        changes = self.accelerations([0.0] * len(self.y))
        h = {k: SX.sym(f"h{k}") for k in unknowns}
        forces = self.reflected(self.solve_transposed(h))
        column = casadi.vertcat(*[SX(x) for x in (*(changes[k] for k in unknowns), *forces)])
        function = casadi.Function("count", casadi.symvar(column), [casadi.cse(column)])
        codes = map(function.instruction_id, range(function.n_instructions()))
        return sum(WEIGHTS.get(code, 1.0) for code in codes)

    def unit_row(self, i: int) -> list[Scalar]:
        """A row of P, (given,)."""
        row = self.selection.rows[i]
        key = id(row.tie), row.axes.index
        if key not in self._unit_rows:
            columns = []
            for k in self.selection.given:
                motion = Motion(self.frames, self.C, {k: 1.0}, still=row.tie.still)
                columns.append(self._rows.velocity(row.tie, motion, row.axes))
            self._unit_rows[key] = [list(x) for x in zip(*columns, strict=True)]
        return self._unit_rows[key][row.component]


def is_zero(x: Scalar) -> bool:
    """Whether a scalar is zero for certain."""
    if al.is_number(x):
        return bool(x == 0)
    return bool(x.is_zero())


def _number(x: SX) -> Scalar:
    return float(x) if x.is_constant() else x
