"""Pictures of modes side by side, and of ratios over a plane."""

from __future__ import annotations

import numpy as np
import pytest

from gough import load, view
from gough.view.factors import OCTAVES, Marks, Ratio, _levels
from gough.view.modes import Panel, draw_modes

FOOT = 1
"""Axes below the panels of a planar mechanism: the bar that gives the scale."""


def panels(name: str, count: int) -> list[Panel]:
    bones = view.skeleton(load(name))
    return [Panel(bones, str(k), k == 0) for k in range(count)]


@pytest.mark.parametrize("count", [1, 2, 4, 5, 12])
def test_every_mode_has_a_panel_of_one_scale(count: int) -> None:
    figure = draw_modes(panels("five-bar", count))
    spaces = figure.axes[:-FOOT]
    assert len(spaces) == count
    limits = {(*space.get_xlim(), *space.get_ylim()) for space in spaces}
    assert len(limits) == 1
    size = figure.get_size_inches()
    box = spaces[0].get_position()
    scales = (
        box.width * size[0] / np.ptp(spaces[0].get_xlim()),
        box.height * size[1] / np.ptp(spaces[0].get_ylim()),
    )
    np.testing.assert_allclose(scales[0], scales[1], rtol=1e-9)


def test_panels_do_not_overlap_and_stay_in_the_picture() -> None:
    boxes = [space.get_position() for space in draw_modes(panels("delta", 7)).axes[:7]]
    for k, a in enumerate(boxes):
        assert min(a.x0, a.y0) > 0
        assert max(a.x1, a.y1) < 1
        for b in boxes[:k]:
            assert a.x1 < b.x0 or b.x1 < a.x0 or a.y1 < b.y0 or b.y1 < a.y0


def test_spatial_modes_show_where_the_axes_point() -> None:
    *_, triad = draw_modes(panels("delta", 2)).axes
    assert [text.get_text() for text in triad.texts if text.get_text()] == ["x", "y", "z"]


def test_the_bar_has_the_length_that_is_written() -> None:
    figure = draw_modes(panels("four-bar", 2))
    space, bar = figure.axes[0], figure.axes[-1]
    length = float(bar.texts[0].get_text().removesuffix(" mm")) * 1e-3
    scale = space.get_position().width / np.ptp(space.get_xlim())
    np.testing.assert_allclose(bar.get_position().width, scale * length, rtol=1e-9)


def test_without_modes_there_is_nothing_to_draw() -> None:
    with pytest.raises(ValueError, match="no modes"):
        draw_modes([])


def test_modes_are_the_same_picture_twice() -> None:
    first, second = (view.svg(draw_modes(panels("2rpr", 2))) for _ in range(2))
    assert first == second


# ratios


X = np.linspace(-1, 1, 21)
CONE = np.hypot(*np.meshgrid(X, X))


@pytest.mark.parametrize("octaves", [False, True])
@pytest.mark.parametrize("grows", [False, True])
@pytest.mark.parametrize(
    "values",
    [np.ones((21, 21)), np.full((21, 21), np.nan), np.full((21, 21), np.inf), CONE, 1 + CONE],
    ids=["ones", "nothing", "infinite", "cone", "hill"],
)
@pytest.mark.filterwarnings("ignore:No contour levels were found")
def test_any_values_are_drawn(values: np.ndarray, grows: bool, octaves: bool) -> None:
    with np.errstate(divide="ignore"):
        shown = 1 / values if grows else values
    ratio = Ratio("r", shown, grows, octaves)
    assert view.svg(view.draw_ratios(X, X, [ratio, ratio], ("x (m)", "y (m)"), Marks()))


def test_what_is_marked_is_in_the_legend() -> None:
    values = 1 + CONE
    values[0, 0] = np.nan
    marks = Marks((0.0, 0.0), (0.1, 0.1), ((-0.5, -0.5), (0.5, 0.5)), CONE - 0.5)
    ratio = Ratio("condition number", values, grows=True)
    figure = view.draw_ratios(X, X, [ratio], ("x (m)", "y (m)"), marks)
    assert [text.get_text() for text in figure.legends[0].get_texts()] == [
        "home",
        "isotropic point",
        "prescribed cube",
        "singularity of type 2",
        "not reached",
    ]


def test_levels_are_round_and_inside_the_values() -> None:
    near = _levels(Ratio("r", 1 + CONE, grows=True))
    far = _levels(Ratio("r", 10.0 ** (2 * CONE), grows=True))
    np.testing.assert_allclose(near, np.round(near, 2), atol=1e-12)
    assert near[0] > 1
    assert far.tolist() == [2, 5, 10, 20]
    assert OCTAVES[4] == 1
