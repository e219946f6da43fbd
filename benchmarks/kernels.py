"""What kernels cost: ``python -m benchmarks.kernels`` [--json] [--no-numba].

All figures are taken in one run; those of one row of a table are taken in turns, and their medians
are given. The hardware bound is the longer of two times, both measured here: arithmetic at the rate
of fused multiply-adds, and divisions and roots at theirs.
"""

from __future__ import annotations

import argparse
import ctypes
import json
import os
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
import timeit
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import casadi
import numpy as np

import gough
from benchmarks import six_ups
from benchmarks.throughput import Throughput
from gough.kernels import Kernel
from gough.kernels.native.machine import Loaded, host, level_for
from gough.kernels.native.store import load
from gough.kernels.native.text import ENTRY, KernelText

ROWS = 128
"""Rows of a batch that stays in the nearest cache."""
ARITHMETIC = ("mul", "add", "fma", "select", "compare")
SAMPLES = 25
REPEAT = """
define void @repeat(ptr %kernel, ptr %pointers, ptr %steps, i64 %rows, i64 %times) {
entry:
  br label %loop
loop:
  %i = phi i64 [0, %entry], [%next, %loop]
  call void %kernel(ptr %pointers, ptr %steps, i64 %rows)
  %next = add i64 %i, 1
  %more = icmp slt i64 %next, %times
  br i1 %more, label %loop, label %exit
exit:
  ret void
}
"""


def in_turns(runs: dict[str, Callable[[], Any]], rows: int) -> dict[str, float]:
    """Median time of each run in ns for a row, all taken in turns."""
    times: dict[str, list[float]] = {name: [] for name in runs}
    for run in runs.values():
        run()
    for _ in range(SAMPLES):
        for name, run in runs.items():
            start = time.perf_counter()
            run()
            times[name].append(time.perf_counter() - start)
    return {name: statistics.median(taken) / rows * 1e9 for name, taken in times.items()}


class Repeated:
    """Machine code of a program called again and again without Python in between."""

    def __init__(self, kernel: Kernel, width: int, times: int, machine: Any = None) -> None:
        sizes = [size for size in kernel.inputs.values() if size]
        text = str(KernelText(kernel.program, sizes, width, 4000))
        level = level_for(kernel.program.operations)
        self._loaded = load((machine or host()).object_code(text, level))
        self._repeat = Loaded(host().object_code(REPEAT, 2))
        self._kernel, self._times = self._loaded.address(ENTRY), times
        kinds = [ctypes.c_void_p] * 3 + [ctypes.c_int64] * 2
        self._call = ctypes.CFUNCTYPE(None, *kinds)(self._repeat.address("repeat"))

    def on(self, arrays: list[np.ndarray], numbers: int) -> Callable[[], None]:
        """The repeated call on some rows."""
        rows = len(arrays[0])
        operands = [*arrays, np.empty((rows, numbers))]
        pointers = np.array([array.ctypes.data for array in operands])
        steps = np.array([array.strides[0] for array in operands])
        kept = (operands, pointers, steps, self)

        def run() -> None:
            assert kept
            self._call(self._kernel, pointers.ctypes.data, steps.ctypes.data, rows, self._times)

        return run


def casadi_c(function: casadi.Function, rows: np.ndarray, times: int, *flags: str) -> Any:
    """CasADi's C code of a function of one vector, compiled and called in a native loop."""
    folder = Path(tempfile.mkdtemp())
    function.generate("generated.c", {"with_header": False})
    shutil.move("generated.c", folder / "generated.c")
    name = function.name()
    (folder / "loop.c").write_text(
        '#include "generated.c"\n'
        "void loop(const double* x, double* y, long rows, long nx, long ny, long times) {\n"
        f"  casadi_real w[{max(1, function.sz_w())}]; casadi_int iw[{max(1, function.sz_iw())}];\n"
        "  for (long k = 0; k < times; ++k) for (long i = 0; i < rows; ++i) {\n"
        "    const double* in[1] = {x + i*nx}; double* out[1] = {y + i*ny};\n"
        f"    {name}(in, out, iw, w, 0);\n  }}\n}}\n"
    )
    library = folder / "loop.so"
    command = ["gcc", "-shared", "-fPIC", *flags, "-o", str(library), str(folder / "loop.c"), "-lm"]
    subprocess.run(command, check=True, capture_output=True)
    loop = ctypes.CDLL(str(library)).loop
    out = np.empty((len(rows), function.nnz_out(0)))
    sizes = [ctypes.c_long(n) for n in (len(rows), rows.shape[1], out.shape[1], times)]
    return lambda: loop(ctypes.c_void_p(rows.ctypes.data), ctypes.c_void_p(out.ctypes.data), *sizes)


def by_numba(kernel: Kernel, rows: np.ndarray, times: int) -> Any:
    """The tape as Python source compiled by numba, called in a compiled loop."""
    import numba

    signs = {"add": "+", "sub": "-", "mul": "*", "div": "/", "less": "<", "less_equal": "<="}
    lines = ["def f(x, y):"]
    for k, (op, o) in enumerate(kernel.tape.code):
        if op in signs:
            value = f"v{o[0]} {signs[op]} v{o[1]}"
        else:
            value = {
                "input": "x[{0}]",
                "constant": "{0!r}",
                "sqrt": "math.sqrt(v{0})",
                "neg": "-v{0}",
                "abs": "abs(v{0})",
                "select": "v{1} if v{0} else v{2}",
            }[op].format(*o)
        lines.append(f"    v{k} = {value}")
    lines += [f"    y[{k}] = v{j}" for k, j in enumerate(kernel.tape.outputs)]
    scope: dict[str, Any] = {"math": __import__("math")}
    exec("\n".join(lines), scope)
    f = numba.njit(scope["f"])
    out = np.empty((len(rows), len(kernel.tape.outputs)))

    @numba.njit
    def loop(x: Any, y: Any, times: int) -> None:
        for _ in range(times):
            for i in range(len(x)):
                f(x[i], y[i])

    return lambda: loop(rows, out, times)


def bound(kernel: Kernel, throughput: Throughput) -> float:
    """The least time for a row that the processor could take, ns."""
    counts = kernel.program.counts()
    arithmetic = sum(counts.get(name, 0) for name in ARITHMETIC) * throughput.fma
    divider = counts.get("div", 0) * throughput.div + counts.get("sqrt", 0) * throughput.sqrt
    return max(arithmetic, divider)


def inverse_dynamics(throughput: Throughput, with_numba: bool) -> dict[str, Any]:
    """The hand-written inverse dynamics of a 6-UPS platform, by all ways."""
    kernel, rows = six_ups.kernel(), six_ups.states(ROWS)
    x, forces = six_ups.inverse_dynamics()
    function = casadi.Function("id6", [x], [forces])
    mapped, columns = function.map(ROWS), casadi.DM(rows.T)
    times, width = 50, host().width
    runs = {
        "wide": Repeated(kernel, width, times).on([rows], 6),
        "scalar": Repeated(kernel, 1, times).on([rows], 6),
    }
    if width == 8:
        narrow = host().without("avx512")
        runs["4 lanes"] = Repeated(kernel, 4, times, narrow).on([rows], 6)
    plain = Kernel("plain", {"x": x}, forces, (6,), fuse=False)
    runs["wide, unfused"] = Repeated(plain, width, times).on([rows], 6)
    if shutil.which("gcc"):
        runs["casadi C, -O3"] = casadi_c(function, rows, times, "-O3")
        runs["casadi C, -O3 -march=native"] = casadi_c(
            function, rows, times, "-O3", "-march=native"
        )
    if with_numba:
        runs["numba"] = by_numba(kernel, rows, times)
    ns = in_turns(runs, ROWS * times)
    ns |= in_turns({"casadi map": partial(mapped, columns)}, ROWS)
    row = rows[0].copy()
    kernel(rows)
    ns["casadi, one call"] = in_turns({"call": lambda: [function(row) for _ in range(200)]}, 200)[
        "call"
    ]
    return {
        "operations": kernel.tape.counts()["total"],
        "ns_per_row": ns["wide"],
        "casadi_c_ns": ns.get("casadi C, -O3"),
        "ratio_to_casadi_c": ns["casadi C, -O3"] / ns["wide"] if "casadi C, -O3" in ns else None,
        "bound_ns": bound(kernel, throughput),
        "share_of_bound": bound(kernel, throughput) / ns["wide"],
        "call_overhead_us": call_overhead(kernel, row, ns["scalar"]),
        "first_result_ms": started(warm=False),
        "cache_load_ms": started(warm=True, prepared=True),
        "cache_load_of_first_kernel_ms": started(warm=True),
        "ways_ns": ns,
    }


def call_overhead(kernel: Kernel, row: np.ndarray, kernel_ns: float) -> float:
    """One call from Python on one row, less the kernel's own time, µs."""
    kernel(row)
    best = [min(timeit.repeat(lambda: kernel(row), number=2000, repeat=1)) for _ in range(SAMPLES)]
    return statistics.median(best) / 2000 * 1e6 - kernel_ns * 1e-3


CHILD = """
import time, sys
import casadi, numpy as np
import gough.kernels.native.compilation
from benchmarks import six_ups
def first_result(x, y):
    row = np.ones(x.numel())
    start = time.perf_counter()
    gough.kernels.Kernel("k", {{"x": x}}, y, (y.numel(),))(row)
    print(1e3 * (time.perf_counter() - start))
if {prepared}:  # the processor is known and the loop that all kernels share is loaded
    x = casadi.SX.sym("x")
    first_result(x, x + 1)
first_result(*{expression})
"""


def started(
    warm: bool,
    expression: str = "six_ups.inverse_dynamics()",
    prepared: bool = False,
    runs: int = 7,
) -> float:
    """From an expression to its first result in a new process, imports done; median in ms."""
    program = CHILD.format(expression=expression, prepared=prepared)
    found = []
    with tempfile.TemporaryDirectory() as kept:
        for k in range(runs + 1):
            with tempfile.TemporaryDirectory() as new:
                environment = {**os.environ, "GOUGH_CACHE_DIR": kept if warm else new}
                done = subprocess.run(
                    [sys.executable, "-c", program],
                    env=environment,
                    capture_output=True,
                    text=True,
                    check=True,
                )
                if k:
                    found.append(float(done.stdout.split()[-1]))
    return statistics.median(found)


def large() -> tuple[casadi.SX, casadi.SX]:
    """An expression of some 30 000 operations."""
    x, forces = six_ups.inverse_dynamics()
    function = casadi.Function("f", [x], [forces])
    parts = [function(x * (1 + 0.01 * k)) for k in range(16)]
    return x, casadi.vertcat(*parts)


def closure(name: str) -> dict[str, Any]:
    """Closure residual and Jacobian of a robot of the catalogue."""
    robot = gough.load(name)
    models, found = robot.models, {}
    q = robot.home.q + 0.01 * np.random.default_rng(1).normal(size=(ROWS, models.positions))
    for label in ("residual", "jacobian"):
        kernel = getattr(models, label)
        numbers = int(np.prod(kernel.shape))
        mapped, columns = kernel.expression.map(ROWS), casadi.DM(q.T)
        runs = {
            "wide": Repeated(kernel, host().width, 50).on([q], numbers),
            "scalar": Repeated(kernel, 1, 50).on([q], numbers),
        }
        ns = in_turns(runs, 50 * ROWS)
        by_map = {"casadi map": partial(mapped, columns, casadi.DM(0, ROWS))}
        ns |= in_turns(by_map, ROWS)
        found[label] = {"operations": kernel.tape.counts()["total"], "ways_ns": ns}
    return found


def measured(with_numba: bool) -> dict[str, Any]:
    """All figures."""
    throughput = Throughput.measured()
    large_one = "__import__('benchmarks.kernels').kernels.large()"
    x, forces = large()
    large_kernel = Kernel("large", {"x": x}, forces)
    return {
        "processor": host().cpu,
        "lanes": host().width,
        "throughput_ns": throughput._asdict(),
        "inverse_dynamics_6ups": inverse_dynamics(throughput, with_numba),
        "operations_30000": {
            "operations": large_kernel.tape.counts()["total"],
            "first_result_ms": started(False, large_one, runs=3),
            "cache_load_ms": started(True, large_one, runs=3),
        },
        "closure": {name: closure(name) for name in ("orthoglide", "gough-stewart")},
    }


def printed(result: dict[str, Any]) -> None:
    """The figures as text."""

    def show(value: Any, indent: int) -> None:
        for key, entry in value.items():
            if isinstance(entry, dict):
                print(f"{' ' * indent}{key}")
                show(entry, indent + 2)
            else:
                text = f"{entry:.4g}" if isinstance(entry, float) else entry
                print(f"{' ' * indent}{key:<{36 - indent}}{text}")

    show(result, 0)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    parser.add_argument("--no-numba", action="store_true", help="leave numba out: it takes long")
    options = parser.parse_args()
    result = measured(not options.no_numba)
    if options.json:
        print(json.dumps(result))
    else:
        printed(result)


if __name__ == "__main__":
    main()
