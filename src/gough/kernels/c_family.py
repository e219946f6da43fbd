"""What C and CUDA C share: tapes written as functions of one statement for each instruction.

A language is a table of texts for the operations; `Statements` is the arithmetic that fills them
in. Every name in a file starts with the name of the kernel, so that files can be put together.
"""

from __future__ import annotations

import math
import re
import textwrap
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass

from gough.kernels.builder import live
from gough.kernels.c_names import check_names
from gough.kernels.functions.large_angles import routine
from gough.kernels.parts import Part, parts
from gough.kernels.tape import RESULTS, Tape, evaluate

LONGEST = 5000
"""Instructions in one function; longer tapes are written in parts."""

OPERATIONS = {
    "add": "{0} + {1}",
    "sub": "{0} - {1}",
    "mul": "{0} * {1}",
    "div": "{0} / {1}",
    "sqrt": "sqrt({0})",
    "fma": "fma({0}, {1}, {2})",
    "fms": "fma({0}, {1}, -{2})",
    "fnma": "fma(-{0}, {1}, {2})",
    "neg": "-{0}",
    "abs": "fabs({0})",
    "floor": "floor({0})",
    "less": "{0} < {1}",
    "less_equal": "{0} <= {1}",
    "equal": "{0} == {1}",
    "not": "!{0}",
    "and": "{0} & {1}",
    "or": "{0} | {1}",
    "select": "{0} ? {1} : {2}",
    "to_word": "{name}_word({0})",
    "to_real": "{name}_real({0})",
    "word_add": "{0} + {1}",
    "word_sub": "{0} - {1}",
    "word_mul": "{0} * {1}",
    "word_and": "{0} & {1}",
    "word_or": "{0} | {1}",
    "word_xor": "{0} ^ {1}",
    "word_equal": "({0} ^ {1}) == 0",  # compilers frown upon v1 == v1
    "shift_left": "{0} << {1}",
    "shift_right": "{0} >> {1}",
    "careful_sin": "{0} ? {name}_sin({2}) : {1}",
    "careful_cos": "{0} ? {name}_cos({2}) : {1}",
}
"""Expressions of the operations; ``{name}`` is the name of the kernel."""


@dataclass(frozen=True)
class Language:
    """How one language writes values and functions."""

    types: Mapping[str, str]
    """Type of each kind of value."""
    operations: Mapping[str, str]
    bits: str
    """A word literal; its place takes a whole number."""
    infinity: str
    nan: str
    local: str
    """What stands before functions that only this file calls …"""
    part: str
    """… before those of them that must not become part of others …"""
    row: str
    """… before the function of one row …"""
    batch: str
    """… and before the one of many rows."""
    restrict: str
    """What says of a pointer that nothing else points there."""

    def real(self, value: float) -> str:
        """A real literal, in brackets if negative: hexadecimal, or decimal where it is whole."""
        if math.isnan(value):
            return self.nan
        if math.copysign(1.0, value) < 0:
            return f"(-{self.real(-value)})"
        if math.isinf(value):
            return self.infinity
        if value.is_integer() and value < 1e6:
            return repr(value)
        digits, exponent = value.hex().split("p")
        return f"{digits.rstrip('0').rstrip('.')}p{exponent}"


class Statements:
    """The arithmetic whose values are texts: an operation appends a line and gives its variable."""

    def __init__(self, language: Language, name: str) -> None:
        self.language, self.name = language, name
        self.lines: list[str] = []
        self.constant = language.real

    @staticmethod
    def flag(value: bool) -> str:
        """A truth literal."""
        return "1" if value else "0"

    def bits(self, value: int) -> str:
        """A word literal."""
        return self.language.bits.format(value)

    def __getattr__(self, op: str) -> Callable[..., str]:
        op = op.rstrip("_")
        kind, text = self.language.types[RESULTS[op]], self.language.operations[op]

        def written(*operands: str) -> str:
            variable = f"v{len(self.lines)}"
            value = text.format(*operands, name=self.name)
            self.lines.append(f"const {kind} {variable} = {value};")
            return variable

        return written


@dataclass(frozen=True)
class Program:
    """A tape and the names of its inputs, to be written in a language.

    Inputs without numbers are left out of the functions: there is nothing to point at.
    """

    language: Language
    name: str
    tape: Tape
    inputs: Mapping[str, int]

    @classmethod
    def checked(
        cls, language: Language, name: str, tape: Tape, inputs: Mapping[str, int]
    ) -> Program:
        """The program, without instructions that no output needs.

        Raises:
            ConfigurationError: the kernel or an input has a name that C or C++ does not take.
        """
        assert sum(inputs.values()) == tape.inputs
        given = {label: size for label, size in inputs.items() if size}
        check_names(name, given)
        return cls(language, name, live(tape), given)

    def row_head(self, restrict: str = "") -> str:
        """Head of the function of one row."""
        return _head(f"{self.language.row} {self.name}(", self._arrays(restrict))

    def batch_head(self, restrict: str = "") -> str:
        """Head of the function of many rows."""
        start = f"{self.language.batch} {self.name}_batch("
        return _head(start, ["size_t rows", *self._arrays(restrict)])

    def _arrays(self, restrict: str, written: Iterable[str] = ("out",)) -> list[str]:
        arrays = [f"const double *{restrict}{label}" for label in self.inputs]
        return arrays + [f"double *{restrict}{label}" for label in written]

    def call(self) -> str:
        """Call of the function of one row from that of many, for number ``row``."""
        sizes = {**self.inputs, "out": len(self.tape.outputs)}
        return f"{self.name}({', '.join(f'{array} + {n} * row' for array, n in sizes.items())});"

    def function(self) -> str:
        """The function of one row, after the functions that it calls."""
        operations = {op for op, _ in self.tape.code}
        called = [self._routine(f) for f in ("sin", "cos") if f"careful_{f}" in operations]
        if len(self.tape) <= LONGEST:
            targets = [f"out[{k}]" for k in range(len(self.tape.outputs))]
            lines = self._lines(self.tape, self.inputs, targets)
        else:
            pieces, kept = parts(self.tape, LONGEST)
            called += [self._part(k, part, kept) for k, part in enumerate(pieces)]
            arguments = ", ".join([*self.inputs, "kept", "out"])
            calls = [f"{self.name}_part{k}({arguments});" for k in range(len(pieces))]
            lines = [f"double kept[{max(kept, 1)}];", *calls]
        head = self.row_head(self.language.restrict)
        return "\n".join([*called, head + _block(_used(lines, [*self.inputs, "out"]))])

    def _part(self, number: int, part: Part, kept: int) -> str:
        arrays = self._arrays(self.language.restrict, ("kept", "out"))
        head = _head(f"{self.language.part} void {self.name}_part{number}(", arrays)
        targets = [*(f"kept[{k}]" for k in part.keeps), *(f"out[{k}]" for k in part.outputs)]
        lines = self._lines(part.tape, {**self.inputs, "kept": kept}, targets)
        return head + _block(_used(lines, [*self.inputs, "kept", "out"]))

    def _routine(self, function: str) -> str:
        head = f"{self.language.local} double {self.name}_{function}(double x)"
        statements = Statements(self.language, self.name)
        (result,) = evaluate(routine(function), statements, ["x"])
        return head + _block([*statements.lines, f"return {result};"])

    def _lines(self, tape: Tape, inputs: Mapping[str, int], targets: Sequence[str]) -> list[str]:
        """Statements that take a tape's inputs from arrays and put its outputs where they go."""
        slots = [f"{label}[{k}]" for label, size in inputs.items() for k in range(size)]
        statements = Statements(self.language, self.name)
        outputs = zip(targets, evaluate(tape, statements, slots), strict=True)
        return statements.lines + [f"{target} = {value};" for target, value in outputs]

    def comment(self, about: str, shape: Sequence[int] | None, notes: Sequence[str]) -> str:
        """What the kernel computes, the shapes, the operations of a row and what else to know."""
        shape = (len(self.tape.outputs),) if shape is None else tuple(shape)
        assert math.prod(shape) == len(self.tape.outputs)
        shapes = {label: f"({size},)" for label, size in self.inputs.items()}
        shapes["out"] = f"{shape}{', rows vary slowest' if len(shape) > 1 else ''}"
        width = max(map(len, shapes))
        counts = self.tape.counts()
        total = counts.pop("total")
        listed = ", ".join(f"{count} {operation}" for operation, count in counts.items())
        lines = [
            *_wrapped(f"{self.name}: {about}" if about else self.name),
            "",
            *(f"  {label:{width}}  {text}" for label, text in shapes.items()),
            "",
            *_wrapped(f"Operations for a row: {total} ({listed})." if total else "No operations."),
            *(line for note in notes for line in _wrapped(note)),
        ]
        return "/* " + "\n".join(f" * {line}".rstrip() for line in lines)[3:] + "\n */\n"


def _head(start: str, parameters: Sequence[str]) -> str:
    line = f"{start}{', '.join(parameters)})"
    return "\n".join(textwrap.wrap(line, 100, subsequent_indent="    "))


def _block(lines: Iterable[str]) -> str:
    inner = "".join(f"    {line}\n" for line in lines)
    return f"\n{{\n{inner}}}\n"


def _used(lines: Sequence[str], arrays: Iterable[str]) -> list[str]:
    """The lines, after a use of each array that they do not name: compilers warn otherwise."""
    text = "\n".join(lines)
    unused = [array for array in arrays if not re.search(rf"\b{array}\b", text)]
    return [*(f"(void){array};" for array in unused), *lines]


def _wrapped(text: str) -> list[str]:
    """Lines of a comment, in which nothing ends it or begins another."""
    harmless = text.replace("*/", "* /").replace("/*", "/ *").replace("\\", "/").replace("??", "?")
    return [part for line in harmless.splitlines() for part in textwrap.wrap(line, 92) or [""]]
