"""Formulas on tapes: values with the operators of Python.

    x = Value.input(builder, 0)
    y = where(x < 0, -x, sqrt(x) * 2.0)

Reals take floats, words take whole numbers as the other operand. Nothing is reordered.
"""

from __future__ import annotations

from typing import TypeAlias

from gough.kernels.builder import Builder
from gough.kernels.tape import REAL, TRUTH, WORD

Number: TypeAlias = "Value | float | int"


class Value:
    """One value of a tape that is being written."""

    __slots__ = ("builder", "number")

    def __init__(self, builder: Builder, number: int) -> None:
        self.builder = builder
        self.number = number

    @classmethod
    def input(cls, builder: Builder, slot: int) -> Value:
        """An input of the tape."""
        return cls(builder, builder.input(slot))

    @property
    def kind(self) -> str:
        """real, truth or word."""
        return self.builder.kind(self.number)

    def emit(self, op: str, *others: Number) -> Value:
        """An operation on this value and others; literals take this value's kind."""
        kind = self.kind
        numbers = [self._operand(other, kind) for other in others]
        return Value(self.builder, self.builder.emit(op, self.number, *numbers))

    def _operand(self, other: Number, kind: str) -> int:
        if isinstance(other, Value):
            return other.number
        return self.builder.literal(kind, other)

    def like(self, literal: float | int) -> Value:
        """A literal of this value's kind."""
        return Value(self.builder, self.builder.literal(self.kind, literal))

    def _by_kind(self, real: str, word: str) -> str:
        assert self.kind in (REAL, WORD)
        return real if self.kind == REAL else word

    def __add__(self, other: Number) -> Value:
        return self.emit(self._by_kind("add", "word_add"), other)

    def __radd__(self, other: Number) -> Value:
        return self.like(other) + self if not isinstance(other, Value) else other + self

    def __sub__(self, other: Number) -> Value:
        return self.emit(self._by_kind("sub", "word_sub"), other)

    def __rsub__(self, other: float | int) -> Value:
        return self.like(other) - self

    def __mul__(self, other: Number) -> Value:
        return self.emit(self._by_kind("mul", "word_mul"), other)

    def __rmul__(self, other: float | int) -> Value:
        return self.like(other) * self

    def __truediv__(self, other: Number) -> Value:
        return self.emit("div", other)

    def __rtruediv__(self, other: float | int) -> Value:
        return self.like(other) / self

    def __neg__(self) -> Value:
        return self.emit("neg")

    def __abs__(self) -> Value:
        return self.emit("abs")

    def __lt__(self, other: Number) -> Value:
        return self.emit("less", other)

    def __le__(self, other: Number) -> Value:
        return self.emit("less_equal", other)

    def __gt__(self, other: Number) -> Value:
        return (other if isinstance(other, Value) else self.like(other)) < self

    def __ge__(self, other: Number) -> Value:
        return (other if isinstance(other, Value) else self.like(other)) <= self

    def equals(self, other: Number) -> Value:
        """Whether two reals or two words are equal."""
        return self.emit(self._by_kind("equal", "word_equal"), other)

    def __and__(self, other: Number) -> Value:
        return self.emit("and" if self.kind == TRUTH else "word_and", other)

    def __or__(self, other: Number) -> Value:
        return self.emit("or" if self.kind == TRUTH else "word_or", other)

    def __xor__(self, other: Number) -> Value:
        return self.emit("word_xor", other)

    def __invert__(self) -> Value:
        return self.emit("not")

    def __lshift__(self, places: int) -> Value:
        return self.emit("shift_left", places)

    def __rshift__(self, places: int) -> Value:
        return self.emit("shift_right", places)

    def word(self) -> Value:
        """The bits of a real."""
        return self.emit("to_word")

    def real(self) -> Value:
        """The real with these bits."""
        return self.emit("to_real")


def where(condition: Value, a: Value | float, b: Value | float) -> Value:
    """``a`` where the condition holds, else ``b``."""
    builder = condition.builder
    pair = [x.number if isinstance(x, Value) else builder.constant(x) for x in (a, b)]
    return Value(builder, builder.emit("select", condition.number, *pair))


def sqrt(x: Value) -> Value:
    """Square root."""
    return x.emit("sqrt")


def floor(x: Value) -> Value:
    """Largest whole number not above x."""
    return x.emit("floor")


def polynomial(x: Value, coefficients: list[float]) -> Value:
    """c₀ + c₁ x + c₂ x² …, by Horner's rule; coefficients from the constant one up."""
    result: Value | float = coefficients[-1]
    for c in reversed(coefficients[:-1]):
        result = result * x + c
    assert isinstance(result, Value)
    return result
