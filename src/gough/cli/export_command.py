"""``gough export``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from gough.cli.common import json_option, parsed, print_json, reporting_errors, robot_argument


@click.command("export")
@robot_argument
@click.option("--to", "language", type=click.Choice(["c", "cuda"]), help="Language to write.")
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    help="Folder to write to; NAME-LANGUAGE in the present folder by default.",
)
@click.option("--count", is_flag=True, help="Print how many operations each model takes.")
@json_option
@reporting_errors
def command(
    robot: str,
    settings: tuple[str, ...],
    variants: tuple[str, ...],
    modelling: Any,
    language: str | None,
    out: Path | None,
    count: bool,
    as_json: bool,
) -> None:
    """Write the models of ROBOT as code, or count their operations."""
    from gough.robot import load

    if language is None and not count:
        raise click.UsageError("nothing to do: say --count, or --to c, or --to cuda")
    loaded = load(robot, modelling, variants, **parsed(settings))
    result: dict[str, Any] = {"name": loaded.name}
    if count:
        result["operations"] = loaded.operations()
    if language is not None:
        folder = out or Path(f"{Path(robot).stem}-{language}")
        write = {"c": loaded.export_c, "cuda": loaded.export_cuda}[language]
        result["files"] = [str(path) for path in write(folder)]
    if as_json:
        print_json(result)
        return
    if count:
        click.echo(_table(result["operations"]))
    for path in result.get("files", ()):
        click.echo(path)


def _table(operations: dict[str, dict[str, int]]) -> str:
    kinds = list(dict.fromkeys(kind for counts in operations.values() for kind in counts))
    kinds.append(kinds.pop(kinds.index("total")))
    lines = [("model", *kinds)]
    lines += [(name, *(str(c.get(k, 0)) for k in kinds)) for name, c in operations.items()]
    widths = [max(len(line[k]) for line in lines) for k in range(len(lines[0]))]
    return "\n".join(
        "  ".join(
            text.rjust(width) if k else text.ljust(width)
            for k, (text, width) in enumerate(zip(line, widths, strict=True))
        )
        for line in lines
    )
