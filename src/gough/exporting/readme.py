"""The README of an exported folder: what every number is."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from itertools import groupby

from gough.dynamics.dynamics import LIMIT, Dynamics
from gough.exporting.models import (
    WITH_REGULARITY,
    Exported,
    Number,
    c_name,
    configuration,
    parameters,
    place_of,
    space_of,
)

LANGUAGES = {"c": "C99", "cuda": "CUDA C"}
VECTORS = {
    "q": "a closed configuration: positions of the joints of the tree",
    "x": "operational coordinates",
    "p": "live parameters",
    "y": "independent rates",
    "yd": "their accelerations",
    "tau": "efforts of the motors",
}


def readme(language: str, dynamics: Dynamics, models: Sequence[Exported]) -> str:
    """The text of ``README.md``.

    Args:
        language: "c" or "cuda".
        dynamics: the robot's.
        models: those in the folder.
    """
    robot = dynamics.structure.mechanism.name
    parts = [
        f"# {robot}: models in {LANGUAGES.get(language, language)}",
        _first(language, robot, models),
        _counts(models),
        "## Inputs",
        _inputs(dynamics, models),
        "## Models",
        *(_model(language, robot, model) for model in models),
        *_regularity(dynamics, models),
        "## Compiling and testing",
        _compiling(language, robot),
        "## Threads and memory",
        _memory(language),
        *_example(language, robot, models),
    ]
    return "\n\n".join(parts) + "\n"


def _first(language: str, robot: str, models: Sequence[Exported]) -> str:
    name = f"{c_name(robot)}_{models[0].name}" if models else c_name(robot)
    what = (
        f"`{name}.h` and `{name}.c`, say, hold the function `{name}` of one row and"
        if language == "c"
        else f"`{name}.cu`, say, holds the device function `{name}` of one row and the kernel"
    )
    return (
        "Written by gough from the description of the robot, whose numbers are part of the code. "
        f"{what} `{name}_batch` of many rows that stand one after the other. SI units and rad; "
        "all numbers are `double`. Vectors are in axes of the base; those of a floating base "
        "itself in axes of the world."
    )


def _counts(models: Sequence[Exported]) -> str:
    lines = ["| model | inputs | numbers out | operations |", "| --- | --- | --- | --- |"]
    for model in models:
        inputs = ", ".join(f"`{label}`" for label in model.inputs)
        total = model.kernel.tape.counts()["total"]
        lines.append(f"| `{model.name}` | {inputs} | {model.width} | {total} |")
    return "\n".join(lines)


# inputs


def _inputs(dynamics: Dynamics, models: Sequence[Exported]) -> str:
    given = {label: numbers for model in models for label, numbers in model.inputs.items()}
    order = [label for label in VECTORS if label in given]
    parts = []
    for label in order:
        text = f"`{label}` ({len(given[label])}): {VECTORS[label]}.{_about(label, dynamics)}\n\n"
        parts.append(text + _listed(given[label]))
    return "\n\n".join(parts)


def _about(label: str, dynamics: Dynamics) -> str:
    """What else there is to know about an input."""
    if label == "q":
        words = " `residual` of it is 0."
        if place_of(dynamics) == "q":
            words += (
                " Models of dynamics mean nothing elsewhere: find the passive joints from the "
                "encoders first, by Newton's method with `residual` and `jacobian`."
            )
        return words
    if label == "x" and any(unit == "1" for _, unit in _outputs(dynamics)):
        return " A pose: position of the platform's origin, then its unit quaternion (w, x, y, z)."
    if label == "y":
        given = "motors first" if space_of(dynamics) == "joint" else "those of the outputs first"
        return f" Rates that determine all others, {given}; rotations are angular velocities."
    if label == "p":
        values = ", ".join(f"{name} = {value!r}" for name, value in parameters(dynamics))
        return f" Their values when this was written: {values}."
    return ""


def _outputs(dynamics: Dynamics) -> list[Number]:
    return [(name, unit) for name, unit in configuration(dynamics) if unit == "1"]


def _listed(numbers: Sequence[Number], start: int = 0) -> str:
    """Places, names and units, in lines."""
    lines = [
        f"    {k:3}  {name}{f' [{unit}]' if unit else ''}" for k, (name, unit) in enumerate(numbers)
    ]
    return "\n".join(lines[start:])


# models


def _model(language: str, robot: str, model: Exported) -> str:
    counts = model.kernel.tape.counts()
    total = counts.pop("total")
    listed = ", ".join(f"{count} {operation}" for operation, count in counts.items())
    parts = [
        f"### {model.name}",
        f"```c\n{_prototypes(language, robot, model)}\n```",
        f"{model.about[0].upper()}{model.about[1:]}. {_note(model)}",
        _results(model),
        f"Operations: {total}{f' ({listed})' if listed else ''}.",
    ]
    return "\n\n".join(part.rstrip() for part in parts)


def _prototypes(language: str, robot: str, model: Exported) -> str:
    name = f"{c_name(robot)}_{model.name}"
    sizes = {label: len(numbers) for label, numbers in model.inputs.items()}
    row = [f"const double {label}[{size}]" for label, size in sizes.items()]
    row.append(f"double out[{model.width}]")
    many = ["size_t rows", *(f"const double *{label}" for label in sizes), "double *out"]
    words = ("__device__ void", "__global__ void") if language == "cuda" else ("void", "void")
    heads = [
        f"{words[0]} {name}({', '.join(row)});",
        f"{words[1]} {name}_batch({', '.join(many)});",
    ]
    return "\n".join(_wrapped(head) for head in heads)


def _wrapped(head: str) -> str:
    """A declaration in lines that end between parameters."""
    parts = [part.replace(" ", "\xa0") for part in head.split(", ")]
    lines = textwrap.wrap(", ".join(parts), 100, break_long_words=False)
    return "\n    ".join(lines).replace("\xa0", " ")


def _note(model: Exported) -> str:
    motors = len(model.inputs.get("tau", ()))
    if model.name == "inverse_dynamics":
        motors, count = model.width - 1, len(model.inputs["y"])
        if motors > count:
            return "There are more motors than rates: of all efforts that will do, the smallest."
        if motors < count:
            return (
                "There are fewer motors than rates: the efforts whose forces Jᵀ tau come nearest "
                "to `forces`; what is missing has to come from elsewhere."
            )
    if model.name == "mass_matrix":
        return "Entries in kg, kg m and kg m², by the units of their rates."
    return ""


def _results(model: Exported) -> str:
    """What the numbers of a result are."""
    axes, shape = model.axes, model.kernel.shape
    if model.name == "poses":
        bodies = ", ".join(f"{k} {body}" for k, (body, _) in enumerate(axes[0]))
        return (
            f"`out` ({shape[0]}, 4, 4): one matrix after the other, its rows one after the other. "
            f"Bodies: {bodies}."
        )
    if model.name == "residual":
        units = [unit for _, unit in axes[0]]
        listed = ", ".join(f"{len(list(run))} in {unit}" for unit, run in groupby(units))
        return f"`out` ({shape[0]}): one number for each equation, in this order: {listed}."
    if len(axes) == 1:
        return f"`out` ({shape[0]}):\n\n{_listed(axes[0])}"
    rows = "one for each equation" if model.name == "jacobian" else _inline(axes[0])
    columns = _inline(axes[1])
    return f"`out` ({shape[0]}, {shape[1]}), rows vary slowest. Rows: {rows}. Columns: {columns}."


def _inline(numbers: Sequence[Number]) -> str:
    return ", ".join(f"{k} {name}" for k, (name, _) in enumerate(numbers))


# the rest


def _regularity(dynamics: Dynamics, models: Sequence[Exported]) -> list[str]:
    ending = [m.name for m in models if m.name in WITH_REGULARITY]
    if not ending:
        return []
    text = (
        f"The last number of {' and '.join(f'`{name}`' for name in ending)} is the smallest "
        "determinant that the model divided by over its typical size near home: about 1 far from "
        f"singularities, 0 at one. The library refuses rows below {LIMIT:g}. It is -1 or NaN where "
        "the others are no numbers"
    )
    if place_of(dynamics) == "x":
        quaternion = ", or the length of the quaternion is not 1 within 5e-13"
        posed = any(unit == "1" for model in models for _, unit in model.inputs.get("x", ()))
        text += f": a leg does not reach the pose{quaternion if posed else ''}"
    text += (
        ". Compare as in `if (!(regularity >= 1e-6))`, which catches NaN too. The other models "
        "have no such number: where it is low theirs mean nothing either."
    )
    return ["## Regularity", text]


def _compiling(language: str, robot: str) -> str:
    prefix = c_name(robot)
    if language == "cuda":
        return (
            f"`test_{prefix}.cu` runs every kernel on recorded states and compares every bit:\n\n"
            f"```sh\nnvcc -o test test_{prefix}.cu && ./test\n```\n\n"
            "It prints PASS and returns 0, or FAIL and 1. The sources use intrinsics that no flag "
            "changes, need no header, and NVRTC takes them as they are. Files can be put together: "
            "all names in one begin with the name of its model."
        )
    return (
        f"`test_{prefix}.c` runs every model on recorded states and compares every bit:\n\n"
        "```sh\ncc -std=c99 -O2 -ffp-contract=off *.c -lm -o test && ./test\n```\n\n"
        "It prints PASS and returns 0, or FAIL and 1. A robot's own program takes all files but "
        "this one. `-ffp-contract=off` keeps the bits of the library; `-ffast-math` is refused. "
        "`-fno-math-errno` makes square roots faster, and `-mfma` or `-march=native` makes fused "
        "operations instructions instead of calls; neither changes a bit. The headers suit C++."
    )


def _memory(language: str) -> str:
    text = (
        "The functions have no state: no globals, no locks, no allocation, no input or output. "
        "They may run in any number of threads at once. Outputs must not overlap inputs. Nothing "
        "iterates: a call takes the same operations whatever the numbers, but for sines and "
        "cosines of more than 25 735 rad, which go a longer way. "
    )
    if language == "cuda":
        return text + "A `_batch` kernel takes all rows with any number of blocks and threads."
    return text + "Memory is the stack's: some kB for the larger models."


def _example(language: str, robot: str, models: Sequence[Exported]) -> list[str]:
    found = [model for model in models if model.name == "inverse_dynamics"]
    if not found:
        return []
    text = _c_example(robot, found[0]) if language == "c" else _cuda_example(robot, found[0])
    return [text]


def _c_example(robot: str, model: Exported) -> str:
    name, motors = f"{c_name(robot)}_{model.name}", model.width - 1
    given = ", ".join(
        f"const double {label}[{len(numbers)}]" for label, numbers in model.inputs.items()
    )
    operations = model.kernel.tape.counts()["total"]
    return f"""\
## In a controller

A cycle of 10 kHz has 100 µs. The {operations} operations of this model take a small part of that:
a processor of a PC does some thousands in 1 µs. Feed-forward of the efforts, which keeps the last
ones where the robot is singular or out of reach:

```c
#include <string.h>

#include "{name}.h"

/* Every 100 µs. Returns 0, or -1 where there is no answer and tau stays as it is. */
int feed_forward({given}, double tau[{motors}])
{{
    double out[{model.width}];
    {name}({", ".join(model.inputs)}, out);
    if (!(out[{motors}] >= {LIMIT:g}))
        return -1;
    memcpy(tau, out, {motors} * sizeof *tau);
    return 0;
}}
```"""


def _cuda_example(robot: str, model: Exported) -> str:
    name = f"{c_name(robot)}_{model.name}"
    return f"""\
## Many states at once

All arrays are in device memory:

```c
{name}_batch<<<blocks, 128>>>(rows, {", ".join(model.inputs)}, out);
```"""
