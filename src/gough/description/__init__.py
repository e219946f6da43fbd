"""Description of mechanisms: bodies, joints, constraints, parameters, roles."""

from gough.description.mechanism import Mechanism
from gough.description.parts import (
    Body,
    Constraint,
    Coupling,
    Frame,
    Joint,
    Leg,
    Motor,
    Parameter,
)

__all__ = [
    "Body",
    "Constraint",
    "Coupling",
    "Frame",
    "Joint",
    "Leg",
    "Mechanism",
    "Motor",
    "Parameter",
]
