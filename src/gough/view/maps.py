"""Values over a plane of two coordinates, as filled contours with what is out of reach hatched."""

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

SMALL = 0.1
"""The contour of small values, as a part of the largest value of its layer."""
LEVELS = 12


@dataclass(frozen=True)
class Layer:
    """One value over the points of a grid or a line."""

    title: str
    values: Array
    """(rows, columns) over y and x, or (points,); not finite where there is no value."""

    @property
    def largest(self) -> float:
        """The largest finite value; 0 if there is none."""
        finite = self.values[np.isfinite(self.values)]
        return float(finite.max(initial=0.0))

    @property
    def gets_small(self) -> bool:
        """Whether the contour of small values exists."""
        finite = self.values[np.isfinite(self.values)]
        return float(finite.min(initial=np.inf)) < SMALL * self.largest

    @property
    def whole(self) -> bool:
        """Whether there is a value everywhere."""
        return bool(np.all(np.isfinite(self.values)))


def draw_maps(
    x: Array,
    y: Array,
    layers: Sequence[Layer],
    labels: tuple[str, str],
    home: tuple[float, float],
) -> Figure:
    """One map for each layer, side by side, each with its own colour bar.

    Args:
        x, y: coordinates of the columns (n,) and rows (m,) of the grid.
        layers: values, (m, n) each.
        labels: of the two axes, with units.
        home: where the start configuration is marked.

    Raises:
        ViewError: matplotlib is not installed.
    """
    with paper.lettering():
        gap, bar = 1.25, 0.12
        width = min((paper.WIDTH - 0.65 - 0.65 + gap) / len(layers) - gap, 3.6)
        height = width * float(np.clip(np.ptp(y) / np.ptp(x), 0.6, 1.6)) if _same(labels) else width
        picture = paper.figure(paper.WIDTH, height + 1.2)
        spare = (paper.WIDTH - 1.3 + gap - len(layers) * (width + gap)) / 2
        for k, layer in enumerate(layers):
            left = 0.65 + spare + k * (width + gap)
            axes = paper.place(picture, left, 0.86, width, height)
            filled = _draw(axes, x, y, layer, home)
            axes.set_title(layer.title)
            axes.set_xlabel(labels[0])
            if k == 0:
                axes.set_ylabel(labels[1])
            if filled is not None:
                beside = paper.place(picture, left + width + 0.08, 0.86, bar, height)
                picture.colorbar(filled, cax=beside, format="%.2g")
        entries = _legend_entries(layers)
        picture.legend(handles=entries, loc="lower center", ncols=3, bbox_to_anchor=(0.5, 0.0))
        return picture


def _same(labels: tuple[str, str]) -> bool:
    """Whether both axes have the same unit."""
    return labels[0].split("(")[-1] == labels[1].split("(")[-1]


def _draw(axes: Axes, x: Array, y: Array, layer: Layer, home: tuple[float, float]) -> Any:
    """Fill the map; what to make a colour bar of, or None."""
    from matplotlib.ticker import MaxNLocator

    axes.patch.set(facecolor="#eef0f2", hatch="////", edgecolor="#aab2b8")
    axes.set_xlim(x[0], x[-1])
    axes.set_ylim(y[0], y[-1])
    axes.locator_params(nbins=5)
    values = np.ma.masked_invalid(layer.values)
    filled = None
    if layer.largest > 0:
        levels = MaxNLocator(LEVELS, steps=[1, 2, 2.5, 5, 10]).tick_values(
            0.0, layer.largest * (1 - 1e-9)
        )
        filled = axes.contourf(x, y, np.minimum(values, levels[-1]), levels=levels, cmap=paper.MAP)
        if layer.gets_small:
            small = SMALL * layer.largest
            axes.contour(x, y, values, levels=[small], colors=paper.ACCENT, linewidths=1.4)
    elif values.count():
        axes.contourf(x, y, values, levels=[-1.0, 1.0], colors=["#440154"])
    axes.plot(*home, **home_style())
    return filled


def home_style() -> dict[str, Any]:
    """How the start configuration is marked."""
    return {
        "marker": "o",
        "ms": 6,
        "mfc": "white",
        "mec": paper.INK,
        "mew": 1.2,
        "ls": "none",
        "zorder": 6,
    }


def _legend_entries(layers: Sequence[Layer]) -> list[Any]:
    from matplotlib.lines import Line2D

    entries: list[Any] = [Line2D([], [], label="home", **home_style())]
    if any(layer.gets_small for layer in layers):
        label = "a tenth of the largest value"
        entries.append(Line2D([], [], color=paper.ACCENT, linewidth=1.4, label=label))
    return entries + ([] if all(layer.whole for layer in layers) else [not_reached()])


def not_reached() -> Any:
    """The legend's entry for what is hatched."""
    from matplotlib.patches import Patch

    return Patch(facecolor="#eef0f2", edgecolor="#aab2b8", hatch="////", label="not reached")
