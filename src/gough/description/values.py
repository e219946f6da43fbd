"""Values of parameters, and numbers that expressions of them come to."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from gough.description.expression import Expression, ExpressionError
from gough.description.parts import Parameter

LARGEST = 1e12
"""Largest number of a mechanism: well beyond any machine, and safe to multiply."""
Values = Mapping[str, Any]
"""Value of each parameter: a scalar, number or symbol, or nested tuples of scalars."""


def evaluate_parameters(
    parameters: Mapping[str, Parameter],
    given: Values | None = None,
    report: Callable[[str, str], None] | None = None,
) -> dict[str, Any]:
    """The value of every parameter, in whatever order they refer to each other.

    Args:
        parameters: the parameters by name.
        given: values that replace those written, such as the symbols of live parameters.
        report: called with a name and a message for each parameter that has no value; without
            it the first such parameter raises.

    Raises:
        ExpressionError: a parameter has no value, and there is no ``report``.
    """
    done: dict[str, Any] = dict(given or {})
    open_: list[str] = []
    failed: set[str] = set()

    def value_of(name: str) -> Any:
        if name in done:
            return done[name]
        if name in failed:
            raise _Follows(f"parameter {name} has no value")
        if name in open_:
            raise _Circle([*open_[open_.index(name) :], name])
        open_.append(name)
        try:
            done[name] = _evaluate(parameters[name].value, _Lazy(parameters, value_of))
        except ExpressionError as error:
            failed.update(error.names if isinstance(error, _Circle) else [name])
            if report is None:
                raise ExpressionError(f"parameter {name}: {error}") from None
            if not isinstance(error, _Follows):
                report(error.names[0] if isinstance(error, _Circle) else name, str(error))
            raise _Follows(f"parameter {name} has no value") from None
        finally:
            open_.pop()
        return done[name]

    left = list(parameters)
    while left:
        deep = []
        for name in left:
            try:
                value_of(name)
            except _Follows:
                continue
            except RecursionError:  # a long chain: what its end comes to is known by the next turn
                deep.append(name)
        if len(deep) == len(left):
            raise ExpressionError(f"parameter {left[0]} is nested too deeply")
        left = deep
    return done


class _Follows(ExpressionError):
    """A parameter has no value because another has none, which was reported."""


class _Circle(ExpressionError):
    """Parameters refer to each other in a circle."""

    def __init__(self, names: list[str]) -> None:
        self.names = names
        ring = " → ".join(name.replace("__", ".") for name in names)
        super().__init__(f"the parameters refer to each other in a circle: {ring}")


class _Lazy(Mapping[str, Any]):
    """Parameters that are evaluated when an expression looks them up."""

    def __init__(self, parameters: Mapping[str, Parameter], value_of: Callable[[str], Any]) -> None:
        self._parameters, self._value_of = parameters, value_of

    def __getitem__(self, name: str) -> Any:
        if name not in self._parameters:
            raise KeyError(name)
        return self._value_of(name)

    def __contains__(self, name: object) -> bool:
        return name in self._parameters

    def __iter__(self) -> Any:
        return iter(self._parameters)

    def __len__(self) -> int:
        return len(self._parameters)


def _evaluate(value: Any, values: Values) -> Any:
    if isinstance(value, tuple):
        return tuple(_evaluate(item, values) for item in value)
    return value.evaluate(values) if isinstance(value, Expression) else value


def scalar(value: float | Expression, values: Values) -> Any:
    """The number or symbol that a scalar of the description comes to.

    Raises:
        ExpressionError: it has no value, or is a list.
    """
    result = _evaluate(value, values)
    if isinstance(result, tuple):
        raise ExpressionError(f"{value} is a list of {len(result)}, not one number")
    return _sensible(result)


def vector(value: Any, values: Values, *lengths: int) -> tuple[Any, ...]:
    """The scalars that a list of the description comes to, of one of the given lengths.

    Raises:
        ExpressionError: a scalar has no value, or the length is another.
    """
    result = _evaluate(value, values)
    items = result if isinstance(result, tuple) else (result,)
    if any(isinstance(item, tuple) for item in items):
        raise ExpressionError("expected numbers, got lists inside a list")
    if lengths and len(items) not in lengths:
        raise ExpressionError(f"expected {_or(lengths)} numbers, got {len(items)}")
    return tuple(_sensible(item) for item in items)


def _sensible(x: Any) -> Any:
    """x, unless it is a number whose square a model could not hold."""
    if isinstance(x, int | float) and abs(x) > LARGEST:
        raise ExpressionError(f"{x:g} is too large; numbers go up to {LARGEST:g}, in SI units")
    return x


def _or(lengths: tuple[int, ...]) -> str:
    return " or ".join(str(n) for n in sorted(set(lengths)))
