"""The plain meaning of a tape: numpy operations, one after the other.

All back ends are tested against this one. It has no fused multiply-adds, because numpy has none.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gough.kernels.tape import Instruction, Tape, evaluate, meaning

Array = NDArray[np.float64]
Words = NDArray[np.uint64]
Truths = NDArray[np.bool_]

_LITERALS = {"constant": np.float64, "bits": np.uint64, "flag": np.bool_}


class Reference:
    """The arithmetic of numpy arrays."""

    constant, bits, flag = np.float64, np.uint64, np.bool_
    add, sub, mul, div = np.add, np.subtract, np.multiply, np.divide
    sqrt, neg, abs, floor = np.sqrt, np.negative, np.abs, np.floor
    less, less_equal, equal = np.less, np.less_equal, np.equal
    not_, and_, or_ = np.logical_not, np.logical_and, np.logical_or
    select = np.where
    word_add, word_sub, word_mul = np.add, np.subtract, np.multiply
    word_and, word_or, word_xor = np.bitwise_and, np.bitwise_or, np.bitwise_xor
    word_equal = np.equal
    shift_left, shift_right = np.left_shift, np.right_shift

    @staticmethod
    def to_word(a: Array) -> Words:
        """Bits of a real."""
        return np.asarray(a, np.float64).view(np.uint64)

    @staticmethod
    def to_real(a: Words) -> Array:
        """The real with these bits."""
        return np.asarray(a, np.uint64).view(np.float64)

    @staticmethod
    def careful_sin(wanted: Truths, fast: Array, angle: Array) -> Array:
        """``fast`` where an angle is small, else the sine of the large angle."""
        return _careful("sin", wanted, fast, angle)

    @staticmethod
    def careful_cos(wanted: Truths, fast: Array, angle: Array) -> Array:
        """``fast`` where an angle is small, else the cosine of the large angle."""
        return _careful("cos", wanted, fast, angle)

    @classmethod
    def folded(cls, op: str, literals: Sequence[Instruction]) -> float | int | bool:
        """What an operation makes of literals."""
        given = [_LITERALS[kind](value) for kind, (value,) in literals]
        with np.errstate(all="ignore"):
            result: Any = meaning(cls, op)(*given)
        return np.asarray(result).item()  # type: ignore[no-any-return]


def run(tape: Tape, rows: Array) -> Array:
    """Outputs of a tape without fused operations and functions: (*batch, n) -> (*batch, m)."""
    rows = np.asarray(rows, np.float64)
    columns = [rows[..., k] for k in range(tape.inputs)]
    with np.errstate(all="ignore"):
        outputs = evaluate(tape, Reference, columns)
    shape = (*rows.shape[:-1], len(outputs))
    result = np.empty(shape)
    for k, output in enumerate(outputs):
        result[..., k] = output
    return result


def _careful(name: str, wanted: Truths, fast: Array, angle: Array) -> Array:
    if not np.any(wanted):
        return fast
    from gough.kernels.functions.large_angles import routine  # uses tapes, which use this module

    large = run(routine(name), np.asarray(angle)[..., None])[..., 0]
    return np.where(wanted, large, fast)
