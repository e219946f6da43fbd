"""Modes of a mechanism side by side: one small panel each, all from one viewpoint, to one scale."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from gough.view import paper
from gough.view.outline import outline
from gough.view.skeleton import Mark, Shape, Skeleton

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

AZIMUTH, ELEVATION = np.radians(-52.0), np.radians(22.0)
"""From where spatial mechanisms are seen, chosen by looking at the robots of the catalogue."""
MOST_COLUMNS = 4
EDGE, GAP, TITLE, FOOT = 0.02, 0.1, 0.24, 0.5
"""Room around and between panels, for a label in each, and for what stands below, inches."""
WIDEST, FLATTEST = 2.3, 0.75
TALLEST = {1: 2.6, 2: 2.3, 3: 1.8}
"""Of a panel without its label, inches, by the number of rows."""
MARGIN = 0.07
"""Around what is drawn, as a part of the longest side."""


@dataclass(frozen=True)
class Panel:
    """One mode."""

    bones: Skeleton
    label: str
    strong: bool = False
    """Whether its label stands out."""


def draw_modes(panels: Sequence[Panel]) -> Figure:
    """Panels row by row in their order; a bar gives the scale, a triad the axes of a spatial view.

    Raises:
        ViewError: matplotlib is not installed.
        ValueError: there is nothing to draw.
    """
    if not panels:
        raise ValueError("there are no modes to draw")
    planar = panels[0].bones.planar
    axes = np.eye(3) if planar else _axes_of_view(AZIMUTH, ELEVATION)
    seen = [replace(panel, bones=_seen(panel.bones, axes)) for panel in panels]
    low, size = _box([panel.bones for panel in seen])
    with paper.lettering():
        return _arranged(seen, low, size, None if planar else axes)


# seeing


def _axes_of_view(azimuth: float, elevation: float) -> Array:
    """Right, up and towards the eye, as rows in axes of the root, (3, 3)."""
    ca, sa, ce, se = np.cos(azimuth), np.sin(azimuth), np.cos(elevation), np.sin(elevation)
    return np.array([[-sa, ca, 0.0], [-se * ca, -se * sa, ce], [ce * ca, ce * sa, se]])


def _seen(bones: Skeleton, axes: Array) -> Skeleton:
    """The same points in axes of the view."""
    shapes = [replace(shape, points=shape.points @ axes.T) for shape in bones.shapes]
    marks = [replace(m, at=axes @ m.at, rails=m.rails @ axes.T) for m in bones.marks]
    return replace(bones, shapes=tuple(shapes), marks=tuple(marks))


def _box(seen: Sequence[Skeleton]) -> tuple[Array, Array]:
    """Lowest corner and size of what holds every mode, in the plane of the picture, m, (2,)."""
    points = np.vstack([bones.points for bones in seen])[:, :2]
    low, high = points.min(axis=0), points.max(axis=0)
    margin = MARGIN * (float(np.max(high - low)) or seen[0].length)
    return low - margin, high - low + 2 * margin


# the sheet


def _arranged(panels: Sequence[Panel], low: Array, size: Array, axes: Array | None) -> Figure:
    rows = -(-len(panels) // MOST_COLUMNS)
    columns = -(-len(panels) // rows)
    width = min((paper.WIDTH - 2 * EDGE + GAP) / columns - GAP, WIDEST)
    scale = min(width / size[0], TALLEST.get(rows, TALLEST[3]) / size[1])
    height = max(scale * size[1], FLATTEST)
    shown = np.array([width, height]) / scale
    low = low - (shown - size) / 2
    picture = paper.figure(paper.WIDTH, rows * (height + TITLE + GAP) - GAP + FOOT + EDGE)
    spare = paper.WIDTH - columns * (width + GAP) + GAP
    for k, panel in enumerate(panels):
        row, column = divmod(k, columns)
        left = spare / 2 + column * (width + GAP)
        bottom = FOOT + (rows - 1 - row) * (height + TITLE + GAP)
        space = _sheet(picture, left, bottom, width, height + TITLE)
        space.set_xlim(low[0], low[0] + shown[0])
        space.set_ylim(low[1], low[1] + shown[1] + TITLE / scale)
        _draw(space, panel)
    _scale_bar(picture, scale, float(shown[0]))
    if axes is not None:
        _triad(picture, axes)
    _legend(picture, panels)
    return picture


def _sheet(picture: Figure, left: float, bottom: float, width: float, height: float) -> Axes:
    """A panel without ticks on a pale ground."""
    space = paper.place(picture, left, bottom, width, height, facecolor="#fafbfb")
    space.set_xticks([])
    space.set_yticks([])
    for side in space.spines.values():
        side.set(color=paper.FAINT, linewidth=0.6)
    return space


def _draw(space: Axes, panel: Panel) -> None:
    bones = panel.bones
    ordered = sorted(bones.shapes, key=lambda shape: float(shape.points[:, 2].mean()))
    for k, shape in enumerate(ordered):
        _draw_shape(space, shape, 2 + k / len(ordered), 1e-3 * bones.length)
    for mark in bones.marks:
        _draw_mark(space, mark)
    space.annotate(
        panel.label,
        (0, 1),
        xycoords="axes fraction",
        xytext=(5, -5),
        textcoords="offset points",
        va="top",
        fontweight="bold" if panel.strong else "normal",
        zorder=6,
    )


def _draw_shape(space: Axes, shape: Shape, order: float, tolerance: float) -> None:
    points = shape.points[:, :2]
    corners = outline(points, tolerance)
    style: dict[str, Any] = {"edgecolor": paper.LINK, "facecolor": "#4a5a6922", "linewidth": 1.3}
    match shape.kind:
        case "base":
            space.plot(*points.T, zorder=1, **_pad())
            style |= {"edgecolor": paper.GROUND, "facecolor": "#f3f1ee", "linewidth": 0.8}
            style |= {"linestyle": (0, (4, 2))}
            order = 0.9
        case "platform":
            style |= {"edgecolor": paper.PLATFORM, "facecolor": "#2f6f9f4d", "linewidth": 1.6}
    if len(corners) == 2:
        line = {key: style[key] for key in ("linewidth", "linestyle") if key in style}
        space.plot(*corners.T, color=style["edgecolor"], zorder=order, **line)
    elif len(corners) > 2:
        space.fill(*corners.T, joinstyle="round", capstyle="round", zorder=order, **style)


def _draw_mark(space: Axes, mark: Mark) -> None:
    colour = paper.ACCENT if mark.actuated else paper.LINK
    if len(mark.rails):
        wide = 1.9 if len(mark.rails) == 2 else 1.1
        style: dict[str, Any] = {"edgecolor": colour, "linewidth": wide, "zorder": 3.2}
        space.fill(*mark.rails[:, :2].T, fill=False, **style)
    space.plot(*mark.at[:2], zorder=4, **_dot(mark.actuated))


def _pad() -> dict[str, Any]:
    return {"marker": "s", "ms": 6, "mfc": "#e4e0da", "mec": paper.GROUND, "mew": 0.5, "ls": "none"}


def _dot(actuated: bool) -> dict[str, Any]:
    colour = paper.ACCENT if actuated else paper.INK
    face = colour if actuated else "white"
    size = 3.6 if actuated else 2.8
    return {"marker": "o", "ms": size, "mfc": face, "mec": colour, "mew": 0.7, "ls": "none"}


def _scale_bar(picture: Figure, scale: float, width: float) -> None:
    """A bar of a round length, at the left of the foot."""
    length = _round_length(min(0.6 * width, 1.1 / scale))
    space = paper.place(picture, 0.1, 0.08, scale * length, 0.3)
    space.set_axis_off()
    space.set_xlim(0, 1)
    space.set_ylim(0, 1)
    space.plot([0, 0, 0, 1, 1, 1], [0.3, 0, 0.15, 0.15, 0.3, 0], color=paper.INK, linewidth=0.9)
    text = f"{length:g} m" if length >= 1 else f"{1e3 * length:g} mm"
    space.text(0.5, 0.42, text, ha="center", va="bottom", fontsize=8)


def _round_length(most: float) -> float:
    """The largest of 1, 2 and 5 times a power of ten that is not above a length."""
    power = 10.0 ** np.floor(np.log10(most))
    return float(next(k for k in (5, 2, 1) if k * power <= most * (1 + 1e-9)) * power)


def _triad(picture: Figure, axes: Array) -> None:
    """Where x, y and z of the root point, at the right of the foot."""
    side = 0.42
    space = paper.place(picture, paper.WIDTH - side - 0.05, 0.04, side, side)
    space.set_axis_off()
    space.set_xlim(-1.15, 1.15)
    space.set_ylim(-0.75, 1.55)
    for name, (right, up) in zip("xyz", axes[:2].T, strict=True):
        tip = {"arrowstyle": "-|>", "lw": 0.8, "color": paper.INK, "shrinkA": 0, "shrinkB": 0}
        space.annotate("", (0.8 * right, 0.8 * up), (0, 0), arrowprops=tip | {"mutation_scale": 5})
        space.text(1.1 * right, 1.1 * up, name, ha="center", va="center", fontsize=7)


def _legend(picture: Figure, panels: Sequence[Panel]) -> None:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    kinds = {s.kind for panel in panels for s in panel.bones.shapes if len(s.points) > 1}
    entries: list[Any] = [Line2D([], [], label="base", **_pad())]
    if "link" in kinds:
        entries.append(Line2D([], [], color=paper.LINK, linewidth=1.3, label="link"))
    if "platform" in kinds:
        face: Any = {"facecolor": "#2f6f9f4d", "edgecolor": paper.PLATFORM}
        entries.append(Patch(label="platform", **face))
    entries.append(Line2D([], [], label="motor", **_dot(True)))
    entries.append(Line2D([], [], label="other joint", **_dot(False)))
    picture.legend(handles=entries, loc="lower center", ncols=len(entries), borderaxespad=0.6)
