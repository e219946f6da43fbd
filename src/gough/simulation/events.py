"""Events that a person asks for: an expression of positions and rates that changes its sign."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from gough.algebra import Scalar
from gough.description.expression import Expression, ExpressionError
from gough.dynamics.dynamics import Dynamics
from gough.errors import ConfigurationError, UnknownName
from gough.simulation.equations import Asked, Scene

RATE, TIME = "d_", "t"
"""What the rate of a variable begins with in an expression; the name of time."""


@dataclass(frozen=True)
class When:
    """A moment that is looked for.

    Args:
        value: what changes its sign there: an expression such as ``"platform.z - 0.5"``, with the
            names of variables for positions, these with ``d_`` in front for rates, and t; or a
            function of a `Scene`.
        stop: whether the run ends there.
        direction: 1 where it rises, -1 where it falls, 0 for both.
    """

    value: str | Callable[[Scene], Scalar]
    stop: bool = False
    direction: int = 0


def asked_for(given: Mapping[str, Any] | None, dynamics: Dynamics) -> tuple[Asked, ...]:
    """Events by name, read and checked.

    Raises:
        ConfigurationError: an expression can not be read, or names no variable.
    """
    found = []
    for name, event in (given or {}).items():
        when = event if isinstance(event, When) else When(event)
        if when.direction not in (-1, 0, 1):
            raise ConfigurationError(
                f"event {name} has the direction {when.direction!r}, expected -1, 0 or 1"
            )
        value = when.value
        if isinstance(value, str):
            value = _Written(name, value, tuple(v.name for v in dynamics.structure.variables))
        elif not callable(value):
            raise ConfigurationError(
                f"event {name} is {value!r}, expected an expression or a function of a scene"
            )
        found.append(Asked(name, value, "stop" if when.stop else "mark", when.direction))
    return tuple(found)


@dataclass(frozen=True)
class _Written:
    """An expression of the names of variables."""

    name: str
    text: str
    variables: tuple[str, ...]

    def __post_init__(self) -> None:
        plain, used = self._plain()
        for word in used.values():
            known = word == TIME or word.removeprefix(RATE) in self.variables
            if not known:
                raise UnknownName(f"variable in event {self.name}", word, self.variables)
        try:
            Expression.read(plain)
        except ExpressionError as error:
            raise ConfigurationError(f"event {self.name}, {self.text!r}: {error}") from None

    def _plain(self) -> tuple[str, dict[str, str]]:
        """The text with words that expressions can hold for names with dots, and these."""
        words = sorted(
            {TIME, *self.variables, *(RATE + v for v in self.variables)}, key=len, reverse=True
        )
        pattern = re.compile(r"(?<![\w.])(" + "|".join(map(re.escape, words)) + r")(?![\w.])")
        used: dict[str, str] = {}

        def plain(match: re.Match[str]) -> str:
            word = f"_v{words.index(match[1])}"
            used[word] = match[1]
            return word

        return pattern.sub(plain, self.text), used

    def __call__(self, scene: Scene) -> Scalar:
        plain, used = self._plain()
        values = {}
        for word, name in used.items():
            if name == TIME:
                values[word] = scene.t
            elif name in self.variables:
                values[word] = scene.position(name)
            else:
                values[word] = scene.rate(name.removeprefix(RATE))
        try:
            return Expression.read(plain).evaluate(values)
        except ExpressionError as error:
            raise ConfigurationError(f"event {self.name}, {self.text!r}: {error}") from None
