"""Pictures: that they are drawn, equal when drawn twice, and show the points they should."""

from __future__ import annotations

import sys
import xml.etree.ElementTree as ET

import numpy as np
import pytest

from gough import catalogue, view
from gough.robot import load
from gough.view.maps import Layer
from gough.view.outline import outline

PNG = b"\x89PNG\r\n\x1a\n"


@pytest.mark.parametrize("name", catalogue.names())
def test_every_robot_of_the_catalogue_is_drawn(name: str) -> None:
    robot = load(name)
    figure = view.draw_mechanism(view.skeleton(robot))
    picture = view.svg(figure)
    assert ET.fromstring(picture).tag.endswith("svg")
    assert len(figure.axes) == (1 if robot.mechanism.motion == "planar" else 3)


def test_pictures_are_equal_when_drawn_twice() -> None:
    bones = view.skeleton(load("five-bar"))
    first, second = (view.draw_mechanism(bones) for _ in range(2))
    assert view.svg(first) == view.svg(second)
    assert view.png(first)[:8] == PNG


def test_the_views_of_a_spatial_robot_have_one_scale() -> None:
    figure = view.draw_mechanism(view.skeleton(load("delta")))
    size = figure.get_size_inches()
    scales = []
    for axes in figure.axes:
        box = axes.get_position()
        scales.append(box.width * size[0] / np.ptp(axes.get_xlim()))
        scales.append(box.height * size[1] / np.ptp(axes.get_ylim()))
    np.testing.assert_allclose(scales, scales[0], rtol=1e-9)


def test_the_skeleton_of_a_four_bar_is_its_four_pins() -> None:
    bones = view.skeleton(load("four-bar"))
    sides = {s.body: np.linalg.norm(np.ptp(s.points, axis=0)) for s in bones.shapes}
    np.testing.assert_allclose(
        [sides[k] for k in ("crank", "coupler", "rocker", "base")], [0.1, 0.3, 0.25, 0.35]
    )
    assert [mark.name for mark in bones.marks if mark.actuated] == ["A"]
    assert {mark.name for mark in bones.marks if mark.on_base} == {"A", "D"}


def test_slides_are_as_long_as_their_position() -> None:
    robot = load("2rpr")
    lengths = [
        np.linalg.norm(m.rails[1] - m.rails[0]) for m in view.skeleton(robot).marks if len(m.rails)
    ]
    np.testing.assert_allclose(lengths, robot.home.q_actuated, rtol=1e-12)


# outlines


def test_an_outline_keeps_the_corners_alone() -> None:
    square = np.array([[0, 0], [1, 0], [1, 1], [0, 1.0]])
    inside = np.array([[0.5, 0.5], [0.5, 0.0], [0.2, 0.7], [0.0, 0.0]])
    corners = outline(np.vstack([inside, square]), 1e-9)
    assert {tuple(c) for c in corners} == {tuple(c) for c in square}
    assert len(corners) == 4


@pytest.mark.parametrize("seed", range(5))
def test_every_point_lies_in_the_outline(seed: int) -> None:
    points = np.random.default_rng(seed).normal(size=(30, 2))
    corners = outline(points, 1e-12)
    for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        across = (b[0] - a[0]) * (points[:, 1] - a[1]) - (b[1] - a[1]) * (points[:, 0] - a[0])
        assert np.all(across >= -1e-12)


def test_points_on_a_line_or_in_a_heap_have_ends_only() -> None:
    line = np.outer([0.3, 0.0, 1.0, 0.7], [1.0, 2.0])
    np.testing.assert_allclose(outline(line, 1e-9), [[0, 0], [1, 2]], atol=1e-15)
    assert outline(np.zeros((3, 2)), 1e-9).shape == (1, 2)
    assert outline(np.zeros((1, 2)), 1e-9).shape == (1, 2)


# values


def test_spectra_with_nothing_in_them_are_drawn() -> None:
    spectra = [
        view.Spectrum("N", np.zeros(0), 0),
        view.Spectrum("E", np.array([1.0, 1e-5, 0.0]), 3),
    ]
    figure = view.draw_spectra(spectra, 1e-9)
    assert "no columns" in [text.get_text() for text in figure.axes[0].texts]
    assert figure.axes[1].get_title() == "E\nrank 2 (generic 3)"
    assert view.svg(figure)


@pytest.mark.parametrize("fill", [0.0, 1.0, np.nan])
def test_flat_and_empty_maps_are_drawn(fill: float) -> None:
    x = np.linspace(0, 1, 4)
    layer = Layer("flat", np.full((4, 4), fill))
    figure = view.draw_maps(x, x, [layer], ("x (m)", "y (m)"), (0.3, 0.3))
    assert view.svg(figure)


def test_a_map_marks_small_values_and_holes() -> None:
    x, y = np.linspace(-1, 1, 9), np.linspace(0, 0.5, 7)
    values = np.hypot(*np.meshgrid(x, y))
    values[0, 0] = np.nan
    layer = Layer("distance", values)
    figure = view.draw_maps(x, y, [layer, layer], ("x (m)", "y (m)"), (0.0, 0.0))
    labels = [text.get_text() for text in figure.legends[0].get_texts()]
    assert labels == ["home", "a tenth of the largest value", "not reached"]


def test_curves_hatch_where_there_is_no_value() -> None:
    x = np.linspace(0, 1, 7)
    values = np.array([np.nan, np.nan, 1, 2, np.nan, 3, np.nan])
    figure = view.draw_curves(x, [Layer("s", values)], "x (m)", 3)
    assert len(figure.axes[0].patches) == 3
    assert view.svg(figure)


def test_matplotlib_is_asked_for_by_name(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    with pytest.raises(view.ViewError, match=r"pip install matplotlib"):
        view.draw_spectra([], 1e-9)


def test_importing_the_room_loads_no_matplotlib() -> None:
    import subprocess

    code = "import sys, gough.view, gough.studies; sys.exit('matplotlib' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
