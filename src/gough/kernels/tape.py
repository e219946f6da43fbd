"""Straight-line programs: a list of instructions, each computing one value from earlier ones.

Everything a kernel does is on its tape, and every back end runs a tape by giving each operation a
meaning: numbers, text of a language, or instructions of another tape. See `evaluate`.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

REAL, TRUTH, WORD = "real", "truth", "word"
"""Kinds of values: float64, a truth value, 64 bits as a whole number modulo 2⁶⁴."""

_R, _RR, _RRR = (REAL,), (REAL, REAL), (REAL, REAL, REAL)
_WW = (WORD, WORD)

PRIMITIVES: dict[str, tuple[tuple[str, ...], str]] = {
    # IEEE 754 operations, rounded to nearest
    "add": (_RR, REAL),
    "sub": (_RR, REAL),
    "mul": (_RR, REAL),
    "div": (_RR, REAL),
    "sqrt": (_R, REAL),
    # with a single rounding: a b + c, a b - c, c - a b
    "fma": (_RRR, REAL),
    "fms": (_RRR, REAL),
    "fnma": (_RRR, REAL),
    # exact ones
    "neg": (_R, REAL),
    "abs": (_R, REAL),
    "floor": (_R, REAL),
    # comparisons are false with NaN; "select" takes its second operand where the first holds
    "less": (_RR, TRUTH),
    "less_equal": (_RR, TRUTH),
    "equal": (_RR, TRUTH),
    "not": ((TRUTH,), TRUTH),
    "and": ((TRUTH, TRUTH), TRUTH),
    "or": ((TRUTH, TRUTH), TRUTH),
    "select": ((TRUTH, REAL, REAL), REAL),
    # the bits of a real and back; arithmetic modulo 2⁶⁴; shifts by 0 … 63
    "to_word": (_R, WORD),
    "to_real": ((WORD,), REAL),
    "word_add": (_WW, WORD),
    "word_sub": (_WW, WORD),
    "word_mul": (_WW, WORD),
    "word_and": (_WW, WORD),
    "word_or": (_WW, WORD),
    "word_xor": (_WW, WORD),
    "word_equal": (_WW, TRUTH),
    "shift_left": (_WW, WORD),
    "shift_right": (_WW, WORD),  # zeros come in
    # the second operand, but where the first holds sin or cos of the third, however large
    "careful_sin": ((TRUTH, REAL, REAL), REAL),
    "careful_cos": ((TRUTH, REAL, REAL), REAL),
}
"""What every back end knows: kinds of the operands and of the result."""

FUNCTIONS: dict[str, tuple[tuple[str, ...], str]] = {
    **dict.fromkeys(("sin", "cos", "tan", "asin", "acos", "atan", "exp", "log", "erf"), (_R, REAL)),
    **dict.fromkeys(("sinh", "cosh", "tanh", "expm1", "log1p"), (_R, REAL)),
    "atan2": (_RR, REAL),
    "pow": (_RR, REAL),
}
"""What is written out in primitives before a back end sees it (`expansion`)."""

LEAVES = {"input": REAL, "constant": REAL, "flag": TRUTH, "bits": WORD}
"""Instructions whose single operand is a slot or a literal, not an earlier value."""

RESULTS = {name: kinds[1] for name, kinds in (PRIMITIVES | FUNCTIONS).items()} | LEAVES
"""Kind of the result of every operation."""

COUNTED = {
    "mul": "mul",
    **dict.fromkeys(("add", "sub"), "add"),
    **dict.fromkeys(("fma", "fms", "fnma"), "fma"),
    "div": "div",
    "sqrt": "sqrt",
    "select": "select",
    **dict.fromkeys(("less", "less_equal", "equal", "not", "and", "or"), "compare"),
    **dict.fromkeys(("neg", "abs", "floor"), "sign"),
    **dict.fromkeys(FUNCTIONS, "function"),
    **dict.fromkeys(("sin", "cos", "tan", "asin", "acos", "atan", "atan2"), "trig"),
}
"""Names under which `Tape.counts` adds operations up."""


class Instruction(NamedTuple):
    """One operation and the numbers of the values it takes; a leaf holds its slot or literal."""

    op: str
    operands: tuple[Any, ...]


@dataclass(frozen=True)
class Tape:
    """Instruction k computes value k; all values before it may be its operands."""

    inputs: int
    """How many numbers go in."""
    code: Sequence[Instruction]
    outputs: Sequence[int]
    """Which values come out; all are real."""

    def __len__(self) -> int:
        return len(self.code)

    @cached_property
    def operations(self) -> int:
        """Instructions that compute something: all but the leaves."""
        return sum(op not in LEAVES for op, _ in self.code)

    def counts(self) -> dict[str, int]:
        """Operations by name: mul, add, fma, div, sqrt, trig, select …; "total" is their sum."""
        found = Counter(COUNTED.get(op, "bits") for op, _ in self.code if op not in LEAVES)
        order = [*dict.fromkeys(COUNTED.values()), "bits"]
        return {name: found[name] for name in order if found[name]} | {"total": found.total()}

    def uses(self) -> list[int]:
        """How often each value is an operand or an output."""
        count = [0] * len(self.code)
        for op, operands in self.code:
            if op not in LEAVES:
                for k in operands:
                    count[k] += 1
        for k in self.outputs:
            count[k] += 1
        return count


def evaluate(tape: Tape, arithmetic: Any, inputs: Sequence[Any]) -> list[Any]:
    """The outputs of a tape in an arithmetic: an object with a method for each operation.

    Methods of leaves (``constant``, ``flag``, ``bits``) get the literal, all others the values
    of their operands. A method whose name is a word of Python ends in an underscore (``not_``).
    """
    names = dict.fromkeys(op for op, _ in tape.code if op != "input")
    meanings = {op: meaning(arithmetic, op) for op in names}
    values: list[Any] = []
    for op, operands in tape.code:
        if op == "input":
            values.append(inputs[operands[0]])
        elif op in LEAVES:
            values.append(meanings[op](operands[0]))
        else:
            values.append(meanings[op](*[values[k] for k in operands]))
    return [values[k] for k in tape.outputs]


def meaning(arithmetic: Any, op: str) -> Any:
    """What an arithmetic does for an operation."""
    return getattr(arithmetic, op + "_" if op in ("not", "and", "or") else op)
