"""Laws of force on a freedom of a joint, one file each."""

from __future__ import annotations

from gough.actuators.base import Effort, Event, Law, Number, Situation
from gough.actuators.dahl import Dahl
from gough.actuators.end_stop import EndStop
from gough.actuators.force import Force
from gough.actuators.friction import Friction
from gough.actuators.lugre import LuGre
from gough.actuators.motor import Motor
from gough.actuators.reel import Reel
from gough.actuators.spring_damper import SpringDamper

LAWS: dict[str, Law] = {
    law.name: law
    for law in (
        Force(),
        Motor(),
        SpringDamper(),
        Friction(),
        LuGre(),
        Dahl(),
        EndStop(),
        Reel(),
    )
}
"""Every law by its name."""

__all__ = ["LAWS", "Effort", "Event", "Law", "Number", "Situation"]
