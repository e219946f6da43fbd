"""Values over one coordinate, with what is out of reach hatched."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from gough.view import paper
from gough.view.maps import Layer, home_style, not_reached

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = NDArray[np.float64]


def draw_curves(x: Array, layers: Sequence[Layer], label: str, home: int) -> Figure:
    """One panel for each layer, one above the other.

    Args:
        x: the coordinate, (n,).
        layers: values, (n,) each.
        label: of the coordinate, with its unit.
        home: index of the start configuration.

    Raises:
        ViewError: matplotlib is not installed.
    """
    with paper.lettering():
        height, gap, under = 1.45, 0.35, 0.85
        picture = paper.figure(paper.WIDTH, under + len(layers) * (height + gap))
        for k, layer in enumerate(layers):
            bottom = under + (len(layers) - 1 - k) * (height + gap)
            axes = paper.place(picture, 0.75, bottom, paper.WIDTH - 0.95, height)
            axes.grid(color=paper.FAINT, linewidth=0.5)
            for low, high in _gaps(x, np.isfinite(layer.values)):
                axes.axvspan(low, high, fc="#eef0f2", ec="#aab2b8", hatch="////", lw=0, zorder=0.5)
            axes.plot(x, np.ma.masked_invalid(layer.values), color=paper.PLATFORM, linewidth=1.6)
            axes.plot(x[home], layer.values[home], **home_style())
            axes.set_xlim(x[0], x[-1])
            axes.set_ylim(0, 1.08 * layer.largest or 1.0)
            axes.set_title(layer.title, loc="left")
            if k < len(layers) - 1:
                axes.tick_params(labelbottom=False)
            else:
                axes.set_xlabel(label)
        _legend(picture, layers)
        return picture


def _gaps(x: Array, reached: NDArray[np.bool_]) -> Iterator[tuple[float, float]]:
    """Intervals of x without values, each up to its neighbours that have one."""
    start = None
    for k, here in enumerate(reached):
        if not here and start is None:
            start = x[max(k - 1, 0)]
        if here and start is not None:
            yield float(start), float(x[k])
            start = None
    if start is not None:
        yield float(start), float(x[-1])


def _legend(picture: Figure, layers: Sequence[Layer]) -> None:
    from matplotlib.lines import Line2D

    entries = [Line2D([], [], label="home", **home_style())]
    entries += [] if all(layer.whole for layer in layers) else [not_reached()]
    picture.legend(handles=entries, loc="lower center", ncols=2, bbox_to_anchor=(0.5, 0.0))
