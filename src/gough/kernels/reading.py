"""From a CasADi function of scalar symbols to a tape.

Here, and only here, a model is simplified by rules of algebra that change roundings: one reciprocal
for each divisor, factors of constants gathered, `if_else` seen as a selection.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import casadi

from gough.errors import ConfigurationError
from gough.kernels.builder import Builder, live
from gough.kernels.tape import FUNCTIONS, TRUTH, Instruction, Tape

_NAMES = {getattr(casadi, n): n[3:].lower() for n in dir(casadi) if n.startswith("OP_")}
ONE = Instruction("constant", (1.0,))
LARGEST_POWER = 32
"""Whole exponents up to this are multiplied out."""


def _moderate(constant: float) -> bool:
    """Whether a constant and its reciprocal are far from overflow and underflow."""
    return 2.0**-1000 < abs(constant) < 2.0**1000


class Simplifier(Builder):
    """A builder that also uses rules of algebra on finite numbers."""

    def __init__(self, inputs: int) -> None:
        super().__init__(inputs)
        self._one = self.constant(1.0)

    def _neg(self, a: int) -> int:
        op, operands = self.code[a]
        return self.emit("sub", operands[1], operands[0]) if op == "sub" else super()._neg(a)

    def _add(self, a: int, b: int) -> int:
        if self.constant_of(a) == 0:
            return b
        if self.constant_of(b) == 0:
            return a
        chosen = self._choice(a, b)
        return super()._add(a, b) if chosen is None else chosen

    def _choice(self, a: int, b: int) -> int | None:
        """``select(c, x, 0) + select(not c, y, 0)`` as one selection."""
        (op_a, of_a), (op_b, of_b) = self.code[a], self.code[b]
        if op_a != "select" or op_b != "select" or of_a[0] != of_b[0]:
            return None
        if self.constant_of(of_a[2]) == 0 and self.constant_of(of_b[1]) == 0:
            return self.emit("select", of_a[0], of_a[1], of_b[2])
        if self.constant_of(of_a[1]) == 0 and self.constant_of(of_b[2]) == 0:
            return self.emit("select", of_a[0], of_b[1], of_a[2])
        return None

    def _sub(self, a: int, b: int) -> int:
        if self.constant_of(b) == 0:
            return a
        if self.constant_of(a) == 0:
            return self.emit("neg", b)
        return self.constant(0.0) if a == b else super()._sub(a, b)

    def _mul(self, a: int, b: int) -> int:
        if self.constant_of(b) is not None:
            a, b = b, a
        factor = self.constant_of(a)
        if factor == 0:
            return self.constant(0.0)
        if factor is not None:
            op, operands = self.code[b]
            if op == "mul":
                for inner, rest in (operands, operands[::-1]):
                    value = self.constant_of(inner)
                    if value is not None and _moderate(factor * value):
                        return self.emit("mul", self.constant(factor * value), rest)
        return super()._mul(a, b)

    def _div(self, a: int, b: int) -> int:
        divisor = self.constant_of(b)
        if self.constant_of(a) == 0:
            return a
        if divisor is not None and _moderate(divisor):
            return self.emit("mul", a, self.constant(1.0 / divisor))
        if a == self._one or divisor is not None:
            return super()._div(a, b)
        return self.emit("mul", a, self.emit("div", self._one, b))


class _Reader:
    """Meanings of CasADi's operations on the tape; its truth values are the numbers 0 and 1."""

    def __init__(self, inputs: int) -> None:
        self.builder = Simplifier(inputs)
        direct = {name: name for name in ("add", "sub", "mul", "div", "neg", "sqrt", "floor")}
        direct |= {"fabs": "abs"} | {name: name for name in FUNCTIONS if name != "pow"}
        tests = {"lt": "less", "le": "less_equal", "eq": "equal"}
        self.meanings: dict[str, Callable[..., int]] = {
            **{theirs: self._direct(ours) for theirs, ours in direct.items()},
            **{theirs: self._direct(ours) for theirs, ours in tests.items()},
            "ne": lambda a, b: self._not(self._emit("equal", a, b)),
            "not": lambda a: self._not(a),
            "and": lambda a, b: self.builder.emit("and", self._truth(a), self._truth(b)),
            "or": lambda a, b: self.builder.emit("or", self._truth(a), self._truth(b)),
            "if_else_zero": lambda c, a: self._select(c, a, self.builder.constant(0.0)),
            "fmin": lambda a, b: self._select(self._emit("less", a, b), a, b),
            "fmax": lambda a, b: self._select(self._emit("less", b, a), a, b),
            "sq": lambda a: self._emit("mul", a, a),
            "twice": lambda a: self._emit("add", a, a),
            "inv": lambda a: self._emit("div", self.builder.constant(1.0), a),
            "ceil": lambda a: self._emit("neg", self._emit("floor", self._emit("neg", a))),
            "assign": lambda a: a,
            "lift": lambda a, _: a,
            "pow": self._power,
            "constpow": self._power,
            "sign": self._sign,
            "copysign": self._copysign,
            "hypot": self._hypot,
        }

    def _direct(self, op: str) -> Callable[..., int]:
        return lambda *operands: self._emit(op, *operands)

    def _emit(self, op: str, *operands: int) -> int:
        return self.builder.emit(op, *[self.real(k) for k in operands])

    def real(self, k: int) -> int:
        """A truth value as 1 or 0, any other as it is."""
        builder = self.builder
        if builder.kind(k) != TRUTH:
            return k
        return builder.emit("select", k, builder.constant(1.0), builder.constant(0.0))

    def _truth(self, k: int) -> int:
        if self.builder.kind(k) == TRUTH:
            return k
        return self._not(self.builder.emit("equal", k, self.builder.constant(0.0)))

    def _not(self, k: int) -> int:
        return self.builder.emit("not", self._truth(k))

    def _select(self, condition: int, a: int, b: int) -> int:
        return self.builder.emit("select", self._truth(condition), self.real(a), self.real(b))

    def _hypot(self, a: int, b: int) -> int:
        """The root of the squares' sum, scaled by the larger so that squares stay in range."""
        emit, one, zero = self._emit, self.builder.constant(1.0), self.builder.constant(0.0)
        a, b = emit("abs", a), emit("abs", b)
        swapped = emit("less", a, b)
        large, small = self._select(swapped, b, a), self._select(swapped, a, b)
        ratio = emit("div", small, self._select(emit("equal", large, zero), one, large))
        root = emit("sqrt", emit("add", emit("mul", ratio, ratio), one))
        infinite = emit("equal", large, self.builder.constant(float("inf")))
        return self._select(infinite, large, emit("mul", large, root))

    def _sign(self, a: int) -> int:
        zero, one = self.builder.constant(0.0), self.builder.constant(1.0)
        negative = self._select(self._emit("less", a, zero), self.builder.constant(-1.0), a)
        return self._select(self._emit("less", zero, a), one, negative)

    def _copysign(self, a: int, b: int) -> int:
        emit, sign = self.builder.emit, self.builder.bits(1 << 63)
        size = emit("to_word", self._emit("abs", a))
        return emit(
            "to_real", emit("word_or", size, emit("word_and", emit("to_word", self.real(b)), sign))
        )

    def _power(self, base: int, exponent: int) -> int:
        base, known = self.real(base), self.builder.constant_of(exponent)
        if known is None or not abs(known) <= LARGEST_POWER or 2 * known != int(2 * known):
            return self._emit("pow", base, exponent)
        size = abs(known)
        power = self._whole_power(base, int(size))
        if size != int(size):
            power = self._emit("mul", power, self._emit("sqrt", base))
        return self._emit("div", self.builder.constant(1.0), power) if known < 0 else power

    def _whole_power(self, base: int, exponent: int) -> int:
        if exponent == 0:
            return self.builder.constant(1.0)
        half = self._whole_power(base, exponent // 2)
        square = self._emit("mul", half, half)
        return self._emit("mul", square, base) if exponent % 2 else square


def read(function: casadi.Function) -> Tape:
    """The tape of a CasADi function of SX symbols; inputs and outputs one after the other.

    Sparse outputs come out with their stored entries only: densify them first.

    Raises:
        ConfigurationError: the function uses an operation that has no meaning here.
    """
    starts = _starts([function.nnz_in(k) for k in range(function.n_in())])
    ends = _starts([function.nnz_out(k) for k in range(function.n_out())])
    reader = _Reader(starts[-1])
    builder, meanings = reader.builder, reader.meanings
    work: dict[int, int] = {}
    outputs = [builder.constant(0.0)] * ends[-1]
    for k in range(function.n_instructions()):
        name, into = _NAMES[function.instruction_id(k)], function.instruction_output(k)
        if name == "const":
            work[into[0]] = builder.constant(function.instruction_constant(k))
            continue
        taken = function.instruction_input(k)
        if name == "input":
            work[into[0]] = builder.input(starts[taken[0]] + taken[1])
        elif name == "output":
            outputs[ends[into[0]] + into[1]] = reader.real(work[taken[0]])
        elif name in meanings:
            work[into[0]] = meanings[name](*[work[j] for j in taken])
        else:
            raise ConfigurationError(
                f"{function.name()} uses the operation {name!r}, which kernels do not have; "
                f"write it with one of: {', '.join(sorted(meanings))}"
            )
    return _undivided(builder.tape(outputs))


def _starts(sizes: Sequence[int]) -> list[int]:
    starts = [0]
    for size in sizes:
        starts.append(starts[-1] + size)
    return starts


def _undivided(tape: Tape) -> Tape:
    """Reciprocals that serve one product only become the quotient they were written as."""
    uses, code = tape.uses(), list(tape.code)
    lone = [
        op == "div" and uses[k] == 1 and code[operands[0]] == ONE
        for k, (op, operands) in enumerate(code)
    ]
    summed = {k for op, operands in code if op in ("add", "sub") for k in operands}
    for k, (op, operands) in enumerate(tape.code):
        if op != "mul" or (k in summed and uses[k] == 1):
            continue  # a product in a sum is fused: the reciprocal is no dearer, and comes earlier
        for a, b in (operands, operands[::-1]):
            if lone[b]:
                code[k] = Instruction("div", (a, code[b].operands[1]))
                break
    return live(Tape(tape.inputs, code, tape.outputs))
