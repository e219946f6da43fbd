"""A description with the changes of its variants merged into it.

Changes are merged as a JSON merge patch (RFC 7396): mappings merge entry by entry, null removes an
entry, and any other value replaces what stood there. A bare number or list given for a parameter
replaces its value and leaves its unit and the rest as they are.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from gough.errors import Path


def merged(data: Any, changes: Any) -> tuple[Any, set[Path]]:
    """The data of a description with changes merged into it.

    Returns:
        The merged data, and the path of every entry that was put in, replaced or removed; what
        stands below such an entry is told by it.
    """
    replaced: set[Path] = set()
    return _merged(data, changes, (), replaced), replaced


def _merged(data: Any, changes: Any, path: Path, replaced: set[Path]) -> Any:
    if _is_parameter(path):
        if not isinstance(changes, Mapping):
            replaced.add(path)
        data, changes = _as_parameter(data), _as_parameter(changes)
    if not isinstance(changes, Mapping):
        replaced.add(path)
        return changes
    if not isinstance(data, Mapping):
        replaced.add(path)
        data = {}
    found = dict(data)
    for key, change in changes.items():
        at = (*path, key)
        if change is None:
            found.pop(key, None)
            replaced.add(at)
        else:
            found[key] = _merged(found.get(key), change, at, replaced)
    return found


def _is_parameter(path: Path) -> bool:
    match path:
        case ("parameters", _) | ("legs", _, "parameters", _):
            return True
    return False


def _as_parameter(value: Any) -> Any:
    """A bare number or list is the value of a parameter."""
    return value if value is None or isinstance(value, Mapping) else {"value": value}
