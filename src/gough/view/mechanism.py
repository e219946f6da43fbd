"""A mechanism as lines and joints, in one view if it moves in a plane, else in three."""

from __future__ import annotations

from dataclasses import dataclass
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

MARKERS: dict[str, Any] = {
    "revolute": "o",
    "prismatic": "s",
    "helical": "p",
    "cylindrical": "h",
    "universal": "D",
    "spherical": "o",
    "planar": "P",
    "parallelogram": [(-1.0, -0.6), (0.4, -0.6), (1.0, 0.6), (-0.4, 0.6), (-1.0, -0.6)],
    "fixed": "+",
    "constraint": "X",
}
FILLED = ("spherical", "constraint")
"""Passive joints drawn as filled marks, to tell a ball from a pin."""
SIZES = {"universal": 5.0, "spherical": 5.5, "parallelogram": 9.0, "fixed": 6.0}
SIZE = 6.5

LEFT, BOTTOM, TOP, RIGHT = 0.62, 0.55, 0.32, 0.15
"""Room for labels around a view, inches."""
TALLEST_PLANAR, TALLEST_SPATIAL = 4.0, 5.6
FLATTEST = 0.3
"""Smallest side of a view over its longest."""
MOST_NAMES = 8
"""Joints of a planar mechanism that still get their names written."""


NAME_ROOM = 0.1
"""Room for names on either side, as a part of the longest side."""


@dataclass(frozen=True)
class View:
    """A projection along one axis of the root."""

    title: str
    across: int
    up: int


FRONT, SIDE, ABOVE = View("front", 0, 2), View("side", 1, 2), View("top", 0, 1)
AXES = "xyz"


def draw_mechanism(bones: Skeleton) -> Figure:
    """The mechanism to scale: view x-y if it is planar, else x-z, y-z and x-y; axes in m.

    Motors have the accent colour; the base is hatched, the platform filled.

    Args:
        bones: the mechanism at one configuration.

    Raises:
        ViewError: matplotlib is not installed.
    """
    with paper.lettering():
        return _one_view(bones) if bones.planar else _three_views(bones)


def _one_view(bones: Skeleton) -> Figure:
    low, size = _box(bones)
    entries = _legend_entries(bones)
    rows = -(-len(entries) // 4)
    under = BOTTOM + 0.1 + 0.2 * rows
    scale = min((paper.WIDTH - LEFT - RIGHT) / size[0], TALLEST_PLANAR / size[1])
    width, height = scale * size[0], scale * size[1]
    picture = paper.figure(paper.WIDTH, under + height + RIGHT)
    left = LEFT + (paper.WIDTH - LEFT - RIGHT - width) / 2
    axes = paper.place(picture, left, under, width, height)
    _draw(axes, bones, ABOVE, low, size)
    _names(axes, bones)
    columns = -(-len(entries) // rows)
    picture.legend(handles=entries, loc="lower center", ncols=columns, borderaxespad=0.3)
    return picture


def _three_views(bones: Skeleton) -> Figure:
    """Side to the right of the front and top below it, all at one scale; the legend in the gap."""
    low, size = _box(bones)
    entries = _legend_entries(bones)
    scale = min(
        (paper.WIDTH - 2 * LEFT - RIGHT) / (size[0] + size[1]),
        TALLEST_SPATIAL / (size[1] + size[2]),
    )
    x, y, z = scale * size
    lower = max(y, 0.2 * len(entries) + 0.2)
    picture = paper.figure(paper.WIDTH, 2 * (BOTTOM + TOP) + lower + z)
    spare = paper.WIDTH - 2 * LEFT - RIGHT - x - y
    first = LEFT + spare / 3
    second = first + x + LEFT + spare / 3
    shelf = BOTTOM + lower + TOP + BOTTOM
    for view, left, bottom, width, height in (
        (FRONT, first, shelf, x, z),
        (SIDE, second, shelf, y, z),
        (ABOVE, first, BOTTOM + lower - y, x, y),
    ):
        axes = paper.place(picture, left, bottom, width, height)
        _draw(axes, bones, view, low, size)
        axes.set_title(f"{view.title}, {AXES[view.across]}-{AXES[view.up]}")
    up = picture.get_size_inches()[1]
    anchor = ((second - 0.1) / paper.WIDTH, (BOTTOM + lower) / up)
    picture.legend(handles=entries, loc="upper left", borderaxespad=0, bbox_to_anchor=anchor)
    return picture


def _box(bones: Skeleton) -> tuple[Array, Array]:
    """Lowest corner and size of what is drawn with a margin, m, (3,) each."""
    points = bones.points
    low, high = points.min(axis=0), points.max(axis=0)
    longest = float(np.max(high - low)) or bones.length
    size = np.maximum(high - low + 0.16 * longest, FLATTEST * longest)
    if _named(bones):
        size[0] += 2 * NAME_ROOM * longest
    return (low + high - size) / 2, size


def _draw(axes: Axes, bones: Skeleton, view: View, low: Array, size: Array) -> None:
    i, k = view.across, view.up
    axes.set_xlim(low[i], low[i] + size[i])
    axes.set_ylim(low[k], low[k] + size[k])
    axes.set_aspect("equal")
    axes.set_xlabel(f"{AXES[i]} (m)")
    axes.set_ylabel(f"{AXES[k]} (m)")
    axes.locator_params(nbins=5)
    axes.grid(color=paper.FAINT, linewidth=0.5)
    for shape in bones.shapes:
        _draw_shape(axes, shape, view, 1e-3 * bones.length)
    for mark in bones.marks:
        _draw_mark(axes, mark, view)


def _draw_shape(axes: Axes, shape: Shape, view: View, tolerance: float) -> None:
    points = shape.points[:, [view.across, view.up]]
    corners = outline(points, tolerance)
    if shape.kind == "base":
        axes.plot(*points.T, "s", ms=13, zorder=1, **_pad())
    if len(corners) < 2:
        return
    style: dict[str, Any]
    match shape.kind:
        case "base":
            style = {"edgecolor": paper.GROUND, "facecolor": "#f3f1ee", "linestyle": (0, (4, 2))}
            style |= {"linewidth": 1.0, "zorder": 0.9}
        case "platform":
            style = {"edgecolor": paper.PLATFORM, "facecolor": "#2f6f9f33", "linewidth": 2.0}
            style |= {"zorder": 3}
        case _:
            style = {"edgecolor": paper.LINK, "facecolor": "#4a5a6922", "linewidth": 1.8}
            style |= {"zorder": 2}
    axes.fill(*corners.T, joinstyle="round", capstyle="round", **style)


def _pad() -> dict[str, Any]:
    return {"mfc": "#e4e0da", "mec": paper.GROUND, "mew": 0.6}


def _draw_mark(axes: Axes, mark: Mark, view: View) -> None:
    i, k = view.across, view.up
    colour = paper.ACCENT if mark.actuated else paper.LINK
    if len(mark.rails):
        rails = mark.rails[:, [i, k]]
        thick = 3.0 if len(rails) == 2 else 1.4
        axes.fill(*rails.T, fill=False, edgecolor=colour, linewidth=thick, alpha=0.75, zorder=2.5)
    axes.plot(mark.at[i], mark.at[k], **_style(mark.type, mark.actuated), zorder=5)


def _style(kind: str, actuated: bool) -> dict[str, Any]:
    colour = paper.ACCENT if actuated else paper.INK
    face = colour if actuated or kind in FILLED else "white"
    return {
        "marker": MARKERS.get(kind, "*"),
        "markersize": SIZES.get(kind, SIZE),
        "markerfacecolor": face,
        "markeredgecolor": colour,
        "markeredgewidth": 1.0,
        "linestyle": "none",
    }


def _legend_entries(bones: Skeleton) -> list[Any]:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    kinds = {shape.kind for shape in bones.shapes if len(shape.points) > 1}
    entries: list[Any] = [Line2D([], [], marker="s", ms=10, ls="none", label="base", **_pad())]
    if "link" in kinds:
        entries.append(Line2D([], [], color=paper.LINK, linewidth=1.8, label="link"))
    if "platform" in kinds:
        fill = {"facecolor": "#2f6f9f33", "edgecolor": paper.PLATFORM}
        entries.append(Patch(label="platform", **fill))  # type: ignore[arg-type]
    seen = {(mark.type, mark.actuated) for mark in bones.marks}
    for kind in MARKERS:
        for actuated in (True, False):
            if (kind, actuated) in seen:
                label = f"{kind}, actuated" if actuated else kind
                entries.append(Line2D([], [], label=label, **_style(kind, actuated)))
    return entries


def _names(axes: Axes, bones: Skeleton) -> None:
    """Names of the joints of a small planar mechanism, away from its middle.

    Those of joints on the base stand above or below, so that they stay inside the picture.
    """
    if not _named(bones):
        return
    places = _places(bones)
    middle = np.mean([mark.at for marks in places for mark in marks], axis=0)
    for marks in places:
        on_base = any(mark.on_base for mark in marks)
        at = np.mean([mark.at for mark in marks], axis=0)
        away = (at - middle)[:2]
        up = 1.0 if away[1] > 0 else -1.0
        right = 1.0 if away[0] >= 0 else -1.0
        axes.annotate(
            _joined([mark.name for mark in marks]),
            at[:2],
            xytext=(0, 10 * up) if on_base else (8 * right, 6 * up),
            textcoords="offset points",
            ha="center" if on_base else ("left" if right > 0 else "right"),
            va="center" if not on_base else ("bottom" if up > 0 else "top"),
            color=paper.SOFT,
            zorder=6,
        )


def _named(bones: Skeleton) -> bool:
    """Whether there is room for names."""
    return bones.planar and len(bones.marks) <= MOST_NAMES


def _joined(names: list[str]) -> str:
    """One or two names in a line; more of them one under the other."""
    return ", ".join(names) if len(names) <= 2 else "\n".join(names)


def _places(bones: Skeleton) -> list[list[Mark]]:
    """Joints that are too near to each other for a name each, together."""
    places: list[list[Mark]] = []
    for mark in bones.marks:
        near = (p for p in places if np.linalg.norm(p[0].at - mark.at) < 0.15 * bones.length)
        place = next(near, None)
        if place is None:
            places.append([mark])
        else:
            place.append(mark)
    return places
