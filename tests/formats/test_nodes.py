"""Reading YAML: the data, the place of every value, and every problem at once."""

from __future__ import annotations

import subprocess
import sys
from unittest import mock

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from gough.errors import DescriptionError, Path, Problem
from gough.formats import nodes
from gough.formats.nodes import Document, compose

LOADERS = [yaml.SafeLoader, *([yaml.CSafeLoader] if yaml.__with_libyaml__ else [])]


@pytest.fixture(params=LOADERS)
def loader(request, monkeypatch):
    """Each loader of PyYAML in turn; their messages and places differ in small ways."""
    monkeypatch.setattr(nodes, "_LOADER", request.param)
    return request.param


def read(text: str) -> Document:
    return compose(text.encode(), "robot.yaml")


def data(text: str) -> object:
    return read(text).data


def problems(text: str | bytes) -> tuple[Problem, ...]:
    with pytest.raises(DescriptionError) as caught:
        compose(text if isinstance(text, bytes) else text.encode(), "robot.yaml")
    return caught.value.problems


def only(text: str | bytes) -> Problem:
    found = problems(text)
    assert len(found) == 1, [problem.text("robot.yaml") for problem in found]
    return found[0]


def place(problem: Problem) -> tuple[int | None, int | None]:
    return problem.line, problem.column


# What is read


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("", None), ("~", None), ("null", None), ("Null", None), ("NULL", None),
        ("true", True), ("True", True), ("TRUE", True),
        ("false", False), ("False", False), ("FALSE", False),
        ("0", 0), ("-3", -3), ("+3", 3), ("010", 10), ("0o17", 15), ("0x1F", 31),
        ("1" * 40, int("1" * 40)),
        ("1.5", 1.5), ("1e-3", 1e-3), (".5", 0.5), ("1.", 1.0), ("-1.E+2", -100.0),
        ("1e308", 1e308), ("1e-999", 0.0), ("0." + "3" * 60, 1 / 3),
    ],
)  # fmt: skip
def test_plain_scalars_follow_the_core_schema(loader, text, value):
    read_back = data(f"a: {text}\n")["a"]
    assert read_back == value
    assert type(read_back) is type(value)


@pytest.mark.parametrize(
    "text",
    [
        "no", "yes", "on", "off", "y", "nULL", "tRUE", "1:30", "2001-01-01", "1_000", "0b1", "0o8",
        "-0x1F", "1e", ".", "inf", "nan", "-.nan", "=", "1 2", "hip",
    ],
)  # fmt: skip
def test_other_plain_scalars_are_text(loader, text):
    assert data(f"a: {text}\n") == {"a": text}


@pytest.mark.parametrize("text", ["1", "true", "null", ".nan", "1e999", "<<", "&a", "!!str", ""])
def test_quoted_scalars_are_text(loader, text):
    assert data(f"'{text}'") == text
    assert data(f'"{text}"') == text


def test_block_scalars_are_text(loader):
    assert data("a: |-\n  12\nb: >-\n  .inf\n") == {"a": "12", "b": ".inf"}


def test_keys_are_always_text(loader):
    assert data("1: a\nno: b\n1e999: c\n'null': d\n") == {
        "1": "a", "no": "b", "1e999": "c", "null": "d",
    }  # fmt: skip


@pytest.mark.parametrize("root", ["null", "3", "text", "[1, 2]", "--- {a: 1}\n...\n"])
def test_the_document_may_be_any_value(loader, root):
    assert data(root) == yaml.safe_load(root)


def test_a_byte_order_mark_is_accepted_and_not_counted(loader):
    document = compose(b"\xef\xbb\xbfa: 1\n", "robot.yaml")
    assert document.data == {"a": 1}
    assert document.places[("a",)] == (1, 4)


PLAIN = (
    st.none()
    | st.booleans()
    | st.integers(-(10**40) + 1, 10**40 - 1)
    | st.floats(allow_nan=False, allow_infinity=False)
)
# YAML 1.1, which `safe_dump` writes, leaves some texts without quotes that 1.2 reads as numbers.
TEXTS = st.text().filter(lambda text: nodes._plain_value(text) == text)
VALUES = st.recursive(
    PLAIN | TEXTS,
    lambda inner: st.lists(inner) | st.dictionaries(TEXTS.filter(bool), inner),
    max_leaves=20,
)


@given(VALUES, st.booleans())
@settings(max_examples=150, deadline=None)
def test_what_yaml_dumps_is_read_back_with_a_place_for_every_value(value, flow):
    text = yaml.safe_dump(value, default_flow_style=flow)
    document = compose(text.encode(), "dump.yaml")
    assert document.data == value
    assert set(document.places) == {()} | set(paths(value))
    assert set(document.keys) == {path for path in paths(value) if isinstance(path[-1], str)}


def paths(value: object, path: Path = ()) -> list[Path]:
    entries = (
        value.items() if isinstance(value, dict) else enumerate(value)
        if isinstance(value, list) else ()
    )  # fmt: skip
    below = [((*path, key), inner) for key, inner in entries]
    return [found for here, inner in below for found in (here, *paths(inner, here))]


# Places

LEGS = """\
# a comment
name: Пример
legs:
  - {base: [0, 1.5], 'kind': prismatic}
  - base:
      - 2
"""


def test_places_of_values_and_keys(loader):
    document = read(LEGS)
    assert document.places == {
        (): (2, 1),
        ("name",): (2, 7),
        ("legs",): (4, 3),
        ("legs", 0): (4, 5),
        ("legs", 0, "base"): (4, 12),
        ("legs", 0, "base", 0): (4, 13),
        ("legs", 0, "base", 1): (4, 16),
        ("legs", 0, "kind"): (4, 30),
        ("legs", 1): (5, 5),
        ("legs", 1, "base"): (6, 7),
        ("legs", 1, "base", 0): (6, 9),
    }
    assert document.keys == {
        ("name",): (2, 1),
        ("legs",): (3, 1),
        ("legs", 0, "base"): (4, 6),
        ("legs", 0, "kind"): (4, 22),
        ("legs", 1, "base"): (5, 5),
    }


@pytest.mark.parametrize(
    ("path", "on_key", "expected"),
    [
        (("legs", 0, "kind"), False, (4, 30)),
        (("legs", 0, "kind"), True, (4, 22)),
        (("legs", 0, "base", 1), True, (4, 16)),  # an item of a list has no key
        (("legs", 1, "kind"), False, (5, 5)),  # a missing entry stands where its mapping begins
        (("legs", 7, "base", 3), False, (4, 3)),
        (("unknown",), False, (2, 1)),
        ((), True, (2, 1)),
    ],
)
def test_a_problem_is_located_at_the_nearest_known_path(path, on_key, expected):
    problem = Problem("wrong", path, on_key)
    assert read(LEGS).locate(problem) == problem.at(*expected)


def test_a_problem_is_located_at_the_start_where_nothing_fits():
    assert place(Document(None, {}, {}).locate(Problem("wrong", ("a",)))) == (1, 1)


# Not a text file


@pytest.mark.parametrize(
    ("raw", "named", "offset", "expected"),
    [
        (b"a: 1\nb: 'x\x00y'", "byte 0x00", 10, (2, 6)),
        (b"\xff\xfea\x00", "byte 0xff", 0, (1, 1)),
        ("é: 1\r\nü: ".encode() + b"\xe9", "byte 0xe9", 11, (2, 4)),
        (b"\xef\xbb\xbfa\x1b", "byte 0x1b", 4, (1, 2)),
        (b"a\x7f\xff", "byte 0x7f", 1, (1, 2)),
        ("a: x\u2028y".encode(), "character U+2028", 4, (1, 5)),
        ("a\ufeff: 1".encode(), "character U+FEFF", 1, (1, 2)),
        ("a: \x85".encode(), "character U+0085", 3, (1, 4)),
    ],
)
def test_bytes_that_are_no_text_are_named(raw, named, offset, expected):
    problem = only(raw)
    assert problem.message == (
        f"not a text file: {named} at offset {offset}; a description is UTF-8 YAML"
    )
    assert place(problem) == expected


@pytest.mark.parametrize("text", ["", "\n\n", "# nothing\n", "---\n", "%YAML 1.2\n---\n...\n"])
def test_an_empty_file_is_refused(loader, text):
    problem = only(text)
    assert "the file is empty" in problem.message
    assert place(problem) == (1, 1)


def test_a_second_document_is_refused(loader):
    problem = only("a: 1\n---\nb: 2\n---\nc: 3\n")
    assert "second YAML document" in problem.message
    assert place(problem) == (2, 1)


# Limits


def test_a_file_over_the_limit_is_refused_before_it_is_parsed(monkeypatch):
    monkeypatch.setattr(nodes, "_events", None)
    problem = only(b"\x00" * (nodes.MAX_BYTES + 1))
    assert problem.message.startswith("the file has 4194305 bytes")
    assert place(problem) == (1, 1)


def test_nesting_is_limited(loader):
    deepest = "[" * nodes.MAX_DEPTH + "]" * nodes.MAX_DEPTH
    assert isinstance(data(deepest), list)
    problem = only(f"a:\n  {deepest}")
    assert "more than 64 levels deep" in problem.message
    assert place(problem) == (2, 3 + nodes.MAX_DEPTH - 1)
    assert problem.path == ("a", *[0] * (nodes.MAX_DEPTH - 1))


def test_the_number_of_values_is_limited(monkeypatch):
    monkeypatch.setattr(nodes, "MAX_VALUES", 4)
    assert data("[1, 2, 3]") == [1, 2, 3]
    problem = only("a: 1\nb:\n  - x\n  - {c: 2}")
    assert "more than 4 values" in problem.message
    assert problem.path == ("b", 1)
    assert place(problem) == (4, 5)


@pytest.mark.parametrize("opening", ["[", "{", "- ", "? ", "[{a: ", "a:\n"])
def test_ten_thousand_levels_are_refused(loader, opening):
    problems(opening * 10_000)


@pytest.mark.skipif(not yaml.__with_libyaml__, reason="the loader in Python is slow")
@pytest.mark.parametrize("piece", ["- 1.25\n", "- [1, 2]\n", "- *a\n", "- 9e999\n", "-\n", "? -\n"])
def test_a_file_of_the_largest_size_is_read_or_refused(piece):
    raw = (piece * (nodes.MAX_BYTES // len(piece))).encode()
    assert len(problems(raw)) <= nodes.MAX_PROBLEMS + 1


@pytest.mark.skipif(not yaml.__with_libyaml__, reason="the loader in Python is slow")
@pytest.mark.parametrize("digit", ["7", ".7", "x", "é", "x\n  "])
def test_a_scalar_of_the_largest_size_is_read_or_refused(digit):
    size = nodes.MAX_BYTES // len(digit.encode()) - 4
    try:
        compose(f"a: {digit * size}".encode(), "robot.yaml")
    except DescriptionError as error:
        assert len(str(error)) < 200


@pytest.mark.skipif(not yaml.__with_libyaml__, reason="the loader in Python is slow")
def test_as_many_values_as_allowed_are_read():
    row = "- [" + "1.25, " * 98 + "2]\n"
    assert len(data(row * 1999)) == 1999


# Refused values


@pytest.mark.parametrize(
    ("literal", "says"),
    [
        (".inf", "'.inf' is infinite"),
        ("+.Inf", "'+.Inf' is infinite"),
        ("-.INF", "'-.INF' is infinite"),
        (".nan", "'.nan' is not a number"),
        (".NaN", "'.NaN' is not a number"),
        (".NAN", "'.NAN' is not a number"),
        ("1e999", "'1e999' is beyond the largest float"),
        ("-1" + "0" * 400 + ".", f"'-1{'0' * 37}…' is beyond the largest float"),
        ("9" * 41, f"the integer '{'9' * 39}…' has 41 digits, more than 40"),
        ("0x" + "F" * 41, f"the integer '0x{'F' * 37}…' has 41 digits, more than 40"),
        ("-" + "9" * 5000, f"the integer '-{'9' * 38}…' has 5000 digits, more than 40"),
    ],
)
def test_numbers_without_a_finite_value_are_refused(loader, literal, says):
    problem = only(f"joints:\n  - mass: {literal}\n")
    assert problem.message.startswith(says)
    assert problem.path == ("joints", 0, "mass")
    assert place(problem) == (2, 11)


@pytest.mark.parametrize(
    ("value", "says"),
    [
        ("&x 1", "the anchor '&x' is not accepted"),
        ("*x", "the alias '*x' is not accepted"),
        ("!!str x", "the tag '!!str' is not accepted"),
        ("!!python/object/apply:os.system [x]", "the tag '!!python/object/apply:os.system' is not"),
        ("!local {x: 1}", "the tag '!local' is not accepted"),
        ("!<x> 1", "the tag '!<x>' is not accepted"),
        ("! 1", "the tag '!' is not accepted"),
    ],
)
def test_anchors_aliases_and_tags_are_refused(loader, value, says):
    problem = only(f"a:\n  - {value}\n")
    assert problem.message.startswith(says)
    assert problem.path == ("a", 0)
    assert place(problem) == (2, 5)


def test_a_billion_laughs_stay_unheard(loader):
    lines = ["a0: &a0 [lol]"]
    lines += [f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 9)}]" for i in range(1, 30)]
    found = problems("\n".join(lines))
    assert len(found) == nodes.MAX_PROBLEMS + 1


@pytest.mark.parametrize(
    ("text", "says", "expected"),
    [
        ("a:\n  <<: {b: 1}\n", "the merge key '<<' is not accepted", (2, 3)),
        ("a:\n  ? [1, 2]\n  : 1\n", "a list or a mapping cannot be a key", (2, 5)),
        ("a:\n  {b: 1}: 1\n", "a list or a mapping cannot be a key", (2, 3)),
        ("a:\n  null: 1\n", "a key is null (null)", (2, 3)),
        ("a:\n  ~: 1\n", "a key is ~ (null)", (2, 3)),
        ("a:\n  '': 1\n", "a key is empty", (2, 3)),
        ("a:\n  ?\n  : 1\n", "a key is empty", (2, 4)),
        ("a:\n  *x : 1\n", "the alias '*x' is not accepted", (2, 3)),
        ("a:\n  &x b: 1\n", "the anchor '&x' is not accepted", (2, 3)),
        ("a:\n  !!str b: 1\n", "the tag '!!str' is not accepted", (2, 3)),
    ],
)
def test_keys_that_are_no_names_are_refused(loader, text, says, expected):
    problem = only(text)
    assert problem.message.startswith(says)
    assert problem.path == ("a",)
    assert place(problem) == expected


def test_duplicate_keys_name_the_line_of_the_first(loader):
    found = problems("legs:\n  hip: 1\n  knee: 2\n  'hip': 3\n  hip: {hip: 4}\n")
    assert [place(problem) for problem in found] == [(4, 3), (5, 3)]
    for problem in found:
        assert problem.message.startswith("the key 'hip' already stands on line 2")
        assert problem.path == ("legs", "hip")
        assert problem.on_key


@pytest.mark.parametrize(
    "text",
    ["a: {x: 1}\na: {x: 2}", "? {a: 1}\n: {a: 1}\na: 1", "null: {a: 1}\na: 1", "<<: {a: 1}\na: 1"],
)
def test_keys_behind_a_refused_key_are_not_taken_for_duplicates(loader, text):
    only(text)


# Syntax


@pytest.mark.parametrize(
    ("text", "says", "expected"),
    [
        ("a: [1, 2\nb: 3\n", "a list in brackets lacks a ',' or its closing ']'", (2, 2)),
        ("a: {b: 1\nc: 2\n", "a mapping in braces lacks a ',' or its closing '}'", (2, 2)),
        ("a: b: c\n", "a ':' gives this value a second key", (1, 5)),
        ("a: 1\n b: 2\n", "a ':' gives this value a second key", (2, 3)),
        ("a: - b\n", "a list item '- ' cannot begin here", (1, 4)),
        ("a: 1\nb\n", "this line is no entry: write 'key: value'", (2, 1)),
        ("a: 1\nb: 'x\nc: 2\n", "the quote that opens here is never closed", (2, 4)),
        ("a: @x\n", "the character '@' cannot begin a value", (1, 4)),
        ("a: [1,, 2]\n", "a key or a value is missing here", (1, 7)),
        ("a: ]\n", "a key or a value is missing here", (1, 4)),
        ("a:\n  b: 1\n c: 2\n", "this does not continue the entries above", (3, 2)),
        ("- a\nb: 1\n", "this does not continue the entries above", (2, 1)),
        ('a: "x" y\n', "this does not continue the entries above", (1, 8)),
        ("a: 1\n...\nb: 2\n", "text stands after the end of the document", (3, 1)),
        ("%YAML 2.0\n---\na: 1\n", "not valid YAML: found incompatible YAML", (1, 1)),
        ("a: 1\nb: *\n", "not valid YAML: ", (2, 5)),
    ],
)
def test_syntax_errors_are_told_in_plain_words(loader, text, says, expected):
    problem = only(text)
    assert problem.message.startswith(says)
    assert place(problem) == expected


def test_unknown_escapes_are_told_in_plain_words(loader):
    problem = only('a: "C:\\dir"\n')
    assert problem.message.startswith("unknown escape in a text in double quotes")
    assert problem.line == 1


def test_a_syntax_error_names_the_line_where_the_unfinished_value_begins(loader):
    assert only("a:\n  [1,\n  2\nb: 3\n").message.endswith("(in what begins on line 2)")


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("a:\n\t- 1\n", (2, 1)),
        ("\ta: 1\n", (1, 1)),
        ("a:\n  b: 1\n\tc: 2\n", (3, 1)),
        ("a:\n  b: 'x'\n \tc: 2\n", (3, 2)),
        ("a: |\n\ttext\n", (2, 1)),
        ("a:\r\n\t- 1\r\n", (2, 1)),
    ],
)
def test_tabs_as_indentation_are_named(loader, text, expected):
    problem = only(text)
    assert problem.message == (
        "a tab stands where YAML accepts only spaces (indentation); replace it with spaces"
    )
    assert place(problem) == expected


@pytest.mark.parametrize("escape", [r"\ud800", r"\UFFFFFFFF"])
def test_escapes_that_are_no_character_are_refused(loader, escape):
    assert only(f'"{escape}"').line == 1


# All problems at once

MANY = """\
a: &x 1e999
b: [*x, !!int 3, .nan]
a: 2
<<: 1
c: [1
"""


def test_every_problem_is_reported_together_with_the_syntax_error_that_ends_the_text(loader):
    assert [(place(problem), problem.path) for problem in problems(MANY)] == [
        ((1, 4), ("a",)),
        ((1, 4), ("a",)),
        ((2, 5), ("b", 0)),
        ((2, 9), ("b", 1)),
        ((2, 18), ("b", 2)),
        ((3, 1), ("a",)),
        ((4, 1), ()),
        ((6, 1), ()),
    ]


def test_the_error_reads_as_one_line_for_each_problem():
    with pytest.raises(DescriptionError) as caught:
        compose(b"hip: .inf\nhip: 1\n", "robot.yaml")
    assert str(caught.value) == (
        "robot.yaml:1:6: hip: '.inf' is infinite; write a finite number, or leave the entry out\n"
        "robot.yaml:2:1: hip: the key 'hip' already stands on line 1; remove or rename one of them"
    )
    assert caught.value.source == "robot.yaml"


@pytest.mark.parametrize("excess", [0, 1, 12])
def test_the_number_of_problems_is_limited(excess):
    found = problems("- .nan\n" * (nodes.MAX_PROBLEMS + excess))
    assert len(found) == nodes.MAX_PROBLEMS + bool(excess)
    if excess:
        assert found[-1].message == f"{excess} more found, not shown; mend those above first"


# Any input

YAML_LIKE = st.text("[]{}-:?&*!|>'\"%@#,.~<\\ \t\r\n01ab\0é", max_size=60).map(str.encode)


@pytest.mark.parametrize("yaml_loader", LOADERS)
@given(raw=st.binary() | YAML_LIKE)
@settings(max_examples=400, deadline=None)
def test_any_bytes_are_read_or_refused(yaml_loader, raw):
    with mock.patch.object(nodes, "_LOADER", yaml_loader):
        try:
            document = compose(raw, "any.yaml")
        except DescriptionError as error:
            assert error.problems
            assert all(problem.line and problem.column for problem in error.problems)
        else:
            assert set(document.places) == {()} | set(paths(document.data))


def test_the_module_loads_without_libyaml():
    code = (
        "import yaml; del yaml.CSafeLoader\n"
        "from gough.formats import nodes\n"
        "assert nodes._LOADER is yaml.SafeLoader\n"
        "assert nodes.compose(b'a: 1', 'x').data == {'a': 1}\n"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
