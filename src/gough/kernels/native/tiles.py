"""The LLVM text of a kernel over tiles: W numbers of each input and output side by side.

    void tile(const double *in, double *out)

Number k of lane r stands at ``in[k W + r]``. Loops that keep their numbers so need no turning of
rows into lanes. ``in`` and ``out`` must not overlap.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from gough.kernels.native.lanes import Lanes, attributes
from gough.kernels.native.text import written
from gough.kernels.parts import Part, parts
from gough.kernels.skipping import CERTAIN, Skipping
from gough.kernels.tape import Tape

ENTRY = "tile"
"""Name of the function that is called."""


@dataclass
class TileText:
    """The module of one kernel for one number of lanes."""

    tape: Tape
    width: int
    longest: int
    """Instructions in one function at most."""

    def __str__(self) -> str:
        self._declarations: set[str] = set()
        pieces, kept = parts(self.tape, self.longest)
        functions = [self._function(k, part) for k, part in enumerate(pieces)]
        functions.append(self._entry(len(pieces), kept))
        return "\n".join([*functions, *sorted(self._declarations), attributes(self.width)])

    def _entry(self, count: int, kept: int) -> str:
        real = Lanes(self.width).real
        lines = [f"  %kept = alloca [{max(kept, 1)} x {real}], align 64"]
        lines += [f"  call void @part_{k}(ptr %in, ptr %out, ptr %kept)" for k in range(count)]
        head = f"define void @{ENTRY}(ptr noalias %in, ptr noalias %out) #0 {{\nentry:\n"
        return head + "\n".join(lines) + "\n  ret void\n}\n"

    def _function(self, number: int, part: Part) -> str:
        lanes = Lanes(self.width)
        keeps, outputs = part.tape.outputs[: len(part.keeps)], part.tape.outputs[len(part.keeps) :]
        places: dict[int, list[tuple[str, int]]] = {}
        for array, values, targets in (
            ("kept", keeps, part.keeps),
            ("out", outputs, part.outputs),
        ):
            for k, place in zip(values, targets, strict=True):
                places.setdefault(k, []).append((array, place))

        def fetch(slot: int) -> str:
            inside = slot < self.tape.inputs
            array, place = ("in", slot) if inside else ("kept", slot - self.tape.inputs)
            at = self._at(lanes, array, place)
            return lanes.new(f"load {lanes.real}, ptr {at}, align 8")

        for k, value in written(lanes, part.tape.code, fetch, places):
            for array, place in places.get(k, ()):
                at = self._at(lanes, array, place)
                lanes.lines.append(f"  store {lanes.real} {value}, ptr {at}, align 8")
        self._declarations |= lanes.declarations
        arguments = "ptr noalias readonly %in, ptr noalias %out, ptr noalias %kept"
        head = f"define internal void @part_{number}({arguments}) #0 {{\nentry:\n"
        return head + "\n".join(lanes.lines) + "\n  ret void\n}\n"

    def _at(self, lanes: Lanes, array: str, place: int) -> str:
        at = place * self.width
        return lanes.new(f"getelementptr inbounds double, ptr %{array}, i64 {at}")


@dataclass
class SkippingTileText:
    """The module of a kernel whose error functions are skipped where all are certainly -1.

    They are computed for all lanes if a lane needs one, so that the bits are those of the whole.
    """

    parts: Skipping
    width: int

    def __str__(self) -> str:
        lanes = Lanes(self.width)
        inputs = self.parts.after.inputs - len(self.parts.before.outputs)
        inputs -= len(self.parts.functions.outputs)
        known = self._run(lanes, self.parts.before, self._loading(lanes))
        count = len(self.parts.functions.outputs)
        values = self._functions(lanes, known[:count])
        handed, load = [*known, *values], self._loading(lanes)
        found = self._run(
            lanes,
            self.parts.after,
            lambda slot: load(slot) if slot < inputs else handed[slot - inputs],
        )
        for place, value in enumerate(found):
            at = self._at(lanes, "out", place)
            lanes.lines.append(f"  store {lanes.real} {value}, ptr {at}, align 8")
        head = f"define void @{ENTRY}(ptr noalias readonly %in, ptr noalias %out) #0 {{\nentry:\n"
        text = head + "\n".join(lanes.lines) + "\n  ret void\n}\n"
        return "\n".join([text, *sorted(lanes.declarations), attributes(self.width)])

    def _run(self, lanes: Lanes, tape: Tape, fetch: Callable[[int], str]) -> list[str]:
        """Names of the outputs of a tape."""
        names = dict(written(lanes, tape.code, fetch, set(tape.outputs)))
        return [names[k] for k in tape.outputs]

    def _functions(self, lanes: Lanes, arguments: list[str]) -> list[str]:
        """Names of the values of the functions, behind a branch; NaN is not certain."""
        least = lanes.constant(float(np.nextafter(CERTAIN, 0.0)))
        wanted = [lanes.not_(lanes.less(x, least)) for x in arguments]  # type: ignore[operator]
        some = wanted[0]
        for one in wanted[1:]:
            some = lanes.or_(some, one)
        before, near, joined = lanes.block, lanes.label(), lanes.label()
        lanes.lines.append(f"  br i1 {lanes.any(some)}, label %{near}, label %{joined}")
        lanes.start_block(near)
        found = self._run(lanes, self.parts.functions, lambda slot: arguments[slot])
        inside = lanes.block
        lanes.lines.append(f"  br label %{joined}")
        lanes.start_block(joined)
        sure = lanes.constant(-1.0)
        return [
            lanes.new(f"phi {lanes.real} [{value}, %{inside}], [{sure}, %{before}]")
            for value in found
        ]

    def _loading(self, lanes: Lanes) -> Callable[[int], str]:
        def load(slot: int) -> str:
            at = self._at(lanes, "in", slot)
            return lanes.new(f"load {lanes.real}, ptr {at}, align 8")

        return load

    def _at(self, lanes: Lanes, array: str, place: int) -> str:
        return lanes.new(f"getelementptr inbounds double, ptr %{array}, i64 {place * self.width}")
