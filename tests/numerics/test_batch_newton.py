"""Many systems at once: roots, endings, and that no row sees its neighbours."""

from dataclasses import dataclass
from functools import cache

import casadi as ca
import numpy as np
import pytest

from gough.kernels import Kernel
from gough.numerics import newton, newton_loops
from gough.numerics.batch_newton import ENDINGS, solve_batch
from gough.numerics.newton import Ending

TURN = ca.SX.sym("turn", 3)


@dataclass(frozen=True)
class Problem:
    """Equations of x and p with the derivative by the step."""

    residual: Kernel
    jacobian: Kernel
    start: float = 2.0
    """Starts are drawn from -start to start."""

    @property
    def n(self):
        return self.residual.inputs["x"]

    @property
    def m(self):
        return self.residual.shape[0]

    @property
    def addresses(self):
        return tuple(k.addresses.wide for k in (self.residual, self.jacobian))

    def solve(self, x, p, **options):
        return solve_batch(*self.addresses, x, p, self.m, **options)

    def data(self, rows, seed=0):
        rng = np.random.default_rng(seed)
        size = self.residual.inputs["p"]
        return rng.uniform(-1, 1, size=(rows, self.n)) * self.start, rng.uniform(
            0.5, 1.5, size=(rows, size)
        )


def problem(n, k, equations, start=2.0):
    x, p = ca.SX.sym("x", n), ca.SX.sym("p", k)
    F = ca.vertcat(*equations(x, p))
    given = {"x": x, "p": p}
    return Problem(
        Kernel("F", given, F, (F.numel(),)), Kernel("J", given, ca.jacobian(F, x)), start
    )


def circle_and_line(x, p):
    """A circle written twice, and a line."""
    circle = x[0] ** 2 + x[1] ** 2 - p[0] ** 2
    return circle, 3 * circle, x[0] - x[1]


def four_bar(x, p):
    """Angles of coupler and rocker for a given crank; at some cranks there is no root."""
    crank, coupler, rocker, base = 1.0, 2.5, 2.0, 3.0 + p[1]
    return (
        crank * ca.cos(p[0]) + coupler * ca.cos(x[0]) - rocker * ca.cos(x[1]) - base,
        crank * ca.sin(p[0]) + coupler * ca.sin(x[0]) - rocker * ca.sin(x[1]),
    )


def hilbert(x, p):
    """Nearly dependent equations, with a condition number of 1e7."""
    return tuple(
        sum((x[j] - p[j]) / (1 + i + j) for j in range(6)) + 1e-6 * (x[i] - p[i]) ** 2
        for i in range(6)
    )


@cache
def problems():
    return {
        "circle and line": problem(2, 1, circle_and_line),
        "four-bar": problem(2, 2, four_bar),
        "sphere": problem(3, 1, lambda x, p: (ca.sumsqr(x) - p[0],)),
        "no root": problem(1, 1, lambda x, p: (x[0] ** 2 + p[0],)),
        "double root": problem(1, 1, lambda x, p: ((x[0] - p[0]) ** 2,)),
        "no parameters": problem(2, 0, lambda x, p: (x[0] * x[1] - 1, x[0] ** 2 - x[1])),
    }


NAMES = list(problems())


def rows_of(solution):
    return solution.x, solution.gap, solution.ending, solution.steps


def same_bits(a, b):
    for first, second in zip(rows_of(a), rows_of(b), strict=True):
        np.testing.assert_array_equal(first, second)


# roots and endings


@pytest.mark.parametrize("name", NAMES)
def test_rows_end_as_they_do_alone_in_numpy(name):
    case = problems()[name]
    x, p = case.data(60)
    found = case.solve(x, p)
    for k in range(60):
        alone = newton.solve(
            lambda at, k=k: case.residual(at, p[k]),
            lambda at, k=k: case.jacobian(at, p[k]),
            lambda at, step: at + step,
            x[k],
        )
        assert ENDINGS[found.ending[k]] is alone.ending
        if alone.ending is Ending.closed:
            assert found.gap[k] <= 1e-12
            singular = 1e-5 if name == "double root" else 1e-11
            np.testing.assert_allclose(found.x[k], alone.q, atol=singular)
        else:
            np.testing.assert_allclose(found.gap[k], alone.gap, rtol=1e-6)


def test_redundant_equations_converge_quadratically_to_rounding():
    case = problems()["circle and line"]
    x, p = case.data(200)
    found = case.solve(x, p)
    closed = found.ended(Ending.closed)
    assert closed.mean() > 0.9
    assert found.gap[closed].max() < 1e-13
    assert found.steps[closed].max() < 20
    expected = np.sqrt(0.5) * p[closed]
    np.testing.assert_allclose(np.abs(found.x[closed]), np.repeat(expected, 2, 1), atol=1e-14)


def test_nearly_dependent_equations_close_to_rounding():
    case = problem(6, 6, hilbert)
    rng = np.random.default_rng(0)
    p = rng.uniform(-1, 1, size=(50, 6))
    found = case.solve(p + 0.05 * rng.uniform(-1, 1, size=(50, 6)), p)
    assert found.ended(Ending.closed).all()
    assert found.gap.max() < 1e-13
    assert found.steps.max() < 30


@pytest.mark.parametrize("name", ["circle and line", "four-bar"])
def test_scales_make_equations_and_unknowns_of_any_unit_alike(name):
    plain = problems()[name]
    k = plain.residual.inputs["p"]
    to_rows = 10.0 ** np.array([5, -6, 3])[: plain.m]
    to_x = 10.0 ** np.array([-4, 6])
    scaled = problem(
        2,
        k,
        lambda x, p: [
            float(scale) * row
            for scale, row in zip(
                to_rows, {"four-bar": four_bar}.get(name, circle_and_line)(x / to_x, p), strict=True
            )
        ],
    )
    x, p = plain.data(100)
    found = scaled.solve(x * to_x, p, row_scale=1 / to_rows, x_scale=to_x)
    expected = plain.solve(x, p)
    np.testing.assert_array_equal(found.ending, expected.ending)
    closed = found.ended(Ending.closed)
    np.testing.assert_allclose(found.x[closed] / to_x, expected.x[closed], atol=1e-10)


def test_free_motions_take_the_shortest_way():
    case = problems()["sphere"]
    x, p = case.data(50)
    found = case.solve(x, p)
    assert found.ended(Ending.closed).all()
    np.testing.assert_allclose(
        found.x, x / np.linalg.norm(x, axis=1)[:, None] * np.sqrt(p), atol=1e-12
    )


def test_a_number_scaled_by_zero_is_held():
    case = problems()["sphere"]
    x, p = case.data(50)
    x[:, 0] = 0.1
    found = case.solve(x, p, x_scale=[0, 1, 1])
    assert np.all(found.x[:, 0] == 0.1)
    assert found.ended(Ending.closed).all()


def test_each_row_has_its_own_ending():
    case = problems()["circle and line"]
    x = np.array([[2.0, 0.1], [np.nan, 1], [0.5**0.5, 0.5**0.5], [1.0, np.inf], [1e200, 1.0]])
    found = case.solve(x, [1.0])
    endings = [ENDINGS[code] for code in found.ending]
    closed, bad = Ending.closed, Ending.not_finite
    assert endings[:4] == [closed, bad, closed, bad]
    assert found.steps[2] == 0
    assert found.gap[1] == np.inf
    np.testing.assert_array_equal(found.x[1], x[1])
    assert case.solve(x[:1], [1.0], max_steps=2).ended(Ending.step_limit).all()
    assert case.solve(x[:1], [1.0], max_steps=0).ended(Ending.step_limit).all()
    assert problems()["no root"].solve([[0.7]], [1.0]).ended(Ending.open).all()


def test_codes_are_the_places_of_the_endings():
    assert (Ending.closed, Ending.open, Ending.step_limit, Ending.not_finite) == ENDINGS
    codes = (newton_loops.CLOSED, newton_loops.OPEN, newton_loops.STEP_LIMIT)
    assert (*codes, newton_loops.NOT_FINITE) == (0, 1, 2, 3)


def test_a_derivative_that_is_not_finite_at_the_start_is_named():
    case = problem(1, 0, lambda x, p: (ca.sqrt(x[0]) + 1,))
    assert case.solve([[0.0]], []).ended(Ending.not_finite).all()


# rotations


def rotated(q, a):
    w, v = q[0], q[1:]
    return a + 2 * ca.cross(v, ca.cross(v, a) + w * a)


@cache
def rotation():
    """Two directions turned onto two others: six equations of three rates."""
    q, p = ca.SX.sym("q", 4), ca.SX.sym("p", 12)
    turned = [rotated(q, p[3 * k : 3 * k + 3]) for k in range(2)]
    F = ca.vertcat(*(turned[k] - p[6 + 3 * k : 9 + 3 * k] for k in range(2)))
    J = ca.vertcat(*(-ca.skew(t) for t in turned))
    given = {"x": q, "p": p}
    angle = ca.sqrt(ca.sumsqr(TURN) + 1e-300)
    dq = ca.vertcat(ca.cos(angle / 2), ca.sin(angle / 2) / angle * TURN)
    w = dq[0] * q[0] - ca.dot(dq[1:], q[1:])
    v = dq[0] * q[1:] + q[0] * dq[1:] + ca.cross(dq[1:], q[1:])
    new = ca.vertcat(w, v)
    retract = Kernel("retract", {"q": q, "step": TURN}, new / ca.norm_2(new), (4,))
    return Problem(Kernel("F", given, F, (6,)), Kernel("J", given, J)), retract


def test_points_on_a_manifold_are_reached_by_its_retraction():
    case, retract = rotation()
    rng = np.random.default_rng(0)
    goal, start = rng.normal(size=(2, 80, 4))
    goal /= np.linalg.norm(goal, axis=1)[:, None]
    start /= np.linalg.norm(start, axis=1)[:, None]
    a = rng.normal(size=(80, 6))
    plain = np.hstack([a, np.zeros((80, 6))])
    p = np.hstack([a, case.residual(goal, plain)])
    options = {"retraction": retract.addresses.wide, "x_scale": np.ones(3)}
    found = case.solve(start, p, **options)
    closed = found.ended(Ending.closed)
    assert closed.mean() > 0.9
    np.testing.assert_allclose(np.linalg.norm(found.x, axis=1), 1, atol=1e-14)
    signs = np.sign(np.sum(found.x * goal, axis=1))[:, None]
    np.testing.assert_allclose((found.x * signs)[closed], goal[closed], atol=1e-12)
    same_bits(found, case.solve(start, p, threads=3, **options))


# no row sees its neighbours


@pytest.mark.parametrize("name", NAMES)
def test_a_row_does_not_depend_on_its_place_or_company(name):
    case = problems()[name]
    x, p = case.data(301, seed=1)
    x[17], x[200] = np.nan, 1e300
    whole = case.solve(x, p)
    order = np.random.default_rng(2).permutation(301)
    shuffled = case.solve(x[order], p[order])
    for a, b in zip(rows_of(whole), rows_of(shuffled), strict=True):
        np.testing.assert_array_equal(a[order], b)
    for k in (0, 17, 100, 300):
        alone = case.solve(x[k : k + 1], p[k : k + 1])
        for a, b in zip(rows_of(whole), rows_of(alone), strict=True):
            np.testing.assert_array_equal(a[k : k + 1], b)


@pytest.mark.parametrize("threads", [2, 3, 7, 1000])
def test_results_do_not_depend_on_the_number_of_threads(threads):
    case = problems()["four-bar"]
    x, p = case.data(500, seed=3)
    same_bits(case.solve(x, p, threads=1), case.solve(x, p, threads=threads))


def test_one_set_of_parameters_serves_all_rows():
    case = problems()["circle and line"]
    x, _ = case.data(100)
    same_bits(case.solve(x, [1.2]), case.solve(x, np.full((100, 1), 1.2), threads=4))


def test_narrow_and_wide_kernels_give_the_same_bits():
    case = problems()["four-bar"]
    x, p = case.data(100)
    narrow = [k.addresses.scalar for k in (case.residual, case.jacobian)]
    same_bits(case.solve(x, p), solve_batch(*narrow, x, p, case.m))


def test_starts_are_left_as_they_were():
    case = problems()["sphere"]
    x, p = case.data(10)
    before = x.copy()
    case.solve(x, p)
    np.testing.assert_array_equal(x, before)
    x.flags.writeable = p.flags.writeable = False
    same_bits(case.solve(x, p), case.solve(np.asfortranarray(before), p))


# arguments


def test_no_rows_and_no_equations():
    case = problems()["sphere"]
    empty = case.solve(np.zeros((0, 3)), np.zeros((0, 1)))
    assert [part.shape[0] for part in rows_of(empty)] == [0] * 4
    found = solve_batch(0, 0, np.ones((2, 3)), [], 0)
    assert found.ended(Ending.closed).all()
    np.testing.assert_array_equal(found.x, 1)


def test_nothing_to_move():
    x, p = ca.SX.sym("x", 0), ca.SX.sym("p", 1)
    F = Kernel("F", {"x": x, "p": p}, p - 1, (1,))
    found = solve_batch(F.addresses.wide, 0, np.zeros((2, 0)), [[1.0], [2.0]], 1)
    assert [ENDINGS[k] for k in found.ending] == [Ending.closed, Ending.open]


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"x0": np.ones(3)}, r"x0 has shape \(3,\), expected \(rows, n\)"),
        ({"p": np.ones((3, 1))}, r"p has shape \(3, 1\), expected \(2, k\) or \(k,\)"),
        ({"p": 1.0}, r"p has shape \(\), expected \(2, k\) or \(k,\)"),
        ({"row_scale": np.ones(2)}, r"row_scale has shape \(2,\), expected \(1,\)"),
        ({"x_scale": np.ones(2)}, r"x_scale has shape \(2,\), expected \(3,\)"),
        ({"x_scale": np.ones((1, 3))}, r"x_scale has shape \(1, 3\), expected \(v,\)"),
        ({"x0": np.ones((2, 3), complex)}, "x0 holds complex128, expected real numbers"),
        ({"retraction": 1}, r"x_scale is None, expected shape \(v,\)"),
        ({"equations": -1}, "equations is -1, expected a whole number from 0 up"),
        ({"max_steps": -1}, "max_steps is -1, expected a whole number from 0 up"),
        ({"threads": 0}, "threads is 0, expected a whole number from 1 up, or None"),
    ],
)
def test_wrong_arguments_are_named(changed, message):
    given = {"x0": np.ones((2, 3)), "p": np.ones(1), "equations": 1} | changed
    with pytest.raises(ValueError, match=message):
        solve_batch(0, 0, **given)
