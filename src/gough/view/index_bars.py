"""First-order and total Sobol' indices as bars with their intervals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from gough.view import paper

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

FIRST, TOTAL = "#2f6f9f", "#b5d3e7"
LETTER = 0.068
"""Width of a letter, inches, about."""
COLUMNS = 3


@dataclass(frozen=True)
class IndexBars:
    """Indices of one output."""

    title: str
    first: Array
    """(factors,); NaN where there is none."""
    total: Array
    first_interval: Array
    """(factors, 2)."""
    total_interval: Array


def draw_index_bars(names: Sequence[str], panels: Sequence[IndexBars], most: int = 12) -> Figure:
    """A panel for each output; factors in one order, the largest total index of any output first.

    Args:
        names: of the factors.
        panels: indices, at least of one output.
        most: factors that are shown; how many are left out is told.

    Raises:
        ViewError: matplotlib is not installed.
    """
    largest = np.max([np.nan_to_num(panel.total) for panel in panels], axis=0)
    order = np.argsort(-largest, kind="stable")[:most]
    with paper.lettering():
        columns = min(COLUMNS, len(panels))
        rows = -(-len(panels) // columns)
        height, under, over, gap = 0.26 * len(order) + 0.12, 0.8, 0.3, 0.2
        left = 0.25 + LETTER * max((len(names[k]) for k in order), default=0)
        width = min((paper.WIDTH - left - 0.2 + gap) / columns - gap, 4.2)
        picture = paper.figure(paper.WIDTH, under + rows * (height + over) + (rows - 1) * 0.2)
        spare = (paper.WIDTH - 0.2 - left - columns * (width + gap) + gap) / 2
        ends = [np.nan_to_num(x[order]) for p in panels for x in (p.total_interval, p.total)]
        high = max(1.02, 1.04 * max(float(x.max(initial=0.0)) for x in ends))
        for k, panel in enumerate(panels):
            row, column = divmod(k, columns)
            bottom = under + (rows - 1 - row) * (height + over + 0.2)
            axes = paper.place(
                picture, left + spare + column * (width + gap), bottom, width, height
            )
            _draw(axes, panel, order)
            axes.locator_params(axis="x", nbins=8 // columns + 1, steps=[1, 2, 5, 10])
            axes.set_xlim(min(0.0, _lowest(panels, order)), high)
            axes.set_yticks(range(len(order)), [names[i] for i in order] if not column else [])
            below = k + columns >= len(panels)
            axes.tick_params(labelbottom=below)
            if below:
                axes.set_xlabel("part of the variance")
        _legend(picture, len(names) - len(order))
        return picture


def _lowest(panels: Sequence[IndexBars], order: NDArray[np.intp]) -> float:
    ends = [np.nan_to_num(panel.first_interval[order]).min(initial=0.0) for panel in panels]
    return 1.1 * float(min(ends))


def _draw(axes: Axes, panel: IndexBars, order: NDArray[np.intp]) -> None:
    axes.grid(axis="x", color=paper.FAINT, linewidth=0.5)
    rows = np.arange(len(order))
    for values, interval, colour, shift in (
        (panel.first, panel.first_interval, FIRST, -0.18),
        (panel.total, panel.total_interval, TOTAL, 0.18),
    ):
        shown = np.nan_to_num(values[order])
        axes.barh(rows + shift, shown, 0.36, color=colour, zorder=2)
        ends = np.clip(np.abs(interval[order].T - values[order]), 0, None)
        style: dict[str, Any] = {"fmt": "none", "ecolor": paper.INK, "elinewidth": 0.8}
        axes.errorbar(
            values[order], rows + shift, xerr=ends, capsize=1.8, capthick=0.8, zorder=3, **style
        )
    if not np.isfinite(panel.total[order]).any():
        axes.text(
            0.5, 0.5, "does not vary", transform=axes.transAxes, ha="center", color=paper.SOFT
        )
    axes.axvline(0, color=paper.SOFT, linewidth=0.6, zorder=1.5)
    axes.set_ylim(len(order) - 0.45, -0.55)
    axes.tick_params(axis="y", length=0)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    axes.xaxis.set_major_formatter("{x:g}")
    axes.set_title(panel.title, loc="left")


def _legend(picture: Figure, hidden: int) -> None:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    entries: list[Any] = [
        Patch(color=FIRST, linewidth=0, label="first order: by itself"),
        Patch(color=TOTAL, linewidth=0, label="total: with others too"),
        Line2D([], [], color=paper.INK, linewidth=0.8, label="interval"),
    ]
    if hidden:
        word = "factor" if hidden == 1 else "factors"
        entries.append(Line2D([], [], ls="none", label=f"({hidden} smaller {word} not shown)"))
    picture.legend(handles=entries, loc="lower center", ncols=len(entries), columnspacing=1.2)
