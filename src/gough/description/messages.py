"""Errors of form, as pydantic finds them, in our words."""

from __future__ import annotations

from typing import Any

from pydantic import BaseModel
from pydantic_core import ErrorDetails

from gough.description.form import Description
from gough.description.parts import (
    Actuator,
    Body,
    Constraint,
    Coupling,
    Frame,
    Joint,
    Leg,
    Motor,
    Parameter,
    Variant,
)
from gough.errors import Path, Problem, closest


def problem(detail: ErrorDetails) -> Problem:
    """One problem of form in our words."""
    path: Path = tuple(part for part in detail["loc"] if part != "[key]")
    on_key = detail["type"] == "extra_forbidden" or "[key]" in detail["loc"]
    return Problem(_message(detail, path), path, on_key)


def _message(detail: ErrorDetails, path: Path) -> str:
    value = _shown(detail["input"])
    match detail["type"]:
        case "extra_forbidden":
            known = _fields_at(path[:-1])
            return f"there is no entry {path[-1]!r} here.{closest(str(path[-1]), known)}"
        case "missing":
            return "is missing"
        case "value_error":
            return str(detail["ctx"]["error"])
        case "string_pattern_mismatch" | "string_too_long":
            return (
                f"{value} is no name: a letter, then letters, digits, - and _ "
                "(words joined by dots), at most 80 characters"
            )
        case "literal_error" | "enum":
            return f"{value} is not one of {detail['ctx']['expected']}"
        case "dict_type" | "model_type":
            return f"expected a mapping of names, got {value}"
        case "tuple_type" | "list_type":
            return f"expected a list, got {value}"
        case "string_type":
            return f"expected text, got {value}; numbers and true, false as text need quotes"
        case "int_type" | "int_from_float" | "greater_than_equal" | "less_than_equal":
            return f"expected a whole number from 1 to 1000, got {value}"
        case "tuple_type" | "list_type" if path[-1] == "frames":
            return f"expected a list of two frames, one on either body; got {value}"
        case "bool_type" | "bool_parsing":
            return f"expected true or false, got {value}"
    return f"{detail['msg']} (got {value})"


def _fields_at(path: Path) -> tuple[str, ...]:
    """Names of the entries that the model knows at a path."""
    model: type[BaseModel] = Description
    kinds: dict[str, type[BaseModel]] = {
        "bodies": Body,
        "joints": Joint,
        "constraints": Constraint,
        "couplings": Coupling,
        "legs": Leg,
        "parameters": Parameter,
        "variants": Variant,
    }
    left = iter(path)
    for part in left:
        if part in kinds and model in (Description, Leg):
            model = kinds[str(part)]
            next(left, None)  # the name of the part, which may be that of an entry
        elif part in ("frames", "home"):
            model = Frame
        elif part == "motor":
            model = Motor
        elif part == "actuators":
            model = Actuator
            next(left, None)
    return tuple(sorted(model.model_fields))


def _shown(value: Any) -> str:
    text = "nothing" if value is None else repr(value)
    return text if len(text) <= 60 else text[:57] + "…"
