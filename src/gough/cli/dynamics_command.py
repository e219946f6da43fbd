"""``gough dynamics``."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import click

from gough.cli.common import (
    MATHEMATICS_SAYS_NO,
    json_option,
    numbers_option,
    parsed,
    print_json,
    reporting_errors,
    robot_argument,
)


@click.command("dynamics")
@robot_argument
@click.option(
    "--trajectory",
    type=click.Path(path_type=Path),
    metavar="FILE.csv",
    help="Motion of the outputs; rest at home by default.",
)
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    metavar="FILE.csv",
    help="Write every row with its efforts, powers and energies.",
)
@numbers_option("--gravity", "gravity", "Three numbers, m/s²; the description's by default.")
@json_option
@reporting_errors
def command(
    robot: str,
    settings: tuple[str, ...],
    variants: tuple[str, ...],
    modelling: Any,
    trajectory: Path | None,
    out: Path | None,
    gravity: list[float] | None,
    as_json: bool,
) -> None:
    """Efforts, powers and energies of ROBOT along a motion, and whether its motors suffice.

    FILE.csv begins with a line of titles, such as

      time [s], x [mm], y [mm], z [mm]

    Columns are the time, the outputs as `gough inverse` takes them (of six freedoms x, y, z, qw,
    qx, qy, qz), their rates (dx, dy …) and accelerations (ddx, ddy …); rates of rotations are
    angular velocities in base axes: drx, dry, drz. Rates and accelerations that are missing are
    derivatives of a spline through the rows. Units are m, mm, rad, deg, s, ms, and these by s or
    s^2; SI and rad where a title has none. Without outputs the columns are the independent
    joints.

    The exit code is 1 if a row is out of reach or singular.
    """
    from gough.dynamics.along import along
    from gough.dynamics.trajectory import at_rest, columns_of, motion_of
    from gough.formats.trajectory import open_table, write_table
    from gough.robot import load

    loaded = load(robot, modelling, variants, **parsed(settings))
    dynamics = loaded.dynamics
    if trajectory is None:
        motion = at_rest(dynamics)
    else:
        motion = motion_of(dynamics, open_table(trajectory, columns_of(dynamics).known))
    found = along(dynamics, motion, gravity)
    if out is not None:
        write_table(out, found.titles(), found.table())
    if as_json:
        print_json(found.as_dict())
    else:
        click.echo(str(found))
    if not found.solved:
        sys.exit(MATHEMATICS_SAYS_NO)
