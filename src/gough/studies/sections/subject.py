"""What was studied, with all that it takes to repeat it."""

from __future__ import annotations

import importlib.metadata
import json
import shlex
from datetime import UTC, datetime
from typing import Any

from gough.description.flat import Flat
from gough.description.parts import Parameter
from gough.errors import Path
from gough.studies.context import POINTS, Context
from gough.studies.numbers import written
from gough.studies.report import Block, Command, Paragraph, Section, Table


def section(context: Context) -> Section:
    """Name, architecture, parameters, versions, and the command that repeats the study."""
    mechanism, structure = context.robot.mechanism, context.robot.structure
    command, whole = repeating(context)
    done = datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC")
    facts = {
        "name": mechanism.name,
        "architecture": structure.architecture,
        "motion": mechanism.motion,
        "modelling": structure.modelling,
        "variants": ", ".join(context.robot.origin.variants if context.robot.origin else ()),
        "characteristic length": f"{written(context.robot.assembler.length)} m",
        "date": done,
        "gough": version(),
        "seed": str(context.seed),
    }
    blocks: list[Block] = [Table(("", ""), [row for row in facts.items() if row[1]])]
    blocks += [Paragraph("The study is repeated by"), Command(command)]
    if not whole:
        text = "where FILE.yaml is the description; report.json holds it under “description”."
        blocks.append(Paragraph(text))
    values = context.robot.assembler.values
    blocks.append(_parameters(structure.flat, values))
    data = {
        "name": mechanism.name,
        "about": mechanism.about,
        "gough": version(),
        "date": done,
        "seed": context.seed,
        "points": context.points,
        "command": command,
        "characteristic_length": {"value": context.robot.assembler.length, "unit": "m"},
        "parameters": {
            name: {"value": values[name], "unit": part.unit, "live": part.live, "about": part.about}
            for name, part in structure.flat.parameters.items()
        },
        "description": json.loads(mechanism.model_dump_json(exclude_defaults=True)),
    }
    return Section("subject", "What was studied", blocks, data)


def _parameters(flat: Flat, values: dict[str, Any]) -> Block:
    """A row for each parameter; those of a leg that is repeated have a value for each leg."""
    if not flat.parameters:
        return Paragraph("The description has no parameters.")
    groups: dict[Path, list[str]] = {}
    for name in flat.parameters:
        groups.setdefault(flat.paths["parameters", name], []).append(name)
    rows = []
    for path, names in groups.items():
        part = flat.parameters[names[0]]
        shown = ", ".join(_number(values[name]) for name in names)
        title = names[0] if path[0] == "parameters" else f"{path[1]}.{path[-1]}"
        rows.append((title, shown, part.unit, _meaning(part)))
    caption = "Parameters."
    if any(len(names) > 1 for names in groups.values()):
        caption = (
            "Parameters; those of a repeated leg, written with its name, have a value for each."
        )
    return Table(("parameter", "value", "unit", "what"), rows, caption)


def _meaning(part: Parameter) -> str:
    return "; ".join(filter(None, [part.about, "live" if part.live else ""]))


def _number(value: Any) -> str:
    """A number or nested tuples of numbers, six digits each."""
    if isinstance(value, tuple):
        return "[" + ", ".join(_number(item) for item in value) + "]"
    return written(value)


def version() -> str:
    """The version of gough."""
    try:
        return importlib.metadata.version("gough")
    except importlib.metadata.PackageNotFoundError:
        return "not installed"


def repeating(context: Context) -> tuple[str, bool]:
    """The command that repeats a study, and whether it is whole: the robot came from a file."""
    origin = context.robot.origin
    words = ["gough study", shlex.quote(origin.robot) if origin else "FILE.yaml"]
    words += [f"--variant {shlex.quote(name)}" for name in (origin.variants if origin else ())]
    for name, value in origin.parameters.items() if origin else ():
        plain = json.dumps(value).replace('"', "") if isinstance(value, list | tuple) else value
        words.append(f"--set {shlex.quote(f'{name}={plain}')}")
    chosen = context.robot.structure.modelling
    if chosen != context.robot.mechanism.modelling:
        words.append(f"--modelling {chosen}")
    if context.points != POINTS:
        words.append(f"--points {context.points}")
    if context.seed:
        words.append(f"--seed {context.seed}")
    return " ".join(words), origin is not None
