"""One factor at a time: what each does to the outputs by itself, for tornado plots."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gough.errors import UnknownName
from gough.uncertainty.distributions import Distribution
from gough.uncertainty.errors import DesignError
from gough.uncertainty.outputs import as_outputs, output_names
from gough.uncertainty.plain import count, percent, plain, short, table

Array = NDArray[np.float64]

SHOWN = 12
"""Factors of a printed table."""


@dataclass(frozen=True)
class OneAtATime:
    """Values of factors: all nominal, then each at a low and at a high quantile by itself.

    Row 0 is nominal, row 1 + 2 i has factor i low, row 2 + 2 i has it high.
    """

    factors: tuple[str, ...]
    distributions: tuple[Distribution, ...]
    nominal: tuple[float, ...]
    low: float = 0.05
    high: float = 0.95

    def __post_init__(self) -> None:
        sizes = {len(self.factors), len(self.distributions), len(self.nominal)}
        if len(sizes) > 1 or not self.factors:
            raise DesignError(
                f"{len(self.factors)} factors, {len(self.distributions)} distributions and "
                f"{len(self.nominal)} nominal values: expected as many of each, at least one"
            )
        if not 0 < self.low < self.high < 1:
            raise DesignError(
                f"low is {self.low} and high {self.high}: expected 0 < low < high < 1"
            )

    @classmethod
    def of(
        cls,
        factors: Sequence[str],
        distributions: Sequence[Distribution],
        nominal: Sequence[float] | None = None,
        low: float = 0.05,
        high: float = 0.95,
    ) -> OneAtATime:
        """A design of any sequences, whose nominal values are the medians by default."""
        if nominal is None:
            nominal = [d.median for d in distributions]
        values = tuple(float(x) for x in nominal)
        return cls(tuple(factors), tuple(distributions), values, low, high)

    def __len__(self) -> int:
        return 2 * len(self.factors) + 1

    def rows(self, start: int = 0, stop: int | None = None) -> Array:
        """Values of the factors in rows start … stop-1, (rows, factors).

        Raises:
            DesignError: the design does not have these rows.
        """
        stop = len(self) if stop is None else stop
        if not 0 <= start <= stop <= len(self):
            raise DesignError(f"rows {start} to {stop} of a design with rows 0 to {len(self)}")
        found = np.tile(np.array(self.nominal), (len(self), 1))
        for k, distribution in enumerate(self.distributions):
            found[1 + 2 * k : 3 + 2 * k, k] = distribution.of([self.low, self.high])
        return found[start:stop]

    def tornado(self, outputs: ArrayLike, names: Sequence[str] | None = None) -> Tornado:
        """The swings of the outputs.

        Args:
            outputs: at all rows, (rows,) or (rows, outputs); NaN of runs without a value.
            names: of the outputs.

        Raises:
            EnsembleError: the shape is wrong.
        """
        values = as_outputs(outputs, len(self))
        return Tornado(
            self.factors,
            output_names(values, names),
            values[0],
            values[1::2].T,
            values[2::2].T,
            (self.low, self.high),
        )


@dataclass(frozen=True)
class Tornado:
    """What each factor does to each output by itself."""

    factors: tuple[str, ...]
    outputs: tuple[str, ...]
    nominal: Array
    """Outputs with every factor nominal, (outputs,)."""
    at_low: Array
    """Outputs with one factor at its low quantile, (outputs, factors)."""
    at_high: Array
    quantiles: tuple[float, float]

    @property
    def swing(self) -> Array:
        """Size of the range that a factor moves an output over, nominal included; NaN where a run
        has no value, (outputs, factors)."""
        ends = np.stack(
            [self.at_low, self.at_high, np.broadcast_to(self.nominal[:, None], self.at_low.shape)]
        )
        return np.asarray(np.ptp(ends, axis=0))

    def ranked(self, output: str) -> tuple[str, ...]:
        """Factors, the largest swing first; those without a value last.

        Raises:
            UnknownName: no output has this name.
        """
        return tuple(self.factors[k] for k in self._order(self._place(output)))

    def _place(self, output: str) -> int:
        if output not in self.outputs:
            raise UnknownName("output", output, self.outputs)
        return self.outputs.index(output)

    def _order(self, k: int) -> NDArray[np.intp]:
        return np.argsort(-np.nan_to_num(self.swing[k], nan=-1.0), kind="stable")

    def as_dict(self) -> dict[str, Any]:
        """The content as plain data."""
        return {
            "factors": list(self.factors),
            "outputs": list(self.outputs),
            "quantiles": list(self.quantiles),
            "nominal": plain(self.nominal),
            "at_low": plain(self.at_low),
            "at_high": plain(self.at_high),
            "swing": plain(self.swing),
        }

    def __str__(self) -> str:
        low, high = (percent(q) for q in self.quantiles)
        lines = [f"one factor at a time, at its {low} and {high} quantiles, others nominal"]
        swing = self.swing
        for k, output in enumerate(self.outputs):
            lines.append(f"{output}: {short(self.nominal[k])} nominal")
            order = self._order(k)
            rows = [["", "low", "high", "swing"]]
            rows += [
                [self.factors[i], *(short(x[k, i]) for x in (self.at_low, self.at_high, swing))]
                for i in order[:SHOWN]
            ]
            lines += table(rows)
            if len(order) > SHOWN:
                lines.append(f"  … and {count(len(order) - SHOWN, 'factor')} with smaller swings")
        lost = int(np.sum(~np.isfinite(self.at_low)) + np.sum(~np.isfinite(self.at_high)))
        if lost or not np.isfinite(self.nominal).all():
            lines.append(f"{count(lost, 'value')} missing: runs that gave none")
        return "\n".join(lines)
