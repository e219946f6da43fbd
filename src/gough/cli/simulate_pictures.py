"""Pictures of runs and ensembles that ``gough simulate`` draws."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from gough import view
from gough.actuators import LAWS, curves
from gough.errors import ConfigurationError
from gough.robot import Robot
from gough.simulation.summary import ROUNDING, EnsembleSummary, RunSummary
from gough.studies.deployments import actuators, alike, numbers_of, together, turns
from gough.view import paper

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

WRITERS = {".png": view.png, ".svg": view.svg}
OTHERS = (".pdf", ".jpg", ".jpeg", ".gif", ".eps", ".ps", ".tif", ".tiff", ".webp", ".bmp")
ENVELOPES = {"deploying", "folding"}
MOST_CURVES = 6
"""Curves of a panel at most."""
MOST_MARKS = 30
"""Moments that are marked; of more the first of each name."""
MOST_OUTPUTS = 6
"""Outputs of an ensemble that are drawn."""
POINTS = 101
"""Of an envelope."""
STILL = 1e-6
"""Turns of a platform below which it does not turn, rad: what rounding makes of symmetry."""
VARIES = 1e-9
"""Range of an output, in parts of the largest, below which it does not vary."""


def drawable(path: Path) -> Path:
    """A file or folder that pictures can go to, as far as can be told before they are there.

    Raises:
        ConfigurationError: it is a file of another kind, or something is in the way.
        ViewError: matplotlib is not installed.
    """
    paper.figure(1.0, 1.0)
    suffix = path.suffix.lower()
    if suffix in OTHERS and not path.is_dir():
        raise ConfigurationError(
            f"{path}: pictures are .png or .svg; a folder gets all of them as .png"
        )
    if suffix in WRITERS and path.is_dir():
        raise ConfigurationError(f"{path} is a folder; name a file")
    if suffix not in WRITERS and path.exists() and not path.is_dir():
        raise ConfigurationError(
            f"{path} is a file and no picture; name a folder, or a file that ends in .png or .svg"
        )
    return path


def draw(path: Path, robot: Robot, found: RunSummary | EnsembleSummary) -> list[Path]:
    """Write pictures to a folder, or the first of them to a file; the files written.

    Raises:
        ConfigurationError: a file can not be written.
    """
    pictures = _of_run(robot, found) if isinstance(found, RunSummary) else _of_ensemble(found)
    suffix = path.suffix.lower()
    written = []
    for name, picture in pictures:
        one = suffix in WRITERS
        file = path if one else path / f"{name}.png"
        content = WRITERS[file.suffix.lower()](picture)
        try:
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_bytes(content)
        except OSError as error:
            raise ConfigurationError(f"{file} can not be written: {error.strerror}") from None
        written.append(file)
        if one:
            break
    return written


# one run


def _of_run(robot: Robot, found: RunSummary) -> Iterator[tuple[str, Figure]]:
    """The motion, the energies, and loops of hysteresis."""
    if len(found.time) < 2:
        return
    histories = [*_positions(found), *_rates(found), *_efforts(robot, found)]
    if histories:
        marks, text = _marks(found)
        yield "motion", view.draw_histories(found.time, histories, marks, text)
    parts = {kind: found.energy(kind) for kind in ("kinetic", "potential", "stored", "dissipated")}
    parts = {kind: values for kind, values in parts.items() if np.ptp(values) > 0}
    if parts:
        error = found.dataset["energy_balance_error"].values
        yield "energy", view.draw_audit(found.time, parts, found.energy("delivered"), error)
    loops, labels = _loops(robot, found)
    if loops:
        yield "loops", view.draw_loops(loops, labels)


def _positions(found: RunSummary) -> Iterator[view.History]:
    outputs = found.outputs
    if "pose" not in found.dataset:
        yield from _panels("position", outputs.names, outputs.units, outputs.values)
        return
    yield view.History("position [m]", list(outputs.values[:, :3].T), ("x", "y", "z"))
    turned = turns(outputs.values[:, 3:])
    if np.ptp(turned) > STILL:
        names = ("about x", "about y", "about z")
        yield view.History("turned since start [°]", list(np.rad2deg(turned).T), names)


def _rates(found: RunSummary) -> Iterator[view.History]:
    outputs = found.outputs
    if "pose" not in found.dataset:
        units = [f"{unit}/s" for unit in outputs.units]
        yield from _panels("rate", outputs.names, units, outputs.rates)
        return
    yield view.History("velocity [m/s]", list(outputs.rates[:, :3].T), ("x", "y", "z"))
    if np.ptp(turns(outputs.values[:, 3:])) > STILL:
        spin = np.rad2deg(outputs.rates[:, 3:])
        yield view.History("angular velocity [°/s]", list(spin.T), ("x", "y", "z"))


def _panels(
    what: str, names: Sequence[str], units: Sequence[str], values: Array
) -> Iterator[view.History]:
    """A panel for each unit, of a few curves at most."""
    for unit in dict.fromkeys(units):
        columns = [k for k, u in enumerate(units) if u == unit]
        if np.abs(values[:, columns]).max(initial=0.0) < ROUNDING:
            continue
        for first in range(0, len(columns), MOST_CURVES):
            chosen = columns[first : first + MOST_CURVES]
            factor = 180 / np.pi if unit.startswith("rad") else 1.0
            yield view.History(
                f"{what} [{unit.replace('rad', '°')}]",
                [factor * values[:, k] for k in chosen],
                [names[k] for k in chosen],
            )


def _efforts(robot: Robot, found: RunSummary) -> Iterator[view.History]:
    """Of the actuators that are told something."""
    commanded = {law.name: law.unit for law in robot.simulator.laws if law.law.commanded}
    names = [str(name) for name in found.dataset["actuator"].values]
    chosen = [k for k, name in enumerate(names) if name in commanded]
    units = ["N" if commanded[names[k]] == "m" else "N m" for k in chosen]
    forces = found.dataset["actuator_force"].values[:, chosen]
    own = [names[k].rpartition(".")[0] for k in chosen]
    shown = own if len(set(own)) == len(own) else [names[k] for k in chosen]
    yield from _panels("effort", shown, units, forces)


def _marks(found: RunSummary) -> tuple[list[float], str]:
    """Moments of events among the times that were seen, and what they are."""
    last = found.time[-1]
    events = [event for event in found.happened if event.times[0] <= last]
    times = sorted({t for event in events for t in event.times if t <= last})
    if len(times) > MOST_MARKS:
        return sorted({event.times[0] for event in events})[:MOST_MARKS], "first event of each name"
    names = ", ".join(event.name for event in events)
    return times, f"event: {names}" if len(events) < 4 else "events"


def _loops(robot: Robot, found: RunSummary) -> tuple[list[view.Loop], tuple[str, str]]:
    """Of actuators with envelopes; those that do the same are drawn once."""
    run, there = found.dataset, set(found.dataset["actuator"].values.tolist())
    groups: dict[str, list[str]] = {}
    for name, actuator in actuators(robot).items():
        if name in there and set(LAWS[actuator.law].numbers) >= ENVELOPES:
            groups.setdefault(name.rpartition(".")[2], []).append(name)
    loops = []
    for names in groups.values():
        forces = [run["actuator_force"].sel(actuator=name).values for name in names]
        for group in alike(forces):
            loops.append(_loop(robot, found, [names[k] for k in group]))
    units = {law.unit for law in robot.simulator.laws for n in groups.values() if law.name in n}
    labels = (
        ("angle [rad]", "torque [N m]") if units == {"rad"} else ("elongation [m]", "force [N]")
    )
    return loops, labels


def _loop(robot: Robot, found: RunSummary, names: list[str]) -> view.Loop:
    position, force = (
        found.dataset[f"actuator_{kind}"].sel(actuator=names[0]).values
        for kind in ("position", "force")
    )
    numbers = numbers_of(robot, names[0])
    along = np.linspace(float(position.min()), float(position.max()), POINTS)
    ends = np.array([curves.value(numbers[key], along) for key in sorted(ENVELOPES)])
    joints = [name.rpartition(".")[0] for name in names]
    title = f"{together(joints)}: {names[0].rpartition('.')[2]}" if len(names) > 1 else names[0]
    return view.Loop(title, position, force, along, ends.min(axis=0), ends.max(axis=0))


# ensembles


def _of_ensemble(found: EnsembleSummary) -> Iterator[tuple[str, Figure]]:
    """Outputs that vary over the factors, and how each is spread."""
    shown = _spread_outputs(found)
    if not shown:
        return
    values = np.column_stack([column for _, column in shown])
    if "factor" in found.dataset:
        names = [str(name) for name in found.dataset["factor_name"].values]
        yield (
            "scatter",
            view.draw_scatter(
                found.dataset["factor"].values[found.told],
                values,
                names,
                [label for label, _ in shown],
            ),
        )
    for label, column in shown:
        name = re.sub(r"[^\w.-]+", "-", label.partition(" [")[0]).strip("-")
        yield f"spread-{name}", view.draw_histogram(column, label)


def _spread_outputs(found: EnsembleSummary) -> list[tuple[str, Array]]:
    """Labels and values of outputs, first times and measures that vary."""
    told: list[tuple[str, Array]] = []
    for spread, values in found.columns():
        if spread.name == "qw":  # the others say it
            continue
        known = values[np.isfinite(values)]
        size = float(np.abs(known).max(initial=0.0))
        if known.size > 1 and np.ptp(known) > VARIES * max(size, 1.0):
            unit = f" [{spread.unit}]" if spread.unit not in ("", "1") else ""
            told.append((f"{spread.name}{unit}", values))
    return told[:MOST_OUTPUTS]
