"""How fast this processor can be: fused multiply-adds, divisions and square roots in a row."""

from __future__ import annotations

import ctypes
import statistics
import time
from typing import NamedTuple

import numpy as np

from gough.kernels.native.machine import Loaded, host

CHAINS = 16
"""Independent chains, enough to hide the time one operation takes."""
TURNS = 20_000


class Throughput(NamedTuple):
    """Time of one operation on one number in the widest registers, ns."""

    fma: float
    div: float
    sqrt: float

    @classmethod
    def measured(cls) -> Throughput:
        """Medians on this processor."""
        return cls(*(_time(name) for name in cls._fields))


def _time(operation: str) -> float:
    width = host().width
    loaded = Loaded(host().object_code(_text(operation, width), 2))
    run = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_int64)(loaded.address("run"))
    numbers = np.ones(width * (CHAINS + 2))
    taken = []
    for _ in range(21):
        start = time.perf_counter()
        run(numbers.ctypes.data, TURNS)
        taken.append(time.perf_counter() - start)
    return statistics.median(taken) / (TURNS * CHAINS * width) * 1e9


def _text(operation: str, width: int) -> str:
    real, suffix = f"<{width} x double>", f"v{width}f64"
    step = {
        "fma": f"call {real} @llvm.fma.{suffix}({real} %c{{k}}, {real} %a, {real} %b)",
        "div": f"fdiv {real} %a, %c{{k}}",
        "sqrt": f"call {real} @llvm.sqrt.{suffix}({real} %c{{k}})",
    }[operation]
    place = "getelementptr double, ptr %numbers, i64"
    loads, chains, steps, stores = [], [], [], []
    for k in range(CHAINS):
        loads += [f"%p{k} = {place} {k * width}", f"%s{k} = load {real}, ptr %p{k}, align 8"]
        chains.append(f"%c{k} = phi {real} [%s{k}, %entry], [%n{k}, %loop]")
        steps.append(f"%n{k} = {step.format(k=k)}")
        stores.append(f"store {real} %n{k}, ptr %p{k}, align 8")
    return f"""
declare {real} @llvm.fma.{suffix}({real}, {real}, {real})
declare {real} @llvm.sqrt.{suffix}({real})
define void @run(ptr %numbers, i64 %turns) #0 {{
entry:
%pa = {place} {CHAINS * width}
%a = load {real}, ptr %pa, align 8
%pb = {place} {(CHAINS + 1) * width}
%b = load {real}, ptr %pb, align 8
{chr(10).join(loads)}
br label %loop
loop:
%i = phi i64 [0, %entry], [%next, %loop]
{chr(10).join(chains)}
{chr(10).join(steps)}
%next = add i64 %i, 1
%more = icmp slt i64 %next, %turns
br i1 %more, label %loop, label %exit
exit:
{chr(10).join(stores)}
ret void
}}
attributes #0 = {{ "prefer-vector-width"="{64 * width}" "min-legal-vector-width"="{64 * width}" }}
"""
