"""The LLVM text of a kernel: a function over rows of arrays.

    void kernel(const char *pointers[], const int64_t steps[], int64_t rows)

``pointers`` holds the first row of each input and of the output, ``steps`` the distance in bytes
from a row to the next. W rows are computed at a time. The last W are taken from the end, so that
some rows are computed twice rather than one beyond the end; with fewer rows than W the last row
fills the lanes. Inputs and output must not overlap.
"""

from __future__ import annotations

from collections.abc import Callable, Container, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

from gough.kernels.native.lanes import Lanes, attributes
from gough.kernels.native.rows import Pointer, Rows
from gough.kernels.parts import Part, parts
from gough.kernels.tape import LEAVES, Instruction, Tape, meaning

Finished = dict[int, list[Any]]

ENTRY = "kernel"
"""Name of the function that is called."""


@dataclass
class KernelText:
    """The module of one kernel for one number of lanes."""

    tape: Tape
    sizes: Sequence[int]
    """Numbers in each input, none of them 0."""
    width: int
    longest: int
    """Instructions in one function at most."""

    def __post_init__(self) -> None:
        self._declarations: set[str] = set()
        self._operands = len(self.sizes) + 1
        starts = [0]
        for size in self.sizes:
            starts.append(starts[-1] + size)
        self._places = [
            (operand, slot - starts[operand])
            for operand, size in enumerate(self.sizes)
            for slot in range(starts[operand], starts[operand] + size)
        ]

    def __str__(self) -> str:
        pieces, kept = parts(self.tape, self.longest)
        functions = [self._part(k, part) for k, part in enumerate(pieces) if len(pieces) > 1]
        functions.append(self._loop(pieces, kept))
        return "\n".join([*functions, *sorted(self._declarations), attributes(self.width)])

    # the loop over rows

    def _loop(self, pieces: Sequence[Part], kept: int) -> str:
        lanes = Lanes(self.width)
        step, last_start = self._entry(lanes, kept)
        lanes.lines.append("  br label %loop")
        lanes.start_block("loop")
        lanes.lines.append("  %i = phi i64 [0, %entry], [%next, %latch]")
        rows = self._row_pointers(lanes, step)
        if len(pieces) == 1:
            self._work(lanes, pieces[0], lambda operand, lane: rows[operand][lane])
        else:
            self._calls(lanes, rows, len(pieces))
        lanes.lines.append("  br label %latch")
        lanes.start_block("latch")
        lanes.lines += [
            f"  %after = add i64 %i, {self.width}",
            "  %done = icmp sge i64 %after, %rows",
            f"  %far = icmp sgt i64 %after, {last_start}",
            f"  %next = select i1 %far, i64 {last_start}, i64 %after",
            "  br i1 %done, label %exit, label %loop",
            "exit:",
            "  ret void",
        ]
        self._collect(lanes)
        head = f"define void @{ENTRY}(ptr %pointers, ptr %steps, i64 %rows) #0 {{\nentry:\n"
        return head + "\n".join(lanes.lines) + "\n}\n"

    def _entry(self, lanes: Lanes, kept: int) -> tuple[list[list[str]], str]:
        """Offsets of the lanes' rows from the first for each operand, and the last first row."""
        new, width = lanes.new, self.width
        lanes.lines.append(f"  %kept = alloca [{kept} x {lanes.real}], align 64")
        lanes.lines.append(f"  %table = alloca [{self._operands * width} x ptr], align 64")
        last = new("sub i64 %rows, 1")
        start = new(f"sub i64 %rows, {width}")
        positive = new(f"icmp sgt i64 {start}, 0")
        last_start = new(f"select i1 {positive}, i64 {start}, i64 0")
        near = []
        for lane in range(1, width):
            beyond = new(f"icmp slt i64 {last}, {lane}")
            near.append(new(f"select i1 {beyond}, i64 {last}, i64 {lane}"))
        offsets = []
        for operand in range(self._operands):
            step = new(f"load i64, ptr {self._element('i64', '%steps', operand, lanes)}")
            pointer = self._element("ptr", "%pointers", operand, lanes)
            first = new(f"load ptr, ptr {pointer}")
            offsets.append([first, step, *[new(f"mul i64 {step}, {lane}") for lane in near]])
        return offsets, last_start

    @staticmethod
    def _element(kind: str, array: str, index: int, lanes: Lanes) -> str:
        return lanes.new(f"getelementptr inbounds {kind}, ptr {array}, i64 {index}")

    def _row_pointers(self, lanes: Lanes, offsets: list[list[str]]) -> list[list[str]]:
        result = []
        for first, step, *further in offsets:
            shift = lanes.new(f"mul i64 %i, {step}")
            row = lanes.new(f"getelementptr inbounds i8, ptr {first}, i64 {shift}")
            others = [lanes.new(f"getelementptr inbounds i8, ptr {row}, i64 {k}") for k in further]
            result.append([row, *others])
        return result

    def _calls(self, lanes: Lanes, rows: list[list[str]], parts: int) -> None:
        for k, row in enumerate([row for operand in rows for row in operand]):
            at = self._element("ptr", "%table", k, lanes)
            lanes.lines.append(f"  store ptr {row}, ptr {at}")
        for k in range(parts):
            lanes.lines.append(f"  call void @part_{k}(ptr %table, ptr %kept)")

    # the work

    def _part(self, number: int, part: Part) -> str:
        """One part as a function; row pointers and numbers of other parts are in memory."""
        lanes = Lanes(self.width)
        known: dict[tuple[int, int], str] = {}

        def pointer(operand: int, lane: int) -> str:
            if (operand, lane) not in known:
                at = self._element("ptr", "%table", operand * self.width + lane, lanes)
                known[operand, lane] = lanes.new(f"load ptr, ptr {at}")
            return known[operand, lane]

        self._work(lanes, part, pointer)
        self._collect(lanes)
        head = f"define internal void @part_{number}(ptr %table, ptr %kept) #0 {{\nentry:\n"
        return head + "\n".join(lanes.lines) + "\n  ret void\n}\n"

    def _work(self, lanes: Lanes, part: Part, pointer: Pointer) -> None:
        """The instructions of a part; leaves are fetched where they are first needed."""
        rows = Rows(lanes, pointer, self.sizes)
        keeps, stores = self._finished(part)
        wanted = {*keeps, *stores, *(j for runs in stores.values() for _, run in runs for j in run)}
        values: dict[int, str] = {}
        fetch = partial(self._input, lanes, rows)
        for k, name in written(lanes, part.tape.code, fetch, wanted):
            values[k] = name
            for place in keeps.get(k, ()):
                at = self._element(lanes.real, "%kept", place, lanes)
                lanes.lines.append(f"  store {lanes.real} {name}, ptr {at}")
            for first, columns in stores.get(k, ()):
                rows.store(first, [values[j] for j in columns])

    def _input(self, lanes: Lanes, rows: Rows, slot: int) -> str:
        """A column of the inputs, or a number that an earlier part has kept."""
        if slot < self.tape.inputs:
            return rows.load(*self._places[slot])
        at = self._element(lanes.real, "%kept", slot - self.tape.inputs, lanes)
        return lanes.new(f"load {lanes.real}, ptr {at}")

    def _finished(self, part: Part) -> tuple[Finished, Finished]:
        """After which instructions numbers are kept, and columns of the output stored.

        Columns are stored by blocks of W as soon as the last of a block is there.
        """
        keeps: Finished = {}
        values = list(part.tape.outputs)
        for place, k in zip(part.keeps, values, strict=False):
            keeps.setdefault(k, []).append(place)
        stores: Finished = {}
        columns = dict(zip(part.outputs, values[len(part.keeps) :], strict=True))
        for first in range(0, len(self.tape.outputs), self.width):
            block = [columns.get(first + k) for k in range(self.width)]
            for start, run in _runs(block):
                stores.setdefault(max(run), []).append((first + start, run))
        return keeps, stores

    def _collect(self, lanes: Lanes) -> None:
        self._declarations |= lanes.declarations


def written(
    lanes: Lanes, code: Sequence[Instruction], fetch: Callable[[int], str], wanted: Container[int]
) -> Iterator[tuple[int, str]]:
    """Write instructions, and give the names of those that are wanted as they come.

    Leaves are fetched where they are first needed.
    """
    values: dict[int, str] = {}

    def value(k: int) -> str:
        if k not in values:
            op, operands = code[k]
            values[k] = (fetch if op == "input" else meaning(lanes, op))(operands[0])
        return values[k]

    for k, (op, operands) in enumerate(code):
        if op not in LEAVES:
            values[k] = meaning(lanes, op)(*[value(j) for j in operands])
        if k in wanted:
            yield k, value(k)


def _runs(block: Sequence[int | None]) -> list[tuple[int, list[int]]]:
    """The stretches of a block that hold values: where each starts, and its values."""
    runs: list[tuple[int, list[int]]] = []
    for place, value in enumerate(block):
        if value is None:
            continue
        if runs and runs[-1][0] + len(runs[-1][1]) == place:
            runs[-1][1].append(value)
        else:
            runs.append((place, [value]))
    return runs
