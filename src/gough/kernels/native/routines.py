"""Sine and cosine of large angles in machine code, made once for all kernels of a process.

Kernels call them by name behind a branch (`lanes`), so a kernel's own code stays short.
"""

from __future__ import annotations

import re

import llvmlite.binding as llvm

from gough.kernels.functions.large_angles import routine
from gough.kernels.native.lanes import ROUTINES, Lanes, attributes, routine_name
from gough.kernels.tape import evaluate


def wanted(code: bytes) -> list[int]:
    """For which numbers of lanes machine code calls the routines, by the names that stand in it."""
    found = re.findall(re.escape(ROUTINES).encode() + rb"(?:sin|cos)_(\d)", code)
    return sorted({int(width) for width in found})


def text(width: int) -> str:
    """The module of both routines for a number of lanes."""
    functions, declarations = [], set()
    for name in ("sin", "cos"):
        lanes = Lanes(width)
        (result,) = evaluate(routine(name), lanes, ["%angle"])
        declarations |= lanes.declarations
        head = f"define {lanes.real} @{routine_name(name, width)}({lanes.real} %angle) #1 {{"
        functions += [head, "entry:", *lanes.lines, f"  ret {lanes.real} {result}", "}"]
    return "\n".join([*functions, *sorted(declarations), attributes(width)])


def publish(width: int, address_of: dict[str, int]) -> None:
    """Let code that is loaded from now on find the routines."""
    for name in ("sin", "cos"):
        symbol = routine_name(name, width)
        llvm.add_symbol(symbol, address_of[symbol])
