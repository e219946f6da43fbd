"""Distributions of uncertain numbers, read from a text or a mapping.

What can be written, with the same in a mapping:

    uniform(0.9, 1.1)                      {uniform: [0.9, 1.1]}
    normal(mean=1, sd=0.1)                 {normal: {mean: 1, sd: 0.1}}
    truncated-normal(1, 0.1, 0.8, 1.2)     mean and sd before truncation, low, high
    lognormal(1, 0.1)                      mean and sd of the variable itself
    triangular(0.9, 1, 1.2)                low, mode, high
    beta(2, 5, 0, 1)                       a, b; low and high are 0 and 1 by default
    scipy(weibull_min, c=1.5, scale=2)     {scipy: {name: weibull_min, c: 1.5, scale: 2}}

About a nominal value: a percentage is a part of it, mean or mode are it where they are left out,
and a lone value is the half width (uniform, triangular) or the standard deviation (normal,
lognormal). ± is uniform.

    ±10 %    ±0.02    normal(5 %)    {uniform: 10 %}    truncated-normal(sd=5 %, low=0 %, high=2)
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from numbers import Real
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gough.errors import UnknownName, closest
from gough.uncertainty.errors import DistributionError
from gough.uncertainty.kinds import KINDS, frozen, scipy_names, scipy_parameters
from gough.uncertainty.plain import number

Array = NDArray[np.float64]

SCIPY = "scipy"
CALL = re.compile(r"\s*([A-Za-z][\w-]*)\s*(?:\((.*)\)|\s(.*))\s*", re.DOTALL)
ABOUT = re.compile(r"\s*(?:±|\+/?-)(.*)", re.DOTALL)
EXAMPLES = "uniform(0.9, 1.1), normal(1, 0.1), ±10 %"


@dataclass(frozen=True)
class Distribution:
    """How one number is distributed."""

    kind: str
    """A name of `gough.uncertainty.kinds`, or *scipy*."""
    parameters: tuple[tuple[str, float], ...]
    family: str = ""
    """The name in scipy.stats, where the kind is *scipy*."""

    def __post_init__(self) -> None:
        values = dict(self.parameters)
        for name, value in values.items():
            if not math.isfinite(value):
                raise DistributionError(f"{self.kind}: {name} is {value}, expected a finite number")
        fault = _scipy_fault(self) if self.kind == SCIPY else KINDS[self.kind].fault(values)
        if fault:
            raise DistributionError(f"{self.kind}: {fault}")

    @classmethod
    def read(cls, value: object, nominal: float | None = None) -> Distribution:
        """A distribution from a text or a mapping with one entry; see the head of this file.

        Args:
            value: the text, the mapping, or a distribution, which is kept.
            nominal: what percentages are parts of, and the default of mean and mode.

        Raises:
            DistributionError: a parameter is missing, or has a value that can not be.
            UnknownName: the kind, a parameter or a distribution of scipy has no such name.
        """
        if isinstance(value, Distribution):
            return value
        if nominal is not None and not math.isfinite(nominal):
            raise DistributionError(f"the nominal value is {nominal}, expected a finite number")
        kind, given = _from_text(value) if isinstance(value, str) else _from_mapping(value)
        if kind == SCIPY:
            return _scipy(given, nominal)
        if kind not in KINDS:
            raise UnknownName("distribution", kind, [*KINDS, SCIPY])
        return cls(kind, _completed(kind, given, nominal))

    def of(self, u: ArrayLike) -> Array:
        """Values at shares u of all values: the inverse distribution function.

        Args:
            u: in (0, 1), any shape; a design gives them.

        Raises:
            DistributionError: a share is not between 0 and 1.
        """
        u = np.asarray(u, np.float64)
        inside = (u > 0) & (u < 1)
        if not inside.all():
            at = tuple(int(k) for k in np.argwhere(~inside)[0])
            where = f" at {at if len(at) > 1 else at[0]}" if at else ""
            raise DistributionError(f"u is {u[at]}{where}, expected a number between 0 and 1")
        if self.kind == SCIPY:
            return np.asarray(self.frozen().ppf(u))
        return KINDS[self.kind].inverse(u, dict(self.parameters))

    def frozen(self) -> Any:
        """The same distribution in scipy.stats, with its density and its moments."""
        values = dict(self.parameters)
        if self.kind == SCIPY:
            return frozen(self.family, values)
        return frozen(*KINDS[self.kind].in_scipy(values))

    @property
    def mean(self) -> float:
        """Of the variable itself, after truncation; infinite or NaN where it has none."""
        return float(self.frozen().mean())

    @property
    def sd(self) -> float:
        """The standard deviation of the variable itself."""
        return float(self.frozen().std())

    @property
    def median(self) -> float:
        """The value that half of all values stay below."""
        return float(self.of(0.5))

    def as_dict(self) -> dict[str, Any]:
        """The mapping that reads back as this distribution."""
        values: dict[str, Any] = dict(self.parameters)
        return {self.kind: {"name": self.family, **values} if self.family else values}

    def __str__(self) -> str:
        if self.kind == SCIPY:
            named = "".join(f", {name}={number(value)}" for name, value in self.parameters)
            return f"{SCIPY}({self.family}{named})"
        return f"{self.kind}({', '.join(number(value) for _, value in self.parameters)})"


def values_of(u: ArrayLike, distributions: Sequence[Distribution]) -> Array:
    """Values of several variables at the rows of a design.

    Args:
        u: (..., k), in (0, 1).
        distributions: of the columns, k.

    Raises:
        DistributionError: there are more or fewer columns, or a share is not between 0 and 1.
    """
    u = np.asarray(u, np.float64)
    if u.ndim == 0 or u.shape[-1] != len(distributions):
        raise DistributionError(
            f"u has the shape {u.shape} for {len(distributions)} distributions, expected one "
            "column for each"
        )
    found = np.empty_like(u)
    for k, distribution in enumerate(distributions):
        found[..., k] = distribution.of(u[..., k])
    return found


# what was written: a name, and values by place or by name


@dataclass(frozen=True)
class _Percent:
    value: float


_Quantity = float | _Percent
_Given = list[tuple[str, object]]
"""Parameters in their order, "" for those without a name."""


def _from_text(text: str) -> tuple[str, _Given]:
    about = ABOUT.fullmatch(text)
    if about:
        return "uniform", [("", about[1])]
    call = CALL.fullmatch(text)
    if not call:
        raise DistributionError(f"{text!r} is no distribution: expected something as {EXAMPLES}")
    inside = call[2] if call[2] is not None else call[3]
    given: _Given = []
    for part in inside.split(",") if inside.strip() else []:
        name, equals, value = part.rpartition("=")
        given.append((name.strip() if equals else "", value))
    if call[1] == SCIPY and given and not given[0][0]:
        given[0] = ("name", given[0][1])
    return call[1], given


def _from_mapping(value: object) -> tuple[str, _Given]:
    if not isinstance(value, Mapping) or len(value) != 1:
        raise DistributionError(
            f"{value!r} is no distribution: expected a text ({EXAMPLES}) or a mapping with one "
            "entry, as {normal: {mean: 1, sd: 0.1}}"
        )
    ((kind, inside),) = value.items()
    if isinstance(inside, Mapping):
        return str(kind), [(str(name), part) for name, part in inside.items()]
    if isinstance(inside, Sequence) and not isinstance(inside, str):
        return str(kind), [("", part) for part in inside]
    return str(kind), [("", inside)]


def _quantity(kind: str, name: str, value: object) -> _Quantity:
    """A number or a percentage."""
    known = f"{kind}: {name or 'a value'} is {value!r}, expected a number or a percentage"
    if isinstance(value, str):
        text = value.strip()
        try:
            if text.endswith("%"):
                return _Percent(float(text[:-1]))
            return float(text)
        except ValueError:
            raise DistributionError(known) from None
    if isinstance(value, bool) or not isinstance(value, Real):
        raise DistributionError(known)
    return float(value)


def _completed(kind: str, given: _Given, nominal: float | None) -> tuple[tuple[str, float], ...]:
    """Every parameter of a kind as a number."""
    form = KINDS[kind]
    if len(given) == 1 and not given[0][0] and form.spread:
        return _about(kind, _quantity(kind, "", given[0][1]), nominal)
    quantities = _named(kind, given, form.parameters)
    if form.centre not in quantities and form.centre and nominal is not None:
        quantities[form.centre] = nominal
    both = isinstance(quantities.get("low"), _Percent) and isinstance(
        quantities.get("high"), _Percent
    )
    if both and nominal is not None and nominal < 0:
        quantities["low"], quantities["high"] = quantities["high"], quantities["low"]
    values = {name: _absolute(kind, name, q, nominal) for name, q in quantities.items()}
    values = {**form.defaults, **values}
    missing = [name for name in form.parameters if name not in values]
    if missing:
        raise DistributionError(
            f"{kind}: {' and '.join(missing)} missing, expected {_signature(kind)}"
        )
    return tuple((name, values[name]) for name in form.parameters)


def _named(kind: str, given: _Given, known: Sequence[str]) -> dict[str, _Quantity]:
    found: dict[str, _Quantity] = {}
    if sum(not name for name, _ in given) > len(known):
        raise DistributionError(
            f"{kind}: {len(given)} values, expected {len(known)}: {_signature(kind)}"
        )
    for k, (name, value) in enumerate(given):
        name = name or known[k]
        if name not in known:
            raise UnknownName(f"parameter of {kind}", name, known)
        if name in found:
            raise DistributionError(f"{kind}: {name} is given twice")
        found[name] = _quantity(kind, name, value)
    return found


def _absolute(kind: str, name: str, value: _Quantity, nominal: float | None) -> float:
    """A number, or that part of the nominal value; a standard deviation has no sign."""
    if not isinstance(value, _Percent):
        return value
    if nominal is None:
        raise DistributionError(
            f"{kind}: {name} is {value.value:g} %, but there is no nominal value that it could be "
            "a part of: give a number"
        )
    part = value.value / 100 * nominal
    if part == 0 and name in ("sd", "the half width"):
        raise DistributionError(
            f"{kind}: {name} is {value.value:g} % of the nominal value {nominal:g}, which is "
            "nothing: give a number, as in ±0.02"
        )
    return abs(part) if name in ("sd", "the half width") else part


def _about(kind: str, spread: _Quantity, nominal: float | None) -> tuple[tuple[str, float], ...]:
    """A distribution about the nominal value, from its half width or its standard deviation."""
    form = KINDS[kind]
    word = "sd" if form.spread == "sd" else "the half width"
    if nominal is None:
        raise DistributionError(
            f"{kind}: one value alone is {word} about a nominal value, and there is none: write "
            f"{_signature(kind)}"
        )
    size = _absolute(kind, word, spread, nominal)
    if size <= 0:
        raise DistributionError(f"{kind}: {word} is {size:g}: it has to be positive")
    values = {form.centre: nominal, "sd": size, "low": nominal - size, "high": nominal + size}
    return tuple((name, values[name]) for name in form.parameters)


def _signature(kind: str) -> str:
    return f"{kind}({', '.join(KINDS[kind].parameters)})"


# scipy


def _scipy(given: _Given, nominal: float | None) -> Distribution:
    """Any continuous distribution of scipy, its parameters by name."""
    family = "".join(str(value).strip() for name, value in given if name == "name")
    named = [(name, value) for name, value in given if name != "name"]
    if not family or any(not name for name, _ in named):
        raise DistributionError(
            "scipy: expected the name of a distribution and its parameters by name, as "
            "{scipy: {name: weibull_min, c: 1.5, loc: 0, scale: 2}}"
        )
    if family not in scipy_names():
        raise UnknownName("continuous distribution of scipy.stats", family, scipy_names())
    known = scipy_parameters(family)
    found = _named(f"{SCIPY}({family})", named, known)
    values = {
        name: _absolute(f"{SCIPY}({family})", name, quantity, nominal)
        for name, quantity in found.items()
    }
    values = {"loc": 0.0, "scale": 1.0, **values}
    missing = [name for name in known if name not in values]
    if missing:
        raise DistributionError(
            f"{SCIPY}({family}): {' and '.join(missing)} missing.{closest('', known)}"
        )
    return Distribution(SCIPY, tuple((name, values[name]) for name in known), family)


def _scipy_fault(distribution: Distribution) -> str:
    values = dict(distribution.parameters)
    if values.get("scale", 1.0) <= 0:
        return f"scale is {values['scale']:g}: it has to be positive"
    if np.isnan(float(frozen(distribution.family, values).ppf(0.5))):
        named = ", ".join(f"{name} = {value:g}" for name, value in values.items())
        return f"{distribution.family} is not defined for {named}"
    return ""
