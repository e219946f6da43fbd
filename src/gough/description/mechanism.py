"""A mechanism: a graph of bodies and joints with roles, as immutable data."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, StringConstraints, model_validator

from gough.description.parts import (
    Body,
    Constraint,
    Coupling,
    Joint,
    Leg,
    Name,
    Parameters,
    Part,
)
from gough.description.scalars import Vector
from gough.errors import DescriptionError


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


class Mechanism(Description):
    """A mechanism with any number of closed loops, its parts checked against each other.

    Raises:
        pydantic.ValidationError: a value has the wrong form, or the parts do not fit together.
    """

    @model_validator(mode="after")
    def _check(self) -> Mechanism:
        from gough.description.check import problems_of

        problems = problems_of(self)
        if problems:
            raise DescriptionError(problems, source=self.name)
        return self

    def written_out(self) -> Mechanism:
        """The same mechanism with its legs, and parallelograms with heavy bars, written out.

        Every part then has its full name and can be changed alone.
        """
        from gough.description.flat import KINDS, flatten

        flat = flatten(self)
        parts = {kind: getattr(flat, kind) for kind in ("parameters", *KINDS)}
        return Mechanism(**{**dict(self), **parts, "legs": {}})
