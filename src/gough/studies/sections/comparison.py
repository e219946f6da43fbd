"""Variants of a description whose laws of force move them: runs on each other, and differences."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gough import view
from gough.description.parts import Variant
from gough.errors import GoughError
from gough.robot import Robot, load
from gough.studies.context import Context
from gough.studies.deployments import RTOL, TIMES, Deployment, Motion, Quantity, motion_of
from gough.studies.numbers import written
from gough.studies.report import Block, Cell, Paragraph, Picture, Section, Table
from gough.view import Compared

Array = NDArray[np.float64]

NAME, TITLE = "comparison", "Variants compared"
SEEN = 1e-6
"""Differences in characteristic lengths or rad that are less count as none: the integration's own
are of this size."""
MOST = 4
"""Quantities of a figure."""
MOST_RUNS = 6
"""Curves of a figure."""
AS_DESCRIBED = "as described"

Combination = tuple[str, ...]
"""Names of variants, in the order in which they are merged."""


@dataclass
class Runs:
    """Runs of a robot's variants, each made once.

    Args:
        robot: loaded from a description.
        duration: of every run, s.
        nominal: the run of the robot itself.
    """

    robot: Robot
    duration: float
    nominal: Motion
    told: dict[Combination, Motion | str] = field(default_factory=dict)
    _loaded: dict[Combination, Robot] = field(default_factory=dict)

    def of(self, chosen: Combination) -> Motion | str:
        """The run with some variants, or why there is none."""
        if chosen not in self.told:
            self.told[chosen] = self._run(chosen)
        return self.told[chosen]

    def distinct(self, names: Sequence[str]) -> list[str]:
        """Variants without those that give the same mechanism as one before, or as none."""
        found, seen = [], [self._mechanism(())]
        for name in names:
            mechanism = self._mechanism((name,))
            if mechanism is None or mechanism not in seen:
                found.append(name)
                seen.append(mechanism)
        return found

    def _mechanism(self, chosen: Combination) -> Mapping[str, Any] | None:
        try:
            mechanism = self._robot(chosen).mechanism
        except GoughError:
            return None
        return mechanism.model_dump(exclude={"variants", "about"}, exclude_unset=True)

    def _run(self, chosen: Combination) -> Motion | str:
        if not chosen:
            return self.nominal
        try:
            robot = self._robot(chosen)
            run = robot.simulate(self.duration, times=TIMES, rtol=RTOL)
        except GoughError as error:
            return str(error).splitlines()[0]
        if str(run["ending"].values) != "finished":
            return str(run["ending"].attrs["long_name"])
        return motion_of(robot, run)

    def _robot(self, chosen: Combination) -> Robot:
        if not chosen:
            return self.robot
        if chosen not in self._loaded:
            origin = self.robot.origin
            assert origin is not None
            variants = (*origin.variants, *chosen)
            found = load(origin.robot, origin.modelling, variants, **origin.parameters)
            self._loaded[chosen] = found
        return self._loaded[chosen]


@dataclass(frozen=True)
class Comparison:
    """Runs beside each other."""

    names: tuple[str, ...]
    """The first is what the others are compared with."""
    together: str
    """The variant that all of them have besides, or none."""
    motions: tuple[Motion, ...]
    length: float
    """The characteristic length, m."""

    @property
    def quantities(self) -> list[tuple[Quantity, Array]]:
        """Outputs and the rate of travel, with their values in all runs, (runs, times)."""
        found = []
        for k, quantity in enumerate(self.motions[0].outputs):
            found.append((quantity, np.array([m.outputs[k].values for m in self.motions])))
        return found

    def size(self, quantity: Quantity, values: Array) -> float:
        """The largest difference from the first run, comparable."""
        scale = 1.0 if quantity.unit == "rad" else self.length
        return float(np.abs(values[1:] - values[0]).max(initial=0.0)) / scale

    @property
    def largest(self) -> float:
        """The largest difference of any output."""
        return max((self.size(q, v) for q, v in self.quantities), default=0.0)


def section(context: Context) -> Section | None:
    """Figures and tables; None for a robot without variants or without a run."""
    nominal = context.deployment
    if isinstance(nominal, str) or not nominal.motion.outputs or context.robot.origin is None:
        return None
    families = alternatives(context.robot.mechanism.variants)
    if not families:
        return None
    context.progress("simulating variants")
    runs = Runs(context.robot, nominal.duration, nominal.motion)
    found = list(comparisons(runs, families, context.robot.assembler.length))
    blocks: list[Block] = [Paragraph(_course(nominal)), *_refusals(runs)]
    for k, one in enumerate(found):
        if one.largest > SEEN:
            blocks += [_picture(context, one, k), _table(one)]
        else:
            listed = ", ".join(one.names)
            blocks.append(Paragraph(f"No difference is seen between {listed}."))
    if not found:
        blocks.append(Paragraph("No variant gives another motion."))
    return Section(NAME, TITLE, blocks, {"comparison": [_data(one) for one in found]})


def alternatives(variants: Mapping[str, Variant]) -> list[list[str]]:
    """Variants in families: those that change the same entries can not be had together."""
    entries = {name: set(_entries(variant.changes)) for name, variant in variants.items()}
    families: list[tuple[list[str], set[tuple[str, ...]]]] = []
    for name, own in entries.items():
        if not own:
            continue
        near = [family for family in families if family[1] & own]
        names = [n for family in near for n in family[0]] + [name]
        changed = own.union(*(family[1] for family in near))
        families = [family for family in families if family not in near] + [(names, changed)]
    return [names for names, _ in families]


def _entries(changes: Any, path: tuple[str, ...] = ()) -> Iterator[tuple[str, ...]]:
    """Paths of what is changed; whether a parameter is live changes no motion."""
    if isinstance(changes, Mapping):
        for key, value in changes.items():
            yield from _entries(value, (*path, str(key)))
    elif path[-1] != "live":
        yield path[:-1] if path[-1] == "value" and "parameters" in path else path


def comparisons(
    runs: Runs, families: Sequence[Sequence[str]], length: float
) -> Iterator[Comparison]:
    """The variants without alternatives, then each family where its first ones differ most."""
    single = runs.distinct([names[0] for names in families if len(names) == 1])
    if single:
        yield from _compared(runs, single, "", length)
    for names in families:
        others = runs.distinct(names) if len(names) > 1 else []
        tried = [pair for more in ("", *single) for pair in _first(runs, others, more, length)]
        if tried:
            most = max(tried, key=lambda one: one.largest)
            yield from _compared(runs, others, most.together, length)


def _first(runs: Runs, names: Sequence[str], together: str, length: float) -> Iterator[Comparison]:
    """What is described and the first variant that runs."""
    for name in names:
        found = list(_compared(runs, [name], together, length))
        if found:
            yield from found
            return


def _compared(
    runs: Runs, names: Sequence[str], together: str, length: float
) -> Iterator[Comparison]:
    """What is described and variants of it beside each other, all with one variant more."""
    base: Combination = (together,) if together else ()
    chosen = {AS_DESCRIBED: base} | {name: (*base, name) for name in names}
    motions = {name: runs.of(variants) for name, variants in chosen.items()}
    known = {name: m for name, m in motions.items() if isinstance(m, Motion)}
    if len(known) > 1 and AS_DESCRIBED in known:
        shown = list(known)[:MOST_RUNS]
        yield Comparison(tuple(shown), together, tuple(known[n] for n in shown), length)


# blocks


def _course(nominal: Deployment) -> str:
    return (
        "Variants of the description are run in the same way as the robot itself, for "
        f"{nominal.duration:g} s. Variants that change the same entries are alternatives: each set "
        "of them is shown by itself or together with a variant that has no alternative, whichever "
        "makes more of a difference between the first two. Variants without alternatives are shown "
        "beside each other. Differences are from what is described."
    )


def _refusals(runs: Runs) -> list[Block]:
    told = [(" + ".join(c), m) for c, m in runs.told.items() if isinstance(m, str)]
    return [Paragraph(f"There is no run of {name}: {reason}") for name, reason in told]


def _picture(context: Context, one: Comparison, k: int) -> Picture:
    first = one.motions[0]
    moved = None if first.travel is None else first.outputs[first.travel].name
    ranked = sorted(one.quantities, key=lambda pair: (pair[0].name != moved, -one.size(*pair)))
    seen = [pair for pair in ranked if one.size(*pair) > SEEN][:MOST]
    drawn = [Compared(q.label, np.rad2deg(v) if q.unit == "rad" else v) for q, v in seen]
    speeds = [m.speed for m in one.motions if m.speed is not None]
    if len(drawn) < MOST and speeds and seen[0][0].name == moved:
        drawn.insert(1, Compared(speeds[0].label, np.array([speed.shown for speed in speeds])))
    figure = view.draw_comparison(first.time, drawn, one.names)
    caption = f"{_listed(one)}, and below each the difference from what is described."
    return context.picture(f"variants-{k + 1}", figure, caption, caption)


def _listed(one: Comparison) -> str:
    also = f", all with {one.together}" if one.together else ""
    return f"Runs of {', '.join(one.names)}{also}"


def _table(one: Comparison) -> Table:
    time, names = one.motions[0].time, one.names[1:]
    rows: list[list[Cell]] = []
    for quantity, values in one.quantities:
        if one.size(quantity, values) <= SEEN:
            continue
        known = quantity.unit in ("m", "rad")
        apart = (1e3 if known else 1.0) * (values[1:] - values[0])
        small = [one.size(quantity, np.array([values[0], v])) <= SEEN for v in values[1:]]
        cells = [
            "none" if none else _largest(a, time) for a, none in zip(apart, small, strict=True)
        ]
        rows.append([f"{quantity.name} [{'m' if known else ''}{quantity.unit}]", *cells])
    caption = f"Largest differences from what is described{_with(one)}, and when they are reached."
    return Table(("output", *names), rows, caption)


def _largest(apart: Array, time: Array) -> str:
    at = int(np.abs(apart).argmax())
    return f"{written(float(f'{apart[at]:.3g}'))} at {written(float(time[at]), 3)} s"


def _with(one: Comparison) -> str:
    return f", all with {one.together}" if one.together else ""


def _data(one: Comparison) -> dict[str, Any]:
    return {
        "names": list(one.names),
        "together_with": one.together,
        "time": one.motions[0].time,
        "outputs": {q.name: {"unit": q.unit, "values": v} for q, v in one.quantities},
    }
