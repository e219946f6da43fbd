"""A motor behind a gear."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import ClassVar

from gough import algebra as al
from gough.actuators.base import Effort, Event, Law, Number, Numbers, Situation
from gough.algebra import Scalar


class Motor(Law):
    """A rotor that turns ``ratio`` times as fast as the freedom, ω = ratio v.

        F = ratio (τ - damping ω),   τ = clip(command, -T(-ω), T(ω))
        T(ω) = torque · clip(1 - ω/speed, 0, 1)

    The command is the torque on the rotor. With ``speed``, that without load, the torque in the
    direction of motion falls with the rate; against it all of ``torque`` is there. The freedom
    feels the inertia ratio² · inertia. The gear has no losses of its own.
    """

    name = "motor"
    numbers: ClassVar[Mapping[str, Number]] = {
        "ratio": Number("ratio", "turns of the rotor for one of the freedom", default=1.0),
        "inertia": Number("inertia", "of the rotor", default=0.0, sign="nonnegative"),
        "torque": Number("torque", "largest of the rotor, either way", sign="positive"),
        "speed": Number("turning rate", "of the rotor without load", sign="positive"),
        "damping": Number("turning damping", "of the rotor", default=0.0, sign="nonnegative"),
    }
    needs_position = False
    command = "torque"

    def command_for(self, effort: Scalar, numbers: Numbers) -> Scalar:
        return effort / self.number(numbers, "ratio")

    def inertia(self, numbers: Numbers) -> Scalar:
        ratio = self.number(numbers, "ratio")
        return ratio * ratio * self.number(numbers, "inertia")

    def problems(self, numbers: Numbers) -> Iterator[tuple[str, str]]:
        if self.number(numbers, "ratio") == 0:
            yield "ratio", "the ratio is zero: the motor would not move the joint"
        if "speed" in numbers and "torque" not in numbers:
            yield "torque", "speed needs torque too, which falls to nothing at that speed"

    def effort(self, situation: Situation, numbers: Numbers) -> Effort:
        ratio, torque, damping = (
            self.number(numbers, name) for name in ("ratio", "torque", "damping")
        )
        turning, given = al.mul(ratio, situation.rate), situation.command
        events: tuple[Event, ...] = ()
        if torque is not None:
            lowest, highest = -self._available(-turning, numbers), self._available(turning, numbers)
            slack = al.minimum(highest - given, given - lowest)
            events = (Event("saturation", slack, "mark"),)
            given = al.minimum(al.maximum(given, lowest), highest)
        drag = al.mul(damping, turning)
        return Effort(
            force=al.mul(ratio, al.sub(given, drag)),
            dissipated=al.mul(drag, turning),
            delivered=al.mul(given, turning),
            events=events,
        )

    def _available(self, turning: Scalar, numbers: Numbers) -> Scalar:
        """Largest torque in a direction, for the rate in that direction."""
        torque, speed = (self.number(numbers, name) for name in ("torque", "speed"))
        if speed is None:
            return torque
        left = 1.0 - al.maximum(turning, 0.0) / speed
        return torque * al.maximum(left, 0.0)
