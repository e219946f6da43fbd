"""Pictures of robots and of numbers about them, made with matplotlib without a window.

matplotlib is loaded at the first picture, not on import.
"""

from gough.view.curves import draw_curves
from gough.view.factors import Marks, Ratio, draw_ratios
from gough.view.maps import Layer, draw_maps
from gough.view.mechanism import draw_mechanism
from gough.view.modes import Panel, draw_modes
from gough.view.paper import ViewError, png, svg
from gough.view.skeleton import Mark, Shape, Skeleton, skeleton
from gough.view.spectra import Spectrum, draw_spectra
from gough.view.stacks import Stack, draw_stacks

__all__ = [
    "Layer",
    "Mark",
    "Marks",
    "Panel",
    "Ratio",
    "Shape",
    "Skeleton",
    "Spectrum",
    "Stack",
    "ViewError",
    "draw_curves",
    "draw_maps",
    "draw_mechanism",
    "draw_modes",
    "draw_ratios",
    "draw_spectra",
    "draw_stacks",
    "png",
    "skeleton",
    "svg",
]
