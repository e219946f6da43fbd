"""What a description of a mechanism says, entry by entry."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, StringConstraints

from gough.description.parts import (
    Body,
    Constraint,
    Coupling,
    Joint,
    Leg,
    Name,
    Parameters,
    Part,
    Variant,
)
from gough.description.scalars import Vector


class Description(Part):
    """What a mechanism's description says: values of the right form, not yet judged together."""

    name: Annotated[str, StringConstraints(min_length=1, max_length=80)]
    about: str = ""
    motion: Literal["spatial", "planar"] = "spatial"
    """planar: every body moves parallel to the x-y plane of the base, and only the equations of
    that plane are written."""
    modelling: Literal["cut-joints", "cut-platform"] = "cut-joints"
    """cut-joints: the platform is a free link and the passive joints that hold it become
    equations. cut-platform: every joint stays and the platform is cut into one piece for each
    leg."""
    gravity: Vector = (0.0, 0.0, -9.81)
    """In base axes, m/s²."""
    parameters: Parameters = Field(default_factory=dict)
    base: Name = "base"
    """The body all poses refer to. It need not be listed unless it has mass and floats."""
    floating: bool = False
    """Whether the base moves freely in space, as that of a legged robot does."""
    bodies: dict[Name, Body] = Field(default_factory=dict)
    joints: dict[Name, Joint] = Field(default_factory=dict)
    constraints: dict[Name, Constraint] = Field(default_factory=dict)
    couplings: dict[Name, Coupling] = Field(default_factory=dict)
    legs: dict[Name, Leg] = Field(default_factory=dict)
    platform: Name | None = None
    """The mobile platform, if there is one."""
    operational: tuple[str, ...] = ()
    """The outputs: coordinates x, y, z, rx, ry, rz of the platform, or joints of one freedom."""
    cut: tuple[str, ...] = ()
    """Passive joints to cut; the library chooses where this does not say."""
    variants: dict[Name, Variant] = Field(default_factory=dict)
    """Other robots of the same description, by what they change of it."""
