"""What all pictures share: colours, lettering, sizes, and the bytes they are saved as."""

from __future__ import annotations

import io
from typing import TYPE_CHECKING, Any

from gough.errors import GoughError

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

WIDTH = 6.7
"""Width of a picture, inches: what the page of a report has between its margins."""

INK = "#26303a"
SOFT = "#6b7680"
FAINT = "#dde2e6"
GROUND = "#8c8579"
LINK = "#4a5a69"
PLATFORM = "#2f6f9f"
ACCENT = "#d1491b"
"""Of the motors, and of what asks for attention."""
MAP = "viridis"

LETTERING: dict[str, Any] = {
    "font.family": "DejaVu Sans",  # comes with matplotlib, so it is the same everywhere
    "font.size": 8.5,
    "axes.titlesize": 9,
    "axes.labelsize": 8.5,
    "axes.edgecolor": SOFT,
    "axes.linewidth": 0.6,
    "axes.labelcolor": INK,
    "axes.titlecolor": INK,
    "axes.axisbelow": True,
    "text.color": INK,
    "xtick.color": SOFT,
    "ytick.color": SOFT,
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
    "xtick.labelsize": 8,
    "ytick.labelsize": 8,
    "legend.fontsize": 8,
    "legend.frameon": False,
    "hatch.linewidth": 0.5,
    "svg.hashsalt": "gough",  # the same picture gives the same bytes
    "svg.fonttype": "path",
}


class ViewError(GoughError, ImportError):
    """Pictures can not be made here."""


def figure(width: float, height: float) -> Figure:
    """An empty picture of a size in inches, without a window.

    Raises:
        ViewError: matplotlib is not installed.
    """
    try:
        from matplotlib.figure import Figure
    except ImportError as error:
        raise ViewError(f"pictures need matplotlib ({error}): pip install matplotlib") from None
    return Figure(figsize=(width, height), facecolor="white")


def lettering() -> Any:
    """A context in which pictures get the lettering of this room.

    Raises:
        ViewError: matplotlib is not installed.
    """
    try:
        import matplotlib
    except ImportError as error:
        raise ViewError(f"pictures need matplotlib ({error}): pip install matplotlib") from None
    settings: Any = LETTERING
    return matplotlib.rc_context(settings)


def place(
    picture: Figure, left: float, bottom: float, width: float, height: float, **more: Any
) -> Axes:
    """Axes at a place of the picture, all in inches from its lower left corner."""
    across, up = picture.get_size_inches()
    return picture.add_axes((left / across, bottom / up, width / across, height / up), **more)


def svg(picture: Figure) -> bytes:
    """The picture as SVG: letters as outlines, no date, so equal pictures are equal bytes."""
    return _saved(picture, "svg", {"Date": None, "Creator": None})


def png(picture: Figure, dpi: int = 160) -> bytes:
    """The picture as PNG, at some dots per inch."""
    return _saved(picture, "png", {"Software": None}, dpi=dpi)


def _saved(picture: Figure, kind: str, metadata: dict[str, None], **more: Any) -> bytes:
    buffer = io.BytesIO()
    with lettering():
        picture.savefig(buffer, format=kind, metadata=metadata, **more)
    return buffer.getvalue()
