"""The dynamics of a description, made from nothing else: for other processes and other values."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from gough.assembly import Assembler
from gough.description import Mechanism
from gough.dynamics.dynamics import Dynamics
from gough.geometry.inverse import InverseGeometry
from gough.geometry.rates import Kinematics
from gough.models import Models
from gough.topology import Modelling, Structure


def dynamics_of(
    mechanism: Mechanism, modelling: Modelling | None, live: Mapping[str, Any]
) -> Dynamics:
    """The dynamics at given live parameters, with the loops closed at home.

    Raises:
        ClosureError: the loops do not close.
    """
    models = Models(Structure(mechanism, modelling))
    assembler = Assembler(models, models.parameters(dict(live)))
    home = assembler.home().require().q
    outputs = bool(models.structure.columns("operational"))
    inverse = InverseGeometry(models, assembler, home) if outputs else None
    return Dynamics(models, assembler, home, inverse, Kinematics(models, assembler, home))
