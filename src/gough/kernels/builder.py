"""Writing tapes: equal instructions are written once, constants are folded.

Every simplification here is exact, bit for bit (but for the sign of NaN), so that functions can
rely on the order of rounding they are written in.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Sequence
from functools import partial

from gough.kernels.reference import Reference
from gough.kernels.tape import FUNCTIONS, LEAVES, REAL, RESULTS, WORD, Instruction, Tape

COMMUTATIVE = frozenset(("add", "mul", "equal", "and", "or")) | {
    *("word_add", "word_mul", "word_and", "word_or", "word_xor", "word_equal")
}
NEVER_FOLDED = frozenset(("fma", "fms", "fnma", "careful_sin", "careful_cos"))
"""The reference has no meaning for the first three; the others are only reached by functions."""


class Builder:
    """An arithmetic whose values are numbers of instructions of a growing tape."""

    def __init__(self, inputs: int) -> None:
        self.inputs = inputs
        self.code: list[Instruction] = []
        self._numbers: dict[object, int] = {}
        self._rules: dict[str, Callable[..., int]] = {
            name: getattr(self, "_" + name)
            for name in ("neg", "abs", "add", "sub", "mul", "div", "select", "not")
        }
        for name in ("careful_sin", "careful_cos"):
            self._rules[name] = partial(self._careful, name)

    # leaves

    def input(self, slot: int) -> int:
        """Input number ``slot``."""
        return self._written(("input", slot), "input", (slot,))

    def constant(self, value: float) -> int:
        """A real literal; equal bits are one instruction."""
        return self._written(("constant", struct.pack("<d", value)), "constant", (float(value),))

    def flag(self, value: bool) -> int:
        """A truth literal."""
        return self._written(("flag", value), "flag", (bool(value),))

    def bits(self, value: int) -> int:
        """A word literal, taken modulo 2⁶⁴."""
        return self._written(("bits", value % 2**64), "bits", (value % 2**64,))

    def literal(self, kind: str, value: float | int | bool) -> int:
        """A literal of a kind."""
        if kind == REAL:
            return self.constant(value)
        return self.bits(int(value)) if kind == WORD else self.flag(bool(value))

    # reading back

    def kind(self, k: int) -> str:
        """Kind of a value."""
        return RESULTS[self.code[k].op]

    def constant_of(self, k: int) -> float | None:
        """The number a value is known to be, or None."""
        op, operands = self.code[k]
        return operands[0] if op == "constant" else None

    def negated(self, k: int) -> int | None:
        """The value that a value is the opposite of, or None."""
        op, operands = self.code[k]
        return operands[0] if op == "neg" else None

    # operations

    def emit(self, op: str, *operands: int) -> int:
        """The value of an operation: an earlier one if there is an equal one."""
        code = self.code
        if all(code[k].op in LEAVES and code[k].op != "input" for k in operands):
            folded = self._folded(op, operands)
            if folded is not None:
                return folded
        rule = self._rules.get(op)
        return self.write(op, *operands) if rule is None else rule(*operands)

    def write(self, op: str, *operands: int) -> int:
        """An instruction as it stands, unless it has been written before."""
        if op in COMMUTATIVE and operands[0] > operands[1]:
            operands = (operands[1], operands[0])
        return self._written((op, operands), op, operands)

    def _written(self, key: object, op: str, operands: tuple[object, ...]) -> int:
        number = self._numbers.get(key)
        if number is None:
            number = self._numbers[key] = len(self.code)
            self.code.append(Instruction(op, operands))
        return number

    def _folded(self, op: str, operands: Sequence[int]) -> int | None:
        if op in NEVER_FOLDED or op in FUNCTIONS:
            return None
        given = [self.code[k] for k in operands]
        return self.literal(RESULTS[op], Reference.folded(op, given))

    def tape(self, outputs: Sequence[int]) -> Tape:
        """What the outputs need of all that was written, in the order of writing."""
        return live(Tape(self.inputs, self.code, list(outputs)))

    # exact rules

    def _neg(self, a: int) -> int:
        inner = self.negated(a)
        return self.write("neg", a) if inner is None else inner

    def _abs(self, a: int) -> int:
        op, operands = self.code[a]
        if op == "abs":
            return a
        return self.write("abs", operands[0] if op == "neg" else a)

    def _add(self, a: int, b: int) -> int:
        minus_b = self.negated(b)
        if minus_b is not None:
            return self.emit("sub", a, minus_b)
        minus_a = self.negated(a)
        return self.write("add", a, b) if minus_a is None else self.emit("sub", b, minus_a)

    def _sub(self, a: int, b: int) -> int:
        minus_b = self.negated(b)
        return self.write("sub", a, b) if minus_b is None else self.emit("add", a, minus_b)

    def _mul(self, a: int, b: int) -> int:
        if self.constant_of(b) is not None:
            a, b = b, a
        factor = self.constant_of(a)
        if factor is not None:
            if factor == 1:
                return b
            if factor == 2:
                return self.emit("add", b, b)
            if factor < 0:
                return self.emit("neg", self.emit("mul", self.constant(-factor), b))
        a, odd_a = self._sign_off(a)
        b, odd_b = self._sign_off(b)
        product = self.write("mul", a, b)
        return self.emit("neg", product) if odd_a != odd_b else product

    def _div(self, a: int, b: int) -> int:
        if self.constant_of(b) == 1:
            return a
        a, odd_a = self._sign_off(a)
        b, odd_b = self._sign_off(b)
        quotient = self.write("div", a, b)
        return self.emit("neg", quotient) if odd_a != odd_b else quotient

    def _sign_off(self, a: int) -> tuple[int, bool]:
        inner = self.negated(a)
        return (a, False) if inner is None else (inner, True)

    def _select(self, condition: int, a: int, b: int) -> int:
        op, operands = self.code[condition]
        if op == "flag":
            return a if operands[0] else b
        if a == b:
            return a
        if op == "not":
            return self.write("select", operands[0], b, a)
        return self.write("select", condition, a, b)

    def _careful(self, op: str, wanted: int, fast: int, angle: int) -> int:
        if self.code[wanted] == Instruction("flag", (False,)):
            return fast
        return self.write(op, wanted, fast, angle)

    def _not(self, a: int) -> int:
        op, operands = self.code[a]
        return int(operands[0]) if op == "not" else self.write("not", a)


def live(tape: Tape) -> Tape:
    """The tape without instructions that no output needs."""
    needed = [False] * len(tape.code)
    for k in tape.outputs:
        needed[k] = True
    for k in range(len(tape.code) - 1, -1, -1):
        op, operands = tape.code[k]
        if needed[k] and op not in LEAVES:
            for operand in operands:
                needed[operand] = True
    new = [0] * len(tape.code)
    code: list[Instruction] = []
    for k, (op, operands) in enumerate(tape.code):
        if needed[k]:
            new[k] = len(code)
            moved = operands if op in LEAVES else tuple([new[j] for j in operands])
            code.append(Instruction(op, moved))
    return Tape(tape.inputs, code, [new[k] for k in tape.outputs])
