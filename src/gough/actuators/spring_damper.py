"""A linear spring with a linear damper."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

from gough.actuators.base import Effort, Law, Number, Numbers, Situation


class SpringDamper(Law):
    """A spring with the force ``preload`` at the position ``rest``, and a damper beside it.

        F = preload - stiffness (w - rest) - damping v

    It stores ½ stiffness (w - rest)² - preload (w - rest), which is 0 at rest, and loses
    damping v².
    """

    name = "spring-damper"
    numbers: ClassVar[Mapping[str, Number]] = {
        "stiffness": Number("stiffness", "of the spring", required=True, sign="nonnegative"),
        "damping": Number("damping", "of the damper", default=0.0, sign="nonnegative"),
        "rest": Number("position", "where the spring gives its preload", default=0.0),
        "preload": Number("force", "force of the spring at rest", default=0.0),
    }

    def effort(self, situation: Situation, numbers: Numbers) -> Effort:
        k, c = (self.number(numbers, name) for name in ("stiffness", "damping"))
        preload, v = self.number(numbers, "preload"), situation.rate
        x = situation.position - self.number(numbers, "rest")
        return Effort(
            force=preload - k * x - c * v,
            stored=0.5 * k * x * x - preload * x,
            dissipated=c * v * v,
        )
