"""Force over elongation of actuators: loops of hysteresis between their envelopes."""

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

COLUMNS = 3
BAND = "#eef0f2"
ARROWS = 3
"""On each loop, at equal steps of its length, to show which way it is gone through."""


@dataclass(frozen=True)
class Loop:
    """One actuator along a motion."""

    name: str
    elongation: Array
    """(times,)."""
    force: Array
    """(times,)."""
    envelope: Array
    """Elongations of the envelopes, rising, (points,)."""
    lower: Array
    """Force on the lower envelope, (points,)."""
    upper: Array


def draw_loops(loops: Sequence[Loop], labels: tuple[str, str]) -> Figure:
    """A panel for each actuator, all to one scale.

    Args:
        loops: of the actuators.
        labels: of elongation and force, with units.

    Raises:
        ViewError: matplotlib is not installed.
    """
    with paper.lettering():
        columns = min(COLUMNS, len(loops))
        rows = -(-len(loops) // columns)
        left, gap, between, under, over = 0.72, 0.16, 0.32, 0.8, 0.26
        width = min((paper.WIDTH - left - 0.12 + gap) / columns - gap, 3.4)
        height = max(0.72 * width, 1.3)
        picture = paper.figure(paper.WIDTH, under + over + rows * height + (rows - 1) * between)
        spare = (paper.WIDTH - 0.12 - left - columns * (width + gap) + gap) / 2
        across = _range([x for loop in loops for x in (loop.envelope, loop.elongation)])
        up = _range([x for loop in loops for x in (loop.lower, loop.upper, loop.force)])
        for k, loop in enumerate(loops):
            row, column = divmod(k, columns)
            bottom = under + (rows - 1 - row) * (height + between)
            axes = paper.place(
                picture, left + spare + column * (width + gap), bottom, width, height
            )
            axes.set_xlim(*across)
            axes.set_ylim(*up)
            _draw(axes, loop)
            below = k + columns >= len(loops)
            axes.tick_params(labelleft=column == 0, labelbottom=below)
            axes.set_xlabel(labels[0] if below else "")
            axes.set_ylabel(labels[1] if column == 0 else "")
        _legend(picture)
        return picture


def _range(values: Sequence[Array]) -> tuple[float, float]:
    together = np.concatenate(values)
    known = together[np.isfinite(together)]
    low, high = (float(known.min()), float(known.max())) if known.size else (0.0, 0.0)
    room = 0.06 * ((high - low) or abs(high) or 1.0)
    return low - room, high + room


def _draw(axes: Axes, loop: Loop) -> None:
    axes.grid(color=paper.FAINT, linewidth=0.5)
    axes.fill_between(loop.envelope, loop.lower, loop.upper, color=BAND, linewidth=0, zorder=0.6)
    axes.plot(loop.envelope, loop.upper, **_upper())
    axes.plot(loop.envelope, loop.lower, **_lower())
    axes.plot(loop.elongation, loop.force, color=paper.PLATFORM, linewidth=1.2, zorder=3)
    axes.plot(loop.elongation[0], loop.force[0], **_start())
    _arrows(axes, loop)
    axes.locator_params(nbins=5)
    axes.set_title(loop.name, loc="left")


def _arrows(axes: Axes, loop: Loop) -> None:
    """Heads along the loop, at equal steps of its length on paper."""
    points = np.column_stack([loop.elongation, loop.force])
    points = points[np.isfinite(points).all(axis=1)]
    if len(points) < 2:
        return
    scale = [np.ptp(axes.get_xlim()), np.ptp(axes.get_ylim())]
    along = np.concatenate(
        [[0], np.cumsum(np.linalg.norm(np.diff(points / scale, axis=0), axis=1))]
    )
    for part in (np.arange(ARROWS) + 0.6) / ARROWS:
        k = int(np.searchsorted(along, part * along[-1]))
        k = min(max(k, 1), len(points) - 1)
        first = max(int(np.searchsorted(along, along[k] - 0.012)) - 1, 0)
        axes.annotate(
            "",
            xy=(points[k, 0], points[k, 1]),
            xytext=(points[first, 0], points[first, 1]),
            arrowprops={
                "arrowstyle": "-|>,head_width=0.16,head_length=0.34",
                "color": paper.PLATFORM,
                "lw": 1.0,
                "shrinkA": 0,
                "shrinkB": 0,
            },
            zorder=4,
        )


def _upper() -> dict[str, Any]:
    return {"color": paper.ACCENT, "linewidth": 1.0, "linestyle": (0, (5, 2)), "zorder": 3.5}


def _lower() -> dict[str, Any]:
    return {"color": paper.INK, "linewidth": 1.0, "linestyle": (0, (1.5, 1.5)), "zorder": 3.5}


def _start() -> dict[str, Any]:
    return {
        "marker": "o", "ms": 4.5, "mfc": "white", "mec": paper.PLATFORM, "mew": 1.1, "ls": "none",
        "zorder": 5,
    }  # fmt: skip


def _legend(picture: Figure) -> None:
    from matplotlib.lines import Line2D

    entries = [
        Line2D([], [], color=paper.PLATFORM, linewidth=1.2, label="motion"),
        Line2D([], [], label="its start", **_start()),
        Line2D([], [], label="upper envelope", **_upper()),
        Line2D([], [], label="lower envelope", **_lower()),
    ]
    picture.legend(handles=entries, loc="lower center", ncols=4, bbox_to_anchor=(0.5, 0.0))
