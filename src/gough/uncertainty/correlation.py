"""How outputs go with factors: linearly, and by rank."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gough.errors import UnknownName
from gough.uncertainty.errors import EnsembleError
from gough.uncertainty.outputs import as_outputs, checked_confidence, output_names
from gough.uncertainty.plain import count, percent, plain, short, table

Array = NDArray[np.float64]
Counts = NDArray[np.int64]

LEAST_ROWS = 4
SHOWN = 12
"""Factors of a printed table."""


@dataclass(frozen=True)
class Correlations:
    """Correlation coefficients of outputs with factors."""

    factors: tuple[str, ...]
    outputs: tuple[str, ...]
    linear: Array
    """Pearson's, (outputs, factors); NaN where one of the two does not vary."""
    rank: Array
    """Spearman's: 1 or -1 where the output only rises or only falls with the factor."""
    runs: int
    lost: Counts
    """Runs without a value, which were left out, (outputs,)."""
    chance: Array
    """What independent values stay below in size with this confidence, (outputs,)."""
    confidence: float

    def ranked(self, output: str) -> tuple[str, ...]:
        """Factors, the largest rank correlation in size first.

        Raises:
            UnknownName: no output has this name.
        """
        if output not in self.outputs:
            raise UnknownName("output", output, self.outputs)
        return tuple(self.factors[i] for i in self._order(self.outputs.index(output)))

    def _order(self, k: int) -> Counts:
        return np.argsort(-np.abs(np.nan_to_num(self.rank[k])), kind="stable")

    def as_dict(self) -> dict[str, Any]:
        """The content as plain data."""
        return {
            "factors": list(self.factors),
            "outputs": list(self.outputs),
            "linear": plain(self.linear),
            "rank": plain(self.rank),
            "runs": self.runs,
            "lost": plain(self.lost),
            "chance": plain(self.chance),
            "confidence": self.confidence,
        }

    def __str__(self) -> str:
        lines = [f"correlations of outputs with factors in {count(self.runs, 'run')}"]
        for k, output in enumerate(self.outputs):
            lost = f"; {count(int(self.lost[k]), 'run')} without a value left out"
            lines.append(
                f"{output}: by chance below {short(self.chance[k], 2)} ({percent(self.confidence)})"
                + (lost if self.lost[k] else "")
            )
            order = self._order(k)
            rows = [["", "rank", "linear"]]
            rows += [
                [self.factors[i], _signed(self.rank[k, i]), _signed(self.linear[k, i])]
                for i in order[:SHOWN]
            ]
            lines += table(rows)
            if len(order) > SHOWN:
                lines.append(f"  … and {count(len(order) - SHOWN, 'factor')} with less")
        return "\n".join(lines)


def _signed(value: float) -> str:
    return f"{value:+.3f}" if np.isfinite(value) else "-"


def correlations(
    factors: ArrayLike,
    outputs: ArrayLike,
    factors_named: Sequence[str] | None = None,
    outputs_named: Sequence[str] | None = None,
    confidence: float = 0.95,
) -> Correlations:
    """Linear and rank correlation of every output with every factor.

    Args:
        factors: values, (runs, factors).
        outputs: (runs,) or (runs, outputs); runs without a value are left out, for that output.
        factors_named: x1, x2 … by default.
        outputs_named: y1, y2 … by default.
        confidence: of the bound below which correlations may be chance, tanh(z / √(runs - 3))
            after Fisher (1921), for independent runs.

    Raises:
        EnsembleError: shapes or names do not fit, or an output has fewer than 4 values.
    """
    from scipy.special import ndtri

    y = as_outputs(outputs)
    x = as_outputs(factors, len(y), "factors")
    names = output_names(x, factors_named, "x"), output_names(y, outputs_named)
    checked_confidence(confidence)
    known = np.isfinite(y)
    used = known.sum(axis=0)
    if used.min() < LEAST_ROWS:
        worst = int(np.argmin(used))
        raise EnsembleError(
            f"{names[1][worst]} has a value in {used[worst]} of {len(y)} runs, expected at least "
            f"{LEAST_ROWS}"
        )
    z = float(ndtri((1 + confidence) / 2))
    chance = np.array([math.tanh(z / math.sqrt(n - 3)) for n in used])
    linear, rank = np.empty((2, y.shape[1], x.shape[1]))
    for k in range(y.shape[1]):
        linear[k], rank[k] = both_correlations(x[known[:, k]], y[known[:, k], k])
    return Correlations(*names, linear, rank, len(y), len(y) - used, chance, confidence)


def both_correlations(x: Array, y: Array) -> tuple[Array, Array]:
    """Linear and rank correlation of y (n,) with the columns of x (n, k), (k,) each."""
    from scipy.stats import rankdata

    return _correlation(x, y), _correlation(rankdata(x, axis=0), rankdata(y))


def _correlation(x: Array, y: Array) -> Array:
    """Pearson's coefficient of y with each column of x; NaN where one does not vary."""
    dx, dy = x - x.mean(axis=0), y - y.mean()
    size = np.linalg.norm(dx, axis=0) * np.linalg.norm(dy)
    flat = (np.ptp(x, axis=0) == 0) | (np.ptp(y) == 0) | (size == 0)
    return np.where(flat, np.nan, np.clip(dy @ dx / np.where(flat, 1.0, size), -1, 1))
