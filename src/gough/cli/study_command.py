"""``gough study``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from gough.cli.common import json_option, parsed, print_json, reporting_errors, robot_argument


@click.command("study")
@robot_argument
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    help="Folder to write to; study-NAME in the present folder by default.",
)
@json_option
@reporting_errors
def command(
    robot: str, settings: tuple[str, ...], modelling: Any, out: Path | None, as_json: bool
) -> None:
    """Write a report on ROBOT: report.html, report.json and pictures."""
    from gough.robot import load
    from gough.studies import study

    loaded = load(robot, modelling, **parsed(settings))
    folder = out or Path(f"study-{Path(robot).stem}")
    progress = None if as_json else lambda text: click.echo(text, err=True)
    report = study(loaded, folder, progress)
    if as_json:
        print_json({"report": str(report), "folder": str(folder)})
    else:
        click.echo(f"The report is in {report}")
