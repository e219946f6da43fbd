"""Exact models and analysis of robots with closed kinematic loops.

The names below are the public face; each is imported from its room at first use, so that
``import gough`` costs nothing.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from gough.analysis.analysis import Analysis
    from gough.description import (
        Actuator,
        Body,
        Constraint,
        Coupling,
        Frame,
        Joint,
        Leg,
        Mechanism,
        Motor,
        Parameter,
    )
    from gough.errors import (
        ClosureError,
        ConfigurationError,
        DescriptionError,
        GoughError,
        MissingExtra,
        OutOfReach,
        SingularError,
        UnknownName,
    )
    from gough.robot import Home, Robot, load
    from gough.simulation.events import When

__version__ = "0.1.0"

_ROOMS = {
    "gough.analysis.analysis": ("Analysis",),
    "gough.description": (
        "Actuator",
        "Body",
        "Constraint",
        "Coupling",
        "Frame",
        "Joint",
        "Leg",
        "Mechanism",
        "Motor",
        "Parameter",
    ),
    "gough.errors": (
        "ClosureError",
        "ConfigurationError",
        "DescriptionError",
        "GoughError",
        "MissingExtra",
        "OutOfReach",
        "SingularError",
        "UnknownName",
    ),
    "gough.robot": ("Home", "Robot", "load"),
    "gough.simulation.events": ("When",),
}
_HOME = {name: room for room, names in _ROOMS.items() for name in names}

__all__ = [
    "Actuator",
    "Analysis",
    "Body",
    "ClosureError",
    "ConfigurationError",
    "Constraint",
    "Coupling",
    "DescriptionError",
    "Frame",
    "GoughError",
    "Home",
    "Joint",
    "Leg",
    "Mechanism",
    "MissingExtra",
    "Motor",
    "OutOfReach",
    "Parameter",
    "Robot",
    "SingularError",
    "UnknownName",
    "When",
    "load",
]


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'gough' has no attribute {name!r}")
    return getattr(import_module(_HOME[name]), name)


def __dir__() -> list[str]:
    return sorted([*__all__, "__version__"])
