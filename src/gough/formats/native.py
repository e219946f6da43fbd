"""Our own YAML: text to mechanism, with every error of a file at once and in its place."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from copy import copy
from pathlib import Path as FilePath
from typing import Any, TypeVar

from pydantic import ValidationError

from gough.description import Mechanism
from gough.description.check import problems_of
from gough.description.form import Description
from gough.description.messages import problem
from gough.description.variants import merged
from gough.errors import DescriptionError, Path, Problem, UnknownName
from gough.formats.nodes import MAX_BYTES, Document, compose

T = TypeVar("T")
PRUNING_ROUNDS = 50


class Source:
    """One description file: its text, its data, and the place of everything in it.

    Raises:
        DescriptionError: the file is missing, unreadable, too large, or no YAML we accept.
    """

    def __init__(self, raw: bytes, name: str) -> None:
        self.name = name
        self.document: Document = compose(raw, name)

    @classmethod
    def open(cls, path: FilePath) -> Source:
        """The description in a file."""
        try:
            with path.open("rb") as file:
                return cls(file.read(MAX_BYTES + 1), str(path))
        except OSError as error:
            reason = error.strerror or str(error)
            raise DescriptionError([Problem(f"can not be read: {reason}")], str(path)) from None

    def mechanism(
        self, parameters: Mapping[str, Any] | None = None, variants: Sequence[str] = ()
    ) -> Mechanism:
        """The mechanism, with some variants and then the values of some parameters replaced.

        Raises:
            DescriptionError: something in the description is wrong; all of it is reported.
            UnknownName: a parameter to replace does not exist, or a variant.
        """
        if not isinstance(self.document.data, dict):
            problem = Problem("a description is a mapping of names").at(1, 1)
            raise DescriptionError([problem], self.name)
        document = varied(self.document, variants)
        assert isinstance(document.data, dict)
        description, broken, problems = _read(replaced(document.data, parameters or {}))
        if description is not None:
            problems += problems_of(description, broken)
        if problems or description is None:
            located = [document.locate(problem) for problem in dict.fromkeys(problems)]
            raise DescriptionError(located, self.name)
        return Mechanism.model_construct(**dict(description))

    def varied(self, variants: Sequence[str]) -> Source:
        """The same description with the changes of some variants, for the places of its parts.

        Raises:
            UnknownName: there is no such variant.
        """
        other = copy(self)
        other.document = varied(self.document, variants)
        return other

    def locating(self, action: Callable[[], T]) -> T:
        """What the action returns; problems it raises are given their place in this file."""
        try:
            return action()
        except DescriptionError as error:
            located = [self.document.locate(problem) for problem in error.problems]
            raise DescriptionError(located, self.name) from None


def varied(document: Document, names: Sequence[str]) -> Document:
    """A document with the changes of some variants, one after the other, each in its place.

    Raises:
        UnknownName: there is no such variant.
    """
    whole = document.data
    known = whole.get("variants") if isinstance(whole, dict) else None
    known = known if isinstance(known, dict) else {}
    for name in names:
        if name not in known:
            raise UnknownName("variant", name, known)
        part = known[name]
        changes = part.get("changes") if isinstance(part, dict) else None
        if isinstance(changes, dict):
            document = _changed(document, changes, ("variants", name, "changes"))
    return document


def _changed(document: Document, changes: dict[str, Any], start: Path) -> Document:
    """A document with changes that stand at a path of it."""
    data, new = merged(document.data, changes)
    tables = []
    for table in (document.places, document.keys):
        found = {path: place for path, place in table.items() if not _within(path, new)}
        for path in new:
            near = (start + path[:length] for length in range(len(path), 0, -1))
            place = next((table[at] for at in near if at in table), None)
            if place is not None:
                found[path] = place
        for path, place in table.items():
            if path[: len(start)] == start and _within(path[len(start) :], new):
                found[path[len(start) :]] = place
        tables.append(found)
    return Document(data, *tables)


def _within(path: Path, parts: Collection[Path]) -> bool:
    """Whether a path leads into one of the parts."""
    return any(path[:length] in parts for length in range(1, len(path) + 1))


def replaced(data: dict[str, Any], parameters: Mapping[str, Any]) -> dict[str, Any]:
    """The data of a description with the values of some parameters replaced."""
    if not parameters:
        return data
    known = data.get("parameters")
    known = known if isinstance(known, dict) else {}
    for name in parameters:
        if name not in known:
            raise UnknownName("parameter", name, known)
    changed = {
        name: {**part, "value": parameters[name]} if isinstance(part, dict) else parameters[name]
        for name, part in known.items()
        if name in parameters
    }
    return {**data, "parameters": {**known, **changed}}


def _read(data: dict[str, Any]) -> tuple[Description | None, list[str], list[Problem]]:
    """The description, without the parts whose form is wrong; their names; what is wrong.

    What is left still has its names and numbers judged, so that one reading shows all errors.
    """
    problems: list[Problem] = []
    broken: list[str] = []
    for _ in range(PRUNING_ROUNDS):
        try:
            return Description.model_validate(data), broken, problems
        except ValidationError as error:
            details = error.errors(include_url=False)
        if not problems:
            problems = [problem(detail) for detail in details]
        for detail in details:
            data = _without(data, tuple(detail["loc"]), broken)
    return None, broken, problems


def _without(data: dict[str, Any], path: tuple[Any, ...], broken: list[str]) -> dict[str, Any]:
    """The data without the part that a path leads into, whose name joins the broken ones."""
    if not path or path[0] not in data:
        return {"name": "mechanism", **data}
    depth = {"legs": 4, "name": 1, "bodies": 2, "joints": 2}.get(path[0], 2)
    inner = path[:depth] if len(path) >= depth else path[: 2 if path[0] == "legs" else 1]
    match inner:
        case ("legs", leg, _, part):
            broken.append(f"{leg}*.{part}")
            broken.append(part)
        case ("legs", leg):
            broken.append(f"{leg}*")
        case (_, part):
            broken.append(str(part))
    pruned: dict[str, Any] = _removed(data, inner)
    return {"name": "mechanism", **pruned}


def _removed(data: Any, path: tuple[Any, ...]) -> Any:
    """The data without the entry at a path; of a list, without the list."""
    key, *rest = path
    if not isinstance(data, dict) or key not in data:
        return data
    if rest and isinstance(data[key], dict):
        return {**data, key: _removed(data[key], tuple(rest))}
    return {name: value for name, value in data.items() if name != key}
