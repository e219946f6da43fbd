"""The errors a user of gough can meet, each naming the thing, the value and the way out."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

Path = tuple[str | int, ...]
SHOWN = 50
"""Problems of one description that are told in words; all of them are kept."""


class GoughError(Exception):
    """Base of every error that gough raises on purpose."""


@dataclass(frozen=True)
class Problem:
    """One thing wrong in a description: where it stands and what to do about it."""

    message: str
    path: Path = ()
    """Keys and indices that lead to the value, as in the file: ("joints", "hip", "type")."""
    on_key: bool = False
    """Whether the key itself is at fault (unknown, repeated) and not the value behind it."""
    line: int | None = None
    column: int | None = None

    def at(self, line: int, column: int) -> Problem:
        """The same problem with its place in the file, both counted from 1."""
        return replace(self, line=line, column=column)

    def text(self, source: str) -> str:
        """One line: file:line:column: path: message."""
        place = source if self.line is None else f"{source}:{self.line}:{self.column}"
        named = ".".join(_printable(str(part)) for part in self.path)
        return f"{place}: {named}: {self.message}" if named else f"{place}: {self.message}"


class DescriptionError(GoughError, ValueError):
    """A mechanism's description is wrong; all its problems at once."""

    def __init__(self, problems: Iterable[Problem], source: str = "mechanism") -> None:
        self.problems = tuple(
            sorted(problems, key=lambda problem: (problem.line or 0, problem.column or 0))
        )
        self.source = source
        lines = [problem.text(source) for problem in self.problems[:SHOWN]]
        hidden = len(self.problems) - len(lines)
        super().__init__("\n".join(lines + ([f"… and {hidden} more"] if hidden else [])))


class UnknownName(GoughError, LookupError):
    """Something was asked for under a name that does not exist."""

    def __init__(self, kind: str, name: str, known: Iterable[str]) -> None:
        self.kind, self.name, self.known = kind, name, tuple(sorted(known))
        super().__init__(f"no {kind} is named {name!r}.{closest(name, self.known)}")


class ClosureError(GoughError, RuntimeError):
    """The loops of a mechanism do not close."""


class OutOfReach(ClosureError):
    """A pose, or actuated positions, that the mechanism can not take; batches name the row."""

    def __init__(self, kind: str, count: int, rows: Sequence[int], reasons: Sequence[str]) -> None:
        self.rows, self.reasons = tuple(rows), tuple(reasons)
        place = f"{kind} {rows[0]} of {count}" if count > 1 else kind
        others = f"; {len(rows) - 1} more have no solution either" if len(rows) > 1 else ""
        super().__init__(f"{place} is out of reach: {reasons[0]}{others}")


class SingularError(GoughError, ArithmeticError):
    """Dynamics have no answer for a row: a singularity, a pose out of reach, an impossible rate."""

    def __init__(self, count: int, rows: Sequence[int], reasons: Sequence[str]) -> None:
        self.rows, self.reasons = tuple(rows), tuple(reasons)
        place = f"row {rows[0]} of {count}: " if count > 1 else ""
        others = f"; {len(rows) - 1} more rows have no answer either" if len(rows) > 1 else ""
        super().__init__(f"{place}{reasons[0]}{others}")


class ConfigurationError(GoughError, ValueError):
    """A configuration has the wrong shape, or holds values that are not finite."""


def _printable(text: str) -> str:
    """The text, or its quoted form where it holds characters that would not print."""
    return text if text.isprintable() else repr(text)


def closest(name: str, known: Sequence[str]) -> str:
    """A sentence with the nearest known name and the list of known names, to end a message with."""
    near = difflib.get_close_matches(name, known, n=1)
    hint = f" Did you mean {near[0]!r}?" if near else ""
    shown = ", ".join(known[:12]) + (f", … ({len(known)} in all)" if len(known) > 12 else "")
    return f"{hint} Known: {shown}." if known else hint


class MissingExtra(GoughError, ImportError):
    """A package is wanted that an extra of this library would have installed."""

    def __init__(self, purpose: str, package: str, extra: str) -> None:
        self.extra = extra
        super().__init__(f'{purpose} needs {package}; install it with pip install "gough[{extra}]"')
