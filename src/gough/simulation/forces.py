"""The laws of force of a mechanism's joints, where its variables are."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from gough import algebra as al
from gough.actuators import LAWS, Effort, Law, Situation
from gough.algebra import Scalar
from gough.description.values import scalar
from gough.dynamics.model import Model
from gough.dynamics.writing import Place
from gough.joints.base import Unit
from gough.symbolic.closure import Closure
from gough.symbolic.screws import combined_sparse
from gough.symbolic.trees.reduced import Reduced
from gough.topology import Structure

DRIVE = "effort"
"""Name of the force that drives an actuated joint without a drive of its own."""


@dataclass(frozen=True)
class Placed:
    """One law on one freedom of a joint."""

    name: str
    """Joint, dot, name of the actuator."""
    joint: str
    freedom: int
    """From 0 up."""
    unit: Unit
    law: Law
    numbers: Mapping[str, Any]
    """Of the law; scalars that may be symbols of live parameters."""
    reference: Scalar

    @property
    def memory(self) -> tuple[str, ...]:
        """Full names of its states."""
        return tuple(f"{self.name}.{state}" for state in self.law.memory)


def laws_of(closure: Closure) -> list[Placed]:
    """Every law of a mechanism, and a drive for each actuated joint that has none."""
    structure, values = closure.structure, closure.values
    found: list[Placed] = []
    for joint, part in structure.flat.joints.items():
        own = [
            Placed(
                f"{joint}.{name}",
                joint,
                actuator.freedom - 1,
                unit_of(structure, joint, actuator.freedom - 1),
                LAWS[actuator.law],
                {key: _value(number, values) for key, number in actuator.numbers.items()},
                scalar(actuator.reference, values),
            )
            for name, actuator in part.actuators.items()
        ]
        found += own
        if part.actuated and not any(placed.law.commanded for placed in own):
            found += _drives(structure, joint, values)
    return found


def _drives(structure: Structure, joint: str, values: Mapping[str, Any]) -> list[Placed]:
    """Ideal forces on the freedoms of an actuated joint, no larger than its motor allows."""
    motor = structure.flat.joints[joint].motor
    limit = None if motor is None or motor.effort is None else scalar(motor.effort, values)
    numbers = {} if limit is None else {"limit": limit}
    count = [v for v in structure.variables if structure.edges[v.edge].name == joint]
    return [
        Placed(
            f"{joint}.{DRIVE}" + (f"{k + 1}" if len(count) > 1 else ""),
            joint,
            k,
            unit_of(structure, joint, k),
            LAWS["force"],
            numbers,
            0.0,
        )
        for k in range(len(count))
    ]


def _value(number: Any, values: Mapping[str, Any]) -> Any:
    if isinstance(number, tuple):
        return tuple(_value(item, values) for item in number)
    found = number.evaluate(values) if hasattr(number, "evaluate") else number
    return found


def unit_of(structure: Structure, joint: str, freedom: int) -> Unit:
    """Unit of a freedom of a joint of the tree."""
    return structure.variables[variable_of(structure, joint, freedom)].unit


def variable_of(structure: Structure, joint: str, freedom: int) -> int:
    """The variable that is a freedom of a joint."""
    return next(
        k
        for k, v in enumerate(structure.variables)
        if structure.edges[v.edge].name == joint and v.freedom == freedom
    )


def has_position(model: Model, placed: Placed, place: Place) -> bool:
    """Whether a model can tell the position that a law asks for, whole turns included."""
    if not placed.law.needs_position or place == "q":
        return True
    return placed.unit == "m"


class Acting:
    """The laws in a model that is being written: what each sees and gives.

    Args:
        laws: the laws.
        model: whose variables they act on.
        place: what the model is placed by.
        reduced: the model's expressions.
        memory: a symbol for each state of the laws.
        branches: a symbol for each switch, or None to let laws decide.
        command: what a commanded law is told, by name.
    """

    def __init__(
        self,
        laws: Sequence[Placed],
        model: Model,
        place: Place,
        reduced: Reduced,
        memory: Sequence[Scalar],
        branches: Sequence[Scalar] | None,
        command: Callable[[str], Scalar],
    ) -> None:
        self.laws, self.model, self.place, self.reduced = laws, model, place, reduced
        states, switches = iter(memory), iter(branches or ())
        self.variables = [variable_of(model.structure, law.joint, law.freedom) for law in laws]
        self._rates = reduced.rates_for(self.variables)
        self.efforts: list[Effort] = []
        self.situations: list[Situation] = []
        for placed, variable in zip(laws, self.variables, strict=True):
            seen = Situation(
                al.sub(self.position(placed, variable), placed.reference),
                self.rate(variable),
                tuple(next(states) for _ in placed.law.memory),
                command(placed.name) if placed.law.commanded else 0.0,
                None if branches is None else tuple(next(switches) for _ in placed.law.switches),
            )
            self.situations.append(seen)
            self.efforts.append(placed.law.effort(seen, placed.numbers))

    def rate(self, variable: int) -> Scalar:
        """Rate of a variable."""
        return combined_sparse(self.reduced.C[variable], self._rates)

    def position(self, placed: Placed, variable: int) -> Scalar:
        """Position of the freedom that a law acts on; 0 if it needs none."""
        if not placed.law.needs_position:
            return 0.0
        if self.place == "x":
            length = self.reduced.length(variable)
            return self.reduced.position(variable) if length is None else length
        closure, edge = self.model.closure, self.model.structure.variables[variable].edge
        return closure.position(edge)[placed.freedom]

    @property
    def along(self) -> dict[int, Scalar]:
        """Forces by variable."""
        found: dict[int, Scalar] = {}
        for variable, effort in zip(self.variables, self.efforts, strict=True):
            found[variable] = al.add(found.get(variable, 0.0), effort.force)
        return found

    @property
    def memory_rates(self) -> list[Scalar]:
        """Rates of all memories."""
        return [rate for effort in self.efforts for rate in effort.memory_rates]

    def power(self, kind: str) -> Scalar:
        """Sum of ``delivered``, ``dissipated`` or ``stored`` over the laws."""
        return al.total([getattr(effort, kind) for effort in self.efforts])
