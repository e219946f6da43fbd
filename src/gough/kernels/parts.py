"""Long tapes in parts that compilers finish in time proportional to their length.

A part takes the inputs of the tape and numbers kept by earlier parts, and keeps numbers for later
ones. All numbers kept are reals: a truth is 1 or 0, a word is the real with its bits.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from gough.kernels.tape import LEAVES, RESULTS, TRUTH, WORD, Instruction, Tape


@dataclass(frozen=True)
class Part:
    """A stretch of a tape as a tape, and where its outputs go."""

    tape: Tape
    """Its inputs are those of the whole tape and after them all places of numbers kept."""
    keeps: Sequence[int]
    """Places of its first outputs among the numbers kept."""
    outputs: Sequence[int]
    """Places of its other outputs among the outputs of the whole tape."""


def parts(tape: Tape, length: int) -> tuple[list[Part], int]:
    """Parts of at most so many instructions, in their order, and how many places they keep.

    A place is used again once no later part takes the number in it.
    """
    if len(tape) <= length:
        return [Part(tape, [], range(len(tape.outputs)))], 0
    home = [k // length for k in range(len(tape))]
    last: dict[int, int] = {}
    for k, (op, operands) in enumerate(tape.code):
        for j in () if op in LEAVES else operands:
            if home[j] < home[k] and tape.code[j].op not in LEAVES:
                last[j] = home[k]
    kept = _places(home, last)
    starts = range(0, len(tape), length)
    stretches = [range(start, min(start + length, len(tape))) for start in starts]
    count = 1 + max(kept.values(), default=-1)
    return [_part(tape, stretch, kept, count) for stretch in stretches], count


def _places(home: Sequence[int], last: Mapping[int, int]) -> dict[int, int]:
    """A place for each value that is taken in a later part, the last of which is given."""
    places: dict[int, int] = {}
    free: list[int] = []
    ending: list[list[int]] = [[] for _ in range(home[-1] + 1)]
    count, part = 0, 0
    for k in sorted(last):
        while part < home[k]:
            free += ending[part]
            part += 1
        if not free:
            free.append(count)
            count += 1
        places[k] = free.pop()
        ending[last[k]].append(places[k])
    return places


def _part(tape: Tape, stretch: range, kept: Mapping[int, int], count: int) -> Part:
    copy = _Copy(tape, kept)
    for k in stretch:
        op, operands = tape.code[k]
        if op not in LEAVES:
            copy.numbers[k] = copy.write(op, *map(copy.number, operands))
    keeps = [k for k in stretch if k in kept]
    places = [place for place, k in enumerate(tape.outputs) if k in stretch]
    outputs = [copy.number(tape.outputs[place]) for place in places]
    part = Tape(tape.inputs + count, copy.code, [*map(copy.as_real, keeps), *outputs])
    return Part(part, [kept[k] for k in keeps], places)


class _Copy:
    """Instructions of one part; values from elsewhere are written when they are first needed."""

    def __init__(self, tape: Tape, kept: Mapping[int, int]) -> None:
        self.tape, self.kept = tape, kept
        self.code: list[Instruction] = []
        self.numbers: dict[int, int] = {}

    def write(self, op: str, *operands: float | int) -> int:
        self.code.append(Instruction(op, operands))
        return len(self.code) - 1

    def number(self, k: int) -> int:
        """The number in this part of a value of the whole tape."""
        if k not in self.numbers:
            op, operands = self.tape.code[k]
            self.numbers[k] = self.write(op, *operands) if op in LEAVES else self._fetched(k)
        return self.numbers[k]

    def _fetched(self, k: int) -> int:
        kind = RESULTS[self.tape.code[k].op]
        number = self.write("input", self.tape.inputs + self.kept[k])
        if kind == TRUTH:
            return self.write("equal", number, self.write("constant", 1.0))
        return self.write("to_word", number) if kind == WORD else number

    def as_real(self, k: int) -> int:
        """A value of this part as the real number to keep."""
        kind, number = RESULTS[self.tape.code[k].op], self.numbers[k]
        if kind == TRUTH:
            ends = self.write("constant", 1.0), self.write("constant", 0.0)
            return self.write("select", number, *ends)
        return self.write("to_real", number) if kind == WORD else number
