"""The page on actuators tells every law and every number, and what is needed."""

import re
from pathlib import Path

import pytest

from gough.actuators import LAWS
from gough.actuators.base import unit_of

PAGE = (Path(__file__).parents[2] / "docs" / "actuators.md").read_text("utf-8")
SECTIONS = dict(re.findall(r"^## `([\w-]+)`\n(.*?)(?=^## )", PAGE, re.MULTILINE | re.DOTALL))


def rows(law):
    """The cells of the law's table by the number's name."""
    for line in SECTIONS[law].splitlines():
        if line.startswith("| ") and "`" in line:
            cells = [cell.strip() for cell in line.strip("|").split(" | ")]
            for bold, name in re.findall(r"(\*\*)?`(\w+)`", cells[0]):
                yield name, bool(bold), cells


def test_the_page_tells_the_laws_in_their_order():
    assert list(SECTIONS) == list(LAWS)


@pytest.mark.parametrize("law", LAWS)
def test_the_page_tells_every_number_with_unit_and_default(law):
    told = {name: (bold, cells) for name, bold, cells in rows(law)}
    numbers = LAWS[law].numbers
    assert told.keys() == numbers.keys()
    for name, (bold, cells) in told.items():
        assert bold == numbers[name].required
        unit = unit_of(numbers[name].unit, "m")
        assert unit in cells[2]
        if numbers[name].default is not None:
            assert cells[3].strip("| ") == f"{numbers[name].default:g}"
