"""How an output is spread over an ensemble, with the limit that it has to keep."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from gough.view import paper

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

KEPT, MISSED = "#9ec3dc", "#e59a80"
MOST = 60
"""Bins at most."""


@dataclass(frozen=True)
class Limit:
    """A limit of an output, and which side of it is missed."""

    value: float
    missed: Literal["above", "below"]
    text: str
    """What stands beside it, such as the probability of missing it with its interval."""


def draw_histogram(values: Array, label: str, limit: Limit | None = None) -> Figure:
    """How many runs have which values; those beyond the limit in another colour.

    Args:
        values: (runs,); how many have no value is told.
        label: of the output, with its unit.
        limit: what it has to keep.

    Raises:
        ViewError: matplotlib is not installed.
    """
    values = np.asarray(values, float)
    known = values[np.isfinite(values)]
    with paper.lettering():
        picture = paper.figure(paper.WIDTH, 2.9)
        axes = paper.place(picture, 0.72, 0.55, paper.WIDTH - 0.92, 2.05)
        from matplotlib.ticker import MaxNLocator

        axes.grid(axis="y", color=paper.FAINT, linewidth=0.5)
        edges = _edges(known, limit)
        heights, _ = np.histogram(known, edges)
        middles = (edges[1:] + edges[:-1]) / 2
        axes.bar(
            middles, heights, np.diff(edges), color=_colours(middles, limit), ec="white", lw=0.5
        )
        axes.set_xlim(edges[0], edges[-1])
        axes.set_ylim(0, 1.12 * max(int(heights.max(initial=0)), 1))
        if limit is not None:
            _mark(axes, limit)
        axes.yaxis.set_major_locator(MaxNLocator(nbins=6, integer=True))
        axes.set_xlabel(label)
        axes.set_ylabel("runs")
        for side in ("top", "right"):
            axes.spines[side].set_visible(False)
        lost = len(values) - len(known)
        without = f", {lost} of them without a value" if lost else ""
        axes.set_title(f"{len(values)} runs{without}", loc="left", fontsize=8, color=paper.SOFT)
        return picture


def _edges(known: Array, limit: Limit | None) -> Array:
    """Equal bins after Freedman and Diaconis (1981), one edge at the limit."""
    if not known.size:
        middle = limit.value if limit else 0.0
        return np.array([middle - 1, middle, middle + 1])
    low, high = float(known.min()), float(known.max())
    room = 0.04 * ((high - low) or abs(high) or 1.0)
    if limit is not None:
        low, high = min(low, limit.value - room), max(high, limit.value + room)
    q1, q3 = np.quantile(known, [0.25, 0.75])
    step = 2 * float(q3 - q1) / np.cbrt(len(known))
    step = max(step, (high - low) / MOST) or room
    start = limit.value if limit is not None else low
    below, above = np.ceil((start - low) / step), np.ceil((high - start) / step)
    edges = start + step * np.arange(-below, max(above, 1 - below) + 1)
    edges[-1] = max(edges[-1], high)  # rounding must not lose the last value
    if known.min() >= 0 > edges[0] and (limit is None or limit.value > 0):
        above_zero = edges[edges > 0.5 * step]  # what is never negative gets no bin below zero
        edges = np.concatenate([[0.0], above_zero]) if above_zero.size else edges
    return np.asarray(edges)


def _colours(middles: Array, limit: Limit | None) -> list[str]:
    if limit is None:
        return [KEPT] * len(middles)
    missed = middles > limit.value if limit.missed == "above" else middles < limit.value
    return [MISSED if m else KEPT for m in missed]


def _mark(axes: Axes, limit: Limit) -> None:
    axes.axvline(limit.value, color=paper.ACCENT, linewidth=1.2, zorder=3)
    low, high = axes.get_xlim()
    right = limit.value < low + 0.5 * (high - low)
    style: dict[str, Any] = {"textcoords": "offset points", "color": paper.ACCENT, "fontsize": 8}
    axes.annotate(
        limit.text,
        (limit.value, 0.98),
        xycoords=axes.get_xaxis_transform(),
        xytext=(4 if right else -4, 0),
        ha="left" if right else "right",
        va="top",
        **style,
    )
