"""Programs that run exported models on recorded states and compare every bit."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from gough.exporting.models import Exported, c_name
from gough.exporting.records import Records

Array = NDArray[np.float64]

_TEST = """\
/* Tests the models of {robot}: {rows} recorded states, of which every bit has to come out again.
 * {build}
 * Prints PASS and returns 0, or says what differs, prints FAIL and returns 1. */
"""

_C_HEAD = """\
#include <stdio.h>
#include <string.h>

{includes}
#define ROWS {rows}
"""

_CHECK = """
/* Whether two numbers have the same bits; all NaNs are the same. */
static int same(double a, double b)
{
    return (a != a && b != b) || memcmp(&a, &b, sizeof a) == 0;
}

static int check(const char *model, size_t width, const double *found, const double *expected)
{
    for (size_t k = 0; k < ROWS * width; ++k) {
        if (!same(found[k], expected[k])) {
            printf("%s: state %lu, number %lu is %.17g instead of %.17g\\n", model,
                (unsigned long)(k / width), (unsigned long)(k % width), found[k], expected[k]);
            return 1;
        }
    }
    printf("%s: the same bits in %d states\\n", model, ROWS);
    return 0;
}
"""

_C_MODEL = """
static int {name}(void)
{{
    static double out[ROWS * {width}];
    {prefix}_{name}_batch(ROWS, {inputs}, out);
    if (check("{name}", {width}, out, out_{name}))
        return 1;
    {prefix}_{name}({inputs}, out);
    for (size_t k = 0; k < {width}; ++k) {{
        if (!same(out[k], out_{name}[k])) {{
            printf("{name}: number %lu of one row differs from that of many\\n", (unsigned long)k);
            return 1;
        }}
    }}
    return 0;
}}
"""

_CUDA_HEAD = """\
#include <cstdio>
#include <cstdlib>
#include <cstring>

{includes}
#define ROWS {rows}
"""

_CUDA_HELPERS = """
static void require(cudaError_t error)
{
    if (error != cudaSuccess) {
        printf("CUDA: %s\\nFAIL\\n", cudaGetErrorString(error));
        exit(1);
    }
}

static double *on_device(const double *numbers, size_t bytes)
{
    double *found = NULL;
    require(cudaMalloc((void **)&found, bytes));
    if (numbers)
        require(cudaMemcpy(found, numbers, bytes, cudaMemcpyHostToDevice));
    return found;
}
"""

_CUDA_MODEL = """
static int {name}(void)
{{
    static double out[ROWS * {width}];
{copies}    double *const result = on_device(NULL, sizeof out);
    {prefix}_{name}_batch<<<1, 64>>>(ROWS, {devices}, result);
    require(cudaGetLastError());
    require(cudaMemcpy(out, result, sizeof out, cudaMemcpyDeviceToHost));
{frees}    require(cudaFree(result));
    return check("{name}", {width}, out, out_{name});
}}
"""

_MAIN = """
int main(void)
{{
    int failed = 0;
{calls}
    puts(failed ? "FAIL" : "PASS");
    return failed ? 1 : 0;
}}
"""


def trial(language: str, robot: str, models: Sequence[Exported], records: Records) -> str:
    """The text of the program; it stands in the folder of the models.

    Args:
        language: "c" or "cuda".
        robot: its name.
        models: those that are tested.
        records: their inputs and results.
    """
    cuda, prefix = language == "cuda", c_name(robot)
    rows = len(next(iter(records.results.values()), ()))
    build = (
        f"Compile: nvcc -o test test_{prefix}.cu"
        if cuda
        else "Compile: cc -std=c99 -O2 -ffp-contract=off *.c -lm -o test"
    )
    ending = "cu" if cuda else "h"
    includes = "".join(f'#include "{prefix}_{model.name}.{ending}"\n' for model in models)
    head = _CUDA_HEAD if cuda else _C_HEAD
    shown = robot.replace("*/", "* /").replace("\n", " ")
    parts = [
        _TEST.format(robot=shown, rows=rows, build=build),
        head.format(includes=includes, rows=rows),
        *(_array(f"in_{label}", values) for label, values in records.inputs.items()),
        *(_array(f"out_{name}", values) for name, values in records.results.items()),
        _CHECK,
        _CUDA_HELPERS if cuda else "",
        *(_cuda_model(prefix, m) if cuda else _c_model(prefix, m) for m in models),
        _MAIN.format(calls="\n".join(f"    failed += {model.name}();" for model in models)),
    ]
    return "".join(parts)


def _c_model(prefix: str, model: Exported) -> str:
    inputs = ", ".join(f"in_{label}" for label in model.inputs)
    return _C_MODEL.format(prefix=prefix, name=model.name, width=model.width, inputs=inputs)


def _cuda_model(prefix: str, model: Exported) -> str:
    copies = "".join(
        f"    double *const {label} = on_device(in_{label}, sizeof in_{label});\n"
        for label in model.inputs
    )
    frees = "".join(f"    require(cudaFree({label}));\n" for label in model.inputs)
    return _CUDA_MODEL.format(
        prefix=prefix,
        name=model.name,
        width=model.width,
        devices=", ".join(model.inputs),
        copies=copies,
        frees=frees,
    )


def _array(name: str, values: Array) -> str:
    """A constant array, a line for every row."""
    lines = "".join(f"    {', '.join(_literals(row))},\n" for row in values.tolist())
    return f"\nstatic const double {name}[ROWS * {values.shape[1]}] = {{\n{lines}}};\n"


def _literals(row: Iterable[float]) -> list[str]:
    return [_literal(x) for x in row]


def _literal(x: float) -> str:
    """A number as C reads it, exactly."""
    if x != x:
        return "(0.0 / 0.0)"
    if x in (float("inf"), float("-inf")):
        return f"({'-' if x < 0 else ''}1.0 / 0.0)"
    digits, _, exponent = x.hex().partition("p")
    whole = digits.rstrip("0").rstrip(".") if "." in digits else digits
    return f"{whole}p{exponent}"
