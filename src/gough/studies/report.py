"""What a section of a report is made of. Nothing here knows of robots or of HTML."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

Cell = str | int | float | bool | None


@dataclass(frozen=True)
class Paragraph:
    """Running text."""

    text: str


@dataclass(frozen=True)
class Points:
    """Short statements, one under the other."""

    items: Sequence[str]


@dataclass(frozen=True)
class Command:
    """What a person types, in a line of its own."""

    text: str


@dataclass(frozen=True)
class Table:
    """Rows of cells under a heading; numbers stand to the right, flush with each other."""

    columns: Sequence[str]
    """Headings; all empty for a table of names and values."""
    rows: Sequence[Sequence[Cell]]
    caption: str = ""


@dataclass(frozen=True)
class Picture:
    """A picture with its caption."""

    name: str
    """Name of its files, without an ending."""
    caption: str
    about: str
    """What is to be seen, in place of the picture for those who can not see it."""
    svg: bytes
    png: bytes


Block = Paragraph | Points | Command | Table | Picture


@dataclass(frozen=True)
class Section:
    """One part of a report."""

    name: str
    """Short name: the anchor in the page and the key of the data."""
    title: str
    blocks: Sequence[Block]
    data: dict[str, Any] = field(default_factory=dict)
    """The content as plain data, merged into the top level of the report's JSON object."""

    @property
    def pictures(self) -> list[Picture]:
        """The pictures in order."""
        return [block for block in self.blocks if isinstance(block, Picture)]
