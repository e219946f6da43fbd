"""Cutting a tape into stretches that are compiled each on its own.

The time to compile a function grows faster than its length, so long tapes become several functions
that pass values to each other through memory.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence, Set
from dataclasses import dataclass
from itertools import pairwise

from gough.kernels.tape import LEAVES, Tape

Stores = dict[int, list[tuple[int, list[int]]]]


@dataclass(frozen=True)
class Stretch:
    """Some instructions in their order, and what they pass on."""

    instructions: range
    outgoing: Set[int]
    """Values that later stretches take."""
    slots: Mapping[int, int]
    """Where values that are passed on stand in memory; the same for all stretches."""
    stores: Stores
    """After which instruction which columns of the output are complete: first column, values."""


def stretches(tape: Tape, width: int, longest: int) -> list[Stretch]:
    """The tape in stretches of at most about ``longest`` operations."""
    stores = _stores(tape, width)
    ranges = _ranges(tape, longest)
    if len(ranges) == 1:
        return [Stretch(ranges[0], frozenset(), {}, stores)]
    home = [part for part, range_ in enumerate(ranges) for _ in range_]
    last = _last_uses(tape, stores, home)
    passed = [k for k, part in last.items() if part > home[k]]
    slots = _slots(sorted(passed), home, last, len(ranges))
    outgoing = frozenset(passed)
    return [Stretch(range_, outgoing, slots, stores) for range_ in ranges]


def _stores(tape: Tape, width: int) -> Stores:
    """Blocks of W columns, each stored as soon as its last value is there."""
    stores: Stores = {}
    for first in range(0, len(tape.outputs), width):
        columns = list(tape.outputs[first : first + width])
        stores.setdefault(max(columns), []).append((first, columns))
    return stores


def _ranges(tape: Tape, longest: int) -> list[range]:
    total = tape.operations
    parts = max(1, -(-total // longest))
    wanted, borders, seen = total / parts, [0], 0
    for k, (op, _) in enumerate(tape.code):
        if seen >= wanted * len(borders) and len(borders) < parts:
            borders.append(k)
        seen += op not in LEAVES
    borders.append(len(tape.code))
    return [range(a, b) for a, b in pairwise(borders)]


def _last_uses(tape: Tape, stores: Stores, home: Sequence[int]) -> dict[int, int]:
    """The last stretch that takes each value; leaves are made anew wherever they are needed."""
    last: dict[int, int] = {}
    for k, (op, operands) in enumerate(tape.code):
        taken = [] if op in LEAVES else list(operands)
        for _, columns in stores.get(k, ()):
            taken += columns
        for j in taken:
            if tape.code[j].op not in LEAVES:
                last[j] = home[k]
    return last


def _slots(
    passed: Sequence[int], home: Sequence[int], last: Mapping[int, int], parts: int
) -> dict[int, int]:
    """A slot for each value; slots are used again once no later stretch takes their value."""
    slots: dict[int, int] = {}
    free: list[int] = []
    ending: list[list[int]] = [[] for _ in range(parts)]
    count, part = 0, 0
    for k in passed:
        while part < home[k]:
            free += ending[part]
            part += 1
        if not free:
            free.append(count)
            count += 1
        slots[k] = free.pop()
        ending[last[k]].append(slots[k])
    return slots
