"""Pictures of robots and of numbers about them, made with matplotlib without a window.

matplotlib is loaded at the first picture, not on import.
"""

from gough.view.audit import draw_audit
from gough.view.compare import Compared, draw_comparison
from gough.view.curves import draw_curves
from gough.view.factors import Marks, Ratio, draw_ratios
from gough.view.histogram import Limit, draw_histogram
from gough.view.histories import History, draw_histories
from gough.view.index_bars import IndexBars, draw_index_bars
from gough.view.loops import Loop, draw_loops
from gough.view.maps import Layer, draw_maps
from gough.view.mechanism import draw_mechanism
from gough.view.modes import Panel, draw_modes
from gough.view.paper import ViewError, png, svg
from gough.view.scatter import draw_scatter
from gough.view.skeleton import Mark, Shape, Skeleton, skeleton
from gough.view.spectra import Spectrum, draw_spectra
from gough.view.stacks import Stack, draw_stacks
from gough.view.tornado import draw_tornado

__all__ = [
    "Compared",
    "History",
    "IndexBars",
    "Layer",
    "Limit",
    "Loop",
    "Mark",
    "Marks",
    "Panel",
    "Ratio",
    "Shape",
    "Skeleton",
    "Spectrum",
    "Stack",
    "ViewError",
    "draw_audit",
    "draw_comparison",
    "draw_curves",
    "draw_histogram",
    "draw_histories",
    "draw_index_bars",
    "draw_loops",
    "draw_maps",
    "draw_mechanism",
    "draw_modes",
    "draw_ratios",
    "draw_scatter",
    "draw_spectra",
    "draw_stacks",
    "draw_tornado",
    "png",
    "skeleton",
    "svg",
]
