"""Redundant closure equations, named by the joints that repeat them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gough.analysis.ranks import singular_values
from gough.symbolic.closure import Block

Array = NDArray[np.float64]
Rank = Callable[[list[Block]], int]


@dataclass(frozen=True)
class Redundancy:
    """Equations of one closing that others already impose."""

    joint: str
    equations: int
    """How many of its equations are repeated."""
    of: int
    """How many equations it has."""
    implied_by: tuple[str, ...]
    """Closings whose equations imply them; if none, the joints of its own loop."""

    def __str__(self) -> str:
        of = "its equation" if self.of == 1 else f"{self.equations} of its {self.of} equations"
        return f"{self.joint} repeats {of}, already imposed by {', '.join(self.implied_by)}"


def redundancies(E: Array, blocks: tuple[Block, ...], threshold: float) -> list[Redundancy]:
    """The closings whose equations depend on those before them, in order.

    Args:
        E: scaled closure Jacobian, (rows, variables).
        blocks: its rows by closing.
        threshold: singular values up to here are zero.
    """

    def rank(chosen: list[Block]) -> int:
        rows = [E[block.rows] for block in chosen]
        return int(np.sum(singular_values(np.vstack(rows).T) > threshold)) if rows else 0

    found = []
    for k, block in enumerate(blocks):
        earlier = _related(E, list(blocks[:k]), block)
        added = rank([*earlier, block]) - rank(earlier)
        count = block.rows.stop - block.rows.start
        if added < count:
            implying = _smallest(earlier, block, added, rank)
            names = tuple(other.name for other in implying)
            own = tuple(joint for joint in block.joints if joint != block.name)
            found.append(Redundancy(block.name, count - added, count, names or own))
    return found


def _related(E: Array, earlier: list[Block], block: Block) -> list[Block]:
    """Earlier closings that share variables with a block, directly or through each other."""
    columns = np.any(E[block.rows] != 0, axis=0)
    related: set[int] = set()
    while True:
        new = {
            k
            for k, other in enumerate(earlier)
            if k not in related and np.any(np.any(E[other.rows] != 0, axis=0) & columns)
        }
        if not new:
            return [other for k, other in enumerate(earlier) if k in related]
        related |= new
        for k in new:
            columns = columns | np.any(E[earlier[k].rows] != 0, axis=0)


def _smallest(earlier: list[Block], block: Block, added: int, rank: Rank) -> list[Block]:
    """The first few of the earlier closings that imply what a block repeats."""
    kept = list(earlier)
    for other in reversed(earlier):
        rest = [b for b in kept if b is not other]
        if rank([*rest, block]) - rank(rest) == added:
            kept = rest
    return kept
