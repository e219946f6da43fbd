"""Writing functions out: a tape in primitives alone, which is what back ends take."""

from __future__ import annotations

from typing import Any

from gough.kernels.builder import Builder
from gough.kernels.functions import FORMULAS
from gough.kernels.tape import FUNCTIONS, LEAVES, Tape, evaluate
from gough.kernels.value import Value


class Expanding:
    """The arithmetic that copies primitives to another tape and writes functions out."""

    def __init__(self, builder: Builder) -> None:
        self.builder = builder

    def __getattr__(self, op: str) -> Any:
        builder, op = self.builder, op.rstrip("_")
        if op in LEAVES:
            return getattr(builder, op)
        if op not in FUNCTIONS:
            return lambda *operands: builder.emit(op, *operands)
        formula = FORMULAS[op]
        return lambda *operands: formula(*[Value(builder, k) for k in operands]).number


def expanded(tape: Tape) -> Tape:
    """The same tape with every function written out."""
    if not any(op in FUNCTIONS for op, _ in tape.code):
        return tape
    builder = Builder(tape.inputs)
    slots = [builder.input(k) for k in range(tape.inputs)]
    return builder.tape(evaluate(tape, Expanding(builder), slots))
