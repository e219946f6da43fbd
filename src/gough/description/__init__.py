"""Description of mechanisms: bodies, joints, constraints, parameters, roles."""

from gough.description.mechanism import Mechanism
from gough.description.parts import (
    Actuator,
    Body,
    Constraint,
    Coupling,
    Frame,
    Joint,
    Leg,
    Motor,
    Parameter,
    Variant,
)

__all__ = [
    "Actuator",
    "Body",
    "Constraint",
    "Coupling",
    "Frame",
    "Joint",
    "Leg",
    "Mechanism",
    "Motor",
    "Parameter",
    "Variant",
]
