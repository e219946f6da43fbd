"""How likely it is that a requirement is missed, and quantiles, with intervals."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gough.errors import UnknownName
from gough.uncertainty.errors import EnsembleError
from gough.uncertainty.outputs import checked_confidence
from gough.uncertainty.plain import count, number, percent, plain, share, short, table

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

Relation = Literal["<", "<=", ">", ">="]
RELATIONS = {"<": np.less, "<=": np.less_equal, ">": np.greater, ">=": np.greater_equal}
CRITERION = re.compile(r"\s*(.+?)\s*(<=|>=|<|>|≤|≥)\s*(\S+)\s*")

Lost = Literal["missed", "excluded"]
LOST = ("missed", "excluded")
Method = Literal["clopper-pearson", "wilson"]
METHODS = ("clopper-pearson", "wilson")
Beyond = Literal["excluded", "highest", "lowest"]
BEYOND = ("excluded", "highest", "lowest")


@dataclass(frozen=True)
class Criterion:
    """What is required of an output: `overshoot <= 0.1` holds up to the limit, and is missed
    beyond."""

    output: str
    relation: Relation
    limit: float

    def __post_init__(self) -> None:
        if self.relation not in RELATIONS:
            raise UnknownName("relation", self.relation, RELATIONS)
        if not math.isfinite(self.limit):
            raise EnsembleError(f"{self.output}: the limit is {self.limit}, expected a number")

    @classmethod
    def read(cls, text: str) -> Criterion:
        """A criterion from a text, as `overshoot <= 0.1`.

        Raises:
            EnsembleError: the text is none.
        """
        match = CRITERION.fullmatch(text)
        try:
            if match:
                relation: Any = {"≤": "<=", "≥": ">="}.get(match[2], match[2])
                return cls(match[1], relation, float(match[3]))
        except ValueError:
            pass
        raise EnsembleError(
            f"{text!r} is no criterion: expected an output, one of {', '.join(RELATIONS)} and a "
            "number, as in overshoot <= 0.1"
        )

    def holds(self, values: ArrayLike) -> Mask:
        """Where the requirement is met; False where there is no value."""
        y = np.asarray(values, np.float64)
        return np.asarray(RELATIONS[self.relation](y, self.limit) & np.isfinite(y))

    def __str__(self) -> str:
        return f"{self.output} {self.relation} {number(self.limit)}"


@dataclass(frozen=True)
class FailureProbability:
    """How likely it is that a requirement is missed."""

    name: str
    """The criterion, or *any of them*."""
    runs: int
    lost: int
    """Runs without a value."""
    lost_are: Lost
    """Whether these count as missed, or not at all."""
    missed: int
    """Runs that miss the requirement, with those without a value if they count."""
    counted: int
    """Runs that count."""
    low: float
    high: float
    confidence: float
    method: Method

    @property
    def probability(self) -> float:
        """The part of the runs that miss it."""
        return self.missed / self.counted

    def as_dict(self) -> dict[str, Any]:
        """The content as plain data."""
        return {
            "name": self.name,
            "probability": self.probability,
            "interval": [self.low, self.high],
            "confidence": self.confidence,
            "method": self.method,
            "missed": self.missed,
            "counted": self.counted,
            "runs": self.runs,
            "lost": self.lost,
            "lost_are": self.lost_are,
        }

    @property
    def _row(self) -> list[str]:
        interval = f"[{share(self.low)}, {share(self.high)}]"
        return [self.name, f"{self.missed} of {self.counted}", share(self.probability), interval]

    @property
    def note(self) -> str:
        """What was done about runs without a value; "" where there are none."""
        if not self.lost:
            return ""
        done = "counted as missed" if self.lost_are == "missed" else "left out"
        return f"{self.name}: {count(self.lost, 'run')} of {self.runs} without a value, {done}"

    def __str__(self) -> str:
        name, missed, part, interval = self._row
        text = f"{name}: missed in {missed} runs, {part} {interval} ({percent(self.confidence)}, "
        return text + f"{self.method})" + (f"\n{self.note}" if self.note else "")


@dataclass(frozen=True)
class Reliability:
    """Several requirements, each by itself and all of them together."""

    each: tuple[FailureProbability, ...]
    any: FailureProbability
    """That at least one of them is missed."""

    def as_dict(self) -> dict[str, Any]:
        """The content as plain data."""
        return {"each": [part.as_dict() for part in self.each], "any": self.any.as_dict()}

    def __str__(self) -> str:
        head = f"probability of missing a requirement ({percent(self.any.confidence)} intervals, "
        parts = [*self.each, self.any] if len(self.each) > 1 else list(self.each)
        rows = [["", "missed", "part", "interval"], *(part._row for part in parts)]
        notes = [part.note for part in parts if part.note]
        return "\n".join([head + f"{self.any.method})", *table(rows), *notes])


def failure_probability(
    criterion: Criterion | str,
    values: ArrayLike,
    *,
    lost: Lost = "missed",
    confidence: float = 0.95,
    method: Method = "clopper-pearson",
) -> FailureProbability:
    """How likely it is that one requirement is missed, from its output in independent runs.

    Args:
        criterion: the requirement.
        values: of its output, (runs,); NaN or infinite where a run has no value.
        lost: whether runs without a value count as *missed* or are *excluded*; excluded, the answer
            is for runs that end well only.
        confidence: of the interval.
        method: *clopper-pearson* covers at least the confidence (Clopper and Pearson 1934);
            *wilson* is shorter and covers it on average (Wilson 1927). Both take runs as
            independent; for a Latin hypercube or a Sobol' sequence they tend to be too wide.

    Raises:
        EnsembleError: there are no runs that count.
    """
    criterion = Criterion.read(criterion) if isinstance(criterion, str) else criterion
    y = np.asarray(values, np.float64)
    if y.ndim != 1:
        raise EnsembleError(f"{criterion.output} has the shape {y.shape}, expected (runs,)")
    known = np.isfinite(y)
    return _probability(str(criterion), ~criterion.holds(y), known, (lost, confidence, method))


def reliability(
    criteria: Sequence[Criterion | str],
    outputs: Mapping[str, ArrayLike],
    *,
    lost: Lost = "missed",
    confidence: float = 0.95,
    method: Method = "clopper-pearson",
) -> Reliability:
    """How likely it is that each of several requirements is missed, and any of them.

    Args:
        criteria: requirements.
        outputs: values by name, (runs,) each.
        lost, confidence, method: as for `failure_probability`.

    Raises:
        UnknownName: a criterion names no output.
        EnsembleError: there are no criteria, or no runs that count.
    """
    read = [Criterion.read(c) if isinstance(c, str) else c for c in criteria]
    if not read:
        raise EnsembleError("there are no criteria: expected at least one, as overshoot <= 0.1")
    for c in read:
        if c.output not in outputs:
            raise UnknownName("output", c.output, outputs)
    how = lost, confidence, method
    each = tuple(
        failure_probability(c, outputs[c.output], lost=lost, confidence=confidence, method=method)
        for c in read
    )
    columns = [np.asarray(outputs[c.output], np.float64) for c in read]
    if len({len(y) for y in columns}) > 1:
        raise EnsembleError(f"outputs have {[len(y) for y in columns]} runs, expected as many each")
    missed = np.any([~c.holds(y) for c, y in zip(read, columns, strict=True)], axis=0)
    known = np.all(np.isfinite(columns), axis=0)
    return Reliability(each, _probability("any of them", missed, known, how))


def _probability(
    name: str, missed: Mask, known: Mask, how: tuple[Lost, float, Method]
) -> FailureProbability:
    lost, confidence, method = how
    if lost not in LOST:
        raise UnknownName("way with runs without a value", lost, LOST)
    if method not in METHODS:
        raise UnknownName("interval", method, METHODS)
    checked_confidence(confidence)
    counted = known if lost == "excluded" else np.ones_like(known)
    n, x = int(counted.sum()), int((missed & counted).sum())
    if not n:
        raise EnsembleError(f"{name}: none of {len(known)} runs has a value")
    interval = clopper_pearson if method == "clopper-pearson" else wilson
    low, high = interval(x, n, confidence)
    return FailureProbability(
        name, len(known), int(np.sum(~known)), lost, x, n, low, high, confidence, method
    )


def clopper_pearson(x: int, n: int, confidence: float = 0.95) -> tuple[float, float]:
    """Interval of a probability from x of n, from beta distributions (Clopper and Pearson 1934).

    It covers the probability with at least the confidence, whatever it is.
    """
    from scipy.special import betaincinv

    tail = (1 - confidence) / 2
    low = float(betaincinv(x, n - x + 1, tail)) if x > 0 else 0.0
    high = float(betaincinv(x + 1, n - x, 1 - tail)) if x < n else 1.0
    return low, high


def wilson(x: int, n: int, confidence: float = 0.95) -> tuple[float, float]:
    """Interval of a probability from x of n, where |p̂ - p| ≤ z √(p (1 - p) / n) (Wilson 1927)."""
    from scipy.special import ndtri

    z2 = float(ndtri((1 + confidence) / 2)) ** 2
    middle = (x + z2 / 2) / (n + z2)
    half = math.sqrt(z2 * (x * (n - x) / n + z2 / 4)) / (n + z2)
    low = 0.0 if x == 0 else middle - half
    return low, 1.0 if x == n else middle + half


# quantiles


@dataclass(frozen=True)
class Quantiles:
    """Values that given parts of all runs stay below."""

    output: str
    levels: tuple[float, ...]
    values: Array
    """(levels,)."""
    low: Array
    """(levels,); -inf where so few runs can not bound it."""
    high: Array
    """(levels,); inf where so few runs can not bound it."""
    coverage: Array
    """How likely an interval covers its quantile, at least the confidence, (levels,)."""
    runs: int
    lost: int
    """Runs without a value."""
    lost_are: Beyond
    """Whether these are left out, or count as higher or lower than all others."""
    confidence: float

    def as_dict(self) -> dict[str, Any]:
        """The content as plain data; None for bounds that so few runs do not give."""
        return {
            "output": self.output,
            "levels": list(self.levels),
            "values": plain(self.values),
            "low": plain(self.low),
            "high": plain(self.high),
            "coverage": plain(self.coverage),
            "runs": self.runs,
            "lost": self.lost,
            "lost_are": self.lost_are,
            "confidence": self.confidence,
        }

    def __str__(self) -> str:
        head = f"quantiles of {self.output} in {count(self.runs, 'run')} "
        rows = [["", "value", "interval"]]
        for level, *row in zip(self.levels, self.values, self.low, self.high, strict=True):
            value, low, high = (short(x, 5) for x in row)
            rows.append([f"{100 * level:g} %", value, f"[{low}, {high}]"])
        lines = [f"{head}({percent(self.confidence)} intervals, by order)", *table(rows)]
        if self.lost:
            done = "left out" if self.lost_are == "excluded" else f"taken as {self.lost_are}"
            lines.append(f"{count(self.lost, 'run')} without a value, {done}")
        return "\n".join(lines)


def quantiles(
    values: ArrayLike,
    levels: Sequence[float] = (0.05, 0.5, 0.95),
    *,
    output: str = "y",
    lost: Beyond = "excluded",
    confidence: float = 0.95,
) -> Quantiles:
    """Quantiles of an output with intervals that hold for any distribution.

    Of n values in order the l-th and the u-th enclose the quantile of level p with the probability
    that l ≤ B < u, where B is binomial (n, p): how many values stay below it (David and Nagaraja
    2003, ch. 7.1). l is the largest and u the smallest with a tail of at most half the rest each.

    Args:
        values: (runs,); NaN or infinite where a run has no value.
        levels: in (0, 1).
        output: its name.
        lost: whether runs without a value are *excluded*, or count as the *highest* or *lowest*.
        confidence: of the intervals; runs are taken as independent.

    Raises:
        EnsembleError: a level is not between 0 and 1, or no run has a value.
    """
    y = np.asarray(values, np.float64)
    checked_confidence(confidence)
    if lost not in BEYOND:
        raise UnknownName("way with runs without a value", lost, BEYOND)
    for level in levels:
        if not 0 < level < 1:
            raise EnsembleError(f"a level is {level}, expected numbers between 0 and 1")
    known = np.isfinite(y)
    if y.ndim != 1 or not known.any():
        raise EnsembleError(
            f"{output} has the shape {y.shape} and {int(known.sum())} values, expected (runs,) and "
            "at least one"
        )
    if lost == "excluded":
        y = y[known]
    else:
        y = np.where(known, y, np.inf if lost == "highest" else -np.inf)
    y = np.sort(y)
    found = np.array([[_between(y, p), *_by_order(y, p, confidence)] for p in levels])
    value, low, high, coverage = found.reshape(-1, 4).T
    missing = int(np.sum(~known))
    return Quantiles(
        output, tuple(levels), value, low, high, coverage, len(known), missing, lost, confidence
    )


def _between(y: Array, level: float) -> float:
    """The quantile of sorted values, linear between neighbours (Hyndman and Fan 1996, type 7)."""
    place = level * (len(y) - 1)
    k = math.floor(place)
    below, above = float(y[k]), float(y[min(k + 1, len(y) - 1)])
    if below == above or place == k or math.isinf(below):
        return below
    return below + (above - below) * (place - k)


def _by_order(y: Array, level: float, confidence: float) -> tuple[float, float, float]:
    """Two of the sorted values that enclose the quantile, and how likely they do."""
    from scipy.stats import binom

    n, tail = len(y), (1 - confidence) / 2
    below = binom(n, level)
    lower, upper = int(below.ppf(tail)), int(below.ppf(1 - tail)) + 1
    low = float(y[lower - 1]) if lower >= 1 else -math.inf
    high = float(y[upper - 1]) if upper <= n else math.inf
    return low, high, float(below.cdf(upper - 1) - below.cdf(lower - 1))
