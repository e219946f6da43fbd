"""Random tapes over all primitives, and rows of numbers to run them on.

A NaN has no agreed sign and payload: nothing here looks at the bits of a value that may be NaN, so
the outputs are the same in every back end but for the bits of NaNs (`assert_same`).
"""

from __future__ import annotations

import ctypes
import ctypes.util
import random
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from hypothesis import strategies as st

from gough.kernels.reference import Array, Reference, run
from gough.kernels.tape import (
    LEAVES,
    PRIMITIVES,
    REAL,
    RESULTS,
    TRUTH,
    WORD,
    Instruction,
    Tape,
    evaluate,
)

SPECIAL = (
    *(0.0, -0.0, 1.0, -1.0, 0.5, 2.0, -3.0, 0.1, np.pi, 2.5, -2.5),
    *(np.inf, -np.inf, np.nan, 5e-324, -5e-324, 1e-310, 2.2250738585072014e-308),
    *(1.7976931348623157e308, -1e308, 1e22, 4503599627370496.5, 2.0**53, -(2.0**63), 1e-160, 1e160),
)
BITS = (0, 1, 52, 0x7FF0_0000_0000_0000, 2**63, 2**64 - 1, 0x3FF0_0000_0000_0000, 2**52 - 1)
FUSED = ("fma", "fms", "fnma")
CAREFUL = ("careful_sin", "careful_cos")
INPUTS, OPERATIONS = 6, 40
"""The most inputs of a random tape, and the most operations of one drawn by hypothesis."""

Choose = Callable[[int], int]
"""A whole number from 0 up to, and without, the one given."""


class _Writer:
    """A tape of operations chosen at random; nothing is simplified."""

    def __init__(self, choose: Choose, inputs: int) -> None:
        self.choose, self.inputs = choose, inputs
        self.code: list[Instruction] = []
        self.of_kind: dict[str, list[int]] = {REAL: [], TRUTH: [], WORD: []}
        self.loose: dict[int, None] = {}
        for slot in range(inputs):
            self.leaf("input", slot)

    def write(self, op: str, *operands: int) -> int:
        """An operation on values."""
        for k in operands:
            self.loose.pop(k, None)
        return self._append(Instruction(op, operands))

    def leaf(self, op: str, literal: object) -> int:
        """An input or a literal; literals are written again and again."""
        return self._append(Instruction(op, (literal,)))

    def _append(self, instruction: Instruction) -> int:
        number = len(self.code)
        self.code.append(instruction)
        self.of_kind[RESULTS[instruction.op]].append(number)
        self.loose[number] = None
        return number

    def operand(self, kind: str) -> int:
        """A literal, a late value or any value of a kind."""
        known, manner = self.of_kind[kind], self.choose(8)
        if manner == 0 or not known:
            return self._literal(kind)
        near = min(len(known), 6 if manner < 5 else len(known))
        return known[-1 - self.choose(near)]

    def _literal(self, kind: str) -> int:
        if kind == REAL:
            return self.leaf("constant", SPECIAL[self.choose(len(SPECIAL))])
        if kind == TRUTH:
            return self.leaf("flag", bool(self.choose(2)))
        return self.leaf("bits", BITS[self.choose(len(BITS))])

    def number(self) -> int:
        """A real that is never NaN."""
        x = self.operand(REAL)
        return self.write("select", self.write("equal", x, x), x, self.leaf("constant", 1.0))

    def operation(self, op: str) -> int:
        """An operation on operands of its kinds."""
        if op == "to_word":
            return self.write(op, self.number())
        if op in ("shift_left", "shift_right"):
            return self.write(op, self.operand(WORD), self.leaf("bits", self.choose(64)))
        operands = [self.operand(kind) for kind in PRIMITIVES[op][0]]
        if op in CAREFUL:
            operands[2] = self.number()
        return self.write(op, *operands)

    def tape(self) -> Tape:
        """The tape; outputs are all reals that nothing uses, and the others made real."""
        outputs = [self._real(k) for k in list(self.loose) if self.code[k].op != "input"]
        return Tape(self.inputs, self.code, outputs or [self._literal(REAL)])

    def _real(self, k: int) -> int:
        kind = RESULTS[self.code[k].op]
        if kind == WORD:
            return self.write("to_real", k)
        if kind == TRUTH:
            return self.write("select", k, self.leaf("constant", 1.0), self.leaf("constant", -1.0))
        return k


def _names(fused: bool, careful: bool) -> Sequence[str]:
    """Operations to choose from; those of reals come more often."""
    left_out = {*(() if fused else FUSED), *(() if careful else CAREFUL)}
    names = [op for op in PRIMITIVES if op not in left_out]
    usual = ["add", "sub", "mul", "add", "mul", "mul", "div", "select", "less"]
    return names + usual + (3 * list(FUSED) if fused else [])


def _tape(choose: Choose, operations: int, names: Sequence[str]) -> Tape:
    writer = _Writer(choose, choose(INPUTS + 1))
    for _ in range(operations):
        writer.operation(names[choose(len(names))])
    return writer.tape()


def random_tape(
    rng: np.random.Generator, size: int, fused: bool = False, careful: bool = False
) -> Tape:
    """A tape of ``size`` random operations, and the few that these need.

    Args:
        rng: where chance comes from.
        size: operations chosen; literals, guards against NaN and outputs come on top.
        fused: whether fused multiply-adds occur; compare such tapes by `exact_run`.
        careful: whether `careful_sin` and `careful_cos` occur.
    """
    source = random.Random(int(rng.integers(2**63)))
    return _tape(lambda n: int(source.random() * n), size, _names(fused, careful))


@st.composite
def tapes(draw: Any, fused: bool = False, careful: bool = False) -> Tape:
    """Strategy: tapes as `random_tape` gives them, that shrink."""
    names = _names(fused, careful)
    return _tape(lambda n: draw(st.integers(0, n - 1)), draw(st.integers(1, OPERATIONS)), names)


def special_rows(rng: np.random.Generator, tape: Tape, rows: int) -> Array:
    """Inputs for a tape, (rows, inputs): plain numbers, all sizes, any bits and special ones."""
    shape = (rows, tape.inputs)
    plain = rng.normal(size=shape) * 3
    with np.errstate(over="ignore", under="ignore"):
        sizes = plain * np.exp2(rng.uniform(-1080, 1023, shape))
    bits = rng.integers(0, 2**64, shape, dtype=np.uint64).view(np.float64)
    halves = np.round(plain * 4) / 2
    special = rng.choice(SPECIAL, shape)
    manner = rng.choice(5, shape, p=[0.6, 0.08, 0.04, 0.13, 0.15])
    return np.choose(manner, [plain, sizes, bits, halves, special])


class Exact(Reference):
    """The plain meaning with the fused operations of the C library, number by number."""

    _library = ctypes.CDLL(ctypes.util.find_library("m"))
    _library.fma.restype, _library.fma.argtypes = ctypes.c_double, [ctypes.c_double] * 3
    fma = staticmethod(np.vectorize(_library.fma, otypes=[float]))

    @classmethod
    def fms(cls, a: Array, b: Array, c: Array) -> Any:
        return cls.fma(a, b, np.negative(c))

    @classmethod
    def fnma(cls, a: Array, b: Array, c: Array) -> Any:
        return cls.fma(np.negative(a), b, c)


def exact_run(tape: Tape, rows: Array) -> Array:
    """Outputs of a tape that may have fused operations, (rows, inputs) -> (rows, outputs)."""
    if not any(op in FUSED for op, _ in tape.code):
        return run(tape, rows)
    with np.errstate(all="ignore"):
        outputs = evaluate(tape, Exact, list(rows.T))
    return np.stack([np.broadcast_to(output, len(rows)) for output in outputs], axis=-1)


def differences(found: Array, expected: Array) -> Array:
    """Places where two arrays differ in bits, all NaNs being the same; (count, axes)."""
    found, expected = np.ascontiguousarray(found), np.ascontiguousarray(expected)
    assert found.shape == expected.shape
    same_bits = found.view(np.uint64) == expected.view(np.uint64)
    return np.argwhere(~(same_bits | (np.isnan(found) & np.isnan(expected))))


def assert_same(found: Array, expected: Array) -> None:
    """Fail unless two arrays have the same bits, all NaNs being the same."""
    places = differences(found, expected)
    if len(places):
        at = tuple(places[0])
        raise AssertionError(
            f"{len(places)} of {found.size} numbers differ, first at {at}: "
            f"{found[at].hex()} instead of {expected[at].hex()}"
        )


def listing(tape: Tape) -> str:
    """A tape in words, for messages."""
    lines = [
        f"{k}: {op} {' '.join(repr(x) if op in LEAVES else f'v{x}' for x in operands)}"
        for k, (op, operands) in enumerate(tape.code)
    ]
    return "\n".join([*lines, f"outputs {list(tape.outputs)}"])
