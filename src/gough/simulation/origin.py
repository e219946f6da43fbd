"""What decides the numbers of an ensemble, in plain values that can be compared."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from types import CodeType
from typing import Any

import numpy as np

from gough.cache import digest

LONGEST = 64
"""Numbers of an array that are kept as they are; of more a digest is."""


def plain(value: Any) -> Any:
    """A value in JSON's types: equal for equal content, in other processes too.

    Functions are their name and a digest of their code and of what they enclose, other objects
    their type and their attributes. What only has an address is told apart by that, so that two
    such things are never taken for the same.
    """
    return _plain(value, ())


def _plain(value: Any, above: tuple[int, ...]) -> Any:
    if isinstance(value, np.generic):
        value = value.item()
    if value is None or isinstance(value, str | bool | int):
        return value
    if isinstance(value, float):
        return value if math.isfinite(value) else str(value)
    if id(value) in above:
        return "…"
    above = (*above, id(value))
    if isinstance(value, Mapping):
        return {str(k): _plain(v, above) for k, v in value.items()}
    if isinstance(value, np.ndarray):
        return _array(value, above)
    if isinstance(value, Sequence):
        return [_plain(v, above) for v in value]
    if hasattr(value, "as_dict"):
        return _plain(value.as_dict(), above)
    if isinstance(value, partial):
        parts = [_plain(x, above) for x in (value.func, value.args, value.keywords)]
        return {"type": "partial", "of": parts}
    if callable(value) and (hasattr(value, "__code__") or hasattr(value, "__self__")):
        return _function(value, above)
    if hasattr(value, "__dict__") and not isinstance(value, type):
        return {"type": _name(type(value)), **_plain(vars(value), above)}
    return str(value)


def _array(value: np.ndarray[Any, Any], above: tuple[int, ...]) -> Any:
    if value.size <= LONGEST or value.dtype.kind not in "biufc":
        return _plain(value.tolist(), above)
    numbers = np.ascontiguousarray(value)
    told = f"{value.dtype.str} {list(value.shape)}"
    return {"array": told, "digest": digest(told, numbers.tobytes()).hex()[:16]}


def _function(value: Callable[..., Any], above: tuple[int, ...]) -> dict[str, Any]:
    found: dict[str, Any] = {"function": _name(value)}
    owner, code = getattr(value, "__self__", None), getattr(value, "__code__", None)
    if owner is not None and not isinstance(owner, type(math)):  # of a module, if it is built in
        found["of"] = _plain(owner, above)
    if code is not None:
        found["code"] = digest(_code(code)).hex()[:16]
        cells = [cell.cell_contents for cell in getattr(value, "__closure__", None) or ()]
        given = [
            cells,
            getattr(value, "__defaults__", None),
            getattr(value, "__kwdefaults__", None),
        ]
        if any(given):
            found["with"] = _plain(given, above)
    return found


def _code(code: CodeType) -> str:
    """Instructions and constants, without places in files."""
    constants = [_code(c) if isinstance(c, CodeType) else _constant(c) for c in code.co_consts]
    return repr((code.co_code, code.co_names, code.co_varnames, constants))


def _constant(value: Any) -> str:
    return repr(sorted(map(repr, value)) if isinstance(value, frozenset) else value)


def _name(value: Any) -> str:
    return f"{value.__module__}.{value.__qualname__}"
