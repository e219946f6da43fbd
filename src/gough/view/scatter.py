"""Outputs of an ensemble against the factors that matter most, in small panels."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from gough.view import paper

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

BINS = 12
"""Groups of as many runs each, whose mean the line goes through."""
DOTS = 3000
"""More runs are thinned to about so many dots; lines and numbers come from all of them."""
VECTORS = 400
"""More dots are saved as pixels, so that a picture stays small."""
LETTER = 0.07
"""Width of a letter, inches, about."""


def draw_scatter(
    factors: Array,
    outputs: Array,
    factor_names: Sequence[str],
    output_names: Sequence[str],
    importance: Array | None = None,
    most: int = 4,
) -> Figure:
    """A row of panels for each output, its most important factors from left to right.

    Args:
        factors: (runs, factors).
        outputs: (runs, outputs); runs without a value are left out.
        factor_names, output_names: with units.
        importance: (outputs, factors), such as total Sobol' indices; the size of the rank
            correlation by default, which is blind to factors that act both ways.
        most: panels in a row.

    Raises:
        ViewError: matplotlib is not installed.
    """
    ranks = np.array([_rank_correlation(factors, y) for y in outputs.T])
    weight = np.abs(ranks) if importance is None else np.asarray(importance)
    with paper.lettering():
        columns, rows = min(most, factors.shape[1]), outputs.shape[1]
        left, gap, height = 0.72, 0.2, 1.3
        width = (paper.WIDTH - left - 0.12 + gap) / max(columns, 3) - gap
        named = [_in_lines(name, int(width / LETTER)) for name in factor_names]
        more = 0.14 * max(name.count("\n") for name in named)
        between, under = 0.66 + more, 0.72 + more
        picture = paper.figure(paper.WIDTH, under + rows * height + (rows - 1) * between + 0.28)
        for r in range(rows):
            order = np.argsort(-np.nan_to_num(weight[r]), kind="stable")[:columns]
            bottom = under + (rows - 1 - r) * (height + between)
            for c, k in enumerate(order):
                axes = paper.place(picture, left + c * (width + gap), bottom, width, height)
                _draw(axes, factors[:, k], outputs[:, r], float(ranks[r, k]))
                axes.set_xlabel(named[k])
                if c == 0:
                    axes.set_ylabel(output_names[r])
                else:
                    axes.tick_params(labelleft=False)
        _legend(picture)
        return picture


def _draw(axes: Axes, x: Array, y: Array, rank: float) -> None:
    known = np.isfinite(y)
    x, y = x[known], y[known]
    step = max(len(x) // DOTS, 1)
    many = len(x) / step > VECTORS
    axes.grid(color=paper.FAINT, linewidth=0.5)
    axes.plot(
        x[::step], y[::step], ".", ms=2.2, color=paper.PLATFORM, alpha=0.35, mew=0, rasterized=many
    )
    axes.plot(*_means(x, y), color=paper.ACCENT, linewidth=1.5)
    axes.margins(0.04)
    axes.locator_params(nbins=4)
    axes.locator_params(axis="x", nbins=3)
    text = f"{rank:+.2f}".replace("-", "−") if np.isfinite(rank) else "–"
    axes.set_title(f"rank corr. {text}", loc="right", fontsize=7.5, color=paper.SOFT, pad=3)


def _in_lines(name: str, letters: int) -> str:
    """A name in lines of at most so many letters; words stay whole, units by their words."""
    joined = name.replace(" [", "\N{NO-BREAK SPACE}[")
    return "\n".join(textwrap.wrap(joined, max(letters, 8), break_long_words=False))


def _means(x: Array, y: Array) -> tuple[Array, Array]:
    """Means of x and y over groups of neighbours in x."""
    order = np.argsort(x, kind="stable")
    groups = np.array_split(order, max(min(BINS, len(x) // 5), 1))
    kept = [g for g in groups if len(g)]
    return np.array([x[g].mean() for g in kept]), np.array([y[g].mean() for g in kept])


def _rank_correlation(factors: Array, y: Array) -> Array:
    """Of an output with each factor; NaN where one of them does not vary."""
    from gough.uncertainty.correlation import both_correlations

    known = np.isfinite(y)
    if known.sum() < 2:
        return np.full(factors.shape[1], np.nan)
    return both_correlations(factors[known], y[known])[1]


def _legend(picture: Figure) -> None:
    from matplotlib.lines import Line2D

    dot = Line2D([], [], ls="none", marker=".", ms=5, color=paper.PLATFORM, mew=0, label="run")
    line = Line2D([], [], color=paper.ACCENT, linewidth=1.5, label="mean of neighbouring runs")
    picture.legend(handles=[dot, line], loc="lower center", ncols=2, bbox_to_anchor=(0.5, 0.0))
