"""``gough simulate``."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from gough.cli.common import (
    INTERRUPTED,
    MATHEMATICS_SAYS_NO,
    json_option,
    numbers_option,
    parsed,
    print_json,
    reporting_errors,
    robot_argument,
)

if TYPE_CHECKING:
    import xarray

    from gough.simulation.summary import EnsembleSummary, RunSummary

MANY = ("vary", "design", "seed", "store", "workers", "scheduler")
"""Options of ensembles alone."""


def _motion_options(command: Any) -> Any:
    """How long, from where, and under what."""
    path = click.Path(path_type=Path)
    for option in reversed(
        (
            click.option("--duration", type=float, metavar="SECONDS", help="1 s by default."),
            numbers_option("--x0", "x0", "Outputs at the start; home by default."),
            numbers_option("--v0", "v0", "Rates of the outputs at the start; 0 by default."),
            numbers_option("--q0", "q0", "A whole configuration instead of --x0."),
            click.option(
                "--input",
                "inputs",
                multiple=True,
                metavar="JOINT=VALUE",
                help="What an actuator is told, N or N m: a number, or FILE.csv with columns time "
                "and value; may be repeated.",
            ),
            click.option("--hold", is_flag=True, help="A controller keeps it where it starts."),
            click.option(
                "--trajectory",
                type=path,
                metavar="FILE.csv",
                help="A controller follows a motion, in the form of `gough dynamics`.",
            ),
            click.option(
                "--controller",
                metavar="NAME",
                help="computed-torque (the default), pd-gravity or joint-pd.",
            ),
            numbers_option("--frequency", "frequency", "Of computed-torque, rad/s; 20 by default."),
            numbers_option("--damping-ratio", "damping_ratio", "With it; 1 by default."),
            numbers_option("--stiffness", "stiffness", "Of the controller; 1/s², N/m, N m/rad."),
            numbers_option("--damping", "damping", "Of the controller; 1/s, N s/m, N m s/rad."),
            click.option(
                "--event",
                "marks",
                multiple=True,
                metavar="NAME=EXPRESSION",
                help="Note when an expression changes its sign, such as half=platform.z-0.5; may "
                "be repeated.",
            ),
            click.option(
                "--stop-at",
                "stops",
                multiple=True,
                metavar="NAME=EXPRESSION",
                help="The same, and the run ends there.",
            ),
            numbers_option("--gravity", "gravity", "Three numbers, m/s²."),
        )
    ):
        command = option(command)
    return command


def _method_options(command: Any) -> Any:
    """How accurately, and where results go."""
    path = click.Path(path_type=Path)
    for option in reversed(
        (
            click.option(
                "--method",
                default="dormand-prince",
                show_default=True,
                metavar="NAME",
                help="Or adams, or bdf for stiff mechanisms.",
            ),
            click.option("--rtol", type=float, default=1e-8, show_default=True),
            click.option("--atol", type=float, help="In the unit of each state; rtol by default."),
            click.option(
                "--times",
                type=click.IntRange(2, 10_000_000),
                metavar="N",
                help="Times at which the motion is seen; 201 by default, of an ensemble the end.",
            ),
            click.option(
                "--locate/--no-locate",
                default=None,
                help="Whether steps end where a law switches; by default where rtol is below 1e-7.",
            ),
            click.option(
                "--out",
                type=path,
                metavar="FILE",
                help="Everything, as FILE.nc (NetCDF), FILE.zarr or FILE.csv.",
            ),
            click.option(
                "--plot",
                type=path,
                metavar="FOLDER_OR_FILE",
                help="Pictures; to FILE.png or FILE.svg the first alone.",
            ),
            click.option("--quiet", is_flag=True, help="Print neither a table nor a bar."),
        )
    ):
        command = option(command)
    return command


def _ensemble_options(command: Any) -> Any:
    """How many runs, of what, and where they are made."""
    for option in reversed(
        (
            click.option("--samples", type=click.IntRange(1), metavar="N", help="Make N runs."),
            click.option(
                "--vary",
                multiple=True,
                metavar="NAME=DISTRIBUTION",
                help="What differs from run to run, such as mass=±5%, x0.z=±0.001, "
                "inputs.leg1.slide=uniform(9,11); all=±10% is every parameter; may be repeated.",
            ),
            click.option(
                "--design",
                metavar="NAME",
                help="latin-hypercube (the default), sobol, random or saltelli.",
            ),
            click.option("--seed", type=click.IntRange(0, 2**63 - 1), help="0 by default."),
            click.option(
                "--store",
                type=click.Path(path_type=Path),
                metavar="FOLDER",
                help="Keep rows here; the same command goes on where it was interrupted.",
            ),
            click.option("--workers", type=click.IntRange(1), metavar="N", help="Chunks at once."),
            click.option(
                "--scheduler", metavar="ADDRESS", help="Of Dask, such as tcp://host:8786."
            ),
        )
    ):
        command = option(command)
    return command


@click.command("simulate")
@robot_argument
@_motion_options
@_method_options
@_ensemble_options
@json_option
@reporting_errors
def command(
    robot: str,
    settings: tuple[str, ...],
    variants: tuple[str, ...],
    modelling: Any,
    out: Path | None,
    plot: Path | None,
    quiet: bool,
    as_json: bool,
    **options: Any,
) -> None:
    """A motion of ROBOT under its actuators, or with --samples an ensemble of them.

    It starts from rest at home and lasts 1 s, with motors that nobody tells anything, unless
    options say otherwise. Printed are outputs at some times, energies and events; --out keeps
    everything.

    The exit code is 1 if the run did not come to its end, or if all runs of an ensemble failed.
    """
    from gough.cli import simulate_pictures as pictures
    from gough.ensembles import Interrupted
    from gough.robot import load
    from gough.simulation import saving

    if out is not None:
        saving.writable(out)
    if plot is not None:
        pictures.drawable(plot)
    loaded = load(robot, modelling, variants, **parsed(settings))
    try:
        found = _simulated(loaded, options, quiet or as_json)
    except Interrupted as error:  # its text says how to go on
        if as_json:
            print_json({"error": str(error)})
        click.echo(str(error), err=True)
        sys.exit(INTERRUPTED)
    files = [] if out is None else [saving.save(found.dataset, out)]
    files += [] if plot is None else pictures.draw(plot, loaded, found)
    if as_json:
        print_json({**found.as_dict(), "files": [str(file) for file in files]})
    elif not quiet:
        click.echo("\n".join([str(found), *(f"  written to {file}" for file in files)]))
    if not found.good:
        sys.exit(MATHEMATICS_SAYS_NO)


def _simulated(robot: Any, options: dict[str, Any], quiet: bool) -> RunSummary | EnsembleSummary:
    """What the options ask for."""
    from gough.cli import simulate_request as request
    from gough.errors import ConfigurationError
    from gough.simulation.summary import RunSummary, units_of

    many = {name: options.pop(name) for name in MANY}
    samples, units = options.pop("samples"), units_of(robot.dynamics)
    gains = request.Gains(
        *(
            options.pop(name)
            for name in ("controller", "frequency", "damping_ratio", "stiffness", "damping")
        )
    )
    start = {name: options.pop(name) for name in ("x0", "v0", "q0")}
    asked = request.asked(
        robot, options.pop("duration"), start, options.pop("hold"), options.pop("trajectory"), gains
    )
    inputs = request.inputs_of(options.pop("inputs"))
    events = request.events_of(options.pop("marks"), options.pop("stops"))
    times = options.pop("times")
    given = {
        **options,
        **asked.start,
        **({} if times is None else {"times": times}),
        "inputs": inputs,
        "events": events,
        "controller": asked.controller,
    }
    if samples is not None:
        return _ensemble(robot, samples, many, asked.duration, given, quiet)
    useless = [f"--{name}" for name, value in many.items() if value not in (None, ())]
    if useless:
        raise ConfigurationError(
            f"{' and '.join(useless)}: for ensembles alone; --samples N says how many runs"
        )
    return RunSummary(_interruptible(lambda: robot.simulate(asked.duration, **given)), units)


def _ensemble(
    robot: Any,
    samples: int,
    many: dict[str, Any],
    duration: float,
    given: dict[str, Any],
    quiet: bool,
) -> EnsembleSummary:
    import numpy as np

    from gough.cli.simulate_request import vary_of
    from gough.errors import ConfigurationError
    from gough.simulation.summary import EnsembleSummary, units_of

    if not many["vary"]:
        raise ConfigurationError(
            'nothing varies; give --vary NAME=DISTRIBUTION, such as --vary "all=±10%"'
        )
    many["vary"] = vary_of(robot, many["vary"])
    store = many["store"]
    fresh = store is None or not Path(store).exists()
    begun = time.monotonic()
    dataset = robot.simulate(
        duration,
        samples=samples,
        progress=not quiet,
        **given,
        **{name: value for name, value in many.items() if value is not None},
    )
    rows = None
    if many["design"] == "saltelli":  # the other blocks repeat these
        rows = np.arange(dataset.sizes["row"]) % (dataset.sizes["factor_name"] + 2) < 2
    return EnsembleSummary(
        dataset,
        units_of(robot.dynamics),
        time.monotonic() - begun if fresh else None,
        "" if store is None else str(store),
        rows,
    )


def _interruptible(work: Callable[[], xarray.Dataset]) -> xarray.Dataset:
    """What work gives; it is done in a thread, since compiled loops do not see an interrupt."""
    found: list[xarray.Dataset] = []
    failed: list[BaseException] = []

    def run() -> None:
        try:
            found.append(work())
        except BaseException as error:
            failed.append(error)

    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    while thread.is_alive():
        thread.join(0.1)
    if failed:
        raise failed[0]
    return found[0]
