"""Choosing fused multiply-adds, on the tape, so that every back end rounds in the same places."""

from __future__ import annotations

from gough.kernels.builder import live
from gough.kernels.tape import Instruction, Tape


def fused(tape: Tape) -> Tape:
    """The tape with a·b + c, a·b - c, c - a·b in one rounding where the product has no other use.

    Of two products in one sum the second becomes part of the fused operation.
    """
    uses = tape.uses()
    lone = [op == "mul" and uses[k] == 1 for k, (op, _) in enumerate(tape.code)]
    code = list(tape.code)
    for k, (op, operands) in enumerate(tape.code):
        if op in ("add", "sub"):
            a, b = operands
            if lone[b]:
                fused_op = "fma" if op == "add" else "fnma"
                code[k] = Instruction(fused_op, (*tape.code[b].operands, a))
            elif lone[a]:
                fused_op = "fma" if op == "add" else "fms"
                code[k] = Instruction(fused_op, (*tape.code[a].operands, b))
    return live(Tape(tape.inputs, code, tape.outputs))
