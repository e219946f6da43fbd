"""A reel that turns as a slide extends."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

from gough.actuators.base import Effort, Law, Number, Numbers, Situation
from gough.algebra import Scalar


class Reel(Law):
    """Inertia alone: a reel of ``inertia`` I and ``radius`` r is felt as the mass I/r²."""

    name = "reel"
    numbers: ClassVar[Mapping[str, Number]] = {
        "inertia": Number("inertia", "about its axis", required=True, sign="nonnegative"),
        "radius": Number("length", "on which the slide winds", required=True, sign="positive"),
    }
    needs_position = False
    freedoms = ("m",)

    def inertia(self, numbers: Numbers) -> Scalar:
        return numbers["inertia"] / (numbers["radius"] * numbers["radius"])

    def effort(self, situation: Situation, numbers: Numbers) -> Effort:
        return Effort(force=0.0)
