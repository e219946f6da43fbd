"""A tape in three, so that error functions which are certainly -1 can be skipped.

Smooth end stops take the error function of how far they are away, which is -1 to the last bit
nearly all the time. What comes before and after stands in tapes of its own.
"""

from __future__ import annotations

from typing import NamedTuple

from gough.kernels.builder import Builder
from gough.kernels.functions.error_function import LARGEST
from gough.kernels.hoisting import copied
from gough.kernels.tape import LEAVES, REAL, RESULTS, Tape

CERTAIN = -LARGEST
"""At and below this the error function is -1."""


class Skipping(NamedTuple):
    """The three parts."""

    before: Tape
    """From the inputs to the arguments of the functions, then all else that ``after`` takes."""
    functions: Tape
    """From the arguments to the values."""
    after: Tape
    """From the inputs, what ``before`` gives, and the values to the outputs."""


def skipping(tape: Tape) -> Skipping | None:
    """The parts of a tape that takes error functions, else None."""
    late: list[bool] = []
    first: list[int] = []
    for k, (op, operands) in enumerate(tape.code):
        inner = op not in LEAVES and any(late[j] for j in operands)
        if op == "erf" and not inner:
            first.append(k)
        late.append(inner or op == "erf" or (op not in LEAVES and RESULTS[op] != REAL))
    if not first:
        return None
    arguments = list(dict.fromkeys(tape.code[k].operands[0] for k in first))
    edge = arguments + _taken(tape, late, first, set(arguments))
    slots = {k: k for k in range(tape.inputs)}
    before = copied(tape, slots, {}, tape.inputs, edge)
    builder = Builder(len(arguments))
    values = [builder.emit("erf", builder.input(k)) for k in range(len(arguments))]
    known = {k: tape.inputs + place for place, k in enumerate(edge)}
    start = tape.inputs + len(edge)
    known |= {k: start + arguments.index(tape.code[k].operands[0]) for k in first}
    after = copied(tape, slots, known, start + len(arguments), tape.outputs)
    return Skipping(before, builder.tape(values), after)


def _taken(tape: Tape, late: list[bool], first: list[int], known: set[int]) -> list[int]:
    """Early values that late ones and outputs take, besides those that are known."""
    wanted, known = set(tape.outputs), known | set(first)
    for k, (op, operands) in enumerate(tape.code):
        if late[k] and op not in LEAVES and k not in first:
            wanted.update(operands)
    return sorted(k for k in wanted - known if not late[k] and tape.code[k].op not in LEAVES)
