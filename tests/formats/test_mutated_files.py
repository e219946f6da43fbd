"""Catalogue files with random damage end in a robot or in an error of ours, never in another."""

import copy
import re

import yaml
from hypothesis import given
from hypothesis import strategies as st

from gough import GoughError, Robot, catalogue
from gough.formats.native import Source

FILES = {name: catalogue.file(name).read_bytes() for name in catalogue.names()}
SMALL = 40
"""Analyse what has fewer variables; larger ones are only built."""

scalars = st.sampled_from(
    [
        None,
        True,
        -1,
        0,
        1e-300,
        1e300,
        3,
        "x",
        "pi/0",
        "a",
        "",
        "B[9]",
        "i",
        [],
        {},
        [1, 2],
        "∞",
        "-",
    ]
)


def judged(raw):
    """Everything a user would do with the file."""
    try:
        source = Source(raw, "mutated.yaml")
        mechanism = source.mechanism()
        robot = source.locating(lambda: Robot(mechanism))
        if len(robot.structure.variables) < SMALL:
            str(robot.analyse())
            robot.analyse().as_dict()
    except GoughError as error:
        assert str(error)


@st.composite
def damaged_text(draw):
    raw = draw(st.sampled_from(sorted(FILES.values())))
    for _ in range(draw(st.integers(1, 4))):
        at = draw(st.integers(0, len(raw)))
        length = draw(st.integers(0, 12))
        raw = raw[:at] + draw(st.binary(max_size=6)) + raw[at + length :]
    return raw


@st.composite
def swapped_words(draw):
    text = draw(st.sampled_from(sorted(FILES.values()))).decode()
    words = sorted(set(re.findall(r"[\w.]+", text)))
    for _ in range(draw(st.integers(1, 3))):
        old, new = draw(st.sampled_from(words)), draw(st.sampled_from(words))
        text = re.sub(rf"\b{re.escape(old)}\b", new, text, count=draw(st.integers(0, 2)))
    return text.encode()


def places(data, path=()):
    """Paths to every value of nested data."""
    yield path
    items = data.items() if isinstance(data, dict) else enumerate(data)
    for key, value in items if isinstance(data, dict | list) else ():
        yield from places(value, (*path, key)) if isinstance(value, dict | list) else [(*path, key)]


@st.composite
def changed_values(draw):
    """A description with some values replaced, dropped or repeated elsewhere."""
    data = yaml.safe_load(draw(st.sampled_from(sorted(FILES.values()))))
    for _ in range(draw(st.integers(1, 3))):
        path = draw(st.sampled_from([p for p in places(data) if p]))
        parent = data
        for key in path[:-1]:
            parent = parent[key]
        match draw(st.sampled_from(["replace", "drop", "copy"])):
            case "replace":
                parent[path[-1]] = copy.deepcopy(draw(scalars))
            case "drop":
                del parent[path[-1]]
            case "copy":
                parent[path[-1]] = copy.deepcopy(data[draw(st.sampled_from(sorted(data)))])
        if not data:
            break
    return yaml.dump(data, Dumper=NoAliases, allow_unicode=True).encode()


class NoAliases(yaml.SafeDumper):
    def ignore_aliases(self, _):
        return True


@given(damaged_text())
def test_damaged_text(raw):
    judged(raw)


@given(swapped_words())
def test_swapped_words(raw):
    judged(raw)


@given(changed_values())
def test_changed_values(raw):
    judged(raw)
