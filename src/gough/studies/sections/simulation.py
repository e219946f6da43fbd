"""The motion that laws of force make from rest at home: what moves, forces, and energies."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gough import view
from gough.actuators import LAWS, Situation, curves
from gough.actuators.base import Unit, unit_of
from gough.studies.context import Context
from gough.studies.deployments import (
    RTOL,
    Deployment,
    Quantity,
    alike,
    numbers_of,
    together,
)
from gough.studies.numbers import written
from gough.studies.report import Block, Cell, Paragraph, Picture, Section, Table
from gough.view import History, Loop

Array = NDArray[np.float64]

NAME, TITLE = "simulation", "Motion under the laws of force"
SEEN = 1e-6
"""Turns in rad and shifts in characteristic lengths that are too small to be drawn."""
NOTHING = 1e-9
"""Numbers of a table that are less are errors of the integration."""
MOST_CURVES = 6
MOST_LOOPS = 5
"""Loops of single actuators that are drawn, beside the slow one."""
CYCLE = 400
"""Points of the way out and of the way back of a slow cycle."""
ENERGIES = ("kinetic", "potential", "stored", "dissipated")


def section(context: Context) -> Section:
    """Pictures and a table, or a sentence that says why there are none."""
    found = context.deployment
    if isinstance(found, str):
        return Section(NAME, TITLE, [Paragraph(found)], {"simulation": None})
    cycles = list(_cycles(found))
    blocks: list[Block] = [Paragraph(_course(found)), _laws(found), _histories(context, found)]
    if cycles:
        blocks += [Paragraph(_hysteresis(cycles)), _loops(context, found, cycles)]
    blocks += [_audit(context, found), _table(found)]
    return Section(NAME, TITLE, blocks, {"simulation": _data(found, cycles)})


def _course(found: Deployment) -> str:
    length = (
        "two and a half times the time of the last first contact with an end stop, to one digit"
        if found.contacts
        else "twice the time that the first acceleration takes to move the robot by its own size"
    )
    text = (
        f"Nothing but the laws of force and gravity acts, and the robot starts from rest at home. "
        f"The run is {found.duration:g} s long, {length}; its local error is kept to "
        f"{written(RTOL)}. robot.simulate({found.duration:g}) repeats it."
    )
    ending = str(found.run["ending"].values)
    if ending != "finished":
        end = float(found.run.attrs["end"])
        text += f" It ended at {written(end, 4)} s: {found.run['ending'].attrs['long_name']}."
    return text


def _laws(found: Deployment) -> Table:
    rows: list[list[Cell]] = []
    for (own, law), names in found.groups.items():
        joints = [name.rpartition(".")[0] for name in names]
        unit: Unit = "m" if _unit(found, names[0], "m", "rad") == "m" else "rad"
        numbers = numbers_of(found.robot, names[0])
        told = ", ".join(_number(law, key, numbers[key], unit) for key in numbers)
        rows.append([own, law, together(joints), told])
    caption = "Laws of force that act, with the numbers of the first of each kind."
    return Table(("actuator", "law", "on", "numbers"), rows, caption)


def _number(law: str, key: str, value: Any, unit: Unit) -> str:
    if isinstance(value, tuple):
        inner = [f"[{_inner(x)}]" if isinstance(x, tuple) else written(x) for x in value]
        return f"{key.replace('_', ' ')} [{', '.join(inner)}]"
    kind = unit_of(LAWS[law].numbers[key].unit, unit)
    return f"{key.replace('_', ' ')} {written(value)} {kind}".rstrip()


def _inner(row: tuple[float, ...]) -> str:
    return ", ".join(written(x) for x in row)


# histories


def _histories(context: Context, found: Deployment) -> Picture:
    motion = found.motion
    shown = [*_outputs(context, found), *_forces(found)]
    marks = sorted(set(found.contacts.values()))
    figure = view.draw_histories(motion.time, shown, marks, "first contact with an end stop")
    caption = f"The motion of {context.robot.name} from rest at home, and forces of its actuators."
    if any(" … " in name for history in shown for name in history.names):
        caption += " What is alike is drawn once."
    return context.picture("deployment", figure, caption, "outputs and forces over time")


def _outputs(context: Context, found: Deployment) -> Iterator[History]:
    motion = found.motion
    if motion.travel is None or motion.speed is None:
        return
    moved = motion.outputs[motion.travel]
    yield History(moved.label, [moved.shown])
    yield History(motion.speed.label, [motion.speed.shown])
    rest = [q for k, q in enumerate(motion.outputs) if k != motion.travel]
    for unit in ("m", "rad"):
        size = context.robot.assembler.length if unit == "m" else 1.0
        seen = [q for q in rest if q.unit == unit and np.ptp(q.values) > SEEN * size]
        if seen:
            what = f"{'shift' if unit == 'm' else 'turn'} [{seen[0].shown_unit}]"
            seen = seen[:MOST_CURVES]
            yield History(what, [q.shown for q in seen], [_short(q) for q in seen])


def _short(quantity: Quantity) -> str:
    return quantity.name.removeprefix("turn ")


def _forces(found: Deployment) -> Iterator[History]:
    """Forces of each kind of law that gives one, and before them how far their joints go."""
    first = next((names for names in found.groups.values()), [])
    if first:
        slide = _unit(found, first[0], "m", "rad") == "m"
        yield _panel(found, first, "position", "elongation [m]" if slide else "angle [rad]")
    for (own, _), names in found.groups.items():
        forces = [found.motion.law("force", name) for name in names]
        if any(np.any(force != 0.0) for force in forces):
            unit = _unit(found, names[0], "N", "N m")
            yield _panel(found, names, "force", f"force of {own} [{unit}]")


def _unit(found: Deployment, name: str, slide: str, turn: str) -> str:
    joint = name.rpartition(".")[0]
    structure = found.robot.structure
    kinds = {v.unit for v in structure.variables if structure.edges[v.edge].name == joint}
    return turn if kinds == {"rad"} else slide


def _panel(found: Deployment, names: list[str], kind: str, label: str) -> History:
    values = [found.motion.law(kind, name) for name in names]
    groups = alike(values)
    joints = [name.rpartition(".")[0].rpartition(".") for name in names]
    own = {joint[2] for joint in joints}
    short = [joint[0] if len(own) == 1 and joint[0] else "".join(joint) for joint in joints]
    if len(groups) > MOST_CURVES:
        groups = groups[:MOST_CURVES]
    named = [together([short[k] for k in group]) for group in groups]
    return History(label, [values[group[0]] for group in groups], named)


# hysteresis


@dataclass(frozen=True)
class Cycle:
    """A law with envelopes on a way that is gone out and back slowly, twice."""

    names: list[str]
    """Actuators that do the same in the run; the first one's numbers are taken."""
    unit: str
    position: Array
    """Of the first actuator in the run."""
    force: Array
    way: Array
    """Out, back and out again, (points,)."""
    slow: Array
    """Force on that way."""
    lower: Array
    """Envelopes over the way out."""
    upper: Array
    lost: float
    """What a steady loop over the way takes, J."""

    @property
    def out(self) -> Array:
        """The way out."""
        return self.way[:CYCLE]


def _cycles(found: Deployment) -> Iterator[Cycle]:
    """One for each actuator with envelopes that does something else than those before."""
    for (_, law), names in found.groups.items():
        if not {"deploying", "folding"} <= set(LAWS[law].numbers):
            continue
        forces = [found.motion.law("force", name) for name in names]
        for group in alike(forces):
            own = [names[k] for k in group]
            yield _cycle(found, law, own)


def _cycle(found: Deployment, law: str, names: list[str]) -> Cycle:
    numbers = numbers_of(found.robot, names[0])
    position = found.motion.law("position", names[0])
    out = np.linspace(float(position.min()), float(position.max()), CYCLE)
    way = np.concatenate([out, out[-2::-1], out[1:]])
    slow = _slowly(law, numbers, way, found.motion.law("force", names[0])[0])
    steady = slice(CYCLE - 1, None)
    lost = -float(np.trapezoid(slow[steady], way[steady]))
    ends = np.array([curves.value(numbers[key], out) for key in ("deploying", "folding")])
    unit = _unit(found, names[0], "m", "rad")
    return Cycle(
        names, unit, position, found.motion.law("force", names[0]), way, slow,
        ends.min(axis=0), ends.max(axis=0), lost,
    )  # fmt: skip


def _slowly(law: str, numbers: dict[str, Any], way: Array, start: float) -> Array:
    """The force on a way, by Runge and Kutta's method of fourth order."""
    forces = [start]

    def slope(w: float, force: float, side: float) -> float:
        effort = LAWS[law].effort(Situation(w, side, (force,)), numbers)
        return float(effort.memory_rates[0]) * side

    for w, after in zip(way[:-1].tolist(), way[1:].tolist(), strict=True):
        step, side, R = after - w, 1.0 if after > w else -1.0, forces[-1]
        a = slope(w, R, side)
        b = slope(w + step / 2, R + step / 2 * a, side)
        c = slope(w + step / 2, R + step / 2 * b, side)
        d = slope(after, R + step * c, side)
        forces.append(R + step * (a + 2 * b + 2 * c + d) / 6)
    return np.array(forces)


def _hysteresis(cycles: list[Cycle]) -> str:
    first = cycles[0]
    way = f"{written(first.out[0], 3)} to {written(first.out[-1], 3)} {first.unit}"
    return (
        "Some actuators have forces that depend on where they come from, between two envelopes. "
        "The motion goes through a part of a loop; drawn beside it is the loop of the first of "
        f"them when it is moved slowly from {way}, back and out again. Once it is steady, such a "
        f"loop takes {written(first.lost, 3)} J."
    )


def _loops(context: Context, found: Deployment, cycles: list[Cycle]) -> Picture:
    first, shown = cycles[0], cycles[:MOST_LOOPS]
    drawn = [Loop(_named(c.names), c.position, c.force, c.out, c.lower, c.upper) for c in shown]
    one = f"{first.names[0].split('.')[0]} " if len(cycles) > 1 else ""
    title = f"{one}slowly, out and back"
    drawn.append(Loop(title, first.way, first.slow, first.out, first.lower, first.upper))
    slide = first.unit == "m"
    labels = ("elongation [m]", "force [N]") if slide else ("angle [rad]", "torque [N m]")
    caption = "Force over elongation of actuators with hysteresis, in the run and in a slow cycle."
    if len(shown) < len(cycles):
        left = ", ".join(_named(c.names) for c in cycles[MOST_LOOPS:])
        caption += f" Not drawn: {left}."
    return context.picture("force-loops", view.draw_loops(drawn, labels), caption, caption)


def _named(names: list[str]) -> str:
    joints = [name.split(".")[0] for name in names]
    own = names[0].removeprefix(f"{joints[0]}.")
    return f"{together(joints)}: {own}" if len(names) > 1 else names[0]


# energies


def _energy(found: Deployment, kind: str) -> Array:
    return np.asarray(found.run[f"energy_{kind}"].values)


def _audit(context: Context, found: Deployment) -> Picture:
    parts = {kind: _energy(found, kind) for kind in ENERGIES}
    delivered = _energy(found, "delivered")
    size = max(float(np.ptp(part)) for part in (*parts.values(), delivered))
    parts = {k: part for k, part in parts.items() if np.ptp(part) > 1e-9 * size}
    error = np.abs(found.run["energy_balance_error"].values)
    figure = view.draw_audit(found.motion.time, parts, delivered, error)
    caption = (
        "Where the energy that the actuators deliver goes, and how far the sum is from closing. "
        "Delivered and dissipated energies are integrated along with the motion."
    )
    return context.picture("energies", figure, caption, "energies stacked over time, and error")


def _table(found: Deployment) -> Table:
    rows = [[name, value, unit] for name, value, unit in _figures(found)]
    return Table(("", "value", "unit"), rows, "The run in numbers.")


def _figures(found: Deployment) -> Iterator[tuple[str, Cell, str]]:
    motion, run = found.motion, found.run
    if found.contacts:
        missing = found.stops - len(found.contacts)
        yield "first contact with an end stop", _four(min(found.contacts.values())), "s"
        rest = f", {missing} never met" if missing else ""
        yield f"last of the first contacts{rest}", _four(max(found.contacts.values())), "s"
    for k in (motion.travel, motion.twist):
        if k is not None:
            quantity = motion.outputs[k]
            yield f"{quantity.name} at the end", _four(quantity.shown[-1]), quantity.shown_unit
    if motion.speed is not None:
        worst = float(np.abs(motion.speed.shown).max())
        yield f"largest {motion.speed.name}", _four(worst), motion.speed.shown_unit
    for (own, _), names in found.groups.items():
        most = max(float(np.abs(motion.law("force", name)).max()) for name in names)
        if most > 0:
            yield f"largest force of {own}", _four(most), _unit(found, names[0], "N", "N m")
    for kind in ("delivered", "dissipated", "kinetic"):
        name = "kinetic energy at the end" if kind == "kinetic" else f"energy {kind}"
        yield name, _four(_energy(found, kind)[-1]), "J"
    error = float(np.abs(run["energy_balance_error"].values).max())
    yield "largest error of the balance", float(f"{error:.2g}"), "J"
    yield "steps", int(run.attrs["steps"]), ""


def _four(value: float) -> float:
    """Four digits; what is far below the integration's errors is zero."""
    return float(f"{value:.4g}") if abs(value) > NOTHING else 0.0


def _data(found: Deployment, cycles: list[Cycle]) -> dict[str, Any]:
    run, motion = found.run, found.motion
    return {
        "duration": found.duration,
        "rtol": RTOL,
        "ending": str(run["ending"].values),
        "contacts": found.contacts,
        "time": motion.time,
        "outputs": {q.name: {"unit": q.unit, "values": q.values} for q in motion.outputs},
        "actuators": {
            str(name): {kind: motion.law(kind, str(name)) for kind in ("position", "force")}
            for name in run["actuator"].values
        },
        "energies": {k: _energy(found, k) for k in (*ENERGIES, "delivered")},
        "energy_balance_error": run["energy_balance_error"].values,
        "loops": [
            {"actuators": c.names, "position": c.way, "force": c.slow, "lost": c.lost}
            for c in cycles
        ],
        "numbers": {name: {"value": v, "unit": u} for name, v, u in _figures(found)},
    }
