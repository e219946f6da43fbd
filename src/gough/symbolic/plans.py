"""Which closure equations give which rates: read from the closure Jacobian at closed samples.

With some rates y given, the others follow from E v = 0. A plan says which rates are constant
multiples of others, which equations are enough, and in which small blocks to solve them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

EPSILON = 1e-9
"""Singular values below this times the largest of E count as zero, as in `analysis.ranks`."""
CONSTANT = 1e-8
"""Relations and entries that stay below this at every sample are zero; a guess."""
STRONG = 0.2
"""An equation nearly as independent as the best (by this factor) is preferred if it is shorter."""
STRONGEST = 0.5
"""Of rates that are independent to this share of the best the first is taken; a guess."""
TAKEN = 1e-3
"""How independent (sine of an angle to those before) a rate should be to be preferred; a guess."""
SPARE = 3
"""Motions there must be beyond the kept rates, or the samples are too few to trust relations."""


class Kind(Enum):
    """How the unknowns of a block follow from its equations."""

    unique = "as many independent equations as unknowns"
    smallest = "fewer equations than unknowns: the smallest rates that solve them"
    nearest = "more independent equations than unknowns: least squares"


@dataclass(frozen=True)
class Block:
    """Equations that are solved together."""

    kind: Kind
    rows: tuple[int, ...]
    """Closure rows."""
    unknowns: tuple[int, ...]
    """Indices of kept rates."""
    first: tuple[int, ...] = ()
    """Of a smallest solution: unknowns to eliminate, so that only the others are made small."""


@dataclass(frozen=True)
class Plan:
    """How all rates v follow from given rates y: v = C w, with y among the kept rates w."""

    inputs: tuple[int, ...]
    """Variables whose rates are given."""
    kept: tuple[int, ...]
    """Variables of w."""
    C: Array
    """(variables, kept), SI units; whole numbers are exact."""
    blocks: tuple[Block, ...]
    """In the order of solving: each needs inputs and unknowns of earlier blocks only."""
    pattern: Mask
    """Which entries of E C are not zero at every closed configuration, (rows, kept)."""
    restrictions: int
    """How many independent conditions the given rates must obey."""
    freedoms: int
    """Dimension of the rates that are possible with the given ones at rest."""

    def columns(self, block: Block) -> tuple[int, ...]:
        """Kept rates in the rows of a block: its unknowns, then the others."""
        held = np.flatnonzero(self.pattern[list(block.rows)].any(axis=0)).tolist()
        return (*block.unknowns, *(k for k in held if k not in block.unknowns))


@dataclass(frozen=True)
class Unsolvable:
    """Equations that have both too many and too few unknowns."""

    rows: tuple[int, ...]
    unknowns: tuple[int, ...]


def make_plan(
    E: Array,
    inputs: Sequence[int],
    last: Sequence[int],
    unit: Array,
    E_open: Array | None = None,
) -> Plan | Unsolvable:
    """The plan for given rates.

    Args:
        E: closure Jacobians at closed samples, (samples, rows, variables), rows and rates scaled.
        inputs: variables whose rates are given.
        last: variables that are made small where several rates are possible; of the others none
            is then free.
        unit: what each scaled rate is a multiple of, (variables,).
        E_open: the same at open configurations, where the samples are too few to tell what never
            changes; relations between rates then are not used.
    """
    threshold = _threshold(E)
    others = [k for k in range(E.shape[2]) if k not in set(inputs)]
    full, solved = _rank(E, threshold), _rank(E[:, :, others], threshold)
    exact = solved == full == _rank(E, threshold) and solved == len(others)
    related = E_open is None and exact
    kept, C = _relations(E, [*inputs, *others], threshold) if related else _none(E)
    reduced = E @ C
    shown = reduced if E_open is None else np.concatenate([reduced, E_open])
    pattern = np.abs(shown).max(axis=0, initial=0.0) > CONSTANT
    position = {variable: k for k, variable in enumerate(kept)}
    unknown = [position[k] for k in others if k in position]
    small = {position[k] for k in last if k in position}
    blocks: list[Block] = []
    for rows, columns in components(pattern, unknown):
        found = _block(reduced, rows, columns, small, threshold)
        if isinstance(found, Unsolvable):
            return Unsolvable(found.rows, tuple(kept[k] for k in found.unknowns))
        blocks += triangular(found, pattern)
    return Plan(
        tuple(inputs),
        tuple(kept),
        _in_units(C, unit, unit[kept]),
        tuple(blocks),
        pattern,
        full - solved,
        len(others) - solved,
    )


def independent(E: Array, variables: Sequence[int], limit: int) -> list[int]:
    """The first of some variables whose rates no constant relation binds, at most ``limit``."""
    threshold = _threshold(E)
    motions = _motions(E, threshold)
    found: list[int] = []
    for k in variables:
        rows = motions[[*found, k]]
        if len(found) < limit and _smallest(rows) > CONSTANT:
            found.append(k)
    return found


def generic_rank(E: Array, columns: Sequence[int]) -> int:
    """The largest rank of some columns over the samples, by the threshold of the whole E."""
    return _rank(E[:, :, list(columns)], _threshold(E))


def best_independent(E: Array, preferred: Sequence[int], others: Sequence[int]) -> list[int]:
    """Variables whose rates tell all others.

    Preferred ones are taken in their order if they are independent of those before at some sample;
    of the others always the one that stays most independent at every sample.

    Args:
        E: closure Jacobians at closed samples, (samples, rows, variables), rows and rates scaled.
        preferred: variables that are wanted.
        others: variables that make up for what is missing.
    """
    motions = _bases(E, _threshold(E))
    count, found = motions[0].shape[1], list[int]()
    for k in preferred:
        if len(found) < count and max(_smallest(T[[*found, k]]) for T in motions) > TAKEN:
            found.append(k)
    left = [k for k in others if k not in found]
    while len(found) < count and left:
        strength = [min(_smallest(T[[*found, k]]) for T in motions) for k in left]
        best = next(k for k, s in enumerate(strength) if s > STRONGEST * max(strength))
        found.append(left.pop(best))
    return found


def relations(
    E: Array, order: Sequence[int], unit: Array, telling: bool
) -> tuple[tuple[int, ...], Array]:
    """Rates w that no constant relation binds, and C with v = C w, in SI units.

    Args:
        E: closure Jacobians at closed samples, (samples, rows, variables), rows and rates scaled.
        order: all variables; those that come first are kept.
        unit: what each scaled rate is a multiple of, (variables,).
        telling: whether the samples are enough to tell what never changes.
    """
    kept, C = _relations(E, order, _threshold(E)) if telling else _none(E)
    return tuple(kept), _in_units(C, unit, unit[kept])


def _threshold(E: Array) -> float:
    return EPSILON * max((float(np.linalg.norm(e, 2)) for e in E if e.size), default=0.0)


def _smallest(rows: Array) -> float:
    if rows.shape[0] > rows.shape[1]:
        return 0.0
    return float(np.linalg.svd(rows, compute_uv=False).min(initial=np.inf))


def _rank(E: Array, threshold: float) -> int:
    """The generic rank: the largest over the samples."""
    if not E.size:
        return 0
    return int(np.max(np.sum(np.linalg.svd(E, compute_uv=False) > threshold, axis=-1)))


def _motions(E: Array, threshold: float) -> Array:
    """Motions that are possible at the regular samples, side by side: (variables, ·)."""
    return np.hstack(_bases(E, threshold))


def _bases(E: Array, threshold: float) -> list[Array]:
    """An orthonormal basis of the motions that are possible at each regular sample."""
    if not E.shape[1]:
        return [np.eye(E.shape[2])]
    rank = _rank(E, threshold)
    bases = []
    for e in E:
        _, s, Vt = np.linalg.svd(e)
        if np.sum(s > threshold) == rank:
            bases.append(Vt[rank:].T)
    return bases


# relations


def _none(E: Array) -> tuple[list[int], Array]:
    return list(range(E.shape[2])), np.eye(E.shape[2])


def _relations(E: Array, order: Sequence[int], threshold: float) -> tuple[list[int], Array]:
    """Rates w that no constant relation binds, and C with v = C w in every motion.

    Variables that come first in the order are kept. Where there are hardly more motions than
    rates kept, any rates would seem to be related, and no relation is used.
    """
    motions = _motions(E, threshold)
    kept: list[int] = []
    factors: dict[int, Array] = {}
    for k in order:
        found = np.linalg.lstsq(motions[kept].T, motions[k], rcond=None)[0]
        if np.abs(motions[k] - found @ motions[kept]).max(initial=0.0) < CONSTANT:
            factors[k] = found
        else:
            kept.append(k)
    if len(kept) + SPARE > motions.shape[1]:
        return _none(E)
    ordered = sorted(kept)
    C = np.zeros((E.shape[2], len(kept)))
    for k in range(E.shape[2]):
        for j, factor in zip(kept, factors.get(k, ()), strict=False):
            C[k, ordered.index(j)] = factor
        if k not in factors:
            C[k, ordered.index(k)] = 1.0
    return ordered, C


def _in_units(C: Array, output: Array, kept: Array) -> Array:
    """C for rates in SI units, with whole and half numbers exact."""
    C = output[:, None] * C / kept
    near = np.round(2 * C) / 2
    return np.where(np.abs(C - near) < CONSTANT, near, C)


# blocks


def components(pattern: Mask, unknown: Sequence[int]) -> list[tuple[list[int], list[int]]]:
    """Rows and unknowns that hang together; unknowns in no row stand alone."""
    left, components = set(unknown), []
    for start in unknown:
        if start not in left:
            continue
        columns, rows = {start}, set[int]()
        while True:
            more_rows = set(np.flatnonzero(pattern[:, sorted(columns)].any(axis=1)).tolist())
            more = {k for k in unknown if pattern[sorted(more_rows), k].any()}
            if more_rows == rows and more <= columns:
                break
            rows, columns = more_rows, columns | more
        left -= columns
        components.append((sorted(rows), sorted(columns)))
    return components


def _block(
    E: Array, rows: list[int], columns: list[int], small: set[int], threshold: float
) -> Block | Unsolvable:
    """The block of one component."""
    part = E[:, rows]
    solved, full = _rank(part[:, :, columns], threshold), _rank(part, threshold)
    if solved == len(columns):
        if full > solved:
            return Block(Kind.nearest, tuple(rows), tuple(columns))
        chosen = _chosen(part[:, :, columns], solved, threshold)
        return Block(Kind.unique, tuple(rows[i] for i in chosen), tuple(columns))
    first = [k for k in columns if k not in small]
    free = len(first) - _rank(part[:, :, first], threshold)
    if full > solved or (0 < free < len(columns) - solved):
        return Unsolvable(tuple(rows), tuple(columns))
    chosen = _chosen(part[:, :, columns], solved, threshold)
    picked = tuple(rows[i] for i in chosen)
    return Block(Kind.smallest, picked, tuple(columns), () if free else tuple(first))


def _chosen(E: Array, count: int, threshold: float) -> list[int]:
    """Rows that are independent at every sample, short ones preferred.

    Gram-Schmidt at all samples at once. What counts is the sample where a row adds least; where
    the samples are few and singular ones among them, only those of full rank are used.
    """
    ranks = np.array([_rank(e[None], threshold) for e in E])
    left = E[ranks == count].copy()
    length = (np.abs(E).max(axis=0) > CONSTANT).sum(axis=1)
    chosen: list[int] = []
    while len(chosen) < count:
        added = np.linalg.norm(left, axis=2).min(axis=0)
        added[chosen] = 0.0
        strong = np.flatnonzero(added >= STRONG * added.max())
        best = min(strong, key=lambda i: (length[i], -round(float(added[i]), 6)))
        chosen.append(int(best))
        direction = left[:, best] / np.linalg.norm(left[:, best], axis=1, keepdims=True)
        for _ in range(2):  # twice: once is not orthogonal to rounding
            along = np.einsum("sik,sk->si", left, direction)
            left = left - along[:, :, None] * direction[:, None, :]
    return sorted(chosen)


def triangular(block: Block, pattern: Mask) -> list[Block]:
    """A block of unique unknowns as smaller ones, one after the other.

    The classes of unknowns that need each other, after a matching of unknowns with rows.
    """
    if block.kind is not Kind.unique or not block.unknowns:
        return [block]
    P = pattern[np.ix_(block.rows, block.unknowns)]
    match = _matching(P)
    if match is None:
        return [block]
    needs = P[match]  # row of each unknown: which unknowns it needs
    reach = needs | np.eye(len(needs), dtype=bool)
    for k in range(len(reach)):
        reach |= np.outer(reach[:, k], reach[k])
    blocks, seen = [], np.zeros(len(reach), dtype=bool)
    for k in np.argsort(reach.sum(axis=1), kind="stable"):
        if not seen[k]:
            own = np.flatnonzero(reach[k] & reach[:, k])
            seen[own] = True
            rows = tuple(sorted(block.rows[match[j]] for j in own))
            blocks.append(Block(Kind.unique, rows, tuple(block.unknowns[j] for j in own)))
    return blocks


def _matching(P: Mask) -> list[int] | None:
    """A row for each column, all different, with entries of the pattern; None if there is none."""
    row_of: dict[int, int] = {}

    def assign(column: int, tried: set[int]) -> bool:
        for row in np.flatnonzero(P[:, column]).tolist():
            if row in tried:
                continue
            tried.add(row)
            owner = next((c for c, r in row_of.items() if r == row), None)
            if owner is None or assign(owner, tried):
                row_of[column] = row
                return True
        return False

    if not all(assign(column, set()) for column in range(P.shape[1])):
        return None
    return [row_of[column] for column in range(P.shape[1])]
