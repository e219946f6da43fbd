"""LuGre friction: dry friction that sticks."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import ClassVar

from gough import algebra as al
from gough.actuators import curves
from gough.actuators.base import Effort, Law, Number, Numbers, Situation, safe
from gough.algebra import Scalar

TOLERANCE = 1e-9
"""Relative; conditions met with equality pass."""


class LuGre(Law):
    """Friction of bristles with the deflection z (Canudas de Wit, Olsson, Åström, Lischinsky 1995).

        dz/dt = v - σ₀ |v| z / g(v),   g(v) = coulomb + (static - coulomb) exp(-(v / stribeck)²)
        F = -(σ₀ z + σ₁(v) dz/dt + σ₂ v),   σ₁(v) = damping exp(-(v / damping_velocity)²)

    with σ₀ ``stiffness`` and σ₂ ``viscous``; without ``damping_velocity`` σ₁ is ``damping``.
    In steady motion F = -(g(v) sign v + σ₂ v); under a load below ``static`` it comes to rest.

    It stores ½ σ₀ z² and loses, with y = σ₀ z / g(v) and s the sign of v,

        |v| (g y² + |v| (σ₁ (1 - s y) + σ₂)),   |y| ≤ r = static / coulomb,

    which can be negative where y > 1, as after a fast stop. Constant damping is passive if and only
    if σ₂ ≥ σ₁ (r - 1) (Barabanov and Ortega 2000). Damping that fades is passive also if
    σ₁ damping_velocity ≤ √(2e) coulomb m, where m is 4 if r > 2 and r² / (r - 1) otherwise: the
    largest |v| σ₁(v) against the smallest g y² / (y - 1). One of the two is asked for.
    """

    name = "lugre"
    numbers: ClassVar[Mapping[str, Number]] = {
        "stiffness": Number("stiffness", "of the bristles, σ₀", required=True, sign="positive"),
        "damping": Number("damping", "of the bristles, σ₁", default=0.0, sign="nonnegative"),
        "viscous": Number("damping", "σ₂", default=0.0, sign="nonnegative"),
        "coulomb": Number("force", "friction in motion", required=True, sign="positive"),
        "static": Number("force", "friction near rest", sign="positive"),
        "stribeck": Number("rate", "over which static falls to coulomb", sign="positive"),
        "damping_velocity": Number("rate", "over which σ₁ fades", sign="positive"),
        "start": Number("position", "deflection z at the start", default=0.0),
    }
    memory = ("deflection",)
    memory_units = ("position",)
    needs_position = False

    def start(self, numbers: Numbers, w: Scalar) -> tuple[Scalar, ...]:
        return (self.number(numbers, "start"),)

    def problems(self, numbers: Numbers) -> Iterator[tuple[str, str]]:
        stiffness, coulomb, static, rate, start = (
            self.number(numbers, name)
            for name in ("stiffness", "coulomb", "static", "stribeck", "start")
        )
        found = list(curves.stribeck_problems(coulomb, static, rate))
        yield from found
        largest = max(coulomb, static or 0.0) / stiffness
        if abs(start) > largest * (1 + TOLERANCE):
            yield (
                "start",
                f"start is {start:g}; the bristles give way at static over stiffness, {largest:g}",
            )
        if static is not None and not found:
            yield from self._active(numbers, static / coulomb)

    def _active(self, numbers: Numbers, r: float) -> Iterator[tuple[str, str]]:
        """A problem if the law could give energy."""
        damping, viscous, coulomb, fading = (
            self.number(numbers, name)
            for name in ("damping", "viscous", "coulomb", "damping_velocity")
        )
        needed = damping * (r - 1)
        if damping == 0 or viscous >= needed * (1 - TOLERANCE):
            return
        least = 4.0 if r > 2 else r * r / (r - 1)
        slow = math.sqrt(2 * math.e) * coulomb * least / damping
        if fading is None or fading > slow * (1 + TOLERANCE):
            yield (
                "damping",
                f"this friction can give energy: with damping {damping:g} and static friction "
                f"{r:g} times coulomb, viscous is {viscous:g} and must be at least "
                f"{safe(needed, 'up')}; or let the damping fade, damping_velocity: "
                f"{safe(slow, 'down')} or less",
            )

    def effort(self, situation: Situation, numbers: Numbers) -> Effort:
        v, (z,) = situation.rate, situation.memory
        stiffness, viscous, coulomb, static, rate = (
            self.number(numbers, name)
            for name in ("stiffness", "viscous", "coulomb", "static", "stribeck")
        )
        give = stiffness * al.absolute(v) / curves.stribeck(v, coulomb, static, rate)
        z_rate = v - give * z
        damping = self._damping(v, numbers)
        return Effort(
            force=-(stiffness * z + damping * z_rate + viscous * v),
            memory_rates=(z_rate,),
            stored=0.5 * stiffness * z * z,
            dissipated=stiffness * give * z * z + (damping * z_rate + viscous * v) * v,
        )

    def _damping(self, v: Scalar, numbers: Numbers) -> Scalar:
        damping, fading = (self.number(numbers, name) for name in ("damping", "damping_velocity"))
        if fading is None:
            return damping
        x = v / fading
        return damping * al.exp(-(x * x))
