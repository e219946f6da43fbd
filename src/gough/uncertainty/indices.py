"""Sobol' indices: which part of the variance of an output each factor is behind.

The first-order index S_i is the part that goes if factor i alone is known; the total index T_i is
the part that stays if all others are known, so T_i - S_i is what factor i does together with
others.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gough.errors import UnknownName
from gough.uncertainty.errors import EnsembleError
from gough.uncertainty.outputs import as_outputs, checked_confidence, output_names
from gough.uncertainty.plain import count, percent, plain, share, short, table

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Counts = NDArray[np.int64]

LEAST_RESAMPLES = 100
"""Fewer say nothing of the tails of an interval."""
LEAST_ROWS = 2
FLAT = 1e-24
"""A variance below this part of the largest square is rounding: the output does not vary."""
STILL = 1e-12
"""A resample whose variance is below this part of the whole sample's drew base rows that are all
alike: it has no indices, and the interval is left open."""
SLAB = 2**22
"""Numbers that are held at a time, of weights and of products: bounds the memory."""
SHOWN = 12
"""Factors of a printed table."""


@dataclass(frozen=True)
class SobolIndices:
    """First-order and total indices of each output."""

    factors: tuple[str, ...]
    outputs: tuple[str, ...]
    first: Array
    """(outputs, factors); NaN where the output does not vary."""
    total: Array
    first_interval: Array
    """(outputs, factors, 2), percentiles of the bootstrap."""
    total_interval: Array
    mean: Array
    """Of the outputs, (outputs,), over A and B."""
    variance: Array
    base_rows: int
    kept: Counts
    """Base rows that were used, (outputs,)."""
    lost: Counts
    """Runs without a value, (outputs,)."""
    confidence: float
    resamples: int
    seed: int

    @property
    def interactions(self) -> Array:
        """1 - Σ S_i, (outputs,): the part of the variance that no factor has alone."""
        return np.asarray(1 - self.first.sum(axis=1))

    def ranked(self, output: str) -> tuple[str, ...]:
        """Factors, the largest total index first.

        Raises:
            UnknownName: no output has this name.
        """
        if output not in self.outputs:
            raise UnknownName("output", output, self.outputs)
        return tuple(self.factors[i] for i in self._order(self.outputs.index(output)))

    def _order(self, k: int) -> Counts:
        return np.argsort(-np.nan_to_num(self.total[k], nan=-np.inf), kind="stable")

    @property
    def notes(self) -> tuple[str, ...]:
        """What was done about runs without a value, and which outputs do not vary."""
        found = []
        for k, output in enumerate(self.outputs):
            if self.lost[k]:
                dropped = self.base_rows - int(self.kept[k])
                found.append(
                    f"{output}: {count(int(self.lost[k]), 'run')} without a value; "
                    f"{count(dropped, 'base row')} of {self.base_rows} "
                    f"({share(dropped / self.base_rows)}) left out in every block"
                )
            if np.isnan(self.first[k]).all():
                found.append(f"{output}: does not vary, so there are no indices")
        return tuple(found)

    def as_dict(self) -> dict[str, Any]:
        """The content as plain data."""
        return {
            "factors": list(self.factors),
            "outputs": list(self.outputs),
            "first": plain(self.first),
            "first_interval": plain(self.first_interval),
            "total": plain(self.total),
            "total_interval": plain(self.total_interval),
            "mean": plain(self.mean),
            "variance": plain(self.variance),
            "base_rows": self.base_rows,
            "kept": plain(self.kept),
            "lost": plain(self.lost),
            "confidence": self.confidence,
            "resamples": self.resamples,
            "seed": self.seed,
            "notes": list(self.notes),
        }

    def __str__(self) -> str:
        lines = [
            f"Sobol' indices from {count(self.base_rows, 'base row')}; {percent(self.confidence)} "
            f"intervals from {self.resamples} resamples (seed {self.seed})"
        ]
        for k, output in enumerate(self.outputs):
            sd = float(np.sqrt(self.variance[k]))
            lines.append(f"{output}: mean {short(self.mean[k])}, standard deviation {short(sd)}")
            order = self._order(k)
            lines += table(
                [["", "first", "", "total", ""], *(self._row(k, i) for i in order[:SHOWN])]
            )
            if len(order) > SHOWN:
                lines.append(f"  … and {count(len(order) - SHOWN, 'factor')} with smaller totals")
            if np.isfinite(self.interactions[k]):
                alone, others = 1 - self.interactions[k], self.interactions[k]
                lines.append(
                    f"  of the variance {alone:.3f} by one factor, {others:.3f} by several"
                )
        return "\n".join([*lines, *self.notes])

    def _row(self, k: int, i: int) -> list[str]:
        cells = [self.factors[i]]
        for value, interval in (
            (self.first, self.first_interval),
            (self.total, self.total_interval),
        ):
            low, high = (_index(x) for x in interval[k, i])
            cells += [_index(value[k, i]), f"[{low}, {high}]"]
        return cells


def _index(value: float) -> str:
    return f"{value + 0.0:.3f}" if np.isfinite(value) else "-"


def sobol_indices(
    outputs: ArrayLike,
    factors: Sequence[str],
    names: Sequence[str] | None = None,
    *,
    confidence: float = 0.95,
    resamples: int = 1000,
    seed: int = 0,
    missing: float = 0.1,
) -> SobolIndices:
    """First-order and total Sobol' indices from outputs at the rows of a Saltelli design.

    With f_A, f_B and f_i the outputs at A, B and A_B^i, less their mean over A and B, and V the
    variance over A and B:

        V S_i = mean of f_B (f_i - f_A)        (Saltelli and others 2010, table 2 b)
        V T_i = mean of (f_A - f_i)² / 2       (Jansen 1999)

    The mean is taken off because the first of them has a variance that grows with its square.
    Intervals are percentiles of a bootstrap that draws base rows, all blocks of one together, and
    takes mean and variance anew each time. Base rows of a Sobol' sequence are not independent: for
    them the intervals are too wide rather than too narrow.

    A run without a value (NaN or infinite) takes its base row out of every block, for that output.
    What is left is then a sample of where all k + 2 runs ended, not of all that can happen.

    Args:
        outputs: in the order of the rows, (rows,) or (rows, outputs).
        factors: names of the factors of the design.
        names: of the outputs.
        confidence: of the intervals.
        resamples: of the bootstrap.
        seed: of the bootstrap.
        missing: the largest part of the base rows that may be left out.

    Raises:
        EnsembleError: rows do not fit the factors, or too many base rows are left out.
    """
    k = len(factors)
    values = as_outputs(outputs)
    labels = output_names(values, names)
    checked_confidence(confidence)
    if k == 0 or isinstance(factors, str) or len(values) % (k + 2):
        raise EnsembleError(
            f"outputs have {len(values)} rows for factors {list(factors)!r}: a Saltelli design of "
            f"{k} factors has a multiple of {k + 2} rows"
        )
    if resamples < LEAST_RESAMPLES:
        raise EnsembleError(f"resamples is {resamples}, expected at least {LEAST_RESAMPLES}")
    blocks = values.reshape(-1, k + 2, values.shape[1])
    known = np.isfinite(blocks)
    whole: Mask = np.asarray(known.all(axis=1))
    _refuse(whole, labels, k, missing)
    found = _Found.empty(values.shape[1], k)
    for columns in _alike(whole):
        kept = blocks[whole[:, columns[0]]]
        parts = -(-len(columns) * kept[..., 0].size // SLAB)
        for part in np.array_split(columns, min(parts, len(columns))):
            _estimate(found, part, kept[:, :, part], (resamples, seed, confidence))
    return SobolIndices(
        tuple(factors),
        labels,
        found.first,
        found.total,
        found.first_interval,
        found.total_interval,
        found.mean,
        found.variance,
        len(blocks),
        whole.sum(axis=0),
        np.sum(~known, axis=(0, 1)),
        confidence,
        resamples,
        seed,
    )


def _refuse(whole: Mask, labels: Sequence[str], k: int, missing: float) -> None:
    """Refuse an ensemble with too many base rows incomplete."""
    rows = len(whole)
    left_out = rows - whole.sum(axis=0)
    worst = int(np.argmax(left_out))
    if left_out[worst] > missing * rows or rows - left_out[worst] < LEAST_ROWS:
        raise EnsembleError(
            f"{labels[worst]}: {left_out[worst]} of {rows} base rows have a run without a value, "
            f"more than `missing` = {missing:g} of them, or too few are left; one such run costs "
            f"the {k + 2} runs of its base row: find out why runs fail, narrow the distributions, "
            "or raise `missing`"
        )


def _alike(whole: Mask) -> Iterator[NDArray[np.intp]]:
    """Columns whose base rows are incomplete in the same places, together."""
    _, group = np.unique(whole, axis=1, return_inverse=True)
    for g in range(int(group.max()) + 1):
        yield np.flatnonzero(group.ravel() == g)


@dataclass(frozen=True)
class _Found:
    first: Array
    total: Array
    first_interval: Array
    total_interval: Array
    mean: Array
    variance: Array

    @staticmethod
    def empty(outputs: int, k: int) -> _Found:
        shapes: list[tuple[int, ...]] = (
            [(outputs, k)] * 2 + [(outputs, k, 2)] * 2 + [(outputs,)] * 2
        )
        return _Found(*(np.full(shape, np.nan) for shape in shapes))


def _estimate(
    found: _Found, columns: NDArray[np.intp], blocks: Array, how: tuple[int, int, float]
) -> None:
    """Indices of outputs whose base rows are all complete, (rows, k + 2, outputs)."""
    resamples, seed, confidence = how
    rows, k = len(blocks), blocks.shape[1] - 2
    mean = blocks[:, :2].mean(axis=(0, 1))
    size = np.square(blocks).max(axis=(0, 1))
    products = _products(blocks - mean)
    one = np.full((1, rows), 1 / rows)
    first, total, variance = (x[0] for x in _indices(one, products, k))
    flat = variance <= FLAT * size
    drawn = [_indices(weights, products, k)[:2] for weights in _weights(rows, resamples, seed)]
    tails = [(1 - confidence) / 2, (1 + confidence) / 2]
    for values, interval, which in (
        (first, found.first_interval, 0),
        (total, found.total_interval, 1),
    ):
        tries = np.concatenate([pair[which] for pair in drawn])
        ends = np.quantile(tries, tails, axis=0)
        interval[columns] = np.where(flat[:, None, None], np.nan, np.moveaxis(ends, 0, -1))
        (found.first, found.total)[which][columns] = np.where(flat[:, None], np.nan, values)
    found.mean[columns], found.variance[columns] = mean, variance


def _products(f: Array) -> Array:
    """What the estimators sum over base rows, (rows, outputs, 3 k + 2).

    f_B (f_i - f_A), f_i - f_A and (f_A - f_i)² / 2 for each factor; (f_A + f_B) / 2 and
    (f_A² + f_B²) / 2.
    """
    A, B = f[:, 0], f[:, 1]
    change = np.moveaxis(f[:, 2:], 1, 2) - A[..., None]
    middle = np.stack([(A + B) / 2, (A**2 + B**2) / 2], axis=-1)
    return np.concatenate([B[..., None] * change, change, change**2 / 2, middle], axis=-1)


def _indices(weights: Array, products: Array, k: int) -> tuple[Array, Array, Array]:
    """S, T (draws, outputs, k) and V (draws, outputs) for weights of base rows that sum to 1.

    The mean m of a draw is taken off by Σ w (f_B - m)(f_i - f_A) = Σ w f_B (f_i - f_A) - m Σ w
    (f_i - f_A) and V = Σ w f² - m².
    """
    rows, outputs, width = products.shape
    sums = (weights @ products.reshape(rows, outputs * width)).reshape(-1, outputs, width)
    both, change, half = sums[..., :k], sums[..., k : 2 * k], sums[..., 2 * k : 3 * k]
    mean, square = sums[..., -2], sums[..., -1]
    variance = np.maximum(square - mean**2, 0)
    still = variance <= STILL * products[..., -1].mean(axis=0)
    over = np.where(still, np.nan, variance)[..., None]
    return (both - mean[..., None] * change) / over, half / over, variance


def _weights(rows: int, resamples: int, seed: int) -> Iterator[Array]:
    """How often each base row is drawn, over the number of draws, (draws, rows) at a time."""
    rng = np.random.default_rng(seed)
    step = max(SLAB // rows, 1)
    for first in range(0, resamples, step):
        draws = min(step, resamples - first)
        picked = rng.integers(0, rows, (draws, rows))
        picked += rows * np.arange(draws)[:, None]
        times = np.bincount(picked.ravel(), minlength=draws * rows)
        yield times.reshape(draws, rows) / rows
