"""Numbers over time in small panels, with moments marked in all of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from gough.view import paper
from gough.view.compare import LINES

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

COLUMNS = 2


@dataclass(frozen=True)
class History:
    """One panel: curves with one unit."""

    label: str
    """With the unit."""
    curves: Sequence[Array]
    """(times,) each."""
    names: Sequence[str] = ()
    """Of the curves; not needed for one."""


def draw_histories(
    time: Array, histories: Sequence[History], marks: Sequence[float] = (), marked: str = ""
) -> Figure:
    """A panel for each history, two beside each other.

    Args:
        time: (times,), s.
        histories: what is drawn.
        marks: moments with a vertical line in every panel, s.
        marked: what happens then.

    Raises:
        ViewError: matplotlib is not installed.
    """
    with paper.lettering():
        columns = min(COLUMNS, len(histories))
        rows = -(-len(histories) // columns)
        left, apart, under, over = 0.72, 0.78, 0.82 if len(marks) else 0.5, 0.12
        high, between = 1.4, 0.2
        width = (paper.WIDTH - left - 0.12 - apart * (columns - 1)) / columns
        height = under + rows * high + (rows - 1) * between + over
        picture = paper.figure(paper.WIDTH, height)
        for k, history in enumerate(histories):
            row, column = divmod(k, columns)
            bottom = under + (rows - 1 - row) * (high + between)
            axes = paper.place(picture, left + column * (width + apart), bottom, width, high)
            for moment in marks:
                axes.axvline(moment, color=paper.SOFT, lw=0.6, ls=(0, (1, 2)), zorder=1.2)
            _draw(axes, time, history)
            below = k + columns >= len(histories)
            axes.tick_params(labelbottom=below)
            axes.set_xlabel("time [s]" if below else "")
        if len(marks):
            _legend(picture, marked)
        return picture


def _draw(axes: Axes, time: Array, history: History) -> None:
    axes.grid(color=paper.FAINT, linewidth=0.5)
    for k, curve in enumerate(history.curves):
        colour, dashes = LINES[k % len(LINES)] if len(history.curves) > 1 else (paper.PLATFORM, "-")
        name = history.names[k] if len(history.names) > k else ""
        axes.plot(
            time, np.ma.masked_invalid(curve), color=colour, ls=dashes, lw=1.3, label=name, zorder=2
        )
    axes.set_xlim(time[0], time[-1])
    axes.margins(y=0.1)
    axes.locator_params(axis="y", nbins=5)
    axes.ticklabel_format(axis="y", style="sci", scilimits=(-3, 4), useMathText=True)
    axes.yaxis.get_offset_text().set_fontsize(7.5)
    axes.set_ylabel(history.label)
    if any(history.names):
        columns = 1 if len(history.curves) < 4 else 2
        axes.legend(
            loc="best", fontsize=7, handlelength=2.0, ncols=columns, labelspacing=0.25,
            columnspacing=1.0, borderaxespad=0.3,
        )  # fmt: skip


def _legend(picture: Figure, marked: str) -> None:
    from matplotlib.lines import Line2D

    line = Line2D([], [], color=paper.SOFT, lw=0.8, ls=(0, (1, 2)), label=marked)
    picture.legend(handles=[line], loc="lower center", bbox_to_anchor=(0.5, 0.0))
