"""A tape in two: what depends on held inputs alone, once, and what is left to do many times."""

from __future__ import annotations

from collections.abc import Collection
from typing import NamedTuple

from gough.kernels.builder import Builder
from gough.kernels.tape import LEAVES, REAL, RESULTS, Tape


class Hoisted(NamedTuple):
    """A tape in two parts."""

    prepared: Tape
    """From the held inputs to the numbers that the rest takes."""
    rest: Tape
    """From the other inputs, in their order, then the prepared numbers, to the outputs."""


def hoisted(tape: Tape, held: Collection[int]) -> Hoisted:
    """The two parts of a tape some of whose input slots are held.

    The same operations on the same numbers, so the same bits. Only reals are handed over: a
    comparison of held numbers is made in the rest.
    """
    moving = _moving(tape, frozenset(held))
    edge = _edge(tape, moving)
    order = sorted(held)
    first = copied(tape, dict(zip(order, range(len(order)), strict=True)), {}, len(order), edge)
    others = [k for k in range(tape.inputs) if k not in set(held)]
    slots = {slot: place for place, slot in enumerate(others)}
    known = {k: len(others) + place for place, k in enumerate(edge)}
    rest = copied(tape, slots, known, len(others) + len(edge), tape.outputs)
    return Hoisted(first, rest)


def _moving(tape: Tape, held: frozenset[int]) -> list[bool]:
    """Which values belong to the rest; literals belong to either."""
    found = []
    for op, operands in tape.code:
        if op == "input":
            found.append(operands[0] not in held)
        else:
            real = RESULTS[op] == REAL
            found.append(op not in LEAVES and (not real or any(found[k] for k in operands)))
    return found


def _edge(tape: Tape, moving: list[bool]) -> list[int]:
    """Held values that the rest or the outputs take, but for literals."""
    wanted = set(tape.outputs)
    for k, (op, operands) in enumerate(tape.code):
        if moving[k] and op not in LEAVES:
            wanted.update(operands)
    return sorted(
        k for k in wanted if not moving[k] and (tape.code[k].op not in LEAVES or _held(tape, k))
    )


def _held(tape: Tape, k: int) -> bool:
    return tape.code[k].op == "input"


def copied(
    tape: Tape, slots: dict[int, int], known: dict[int, int], inputs: int, outputs: Collection[int]
) -> Tape:
    """The part of a tape that gives some values, from slots and from values that are known.

    Args:
        tape: the whole.
        slots: place of each input slot among the inputs of the part.
        known: place there of values that are not computed.
        inputs: how many inputs the part has.
        outputs: the values.
    """
    builder, numbers = Builder(inputs), {}
    for k in _needed(tape, known, outputs):
        op, operands = tape.code[k]
        if k in known:
            numbers[k] = builder.input(known[k])
        elif op == "input":
            numbers[k] = builder.input(slots[operands[0]])
        elif op in LEAVES:
            numbers[k] = getattr(builder, op)(*operands)
        else:
            numbers[k] = builder.write(op, *[numbers[j] for j in operands])
    return builder.tape([numbers[k] for k in outputs])


def _needed(tape: Tape, known: dict[int, int], outputs: Collection[int]) -> list[int]:
    """Values that outputs need, in their order."""
    needed = [False] * len(tape.code)
    for k in outputs:
        needed[k] = True
    for k in range(len(tape.code) - 1, -1, -1):
        op, operands = tape.code[k]
        if needed[k] and op not in LEAVES and k not in known:
            for j in operands:
                needed[j] = True
    return [k for k, wanted in enumerate(needed) if wanted]
