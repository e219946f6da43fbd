"""The report: what its folder holds, that it stands alone, and that it is whole or not there."""

from __future__ import annotations

import json
import re
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gough.description import Body, Joint, Mechanism
from gough.errors import ClosureError
from gough.robot import Robot, load
from gough.studies import StudyError, study
from gough.studies.context import Context
from gough.studies.html import EMPTY, element, page, written
from gough.studies.report import Paragraph, Section, Table
from gough.studies.sections import subject
from gough.studies.sweep import Sweep, sweep

POINTS = 5
PICTURES = {
    "four-bar": ["working-modes"],
    "2rpr": ["efforts-by-part", "efforts-by-kind", "velocity-factors"],
    "five-bar": ["efforts-by-part", "efforts-by-kind", "working-modes", "velocity-factors"],
}


class Balance(HTMLParser):
    """Fails on an element that is not closed, or closed twice."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.seen: list[str] = []
        self.ids: list[str] = []
        self.targets: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.seen.append(tag)
        self.ids += [value or "" for name, value in attrs if name == "id"]
        self.targets += [value or "" for name, value in attrs if name in ("href", "src")]
        if tag not in EMPTY:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open, f"</{tag}> closes nothing"
        assert self.open.pop() == tag


def parsed(text: str) -> Balance:
    balance = Balance()
    balance.feed(text)
    balance.close()
    assert not balance.open
    return balance


def strict(text: str) -> Any:
    """The JSON value, where NaN and Infinity are no JSON."""

    def refuse(name: str) -> None:
        raise AssertionError(name)

    return json.loads(text, parse_constant=refuse)


@pytest.fixture(scope="module", params=["four-bar", "2rpr", "five-bar"])
def report(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("study") / request.param
    assert study(load(request.param), folder, points=POINTS) == folder / "report.html"
    return folder


def test_the_folder_holds_page_data_and_pictures_and_nothing_else(report: Path) -> None:
    found = {str(p.relative_to(report)) for p in report.rglob("*") if p.is_file()}
    names = ["robot", "singular-values", "sweep", "assembly-modes", *PICTURES[report.name]]
    pictures = {f"pictures/{name}.{kind}" for name in names for kind in ("svg", "png")}
    assert found == {"report.html", "report.json"} | pictures
    assert all(path.stat().st_size > 1000 for path in report.rglob("*.*") if path.is_file())


def test_the_page_is_balanced_and_stands_alone(report: Path) -> None:
    text = (report / "report.html").read_text(encoding="utf-8")
    assert "http" not in text
    page = parsed(text)
    assert not {"script", "link", "iframe"} & set(page.seen)
    assert len(page.ids) == len(set(page.ids))
    for target in page.targets:
        assert target.startswith("data:image/svg+xml") or target[1:] in page.ids
    assert len(text) < 3_000_000


def test_the_data_say_what_the_page_says(report: Path) -> None:
    data = strict((report / "report.json").read_text(encoding="utf-8"))
    robot = load(report.name)
    assert data["command"] == f"gough study {report.name} --points 5"
    assert data["analysis"]["mobility"] == robot.analyse().mobility
    np.testing.assert_allclose(data["home"]["q"], robot.home.q, rtol=1e-12)
    for picture in data["pictures"]:
        assert all((report / file).exists() for file in picture["files"])


def test_a_study_is_the_same_twice_but_for_the_date(report: Path, tmp_path: Path) -> None:
    study(load(report.name), tmp_path, points=POINTS)
    date = re.compile(rb"\d{4}-\d\d-\d\d \d\d:\d\d UTC")
    for name in ("report.html", "report.json", "pictures/robot.svg"):
        first, second = ((folder / name).read_bytes() for folder in (report, tmp_path))
        assert date.sub(b"", first) == date.sub(b"", second)


def test_points_out_of_reach_are_null(tmp_path: Path) -> None:
    study(load("four-bar"), tmp_path, points=POINTS)
    found = strict((tmp_path / "report.json").read_text(encoding="utf-8"))["sweep"]
    reached = np.array(found["reached"])
    assert 0 < reached.sum() < reached.size
    assert [value is not None for value in found["sigma_A"]] == reached.tolist()


# robots with less


def pendulum(**more: Any) -> Robot:
    pin = Joint(type="revolute", bodies=("base", "rod"), actuated=True)
    bodies = {"rod": Body(mass=1.0)}
    return Robot(Mechanism(name="a <b> & c", bodies=bodies, joints={"pin": pin}, **more))


@pytest.mark.parametrize("floating", [False, True])
def test_a_tree_without_outputs_gets_a_report_that_says_so(tmp_path: Path, floating: bool) -> None:
    study(pendulum(floating=floating), tmp_path)
    text = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "the mechanism has no operational coordinates" in text
    assert "a &lt;b&gt; &amp; c" in text
    assert "gough study FILE.yaml" in text
    parsed(text)
    data = strict((tmp_path / "report.json").read_text(encoding="utf-8"))
    assert data["sweep"] is None
    assert Mechanism.model_validate(data["description"]) == pendulum(floating=floating).mechanism


@pytest.mark.parametrize("name", ["3-upu", "2rpr-slider", "4-rpr", "3-rps"])
def test_robots_with_odd_actuation_or_outputs_get_a_sweep(name: str) -> None:
    robot = load(name)
    found = sweep(robot, robot.analyse(), POINTS, lambda message: None)
    assert isinstance(found, Sweep)
    assert found.reached[found.home]


def triangle(third: float) -> Mechanism:
    """Three bars, two of them 1 m long: a structure, or open."""
    joints = {
        "A": {"type": "revolute", "bodies": ("base", "a"), "home": 1.0},
        "B": {"type": "revolute", "bodies": ("a", "b"), "frames": ({"point": (1, 0)}, {})},
        "C": {
            "type": "revolute",
            "bodies": ("b", "base"),
            "frames": ({"point": (1, 0)}, {"point": (third, 0)}),
        },
    }
    parts = {"bodies": {"a": {}, "b": {}}, "joints": joints, "operational": ["A"]}
    return Mechanism.model_validate({"name": "triangle", "motion": "planar", **parts})


def test_a_structure_has_no_sweep() -> None:
    robot = Robot(triangle(third=1.0))
    found = sweep(robot, robot.analyse(), POINTS, lambda message: None)
    assert found == "There is no sweep: no operational coordinate can move."


# sweeps


def test_sigma_of_two_legs_is_what_geometry_says() -> None:
    """For 2-RPR, A is the identity and B holds the directions u of the legs as rows.

    Its smallest singular value is sqrt(1 - |u1 · u2|).
    """
    robot = load("2rpr")
    found = sweep(robot, robot.analyse(), 7, lambda message: None)
    assert isinstance(found, Sweep)
    x, y = np.meshgrid(found.axes[0].values, found.axes[1].values)
    legs = [np.stack([x - foot, y]) for foot in (0.0, 1.0)]
    u1, u2 = (leg / np.linalg.norm(leg, axis=0) for leg in legs)
    expected = np.sqrt(1 - np.abs(np.sum(u1 * u2, axis=0)))
    assert found.reached.all()
    np.testing.assert_allclose(found.sigma_a, 1.0, atol=1e-9)
    np.testing.assert_allclose(found.sigma_b, expected, atol=1e-9)


def test_a_rocker_is_reached_between_its_ends() -> None:
    """Crank and coupler in line: the rocker's ends by the law of cosines."""
    robot = load("four-bar")
    a, b, c, d = 0.1, 0.3, 0.25, 0.35
    ends = [np.pi - np.arccos((c**2 + d**2 - r**2) / (2 * c * d)) for r in (b + a, b - a)]
    found = sweep(robot, robot.analyse(), 25, lambda message: None)
    assert isinstance(found, Sweep)
    D = found.axes[0].values
    inside = (min(ends) < D) & (max(ends) > D)
    np.testing.assert_array_equal(found.reached, inside)


def test_progress_is_told() -> None:
    robot, told = load("2rpr"), list[str]()
    sweep(robot, robot.analyse(), 11, told.append)
    assert "sweep: 50 of 121 points" in told


# what goes wrong


def test_a_file_in_the_way_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "taken"
    path.write_text("mine")
    with pytest.raises(StudyError, match="is a file"):
        study(load("2rpr"), path)
    with pytest.raises(StudyError, match="can not write a study"):
        study(load("2rpr"), path / "below")
    assert path.read_text() == "mine"


def test_an_unwritable_folder_is_refused() -> None:
    with pytest.raises(StudyError, match="name another folder"):
        study(load("2rpr"), Path("/proc/gough-study"))


def test_an_interrupted_study_leaves_what_was_there(tmp_path: Path) -> None:
    def interrupt(message: str) -> None:
        if message.startswith("drawing"):
            raise KeyboardInterrupt

    (tmp_path / "report.html").write_text("before")
    for folder in (tmp_path, tmp_path / "new"):
        with pytest.raises(KeyboardInterrupt):
            study(load("2rpr"), folder, interrupt, points=POINTS)
    assert [path.name for path in tmp_path.iterdir()] == ["report.html"]
    assert (tmp_path / "report.html").read_text() == "before"


def test_loops_that_do_not_close_leave_no_folder(tmp_path: Path) -> None:
    with pytest.raises(ClosureError):
        study(Robot(triangle(third=2.5)), tmp_path / "new")
    assert not (tmp_path / "new").exists()


def test_too_few_points_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="3 or more"):
        study(load("2rpr"), tmp_path, points=2)


# words and tables


@pytest.mark.parametrize(
    ("changes", "options"),
    [
        ({}, ""),
        ({"L": 1.25}, " --set L=1.25"),
        ({"angles": [1.0, "pi/2"]}, " --set 'angles=[1.0, pi/2]'"),
        ({"modelling": "cut-platform"}, " --modelling cut-platform"),
    ],
)
def test_the_command_names_what_was_changed(changes: dict[str, Any], options: str) -> None:
    context = Context(load("2rpr", **changes))
    assert subject.repeating(context) == (f"gough study 2rpr{options}", True)


def test_the_command_names_seed_and_points() -> None:
    context = Context(load("2rpr"), seed=3, points=5)
    assert subject.repeating(context) == ("gough study 2rpr --points 5 --seed 3", True)


def test_parameters_of_repeated_legs_share_a_row() -> None:
    table = subject.section(Context(load("3-upu"))).blocks[-1]
    assert isinstance(table, Table)
    rows = {row[0]: row[1] for row in table.rows}
    assert rows["leg.phi"] == "0, 2.0944, 4.18879"
    assert rows["R"] == "1"


def test_a_changed_robot_is_not_called_by_the_catalogue_name() -> None:
    changed = load("2rpr").mechanism.model_copy(update={"gravity": (0.0, 0.0, 0.0)})
    assert subject.repeating(Context(Robot(changed))) == ("gough study FILE.yaml", False)


@pytest.mark.parametrize(
    ("cell", "text"),
    [
        (None, ""),
        (True, "yes"),
        (-3, "−3"),
        (1234567, "1234567"),
        (-0.0, "0"),
        (0.1 + 0.2, "0.3"),
        (1e-9, "10⁻⁹"),
        (-2.5e-12, "−2.5\N{THIN SPACE}×\N{THIN SPACE}10⁻¹²"),
        ("leg1", "leg1"),
    ],
)
def test_cells_read_well(cell: Any, text: str) -> None:
    assert written(cell) == text


def test_the_writer_escapes_everything() -> None:
    evil = '<script>"&'
    blocks = [Paragraph(evil), Table((evil, evil), [(evil, 1.0), (evil, None)], evil)]
    text = page(evil, evil, [Section("one", evil, blocks)])
    assert "<script" not in text
    assert 'class="number"' in text
    parsed(text)
    assert element("a", href='"') == '<a href="&quot;"></a>\n'


def test_sections_share_one_analysis() -> None:
    context = Context(load("2rpr"))
    assert context.analysis is context.analysis


def test_an_isolated_assembly_is_not_called_regular(tmp_path: Path) -> None:
    robot = load("five-bar", d=2.6, x=1.3, y=0, q=[0, "pi"])
    text = study(robot, tmp_path / "isolated", points=3).read_text("utf-8")
    assert "Whether it is singular is unknown" in text
    assert "is not singular" not in text
