"""Kernels for all rates of a mechanism from some of them."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gough.errors import ConfigurationError
from gough.geometry.samples import Sampled
from gough.kernels import Kernel
from gough.models import Models
from gough.symbolic.plans import Unsolvable, make_plan
from gough.symbolic.rates import Rates, symbols

Array = NDArray[np.float64]


class RateMap:
    """Kernels for all rates v from some given ones y: v = G y, v̇ = G ẏ + σ(q, v).

    Where y leaves several rates possible, the smallest are returned: motors (outputs, if y are
    motors' rates) first, then passive joints, in multiples of the characteristic length. So a leg
    that can spin does not, and the smallest v̇ is returned, not the rate of the smallest v. Where
    y must obey conditions (motors of a redundant robot), least squares are returned: exact for
    rates that do, and none for others.

    Args:
        models: the mechanism.
        sampled: closed configurations; the map holds for the assembly they belong to.
        inputs: variables that are given.
        last: variables made small first, where several rates are possible.

    Attributes:
        plan: which equations are solved for which rates.

    Raises:
        ConfigurationError: equations have both too many and too few unknowns.
    """

    def __init__(
        self, models: Models, sampled: Sampled, inputs: Sequence[int], last: Sequence[int]
    ) -> None:
        self.models = models
        unit = sampled.samples.rate_scale
        plan = make_plan(sampled.E, inputs, last, unit, sampled.E_open)
        variables = models.structure.variables
        if isinstance(plan, Unsolvable):
            names = ", ".join(variables[k].name for k in plan.unknowns)
            raise ConfigurationError(
                f"the rates of {names} are both restricted and not determined by those of "
                f"{', '.join(variables[k].name for k in inputs)}; lock or drive a joint that "
                "moves alone"
            )
        self.plan = plan
        self._symbolic = Rates(models.closure, sampled.samples, plan)
        self._rows: dict[tuple[int, ...], Kernel] = {}

    @property
    def restricted(self) -> bool:
        """Whether the given rates must obey conditions."""
        return self.plan.restrictions > 0

    @property
    def unique(self) -> bool:
        """Whether all rates follow from the given ones."""
        return self.plan.freedoms == 0

    @cached_property
    def rates(self) -> Kernel:
        """v of (q, p, y): (*batch, variables)."""
        y = symbols("y", len(self.plan.inputs))
        v = self._symbolic.velocity(y)
        return Kernel("rates", self._inputs | {"y": y}, v, (len(self.plan.C),))

    @cached_property
    def accelerations(self) -> Kernel:
        """v̇ of (q, p, v, ẏ), for rates v that obey the closure: (*batch, variables)."""
        v, yd = symbols("v", len(self.plan.C)), symbols("yd", len(self.plan.inputs))
        vd = self._symbolic.acceleration(v, yd)
        return Kernel("accelerations", self._inputs | {"v": v, "yd": yd}, vd, (len(self.plan.C),))

    @property
    def matrix(self) -> Kernel:
        """G of (q, p): (*batch, variables, inputs)."""
        return self.rows(range(len(self.plan.C)))

    def rows(self, variables: Sequence[int]) -> Kernel:
        """The rows of G of some variables, of (q, p): (*batch, variables, inputs)."""
        key = tuple(variables)
        if key not in self._rows:
            shape = (len(key), len(self.plan.inputs))
            self._rows[key] = Kernel("rows", self._inputs, self._symbolic.matrix(key), shape)
        return self._rows[key]

    @cached_property
    def block_entries(self) -> Kernel:
        """Entries of the scaled rows of all blocks, one after the other, of (q, p)."""
        entries = self._symbolic.block_entries()
        return Kernel("blocks", self._inputs, entries, (entries.numel(),))

    def block_rows(self, q: Array, p: Array) -> list[Array]:
        """The scaled rows of each block, in the columns of ``plan.columns``: (*batch, ·, ·)."""
        entries, found, start = self.block_entries(q, p), [], 0
        for block in self.plan.blocks:
            shape = len(block.rows), len(self.plan.columns(block))
            part = entries[..., start : start + shape[0] * shape[1]]
            found.append(part.reshape(*part.shape[:-1], *shape))
            start += shape[0] * shape[1]
        return found

    def block_matrices(self, q: Array, p: Array) -> list[Array]:
        """The scaled matrix of each block: (*batch, rows, unknowns) each."""
        pairs = zip(self.block_rows(q, p), self.plan.blocks, strict=True)
        return [rows[..., : len(block.unknowns)] for rows, block in pairs]

    def block_regularity(self, q: Array, p: Array) -> Array:
        """For each block, how far it is from singular: (*batch, blocks), 0 to 1.

        The smallest singular value of its matrix over the Frobenius norm of its rows of E.
        """
        found = []
        for rows, block in zip(self.block_rows(q, p), self.plan.blocks, strict=True):
            if not rows.size:
                found.append(np.ones(rows.shape[:-2]))
                continue
            smallest = np.linalg.svd(rows[..., : len(block.unknowns)], compute_uv=False)[..., -1]
            size = np.linalg.norm(rows, axis=(-2, -1))
            ratio = np.zeros_like(size)
            found.append(np.divide(smallest, size, out=ratio, where=size > 0))
        return np.stack(found, axis=-1) if found else np.ones((*q.shape[:-1], 1))

    def regularity(self, q: Array, p: Array) -> Array:
        """The smallest `block_regularity`: (*batch), 0 where a block is singular."""
        return np.asarray(self.block_regularity(q, p).min(axis=-1))

    def worst_block(self, q: Array, p: Array) -> str:
        """Names of the rates that the worst block of one configuration gives."""
        block = self.plan.blocks[int(np.argmin(self.block_regularity(q, p)))]
        variables = self.models.structure.variables
        return ", ".join(variables[self.plan.kept[k]].name for k in block.unknowns)

    @property
    def _inputs(self) -> dict[str, Any]:
        return {"q": self.models.closure.q, "p": self.models.closure.p}
