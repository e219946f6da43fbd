"""Trajectories as CSV: a header of names with units, then a row for each moment."""

from __future__ import annotations

import csv
import io
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from gough.errors import ConfigurationError, DescriptionError, Problem, closest

UNITS: dict[str, dict[str, float]] = {
    "s": {"s": 1.0, "ms": 1e-3},
    "m": {"m": 1.0, "mm": 1e-3},
    "rad": {"rad": 1.0, "deg": math.pi / 180, "°": math.pi / 180},
    "1": {"1": 1.0, "": 1.0, "-": 1.0},
}
for _of in ("m", "rad"):
    for _per in ("s", "s^2"):
        UNITS[f"{_of}/{_per}"] = {f"{unit}/{_per}": f for unit, f in UNITS[_of].items()}
"""For each unit of ours those that a header may have, and what one of them is in ours."""

_TITLE = re.compile(r"([^\[\]]*?)\s*(?:\[([^\[\]]*)\])?\s*")
MOST_PROBLEMS = 50
"""Wrong cells that are told of one file."""


@dataclass(frozen=True)
class Table:
    """The columns of a file, in SI units and rad."""

    source: str
    header: int
    """In which line of the file the titles stand, from 1."""
    columns: Mapping[str, list[float]]
    lines: Sequence[int]
    """In which line each row stands."""

    def __len__(self) -> int:
        return len(self.lines)

    def problem(self, row: int, message: str, column: str) -> DescriptionError:
        """An error about a number of a row."""
        problem = Problem(message, (column,), line=self.lines[row], column=1)
        return DescriptionError([problem], self.source)

    def wrong_header(self, message: str) -> DescriptionError:
        """An error about the header."""
        return DescriptionError([Problem(message, line=self.header, column=1)], self.source)


@dataclass(frozen=True)
class _Line:
    """The cells of a line and where they stand."""

    number: int
    cells: list[str]
    starts: list[int]


@dataclass(frozen=True)
class _Column:
    name: str
    factor: float


def open_table(path: str | Path, known: Mapping[str, str]) -> Table:
    """The table of a CSV file.

    Args:
        path: of the file.
        known: names that columns may have, and their units.

    Raises:
        DescriptionError: the file can not be read, or something in it is wrong; every problem.
    """
    try:
        content = Path(path).read_bytes()
    except OSError as error:
        problem = Problem(f"can not be read: {error.strerror}")
        raise DescriptionError([problem], str(path)) from None
    return read_table(content, str(path), known)


def read_table(content: bytes, source: str, known: Mapping[str, str]) -> Table:
    """The table of a text in CSV; see `open_table`.

    Cells are parted by commas; by semicolons or tabs where the header has no comma. Empty lines
    and lines that begin with # are left out. A title is a name with its unit in brackets; without
    brackets the unit is that of SI, and rad.
    """
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = content[: error.start].count(b"\n") + 1
        raise DescriptionError(
            [Problem("is no text in UTF-8", line=line, column=1)], source
        ) from None
    lines = list(_lines(text))
    if not lines:
        raise DescriptionError([Problem("the file is empty: a header and rows expected")], source)
    columns = _header(lines[0], source, known)
    if len(lines) == 1:
        problem = Problem("there are no rows below the header", line=lines[0].number, column=1)
        raise DescriptionError([problem], source)
    problems: list[Problem] = []
    rows = [_row(line, columns, problems) for line in lines[1:]]
    if problems:
        raise DescriptionError(_shortened(problems), source)
    values = {c.name: [row[k] for row in rows] for k, c in enumerate(columns)}
    return Table(source, lines[0].number, values, [line.number for line in lines[1:]])


def _lines(text: str) -> Iterable[_Line]:
    """Lines that hold something."""
    delimiter = None
    for number, line in enumerate(text.splitlines(), start=1):
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        if delimiter is None:
            delimiter = next((mark for mark in ",;\t" if mark in line), ",")
        cells = next(csv.reader(io.StringIO(line), delimiter=delimiter))
        starts, at = [], 1
        for cell in cells:
            starts.append(at)
            at += len(cell) + 1
        yield _Line(number, cells, starts)


def _header(line: _Line, source: str, known: Mapping[str, str]) -> list[_Column]:
    columns: list[_Column] = []
    problems: list[Problem] = []
    for cell, start in zip(line.cells, line.starts, strict=True):
        found = _column(cell, known)
        if isinstance(found, _Column) and found.name in {c.name for c in columns}:
            found = f"column {found.name!r} occurs twice"
        if isinstance(found, _Column):
            columns.append(found)
        else:
            problems.append(Problem(found, line=line.number, column=start))
    if problems:
        raise DescriptionError(problems, source)
    return columns


def _column(cell: str, known: Mapping[str, str]) -> _Column | str:
    """A column, or what is wrong with its title."""
    match = _TITLE.fullmatch(cell.strip())
    if match is None or not match[1]:
        return f"{cell.strip()!r} is no title of a column: expected a name and a unit, as in x [m]"
    name, unit = match[1], match[2]
    if name not in known:
        return f"there is no column {name!r}.{closest(name, list(known))}"
    units = UNITS[known[name]]
    plain = None if unit is None else _plain(unit)
    if plain is None:
        return _Column(name, 1.0)
    if plain not in units:
        words = ", ".join(word for word in units if word)
        return f"{name} has the unit {unit!r}, expected one of {words}"
    return _Column(name, units[plain])


def _plain(unit: str) -> str:
    """A unit as in `UNITS`: m/s², m/s2 and m/s**2 are m/s^2."""
    text = unit.replace(" ", "").replace("²", "^2").replace("**", "^")
    return re.sub(r"/s2$", "/s^2", text)


def _row(line: _Line, columns: Sequence[_Column], problems: list[Problem]) -> list[float]:
    """The numbers of a line; what is wrong with it is added to the problems."""
    if len(line.cells) != len(columns):
        message = f"has {len(line.cells)} cells, expected {len(columns)}, as the header"
        problems.append(Problem(message, line=line.number, column=1))
        return []
    row = []
    for column, cell, start in zip(columns, line.cells, line.starts, strict=True):
        number = _number(cell)
        if number is None:
            message = f"{cell.strip()!r} is no finite number" if cell.strip() else "is empty"
            problems.append(Problem(message, (column.name,), line=line.number, column=start))
        row.append(column.factor * (number or 0.0))
    return row


def _number(cell: str) -> float | None:
    if "_" in cell:
        return None
    try:
        number = float(cell)
    except ValueError:
        return None
    return number if math.isfinite(number) else None


def _shortened(problems: list[Problem]) -> list[Problem]:
    return problems[:MOST_PROBLEMS]


def write_table(path: str | Path, titles: Sequence[str], rows: Iterable[Sequence[object]]) -> None:
    """Write a header and rows as CSV; numbers in full, an empty cell where there is none.

    Raises:
        ConfigurationError: the file can not be written.
    """
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(titles)
    writer.writerows([_cell(value) for value in row] for row in rows)
    try:
        Path(path).parent.mkdir(parents=True, exist_ok=True)
        Path(path).write_text(text.getvalue(), "utf-8")
    except OSError as error:
        raise ConfigurationError(f"{path} can not be written: {error.strerror}") from None


def _cell(value: object) -> str:
    if isinstance(value, float):
        return repr(value) if math.isfinite(value) else ""
    return str(value)
