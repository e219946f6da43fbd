"""Singular values on a logarithmic scale, with the threshold that decides the ranks."""

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

FLOOR = 1e-18
"""Smaller values, zero among them, are drawn here."""


@dataclass(frozen=True)
class Spectrum:
    """Singular values of one matrix."""

    name: str
    values: Array
    """Largest first, (k,)."""
    generic_rank: int


def draw_spectra(spectra: Sequence[Spectrum], threshold: float) -> Figure:
    """One panel for each matrix, on one logarithmic scale.

    Args:
        spectra: the matrices, from left to right.
        threshold: values up to here count as zero; a dashed line.

    Raises:
        ViewError: matplotlib is not installed.
    """
    with paper.lettering():
        picture = paper.figure(paper.WIDTH, 2.9)
        largest = max((float(s.values.max(initial=0.0)) for s in spectra), default=0.0) or 1.0
        smallest = min((_lowest(s.values) for s in spectra), default=FLOOR)
        gap = 0.12
        width = (paper.WIDTH - 0.68 - 0.1 + gap) / max(len(spectra), 1) - gap
        for k, spectrum in enumerate(spectra):
            axes = paper.place(picture, 0.68 + k * (width + gap), 0.5, width, 1.95)
            axes.set_yscale("log")
            axes.set_ylim(min(smallest, threshold or 1.0) / 10, 5 * largest)
            _draw(axes, spectrum, threshold)
            if k == 0:
                axes.set_ylabel("singular value")
                _name_threshold(axes, threshold)
            else:
                axes.tick_params(labelleft=False)
        return picture


def _name_threshold(axes: Axes, threshold: float) -> None:
    axes.annotate(
        "threshold",
        (0.02, threshold or FLOOR),
        xycoords=axes.get_yaxis_transform(),
        xytext=(2, 3),
        textcoords="offset points",
        color=paper.ACCENT,
        fontsize=7.5,
    )


def _lowest(values: Array) -> float:
    return max(float(values.min(initial=1.0)), FLOOR)


def _draw(axes: Axes, spectrum: Spectrum, threshold: float) -> None:
    from matplotlib.ticker import MaxNLocator

    shown = np.maximum(spectrum.values, FLOOR)
    number = np.arange(1, len(shown) + 1)
    kept = spectrum.values > threshold
    rank = int(np.sum(kept))
    axes.grid(axis="y", color=paper.FAINT, linewidth=0.5)
    axes.axhline(threshold or FLOOR, color=paper.ACCENT, linewidth=0.9, linestyle=(0, (5, 3)))
    axes.plot(number[kept], shown[kept], "o", ms=4.5, color=paper.PLATFORM)
    axes.plot(number[~kept], shown[~kept], "o", ms=4.5, mfc="white", color=paper.ACCENT)
    axes.set_xlim(0.3, max(len(shown), 1) + 0.7)
    axes.xaxis.set_major_locator(MaxNLocator(nbins=5, integer=True, min_n_ticks=1))
    axes.set_xlabel("number")
    usual = "" if rank == spectrum.generic_rank else f" (generic {spectrum.generic_rank})"
    axes.set_title(f"{spectrum.name}\nrank {rank}{usual}")
    if not len(shown):
        axes.text(0.5, 0.5, "no columns", transform=axes.transAxes, ha="center", color=paper.SOFT)
        axes.set_xticks([])
