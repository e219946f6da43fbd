"""``gough inverse``."""

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


@click.command("inverse")
@robot_argument
@numbers_option(
    "--x",
    "given",
    "Operational coordinates, rad and m; all six freedoms as x, y, z and a quaternion w, x, y, z. "
    "Home's by default.",
)
@json_option
@reporting_errors
def command(
    robot: str,
    settings: tuple[str, ...],
    variants: tuple[str, ...],
    modelling: Any,
    given: list[float] | None,
    as_json: bool,
) -> None:
    """Positions of the joints of ROBOT for a pose, on home's working mode and on all others."""
    from gough.robot import load

    loaded = load(robot, modelling, variants, **parsed(settings))
    x = loaded.home.x if given is None else given
    q = loaded.inverse_geometry(x)
    modes = loaded.working_modes(x) if loaded.has_closed_form else None
    names = loaded.position_names
    if as_json:
        data: dict[str, Any] = {
            "name": loaded.name,
            "x": [float(value) for value in x],
            "q": dict(zip(names, q.tolist(), strict=True)),
        }
        if modes is not None:
            data["working_modes"] = modes.as_dict()
        print_json(data)
        return
    click.echo(f"{loaded.name} on the working mode of home")
    width = max(map(len, names))
    for name, value in zip(names, q, strict=True):
        click.echo(f"  {name:<{width}}  {value + 0.0:+.9f}")
    if modes is not None and len(modes) > 1:
        click.echo(str(modes))
