"""Curves of several runs on each other, and how far they are from the first."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from gough.view import paper

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

COLUMNS = 2
LINES: tuple[tuple[str, Any], ...] = (
    (paper.INK, "solid"),
    (paper.PLATFORM, (0, (6, 1.5))),
    (paper.ACCENT, (0, (3.5, 1.5))),
    ("#5a8f4e", (0, (1.2, 1.2))),
    ("#8c6bb1", (0, (5, 1.5, 1.2, 1.5))),
    (paper.GROUND, (0, (8, 2, 2, 2))),
)
"""Colours and dashes of the runs; dashes keep equal curves apart where they lie on each other."""


@dataclass(frozen=True)
class Compared:
    """One quantity in all runs."""

    label: str
    """With its unit."""
    values: Array
    """(runs, times); NaN where a run has no value."""


def draw_comparison(
    x: Array, quantities: Sequence[Compared], names: Sequence[str], label: str = "time [s]"
) -> Figure:
    """For each quantity the curves of all runs, and below their differences from the first.

    Args:
        x: what the curves go over, (times,).
        quantities: what is drawn.
        names: of the runs; the first is what the others are compared with.
        label: of x, with its unit.

    Raises:
        ViewError: matplotlib is not installed.
    """
    with paper.lettering():
        columns = min(COLUMNS, len(quantities))
        rows = -(-len(quantities) // columns)
        left, apart, under = 0.82, 0.85, 0.8
        high, gap, low, between = 1.45, 0.12, 0.75, 0.35
        width = (paper.WIDTH - left - 0.15 - apart * (columns - 1)) / columns
        block = low + gap + high
        height = under + rows * block + (rows - 1) * between + 0.22
        picture = paper.figure(paper.WIDTH, height)
        for k, quantity in enumerate(quantities):
            row, column = divmod(k, columns)
            at = left + column * (width + apart)
            bottom = under + (rows - 1 - row) * (block + between)
            upper = paper.place(picture, at, bottom + low + gap, width, high)
            lower = paper.place(picture, at, bottom, width, low)
            _draw(upper, x, quantity.values, 0)
            difference = quantity.values[1:] - quantity.values[0]
            power = _power(difference)
            _draw(lower, x, difference / 10.0**power, 1)
            lower.axhline(0, color=LINES[0][0], linewidth=0.8, zorder=1.5)
            upper.tick_params(labelbottom=False)
            upper.set_ylabel(quantity.label)
            lower.set_ylabel("difference" + (f"\nin 10{_raised(power)}" if power else ""))
            picture.align_ylabels([upper, lower])
            below = k + columns >= len(quantities)
            lower.tick_params(labelbottom=below)
            lower.set_xlabel(label if below else "")
        _legend(picture, names)
        return picture


def _draw(axes: Any, x: Array, values: Array, first: int) -> None:
    axes.grid(color=paper.FAINT, linewidth=0.5)
    for k, y in enumerate(values):
        colour, dashes = LINES[(k + first) % len(LINES)]
        axes.plot(
            x, np.ma.masked_invalid(y), color=colour, linestyle=dashes, linewidth=1.3, zorder=2
        )
    axes.set_xlim(x[0], x[-1])
    axes.locator_params(axis="y", nbins=5 if not first else 3)
    axes.margins(y=0.1)
    axes.ticklabel_format(axis="y", style="sci", scilimits=(-3, 4), useMathText=True)
    axes.yaxis.get_offset_text().set_fontsize(7.5)


def _power(values: Array) -> int:
    """The power of ten that small or large values are told in; 0 for others."""
    known = np.abs(values[np.isfinite(values)])
    largest = float(known.max(initial=0.0))
    return int(np.floor(np.log10(largest))) if largest and not 0.01 <= largest < 1e4 else 0


def _raised(power: int) -> str:
    return str(power).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))


def _legend(picture: Figure, names: Sequence[str]) -> None:
    from matplotlib.lines import Line2D

    entries = [
        Line2D([], [], color=LINES[k % len(LINES)][0], ls=LINES[k % len(LINES)][1], label=name)
        for k, name in enumerate(names)
    ]
    picture.legend(handles=entries, loc="lower center", ncols=min(len(names), 5), handlelength=2.6)
