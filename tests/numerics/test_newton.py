"""Endings of the damped Newton iteration, with redundant equations and singular roots."""

import numpy as np

from gough.numerics.newton import Ending, solve


def run(F, J, start, **options):
    return solve(F, J, lambda q, step: q + step, np.array(start, dtype=float), **options)


def circle_and_line(q):
    """A circle written twice, and a line."""
    x, y = q
    return np.array([x * x + y * y - 1, 3 * (x * x + y * y - 1), x - y])


def slope(q):
    x, y = q
    return np.array([[2 * x, 2 * y], [6 * x, 6 * y], [1, -1]])


def test_redundant_equations_converge_quadratically():
    found = run(circle_and_line, slope, [2.0, 0.1])
    assert found.ending is Ending.closed
    assert found.steps < 12
    np.testing.assert_allclose(found.q, [0.5**0.5] * 2, atol=1e-14)


def test_more_unknowns_than_equations():
    found = run(lambda q: np.array([q @ q - 1]), lambda q: 2 * q[None], [0.3, 0.4, 0.5])
    assert found.ending is Ending.closed
    np.testing.assert_allclose(found.q / found.q[0], [1, 4 / 3, 5 / 3], atol=1e-9)


def test_out_of_reach_is_an_answer():
    found = run(lambda q: np.array([q[0] ** 2 + 1]), lambda q: np.array([[2 * q[0]]]), [0.7])
    assert found.ending is Ending.open
    assert found.gap > 0.99


def test_a_closed_start_is_kept_even_where_it_is_singular():
    found = run(lambda q: q**2, lambda q: np.diag(2 * q), [0.0])
    assert (found.ending, found.steps) == (Ending.closed, 0)


def test_few_steps_and_bad_starts_are_named():
    assert run(circle_and_line, slope, [2.0, 0.1], max_steps=2).ending is Ending.step_limit
    nothing = run(lambda q: np.array([np.nan]), lambda q: np.array([[1.0]]), [0.0])
    assert nothing.ending is Ending.not_finite


def test_no_equations_are_closed():
    assert run(lambda q: np.zeros(0), lambda q: np.zeros((0, 1)), [1.0]).ending is Ending.closed
