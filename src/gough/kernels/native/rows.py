"""Columns of array-of-structures rows in and out of lanes, never past the end of a row."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from gough.kernels.native.lanes import Lanes

Pointer = Callable[[int, int], str]
"""Name of the pointer to the row of lane r of operand j (the output is the last operand)."""


@dataclass
class Rows:
    """Loads and stores of one stretch of code; column c of W rows is one value of W lanes."""

    lanes: Lanes
    pointer: Pointer
    sizes: Sequence[int]
    """Columns of each input."""
    _loaded: dict[tuple[int, int], str] = field(default_factory=dict)

    def load(self, operand: int, column: int) -> str:
        """One column of an input, loaded at its first use with its neighbours."""
        if (operand, column) not in self._loaded:
            width, size = self.lanes.width, self.sizes[operand]
            if size < width or width == 1:
                self._loaded[operand, column] = self._gathered(operand, column)
            else:
                # the last block overlaps its neighbour instead of reading past the row
                first = min(column // width * width, size - width)
                for k, value in enumerate(self._block(operand, first)):
                    self._loaded.setdefault((operand, first + k), value)
        return self._loaded[operand, column]

    def _at(self, operand: int, lane: int, column: int) -> str:
        row = self.pointer(operand, lane)
        return self.lanes.new(f"getelementptr inbounds double, ptr {row}, i64 {column}")

    def _gathered(self, operand: int, column: int) -> str:
        lanes, value = self.lanes, "poison"
        for lane in range(lanes.width):
            at = self._at(operand, lane, column)
            number = lanes.new(f"load double, ptr {at}, align 8, !invariant.load !0")
            if lanes.width == 1:
                return number
            value = lanes.new(f"insertelement {lanes.real} {value}, double {number}, i64 {lane}")
        return value

    def _block(self, operand: int, first: int) -> list[str]:
        lanes, rows = self.lanes, []
        for lane in range(lanes.width):
            at = self._at(operand, lane, first)
            rows.append(lanes.new(f"load {lanes.real}, ptr {at}, align 8, !invariant.load !0"))
        return self._transposed(rows)

    def store(self, first: int, columns: Sequence[str]) -> None:
        """At most W neighbouring columns of the output."""
        lanes, output = self.lanes, len(self.sizes)
        if lanes.width == 1:
            at = self._at(output, 0, first)
            lanes.lines.append(f"  store double {columns[0]}, ptr {at}, align 8")
            return
        missing = ["poison"] * (lanes.width - len(columns))
        for lane, row in enumerate(self._transposed([*columns, *missing])):
            for begin, count in _powers_of_two(len(columns)):
                at = self._at(output, lane, first + begin)
                kind, part = self._part(row, begin, count)
                lanes.lines.append(f"  store {kind} {part}, ptr {at}, align 8")

    def _part(self, row: str, begin: int, count: int) -> tuple[str, str]:
        lanes = self.lanes
        if count == lanes.width:
            return lanes.real, row
        mask = _mask(range(begin, begin + count))
        part = lanes.new(f"shufflevector {lanes.real} {row}, {lanes.real} poison, {mask}")
        return f"<{count} x double>", part

    def _transposed(self, square: list[str]) -> list[str]:
        """W values of W lanes with rows and columns exchanged, by log₂ W rounds of shuffles."""
        lanes, width, distance = self.lanes, self.lanes.width, 1
        while distance < width:
            low = [j if not j & distance else width + j - distance for j in range(width)]
            high = [j + distance if not j & distance else width + j for j in range(width)]
            result = list(square)
            for j in range(width):
                if not j & distance:
                    pair = f"{lanes.real} {square[j]}, {lanes.real} {square[j + distance]}"
                    result[j] = lanes.new(f"shufflevector {pair}, {_mask(low)}")
                    result[j + distance] = lanes.new(f"shufflevector {pair}, {_mask(high)}")
            square, distance = result, 2 * distance
        return square


def _mask(positions: Sequence[int]) -> str:
    return f"<{len(positions)} x i32> <{', '.join(f'i32 {k}' for k in positions)}>"


def _powers_of_two(count: int) -> list[tuple[int, int]]:
    """Stretches (begin, length) of lengths 2ⁿ that make up ``count``."""
    stretches, begin = [], 0
    while begin < count:
        length = 1 << ((count - begin).bit_length() - 1)
        stretches.append((begin, length))
        begin += length
    return stretches
