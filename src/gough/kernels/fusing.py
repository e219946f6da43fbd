"""Choosing fused multiply-adds, on the tape, so that every back end rounds in the same places."""

from __future__ import annotations

from gough.kernels.builder import live
from gough.kernels.tape import Instruction, Tape


def fused(tape: Tape) -> Tape:
    """The tape with a·b + c, a·b - c, c - a·b in one rounding where the product has no other use.

    Of two products in one sum the second becomes part of the fused operation. A difference of two
    products stays as it is: with one of them unrounded it would not be 0 where they are equal, and
    a root of x·x - y·y would be NaN there.
    """
    uses = tape.uses()
    product = [op == "mul" for op, _ in tape.code]
    lone = [product[k] and uses[k] == 1 for k in range(len(tape.code))]
    code = list(tape.code)
    for k, (op, operands) in enumerate(tape.code):
        if op not in ("add", "sub"):
            continue
        a, b = operands
        if op == "sub" and product[a] and product[b]:
            continue
        if lone[b]:
            code[k] = Instruction("fma" if op == "add" else "fnma", (*tape.code[b].operands, a))
        elif lone[a]:
            code[k] = Instruction("fma" if op == "add" else "fms", (*tape.code[a].operands, b))
    return live(Tape(tape.inputs, code, tape.outputs))
