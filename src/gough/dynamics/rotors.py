"""What turns with a joint beside its bodies: rotors of motors, and laws with inertia (reels)."""

from __future__ import annotations

from gough import algebra as al
from gough.actuators import LAWS
from gough.algebra import Scalar
from gough.description.parts import Joint
from gough.description.values import Values, array, scalar


def rotors_of(joint: Joint, values: Values) -> dict[int, Scalar]:
    """Inertia that the freedoms of a joint feel, by freedom counted from 0; kg or kg m².

    ratio² · inertia of its motor, and the inertia of its actuators' laws.
    """
    found: dict[int, Scalar] = {}
    if joint.motor is not None:
        ratio, inertia = (scalar(x, values) for x in (joint.motor.ratio, joint.motor.inertia))
        found[0] = al.mul(al.mul(ratio, ratio), inertia)
    for actuator in joint.actuators.values():
        numbers = {name: array(x, values) for name, x in actuator.numbers.items()}
        felt = LAWS[actuator.law].inertia(numbers)
        if not al.is_number(felt) or felt != 0:
            freedom = actuator.freedom - 1
            found[freedom] = al.add(found.get(freedom, 0.0), felt)
    return found
