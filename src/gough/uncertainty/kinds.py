"""The kinds of distributions that have a name here: parameters, what they must obey, inverse.

An inverse distribution function maps u in (0, 1) to the value that a share u of all values stays
below. Each kind also names the same distribution in scipy, which has densities and moments.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Values = Mapping[str, float]


@dataclass(frozen=True)
class Kind:
    """One kind of distribution."""

    parameters: tuple[str, ...]
    """In the order of a text."""
    fault: Callable[[Values], str]
    """What is wrong with finite values of the parameters; "" where nothing is."""
    inverse: Callable[[Array, Values], Array]
    in_scipy: Callable[[Values], tuple[str, dict[str, float]]]
    """The name and the parameters of the same distribution there."""
    defaults: Values = field(default_factory=dict)
    centre: str = ""
    """The parameter that is the nominal value where it is left out."""
    spread: str = ""
    """What a lone value gives: *sd*, or *half* the width of what is symmetric about nominal."""


def _ordered(v: Values) -> str:
    if v["low"] >= v["high"]:
        return f"low is {v['low']:g} and high is {v['high']:g}: low has to be less than high"
    return ""


def _positive(v: Values, name: str) -> str:
    return "" if v[name] > 0 else f"{name} is {v[name]:g}: it has to be positive"


# uniform


def _uniform(u: Array, v: Values) -> Array:
    return v["low"] + (v["high"] - v["low"]) * u


def _uniform_scipy(v: Values) -> tuple[str, dict[str, float]]:
    return "uniform", {"loc": v["low"], "scale": v["high"] - v["low"]}


# normal


def _normal(u: Array, v: Values) -> Array:
    from scipy.special import ndtri

    return np.asarray(v["mean"] + v["sd"] * ndtri(u))


def _normal_scipy(v: Values) -> tuple[str, dict[str, float]]:
    return "norm", {"loc": v["mean"], "scale": v["sd"]}


# truncated normal

FAR = 30.0
"""Standard deviations beyond which a window of a normal distribution holds no number: a guess that
leaves its inverse in the range of doubles."""


def _truncated_fault(v: Values) -> str:
    fault = _ordered(v) or _positive(v, "sd")
    if fault:
        return fault
    a, b = ((v[name] - v["mean"]) / v["sd"] for name in ("low", "high"))
    if a > FAR or b < -FAR:
        return (
            f"mean is {v['mean']:g} and sd {v['sd']:g}: nothing of it lies between low {v['low']:g}"
            f" and high {v['high']:g}; mean and sd are those before truncation"
        )
    return ""


def _truncated(u: Array, v: Values) -> Array:
    from scipy.stats import truncnorm

    a, b = ((v[name] - v["mean"]) / v["sd"] for name in ("low", "high"))
    return np.asarray(truncnorm.ppf(u, a, b, loc=v["mean"], scale=v["sd"]))


def _truncated_scipy(v: Values) -> tuple[str, dict[str, float]]:
    a, b = ((v[name] - v["mean"]) / v["sd"] for name in ("low", "high"))
    return "truncnorm", {"a": a, "b": b, "loc": v["mean"], "scale": v["sd"]}


# lognormal


def _lognormal_fault(v: Values) -> str:
    return _positive(v, "mean") or _positive(v, "sd")


def _of_logarithm(v: Values) -> tuple[float, float]:
    """Mean and standard deviation of the logarithm: σ² = ln(1 + sd²/mean²), μ = ln mean - σ²/2."""
    squared = math.log1p((v["sd"] / v["mean"]) ** 2)
    return math.log(v["mean"]) - squared / 2, math.sqrt(squared)


def _lognormal(u: Array, v: Values) -> Array:
    from scipy.special import ndtri

    mean, sd = _of_logarithm(v)
    return np.asarray(np.exp(mean + sd * ndtri(u)))


def _lognormal_scipy(v: Values) -> tuple[str, dict[str, float]]:
    mean, sd = _of_logarithm(v)
    return "lognorm", {"s": sd, "scale": math.exp(mean)}


# triangular


def _triangular_fault(v: Values) -> str:
    fault = _ordered(v)
    if fault or v["low"] <= v["mode"] <= v["high"]:
        return fault
    return f"mode is {v['mode']:g}: it has to lie between low {v['low']:g} and high {v['high']:g}"


def _triangular(u: Array, v: Values) -> Array:
    low, mode, high = v["low"], v["mode"], v["high"]
    rising = low + np.sqrt(u * (high - low) * (mode - low))
    falling = high - np.sqrt((1 - u) * (high - low) * (high - mode))
    return np.where(u * (high - low) < mode - low, rising, falling)


def _triangular_scipy(v: Values) -> tuple[str, dict[str, float]]:
    width = v["high"] - v["low"]
    return "triang", {"c": (v["mode"] - v["low"]) / width, "loc": v["low"], "scale": width}


# beta


def _beta_fault(v: Values) -> str:
    return _positive(v, "a") or _positive(v, "b") or _ordered(v)


def _beta(u: Array, v: Values) -> Array:
    from scipy.special import betaincinv

    return np.asarray(v["low"] + (v["high"] - v["low"]) * betaincinv(v["a"], v["b"], u))


def _beta_scipy(v: Values) -> tuple[str, dict[str, float]]:
    scale = v["high"] - v["low"]
    return "beta", {"a": v["a"], "b": v["b"], "loc": v["low"], "scale": scale}


KINDS: dict[str, Kind] = {
    "uniform": Kind(("low", "high"), _ordered, _uniform, _uniform_scipy, spread="half"),
    "normal": Kind(
        ("mean", "sd"),
        lambda v: _positive(v, "sd"),
        _normal,
        _normal_scipy,
        centre="mean",
        spread="sd",
    ),
    "truncated-normal": Kind(
        ("mean", "sd", "low", "high"), _truncated_fault, _truncated, _truncated_scipy, centre="mean"
    ),
    "lognormal": Kind(
        ("mean", "sd"), _lognormal_fault, _lognormal, _lognormal_scipy, centre="mean", spread="sd"
    ),
    "triangular": Kind(
        ("low", "mode", "high"),
        _triangular_fault,
        _triangular,
        _triangular_scipy,
        centre="mode",
        spread="half",
    ),
    "beta": Kind(
        ("a", "b", "low", "high"),
        _beta_fault,
        _beta,
        _beta_scipy,
        defaults={"low": 0.0, "high": 1.0},
    ),
}


def frozen(name: str, parameters: Values) -> Any:
    """A distribution of scipy with its parameters."""
    from scipy import stats

    return getattr(stats, name)(**parameters)


def scipy_names() -> tuple[str, ...]:
    """Every continuous distribution of scipy."""
    from scipy import stats

    found = [n for n in dir(stats) if isinstance(getattr(stats, n), stats.rv_continuous)]
    return tuple(sorted(found))


def scipy_parameters(name: str) -> tuple[str, ...]:
    """The shapes of one of them, then loc and scale."""
    from scipy import stats

    shapes = getattr(stats, name).shapes
    return (*([s.strip() for s in shapes.split(",")] if shapes else []), "loc", "scale")
