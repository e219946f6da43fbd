"""The ideal force: what is commanded."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

from gough import algebra as al
from gough.actuators.base import Effort, Event, Law, Number, Numbers, Situation


class Force(Law):
    """The commanded force, clipped at ``limit`` either way if there is one.

        F = clip(command, -limit, limit)

    All of its power comes from outside.
    """

    name = "force"
    numbers: ClassVar[Mapping[str, Number]] = {
        "limit": Number("force", "largest force, either way", sign="positive"),
    }
    needs_position = False
    command = "force"

    def effort(self, situation: Situation, numbers: Numbers) -> Effort:
        asked, limit = situation.command, self.number(numbers, "limit")
        if limit is None:
            return Effort(asked, delivered=al.mul(asked, situation.rate))
        force = al.minimum(al.maximum(asked, -limit), limit)
        saturation = Event("saturation", limit - al.absolute(asked), "mark")
        return Effort(force, delivered=force * situation.rate, events=(saturation,))
