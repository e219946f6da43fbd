"""End stops: springs and dampers that set in smoothly where the travel ends."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import ClassVar

from gough import algebra as al
from gough.actuators.base import Effort, Event, Law, Number, Numbers, Situation
from gough.algebra import Scalar


class EndStop(Law):
    """Stops at ``upper``, at ``lower``, or at both.

    With the penetration x = w - upper of the upper stop,

        f = K/2 (1 + erf(σ x)) x + a/2 (1 + erf(σₐ x)) dx/dt

    pushes w down; K is ``stiffness``, a ``damping``, σ ``sharpness_spring`` and σₐ
    ``sharpness_damper``. Its spring has the potential

        U = K (x²/4 (1 + erf σx) + x exp(-σ²x²) / (4 σ √π) - (1 + erf σx) / (8 σ²)).

    The lower stop is its mirror image, x = lower - w. Just before contact the spring pulls w
    towards the stop, by 0.12019 K/σ at most, at x = -0.53160/σ; with ``one_signed: 1`` it is

        K (x/2 (1 + erf σx) + exp(-σ²x²) / (2 σ √π)),

    the integral of the step, which never pulls. The damper may pull while w leaves the stop.
    """

    name = "end-stop"
    numbers: ClassVar[Mapping[str, Number]] = {
        "upper": Number("position", "where the travel ends upwards"),
        "lower": Number("position", "where the travel ends downwards"),
        "stiffness": Number("stiffness", "of a stop, K", required=True, sign="positive"),
        "damping": Number("damping", "of a stop, a", default=0.0, sign="nonnegative"),
        "sharpness_spring": Number(
            "per position", "how abruptly the spring sets in", required=True, sign="positive"
        ),
        "sharpness_damper": Number(
            "per position", "the same of the damper; without it as the spring", sign="positive"
        ),
        "one_signed": Number("1", "1 for a spring that never pulls", default=0.0),
    }

    def problems(self, numbers: Numbers) -> Iterator[tuple[str, str]]:
        upper, lower, one = (
            self.number(numbers, name) for name in ("upper", "lower", "one_signed")
        )
        if upper is None and lower is None:
            yield "upper", "an end stop needs upper, lower or both: where the travel ends"
        elif upper is not None and lower is not None and lower >= upper:
            yield "lower", f"lower is {lower:g} and upper {upper:g}; lower must be less"
        if one not in (0, 1):
            yield "one_signed", f"one_signed is {one:g}; write 1 for yes or 0 for no"

    def effort(self, situation: Situation, numbers: Numbers) -> Effort:
        w, v = situation.position, situation.rate
        upper, lower = (self.number(numbers, name) for name in ("upper", "lower"))
        stops = []
        if upper is not None:
            stops.append(("contact_upper", -1.0, w - upper, v))
        if lower is not None:
            stops.append(("contact_lower", 1.0, lower - w, -v))
        force, stored, dissipated = [], [], []
        for _, side, x, x_rate in stops:
            spring, potential = self._spring(x, numbers)
            damper = self._damping(x, numbers) * x_rate
            force.append(side * (spring + damper))
            stored.append(potential)
            dissipated.append(damper * x_rate)
        return Effort(
            force=al.total(force),
            stored=al.total(stored),
            dissipated=al.total(dissipated),
            events=tuple(Event(name, x, "mark") for name, _, x, _ in stops),
        )

    def _spring(self, x: Scalar, numbers: Numbers) -> tuple[Scalar, Scalar]:
        """Force against the penetration x, and its potential."""
        K, sigma, one = (
            self.number(numbers, name) for name in ("stiffness", "sharpness_spring", "one_signed")
        )
        step = 1.0 + al.erf(sigma * x)
        bell = al.exp(-(sigma * x) * (sigma * x)) / (2.0 * math.sqrt(math.pi) * sigma)
        force = 0.5 * x * step + one * bell
        potential = 0.25 * x * x * step + 0.5 * x * bell
        potential += (2.0 * one - 1.0) / (8.0 * sigma * sigma) * step
        return K * force, K * potential

    def _damping(self, x: Scalar, numbers: Numbers) -> Scalar:
        sharpness = self.number(numbers, "sharpness_damper")
        if sharpness is None:
            sharpness = self.number(numbers, "sharpness_spring")
        return 0.5 * self.number(numbers, "damping") * (1.0 + al.erf(sharpness * x))
