"""``gough study``."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import click

from gough.cli.common import (
    json_option,
    parsed,
    print_json,
    reporting_errors,
    robot_argument,
    seed_option,
)


@click.command("study")
@robot_argument
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    help="Folder to write to; study-NAME in the present folder by default.",
)
@click.option(
    "--points",
    type=click.IntRange(3, 400),
    default=25,
    show_default=True,
    help="Points of the sweep along each coordinate.",
)
@seed_option
@json_option
@reporting_errors
def command(
    robot: str,
    settings: tuple[str, ...],
    variants: tuple[str, ...],
    modelling: Any,
    out: Path | None,
    points: int,
    seed: int,
    as_json: bool,
) -> None:
    """Write a report on ROBOT: report.html, report.json and pictures."""
    from gough.robot import load
    from gough.studies import study

    loaded = load(robot, modelling, variants, **parsed(settings))
    folder = out or Path(f"study-{Path(robot).stem}")
    with _progress() as tell:
        report = study(loaded, folder, tell, points=points, seed=seed)
    if as_json:
        print_json({"report": str(report), "folder": str(folder)})
    else:
        click.echo(f"The report is in {report}")


@contextmanager
def _progress() -> Iterator[Callable[[str], None]]:
    """What shows how far the work is: one line that changes, on a terminal only."""
    from rich.console import Console

    console = Console(stderr=True)
    if not console.is_terminal:
        yield lambda text: None
        return
    with console.status("") as status:
        yield status.update
