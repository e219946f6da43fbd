"""The operations of a tape as LLVM instructions on one number or on several lanes at once."""

from __future__ import annotations

import struct

ROUTINES = "gough_large_"
"""How the names of the functions of large angles begin."""
_DIRECT = {
    "add": "fadd",
    "sub": "fsub",
    "mul": "fmul",
    "div": "fdiv",
    "less": "fcmp olt",
    "less_equal": "fcmp ole",
    "equal": "fcmp oeq",
}
_WORDS = {
    "word_add": "add",
    "word_sub": "sub",
    "word_mul": "mul",
    "word_and": "and",
    "word_or": "or",
    "word_xor": "xor",
    "word_equal": "icmp eq",
    "shift_left": "shl",
    "shift_right": "lshr",
}


class Lanes:
    """An arithmetic whose values are names in LLVM text; ``lines`` grows with every operation.

    There are no fast-math flags anywhere: each instruction rounds as IEEE 754 says, so that all
    numbers of lanes give the same bits.
    """

    def __init__(self, width: int) -> None:
        self.width = width
        self.real, self.word, self.truth = (_vector(t, width) for t in ("double", "i64", "i1"))
        self._suffix = "f64" if width == 1 else f"v{width}f64"
        self.lines: list[str] = []
        self.block = "entry"
        """The label of the basic block that is being written."""
        self.declarations: set[str] = set()
        self._count = 0

    def new(self, text: str) -> str:
        """A new name for the result of an instruction."""
        self._count += 1
        name = f"%v{self._count}"
        self.lines.append(f"  {name} = {text}")
        return name

    def label(self) -> str:
        """A new name for a basic block."""
        self._count += 1
        return f"b{self._count}"

    def start_block(self, label: str) -> None:
        """What follows stands in another basic block."""
        self.lines.append(f"{label}:")
        self.block = label

    def __getattr__(self, op: str) -> object:
        """Operations that are one instruction on two operands of one type."""
        if op in _DIRECT:
            return lambda a, b: self.new(f"{_DIRECT[op]} {self.real} {a}, {b}")
        if op in _WORDS:
            return lambda a, b: self.new(f"{_WORDS[op]} {self.word} {a}, {b}")
        raise AttributeError(op)

    # leaves

    def constant(self, value: float) -> str:
        """A real literal in hexadecimal, exact."""
        bits = struct.unpack("<Q", struct.pack("<d", value))[0]
        return self._splat("double", f"0x{bits:016X}")

    def bits(self, value: int) -> str:
        """A word literal."""
        return self._splat("i64", str(value))

    def flag(self, value: bool) -> str:
        """A truth literal."""
        return self._splat("i1", "true" if value else "false")

    def _splat(self, kind: str, literal: str) -> str:
        return literal if self.width == 1 else f"splat ({kind} {literal})"

    # operations

    def _call(self, name: str, *operands: str) -> str:
        full = f"@llvm.{name}.{self._suffix}"
        self.declarations.add(
            f"declare {self.real} {full}({', '.join([self.real] * len(operands))})"
        )
        return self.new(
            f"call {self.real} {full}({', '.join(f'{self.real} {a}' for a in operands)})"
        )

    def sqrt(self, a: str) -> str:
        """√a."""
        return self._call("sqrt", a)

    def abs(self, a: str) -> str:
        """|a|."""
        return self._call("fabs", a)

    def floor(self, a: str) -> str:
        """Largest whole number not above a."""
        return self._call("floor", a)

    def neg(self, a: str) -> str:
        """-a."""
        return self.new(f"fneg {self.real} {a}")

    def fma(self, a: str, b: str, c: str) -> str:
        """a b + c."""
        return self._call("fma", a, b, c)

    def fms(self, a: str, b: str, c: str) -> str:
        """a b - c."""
        return self._call("fma", a, b, self.neg(c))

    def fnma(self, a: str, b: str, c: str) -> str:
        """c - a b."""
        return self._call("fma", self.neg(a), b, c)

    def not_(self, a: str) -> str:
        """Not a."""
        return self.new(f"xor {self.truth} {a}, {self.flag(True)}")

    def and_(self, a: str, b: str) -> str:
        """Both."""
        return self.new(f"and {self.truth} {a}, {b}")

    def or_(self, a: str, b: str) -> str:
        """Either."""
        return self.new(f"or {self.truth} {a}, {b}")

    def select(self, condition: str, a: str, b: str) -> str:
        """``a`` where the condition holds, else ``b``."""
        return self.new(f"select {self.truth} {condition}, {self.real} {a}, {self.real} {b}")

    def to_word(self, a: str) -> str:
        """The bits of a real."""
        return self.new(f"bitcast {self.real} {a} to {self.word}")

    def to_real(self, a: str) -> str:
        """The real with these bits."""
        return self.new(f"bitcast {self.word} {a} to {self.real}")

    def careful_sin(self, wanted: str, fast: str, angle: str) -> str:
        """``fast``, but the sine of a large angle where wanted."""
        return self._rarely("sin", wanted, fast, angle)

    def careful_cos(self, wanted: str, fast: str, angle: str) -> str:
        """``fast``, but the cosine of a large angle where wanted."""
        return self._rarely("cos", wanted, fast, angle)

    def _rarely(self, routine: str, wanted: str, fast: str, angle: str) -> str:
        """A call behind a branch that is taken only if a lane wants it."""
        rare, after, before = self.label(), self.label(), self.block
        self.lines.append(f"  br i1 {self.any(wanted)}, label %{rare}, label %{after}, !prof !1")
        self.start_block(rare)
        name = routine_name(routine, self.width)
        self.declarations.add(f"declare {self.real} @{name}({self.real}) #1")
        large = self.new(f"call {self.real} @{name}({self.real} {angle})")
        merged = self.select(wanted, large, fast)
        self.lines.append(f"  br label %{after}")
        self.start_block(after)
        return self.new(f"phi {self.real} [{fast}, %{before}], [{merged}, %{rare}]")

    def any(self, truth: str) -> str:
        """Whether a truth value holds in any lane, an i1."""
        if self.width == 1:
            return truth
        packed = self.new(f"bitcast {self.truth} {truth} to i{self.width}")
        return self.new(f"icmp ne i{self.width} {packed}, 0")


def routine_name(routine: str, width: int) -> str:
    """Name of the function of large angles for a number of lanes."""
    return f"{ROUTINES}{routine}_{width}"


def attributes(width: int) -> str:
    """What the functions of a module are told: #0 usual ones, #1 those that are rarely called."""
    bits = 64 * width
    registers = f'"prefer-vector-width"="{bits}" "min-legal-vector-width"="{bits}"'
    return (
        f"attributes #0 = {{ nounwind {registers} }}\n"
        f"attributes #1 = {{ nounwind noinline cold {registers} }}\n"
        '!0 = !{}\n!1 = !{!"branch_weights", i32 1, i32 1048576}\n'
    )


def _vector(kind: str, width: int) -> str:
    return kind if width == 1 else f"<{width} x {kind}>"
