"""What a run or an ensemble has come to, in words and as plain data; from the dataset alone."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from gough.dynamics.dynamics import Dynamics
from gough.geometry.coordinates import Coordinates
from gough.numerics.integration import Ending
from gough.simulation.saving import endings, unit_of

if TYPE_CHECKING:
    import xarray

Array = NDArray[np.float64]

SHOWN_TIMES = 21
"""Rows of the table of outputs at most; the last time is always among them."""
SHOWN_COLUMNS = 8
"""Coordinates in a table at most, where a mechanism has no outputs."""
SHOWN_EVENTS = 12
"""Names of events that are told."""
DIGITS = 4
"""Digits of the largest number of a table."""
SMALLEST = 9
"""Digits behind the point at most."""
ROUNDING = 1e-9
"""Coordinates below this are told as 0, m and rad."""
NOISE = 1e-6
"""Part of the largest number below which changes are not told."""
LEVELS = (0.05, 0.5, 0.95)
"""Quantiles that are told of an ensemble."""
ENERGIES = ("kinetic", "potential", "stored", "delivered", "dissipated")
REASONS = {ending.name: ending.value for ending in Ending} | {
    "not_closed": "the loops do not close with the parameters and the start of the run"
}
GOOD = ("finished", "stopped")
"""Endings of runs that came to an end of their own."""


def summary(
    dataset: xarray.Dataset, units: Mapping[str, str] | None = None
) -> RunSummary | EnsembleSummary:
    """The summary of a dataset of `Robot.simulate`, also of one that was read from a file.

    Args:
        dataset: of one run, or of an ensemble.
        units: of outputs and joints by name, where the dataset names several; see `units_of`.
    """
    kind = EnsembleSummary if "row" in dataset.dims else RunSummary
    return kind(dataset, dict(units or {}))


def units_of(dynamics: Dynamics) -> dict[str, str]:
    """Units of outputs and of joints' variables by name."""
    outputs = Coordinates(dynamics.models, "operational")
    variables = dynamics.structure.variables
    found = {variable.name: str(variable.unit) for variable in variables}
    return found | dict(zip(outputs.names, outputs.units, strict=True))


@dataclass(frozen=True)
class Outputs:
    """Coordinates that are told of a motion."""

    names: list[str]
    units: list[str]
    values: Array
    """(rows, coordinates)."""
    rate_names: list[str]
    rates: Array


@dataclass(frozen=True)
class Happened:
    """Events of one name."""

    name: str
    times: list[float]


@dataclass(frozen=True)
class RunSummary:
    """One run.

    Args:
        dataset: of the run.
        units: of outputs and joints by name.
    """

    dataset: xarray.Dataset
    units: Mapping[str, str] = field(default_factory=dict)

    @property
    def ending(self) -> str:
        """Name of the ending."""
        return str(self.dataset["ending"].values)

    @property
    def good(self) -> bool:
        """Whether the run came to its end, or stopped where it was asked to."""
        return self.ending in GOOD

    @property
    def time(self) -> Array:
        """Times that were seen, s."""
        return np.asarray(self.dataset["time"].values, dtype=float)

    @property
    def end(self) -> float:
        """Time of the end, s."""
        return float(self.dataset.attrs["end"])

    @cached_property
    def outputs(self) -> Outputs:
        """The outputs; of a mechanism without them the joints that are independent at first."""
        for x, xd in (("pose", "twist"), ("x", "xd")):
            if x in self.dataset:
                return self._coordinates(x, f"{x}_part", xd, f"{xd}_part", None)
        first = json.loads(self.dataset.attrs["formulations"])[0]["independent"]
        known = set(_names(self.dataset["coordinate"]))
        chosen = [name for name in first if name in known]
        return self._coordinates("q", "coordinate", "v", "variable", chosen)

    def _coordinates(
        self, x: str, parts: str, xd: str, rates: str, chosen: list[str] | None
    ) -> Outputs:
        names, rate_names = _names(self.dataset[parts]), _names(self.dataset[rates])
        if chosen is not None:
            names, rate_names = chosen, chosen
        columns = [_names(self.dataset[parts]).index(name) for name in names]
        moving = [_names(self.dataset[rates]).index(name) for name in rate_names]
        told = str(self.dataset[x].attrs.get("units", ""))
        units = [self.units.get(name) or unit_of(told, name) for name in names]
        values, moved = self.dataset[x].values[:, columns], self.dataset[xd].values[:, moving]
        return Outputs(names, units, values, rate_names, moved)

    def energy(self, kind: str) -> Array:
        """Energy of a kind, (times,), J."""
        return np.asarray(self.dataset[f"energy_{kind}"].values)

    @property
    def balance_error(self) -> float:
        """The largest error of the balance of energies, J."""
        return float(np.abs(self.dataset["energy_balance_error"].values).max(initial=0.0))

    @cached_property
    def happened(self) -> list[Happened]:
        """Events by name, in the order of their first times."""
        found: dict[str, list[float]] = {}
        times = self.dataset["event_time"].values.tolist()
        for name, at in zip(_names(self.dataset["event"]), times, strict=True):
            found.setdefault(name, []).append(float(at))
        return [Happened(*pair) for pair in sorted(found.items(), key=lambda p: p[1][0])]

    def counts(self) -> dict[str, int]:
        """Steps taken, steps refused, evaluations, events."""
        names = ("steps", "refused", "evaluations", "events")
        return {name: int(self.dataset.attrs[name]) for name in names}

    # as data

    def as_dict(self) -> dict[str, Any]:
        """The content as plain data."""
        attributes, outputs = self.dataset.attrs, self.outputs
        return {
            "name": str(attributes.get("robot", "")),
            "kind": "run",
            "ending": self.ending,
            "reason": str(self.dataset["ending"].attrs.get("long_name", "")),
            "duration": float(attributes["duration"]),
            "end": self.end,
            "method": str(attributes["method"]),
            "rtol": float(attributes["rtol"]),
            "atol": float(attributes["atol"]),
            "time": _plain(self.time),
            "units": dict(zip(outputs.names, outputs.units, strict=True)),
            "outputs": _by_name(outputs.names, outputs.values),
            "rates": _by_name(outputs.rate_names, outputs.rates),
            "energies": {kind: _plain(self.energy(kind)) for kind in ENERGIES},
            "balance_error": _plain(np.array(self.balance_error)),
            "events": [
                {"name": name, "time": at}
                for name, at in zip(
                    _names(self.dataset["event"]),
                    self.dataset["event_time"].values.tolist(),
                    strict=True,
                )
            ],
            "counts": self.counts(),
            "formulations": json.loads(attributes["formulations"]),
        }

    # in words

    def __str__(self) -> str:
        parts = [[self._first_line()], self._motion(), self._energies(), self._events()]
        return "\n".join([line for part in parts for line in part] + [self._effort()])

    def _first_line(self) -> str:
        attributes = self.dataset.attrs
        reason = str(self.dataset["ending"].attrs.get("long_name", ""))
        name, duration = attributes.get("robot", ""), float(attributes["duration"])
        if self.ending == "finished":
            return f"{name} over {duration:g} s: finished"
        where = f"at {self.end:.6g} s of {duration:g} s"
        stop = self._stop()
        if stop:
            return f"{name}: stopped by {stop} {where}"
        return f"{name}: {self.ending} {where}: {reason}"

    def _stop(self) -> str:
        """Name of the event that a run stopped at."""
        if self.ending != "stopped" or not self.dataset.sizes["event"]:
            return ""
        return _names(self.dataset["event"])[-1]

    def _motion(self) -> list[str]:
        outputs, shown = self.outputs, _spread(len(self.time), SHOWN_TIMES)
        if not outputs.names:
            return []
        columns = list(range(len(outputs.names)))[:SHOWN_COLUMNS]
        titles = [
            f"{outputs.names[k]} [{outputs.units[k] or '?'}]".removesuffix(" [1]") for k in columns
        ]
        titles = [title.removesuffix(" [?]") for title in titles]
        cells = [_column(self.time[shown], self.time, "g"), *self._cells(columns, shown)]
        lines = _aligned([["t [s]", *titles], *map(list, zip(*cells, strict=True))], left=False)
        hidden = len(outputs.names) - len(columns)
        lines += [f"… and {hidden} coordinates more"] if hidden else []
        late = self.end - float(self.time[-1])
        if self.ending != "finished" and late > 0:
            lines.append(f"the end, {late:.3g} s later, is not among the times that were seen")
        return ["", *(f"  {line}" for line in lines)]

    def _cells(self, columns: Sequence[int], shown: NDArray[np.intp]) -> list[list[str]]:
        """Numbers of the coordinates; those of one unit have as many digits behind the point."""
        outputs, cells = self.outputs, []
        for k in columns:
            same = [j for j in columns if outputs.units[j] == outputs.units[k]]
            cells.append(_column(outputs.values[shown, k], outputs.values[:, same]))
        return cells

    def _energies(self) -> list[str]:
        names = [kind for kind in ENERGIES if np.any(self.energy(kind) != 0.0)]
        if not names:
            return ["", "  no energy moved"]
        values = np.array([self.energy(kind) for kind in names])
        size = float(np.abs(values - values[:, :1]).max(initial=0.0))
        largest = max(size, float(np.abs(values).max(initial=0.0)))
        rows = [["energy [J]", "start", "end", "most"]]
        for name, energy in zip(names, values, strict=True):
            told = (energy[0], energy[-1], energy.max())
            rows.append([name, *(_energy(x, largest) for x in told)])
        share = f", {self.balance_error / largest:.1e} of the largest" if largest else ""
        lines = _aligned(rows)
        return [
            "",
            *(f"  {line}" for line in lines),
            f"  balance open by at most {self.balance_error:.1e} J{share}",
        ]

    def _events(self) -> list[str]:
        found = self.happened
        if not found:
            return []
        rows = [["event", "first [s]", "count"]]
        rows += [[e.name, f"{e.times[0]:.6g}", str(len(e.times))] for e in found[:SHOWN_EVENTS]]
        hidden = len(found) - SHOWN_EVENTS
        more = [f"  … and {hidden} names more"] if hidden > 0 else []
        return ["", *(f"  {line}" for line in _aligned(rows)), *more]

    def _effort(self) -> str:
        counts, attributes = self.counts(), self.dataset.attrs
        changed = len(json.loads(attributes["formulations"])) - 1
        again = f", {changed} changes of coordinates" if changed else ""
        if changed == 1:
            again = ", 1 change of coordinates"
        refused = f" and {counts['refused']} refused" if counts["refused"] else ""
        return (
            f"\n  {attributes['method']}, rtol {float(attributes['rtol']):g}: {counts['steps']} "
            f"steps{refused}, {counts['evaluations']} evaluations{again}"
        )


# ensembles


@dataclass(frozen=True)
class Spread:
    """How one number is spread over the runs of an ensemble."""

    name: str
    unit: str
    quantiles: Array
    """At `LEVELS`."""
    count: int
    """Runs that have a value."""


@dataclass(frozen=True)
class EnsembleSummary:
    """Many runs.

    Args:
        dataset: of the ensemble.
        units: of outputs by name.
        seconds: what the making of new rows took, s.
        store: where the rows are kept.
        rows: which rows quantiles are of; all by default. Of a Saltelli design those of its blocks
            A and B, since others repeat them.
    """

    dataset: xarray.Dataset
    units: Mapping[str, str] = field(default_factory=dict)
    seconds: float | None = None
    store: str = ""
    rows: NDArray[np.bool_] | None = None

    @property
    def count(self) -> int:
        """Rows in all."""
        return int(self.dataset.sizes["row"])

    @cached_property
    def endings(self) -> dict[str, int]:
        """How many rows ended how."""
        names, codes = endings(self.dataset), self.dataset["ending"].values
        counts = {name: int(np.sum(codes == k)) for k, name in names.items()}
        return {name: count for name, count in counts.items() if count}

    @property
    def good(self) -> bool:
        """Whether a run came to its end, or stopped where it was asked to."""
        return any(self.endings.get(name, 0) for name in GOOD)

    @cached_property
    def told(self) -> NDArray[np.bool_]:
        """Rows that quantiles are of."""
        codes = [k for k, name in endings(self.dataset).items() if name in GOOD]
        sound = np.isin(self.dataset["ending"].values, codes)
        return sound if self.rows is None else sound & self.rows

    @cached_property
    def outputs(self) -> list[Spread]:
        """Outputs at the end."""
        x = "pose" if "pose" in self.dataset else "x"
        if x not in self.dataset:
            return []
        told = str(self.dataset[x].attrs.get("units", ""))
        names = _names(self.dataset[f"{x}_part"])
        columns = self.dataset[x].values.T
        return [
            self._spread(name, self.units.get(name) or unit_of(told, name), values)
            for name, values in zip(names, columns, strict=True)
        ]

    @cached_property
    def firsts(self) -> list[Spread]:
        """First times of events."""
        if "first" not in self.dataset:
            return []
        names, columns = _names(self.dataset["event"]), self.dataset["first"].values.T
        return [self._spread(n, "s", c) for n, c in zip(names, columns, strict=True)]

    @cached_property
    def measures(self) -> list[Spread]:
        """Numbers that are asked for besides, which are the columns of no other kind."""
        others = ("ending", "end", "energy_balance_error")
        return [
            self._spread(str(name), str(variable.attrs.get("units", "")), variable.values)
            for name, variable in self.dataset.data_vars.items()
            if variable.dims == ("row",) and name not in others
        ]

    def columns(self) -> Iterator[tuple[Spread, Array]]:
        """Outputs, first times and measures, with their values in the rows that are told of."""
        x = "pose" if "pose" in self.dataset else "x"
        given = [*(self.dataset[x].values.T if self.outputs else ())]
        given += [*(self.dataset["first"].values.T if self.firsts else ())]
        given += [self.dataset[spread.name].values for spread in self.measures]
        for spread, values in zip(
            [*self.outputs, *self.firsts, *self.measures], given, strict=True
        ):
            yield spread, values[self.told]

    def _spread(self, name: str, unit: str, values: Array) -> Spread:
        known = values[self.told]
        known = known[np.isfinite(known)]
        found = np.quantile(known, LEVELS) if known.size else np.full(len(LEVELS), np.nan)
        return Spread(name, unit, found, int(known.size))

    @property
    def balance_error(self) -> float:
        """The largest error of the balance of energies of runs that came to an end, J."""
        errors = np.abs(self.dataset["energy_balance_error"].values[self.told])
        return float(np.nanmax(errors, initial=0.0))

    # as data

    def as_dict(self) -> dict[str, Any]:
        """The content as plain data."""
        factors = _names(self.dataset["factor_name"]) if "factor_name" in self.dataset else []
        attributes = self.dataset.attrs
        return {
            "name": str(attributes.get("robot", "")),
            "kind": "ensemble",
            "rows": self.count,
            "endings": self.endings,
            "factors": factors,
            "seed": int(attributes["seed"]),
            "levels": list(LEVELS),
            "outputs": [_spread_data(spread) for spread in self.outputs],
            "events": [_spread_data(spread) for spread in self.firsts],
            "measures": [_spread_data(spread) for spread in self.measures],
            "balance_error": _plain(np.array(self.balance_error)),
            "seconds": self.seconds,
            "store": self.store or None,
        }

    # in words

    def __str__(self) -> str:
        attributes = self.dataset.attrs
        names = ", ".join(f"{count} {name}" for name, count in self.endings.items())
        lines = [f"{attributes.get('robot', '')}: {self.count} runs: {names}"]
        lines += [f"  {name}: {REASONS[name]}" for name in self.endings if name not in GOOD]
        for what, spreads in (
            ("output at the end", self.outputs),
            ("event, first [s]", self.firsts),
            ("measure", self.measures),
        ):
            lines += self._table(what, spreads)
        worst = self.balance_error
        lines += ["", f"  balance of energies open by at most {worst:.1e} J"] if self.good else []
        return "\n".join(lines + self._made())

    def _table(self, what: str, spreads: Sequence[Spread]) -> list[str]:
        """Quantiles and how many runs have a value, where not all have one."""
        shown = [spread for spread in spreads if spread.count][: 3 * SHOWN_EVENTS]
        if not shown:
            return []
        some = any(spread.count < int(self.told.sum()) for spread in shown)
        titles = [f"{100 * level:g} %" for level in LEVELS]
        rows = [[what, *titles, *(["runs"] if some else [])]]
        for spread in shown:
            same = np.array([s.quantiles for s in shown if s.unit == spread.unit]).T
            numbers = _column(spread.quantiles, same)
            unit = "" if spread.unit in ("", "1") or "[s]" in what else f" [{spread.unit}]"
            rows.append([f"{spread.name}{unit}", *numbers, *([str(spread.count)] if some else [])])
        never = len(spreads) - len(shown)
        more = [f"  and {never} that never happened"] if never and "event" in what else []
        return ["", *(f"  {line}" for line in _aligned(rows)), *more]

    def _made(self) -> list[str]:
        lines = []
        if self.seconds is not None:
            rate = self.count / self.seconds if self.seconds else np.inf
            lines.append(
                f"  made in {self.seconds:.3g} s, the making of machine code included: "
                f"{_rounded(rate)} rows/s"
            )
        if self.store:
            lines.append(f"  kept in {self.store}")
        return lines


# parts


def _names(coordinate: xarray.DataArray) -> list[str]:
    return [str(name) for name in coordinate.values]


def _spread(count: int, most: int) -> NDArray[np.intp]:
    """Indices at equal steps over so many rows, and the last one."""
    step = max(1, -(-(count - 1) // (most - 1)))
    return np.unique(np.append(np.arange(0, count, step), count - 1))


def _column(values: Array, scale: Array, kind: str = "f") -> list[str]:
    """Numbers as texts, to one precision: that of the largest of others, (n, columns), and enough
    to see how they change along a column."""
    if kind == "g":
        return [f"{x:.6g}" for x in values.tolist()]
    size = float(np.abs(scale[np.isfinite(scale)]).max(initial=0.0))
    if size < ROUNDING:
        return ["0" if abs(x) < ROUNDING else "-" for x in values.tolist()]
    if size >= 1e6 or size < 1e-4:
        return [f"{x:.{DIGITS - 1}e}" for x in values.tolist()]
    behind = max(DIGITS - 1 - int(np.floor(np.log10(size))), 1 if size >= 1e3 else DIGITS)
    change = float(np.nanmax(np.ptp(scale, axis=0), initial=0.0))
    if change > NOISE * size:
        behind = max(behind, DIGITS - 2 - int(np.floor(np.log10(change))))
    return [_no_minus(f"{x:.{min(behind, SMALLEST)}f}") for x in values.tolist()]


def _no_minus(text: str) -> str:
    """A text of a number; zero has no sign."""
    return text.removeprefix("-") if not text.strip("-0.") else text


def _energy(value: float, largest: float) -> str:
    """An energy; rounding errors are 0."""
    return f"{value:.5g}" if abs(value) > 1e-12 * largest else "0"


def _rounded(rate: float) -> str:
    return f"{rate:,.0f}".replace(",", " ") if rate >= 10 else f"{rate:.2g}"


def _aligned(lines: Sequence[Sequence[str]], left: bool = True) -> list[str]:
    """Lines of a table: the first column to the left, the others to the right."""
    widths = [max(len(line[k]) for line in lines) for k in range(len(lines[0]))]
    found = []
    for line in lines:
        cells = [text.rjust(width) for text, width in zip(line, widths, strict=True)]
        if left:
            cells[0] = line[0].ljust(widths[0])
        found.append("  ".join(cells).rstrip())
    return found


def _by_name(names: Sequence[str], values: Array) -> dict[str, Any]:
    return {name: _plain(values[:, k]) for k, name in enumerate(names)}


def _spread_data(spread: Spread) -> dict[str, Any]:
    return {
        "name": spread.name,
        "unit": spread.unit,
        "quantiles": _plain(spread.quantiles),
        "runs": spread.count,
    }


def _plain(values: Array) -> Any:
    """Nested lists with None for what is no finite number."""
    if values.ndim:
        return [_plain(value) for value in values]
    return float(values) if np.isfinite(values) else None
