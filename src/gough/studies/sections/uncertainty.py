"""What the numbers of a description do to the motion that its laws of force make: an ensemble."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from gough import view
from gough.errors import GoughError
from gough.robot import Robot
from gough.simulation.factors import every_parameter
from gough.simulation.many import Many, ensemble_of, simulate_many
from gough.simulation.simulate import Request
from gough.studies.context import Context
from gough.studies.deployments import Deployment, turned
from gough.studies.numbers import written
from gough.studies.report import Block, Cell, Paragraph, Picture, Section, Table
from gough.uncertainty import (
    Criterion,
    Distribution,
    OneAtATime,
    Reliability,
    SaltelliDesign,
    SobolIndices,
    Tornado,
    reliability,
    sobol_indices,
)
from gough.view import IndexBars, Limit

Array = NDArray[np.float64]

NAME, TITLE = "uncertainty", "What scatter of the parameters does to the motion"
SHARE = "±10 %"
"""Distribution of every number about its value: uniform; a guess."""
RUNS = 15_000
"""Runs of an ensemble at most; base rows are the largest power of 2 that keeps to it."""
SLOW_RUNS = 1_500
"""The same where runs are made in joints, whose loops are closed one by one."""
LEAST_BASE = 16
RTOL = 1e-6
LATE, TURNED, LEFT = 1.1, 30.0, 2.0
"""Limits of what is asked for: parts of the nominal time, degrees, % of the largest kinetic
energy; all three are guesses."""
SHOWN = 8
"""Factors of a table."""
MISSING = 0.5
"""Part of base rows that may be lost before there are no indices."""


@dataclass(frozen=True)
class Design:
    """Rows for a tornado, then rows for Sobol' indices, so that one ensemble has both."""

    saltelli: SaltelliDesign

    @cached_property
    def single(self) -> OneAtATime:
        """One factor at a time, in shares of its values."""
        k = self.saltelli.factors
        share = Distribution.read("uniform(0, 1)")
        return OneAtATime.of([str(n) for n in range(k)], [share] * k)

    def __len__(self) -> int:
        return len(self.single) + len(self.saltelli)

    def rows(self, start: int = 0, stop: int | None = None) -> Array:
        """Rows start … stop-1, in (0, 1)."""
        stop, first = len(self) if stop is None else stop, len(self.single)
        parts = (
            self.single.rows(min(start, first), min(stop, first)),
            self.saltelli.rows(max(start - first, 0), max(stop - first, 0)),
        )
        return np.concatenate(parts)

    def as_dict(self) -> dict[str, Any]:
        """The content as plain data."""
        return {"one_at_a_time": len(self.single), "saltelli": self.saltelli.as_dict()}


@dataclass(frozen=True)
class Output:
    """One number of every run."""

    name: str
    unit: str
    values: Array
    """(runs,), NaN of runs without a value."""
    limit: Criterion

    @property
    def label(self) -> str:
        """Name and unit."""
        return f"{self.name} [{self.unit}]"


@dataclass(frozen=True)
class Spread:
    """An ensemble, and what follows from it."""

    factors: tuple[str, ...]
    labels: tuple[str, ...]
    """Factors with their units."""
    values: Array
    """Of the factors, (runs, factors)."""
    outputs: tuple[Output, ...]
    design: Design
    endings: str

    @property
    def first(self) -> int:
        """The first run for Sobol' indices."""
        return len(self.design.single)

    @cached_property
    def independent(self) -> NDArray[np.intp]:
        """Runs of blocks A and B, which do not repeat each other."""
        count = len(self.design.saltelli)
        block = self.design.saltelli.place(np.arange(count))[1]
        return np.flatnonzero(block < 2) + self.first

    @cached_property
    def indices(self) -> SobolIndices:
        """Sobol' indices of all outputs."""
        outputs = np.column_stack([o.values[self.first :] for o in self.outputs])
        names = [o.name for o in self.outputs]
        return sobol_indices(outputs, self.factors, names, missing=MISSING)

    @cached_property
    def tornado(self) -> Tornado:
        """Outputs with one factor at a time at its 5 % and 95 % quantiles."""
        outputs = np.column_stack([o.values[: self.first] for o in self.outputs])
        found = self.design.single.tornado(outputs, [o.name for o in self.outputs])
        return replace(found, factors=self.factors)

    @cached_property
    def reliability(self) -> Reliability:
        """How likely a limit is missed."""
        values = {o.limit.output: o.values[self.independent] for o in self.outputs}
        return reliability([o.limit for o in self.outputs], values)


def section(context: Context) -> Section | None:
    """Indices, pictures and probabilities; None for a robot whose laws move nothing to a stop."""
    nominal = context.deployment
    if isinstance(nominal, str) or not nominal.whole or not nominal.motion.outputs:
        return None
    context.progress("simulating an ensemble")
    try:
        found = spread(context.robot, nominal, context.seed)
        if isinstance(found, str):
            return Section(NAME, TITLE, [Paragraph(found)], {"uncertainty": None})
        blocks = _blocks(context, nominal, found)
    except GoughError as error:
        text = f"Nothing is said of scatter: {error}."
        return Section(NAME, TITLE, [Paragraph(text)], {"uncertainty": None})
    return Section(NAME, TITLE, blocks, {"uncertainty": _data(found)})


def spread(robot: Robot, nominal: Deployment, seed: int = 0) -> Spread | str:
    """The ensemble of a robot about its nominal run, or a sentence that says why there is none."""
    vary = every_parameter(robot.mechanism, SHARE)
    if not vary:
        return "Nothing is said of scatter: the description has no parameter that is a number."
    most = RUNS if '"coordinates": "x"' in nominal.run.attrs["formulations"] else SLOW_RUNS
    base = 2 ** int(math.log2(max(most / (len(vary) + 2), 1)))
    if base < LEAST_BASE:
        text = f"Nothing is said of scatter: {len(vary)} parameters take more than {most} runs."
        return text
    design = Design(SaltelliDesign(base, len(vary), seed=seed))
    request = Request(nominal.duration, rtol=RTOL)
    many = Many(len(design), vary, progress=False, seed=seed)
    values = robot.assembler.values
    live = {name: values[name] for name, p in robot.mechanism.parameters.items() if p.live}
    ensemble = ensemble_of(robot.mechanism, robot.structure.modelling, live, request, many)
    ensemble = replace(ensemble, design=cast(Any, design))
    runs = simulate_many(ensemble, many, {})
    return Spread(
        tuple(vary),
        tuple(_labelled(robot, name) for name in vary),
        runs["factor"].values,
        tuple(_outputs(nominal, runs)),
        design,
        runs.attrs["endings"],
    )


def _labelled(robot: Robot, factor: str) -> str:
    """A factor with its unit; of several in a text that of its entry."""
    name, *entry = re.split(r"[\[\]]+", factor.rstrip("]"))
    units = [unit.strip() for unit in robot.mechanism.parameters[name].unit.split(",")]
    place = int(entry[0]) if entry and len(units) > 1 else 0
    unit = units[min(place, len(units) - 1)]
    return f"{factor} [{unit}]" if unit else factor


def _outputs(nominal: Deployment, runs: Any) -> list[Output]:
    """When the last stop was met, how far the platform has turned, what still moves."""
    lost = ~np.isfinite(runs["end"].values)
    met = list(nominal.contacts)
    first = runs["first"].sel(event=met).values
    time = np.where(lost, np.nan, first.max(axis=1))
    limit = float(f"{LATE * nominal.time:.2g}")
    found = [Output("time of deployment", "s", time, Criterion("time of deployment", "<=", limit))]
    twist = nominal.motion.twist
    if twist is not None:
        name = f"size of {nominal.motion.outputs[twist].name}"
        home = nominal.run["pose"].values[0, 3:]
        turn = np.rad2deg(turned(runs["pose"].values[:, 3:], home)[:, twist - 3])
        # the sign of half a turn would jump, its size does not
        size = np.where(lost, np.nan, np.abs(turn))
        found.append(Output(name, "°", size, Criterion(name, "<=", TURNED)))
    most = float(nominal.run["energy_kinetic"].values.max())
    kinetic = runs["energy"].sel(energy_kind="kinetic").values
    left = np.where(lost, np.nan, 100 * kinetic / most)
    asked = Criterion("kinetic energy left", "<=", LEFT)
    return [*found, Output("kinetic energy left", "%", left, asked)]


# blocks


def _blocks(context: Context, nominal: Deployment, found: Spread) -> list[Block]:
    texts = [_course(nominal, found), _meaning(found)]
    blocks: list[Block] = [Paragraph(text) for text in texts]
    blocks += [_bars(context, found), *_tables(context.robot, found)]
    blocks.append(_scatter(context, found))
    blocks += [_tornado(context, found, k) for k in range(len(found.outputs))]
    blocks += [Paragraph(_asked(nominal, found)), _missed(found)]
    return [*blocks, *(_histogram(context, found, k) for k in range(len(found.outputs)))]


def _course(nominal: Deployment, found: Spread) -> str:
    saltelli = found.design.saltelli
    return (
        f"Every number other than zero among the parameters is scattered by {SHARE}, uniformly and "
        f"independently of the others: {len(found.factors)} factors. {len(saltelli)} runs of "
        f"{nominal.duration:g} s ({saltelli.base} base rows of a Saltelli design, relative "
        f"tolerance {written(RTOL)}) give the indices; {found.first} more move one factor at a "
        f"time. How they ended: {found.endings}. The scatter is our choice, not known of a "
        "machine: indices say what to look at first, and the probabilities below hold for it alone."
    )


def _meaning(found: Spread) -> str:
    defined = {
        "time of deployment": "the moment at which the last end stop is met for the first time",
        "kinetic energy left": "that at the end of a run over the largest of the nominal run",
    }
    turn = "that of the platform's rotation vector from home at the end of a run, either way"
    told = "; ".join(f"{o.name} is {defined.get(o.name, turn)}" for o in found.outputs)
    alone = found.indices.first.sum(axis=1)
    least = int(np.argmin(alone))
    text = (
        f"Outputs: {told}. The first-order index is the part of the variance that goes if this "
        "factor alone is known, the total index the part that stays if all others are. "
    )
    if alone[least] < 0.5:
        text += (
            f"Of {found.outputs[least].name} first-order indices explain "
            f"{written(100 * max(alone[least], 0.0), 2)} %: it depends on factors together, such "
            "as on how much two of a kind differ, and not on any of them by itself."
        )
    return text


def _bars(context: Context, found: Spread) -> Picture:
    s = found.indices
    panels = [
        IndexBars(o.name, s.first[k], s.total[k], s.first_interval[k], s.total_interval[k])
        for k, o in enumerate(found.outputs)
    ]
    caption = (
        "Sobol' indices of the outputs with 95 % intervals from "
        f"{s.resamples} resamples of {s.base_rows} base rows."
    )
    return context.picture("sobol", view.draw_index_bars(found.factors, panels), caption, caption)


def _tables(robot: Robot, found: Spread) -> list[Block]:
    s, tables = found.indices, list[Block]()
    for k, output in enumerate(found.outputs):
        rows: list[list[Cell]] = []
        for name in s.ranked(output.name)[:SHOWN]:
            i = s.factors.index(name)
            parts = (s.first, s.first_interval), (s.total, s.total_interval)
            cells = [_with_interval(v[k, i], ends[k, i]) for v, ends in parts]
            about = robot.mechanism.parameters[name.partition("[")[0]].about
            rows.append([found.labels[i], *cells, about])
        spread = f"mean {_few(s.mean[k])}, standard deviation {_few(np.sqrt(s.variance[k]))}"
        caption = f"Sensitivity of {output.label}, {spread}: Sobol' indices with 95 % intervals"
        more = len(s.factors) - SHOWN
        caption += f"; {more} factors with smaller totals are in report.json." if more > 0 else "."
        tables.append(Table(("factor", "first order", "total", "what"), rows, caption))
    tables += [Paragraph(f"{note}.") for note in s.notes]
    return tables


def _few(value: float) -> str:
    return written(float(value), 3)


def _with_interval(value: float, ends: Array) -> str:
    low, mid, high = (f"{round(x, 2) + 0.0:.2f}" for x in (ends[0], value, ends[1]))
    text = f"{mid} [{low}, {high}]".replace("-", "\N{MINUS SIGN}")
    return text.replace(" ", "\N{NO-BREAK SPACE}")


def _scatter(context: Context, found: Spread) -> Picture:
    runs = found.independent
    outputs = np.column_stack([o.values[runs] for o in found.outputs])
    labels = [o.label for o in found.outputs]
    figure = view.draw_scatter(
        found.values[runs], outputs, found.labels, labels, found.indices.total
    )
    caption = (
        f"Outputs over the factors with the largest total indices, {len(runs)} independent runs."
    )
    return context.picture("scatter", figure, caption, caption)


def _tornado(context: Context, found: Spread, k: int) -> Picture:
    t, output = found.tornado, found.outputs[k]
    nominal, low, high = _cleared(t.nominal[k], t.at_low[k], t.at_high[k])
    swing = np.nan_to_num(np.abs([low - nominal, high - nominal]), nan=np.inf).max(axis=0)
    kept = np.flatnonzero(swing > 0)
    names = [found.labels[i] for i in kept]
    figure = view.draw_tornado(names, low[kept], high[kept], float(nominal), output.label)
    caption = f"What one factor by itself does to the {output.name}, all others nominal."
    if len(kept) < len(found.labels):
        caption += f" {len(found.labels) - len(kept)} factors by themselves do nothing to be seen."
    return context.picture(f"tornado-{_file(output)}", figure, caption, caption)


def _cleared(*values: Any) -> list[Array]:
    """Numbers rounded to 10⁻⁵ of the largest: what is less is the integration's."""
    size = max(float(np.nanmax(np.abs(value), initial=0.0)) for value in values) or 1.0
    digits = 5 - math.ceil(math.log10(size))
    return [np.round(value, digits) + 0.0 for value in values]


def _file(output: Output) -> str:
    return output.name.replace(" ", "-")


def _asked(nominal: Deployment, found: Spread) -> str:
    asked = "; ".join(_limit(o) for o in found.outputs)
    return (
        f"What is asked for, our choice again: {asked}. The limit of time is {LATE:g} times the "
        f"nominal {written(nominal.time, 3)} s. Probabilities of missing a limit are from the "
        f"{len(found.independent)} runs that do not repeat each other; runs without a value count "
        "as missed."
    )


def _limit(output: Output) -> str:
    limit = written(output.limit.limit)
    return f"{output.limit.output} ≤ {limit} {output.unit}"


def _missed(found: Spread) -> Table:
    rows: list[list[Cell]] = []
    names = [*(_limit(o) for o in found.outputs), "any of them"]
    parts = [*found.reliability.each, found.reliability.any]
    for name, part in zip(names, parts, strict=True):
        ends = f"{_percent(part.low)} to {_percent(part.high)}"
        missed = f"{part.missed} of {part.counted}"
        rows.append([name, missed, _percent(part.probability), ends])
    caption = "Probability of missing a limit, with 95 % intervals after Clopper and Pearson."
    return Table(("limit", "missed", "probability", "interval"), rows, caption)


def _percent(value: float) -> str:
    return f"{100 * value:.3g} %"


def _histogram(context: Context, found: Spread, k: int) -> Picture:
    output, part = found.outputs[k], found.reliability.each[k]
    text = (
        f"limit {written(output.limit.limit)} {output.unit}\nmissed: {_percent(part.probability)} "
        f"({_percent(part.low)} to {_percent(part.high)})"
    )
    values = output.values[found.independent]
    figure = view.draw_histogram(values, output.label, Limit(output.limit.limit, "above", text))
    caption = f"Spread of the {output.limit.output}, and the limit that is asked for."
    return context.picture(f"spread-{_file(output)}", figure, caption, caption)


def _data(found: Spread) -> Mapping[str, Any]:
    return {
        "share": SHARE,
        "rtol": RTOL,
        "design": found.design.as_dict(),
        "endings": found.endings,
        "sobol": found.indices.as_dict(),
        "tornado": found.tornado.as_dict(),
        "reliability": found.reliability.as_dict(),
    }
