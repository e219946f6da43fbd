"""Shares of a sum along time, stacked: what is positive upwards, what is negative downwards."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from gough.view import paper

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

TINTS = ("#9ecae1", "#fdae6b", "#a1d99b", "#bcbddc", "#fdd0a2", "#c7e9c0", "#d9d9d9", "#e7ba52")
"""Of the shares, one after the other."""
COLUMNS = 2


@dataclass(frozen=True)
class Stack:
    """One sum and its shares."""

    title: str
    shares: Array
    """(shares, times)."""


def draw_stacks(time: Array, stacks: Sequence[Stack], names: Sequence[str], label: str) -> Figure:
    """A panel for each sum, its shares stacked under a line for the sum.

    Args:
        time: (times,), s.
        stacks: what is drawn.
        names: of the shares.
        label: of the sums, with their unit.

    Raises:
        ViewError: matplotlib is not installed.
    """
    with paper.lettering():
        columns = min(COLUMNS, len(stacks))
        rows = -(-len(stacks) // columns)
        height, gap, under = 1.35, 0.45, 0.95
        width = (paper.WIDTH - 0.75 - 0.5 * (columns - 1)) / columns
        picture = paper.figure(paper.WIDTH, under + rows * (height + gap))
        for k, stack in enumerate(stacks):
            row, column = divmod(k, columns)
            left = 0.65 + column * (width + 0.5)
            bottom = under + (rows - 1 - row) * (height + gap)
            axes = paper.place(picture, left, bottom, width, height)
            _fill(axes, time, stack)
            if column == 0:
                axes.set_ylabel(label)
            if k >= len(stacks) - columns:
                axes.set_xlabel("time [s]")
            else:
                axes.tick_params(labelbottom=False)
        _legend(picture, names)
        return picture


def _fill(axes: Axes, time: Array, stack: Stack) -> None:
    axes.grid(color=paper.FAINT, linewidth=0.5)
    for sign in (1.0, -1.0):
        low = np.zeros(len(time))
        for k, share in enumerate(stack.shares):
            high = low + np.where(sign * share > 0, share, 0.0)
            axes.fill_between(time, low, high, color=TINTS[k % len(TINTS)], linewidth=0)
            low = high
    axes.axhline(0, color=paper.SOFT, linewidth=0.6)
    axes.plot(time, stack.shares.sum(axis=0), color=paper.INK, linewidth=1.3)
    axes.set_xlim(time[0], time[-1])
    axes.set_title(stack.title, loc="left")


def _legend(picture: Figure, names: Sequence[str]) -> None:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    entries = [
        Patch(color=TINTS[k % len(TINTS)], label=name, linewidth=0) for k, name in enumerate(names)
    ]
    total = Line2D([], [], color=paper.INK, linewidth=1.3, label="sum")
    picture.legend(
        handles=[*entries, total],
        loc="lower center",
        ncols=min(len(names) + 1, 8),
        bbox_to_anchor=(0.5, 0.0),
        columnspacing=1.2,
        handlelength=1.2,
    )
