"""Numbers of a description: floats, or expressions of parameters, checked by pydantic."""

from __future__ import annotations

import math
from numbers import Real
from typing import Annotated, Any

from pydantic import PlainSerializer, PlainValidator, WithJsonSchema

from gough.description.expression import Expression, ExpressionError

NUMBER_SCHEMA = {
    "anyOf": [
        {"type": "number"},
        {"type": "string", "description": "arithmetic of parameters, such as R*cos(pi/3 - d)"},
    ]
}


def read_scalar(value: Any) -> float | Expression:
    """A finite float, or the expression that a text holds."""
    if isinstance(value, Expression):
        return value
    if isinstance(value, str):
        try:
            return Expression.read(value)
        except ExpressionError as error:
            raise ValueError(str(error)) from None
    if isinstance(value, bool) or not isinstance(value, Real):
        raise ValueError(f"expected a number or an expression, got {_shown(value)}")
    try:
        number = float(value)
    except OverflowError:
        number = math.inf
    if not math.isfinite(number):
        raise ValueError(f"expected a finite number, got {_shown(value)}")
    return number


def read_vector(value: Any) -> tuple[float | Expression, ...] | Expression:
    """A list of numbers, or an expression that names one."""
    if isinstance(value, str | Expression):
        scalar = read_scalar(value)
        assert isinstance(scalar, Expression)
        return scalar
    value = _plain(value)
    if not isinstance(value, list | tuple):
        raise ValueError(f"expected a list of numbers, got {_shown(value)}")
    return tuple(read_scalar(item) for item in value)


def read_position(value: Any) -> tuple[float | Expression, ...] | Expression:
    """A list of numbers, an expression that names one, or one number."""
    value = _plain(value)
    lone = not isinstance(value, list | tuple | str | Expression)
    return (read_scalar(value),) if lone else read_vector(value)


def read_array(value: Any) -> Any:
    """A number, or nested lists of numbers."""
    value = _plain(value)
    if isinstance(value, list | tuple):
        if not value:
            raise ValueError("expected at least one number, got an empty list")
        return tuple(read_array(item) for item in value)
    return read_scalar(value)


def _plain(value: Any) -> Any:
    """The lists and numbers of an array."""
    return value.tolist() if hasattr(value, "tolist") else value


def write(value: Any) -> Any:
    """The plain data an expression or a list was read from."""
    if isinstance(value, Expression):
        return value.text
    return [write(item) for item in value] if isinstance(value, tuple) else value


def _shown(value: Any) -> str:
    if value is None:
        return "nothing"
    text = repr(value)
    return text if len(text) <= 40 else text[:37] + "…"


Scalar = Annotated[
    float | Expression,
    PlainValidator(read_scalar),
    PlainSerializer(write),
    WithJsonSchema(NUMBER_SCHEMA),
]
Vector = Annotated[
    tuple[float | Expression, ...] | Expression,
    PlainValidator(read_vector),
    PlainSerializer(write),
    WithJsonSchema({"anyOf": [{"type": "array", "items": NUMBER_SCHEMA}, {"type": "string"}]}),
]
Position = Annotated[
    tuple[float | Expression, ...] | Expression,
    PlainValidator(read_position),
    PlainSerializer(write),
    WithJsonSchema(
        {"anyOf": [{"type": ["number", "string"]}, {"type": "array", "items": NUMBER_SCHEMA}]}
    ),
]
Array = Annotated[
    Any,
    PlainValidator(read_array),
    PlainSerializer(write),
    WithJsonSchema(
        {"anyOf": [{"type": ["number", "string"]}, {"type": "array", "minItems": 1, "items": {}}]}
    ),
]
