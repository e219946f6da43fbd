"""All rates and accelerations of a mechanism from some of them, as scalar expressions."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import casadi
import numpy as np
from numpy.typing import NDArray

from gough import algebra as al
from gough.algebra import Scalar
from gough.symbolic.block_solves import Row, solve_nearest, solve_smallest, solve_unique
from gough.symbolic.closing_rates import ClosingRates, Samples
from gough.symbolic.closure import Closure
from gough.symbolic.plans import Block, Kind, Plan
from gough.symbolic.screws import combined

Array = NDArray[np.float64]
SX = casadi.SX


def symbols(name: str, count: int) -> SX:
    """A column of symbols."""
    return SX.sym(name, count)


class Rates:
    """Rates of all variables v from given ones y: v = G y, and v̇ = G ẏ + σ(q, v).

    Both hold at closed configurations of the assembly that the samples were taken from. The
    equations are E v = 0 and E v̇ = -Ė v, solved in the blocks of the plan.

    Args:
        closure: the closure equations.
        samples: closed configurations.
        plan: what to solve with what.
    """

    def __init__(self, closure: Closure, samples: Samples, plan: Plan) -> None:
        self.closure, self.samples, self.plan = closure, samples, plan
        self._rates = ClosingRates(closure, samples, plan.C)
        index = {variable: k for k, variable in enumerate(plan.kept)}
        self._given = [index[variable] for variable in plan.inputs]

    @cached_property
    def _entries(self) -> list[Row]:
        """E C without the entries that are zero at every closed configuration."""
        pattern = self.plan.pattern
        return [
            {k: x for k, x in row.items() if pattern[i, k]}
            for i, row in enumerate(self._rates.entries)
        ]

    def velocity(self, y: SX) -> SX:
        """v from the given rates y, a column."""
        return self._all(self._solved([[y[k]] for k in range(y.numel())], None))

    def matrix(self, variables: Sequence[int]) -> SX:
        """The rows of G of some variables, (variables, inputs)."""
        unit = [[float(i == k) for k in range(len(self._given))] for i in range(len(self._given))]
        kept = self._solved(unit, None, self._sources(variables))
        rows = [self._combination(kept, variable) for variable in variables]
        found = SX(len(rows), len(self._given))
        for i, row in enumerate(rows):
            for k, value in enumerate(row):
                if not (al.is_number(value) and value == 0):
                    found[i, k] = value
        return found

    def acceleration(self, v: SX, yd: SX) -> SX:
        """v̇ from all rates v, which must obey the closure, and the given accelerations ẏ."""
        w = [v[variable] for variable in self.plan.kept]
        given = [[yd[k]] for k in range(yd.numel())]
        return self._all(self._solved(given, self._rates.bias(w)))

    def block_entries(self) -> SX:
        """Entries of the rows of all blocks, with comparable rows and rates, a column.

        Block after block, each row after row, in the columns of ``plan.columns``.
        """
        found: list[Scalar] = []
        for block in self.plan.blocks:
            for r in block.rows:
                for k in self.plan.columns(block):
                    scale = float(self.samples.row_scale[r]) * self._unit(k)
                    found.append(al.mul(scale, self._entries[r].get(k, 0.0)))
        return SX(casadi.vertcat(*found)) if found else SX(0, 1)

    def _unit(self, kept: int) -> float:
        return float(self.samples.rate_scale[self.plan.kept[kept]])

    def _sources(self, variables: Sequence[int]) -> frozenset[int]:
        """Kept rates that some variables are made of."""
        return frozenset(np.flatnonzero(self.plan.C[list(variables)].any(axis=0)).tolist())

    def _solved(
        self,
        given: list[list[Scalar]],
        bias: list[Scalar] | None,
        late: frozenset[int] = frozenset(),
    ) -> dict[int, list[Scalar]]:
        """Every kept rate, for several columns of given ones at once."""
        found = dict(zip(self._given, given, strict=True))
        width = len(given[0]) if given else 1
        for block in self.plan.blocks:
            own = set(block.unknowns)
            rows, right = [], []
            for r in block.rows:
                entries = self._entries[r]
                rest = [0.0 if bias is None else al.mul(-1.0, bias[r])] * width
                for k, x in entries.items():
                    if k not in own:
                        pairs = zip(rest, found[k], strict=True)
                        rest = [al.sub(a, al.mul(x, b)) for a, b in pairs]
                rows.append({k: x for k, x in entries.items() if k in own})
                right.append(rest)
            found |= self._block(block, rows, right, width, late)
        return found

    def _block(
        self,
        block: Block,
        rows: list[Row],
        right: list[list[Scalar]],
        width: int,
        late: frozenset[int],
    ) -> dict[int, list[Scalar]]:
        if not rows:  # rates that appear in no equation are kept at rest
            return {k: [0.0] * width for k in block.unknowns}
        match block.kind:
            case Kind.unique:
                return solve_unique(rows, right, block.unknowns, late)
            case Kind.smallest:
                unit = {k: self._unit(k) for k in block.unknowns}
                return solve_smallest(rows, right, block.unknowns, block.first, unit)
            case Kind.nearest:
                weights = [float(self.samples.row_scale[r]) for r in block.rows]
                return solve_nearest(rows, right, block.unknowns, weights)

    def _combination(self, kept: dict[int, list[Scalar]], variable: int) -> list[Scalar]:
        form = self.plan.C[variable]
        width = len(self._given)
        order = range(len(self.plan.kept))
        return [
            combined(form, [kept[k][c] if form[k] else 0.0 for k in order]) for c in range(width)
        ]

    def _all(self, kept: dict[int, list[Scalar]]) -> SX:
        w = [kept[k][0] for k in range(len(self.plan.kept))]
        return SX(casadi.vertcat(*[combined(form, w) for form in self.plan.C]))
