"""Which rows give which rates: the axes each closing is written in, independent rows, their blocks.

Good axes make small blocks: in axes of the leg itself the tip of a leg has one rate in each row.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import casadi
import numpy as np
from numpy.typing import NDArray

from gough import algebra as al
from gough.algebra import Scalar
from gough.errors import ConfigurationError
from gough.symbolic.closing_rates import evaluated
from gough.symbolic.plans import Block, Kind, components, triangular
from gough.symbolic.trees.frames import Frames
from gough.symbolic.trees.motion import Motion
from gough.symbolic.trees.nodes import Node, Tree
from gough.symbolic.trees.ties import Rows, Tie, distances, length, ties

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

NOTHING = 1e-11
"""Entries that stay below this times the largest of their row at every sample are zero."""
INDEPENDENT = 1e-5
"""Rows less independent than this (sine of an angle) of those before, at some sample, are left."""
NEAR = 1e-9
"""Rows that differ by less, relative to the largest entry, at every sample are the same."""
ROUNDS = 2


@dataclass(frozen=True)
class Written:
    """A tie in the axes of one class, evaluated."""

    tie: Tie
    axes: Node
    numbers: Array
    """(samples, rows, kept)."""
    pattern: Mask
    """(rows, kept)."""
    operations: tuple[int, ...]
    """About how many operations each row takes."""


@dataclass(frozen=True)
class Chosen:
    """One row."""

    tie: Tie
    axes: Node
    component: int


@dataclass(frozen=True)
class Selection:
    """Rows and blocks that give all kept rates from the given ones."""

    given: tuple[int, ...]
    """Places among the kept rates of those given."""
    unknown: tuple[int, ...]
    """Places of the others."""
    rows: tuple[Chosen, ...]
    """As many as there are unknowns."""
    pattern: Mask
    """Entries that are not zero, (rows, kept)."""
    blocks: tuple[Block, ...]
    """Rows by their place above, in the order of solving."""
    typical: tuple[float, ...]
    """A typical size of the determinant of each block."""
    lengths: Mapping[int, Chosen] = field(default_factory=dict)
    """Rows that the rate of a length may stand for: it says the same of the same rates."""

    def used(self, needed: Iterable[int]) -> set[int]:
        """The rows that some kept rates take."""
        rows, left = set[int](), set(needed)
        for block in reversed(self.blocks):
            if left & set(block.unknowns):
                rows |= set(block.rows)
                left |= set(np.flatnonzero(self.pattern[list(block.rows)].any(axis=0)).tolist())
        return rows

    def beside(self, row: int) -> set[int]:
        """The other rows of its closing."""
        closing = self.rows[row].tie.closing
        return {i for i, other in enumerate(self.rows) if other.tie.closing == closing} - {row}

    def replaced(self, needed: Iterable[int]) -> set[int]:
        """Rows that a length may stand for where only some kept rates are needed.

        Those of closings of which no other row is used.
        """
        used = self.used(needed)
        return {i for i in self.lengths if not self.beside(i) & used}

    def shortened(self, replaced: Iterable[int]) -> Selection:
        """The same with the rates of lengths in place of some rows."""
        rows = list(self.rows)
        for i in replaced:
            rows[i] = self.lengths[i]
        return replace(self, rows=tuple(rows))


class Selector:
    """Chooses rows of one tree.

    Args:
        tree: the mechanism.
        frames: its placing by joint positions.
        C: all rates v = C w, (variables, kept).
        given: places among the kept rates of those given.
    """

    def __init__(self, tree: Tree, frames: Frames, C: Array, given: Sequence[int]) -> None:
        self.tree, self.frames, self.C = tree, frames, C
        self.given = tuple(given)
        self.unknown = tuple(k for k in range(C.shape[1]) if k not in set(given))
        self.rows = Rows(frames)

    def select(self) -> Selection:
        """The rows that cost least.

        Raises:
            ConfigurationError: the rows do not determine the unknown rates.
        """
        choice = [0] * len(self._options)
        best = self._cost(choice)
        for _ in range(ROUNDS):
            for i, options in enumerate(self._options):
                for k in range(len(options)):
                    other = [*choice[:i], k, *choice[i + 1 :]]
                    cost = self._cost(other) if k != choice[i] else best
                    if cost < best - 1e-9:
                        choice, best = other, cost
        return self._finished(choice)

    @cached_property
    def _options(self) -> list[list[Written]]:
        """Every tie in the axes of every class, the sparsest first."""
        found = []
        for tie in [*distances(self.tree, self.frames), *ties(self.tree)]:
            written = [self._write(tie, axes) for axes in tie.classes]
            written = [w for w in written if w.pattern[:, self.unknown].any()]
            written.sort(key=lambda w: int((w.pattern[:, self.unknown].sum(axis=1) ** 2).sum()))
            if written:
                found.append(written)
        return found

    def _write(self, tie: Tie, axes: Node) -> Written:
        columns = []
        for k in range(self.C.shape[1]):
            motion = Motion(self.frames, self.C, {k: 1.0}, still=tie.still)
            columns.append(self.rows.velocity(tie, motion, axes))
        flat = [x for row in zip(*columns, strict=True) for x in row]
        numbers = evaluated(self.tree.closure, self.tree.samples, flat)
        numbers = numbers.reshape(len(numbers), -1, self.C.shape[1])
        largest = np.abs(numbers).max(initial=0.0)
        pattern = np.abs(numbers).max(axis=0) > NOTHING * max(largest, 1e-300)
        operations = tuple(_operations(row) for row in zip(*columns, strict=True))
        return Written(tie, axes, np.where(pattern, numbers, 0.0), pattern, operations)

    def _picked(self, choice: Sequence[int]) -> list[tuple[Written, int]]:
        """Independent rows of a choice, short ones first."""
        written = [options[k] for options, k in zip(self._options, choice, strict=True)]
        rows = [(w, i) for w in written for i in range(len(w.pattern))]
        unknown = list(self.unknown)
        rows.sort(key=lambda r: (int(r[0].pattern[r[1], unknown].sum()), r[0].operations[r[1]]))
        picked: list[tuple[Written, int]] = []
        basis = np.zeros((len(self.tree.samples.q), 0, len(unknown)))
        for w, i in rows:
            row = w.numbers[:, i, unknown]
            size = np.linalg.norm(row, axis=1, keepdims=True)
            if not w.pattern[i, unknown].any() or len(picked) == len(unknown):
                continue
            left = row / np.where(size > 0, size, 1.0)
            for _ in range(2):  # twice: once is not orthogonal to rounding
                left = left - np.einsum("sk,skj->sj", np.einsum("skj,sj->sk", basis, left), basis)
            length = np.linalg.norm(left, axis=1, keepdims=True)
            if length.min() > INDEPENDENT:
                basis = np.concatenate([basis, (left / length)[:, None]], axis=1)
                picked.append((w, i))
        return picked

    def _cost(self, choice: Sequence[int]) -> float:
        picked = self._picked(choice)
        if len(picked) < len(self.unknown):
            return np.inf
        pattern = np.array([w.pattern[i] for w, i in picked]).reshape(len(picked), self.C.shape[1])
        blocks = self._blocks(pattern)
        return float(
            sum(len(block.rows) ** 3 for block in blocks)
            + 0.1 * pattern[:, self.unknown].sum()
            + 0.002 * sum(w.operations[i] for w, i in picked)
        )

    def _blocks(self, pattern: Mask) -> tuple[Block, ...]:
        found: list[Block] = []
        for rows, columns in components(pattern, list(self.unknown)):
            found += triangular(Block(Kind.unique, tuple(rows), tuple(columns)), pattern)
        return tuple(found)

    def _finished(self, choice: Sequence[int]) -> Selection:
        picked = self._picked(choice)
        if len(picked) < len(self.unknown):
            raise ConfigurationError(
                f"{self.tree.closure.structure.mechanism.name}: {len(picked)} independent rows "
                f"were found for {len(self.unknown)} rates; the mechanism may be singular "
                "everywhere near home"
            )
        width = self.C.shape[1]
        pattern = np.array([w.pattern[i] for w, i in picked], dtype=bool).reshape(-1, width)
        numbers = [w.numbers[:, i] for w, i in picked]
        blocks, typical = self._blocks(pattern), []
        for block in blocks:
            A = np.stack([numbers[r][:, list(block.unknowns)] for r in block.rows], axis=1)
            typical.append(float(np.median(np.abs(np.linalg.det(A)))))
        rows = tuple(Chosen(w.tie, w.axes, i) for w, i in picked)
        lengths = self._lengths(picked)
        return Selection(self.given, self.unknown, rows, pattern, blocks, tuple(typical), lengths)

    def _lengths(self, picked: Sequence[tuple[Written, int]]) -> dict[int, Chosen]:
        """Rates of lengths that say what picked rows say."""
        found: dict[int, Chosen] = {}
        for tie in {id(w.tie): w.tie for w, _ in picked}.values():
            if (own := length(tie, self.tree, self.frames)) is None:
                continue
            row = self._write(own, own.classes[0])
            for n, (w, i) in enumerate(picked):
                if w.tie is tie and _alike(w.numbers[:, i], row.numbers[:, 0]):
                    found[n] = Chosen(own, row.axes, 0)
        return found


def _alike(a: Array, b: Array) -> bool:
    """Whether two rows are the same, or opposed, at every sample."""
    near = NEAR * np.abs(a).max()
    return bool(min(np.abs(a - b).max(), np.abs(a + b).max()) < near)


def _operations(row: Sequence[Scalar]) -> int:
    """About how many operations some scalars take."""
    parts = [casadi.SX(x) for x in row if not al.is_number(x)]
    if not parts:
        return 0
    column = casadi.vertcat(*parts)
    return int(casadi.Function("row", casadi.symvar(column), [column]).n_instructions())
