"""What the actuators of a joint must be beyond the form of their values."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

from gough.actuators import LAWS, Law
from gough.actuators.base import Unit, unit_of
from gough.description.parts import Actuator, Joint
from gough.errors import Path, Problem, closest
from gough.joints import TYPES

Read = Callable[[Any, Path], Any]
"""The floats that a number or a list comes to, or None after a report."""


def actuator_problems(joint: Joint, path: Path, read: Read, read_one: Read) -> Iterator[Problem]:
    """Everything wrong with the actuators of a joint.

    Args:
        joint: the joint.
        path: where it is written.
        read: reads nested lists of numbers.
        read_one: reads one number.
    """
    felt = joint.motor is not None and read_one(joint.motor.inertia, (*path, "motor", "inertia"))
    for name, actuator in joint.actuators.items():
        place = (*path, "actuators", name)
        unit = _freedom(joint, actuator)
        if isinstance(unit, Problem):
            yield Problem(unit.message, (*place, *unit.path), unit.on_key)
            continue
        law = LAWS[actuator.law]
        yield from _misplaced(law, joint, actuator, unit, place)
        read_one(actuator.reference, (*place, "reference"))
        numbers, found = _numbers(law, actuator, unit, place, read)
        yield from found
        if numbers is not None and felt and law.inertia(numbers):
            yield Problem(
                f"the joint feels the inertia of its motor already, and that of this {law.name} "
                "would be added: write all of it in one place",
                place,
                on_key=True,
            )


def _freedom(joint: Joint, actuator: Actuator) -> Unit | Problem:
    """The unit of the freedom that an actuator acts on."""
    rates = TYPES[joint.type].rates
    if not rates:
        text = f"a {joint.type} joint has no freedom that an actuator could act on"
        return Problem(text, on_key=True)
    if actuator.freedom > len(rates):
        known = "one freedom" if len(rates) == 1 else f"{len(rates)} freedoms, counted from 1"
        text = f"there is no freedom {actuator.freedom}: a {joint.type} joint has {known}"
        return Problem(text, ("freedom",))
    return rates[actuator.freedom - 1]


def _misplaced(
    law: Law, joint: Joint, actuator: Actuator, unit: Unit, place: Path
) -> Iterator[Problem]:
    """A law on a freedom that it can not act on."""
    freedom, at = actuator.freedom, (*place, "law")
    if law.needs_position and TYPES[joint.type].coordinate_of(freedom - 1) is None:
        able = ", ".join(name for name in LAWS if _acts_on_rates(LAWS[name], unit))
        text = (
            f"the law {law.name} needs a position, and freedom {freedom} of a {joint.type} joint "
            f"has a rate alone; laws of rates are {able}"
        )
        yield Problem(text, at)
    if unit not in law.freedoms:
        kinds = {"m": "a slide, in m", "rad": "a turn, in rad"}
        text = (
            f"a {law.name} acts on {kinds[law.freedoms[0]]}; freedom {freedom} of a {joint.type} "
            f"joint is {kinds[unit]}"
        )
        yield Problem(text, at)


def _acts_on_rates(law: Law, unit: Unit) -> bool:
    return not law.needs_position and unit in law.freedoms


def _numbers(
    law: Law, actuator: Actuator, unit: Unit, place: Path, read: Read
) -> tuple[dict[str, Any] | None, list[Problem]]:
    """The numbers of an actuator, None if any is wrong; and what is wrong with them."""
    at, found = (*place, "numbers"), []
    for key in actuator.numbers:
        if key in law.numbers:
            continue
        known = closest(key, tuple(law.numbers))
        text = f"the law {law.name} has no number {key!r}.{known}"
        found.append(Problem(text, (*at, key), on_key=True))
    for key, number in law.numbers.items():
        if number.required and key not in actuator.numbers:
            unit_text = unit_of(number.unit, unit)
            wanted = f"{number.about}, {unit_text}" if unit_text else number.about
            text = f"the law {law.name} needs numbers: {{{key}: …}} ({wanted})"
            found.append(Problem(text, place, on_key=True))
    values: dict[str, Any] = {}
    for key, written in actuator.numbers.items():
        value = read(written, (*at, key))
        if key not in law.numbers or value is None:
            continue
        wrong = law.numbers[key].problem(key, value, unit)
        if wrong is not None:
            found.append(Problem(wrong, (*at, key)))
        else:
            values[key] = value
    complete = not found and len(values) == len(actuator.numbers)
    if complete:
        for key, message in law.problems(values):
            on_key = key not in actuator.numbers
            found.append(Problem(message, place if on_key else (*at, key), on_key))
    return (values if complete else None), found
