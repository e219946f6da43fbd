"""YAML text to plain data, with the place of every value and all problems of the text at once.

The text is read as a flat stream of events, never as a tree of nodes: nothing recurses, and an
alias is refused before it can stand for anything. Plain scalars follow the core schema of
YAML 1.2 (yaml.org/spec/1.2.2, section 10.3), so `no` and `1:30` are text and `1e-3` is a number.
"""

from __future__ import annotations

import codecs
import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import yaml

from gough.errors import DescriptionError, Path, Problem

MAX_BYTES = 4 * 1024 * 1024
MAX_DEPTH = 64
_TOO_DEEP = f"lists and mappings nest more than {MAX_DEPTH} levels deep; flatten them"
MAX_VALUES = 200_000
MAX_DIGITS = 40
MAX_PROBLEMS = 50
QUOTES = "; text with [ ] inside, such as B[i], needs quotes"

_LOADER: type[yaml.SafeLoader | yaml.CSafeLoader] = getattr(yaml, "CSafeLoader", yaml.SafeLoader)

_NULL = frozenset({"", "~", "null", "Null", "NULL"})
_BOOL = dict.fromkeys(("true", "True", "TRUE"), True) | dict.fromkeys(
    ("false", "False", "FALSE"), False
)
_INTEGER = re.compile(r"[-+]?(?P<ten>[0-9]+)|0o(?P<eight>[0-7]+)|0x(?P<sixteen>[0-9a-fA-F]+)")
_BASES = {"ten": 10, "eight": 8, "sixteen": 16}
_FLOAT = re.compile(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?")
_INFINITE = re.compile(r"[-+]?\.(inf|Inf|INF)")
_NOT_A_NUMBER = re.compile(r"\.(nan|NaN|NAN)")

_HALF_CHARACTER = re.compile("[\ud800-\udfff]")  # libyaml refuses it, the loader in Python does not
_LINE_END = re.compile(r"\r\n|\r|\n")
# What YAML calls printable, less four characters: U+0085, U+2028 and U+2029 end a line in YAML 1.1
# (hence in PyYAML) but not in YAML 1.2 or in an editor, and U+FEFF cannot be seen.
_UNREADABLE = re.compile(
    "[^\t\n\r\x20-\x7e\xa0-\u2027\u202a-\ud7ff\ue000-\ufefe\uff00-\ufffd\U00010000-\U0010ffff]"
)


class Place(NamedTuple):
    """Where something begins in the text; both numbers count from 1."""

    line: int
    column: int


@dataclass(frozen=True)
class Document:
    """What a text says, and where it says it. The keys of mappings are always text."""

    data: object
    """None, bool, int, float, str, or a list or dict of these."""
    places: Mapping[Path, Place]
    """Where each value begins; the path of the whole document is ()."""
    keys: Mapping[Path, Place]
    """Where the key of each entry of a mapping begins."""

    def locate(self, problem: Problem) -> Problem:
        """The problem with the place of its path, or of the nearest path around it."""
        for length in range(len(problem.path), -1, -1):
            path = problem.path[:length]
            if problem.on_key and path in self.keys:
                return problem.at(*self.keys[path])
            if path in self.places:
                return problem.at(*self.places[path])
        return problem.at(1, 1)


def compose(raw: bytes, source: str) -> Document:
    """The data of a YAML text and the place of every value.

    Args:
        raw: the content of the file, UTF-8 with or without a byte order mark.
        source: the name of the file, for the messages.

    Raises:
        DescriptionError: with every problem that can be found. A syntax error, or a limit passed,
            ends the reading; what was found before stands beside it.
    """
    reader = _Reader()
    try:
        for event in _events(_decoded(raw)):
            reader.take(event)
        reader.finish()
    except _EndError as end:
        reader.problems.add(end.problem)
    if reader.problems.shown:
        raise reader.problems.error(source)
    return Document(reader.data, reader.places, reader.keys)


class _EndError(Exception):
    """A problem after which nothing more can be read."""

    def __init__(self, problem: Problem) -> None:
        self.problem = problem
        super().__init__(problem.message)


@dataclass
class _Problems:
    """The first problems of a text, and the number of those that followed."""

    shown: list[Problem] = field(default_factory=list)
    hidden: int = 0

    def add(self, problem: Problem) -> None:
        if len(self.shown) < MAX_PROBLEMS:
            self.shown.append(problem)
        else:
            self.hidden += 1

    def error(self, source: str) -> DescriptionError:
        """The error to raise; the number of hidden problems stands last, at the last place."""
        if not self.hidden:
            return DescriptionError(self.shown, source)
        last = max((problem.line or 1, problem.column or 1) for problem in self.shown)
        more = Problem(f"{self.hidden} more found, not shown; mend those above first").at(*last)
        return DescriptionError([*self.shown, more], source)


@dataclass
class _Frame:
    """A list or mapping whose end has not been read yet."""

    values: list[object] | dict[str, object]
    path: Path
    lost: bool = False
    """Whether it stands in or behind a refused key, so that its values have no path."""
    awaits_key: bool = field(init=False)
    key: str | None = None
    """The key whose value comes next; None where that key was refused."""
    lines: dict[str, int] = field(default_factory=dict)
    """The line where each key stands first."""

    def __post_init__(self) -> None:
        self.awaits_key = isinstance(self.values, dict)

    def path_of(self, key: str) -> Path:
        """The path of an entry."""
        return self.path if self.lost else (*self.path, key)

    def next_path(self) -> Path:
        """The path of the value that comes next; the frame's own where that value has none."""
        if isinstance(self.values, list):
            return self.path if self.lost else (*self.path, len(self.values))
        return self.path if self.key is None else self.path_of(self.key)

    def put(self, value: object) -> None:
        """Append the value, or enter it under its key; a value without a key is dropped."""
        if isinstance(self.values, list):
            self.values.append(value)
            return
        if self.key is not None:
            self.values[self.key] = value
        self.awaits_key, self.key = True, None


class _Reader:
    """Builds the data from the events of a text, one at a time."""

    def __init__(self) -> None:
        self.data: object = None
        self.places: dict[Path, Place] = {}
        self.keys: dict[Path, Place] = {}
        self.problems = _Problems()
        self._frames: list[_Frame] = []
        self._documents = 0
        self._values = 0
        self._empty = True

    def take(self, event: yaml.Event) -> None:
        """Add what one event says."""
        if isinstance(event, yaml.DocumentStartEvent):
            self._start_document(event)
        elif isinstance(event, yaml.CollectionEndEvent):
            self._frames.pop()
        elif isinstance(event, yaml.NodeEvent):
            _refuse_half_characters(event)
            if self._frames and self._frames[-1].awaits_key:
                self._take_key(event, self._frames[-1])
            else:
                self._take_value(event)

    def finish(self) -> None:
        """Refuse a text that held no value at all."""
        if self._empty and not self.problems.shown:
            text = "the file is empty, or holds only comments; write a description in it"
            raise _EndError(Problem(text).at(1, 1))

    def _start_document(self, event: yaml.DocumentStartEvent) -> None:
        self._documents += 1
        if self._documents > 1:
            text = (
                "a second YAML document begins here; one file holds one description: "
                "remove the '---', or move what follows to a file of its own"
            )
            raise _EndError(Problem(text).at(*_place(event.start_mark)))

    def _take_value(self, event: yaml.NodeEvent) -> None:
        frame = self._frames[-1] if self._frames else None
        path = frame.next_path() if frame is not None else ()
        self._count(event, path)
        self._refuse_ornaments(event, path)
        value = self._value(event, path)
        self.places[path] = _place(event.start_mark)
        if frame is None:
            self.data = value
            self._empty = value is None and _text(event) == ""
        else:
            frame.put(value)
        if isinstance(value, list | dict):
            lost = frame is not None and path == frame.path
            self._open(event, _Frame(value, path, lost))

    def _value(self, event: yaml.NodeEvent, path: Path) -> object:
        """The value of a scalar, or an empty list or dict that later events fill."""
        if isinstance(event, yaml.CollectionStartEvent):
            return _container(event)
        if not _is_plain(event):
            return _text(event)
        value = _plain_value(_text(event))
        if isinstance(value, _Refusal):
            self._add(value.message, path, event)
            return None
        return value

    def _take_key(self, event: yaml.NodeEvent, frame: _Frame) -> None:
        """Keep the key for the value that follows, or refuse it and say why."""
        frame.awaits_key, frame.key = False, None
        self._refuse_ornaments(event, frame.path)
        if isinstance(event, yaml.CollectionStartEvent):
            self._add("a list or a mapping cannot be a key; a key is a name", frame.path, event)
            self._open(event, _Frame(_container(event), frame.path, lost=True))
        elif not isinstance(event, yaml.AliasEvent):
            frame.key = self._key(event, frame)

    def _key(self, event: yaml.NodeEvent, frame: _Frame) -> str | None:
        """The text of a scalar key; None where it cannot name an entry."""
        name = _text(event)
        if not name or (_is_plain(event) and name in _NULL):
            found = f"a key is {name} (null)" if name else "a key is empty"
            self._add(f"{found}; give the entry a name", frame.path, event)
            return None
        if _is_plain(event) and name == "<<":
            text = "the merge key '<<' is not accepted; write the merged entries out"
            self._add(text, frame.path, event)
            return None
        self._note_key(event, frame, name)
        return name

    def _note_key(self, event: yaml.NodeEvent, frame: _Frame, name: str) -> None:
        """Keep the place of a key, or refuse it where the mapping has it already."""
        path, place = frame.path_of(name), _place(event.start_mark)
        if name in frame.lines:
            first = f"the key {_shown(name)} already stands on line {frame.lines[name]}"
            self._add(f"{first}; remove or rename one of them", path, event, on_key=True)
        else:
            frame.lines[name] = place.line
            self.keys[path] = place

    def _refuse_ornaments(self, event: yaml.NodeEvent, path: Path) -> None:
        """Refuse an alias, an anchor, a tag."""
        if isinstance(event, yaml.AliasEvent):
            text = f"the alias {_shown('*' + (event.anchor or ''))} is not accepted"
            self._add(f"{text}; write the value out in its place", path, event)
        elif event.anchor is not None:
            text = f"the anchor {_shown('&' + event.anchor)} is not accepted"
            self._add(f"{text}; remove it, and write the value out where it is used", path, event)
        tag: str | None = getattr(event, "tag", None)
        if tag is not None:
            text = f"the tag {_shown(_written_tag(tag))} is not accepted"
            self._add(f"{text}; remove it, and quote the value if it is text", path, event)

    def _open(self, event: yaml.NodeEvent, frame: _Frame) -> None:
        if len(self._frames) == MAX_DEPTH:
            raise _EndError(Problem(_TOO_DEEP, frame.path).at(*_place(event.start_mark)))
        self._frames.append(frame)

    def _count(self, event: yaml.NodeEvent, path: Path) -> None:
        self._values += 1
        if self._values > MAX_VALUES:
            text = f"the file holds more than {MAX_VALUES} values; split it, or leave some out"
            raise _EndError(Problem(text, path).at(*_place(event.start_mark)))

    def _add(
        self, message: str, path: Path, event: yaml.NodeEvent, *, on_key: bool = False
    ) -> None:
        self.problems.add(Problem(message, path, on_key).at(*_place(event.start_mark)))


# Scalars


class _Refusal(NamedTuple):
    """Why a scalar has no value."""

    message: str


def _plain_value(text: str) -> bool | int | float | str | _Refusal | None:
    """The value of a plain scalar in the core schema of YAML 1.2, or why it is refused."""
    if text in _NULL:
        return None
    if text in _BOOL:
        return _BOOL[text]
    if integer := _INTEGER.fullmatch(text):
        return _integer(integer)
    if _FLOAT.fullmatch(text):
        value = float(text)
        if math.isfinite(value):
            return value
        return _Refusal(
            f"{_shown(text)} is beyond the largest float, about 1.8e308; write a number nearer to 0"
        )
    if _INFINITE.fullmatch(text):
        return _Refusal(f"{text!r} is infinite; write a finite number, or leave the entry out")
    if _NOT_A_NUMBER.fullmatch(text):
        return _Refusal(f"{text!r} is not a number; write a finite one, or leave the entry out")
    return text


def _integer(match: re.Match[str]) -> int | _Refusal:
    """The integer of a match of `_INTEGER`; its length is limited before it is converted."""
    base = match.lastgroup or "ten"
    digits = match[base]
    if len(digits) > MAX_DIGITS:
        return _Refusal(
            f"the integer {_shown(match[0])} has {len(digits)} digits, more than {MAX_DIGITS}; "
            "write it as a float, or quote it if it is text"
        )
    value = int(digits, _BASES[base])
    return -value if match[0].startswith("-") else value


def _is_plain(event: yaml.NodeEvent) -> bool:
    """Whether a scalar has no quotes, no block mark and no tag; an alias is a plain nothing."""
    return not getattr(event, "style", None) and getattr(event, "tag", None) is None


def _container(event: yaml.CollectionStartEvent) -> list[object] | dict[str, object]:
    """The empty list or dict that a list or mapping begins with."""
    return [] if isinstance(event, yaml.SequenceStartEvent) else {}


def _text(event: yaml.NodeEvent) -> str:
    """The characters of a scalar; none for anything else."""
    return event.value if isinstance(event, yaml.ScalarEvent) else ""


def _refuse_half_characters(event: yaml.NodeEvent) -> None:
    """Raise where an escape such as "\\ud800" leaves half a character in a text."""
    if _HALF_CHARACTER.search(_text(event)):
        text = "an escape in this text is half a character (\\ud800 to \\udfff); write it in full"
        raise _EndError(Problem(text).at(*_place(event.start_mark)))


def _written_tag(tag: str) -> str:
    """A tag as a person writes it."""
    if tag.startswith("tag:yaml.org,2002:"):
        return "!!" + tag.removeprefix("tag:yaml.org,2002:")
    return tag if tag.startswith("!") else f"!<{tag}>"


def _shown(text: str) -> str:
    """The text in quotes, with the end left out where it is long."""
    return repr(text if len(text) <= 40 else text[:39] + "…")


# Text and syntax


def _decoded(raw: bytes) -> str:
    """The text of the file; raises at the first byte that is no readable UTF-8."""
    if len(raw) > MAX_BYTES:
        text = f"the file has {len(raw)} bytes; a description has {MAX_BYTES} (4 MiB) at most"
        raise _EndError(Problem(text).at(1, 1))
    mark = len(codecs.BOM_UTF8) if raw.startswith(codecs.BOM_UTF8) else 0
    end = len(raw)
    try:
        text = raw[mark:].decode()
    except UnicodeDecodeError as error:
        end = mark + error.start
        text = raw[mark:end].decode()
    if found := _UNREADABLE.search(text):
        text = text[: found.start()]
        code, offset = ord(found[0]), mark + len(text.encode())
        name = f"character U+{code:04X}" if code > 0x7F else f"byte 0x{code:02x}"
    elif end < len(raw):
        name, offset = f"byte 0x{raw[end]:02x}", end
    else:
        return text
    message = f"not a text file: {name} at offset {offset}; a description is UTF-8 YAML"
    raise _EndError(Problem(message).at(*_place_after(text)))


def _place_after(text: str) -> Place:
    """The place of the character that follows the text."""
    line, start = 1, 0
    for end in _LINE_END.finditer(text):
        line, start = line + 1, end.end()
    return Place(line, len(text) - start + 1)


def _place(mark: object) -> Place:
    """The place of a mark of PyYAML, which counts from 0; (1, 1) where there is none."""
    return Place(getattr(mark, "line", 0) + 1, getattr(mark, "column", 0) + 1)


def _events(text: str) -> Iterator[yaml.Event]:
    """The events of the text; raises `_EndError` where the text is not YAML."""
    try:
        yield from yaml.parse(text, Loader=_LOADER)
    except yaml.MarkedYAMLError as error:
        raise _EndError(_syntax_problem(error, text)) from None
    except (yaml.YAMLError, ValueError, OverflowError) as error:
        # The loader in Python lets ValueError and OverflowError of "\UFFFFFFFF" or of a long
        # %YAML version through; a ReaderError has a position instead of a mark.
        place = _place_after(text[: getattr(error, "position", 0)])
        reason = str(error).partition("\n")[0]
        raise _EndError(Problem(f"not valid YAML: {reason}").at(*place)) from None


class _Words(NamedTuple):
    """What to say for a message of PyYAML that holds a fragment."""

    fragment: str
    message: str
    at_start: bool = False
    """Whether the fault is where the unfinished thing begins, not where PyYAML gave up."""


_TAB = "a tab stands where YAML accepts only spaces (indentation); replace it with spaces"
_DISCORD = "this does not continue the entries above; check indentation, quotes and ':' around here"

# libyaml and the loader in Python word their messages differently; a fragment fits both.
_WORDS = (
    _Words("tab character", _TAB),
    _Words(
        "values are not allowed",
        "a ':' gives this value a second key; put that entry on its own line, aligned with its "
        "neighbours, or quote the value if it is text",
    ),
    _Words(
        "sequence entries are not allowed",
        "a list item '- ' cannot begin here; put it on its own line, aligned with its neighbours",
    ),
    _Words(
        "',' or ']'",
        "a list in brackets lacks a ',' or its closing ']' here" + QUOTES,
    ),
    _Words(
        "',' or '}'",
        "a mapping in braces lacks a ',' or its closing '}' here" + QUOTES,
    ),
    _Words("expected ':'", "this line is no entry: write 'key: value'", at_start=True),
    _Words(
        "unexpected end of stream",
        "the quote that opens here is never closed; close it",
        at_start=True,
    ),
    _Words(
        "unknown escape",
        "unknown escape in a text in double quotes; write two backslashes for one, or use single "
        "quotes",
    ),
    _Words(
        "node content", "a key or a value is missing here, or a ',' or a bracket is one too many"
    ),
    _Words(
        "<document start>",
        "text stands after the end of the document; one file holds one description",
    ),
    _Words("expected key", _DISCORD),
    # newer libyaml counts by itself, and reads ahead of the events
    _Words("maximum nesting depth", _TOO_DEEP),
    _Words("'-' indicator", _DISCORD),
    _Words("<block end>", _DISCORD),
)


def _syntax_problem(error: yaml.MarkedYAMLError, text: str) -> Problem:
    """A syntax error of PyYAML in plain words, at its place."""
    place = _place(error.problem_mark or error.context_mark)
    start = _place(error.context_mark) if error.context_mark else place
    reason = error.problem or "the text cannot be read"
    if "cannot start any token" in reason:
        return Problem(_strange_start(_character(text, place))).at(*place)
    unknown = _Words("", f"not valid YAML: {reason}")
    words = next((words for words in _WORDS if words.fragment in reason), unknown)
    if words.at_start:
        return Problem(words.message).at(*start)
    if start.line == place.line or words.message == _TAB:
        return Problem(words.message).at(*place)
    return Problem(f"{words.message} (in what begins on line {start.line})").at(*place)


def _strange_start(character: str) -> str:
    """The message for a character that begins no YAML value."""
    if character == "\t":
        return _TAB
    return f"the character {character!r} cannot begin a value; quote the value if it is text"


def _character(text: str, place: Place) -> str:
    """The character at a place of the text; none past the end of the line."""
    line = _LINE_END.split(text, maxsplit=place.line)[place.line - 1]
    return line[place.column - 1 : place.column]
