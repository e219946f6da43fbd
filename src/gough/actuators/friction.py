"""Viscous and dry friction without memory."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import ClassVar

from gough import algebra as al
from gough.actuators import curves
from gough.actuators.base import Effort, Law, Number, Numbers, Situation


class Friction(Law):
    """Viscous friction, and dry friction that turns its sign smoothly over ``velocity``.

        F = -viscous v - g(v) tanh(v / velocity)
        g(v) = coulomb + (static - coulomb) exp(-(v / stribeck)²)

    It creeps rather than sticks: under a steady load F below the dry friction it moves at about
    velocity · artanh(F / coulomb). The law ``lugre`` sticks. A smaller ``velocity`` creeps less and
    makes integration stiffer.
    """

    name = "friction"
    numbers: ClassVar[Mapping[str, Number]] = {
        "viscous": Number(
            "damping", "force for each unit of rate", default=0.0, sign="nonnegative"
        ),
        "coulomb": Number("force", "dry friction in motion", default=0.0, sign="nonnegative"),
        "static": Number("force", "dry friction near rest", sign="nonnegative"),
        "stribeck": Number("rate", "over which static falls to coulomb", sign="positive"),
        "velocity": Number("rate", "over which dry friction turns its sign", sign="positive"),
    }
    needs_position = False

    def problems(self, numbers: Numbers) -> Iterator[tuple[str, str]]:
        coulomb, static, rate, velocity = (
            self.number(numbers, name) for name in ("coulomb", "static", "stribeck", "velocity")
        )
        yield from curves.stribeck_problems(coulomb, static, rate)
        if velocity is None and numbers.keys() & {"coulomb", "static"}:
            yield (
                "velocity",
                "dry friction needs velocity, the rate over which it turns its sign, well below "
                "the rates of interest; the law lugre does without",
            )

    def effort(self, situation: Situation, numbers: Numbers) -> Effort:
        v, resistance = situation.rate, al.mul(self.number(numbers, "viscous"), situation.rate)
        velocity = self.number(numbers, "velocity")
        if velocity is not None:
            coulomb, static, rate = (
                self.number(numbers, name) for name in ("coulomb", "static", "stribeck")
            )
            dry = curves.stribeck(v, coulomb, static, rate)
            resistance = al.add(resistance, al.mul(dry, al.tanh(v / velocity)))
        return Effort(force=al.sub(0.0, resistance), dissipated=al.mul(resistance, v))
