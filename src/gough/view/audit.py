"""Where the energy of a motion goes, and how far the balance is from closing."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from gough.view import paper

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

TINTS = {
    "kinetic": "#9ecae1",
    "potential": "#a1d99b",
    "stored": "#fdd49e",
    "dissipated": "#c9b8d8",
}
SPARE = ("#d9d9d9", "#e7ba52", "#c7e9c0")
"""Of parts with other names."""


def draw_audit(
    time: Array, parts: Mapping[str, Array], delivered: Array, error: Array | None = None
) -> Figure:
    """Parts of the energy since the start stacked, with a line for what was delivered.

    Args:
        time: (times,), s.
        parts: energies by name, (times,) each, J; *kinetic*, *potential*, *stored* and *dissipated*
            have colours of their own. Each is drawn as what it gained since the start.
        delivered: work that motors and surroundings did since the start, (times,), J.
        error: of the balance, (times,), J; the sum of the parts less what was delivered by default.

    Raises:
        ViewError: matplotlib is not installed.
    """
    gains = {name: np.asarray(part) - part[0] for name, part in parts.items()}
    total = np.sum(list(gains.values()), axis=0)
    off = np.abs(total - (delivered - delivered[0]) if error is None else error)
    with paper.lettering():
        left, under, low, gap, high, over = 0.78, 0.8, 1.0, 0.24, 2.2, 0.12
        picture = paper.figure(paper.WIDTH, under + low + gap + high + over)
        width = paper.WIDTH - left - 0.2
        axes = paper.place(picture, left, under + low + gap, width, high)
        _stack(axes, time, gains, delivered - delivered[0])
        below = paper.place(picture, left, under, width, low)
        _error(below, time, off, float(np.nanmax(np.abs([total, *gains.values()]), initial=0.0)))
        _legend(picture, list(gains))
        return picture


def _stack(axes: Axes, time: Array, gains: Mapping[str, Array], delivered: Array) -> None:
    axes.grid(color=paper.FAINT, linewidth=0.5)
    for sign in (1.0, -1.0):
        low = np.zeros(len(time))
        for name, gain in gains.items():
            high = low + np.where(sign * gain > 0, gain, 0.0)
            if np.any(high != low):
                axes.fill_between(time, low, high, color=_tint(name, list(gains)), linewidth=0)
            low = high
    axes.axhline(0, color=paper.SOFT, linewidth=0.6)
    axes.plot(time, delivered, color=paper.INK, linewidth=1.4)
    axes.set_xlim(time[0], time[-1])
    axes.tick_params(labelbottom=False)
    axes.set_ylabel("energy since start [J]")


def _error(axes: Axes, time: Array, error: Array, size: float) -> None:
    """The size of the error; where it is zero there is nothing on a logarithmic axis."""
    axes.grid(color=paper.FAINT, linewidth=0.5)
    axes.set_yscale("log")
    shown = np.ma.masked_less_equal(np.ma.masked_invalid(error), 0.0)
    axes.plot(time, shown, color=paper.ACCENT, linewidth=1.0)
    if shown.count():
        low, high = float(shown.min()), float(shown.max())
        low = max(low, 1e-6 * high)
        axes.set_ylim(10 ** np.floor(np.log10(low)), 10 ** np.ceil(np.log10(1.1 * high)))
    else:
        axes.set_ylim(1e-16, 1.0)
    worst = float(np.nanmax(error, initial=0.0))
    part = f", {_rough(worst / size)} of the largest energy" if size > 0 else ""
    title = f"balance open by at most {_rough(worst)} J{part}"
    axes.set_title(title, loc="right", fontsize=8, pad=3)
    axes.set_xlim(time[0], time[-1])
    axes.set_xlabel("time [s]")
    axes.set_ylabel("error [J]")


def _rough(value: float) -> str:
    """One digit and a power of ten."""
    front, _, power = f"{value:.0e}".partition("e")
    if not value or -3 < int(power) < 3:
        return f"{value:.1g}"
    raised = str(int(power)).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))
    return f"10{raised}" if front == "1" else f"{front} · 10{raised}"


def _tint(name: str, names: list[str]) -> str:
    others = [n for n in names if n not in TINTS]
    return TINTS[name] if name in TINTS else SPARE[others.index(name) % len(SPARE)]


def _legend(picture: Figure, names: list[str]) -> None:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    entries = [Patch(color=_tint(name, names), linewidth=0, label=name) for name in names]
    line = Line2D([], [], color=paper.INK, linewidth=1.4, label="delivered: the sum")
    picture.legend(
        handles=[*entries, line], loc="lower center", ncols=len(names) + 1, columnspacing=1.4
    )
