"""Pictures of ensembles, actuators and audits: drawn from plain arrays, with what has no value."""

from __future__ import annotations

import numpy as np
import pytest

from gough import view

RNG = np.random.default_rng(0)


def words(figure):
    texts = [text.get_text() for axes in figure.axes for text in axes.texts]
    return texts + [text.get_text() for legend in figure.legends for text in legend.get_texts()]


def colours(axes):
    return {tuple(np.round(bar.get_facecolor(), 3)) for bar in axes.patches}


# scatter


def ensemble(runs=200):
    x = RNG.random((runs, 5))
    y = np.stack([3 * x[:, 4] - x[:, 1], np.cos(2 * np.pi * x[:, 2])], axis=1)
    y[:3] = np.nan
    return x, y


def test_scatter_shows_the_most_important_factors_first():
    x, y = ensemble()
    names = [f"factor {k}" for k in range(5)]
    figure = view.draw_scatter(x, y, names, ["y", "z"], most=2)
    assert [axes.get_xlabel() for axes in figure.axes][:2] == ["factor 4", "factor 1"]
    importance = np.zeros((2, 5))
    importance[1, 2] = 1
    figure = view.draw_scatter(x, y, names, ["y", "z"], importance, most=2)
    assert figure.axes[2].get_xlabel() == "factor 2"
    assert [axes.get_ylabel() for axes in figure.axes] == ["y", "", "z", ""]


def test_scatter_leaves_out_runs_without_a_value():
    x, y = ensemble()
    figure = view.draw_scatter(x, y, list("abcde"), ["y", "z"])
    assert len(figure.axes[0].lines[0].get_xdata()) == 197
    assert view.svg(figure)


def test_scatter_of_nothing_is_drawn():
    figure = view.draw_scatter(np.ones((4, 1)), np.full((4, 1), np.nan), ["a"], ["y"])
    assert view.svg(figure)
    assert figure.axes[0].get_title(loc="right") == "rank corr. –"


def test_scatter_breaks_long_names_between_words():
    figure = view.draw_scatter(
        np.eye(4), np.eye(4)[:, :1], ["a", "b", "c", "leg1.slide friction of the slide [N]"], ["y"]
    )
    labels = [axes.get_xlabel() for axes in figure.axes]
    assert "leg1.slide\nfriction of the\nslide\N{NO-BREAK SPACE}[N]" in labels


# tornado


def test_a_tornado_is_sorted_by_swing():
    figure = view.draw_tornado(["a", "b", "c"], [1, -3, 0.5], [2, 3, 1], 1.5, "force [N]")
    assert [t.get_text() for t in figure.axes[0].get_yticklabels()] == ["b", "a", "c"]
    assert "all nominal: 1.5" in words(figure)
    assert {"−3", "3", "2"} <= set(words(figure))
    assert "0.5 (1 at high)" in words(figure)  # both below nominal


def test_a_tornado_tells_what_has_no_value():
    figure = view.draw_tornado(["a", "b"], [np.nan, 1], [2, np.nan], 1.5, "force [N]")
    assert {"no value at low", "no value at high"} <= set(words(figure))
    empty = view.draw_tornado(["a"], [np.nan], [np.nan], np.nan, "force [N]")
    assert view.svg(empty)


def test_a_tornado_of_many_shows_the_most():
    swing = np.arange(30.0)
    figure = view.draw_tornado([f"f{k}" for k in range(30)], -swing, swing, 0.0, "y", most=5)
    assert [t.get_text() for t in figure.axes[0].get_yticklabels()] == [
        f"f{k}" for k in (29, 28, 27, 26, 25)
    ]


# index bars


def bars(title, total):
    total = np.asarray(total, float)
    first = total / 2
    return view.IndexBars(
        title,
        first,
        total,
        np.stack([first - 0.05, first + 0.05], axis=1),
        np.stack([total - 0.05, total + 0.05], axis=1),
    )


def test_index_bars_have_one_order_and_tell_what_is_hidden():
    panels = [bars("y", [0.1, 0.5, 0.0]), bars("z", [0.9, 0.2, 0.0])]
    figure = view.draw_index_bars(["a", "b", "c"], panels, most=2)
    assert [t.get_text() for t in figure.axes[0].get_yticklabels()] == ["a", "b"]
    assert {t.get_text() for t in figure.axes[1].get_yticklabels()} == {""}
    assert "(1 smaller factor not shown)" in words(figure)
    assert figure.axes[0].get_xlim() == figure.axes[1].get_xlim()


def test_index_bars_of_an_output_that_does_not_vary():
    figure = view.draw_index_bars(["a", "b"], [bars("y", [np.nan, np.nan])] * 4)
    assert "does not vary" in words(figure)
    assert view.svg(figure)


# loops


def loop(name, size):
    t = np.linspace(0, 2 * np.pi, 100)
    e = np.linspace(-1, 1, 20)
    return view.Loop(name, size * np.sin(t), size * np.sin(t + 0.3), e, e - 0.5, e + 0.5)


def test_loops_have_one_scale_and_their_start():
    figure = view.draw_loops([loop(f"leg{k}", 0.2 * k) for k in range(1, 5)], ("x [m]", "F [N]"))
    assert len({axes.get_xlim() + axes.get_ylim() for axes in figure.axes}) == 1
    assert [axes.get_xlabel() for axes in figure.axes] == ["", "x [m]", "x [m]", "x [m]"]
    assert view.svg(figure)


def test_loops_that_stand_still_or_have_no_value_are_drawn():
    still = view.Loop("a", np.zeros(5), np.zeros(5), np.zeros(2), np.zeros(2), np.zeros(2))
    gone = view.Loop(
        "b", np.full(5, np.nan), np.full(5, np.nan), np.zeros(2), -np.ones(2), np.ones(2)
    )
    with np.errstate(all="raise"):
        assert view.svg(view.draw_loops([still], ("x", "F")))
    assert view.svg(view.draw_loops([still, gone], ("x", "F")))


# audit


def test_an_audit_stacks_gains_and_shows_the_error():
    t = np.linspace(0, 1, 50)
    parts = {"kinetic": 5 + t, "potential": -2 * t, "dissipated": 3 * t}
    figure = view.draw_audit(t, parts, 2 * t + 1e-6 * t)
    upper, lower = figure.axes
    assert lower.get_yscale() == "log"
    title = "balance open by at most 10⁻⁶ J, 3 · 10⁻⁷ of the largest energy"
    assert lower.get_title(loc="right") == title
    np.testing.assert_allclose(upper.lines[-1].get_ydata(), 2 * t + 1e-6 * t)
    assert words(figure) == ["kinetic", "potential", "dissipated", "delivered: the sum"]


def test_an_audit_without_motion_is_drawn():
    t = np.linspace(0, 1, 5)
    figure = view.draw_audit(t, {"kinetic": 0 * t, "springs": 0 * t}, 0 * t)
    assert view.svg(figure)


# comparison


def test_a_comparison_has_differences_from_the_first():
    t = np.linspace(0, 1, 20)
    values = np.stack([t, t + 2e-6, t - 4e-6 * t])
    figure = view.draw_comparison(
        t, [view.Compared("x [m]", values), view.Compared("F [N]", 1e4 * values)], ["a", "b", "c"]
    )
    assert figure.axes[1].get_ylabel() == "difference\nin 10⁻⁶"
    np.testing.assert_allclose(figure.axes[1].lines[0].get_ydata(), 2.0)
    assert figure.axes[3].get_ylabel() == "difference"
    assert words(figure) == ["a", "b", "c"]


def test_a_comparison_of_equal_and_missing_runs_is_drawn():
    t = np.linspace(0, 1, 5)
    figure = view.draw_comparison(
        t, [view.Compared("x", np.stack([t, t, np.full(5, np.nan)]))], list("abc")
    )
    assert figure.axes[1].get_ylabel() == "difference"
    assert view.svg(figure)


# histogram


@pytest.mark.parametrize("missed", ["above", "below"])
def test_a_histogram_parts_runs_at_the_limit(missed):
    y = RNG.normal(size=1000)
    figure = view.draw_histogram(y, "y", view.Limit(1.0, missed, "limit"))
    axes = figure.axes[0]
    right = [bar for bar in axes.patches if bar.get_x() + bar.get_width() / 2 > 1]
    left = [bar for bar in axes.patches if bar.get_x() + bar.get_width() / 2 < 1]
    assert sum(bar.get_height() for bar in right) == np.sum(y > 1)
    assert sum(bar.get_height() for bar in left) == np.sum(y < 1)
    assert len({bar.get_facecolor() for bar in right}) == 1
    assert right[0].get_facecolor() != left[0].get_facecolor()


@pytest.mark.parametrize("values", [[2.0], [2.0, 2.0, 2.0], [np.nan], [0.0, 1e-300, np.inf], []])
@pytest.mark.parametrize(
    "limit", [None, view.Limit(2.0, "above", "limit"), view.Limit(-5, "below", "")]
)
def test_histograms_of_few_values_are_drawn(values, limit):
    figure = view.draw_histogram(np.array(values), "y", limit)
    assert view.svg(figure)
    heights = sum(bar.get_height() for bar in figure.axes[0].patches)
    assert heights == np.sum(np.isfinite(values))


def test_a_histogram_of_what_is_never_negative_starts_at_zero():
    y = np.abs(RNG.normal(size=2000)) ** 3
    axes = view.draw_histogram(y, "y", view.Limit(2.0, "above", "limit")).axes[0]
    assert axes.get_xlim()[0] == 0
    assert sum(bar.get_height() for bar in axes.patches) == len(y)


def test_a_history_has_a_panel_for_each_quantity_and_marks_in_all():
    t = np.linspace(0, 1, 20)
    shown = [view.History("z [m]", [t]), view.History("force [N]", [t, 2 * t], ["a", "b"])]
    figure = view.draw_histories(t, shown, [0.4], "contact")
    one, two = figure.axes
    assert (one.get_ylabel(), two.get_ylabel()) == ("z [m]", "force [N]")
    assert [text.get_text() for text in two.get_legend().get_texts()] == ["a", "b"]
    assert all(len(axes.lines) == count for axes, count in ((one, 2), (two, 3)))
    assert words(figure) == ["contact"]
    assert view.svg(view.draw_histories(t, shown[:1]))


def test_a_histogram_tells_runs_without_a_value():
    figure = view.draw_histogram(np.array([1.0, 2.0, np.nan]), "y")
    assert figure.axes[0].get_title(loc="left") == "3 runs, 1 of them without a value"


def test_pictures_of_ensembles_are_equal_when_drawn_twice():
    x, y = ensemble()
    first, second = (view.draw_scatter(x, y, list("abcde"), ["y", "z"]) for _ in range(2))
    assert view.svg(first) == view.svg(second)
