"""Values of parameters, and numbers that expressions of them come to."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
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
    evaluation = _Evaluation(parameters, given or {}, report)
    left = list(parameters)
    while left:
        deep = [name for name in left if not evaluation.settled(name)]
        if len(deep) == len(left):
            raise ExpressionError(f"parameter {left[0]} is nested too deeply")
        left = deep
    return evaluation.done


class _Follows(ExpressionError):
    """A parameter has no value because another has none, which was reported."""


class _Circle(ExpressionError):
    """Parameters refer to each other in a circle."""

    def __init__(self, names: list[str]) -> None:
        self.names = names
        ring = " → ".join(name.replace("__", ".") for name in names)
        super().__init__(f"the parameters refer to each other in a circle: {ring}")


class _Evaluation(Mapping[str, Any]):
    """Values of parameters, found when an expression looks them up."""

    def __init__(
        self,
        parameters: Mapping[str, Parameter],
        given: Values,
        report: Callable[[str, str], None] | None,
    ) -> None:
        self.parameters, self.report = parameters, report
        self.done: dict[str, Any] = dict(given)
        self.open: list[str] = []
        self.failed: set[str] = set()

    def settled(self, name: str) -> bool:
        """Whether a parameter has its value, or certainly none.

        At the end of a long chain it has neither yet; the next try begins where this one ended.
        """
        try:
            self[name]
        except _Follows:
            return True
        except RecursionError:
            return False
        return True

    def __getitem__(self, name: str) -> Any:
        if name not in self.parameters:
            raise KeyError(name)
        if name in self.failed:
            raise _Follows(f"parameter {name} has no value")
        if name in self.open:
            raise _Circle([*self.open[self.open.index(name) :], name])
        if name not in self.done:
            self.open.append(name)
            try:
                self.done[name] = _evaluate(self.parameters[name].value, self)
            except ExpressionError as error:
                self._fail(name, error)
            finally:
                self.open.pop()
        return self.done[name]

    def _fail(self, name: str, error: ExpressionError) -> None:
        """Keep in mind that a parameter has no value, and tell it once."""
        members = error.names if isinstance(error, _Circle) else [name]
        self.failed.update(members)
        if self.report is None:
            raise ExpressionError(f"parameter {name}: {error}") from None
        if not isinstance(error, _Follows):
            self.report(members[0], str(error))
        raise _Follows(f"parameter {name} has no value") from None

    def __contains__(self, name: object) -> bool:
        return name in self.parameters

    def __iter__(self) -> Iterator[str]:
        return iter(self.parameters)

    def __len__(self) -> int:
        return len(self.parameters)


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


def array(value: Any, values: Values) -> Any:
    """The scalar, or nested tuples of scalars, that a number or a list comes to.

    Raises:
        ExpressionError: a scalar has no value.
    """
    return _all_sensible(_evaluate(value, values))


def _all_sensible(x: Any) -> Any:
    return tuple(map(_all_sensible, x)) if isinstance(x, tuple) else _sensible(x)


def _sensible(x: Any) -> Any:
    """x, unless it is a number whose square a model could not hold."""
    if isinstance(x, int | float) and abs(x) > LARGEST:
        raise ExpressionError(f"{x:g} is too large; numbers go up to {LARGEST:g}, in SI units")
    return x


def _or(lengths: tuple[int, ...]) -> str:
    return " or ".join(str(n) for n in sorted(set(lengths)))
