"""Damped steps against the singular values of J."""

import numba
import numpy as np
import pytest

from gough.numerics import damped_steps as ds
from gough.numerics.calling import pointer_to
from gough.numerics.lanes import LANES

LONGEST = 0.5


@numba.njit
def run(J, F, square, trust, m, n, row_scale, scale, work, step, promised, slope):
    room = ds.Work(
        pointer_to(work[0], 0),
        pointer_to(work[1], 0),
        pointer_to(work[2], 0),
        pointer_to(work[3], 0),
        pointer_to(work[4], 0),
        pointer_to(work[5], 0),
    )
    ds.damped_steps(
        pointer_to(J, 0), pointer_to(F, 0), pointer_to(square, 0), pointer_to(trust, 0), 0, m, n,
        pointer_to(row_scale, 0), pointer_to(scale, 0), LONGEST, room, pointer_to(step, 0),
        pointer_to(promised, 0), pointer_to(slope, 0),
    )  # fmt: skip


def steps(J, F, trust, row_scale=None, x_scale=None):
    """The steps of LANES systems, what they promise and the slopes."""
    count, m, n = J.shape
    assert count == LANES
    row_scale = np.ones(m) if row_scale is None else row_scale
    x_scale = np.ones(n) if x_scale is None else x_scale
    step, promised, slope = np.zeros(LANES * n), np.zeros(LANES), np.zeros(LANES)
    square = np.sum((F * row_scale) ** 2, axis=1)
    work = tuple(np.full(LANES * (m + n + 2) ** 2, np.nan) for _ in range(6))
    scale = np.outer(row_scale, x_scale).ravel()
    run(J.ravel(), F.ravel(), square, trust, m, n, row_scale, scale, work, step, promised, slope)
    return step.reshape(LANES, n), promised, slope


def reference(J, F, trust):
    U, s, Vt = np.linalg.svd(J, full_matrices=False)
    s[s < 1e-13 * s[0]] = 0
    damping = trust * min(float(F @ F), 1.0)
    along = s * (U.T @ F) / (s * s + damping + 1e-300)
    along *= min(1.0, LONGEST / np.linalg.norm(along))
    step = -Vt.T @ along
    return step, F @ F - np.sum((F + J @ step) ** 2)


SHAPES = [(1, 1), (3, 3), (6, 6), (9, 4), (4, 9), (7, 1), (1, 7), (17, 16)]


@pytest.mark.parametrize(("m", "n"), SHAPES)
@pytest.mark.parametrize("size", [1e-9, 1e-3, 3.0])
def test_steps_are_those_of_the_singular_values(m, n, size):
    rng = np.random.default_rng([m, n])
    J, F = rng.normal(size=(LANES, m, n)), size * rng.normal(size=(LANES, m))
    trust = 10.0 ** rng.uniform(-3, 3, size=LANES)
    found, promised, slope = steps(J, F, trust)
    for k in range(LANES):
        expected, gain = reference(J[k], F[k], trust[k])
        near = 1e-8 * np.linalg.norm(expected) + 1e-20
        np.testing.assert_allclose(found[k], expected, atol=near)
        np.testing.assert_allclose(promised[k], gain, rtol=1e-6)
        exact = np.sum((J[k].T @ F[k]) ** 2) / (np.sum(J[k] ** 2) * np.sum(F[k] ** 2))
        np.testing.assert_allclose(slope[k], exact, rtol=1e-9)


@pytest.mark.parametrize(("m", "n"), [(6, 6), (9, 4), (4, 9)])
def test_a_root_of_redundant_equations_is_reached_along_reached_directions_only(m, n):
    rng = np.random.default_rng(3)
    J = rng.normal(size=(LANES, m, 3)) @ rng.normal(size=(LANES, 3, n))
    F = np.einsum("kij,kj->ki", J, 1e-9 * rng.normal(size=(LANES, n)))
    found, _, _ = steps(J, F, np.ones(LANES))
    for k in range(LANES):
        expected = -np.linalg.pinv(J[k], rcond=1e-10) @ F[k]
        np.testing.assert_allclose(found[k], expected, atol=1e-13)


def test_badly_conditioned_equations_are_solved_as_they_are():
    rng = np.random.default_rng(4)
    U, V = (np.linalg.qr(rng.normal(size=(LANES, 6, 6)))[0] for _ in range(2))
    J = U * np.logspace(0, -8, 6) @ V
    exact = 1e-7 * rng.normal(size=(LANES, 6))
    F = np.einsum("kij,kj->ki", J, exact)
    found, _, _ = steps(J, F, np.full(LANES, 1e-6))
    # the normal equations would leave nothing of the three smallest singular values
    left = np.einsum("kij,kj->ki", J, found) + F
    assert np.all(np.linalg.norm(left, axis=1) < 1e-6 * np.linalg.norm(F, axis=1))


def test_a_column_scaled_by_zero_is_held():
    rng = np.random.default_rng(5)
    J, F = rng.normal(size=(LANES, 4, 5)), rng.normal(size=(LANES, 4))
    row_scale, x_scale = rng.uniform(1, 2, size=4), np.array([1.0, 0, 2, 0, 1])
    found, _, _ = steps(J, F, np.ones(LANES), row_scale, x_scale)
    assert np.all(found[:, [1, 3]] == 0)
    for k in range(LANES):
        expected, _ = reference(row_scale[:, None] * J[k] * x_scale, row_scale * F[k], 1.0)
        np.testing.assert_allclose(found[k], expected, atol=1e-9)


def test_a_lane_does_not_depend_on_the_others():
    rng = np.random.default_rng(6)
    J, F = rng.normal(size=(LANES, 5, 5)), rng.normal(size=(LANES, 5))
    before = steps(J, F, np.ones(LANES))
    J[1:], F[1:] = np.nan, np.inf
    after = steps(J, F, np.ones(LANES))
    for a, b in zip(before, after, strict=True):
        np.testing.assert_array_equal(a[0], b[0])
