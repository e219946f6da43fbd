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
from gough.uncertainty import Distribution, DistributionError

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
        self._require_apart()

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
        try:
            return Factor(name, target, Distribution.read(value, target.nominal))
        except (DistributionError, UnknownName) as error:
            raise DistributionError(f"factor {name}: {error}") from None

    def _require_apart(self) -> None:
        """Refuse factors that set the same number."""
        found: dict[tuple[str, int], str] = {}
        for factor in self.each:
            place = factor.target.kind, factor.target.place
            if place in found:
                raise ConfigurationError(
                    f"factors {found[place]} and {factor.name} are the same number; keep one"
                )
            found[place] = factor.name

    def _target(self, name: str) -> Target:
        if name.startswith(POSITION):
            return self._position(name)
        if name.startswith(RATE):
            structure = self.dynamics.structure
            columns = structure.columns("operational")
            known = [structure.variables[k].name for k in columns]
            place = _shortly("rate of an output", name.removeprefix(RATE), known)
            return Target("rate", name, place, float(self._v0[place]))
        if name.startswith(INPUT):
            law = law_of(name, self._laws)
            place = list(self._inputs).index(law)
            return Target("input", law, place, self._inputs[law])
        place = _found("number of a live parameter", name, list(self._parameters))
        return Target("parameter", name, place, float(self.dynamics.assembler.p[place]))

    def _position(self, name: str) -> Target:
        """An output, or an entry of a rotation vector that turns a pose."""
        short, names = name.removeprefix(POSITION), self._outputs.names
        quaternion = any(_last(each) == "qw" for each in names)
        if quaternion and short in TURNS:
            return Target("turn", name, TURNS.index(short), 0.0)
        plain = [each for each in names if not (quaternion and _last(each).startswith("q"))]
        place = _shortly("output", short, plain, TURNS if quaternion else ())
        return Target(
            "position", name, names.index(plain[place]), float(self._x0[names.index(plain[place])])
        )

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


def _last(name: str) -> str:
    return name.rpartition(".")[2]


def _shortly(kind: str, name: str, known: Sequence[str], more: Sequence[str] = ()) -> int:
    """Place of a name, or of the one that ends so."""
    if name in known:
        return known.index(name)
    short = [_last(each) for each in known]
    if short.count(name) > 1:
        full = [each for each in known if _last(each) == name]
        raise ConfigurationError(f"{name} is the end of several names; give {' or '.join(full)}")
    clear = [s if short.count(s) == 1 else full for s, full in zip(short, known, strict=True)]
    _found(kind, name, [*clear, *more])
    return short.index(name)


def law_of(factor: str, laws: Sequence[Placed]) -> str:
    """Full name of the law that a factor of the inputs tells."""
    return next(iter(read_inputs({factor.removeprefix(INPUT): 0.0}, laws).constant))


def told_as_numbers(
    inputs: Mapping[str, Any] | None, vary: Mapping[str, Any], laws: Sequence[Placed]
) -> dict[str, Any]:
    """Inputs, and 0 for those that vary and are not told anything.

    Raises:
        UnknownName: there is no such joint or law that takes a command.
        ConfigurationError: an input that varies is a table.
    """
    given = read_inputs(inputs, laws)
    found = dict(inputs or {})
    for name in vary:
        if not name.startswith(INPUT):
            continue
        law = law_of(name, laws)
        if law in given.tabled:
            raise ConfigurationError(
                f"factor {name} is a number, but inputs tell {law} a table; give a number there"
            )
        if law not in given.constant:
            found[law] = 0.0
    return found


def every_parameter(
    mechanism: Mechanism, share: str, live: Mapping[str, Any] | None = None
) -> dict[str, str]:
    """A distribution for every number other than zero among the parameters.

    Args:
        mechanism: the description.
        share: the distribution of each about its nominal value, such as ±10 %.
        live: values that replace those described.

    Raises:
        ConfigurationError: there are no such numbers.
    """
    try:
        given = {name: _tupled(value) for name, value in (live or {}).items()}
        values = evaluate_parameters(mechanism.parameters, given)
    except ExpressionError as error:
        raise ConfigurationError(str(error)) from None
    found = {}
    for name, part in mechanism.parameters.items():
        written = part.value
        if not _is_given(written) and name not in given:
            continue
        numbers = np.ravel(np.array(values[name], dtype=float)).tolist()
        for entry, number in zip(_entries(name, values[name]), numbers, strict=True):
            if number != 0.0:
                found[entry] = share
    if not found:
        raise ConfigurationError(
            f"{mechanism.name} has no parameters to vary by {share!r}; name what varies"
        )
    return found


def _tupled(value: Any) -> Any:
    return tuple(_tupled(item) for item in value) if np.ndim(value) else float(value)


def _is_given(value: Any) -> bool:
    """Whether a parameter is a number, or an expression of numbers alone."""
    if isinstance(value, tuple):
        return all(_is_given(item) for item in value)
    names = getattr(value, "names", ())
    return not set(names) - {"pi"}
