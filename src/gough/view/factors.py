"""Velocity factors and condition numbers over a plane: ratios, told apart by what they double."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from gough.view import paper
from gough.view.maps import home_style, not_reached

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Array = NDArray[np.float64]
Point = tuple[float, float]

OCTAVES = 2.0 ** (np.arange(-4, 5) / 2)
"""Levels of factors without a unit, 1/4 to 4 in steps of √2."""
DIVERGING = "PuOr_r"
ROUNDING = 1e-9
SPREAD = 30.0
"""Values above this times the smallest are not told apart: they belong to singularities."""
LINEAR = 6.0
"""Levels stand in equal steps where the largest is less than this times the smallest."""
STEPS = (1, 2, 5)
"""Else these times powers of ten."""


@dataclass(frozen=True)
class Ratio:
    """One positive value over the points of a grid."""

    title: str
    values: Array
    """(rows, columns) over y and x; NaN where there is no value, infinite at singularities."""
    grows: bool
    """Whether it is infinite at singularities rather than zero."""
    octaves: bool = False
    """Whether 1 is its middle: levels from 1/4 to 4, with lines at 1/2, 1 and 2."""

    def bent(self, values: Array) -> Array:
        """Values so that they are about linear near singularities: v, or -1 / v."""
        with np.errstate(divide="ignore"):
            return np.asarray(-1.0 / values if self.grows else values)


@dataclass(frozen=True)
class Marks:
    """What stands on every map."""

    home: Point | None = None
    isotropic: Point | None = None
    square: tuple[Point, Point] | None = None
    """Two opposite corners of a prescribed workspace."""
    side: Array | None = None
    """(rows, columns), changes its sign at singularities of type 2."""


def draw_ratios(
    x: Array, y: Array, ratios: Sequence[Ratio], labels: tuple[str, str], marks: Marks
) -> Figure:
    """One map for each ratio, side by side, each with its colour bar; lengths to one scale.

    Args:
        x, y: coordinates of the columns (n,) and rows (m,) of the grid, of one unit.
        ratios: what is drawn.
        labels: of the two axes, with units.
        marks: what stands on every map.

    Raises:
        ViewError: matplotlib is not installed.
    """
    with paper.lettering():
        left, under, gap, bar, over = 0.65, 0.88, 1.2, 0.12, 0.3
        width = min((paper.WIDTH - left - 0.7 + gap) / len(ratios) - gap, 3.4)
        height = width * float(np.clip(np.ptp(y) / np.ptp(x), 0.5, 1.6))
        picture = paper.figure(paper.WIDTH, height + under + over)
        spare = (paper.WIDTH - left - 0.7 + gap - len(ratios) * (width + gap)) / 2
        for k, ratio in enumerate(ratios):
            at = left + spare + k * (width + gap)
            space = paper.place(picture, at, under, width, height)
            filled = _draw(space, x, y, ratio, marks)
            space.set_title(ratio.title)
            space.set_xlabel(labels[0])
            if k == 0:
                space.set_ylabel(labels[1])
            if filled is not None:
                beside = paper.place(picture, at + width + 0.08, under, bar, height)
                _colour_bar(picture, filled, beside, ratio)
        entries = _legend_entries(ratios, marks)
        if entries:
            picture.legend(handles=entries, loc="lower center", ncols=len(entries))
        return picture


def _draw(space: Axes, x: Array, y: Array, ratio: Ratio, marks: Marks) -> Any:
    """Fill the map; what to make a colour bar of, or None where there is nothing."""
    import matplotlib
    from matplotlib.colors import BoundaryNorm

    space.patch.set(facecolor="#eef0f2", hatch="////", edgecolor="#aab2b8")
    space.set_xlim(x[0], x[-1])
    space.set_ylim(y[0], y[-1])
    space.locator_params(nbins=5)
    filled = None
    if not np.isnan(ratio.values).all():
        levels = OCTAVES if ratio.octaves else _levels(ratio)
        bounds = ratio.bent(levels)
        # what is 1 but for rounding is not below it
        values = np.ma.masked_invalid(ratio.bent(ratio.values * (1 + ROUNDING)))
        name = DIVERGING if ratio.octaves else paper.MAP
        style: dict[str, Any] = {"levels": bounds, "extend": "both"}
        style["cmap"] = matplotlib.colormaps[name].resampled(len(levels) + 1)
        style["norm"] = BoundaryNorm(bounds, len(levels) + 1, extend="both")
        filled = space.contourf(x, y, values, **style)
        if ratio.octaves:
            _band(space, x, y, values, ratio)
        else:
            space.contour(
                x, y, values, levels=bounds, colors="white", linewidths=0.4, linestyles="solid"
            )
    _draw_marks(space, x, y, marks)
    return filled


def _levels(ratio: Ratio) -> Array:
    """Round values that cover most of what is finite."""
    from matplotlib.ticker import MaxNLocator

    known = ratio.values[~np.isnan(ratio.values)]
    low, high = (float(np.quantile(known, part, method="lower")) for part in (0.0, 0.95))
    if not ratio.grows:
        low, high = 0.0, float(known.max())
    high = min(high, SPREAD * low) if low > 0 else high
    if not np.isfinite(high) or high <= 1.001 * low:
        return np.geomspace(1.0, SPREAD, 6) * (low if 0 < low < np.inf else 1.0)
    if low > 0 and high > LINEAR * low:
        decades = range(int(np.floor(np.log10(low))), int(np.ceil(np.log10(high))) + 1)
        series = np.array([step * 10.0**k for k in decades for step in STEPS])
        return series[(series > low) & (series < 1.001 * high)]
    found = np.asarray(MaxNLocator(8, steps=[1, 2, 2.5, 5, 10]).tick_values(low, high))
    return found[(found > low) & (found < 1.001 * high)]


def _band(space: Axes, x: Array, y: Array, values: Any, ratio: Ratio) -> None:
    """Lines at 1/2, 1 and 2, named."""
    half, one, two = ratio.bent(np.array([0.5, 1.0, 2.0])).tolist()
    style: dict[str, Any] = {"colors": paper.INK, "linestyles": "solid", "zorder": 3}
    space.contour(x, y, values, levels=[one], linewidths=0.6, **style)
    lines = space.contour(x, y, values, levels=[half, two], linewidths=1.5, **style)
    space.clabel(lines, fmt={half: "½", two: "2"}, fontsize=8.5)


def _draw_marks(space: Axes, x: Array, y: Array, marks: Marks) -> None:
    if marks.side is not None and np.nanmin(marks.side) < 0 < np.nanmax(marks.side):
        side = np.ma.masked_invalid(marks.side)
        space.contour(x, y, side, levels=[0.0], colors="white", linewidths=2.6, zorder=4)
        space.contour(x, y, side, levels=[0.0], zorder=4.1, **_crossing())
    if marks.square is not None:
        (x0, y0), (x1, y1) = marks.square
        corners = np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1], [x0, y0]])
        space.plot(*corners.T, **_square_style())
    if marks.home is not None:
        space.plot(*marks.home, **home_style())
    if marks.isotropic is not None:
        space.plot(*marks.isotropic, **_star())


def _crossing() -> dict[str, Any]:
    return {"colors": paper.INK, "linewidths": 1.4, "linestyles": [(0, (5, 2, 1, 2))]}


def _square_style() -> dict[str, Any]:
    return {"color": paper.INK, "linewidth": 1.2, "linestyle": (0, (4, 2)), "zorder": 5}


def _star() -> dict[str, Any]:
    return {
        "marker": "*", "ms": 11, "mfc": "white", "mec": paper.INK, "mew": 1.0, "ls": "none",
        "zorder": 7,
    }  # fmt: skip


def _colour_bar(picture: Figure, filled: Any, beside: Axes, ratio: Ratio) -> None:
    bounds = np.asarray(filled.levels)
    names = ["¼", "½", "1", "2", "4"]
    if ratio.octaves:
        bounds = bounds[::2]
    else:
        names = [f"{level:.4g}" for level in (-1.0 / bounds if ratio.grows else bounds)]
    bar = picture.colorbar(filled, cax=beside, ticks=bounds, spacing="uniform")
    bar.ax.set_yticklabels(names)
    bar.ax.minorticks_off()


def _legend_entries(ratios: Sequence[Ratio], marks: Marks) -> list[Any]:
    from matplotlib.lines import Line2D

    entries: list[Any] = []
    if marks.home is not None:
        entries.append(Line2D([], [], label="home", **home_style()))
    if marks.isotropic is not None:
        entries.append(Line2D([], [], label="isotropic point", **_star()))
    if marks.square is not None:
        entries.append(Line2D([], [], label="prescribed cube", **_square_style()))
    if marks.side is not None and np.nanmin(marks.side) < 0 < np.nanmax(marks.side):
        dashes: Any = (0, (5, 2, 1, 2))
        style: dict[str, Any] = {"color": paper.INK, "linewidth": 1.4, "linestyle": dashes}
        entries.append(Line2D([], [], label="singularity of type 2", **style))
    if any(np.isnan(ratio.values).any() for ratio in ratios):
        entries.append(not_reached())
    return entries
