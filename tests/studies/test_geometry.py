"""Modes and velocity factors in the report: numbers of robots, words where there are none."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import pytest

from gough import Body, Joint, Mechanism, Robot, catalogue, load
from gough.studies.context import Context
from gough.studies.ratios import Ratios, outputs, ratios
from gough.studies.report import Paragraph, Picture, Section, Table
from gough.studies.sections import geometry, velocity_factors


def silent(message: str) -> None:
    """Progress that nobody asked for."""


def said(section: Section) -> str:
    return " ".join(block.text for block in section.blocks if isinstance(block, Paragraph))


def tables(section: Section) -> list[Table]:
    return [block for block in section.blocks if isinstance(block, Table)]


# modes


@pytest.mark.parametrize(
    ("name", "working", "assembly", "status"),
    [
        ("orthoglide", 8, 2, "expected"),
        ("delta", 8, 2, "expected"),
        ("five-bar", 4, 2, "expected"),
        ("four-bar", 2, 2, "expected"),
        ("3-rrr", 8, 2, "expected"),
        ("3-rpr", 1, 2, "expected"),
        ("gough-stewart", 1, 8, "expected"),
        ("6-ups", 1, 40, "certified"),
        ("hexa", 64, 16, "certified"),
        ("3-rps", None, 16, "found"),
        ("biped-leg", None, 8, "found"),
    ],
)
def test_the_section_has_the_modes_of_home(
    name: str, working: int | None, assembly: int, status: str
) -> None:
    found = geometry.section(Context(load(name)))
    data = found.data["geometry"]
    if working is None:
        assert data["working_modes"] is None
    else:
        assert len(data["working_modes"]["modes"]) == working
    assert len(data["assembly_modes"]["certified"]) == assembly
    assert data["assembly_modes"]["status"] == status
    assert f"{assembly} assembly modes, {status}: {geometry.STATUS[status]}" in said(found)
    drawn = {"working-modes"} if working and working > 1 else set()
    assert {picture.name for picture in found.pictures} == drawn | {"assembly-modes"}
    last = tables(found)[-1]
    assert len(last.rows) == assembly
    assert sum(bool(row[-1]) for row in last.rows) == sum(data["assembly_modes"]["certified"])


@pytest.mark.parametrize("name", ["orthoglide", "gough-stewart", "3-rpr", "four-bar", "biped-leg"])
def test_home_is_named_among_the_assembly_modes(name: str) -> None:
    found = geometry.section(Context(load(name)))
    home = found.data["geometry"]["assembly_modes"]["home"]
    rows = [row[0] for row in tables(found)[-1].rows]
    assert [k for k, label in enumerate(rows) if "home" in str(label)] == [home]


def test_home_is_named_among_the_working_modes() -> None:
    rows = tables(geometry.section(Context(load("orthoglide"))))[0].rows
    assert [row[0] for row in rows if "home" in str(row[0])] == ["−−− · home"]


def test_what_is_not_drawn_is_counted() -> None:
    captions = [p.caption for p in geometry.section(Context(load("hexa"))).pictures]
    assert "8 of 64 are drawn, 56 more are not" in captions[0]
    assert "12 of 16 are drawn, 4 more are not" in captions[1]


def test_many_unknowns_are_left_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(geometry, "MOST_UNKNOWNS", 1)
    found = geometry.section(Context(load("five-bar")))
    assert "linear equations leave 2 unknowns, and a study stops at 1" in said(found)
    assert found.data["geometry"]["assembly_modes"] is None


def pendulum(**more: Any) -> Robot:
    pin = Joint(type="revolute", bodies=("base", "rod"), actuated=True)
    bodies = {"rod": Body(mass=1.0)}
    return Robot(Mechanism(name="pendulum", bodies=bodies, joints={"pin": pin}, **more))


def test_a_tree_says_what_it_has_not() -> None:
    context = Context(pendulum())
    modes = said(geometry.section(context))
    assert "no operational coordinates" in modes
    assert "no loop is closed" in modes
    assert "no operational coordinates" in said(velocity_factors.section(context))


def test_legs_without_a_closed_form_are_named() -> None:
    text = said(geometry.section(Context(load("tricept"))))
    assert "Working modes are not listed: the legs of tricept have no closed form" in text


# velocity factors


def test_a_robot_maps_its_own_workspace() -> None:
    """Factors of the Orthoglide are 0.8, 0.8, 2 and 0.5, 2, 2 at two corners of its cube."""
    D = 0.31058
    tau = np.array([-D / (3 * np.sqrt(2)), D / np.sqrt(6)])
    found = load("orthoglide").workspace_map(x=tau, y=tau, z=0.6 + tau)
    assert set(found.data_vars) == {"reached", "regular", "conditioning", "velocity_factors"}
    factors = found.velocity_factors
    np.testing.assert_allclose(factors[0, 0, 0], [0.8, 0.8, 2], atol=1e-9)
    np.testing.assert_allclose(factors[1, 1, 1], [0.5, 2, 2], atol=1e-9)


@pytest.fixture(scope="module")
def orthoglide() -> Ratios:
    found = ratios(load("orthoglide"), 13, silent)
    assert isinstance(found, Ratios)
    return found


def test_the_isotropic_point_of_the_orthoglide_is_where_its_slides_meet(orthoglide: Ratios) -> None:
    assert orthoglide.isotropy is not None
    place = [orthoglide.isotropy.place[name] for name in "xyz"]
    np.testing.assert_allclose(place, [0, 0, 0.6], atol=1e-7)
    np.testing.assert_allclose(orthoglide.isotropy.factor, 1, atol=1e-7)
    assert not orthoglide.through_home
    np.testing.assert_allclose(orthoglide.held["z"], 0.6, atol=1e-7)


def test_factors_of_the_orthoglide_are_those_of_its_formula(orthoglide: Ratios) -> None:
    """Rows of J⁻¹ in axes of a leg are (u / s, v / s, 1) with s² = D² - u² - v²."""
    D = 0.31058
    x, y = np.meshgrid(*orthoglide.points)
    row, column = np.argwhere(np.isfinite(orthoglide.conditioning))[7]
    p = np.array([x[row, column], y[row, column], 0.0])
    J_inverse = np.empty((3, 3))
    for k, (u, v, w) in enumerate([(0, 1, 2), (1, 2, 0), (2, 0, 1)]):
        s = np.sqrt(D**2 - p[u] ** 2 - p[v] ** 2)
        J_inverse[k, [u, v, w]] = p[u] / s, p[v] / s, 1.0
    factors = 1 / np.linalg.svd(J_inverse, compute_uv=False)
    there = [orthoglide.factor(which)[row, column] for which in range(3)]
    np.testing.assert_allclose(there, factors, rtol=1e-6)


def test_the_side_changes_at_singularities_of_type_2() -> None:
    """The legs of 2-RPR are in line where y = 0; home is above."""
    found = ratios(load("2rpr"), 13, silent)
    assert isinstance(found, Ratios)
    assert found.side is not None
    _, y = np.meshgrid(*found.points)
    known = np.isfinite(found.side) & (np.abs(y) > 1e-9)
    assert (y < 0).any()
    np.testing.assert_array_equal(np.sign(found.side[known]), np.sign(y[known]))


def test_half_turns_of_passive_joints_are_no_singularities() -> None:
    """Where a universal joint of 6-ups is led through its limit the motors still hold."""
    found = ratios(load("6-ups"), 13, silent)
    assert isinstance(found, Ratios)
    assert found.side is not None
    near = 1 / found.conditioning < 0.02
    crossed = np.sign(found.side[1:]) != np.sign(found.side[:-1])
    assert crossed.any()
    assert (near[1:] | near[:-1])[crossed].all()


def test_a_robot_isotropic_everywhere_gets_a_sentence() -> None:
    found = velocity_factors.section(Context(load("tripteron"), points=5))
    assert "All factors are 1 everywhere" in said(found)
    assert not found.pictures


@pytest.mark.parametrize(
    ("name", "titles"),
    [
        ("orthoglide", ["smallest velocity factor", "largest velocity factor"]),
        ("five-bar", ["smallest velocity factor (m/rad)", "largest velocity factor (m/rad)"]),
        ("gough-stewart", ["condition number"]),
        ("3-rpr", ["condition number"]),
    ],
)
def test_translating_robots_get_factors_and_others_a_condition_number(
    name: str, titles: list[str]
) -> None:
    found = ratios(load(name), 5, silent)
    assert isinstance(found, Ratios)
    assert [ratio.title for ratio in velocity_factors._layers(found)] == titles


def test_the_map_of_a_pose_is_held_at_home() -> None:
    robot = load("gough-stewart")
    found = ratios(robot, 5, silent)
    assert isinstance(found, Ratios)
    (x, y), (first, second) = found.points, found.axes
    at_home = np.argmin(np.abs(y - second.home)), np.argmin(np.abs(x - first.home))
    condition = robot.kinematics.conditioning(robot.home.q)
    np.testing.assert_allclose(found.conditioning[at_home], condition, rtol=1e-9)


def test_one_translation_has_no_map() -> None:
    text = said(velocity_factors.section(Context(load("tricept"))))
    assert text == (
        "Velocity factors are mapped over two translations; the outputs of tricept have one."
    )


@pytest.mark.parametrize("name", catalogue.names())
def test_outputs_have_their_values_at_home(name: str) -> None:
    robot = load(name)
    if not robot.structure.columns("operational"):
        return
    found = outputs(robot)
    assert len(found) == len(robot.structure.columns("operational"))
    assert all(re.fullmatch("m|rad|1", output.unit) for output in found)


def test_pictures_are_made_and_named() -> None:
    found = velocity_factors.section(Context(load("five-bar"), points=5))
    (picture,) = [block for block in found.blocks if isinstance(block, Picture)]
    assert picture.name == "velocity-factors"
    assert picture.png[:4] == b"\x89PNG"
