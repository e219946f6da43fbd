"""Motions that make parameters visible: periodic, within limits, of small condition number.

Finite Fourier series are periodic and band limited, so that measurements can be averaged over
periods and derivatives are exact (Swevers, Ganseman, Tükel, De Schutter and Van Brussel 1997).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import minimize

from gough.dynamics.identification.base import BaseParameters
from gough.dynamics.identification.limits import Limits, Range, limits_of, use_of
from gough.dynamics.identification.placing import Motion, Placing, placing_of
from gough.dynamics.identification.regressor import Regressor, States
from gough.dynamics.identification.series import fitted, series
from gough.dynamics.model import Space
from gough.errors import ConfigurationError

Array = NDArray[np.float64]

DRAWS = 8
"""Random series that the search starts from the best of."""
SHRINKING, SHRINKS = 0.7, 30
"""Factor by which a series that breaks a limit is made smaller, and how often at most."""
POINTS = 10
"""Samples of a period for each harmonic while the series is sought."""
PENALTY = 3.0
"""Decades of the condition number that the breaking of a limit by 100 % costs; a guess."""
STEP = 1e-4
"""Of the finite differences, in parts of the largest amplitude."""


class Ending(Enum):
    """How the search ended; the text is what the user reads."""

    converged = "no nearby series has a smaller condition number"
    evaluation_limit = "still improving when the evaluations ran out: raise `evaluations`"
    no_better = "no series better than the best random one was found"


@dataclass(frozen=True, eq=False)
class ExcitingTrajectory:
    """One period of a motion that excites the base parameters."""

    space: Space
    names: tuple[str, ...]
    """Of the coordinates of the series."""
    time: Array
    """s, (samples,); the period begins anew after the last."""
    x: Array
    """Operational coordinates, (samples, n), a pose where all six freedoms are; in joint space
    positions of the independent joints."""
    xd: Array
    """Their rates, (samples, m), of a pose its twist."""
    xdd: Array
    """Their accelerations, (samples, m)."""
    states: States
    """The same as closed configurations with independent rates and accelerations."""
    frequency: float
    """Of the first harmonic, Hz."""
    coefficients: Array
    """Of sines and cosines of each coordinate, (n, 2, harmonics), rad and m."""
    offsets: Array
    """Means of the coordinates: rad and m, of a rotation vector from the centre's orientation."""
    condition: float
    """Of the regressor of base parameters, columns of norm 1."""
    before: float
    """The same of the first random series that kept the limits."""
    limit_use: float
    """Largest part of a limit of the motors that it takes, 0 without any."""
    evaluations: int
    ending: Ending
    seed: int

    def __str__(self) -> str:
        count = self.coefficients.shape[2]
        lines = [
            f"exciting trajectory of {count} harmonics of {self.frequency:g} Hz, "
            f"{len(self.time)} samples",
            f"condition {self.condition:.4g}, {self.before:.4g} before; {self.evaluations} "
            f"evaluations, seed {self.seed}: {self.ending.value}",
            f"largest use of a limit of the motors: {100 * self.limit_use:.0f} %",
        ]
        for name, offset, (a, b) in zip(self.names, self.offsets, self.coefficients, strict=True):
            text = " ".join(f"{x:+.4f}/{y:+.4f}" for x, y in zip(a, b, strict=True))
            lines.append(f"  {name}: {offset:.4f}, sine/cosine {text}")
        return "\n".join(lines)

    def as_dict(self) -> dict[str, Any]:
        """The content as plain data."""
        return {
            "space": self.space,
            "names": list(self.names),
            "time": self.time.tolist(),
            "x": self.x.tolist(),
            "xd": self.xd.tolist(),
            "xdd": self.xdd.tolist(),
            "frequency": self.frequency,
            "coefficients": self.coefficients.tolist(),
            "offsets": self.offsets.tolist(),
            "condition": self.condition,
            "condition_before": self.before,
            "limit_use": self.limit_use,
            "evaluations": self.evaluations,
            "ending": self.ending.name,
            "seed": self.seed,
        }


@dataclass(frozen=True)
class _Tried:
    """One series and what it is worth."""

    coefficients: Array
    offsets: Array
    condition: float
    use: float

    @property
    def kept(self) -> bool:
        """Whether it keeps all limits."""
        return self.use <= 1 and np.isfinite(self.condition)

    @property
    def cost(self) -> float:
        """Decades of the condition number, and of what breaks limits."""
        decades = np.log10(self.condition) if np.isfinite(self.condition) else 20.0
        return float(decades + PENALTY * max(self.use - 1, 0.0))


class Search:
    """The search for one trajectory; see `exciting_trajectory`."""

    def __init__(
        self,
        regressor: Regressor,
        base: BaseParameters,
        placing: Placing,
        limits: Limits,
        frequency: float,
        harmonics: int,
    ) -> None:
        self._regressor, self._base, self._placing = regressor, base, placing
        self._limits, self._frequency = limits, frequency
        self._shape = len(placing.names), 2, harmonics
        self._size = (limits.high - limits.low) / 2
        self._time = np.arange(POINTS * harmonics) / (POINTS * harmonics * frequency)
        self.evaluations = 0
        self.best: _Tried | None = None

    def motion(self, coefficients: Array, offsets: Array, time: Array) -> Motion:
        """The motion of a series."""
        s, sd, sdd = series(coefficients, self._frequency, time)
        return self._placing.motion(s + offsets, sd, sdd)

    def judged(self, coefficients: Array, offsets: Array, time: Array) -> _Tried:
        """A series with its condition number and its use of limits at some times."""
        motion = self.motion(coefficients, offsets, time)
        use = use_of(self._regressor, self._limits, motion)
        condition = np.inf
        if motion.states is not None:
            condition = condition_of(self._regressor, self._base, motion.states)
        return _Tried(coefficients, offsets, condition, use)

    def tried(self, numbers: Array) -> _Tried:
        """The series of some numbers, in parts of the ranges, made to fit them."""
        self.evaluations += 1
        scaled = numbers.reshape(self._shape) * self._size[:, None, None]
        found = self.judged(*fitted(scaled, self._limits.low, self._limits.high), self._time)
        if found.kept and (self.best is None or found.condition < self.best.condition):
            self.best = found
        return found

    def start(self, rng: np.random.Generator) -> tuple[Array, _Tried] | None:
        """A random series that keeps the limits, made smaller until it does."""
        numbers = rng.normal(size=self._shape).ravel()
        numbers /= np.abs(numbers).max()
        for _ in range(SHRINKS):
            found = self.tried(numbers)
            if found.kept:
                return numbers, found
            numbers = numbers * SHRINKING
        return None

    def improve(self, numbers: Array, evaluations: int) -> Ending:
        """Search from a series downhill."""
        before = self.best
        result = minimize(
            lambda x: self.tried(x).cost,
            numbers,
            method="L-BFGS-B",
            bounds=[(-1.0, 1.0)] * len(numbers),
            options={"maxfun": evaluations, "eps": STEP},
        )
        if self.best is before:
            return Ending.no_better
        return Ending.converged if result.status == 0 else Ending.evaluation_limit


def exciting_trajectory(
    regressor: Regressor,
    base: BaseParameters,
    frequency: float = 0.1,
    harmonics: int = 5,
    centre: ArrayLike | None = None,
    ranges: Mapping[str, Range] | None = None,
    speeds: Mapping[str, float] | None = None,
    efforts: Mapping[str, float] | None = None,
    samples: int = 200,
    evaluations: int = 600,
    seed: int = 0,
) -> ExcitingTrajectory:
    """A periodic motion that makes the condition number of the base regressor small.

    Columns of the regressor are brought to norm 1 first, so that units do not matter. A smaller
    condition number lets all parameters be told from each other; how large the motion is, and so
    how large efforts are over their noise, is a matter of the ranges.

    Args:
        regressor: of the mechanism.
        base: its base parameters.
        frequency: of the first harmonic, Hz; the period is its inverse.
        harmonics: how many; the highest is the bandwidth.
        centre: operational coordinates, or positions of the independent joints in joint space,
            that the motion stays around; home by default.
        ranges: (low, high) by the name of a coordinate or a motor, rad and m; of rx, ry and rz of
            a pose the rotation vector from the centre's orientation. Without, 15 % of the
            characteristic length and 0.25 rad either side of the centre.
        speeds: largest rates of motors by name, rad/s or m/s; those described by default.
        efforts: largest efforts of motors by name for the described parameters, N m or N; those
            described by default.
        samples: of the period, in the result.
        evaluations: series that are tried after the random ones.
        seed: of the random series.

    Raises:
        UnknownName: a limit is given for what does not exist.
        ConfigurationError: an argument makes no sense, or no series keeps the limits.
    """
    _check(base, frequency, harmonics, samples, regressor)
    placing = placing_of(regressor, centre)
    limits = limits_of(regressor, placing, ranges, speeds, efforts)
    search = Search(regressor, base, placing, limits, frequency, harmonics)
    rng = np.random.default_rng(seed)
    starts = [found for _ in range(DRAWS) if (found := search.start(rng)) is not None]
    if not starts:
        raise ConfigurationError(
            "no periodic motion around the centre keeps the limits; choose smaller ranges, a lower "
            "frequency, or a centre away from singularities"
        )
    ending = search.improve(min(starts, key=lambda s: s[1].cost)[0], evaluations)
    time = np.arange(samples) / (samples * frequency)
    first = starts[0][1]
    before = search.judged(first.coefficients, first.offsets, time).condition
    assert search.best is not None
    best = _kept_everywhere(search, search.best, time)
    motion = search.motion(best.coefficients, best.offsets, time)
    assert motion.states is not None
    return ExcitingTrajectory(
        regressor.space,
        placing.names,
        time,
        motion.x,
        motion.xd,
        motion.xdd,
        motion.states,
        frequency,
        best.coefficients,
        placing.centre + best.offsets,
        best.condition,
        before,
        best.use,
        search.evaluations,
        ending,
        seed,
    )


def _kept_everywhere(search: Search, found: _Tried, time: Array) -> _Tried:
    """The series at the samples of the result, smaller by a little where it breaks limits there."""
    for _ in range(SHRINKS):
        fine = search.judged(found.coefficients, found.offsets, time)
        if fine.kept:
            return fine
        factor = 0.99 if fine.use > 1.01 else 0.999
        found = _Tried(found.coefficients * factor, found.offsets, found.condition, found.use)
    raise ConfigurationError("the series breaks a limit between its samples; use more harmonics")


def condition_of(regressor: Regressor, base: BaseParameters, states: States) -> float:
    """Condition number of the stacked base regressor with columns of norm 1; inf if singular."""
    Y = base.columns(regressor.matrix(states)).reshape(-1, len(base))
    if not np.isfinite(Y).all() or len(Y) < len(base):
        return np.inf
    size = np.linalg.norm(Y, axis=0)
    if np.any(size == 0):
        return np.inf
    s = np.linalg.svd(np.linalg.qr(Y / size, mode="r"), compute_uv=False)
    return float(s[0] / s[-1]) if s[-1] > 0 else np.inf


def _check(
    base: BaseParameters, frequency: float, harmonics: int, samples: int, regressor: Regressor
) -> None:
    if not (np.isfinite(frequency) and frequency > 0):
        raise ConfigurationError(f"the frequency is {frequency} Hz; it must be above 0")
    if harmonics < 1:
        raise ConfigurationError(f"there are {harmonics} harmonics; one at least is needed")
    rows = len(regressor.channels)
    for count, what in ((samples, "samples"), (POINTS * harmonics, "points (ten a harmonic)")):
        if count * rows < len(base):
            raise ConfigurationError(
                f"{count} {what} with {rows} efforts each are fewer numbers than the {len(base)} "
                "base parameters; take more samples or harmonics"
            )
