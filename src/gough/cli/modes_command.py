"""``gough modes``."""

from __future__ import annotations

from typing import Any

import click

from gough.cli.common import (
    json_option,
    numbers_option,
    parsed,
    print_json,
    reporting_errors,
    robot_argument,
)


@click.command("modes")
@robot_argument
@numbers_option("--q", "given", "Positions of the actuated joints, rad and m; home's by default.")
@click.option(
    "--motion",
    type=click.Choice(["home", "any"]),
    default="home",
    show_default=True,
    help="Whether a platform that only translates keeps home's orientation in every mode.",
)
@json_option
@reporting_errors
def command(
    robot: str,
    settings: tuple[str, ...],
    variants: tuple[str, ...],
    modelling: Any,
    given: list[float] | None,
    motion: str,
    as_json: bool,
) -> None:
    """Every assembly mode of ROBOT for some positions of its actuated joints.

    Solutions are certified one by one where an interval proof succeeds; the word behind their
    number tells what is known about the list: certified, expected or found.
    """
    from gough.robot import load

    loaded = load(robot, modelling, variants, **parsed(settings))
    modes = loaded.assembly_modes(loaded.home.q_actuated if given is None else given, motion)
    if as_json:
        print_json(modes.as_dict())
    else:
        click.echo(str(modes))
