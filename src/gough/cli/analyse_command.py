"""``gough analyse``."""

from __future__ import annotations

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


@click.command("analyse")
@robot_argument
@seed_option
@json_option
@reporting_errors
def command(
    robot: str,
    settings: tuple[str, ...],
    variants: tuple[str, ...],
    modelling: Any,
    seed: int,
    as_json: bool,
) -> None:
    """Mobility, ranks, defects, redundant equations and singularity of ROBOT at its home."""
    from gough.robot import load

    analysis = load(robot, modelling, variants, **parsed(settings)).analyse(seed)
    if as_json:
        print_json(analysis.as_dict())
    else:
        click.echo(str(analysis))
