"""What every law of an actuator states: its numbers, its memory, its force and its energy.

A law acts on one freedom of a joint. It sees the position w of the freedom (rad or m, less the
actuator's reference) and its rate v, and gives the force on the freedom (N m or N), positive where
it pushes the position up.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Literal

from gough.actuators import curves
from gough.algebra import Scalar

Unit = Literal["m", "rad"]
"""Unit of a freedom's position."""
Numbers = Mapping[str, Any]
"""Values of a law's numbers by name: scalars, or nested tuples of them where a list is allowed."""

UNITS: dict[str, tuple[str, str]] = {
    "1": ("", ""),
    "force": ("N", "N m"),
    "position": ("m", "rad"),
    "rate": ("m/s", "rad/s"),
    "stiffness": ("N/m", "N m/rad"),
    "damping": ("N s/m", "N m s/rad"),
    "per position": ("1/m", "1/rad"),
    "ratio": ("1/m", ""),
    "length": ("m", "m"),
    "inertia": ("kg m²", "kg m²"),
    "torque": ("N m", "N m"),
    "turning rate": ("rad/s", "rad/s"),
    "turning damping": ("N m s/rad", "N m s/rad"),
}
"""Units by kind: for a freedom in m, for one in rad."""


def unit_of(kind: str, freedom: Unit) -> str:
    """The unit of a kind of number for a freedom in m or in rad."""
    return UNITS[kind][0 if freedom == "m" else 1]


def told(value: float, kind: str, freedom: Unit) -> str:
    """The value with its unit."""
    return f"{value:g} {unit_of(kind, freedom)}".rstrip()


def safe(value: float, direction: Literal["up", "down"]) -> str:
    """A value with four digits to write in a message, rounded so that it is still enough."""
    if not 1e-300 < value < 1e300:
        return f"{value:g}"
    unit = 10.0 ** (math.floor(math.log10(value)) - 3)
    digits = value / unit
    whole = math.ceil(digits - 1e-7) if direction == "up" else math.floor(digits + 1e-7)
    return f"{whole * unit:.4g}"


@dataclass(frozen=True)
class Number:
    """A number that a law takes from the description."""

    unit: str
    """Kind of the unit, one of ``UNITS``; a curve's is that of its values."""
    about: str
    required: bool = False
    default: float | None = None
    """What stands for it where it is not written; None: the law does without."""
    sign: Literal["any", "nonnegative", "positive"] = "any"
    shape: Literal["number", "pair", "curve"] = "number"
    """One number, two numbers, or a force over the position (see `curves`)."""

    def problem(self, name: str, value: Any, freedom: Unit) -> str | None:
        """What is wrong with a value made of floats, or None."""
        if self.shape == "curve":
            return curves.problem(name, value)
        if self.shape == "pair":
            return None if _numbers_in(value) == 2 else f"{name} is a list of two numbers"
        if isinstance(value, tuple):
            return f"{name} is one number, and not a list of {len(value)}"
        if value < 0 and self.sign == "nonnegative":
            return f"{name} is {told(value, self.unit, freedom)}; it can not be negative"
        if value <= 0 and self.sign == "positive":
            return f"{name} is {told(value, self.unit, freedom)}; it must be positive"
        return None


def _numbers_in(value: Any) -> int:
    """How many numbers a flat list holds; -1 for anything else."""
    flat = isinstance(value, tuple) and not any(isinstance(x, tuple) for x in value)
    return len(value) if flat else -1


@dataclass(frozen=True)
class Situation:
    """What a law sees at one moment."""

    position: Scalar
    """w: position of the freedom less the actuator's reference, m or rad."""
    rate: Scalar
    """v, m/s or rad/s."""
    memory: tuple[Scalar, ...] = ()
    """The law's own state, in the order of ``Law.memory``."""
    command: Scalar = 0.0
    """What a commanded law is told to give, in the unit of ``Law.command``."""
    branches: tuple[Scalar, ...] | None = None
    """For each switch 1.0 where its quantity is taken as positive and 0.0 where as negative, so
    that the law is smooth beyond the switch too. None: the law decides, and is continuous."""


@dataclass(frozen=True)
class Event:
    """A moment that an integration may want to meet: where a value changes its sign."""

    name: str
    value: Scalar
    kind: Literal["switch", "mark"]
    """switch: the law's formula changes there; events of this kind stand in the order of
    ``Law.switches``. mark: something worth telling happens."""


@dataclass(frozen=True)
class Effort:
    """What a law gives at one moment. For every law

    force v = delivered - dissipated - d(stored)/dt.
    """

    force: Scalar
    """On the freedom, positive where it pushes the position up, N or N m."""
    memory_rates: tuple[Scalar, ...] = ()
    """Rates of the memory."""
    stored: Scalar = 0.0
    """Energy that can come back, J; a function of position and memory."""
    dissipated: Scalar = 0.0
    """Power that is lost, W."""
    delivered: Scalar = 0.0
    """Power that comes from outside the mechanism, W."""
    events: tuple[Event, ...] = ()


class Law(ABC):
    """A law of force on one freedom of a joint; stateless.

    Methods take the law's numbers by name; one that is not there has its default.
    """

    name: ClassVar[str]
    numbers: ClassVar[Mapping[str, Number]]
    memory: ClassVar[tuple[str, ...]] = ()
    """Names of its own states."""
    memory_units: ClassVar[tuple[str, ...]] = ()
    """Kinds of their units."""
    switches: ClassVar[tuple[str, ...]] = ()
    """Names of the events at which its formula changes."""
    needs_position: ClassVar[bool] = True
    """Whether it needs a position, which three rotations of a ball do not have."""
    command: ClassVar[str | None] = None
    """Kind of the unit of its command; None for a law that takes none."""
    freedoms: ClassVar[tuple[Unit, ...]] = ("m", "rad")
    """Units of the freedoms it can act on."""

    @property
    def commanded(self) -> bool:
        """Whether the law takes a command."""
        return self.command is not None

    def number(self, numbers: Numbers, name: str) -> Any:
        """A number of the law, or its default; None if it has neither."""
        value = numbers.get(name)
        return self.numbers[name].default if value is None else value

    def command_for(self, effort: Scalar, numbers: Numbers) -> Scalar:
        """The command that asks for a force on the freedom; inertia and losses not counted."""
        return effort

    def start(self, numbers: Numbers, w: Scalar) -> tuple[Scalar, ...]:
        """Memory at the start of a motion at position w."""
        return ()

    def inertia(self, numbers: Numbers) -> Scalar:
        """Inertia that the freedom feels, kg or kg m²."""
        return 0.0

    def problems(self, numbers: Numbers) -> Iterator[tuple[str, str]]:
        """What is wrong with numbers that are right one by one: name of the number, message."""
        return iter(())

    @abstractmethod
    def effort(self, situation: Situation, numbers: Numbers) -> Effort:
        """Force, rates of the memory and powers in a situation."""
