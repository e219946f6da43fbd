"""What each factor does to an output by itself, as bars about the nominal value."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from gough.view import paper

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

LOW, HIGH = "#7fb2d3", "#2f6f9f"
"""Of a factor at its low and at its high value."""
LETTER = 0.068
"""Width of a letter, inches, about."""


def draw_tornado(
    names: Sequence[str],
    at_low: Array,
    at_high: Array,
    nominal: float,
    label: str,
    quantiles: tuple[str, str] = ("5 %", "95 %"),
    most: int = 12,
) -> Figure:
    """Horizontal bars from the nominal output to the outputs with one factor low and high.

    Args:
        names: of the factors.
        at_low, at_high: the output with one factor there, (factors,); NaN where a run gave none.
        nominal: the output with all factors nominal.
        label: of the output, with its unit.
        quantiles: what low and high are, in words.
        most: bars, the largest swings first.

    Raises:
        ViewError: matplotlib is not installed.
    """
    at_low, at_high = np.asarray(at_low, float), np.asarray(at_high, float)
    ends = np.array([at_low, at_high, np.full(len(names), nominal)])
    swing = np.nan_to_num(np.ptp(ends, axis=0), nan=-1.0)
    order = np.argsort(-swing, kind="stable")[:most]
    with paper.lettering():
        height, under, over = 0.24 * len(order) + 0.1, 0.8, 0.14
        left = 0.25 + LETTER * max((len(names[k]) for k in order), default=0)
        picture = paper.figure(paper.WIDTH, height + under + over)
        axes = paper.place(picture, left, under, paper.WIDTH - left - 0.2, height)
        axes.grid(axis="x", color=paper.FAINT, linewidth=0.5)
        for row, k in enumerate(order):
            _bar(axes, row, (at_low[k], at_high[k]), nominal)
        axes.axvline(nominal, color=paper.INK, linewidth=0.9, zorder=4)
        axes.set_ylim(len(order) - 0.45, -0.55)
        axes.set_yticks(range(len(order)), [names[k] for k in order])
        axes.tick_params(axis="y", length=0)
        for side in ("top", "right", "left"):
            axes.spines[side].set_visible(False)
        axes.set_xlabel(label)
        _limits(axes, ends[:, order])
        _legend(picture, quantiles, nominal)
        return picture


def _bar(axes: Axes, row: int, values: tuple[float, float], nominal: float) -> None:
    """Two bars of one factor; where both go the same way the shorter lies on the longer."""
    low, high = values
    shift = np.array([low - nominal, high - nominal])
    same = bool(shift[0] * shift[1] > 0)
    longer = int(np.argmax(np.abs(np.nan_to_num(shift))))
    for which, colour in ((longer, (LOW, HIGH)[longer]), (1 - longer, (LOW, HIGH)[1 - longer])):
        if not np.isfinite(values[which]):
            continue
        thin = same and which != longer
        axes.barh(row, shift[which], 0.34 if thin else 0.68, left=nominal, color=colour, zorder=3)
    right = bool(shift[longer] >= 0)
    other, name = values[1 - longer], ("low", "high")[1 - longer]
    if np.isfinite(values[longer]):
        beside = f" ({other:.4g} at {name})" if same else ""
        _write(axes, row, f"{values[longer]:.4g}{beside}", values[longer], right)
    if not np.isfinite(other):
        _write(axes, row, f"no value at {name}", nominal, not right, paper.ACCENT)
    elif not same and other != nominal:
        _write(axes, row, f"{other:.4g}", other, not right)


def _write(
    axes: Axes, row: int, text: str, at: float, right: bool, colour: str = paper.INK
) -> None:
    axes.annotate(
        text.replace("-", "\N{MINUS SIGN}"),
        (at, row),
        xytext=(3 if right else -3, 0),
        textcoords="offset points",
        ha="left" if right else "right",
        va="center_baseline",
        fontsize=7.5,
        color=colour,
    )


def _limits(axes: Axes, ends: Array) -> None:
    """Room for the numbers at both ends, and for two where both bars go the same way."""
    known = ends[np.isfinite(ends)]
    low, high = (float(known.min()), float(known.max())) if known.size else (0.0, 0.0)
    size = (high - low) or abs(high) or 1.0
    left, right = low - 0.13 * size, high + 0.13 * size
    shift = ends[:2] - ends[2]
    with np.errstate(invalid="ignore"):
        same = shift[0] * shift[1] > 0
    for first, second in ends[:2, same].T.tolist():
        if first + second > 2 * ends[2, 0]:
            right = max(right, max(first, second) + 0.34 * size)
        else:
            left = min(left, min(first, second) - 0.34 * size)
    axes.set_xlim(left, right)


def _legend(picture: Figure, quantiles: tuple[str, str], nominal: float) -> None:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    value = f"{nominal:.4g}" if np.isfinite(nominal) else "no value"
    entries: list[Any] = [
        Patch(color=LOW, linewidth=0, label=f"factor at its {quantiles[0]} quantile"),
        Patch(color=HIGH, linewidth=0, label=f"at its {quantiles[1]} quantile"),
        Line2D([], [], color=paper.INK, linewidth=0.9, label=f"all nominal: {value}"),
    ]
    picture.legend(handles=entries, loc="lower center", ncols=3, bbox_to_anchor=(0.5, 0.0))
