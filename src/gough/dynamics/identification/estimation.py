"""Base parameters from measured efforts by weighted least squares (Khalil and Dombre 2002, 12.5).

With measured efforts z = Y_b β + e, noise e of standard deviation σ_j of motor j, white, and none
in positions and rates:

    β = (Yᵀ W Y)⁻¹ Yᵀ W z,   cov β = (Yᵀ W Y)⁻¹,   W = diag 1/σ²

σ is taken from the residual of each motor unless it is given (Gautier 1997).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gough.dynamics.identification.base import BaseParameters
from gough.dynamics.identification.regressor import Regressor, States
from gough.errors import ConfigurationError

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

BAD = 10.0
"""Relative standard deviation in % above which a parameter counts as badly determined; custom."""
ROUNDS = 4
"""Times that noise is estimated from the residual and the weights are made anew."""
QUIET = 1e-6
"""Least noise of a channel over the largest: what fits exactly gets no endless weight."""
LOST = 1e-10
"""Singular values of the scaled regressor below this part of the largest tell nothing."""


@dataclass(frozen=True, eq=False)
class Estimate:
    """Estimated base parameters with their uncertainty."""

    names: tuple[str, ...]
    units: tuple[str, ...]
    values: Array
    """(base,)."""
    deviations: Array
    """Standard deviations, (base,); inf where the motion says nothing of a parameter."""
    covariance: Array
    """(base, base); NaN in place of what is unknown."""
    described: Array
    """Base parameters of the description, (base,)."""
    channels: tuple[str, ...]
    noise: Array
    """Standard deviation of the noise of each channel, given or estimated, (channels,); 1 for the
    shares of redundant motors whose noise is given, which are measured in it."""
    residual: Array
    """Root mean square of what is left of each channel, (channels,), N and N m, or such shares."""
    relative_residual: float
    """Norm of what is left over the norm of what was measured."""
    condition: float
    """Of the weighted regressor with columns of norm 1."""
    rows: int
    """Numbers that were measured."""

    @property
    def relative(self) -> Array:
        """Standard deviations in % of the values, (base,)."""
        with np.errstate(divide="ignore", invalid="ignore"):
            found = 100 * self.deviations / np.abs(self.values)
        return np.where(np.isnan(found), np.inf, found)

    @property
    def badly_determined(self) -> Mask:
        """Where the relative standard deviation is above 10 %: of what is 0 it always is."""
        return np.asarray(self.relative > BAD)

    def __str__(self) -> str:
        width = max(map(len, self.names))
        lines = [
            f"{len(self.names)} base parameters from {self.rows} measured numbers: condition "
            f"{self.condition:.4g}, {100 * self.relative_residual:.3g} % left",
            f"  {'':{width}} {'value':>12} {'deviation':>10} {'%':>7} {'described':>12}",
        ]
        for k, name in enumerate(self.names):
            mark = "  badly determined" if self.badly_determined[k] else ""
            lines.append(
                f"  {name:{width}} {self.values[k]:12.6g} {self.deviations[k]:10.3g} "
                f"{min(self.relative[k], 9999.9):7.1f} {self.described[k]:12.6g} "
                f"{self.units[k]}{mark}"
            )
        each = (f"{c} {r:.3g}" for c, r in zip(self.channels, self.residual, strict=True))
        return "\n".join([*lines, f"residual (rms): {', '.join(each)}"])

    def as_dict(self) -> dict[str, Any]:
        """The content as plain data."""
        return {
            "names": list(self.names),
            "units": list(self.units),
            "values": self.values.tolist(),
            "deviations": _plain(self.deviations),
            "relative": _plain(self.relative),
            "badly_determined": self.badly_determined.tolist(),
            "described": self.described.tolist(),
            "channels": list(self.channels),
            "noise": self.noise.tolist(),
            "residual": self.residual.tolist(),
            "relative_residual": self.relative_residual,
            "condition": self.condition if np.isfinite(self.condition) else None,
            "rows": self.rows,
        }


def _plain(values: Array) -> list[float | None]:
    return [float(x) if np.isfinite(x) else None for x in values]


def estimate(
    regressor: Regressor,
    base: BaseParameters,
    states: States,
    efforts: ArrayLike,
    noise: ArrayLike | None = None,
    weights: ArrayLike | None = None,
) -> Estimate:
    """Base parameters that explain measured efforts best.

    Args:
        regressor: of the mechanism.
        base: its base parameters.
        states: the motion that was measured, without noise: filter positions first.
        efforts: of the motors, (rows, motors), N and N m.
        noise: standard deviation of the efforts of each motor, (motors,); from the residuals by
            default. Where motors are fewer than the independent rates: of the forces along these.
        weights: how much each row counts, (rows,): 0 leaves it out, as where a motor turns round
            and Coulomb friction is anything; 1 by default.

    Raises:
        ConfigurationError: shapes do not fit, or there are fewer numbers than parameters.
    """
    z = _numbers("efforts", efforts, (len(states), len(regressor.dynamics.motors)))
    weigh = np.ones(len(states)) if weights is None else _numbers("weights", weights, (len(z),))
    if np.any(weigh < 0):
        raise ConfigurationError("weights are negative; they must be 0 or more")
    shared = regressor.form == "shared"
    given = None if noise is None else _noise(regressor, noise)
    own = given if shared else None
    Y = base.columns(regressor.matrix(states, own))
    z = regressor.measured(states, z, own)
    if len(base) > np.count_nonzero(weigh) * z.shape[1]:
        raise ConfigurationError(
            f"{np.count_nonzero(weigh) * z.shape[1]} measured numbers do not tell "
            f"{len(base)} base parameters; measure more rows"
        )
    sigma = np.ones(z.shape[1]) if given is None or shared else given
    solved = _solved(Y, z, sigma, weigh)
    for _ in range(ROUNDS if given is None else 0):
        sigma = _estimated_noise(solved, Y, z, weigh, shared)
        solved = _solved(Y, z, sigma, weigh)
        if shared:
            break
    return _told(regressor, base, solved, Y, z, sigma, weigh)


@dataclass(frozen=True)
class _Solved:
    values: Array
    covariance: Array
    deviations: Array
    condition: float


def _solved(Y: Array, z: Array, sigma: Array, weigh: Array) -> _Solved:
    """Weighted least squares by singular values of the columns brought to norm 1."""
    factor = np.sqrt(weigh)[:, None] / sigma
    X = (Y * factor[..., None]).reshape(-1, Y.shape[2])
    size = np.linalg.norm(X, axis=0)
    size[size == 0] = 1.0
    U, s, Vt = np.linalg.svd(X / size, full_matrices=False)
    told = s > LOST * s[0]
    inverse = Vt[told].T / s[told]
    values = inverse @ (U[:, told].T @ (z * factor).ravel()) / size
    covariance = inverse @ inverse.T / np.outer(size, size)
    deviations = np.sqrt(np.diag(covariance))
    unknown = np.abs(Vt[~told]).max(axis=0, initial=0.0) > np.sqrt(LOST)
    deviations[unknown] = np.inf
    covariance[unknown], covariance[:, unknown] = np.nan, np.nan
    condition = float(s[0] / s[-1]) if told.all() else np.inf
    return _Solved(values, covariance, deviations, condition)


def _estimated_noise(solved: _Solved, Y: Array, z: Array, weigh: Array, shared: bool) -> Array:
    """Standard deviation of each channel's noise from what is left, freedoms taken off evenly."""
    left = (z - Y @ solved.values) ** 2 * weigh[:, None]
    freedoms = np.count_nonzero(weigh) - Y.shape[2] / z.shape[1]
    variance = left.sum(axis=0) / max(freedoms, 1.0)
    if shared:
        variance[:] = variance.mean()
    sigma = np.sqrt(variance)
    largest = float(sigma.max())
    return np.maximum(sigma, QUIET * largest) if largest > 0 else np.ones_like(sigma)


def _told(
    regressor: Regressor,
    base: BaseParameters,
    solved: _Solved,
    Y: Array,
    z: Array,
    sigma: Array,
    weigh: Array,
) -> Estimate:
    used = weigh > 0
    left = (z - Y @ solved.values)[used]
    measured = float(np.linalg.norm(z[used]))
    return Estimate(
        base.names,
        base.units,
        solved.values,
        solved.deviations,
        solved.covariance,
        base.values,
        regressor.channels,
        sigma,
        np.sqrt(np.mean(left**2, axis=0)),
        float(np.linalg.norm(left)) / measured if measured else 0.0,
        solved.condition,
        int(used.sum()) * z.shape[1],
    )


def _noise(regressor: Regressor, noise: ArrayLike) -> Array:
    count = len(regressor.channels if regressor.form == "forces" else regressor.dynamics.motors)
    found = np.broadcast_to(np.asarray(noise, dtype=float), (count,)).copy()
    if not np.all(np.isfinite(found) & (found > 0)):
        raise ConfigurationError("noise must be above 0: the standard deviation of each effort")
    return found


def _numbers(name: str, given: ArrayLike, shape: tuple[int, ...]) -> Array:
    found = np.asarray(given, dtype=float)
    if found.shape != shape:
        raise ConfigurationError(f"{name} has shape {found.shape}, expected {shape}")
    if not np.isfinite(found).all():
        raise ConfigurationError(f"{name} has entries that are not finite")
    return found
