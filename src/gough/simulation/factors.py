"""What varies from run to run in an ensemble: parameters, starts and inputs."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gough.description import Mechanism, Parameter
from gough.description.expression import ExpressionError
from gough.description.values import evaluate_parameters
from gough.dynamics.dynamics import Dynamics
from gough.errors import ConfigurationError, UnknownName
from gough.geometry.coordinates import Coordinates
from gough.simulation.forces import Placed
from gough.simulation.inputs import read_inputs
from gough.uncertainty import Distribution

Array = NDArray[np.float64]

POSITION, RATE, INPUT = "x0.", "v0.", "inputs."
"""What the name of a factor begins with that is no parameter."""
ENTRY = re.compile(r"([A-Za-z_]\w*)((?:\[\d+\])*)")
TURNS = ("rx", "ry", "rz")


@dataclass(frozen=True)
class Target:
    """What a factor sets."""

    kind: str
    """parameter, position, turn, rate or input."""
    name: str
    place: int
    """Among live parameters, outputs, rates of outputs, or the inputs."""
    nominal: float


@dataclass(frozen=True)
class Factor:
    """One number that varies."""

    name: str
    target: Target
    distribution: Distribution


def with_live(mechanism: Mechanism, names: Sequence[str]) -> Mechanism:
    """The mechanism with the parameters that factors name as inputs of every model.

    Raises:
        UnknownName: there is no such parameter.
        ConfigurationError: a name has another form.
    """
    changed = {}
    for name in names:
        if name.startswith((POSITION, RATE, INPUT)):
            continue
        match = ENTRY.fullmatch(name)
        if match is None:
            raise ConfigurationError(
                f"factor {name!r} is neither a parameter, such as mass or scale[2], nor of the "
                f"start or the inputs: {POSITION}z, {RATE}rx, {INPUT}JOINT"
            )
        if match[1] not in mechanism.parameters:
            raise UnknownName("parameter", match[1], mechanism.parameters)
        changed[match[1]] = mechanism.parameters[match[1]].model_copy(update={"live": True})
    if not changed:
        return mechanism
    parameters: dict[str, Parameter] = {**mechanism.parameters, **changed}
    return mechanism.model_copy(update={"parameters": parameters})


class Factors:
    """All that varies.

    Args:
        given: a distribution for each name, as a text, a mapping or an object.
        dynamics: of the mechanism whose varied parameters are live.
        x0: operational coordinates at the start of the nominal run.
        v0: their rates.
        laws: that take commands.
        inputs: nominal ones, by name of the law.
    """

    def __init__(
        self,
        given: Mapping[str, Any],
        dynamics: Dynamics,
        x0: Array,
        v0: Array,
        laws: Sequence[Placed],
        inputs: Mapping[str, float],
    ) -> None:
        self.dynamics, self._laws, self._inputs = dynamics, laws, dict(inputs)
        self._x0, self._v0 = x0, v0
        self._outputs = Coordinates(dynamics.models, "operational")
        self.each = [self._factor(name, value) for name, value in given.items()]

    @property
    def names(self) -> list[str]:
        """Of the factors."""
        return [factor.name for factor in self.each]

    def values(self, u: Array) -> Array:
        """Values at shares u, (rows, factors)."""
        columns = [factor.distribution.of(u[:, k]) for k, factor in enumerate(self.each)]
        return np.stack(columns, axis=1) if columns else np.zeros((len(u), 0))

    def place(self, kind: str) -> list[tuple[int, int]]:
        """Column of the factors of a kind, and what they set."""
        return [(k, f.target.place) for k, f in enumerate(self.each) if f.target.kind == kind]

    def as_dict(self) -> dict[str, Any]:
        """Names and distributions."""
        return {factor.name: factor.distribution.as_dict() for factor in self.each}

    # reading

    def _factor(self, name: str, value: Any) -> Factor:
        target = self._target(name)
        return Factor(name, target, Distribution.read(value, target.nominal))

    def _target(self, name: str) -> Target:
        if name.startswith(POSITION):
            return self._position(name)
        if name.startswith(RATE):
            structure = self.dynamics.structure
            columns = structure.columns("operational")
            known = [structure.variables[k].name.rpartition(".")[2] for k in columns]
            place = _found("rate of an output", name.removeprefix(RATE), known)
            return Target("rate", name, place, float(self._v0[place]))
        if name.startswith(INPUT):
            law = next(iter(read_inputs({name.removeprefix(INPUT): 0.0}, self._laws).constant))
            place = list(self._inputs).index(law)
            return Target("input", law, place, self._inputs[law])
        place = _found("number of a live parameter", name, list(self._parameters))
        return Target("parameter", name, place, float(self.dynamics.assembler.p[place]))

    def _position(self, name: str) -> Target:
        """An output, or an entry of a rotation vector that turns a pose."""
        short, names = name.removeprefix(POSITION), self._outputs.names
        known = [each.rpartition(".")[2] for each in names]
        if "qw" in known and short in TURNS:
            return Target("turn", name, TURNS.index(short), 0.0)
        plain = [each for each in known if not each.startswith("q")]
        _found("output", short, plain + (list(TURNS) if "qw" in known else []))
        place = known.index(short)
        return Target("position", name, place, float(self._x0[place]))

    @cached_property
    def _parameters(self) -> dict[str, int]:
        """Name of each number of the live parameters: scale[2], deploying[0]."""
        found: dict[str, int] = {}
        for name, value in self.dynamics.models.closure.live.items():
            for entry in _entries(name, value):
                found[entry] = len(found)
        return found


def _entries(name: str, value: Any) -> list[str]:
    if isinstance(value, tuple):
        return [x for k, item in enumerate(value) for x in _entries(f"{name}[{k}]", item)]
    return [name]


def _found(kind: str, name: str, known: Sequence[str]) -> int:
    if name not in known:
        raise UnknownName(kind, name, known)
    return known.index(name)


def every_parameter(mechanism: Mechanism, share: str) -> dict[str, str]:
    """A distribution for every number other than zero among the parameters.

    Args:
        mechanism: the description.
        share: the distribution of each about its nominal value, such as ±10 %.
    """
    try:
        values = evaluate_parameters(mechanism.parameters)
    except ExpressionError as error:
        raise ConfigurationError(str(error)) from None
    given = {}
    for name, part in mechanism.parameters.items():
        written = part.value
        if not _is_given(written):
            continue
        numbers = np.ravel(np.array(values[name], dtype=float)).tolist()
        for entry, number in zip(_entries(name, values[name]), numbers, strict=True):
            if number != 0.0:
                given[entry] = share
    return given


def _is_given(value: Any) -> bool:
    """Whether a parameter is a number, or an expression of numbers alone."""
    if isinstance(value, tuple):
        return all(_is_given(item) for item in value)
    names = getattr(value, "names", ())
    return not set(names) - {"pi"}
