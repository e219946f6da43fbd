"""Proofs of solutions: never a wrong one, checked against exact roots and many-digit arithmetic."""

import itertools
import subprocess
import sys
from fractions import Fraction

import mpmath
import numpy as np
import pytest

from gough.numerics import certificate_loops as loops
from gough.numerics.certificate_balls import certify_one
from gough.numerics.certificates import Certificates, Verdict, certify, fractions_of
from gough.numerics.quadratics import Quadratics

DIGITS = 80


def dense(n):
    """All pairs of unknowns in each equation."""
    left, right = np.triu_indices(n)
    rows = np.repeat(np.arange(n - 1), len(left))
    return Quadratics(n, rows, np.tile(left, n - 1), np.tile(right, n - 1))


def products_of_forms(n, real, seed):
    """Equations (p·x)(q·x) = 0, or |(p + i q)·x|² = 0, of whole numbers, and their 2ⁿ⁻¹ roots."""
    rng = np.random.default_rng(seed)
    p, q = rng.integers(-4, 5, size=(2, n - 1, n))
    pattern, kinds = dense(n), np.broadcast_to(real, n - 1)
    c, factors = [], []
    for a, b, lines in zip(p, q, kinds, strict=True):
        M = np.outer(a, b) if lines else np.outer(a, a) + np.outer(b, b)
        c.append((np.triu(M + M.T, 1) + np.diag(np.diag(M)))[np.triu_indices(n)])
        factors.append((a + 0j, b + 0j) if lines else (a + 1j * b, a - 1j * b))
    roots = [across(rows) for rows in itertools.product(*factors)]
    return pattern, np.concatenate(c).astype(float), roots


def across(rows):
    """The vector normal to n - 1 vectors of whole complex numbers, by minors."""
    with mpmath.workdps(DIGITS):
        M, n = mpmath.matrix(np.array(rows).tolist()), len(rows) + 1
        keep = [[k for k in range(n) if k != j] for j in range(n)]
        minors = [mpmath.matrix([[M[i, k] for k in row] for i in range(n - 1)]) for row in keep]
        x = [(-1) ** j * determinant(minor) for j, minor in enumerate(minors)]
        largest = max(x, key=abs)
        return [value / largest for value in x]


def determinant(M):
    if M.rows == 1:
        return M[0, 0]
    return sum(
        (-1) ** j
        * M[0, j]
        * determinant(
            mpmath.matrix([[M[i, k] for k in range(M.rows) if k != j] for i in range(1, M.rows)])
        )
        for j in range(M.rows)
    )


def in_chart(root, x):
    """The point of a ray in the chart of a centre, or None if it has none."""
    a = [mpmath.mpf(value.real) for value in x.tolist()]
    along = sum(p * q for p, q in zip(a, root, strict=True))
    if abs(along) < mpmath.mpf(10) ** (-DIGITS // 2):
        return None
    length = sum(value * value for value in a)
    return [value * length / along for value in root]


def distance(point, x):
    return max(abs(p - mpmath.mpc(q)) for p, q in zip(point, x.tolist(), strict=True))


def is_real(point):
    return max(abs(mpmath.im(value)) for value in point) < mpmath.mpf(10) ** (-DIGITS // 2)


def assert_sound(found, roots):
    """Each proved ball holds one root and reaches to no other, and is real as the root is."""
    owners = np.full(len(found.x), -1)
    with mpmath.workdps(DIGITS):
        for i in np.flatnonzero(found.proved):
            points = [in_chart(root, found.x[i]) for root in roots]
            gaps = [mpmath.inf if p is None else distance(p, found.x[i]) for p in points]
            owners[i] = int(np.argmin(gaps))
            assert gaps[owners[i]] <= found.radius[i]
            assert sum(gap < found.reach[i] for gap in gaps) <= 1
            verdict = Verdict(found.verdict[i])
            if verdict != Verdict.undecided:
                assert is_real(points[owners[i]]) == (verdict == Verdict.real)
            if verdict == Verdict.real:
                assert not found.x[i].imag.any()
    chosen = owners[found.distinct]
    assert len(set(chosen)) == len(chosen)
    assert np.all(np.isinf(found.radius[~found.proved]))
    return owners


def doubles(roots):
    return np.array([[complex(value) for value in root] for root in roots])


KINDS = [
    (2, True),
    (3, True),
    (3, False),
    (4, True),
    (4, False),
    (4, [True, False, True]),
    (6, [False, True, True, False, True]),
]


@pytest.mark.parametrize(("n", "real"), KINDS)
def test_all_roots_of_products_of_forms_are_proved_distinct(n, real):
    pattern, c, roots = products_of_forms(n, real, n)
    rng = np.random.default_rng(n)
    turned = doubles(roots) * np.exp(1j * rng.uniform(0, 7, size=(len(roots), 1)))
    found = certify(pattern, c, np.zeros(len(c)), turned * 10.0 ** rng.integers(-9, 9))
    np.testing.assert_array_equal(assert_sound(found, roots), np.arange(len(roots)))
    assert found.distinct.all()
    assert not found.clashes.size
    assert not found.lone.any()
    assert not np.any(found.verdict == Verdict.undecided)


@pytest.mark.parametrize(("n", "real"), KINDS)
def test_whatever_is_proved_from_random_starts_is_true(n, real):
    pattern, c, roots = products_of_forms(n, real, n + 10)
    rng = np.random.default_rng(n)
    starts = rng.normal(size=(150, n)) + 1j * rng.normal(size=(150, n)) * rng.integers(0, 2)
    starts[:50] = doubles(roots)[rng.integers(0, len(roots), 50)]
    starts[:50] += rng.normal(size=(50, n)) * 10.0 ** rng.uniform(-9, 0, size=(50, 1))
    found = certify(pattern, c, np.zeros(len(c)), starts)
    assert_sound(found, roots)
    assert found.proved.sum() > 20
    assert found.distinct.sum() <= len(roots)


# near singular


def near_double(eps):
    """(x + y)² = eps y² and (z - x)(z + 2 y) = 0: coefficients, and the roots near (-1, 1, -1)."""
    pattern = Quadratics(
        3, np.array([0, 0, 0, 1, 1, 1, 1]), np.array([0, 0, 1, 0, 0, 1, 2]),
        np.array([0, 1, 1, 1, 2, 2, 2]),
    )  # fmt: skip
    true = [Fraction(v) for v in (1, 2, 1 - eps, -2, -1, 2, 1)]
    with mpmath.workdps(DIGITS):
        root = mpmath.sqrt(mpmath.mpf(eps.numerator) / eps.denominator)
        xs = [-1 + root, -1 - root]
        roots = [[x, mpmath.mpf(1), z] for x in xs for z in (x, mpmath.mpf(-2))]
    return pattern, true, roots


EPS = [Fraction(sign, 10**k) for k in (2, 6, 12, 14, 16, 20, 24, 30) for sign in (1, -1)]


@pytest.mark.parametrize("eps", EPS)
@pytest.mark.parametrize("offset", [0.0, 1e-9, 1e-5j])
def test_nearly_double_roots(eps, offset):
    pattern, true, roots = near_double(eps)
    c = np.array([float(value) for value in true])
    errors = np.array([float(abs(v - Fraction(d))) for v, d in zip(true, c.tolist(), strict=True)])
    errors = np.nextafter(errors, np.inf)
    starts = doubles(roots) + offset * np.array([1.0, 0.5, 0.0])
    found = certify(pattern, c, errors, starts)
    assert_sound(found, roots)
    if offset == 0 or abs(eps) > 1e-8:
        retried = certify(pattern, c, errors, starts, lambda: true)
        assert_sound(retried, roots)
        expected = Verdict.real if eps > 0 else Verdict.not_real
        assert np.all(retried.verdict == expected)


@pytest.mark.parametrize("eps", [Fraction(1, 10**30), Fraction(-1, 10**30)])
def test_nearly_double_roots_at_zero_need_no_more_bits(eps):
    pattern = dense(2)
    root = np.emath.sqrt(float(eps))
    c = [1.0, 0.0, -float(eps)]
    found = certify(pattern, c, [0, 0, 0], [[root, 1], [-root, 1]])
    assert np.all(found.verdict == (Verdict.real if eps > 0 else Verdict.not_real))
    assert found.distinct.all()


@pytest.mark.parametrize("exact", [False, True])
@pytest.mark.parametrize("c", [[1, -2, 1], [1, 0, 0], [0, 0, 0]])
def test_double_roots_are_not_proved(c, exact):
    given = np.array(c, float)
    starts = [[1, 1], [1, 1 + 1e-9], [1, 1 + 1e-6j], [1e-12, 1], [3, 1], [1j, 1e-3]]
    true = (lambda: fractions_of(given)) if exact else None
    assert not certify(dense(2), given, [0, 0, 0], starts, true).proved.any()


def test_realness_within_errors_is_left_open_or_true():
    """x² = eps y² with an error larger than eps has real and other solutions nearby."""
    for eps in (1e-6, -1e-6, 0.0):
        root = np.emath.sqrt(eps)
        found = certify(dense(2), [1, 0, -eps], [0, 0, 1.1e-6], [[root, 1], [-root, 1]])
        assert not found.proved.any()


# bounds of rounding


def run_with_room(pattern, c, errors, starts):
    """Bounds, centres and approximate inverses of at most sixteen candidates."""
    n, k, W = pattern.unknowns, len(starts), loops.W
    reals, whole = loops.room(n, len(c))
    reals, whole = np.empty(reals), np.empty(whole, np.int64)
    x, bounds = np.empty((k, n), complex), np.empty((k, 4))
    verdict = np.empty(k, np.int8)
    loops.certify_compiled(
        n, pattern.rows, pattern.left, pattern.right, pattern.starts, c, errors, starts, x,
        np.empty(k), np.empty(k), verdict, bounds, reals, whole,
    )  # fmt: skip
    place = 2 * len(c) + n
    place += (-(reals.ctypes.data // 8 + place)) % W
    numbers = reals[place : place + 2 * W * (2 * n + 2 * n * n)].reshape(-1, 2, W)
    numbers = np.moveaxis(numbers[:, 0] + 1j * numbers[:, 1], -1, 0)[:k]
    return bounds, numbers[:, :n], numbers[:, 2 * n + n * n :].reshape(k, n, n)


def exact_bounds(pattern, c, z, Y):
    """η, δ and κ in many digits of scaled equations with coefficients c."""
    n = pattern.unknowns
    z = [mpmath.mpc(value) for value in z.tolist()]
    a = [value.real for value in z]
    Y = mpmath.matrix(Y.tolist())
    G, J = mpmath.zeros(n, 1), mpmath.zeros(n, n)
    curved = mpmath.zeros(n, n * n)
    entries = zip(pattern.rows.tolist(), pattern.left.tolist(), pattern.right.tolist(), strict=True)
    for value, (i, p, q) in zip(c, entries, strict=True):
        G[i] += value * z[p] * z[q]
        J[i, p] += value * z[q]
        J[i, q] += value * z[p]
        curved[i, n * p + q] += value
    G[n - 1] = sum(p * (q - p) for p, q in zip(a, z, strict=True))
    for j in range(n):
        J[n - 1, j] = a[j]
    eta = max(abs(value) for value in Y * G)
    return eta, norm(mpmath.eye(n) - Y * J), 2 * norm(Y * curved)


def norm(M):
    return max(sum(abs(M[i, j]) for j in range(M.cols)) for i in range(M.rows))


def scaled(pattern, c, errors, corner):
    """Exact coefficients in a corner of the errors, equations multiplied as the loops do."""
    largest = np.zeros(pattern.unknowns - 1)
    np.maximum.at(largest, pattern.rows, np.maximum(np.abs(c), errors))
    power = np.frexp(largest)[1][pattern.rows].tolist()
    moved = zip(c.tolist(), errors.tolist(), corner.tolist(), power, strict=True)
    return [
        mpmath.ldexp(mpmath.mpf(value) + side * mpmath.mpf(error), -shift)
        for value, error, side, shift in moved
    ]


@pytest.mark.parametrize("n", [2, 3, 5])
@pytest.mark.parametrize("relative", [0.0, 1e-15, 1e-3])
def test_bounds_hold_in_exact_arithmetic(n, relative):
    rng = np.random.default_rng(n)
    pattern = dense(n)
    c = rng.normal(size=len(pattern.rows)) * 10.0 ** rng.integers(-4, 4, len(pattern.rows))
    c *= 10.0 ** rng.integers(-20, 20, n - 1)[pattern.rows]
    errors = relative * np.abs(c) * rng.uniform(size=len(c))
    starts = rng.normal(size=(12, n)) + 1j * rng.normal(size=(12, n))
    bounds, centres, inverses = run_with_room(pattern, c, errors, starts)
    checked = 0
    with mpmath.workdps(DIGITS):
        corners = np.vstack([np.zeros(len(c)), rng.choice([-1, 1], size=(3, len(c)))])
        for given, z, Y in zip(bounds, centres, inverses, strict=True):
            for corner in corners:
                if not np.isfinite(given).all():
                    continue
                true = exact_bounds(pattern, scaled(pattern, c, errors, corner), z, Y)
                assert all(upper >= value for upper, value in zip(given, true, strict=False))
                checked += 1
    assert checked > 20


def test_curvature_is_not_overestimated_by_much():
    rng = np.random.default_rng(0)
    pattern = dense(4)
    c = rng.normal(size=len(pattern.rows))
    starts = rng.normal(size=(8, 4)) + 0j
    bounds, centres, inverses = run_with_room(pattern, c, 0 * c, starts)
    zero = np.zeros(len(c))
    for given, z, Y in zip(bounds, centres, inverses, strict=True):
        kappa = exact_bounds(pattern, scaled(pattern, c, zero, zero), z, Y)[2]
        assert kappa <= given[2] <= kappa * (1 + 1e-10)


@pytest.mark.parametrize("size", [1e-6, 1e-3])
@pytest.mark.parametrize("real", [True, False])
def test_the_ball_holds_the_solution_of_every_system_within_the_errors(size, real):
    pattern, c, roots = products_of_forms(3, real, 3)
    errors = size * np.abs(c)
    found = certify(pattern, c, errors, doubles(roots))
    assert found.proved.sum() > 1
    rng = np.random.default_rng(1)
    with mpmath.workdps(40):
        for i in np.flatnonzero(found.proved):
            x = found.x[i]
            for corner in rng.choice([-1, 1], size=(6, len(c))):
                moved = scaled(pattern, c, errors, corner)
                point = newton(pattern, moved, x)
                assert distance(point, x) <= found.radius[i]
                assert (max(abs(p.imag) for p in point) < 1e-30) == found.real[i]
            if size < 1e-5:
                assert found.radius[i] < 1.01 * first_order(pattern, c, errors, x)


def first_order(pattern, c, errors, x):
    """How far a solution may move by the errors, to first order."""
    J = np.vstack([pattern.jacobian(c, x), x.real])
    moves = np.abs(np.linalg.inv(J))[:, pattern.rows]
    return (moves @ (errors * np.abs(x[pattern.left] * x[pattern.right]))).max()


def newton(pattern, c, x):
    """A solution in the chart of x in many digits."""
    n = pattern.unknowns
    z, a = mpmath.matrix(x.tolist()), mpmath.matrix(x.real.tolist())
    for _ in range(12):
        G, J = mpmath.zeros(n, 1), mpmath.zeros(n, n)
        for value, i, p, q in zip(
            c, pattern.rows.tolist(), pattern.left.tolist(), pattern.right.tolist(), strict=True
        ):
            G[i] += value * z[p] * z[q]
            J[i, p] += value * z[q]
            J[i, q] += value * z[p]
        for j in range(n):
            G[n - 1] += a[j] * (z[j] - a[j])
            J[n - 1, j] = a[j]
        z = z - mpmath.lu_solve(J, G)
    return [mpmath.mpc(value) for value in z]


# pairs


def test_multiples_of_a_solution_clash():
    pattern, c, roots = products_of_forms(4, [True, False, False], 2)
    x = doubles(roots)
    again = np.vstack([x, x[2:4] * (0.3 - 2j), x[:1]])
    found = certify(pattern, c, 0 * c, again)
    assert found.clashes.tolist() == [[0, 10], [2, 8], [3, 9]]
    assert found.distinct.tolist() == [True] * 8 + [False] * 3


def test_a_missing_conjugate_shows():
    pattern, c, roots = products_of_forms(4, False, 2)
    found = certify(pattern, c, 0 * c, doubles(roots)[1:])
    assert found.lone.tolist() == [False] * 6 + [True]


def test_balls_that_touch_are_not_called_distinct():
    x = np.array([[1.0, 0.5], [1.0, 0.5 + 4e-3]], complex)
    for radius, apart in ((1e-3, True), (3e-3, False)):
        found = Certificates(
            x, np.full(2, radius), np.full(2, 1.0), np.full(2, Verdict.real, np.int8)
        )
        assert found.distinct.all() == apart


# a six-leg platform

PLATFORM = np.array([
    [1.0289, 1.6419, 1.1467], [-0.9732, -1.3928, 0.0672], [0.8614, 0.5092, 1.8103],
    [0.7508, 0.6398, -0.7313], [-1.1077, 1.4844, 0.0489], [0.8115, -1.3764, -0.4364],
])  # fmt: skip
BASE = np.array([
    [-1.2911, -0.7757, 0.9031], [-1.4806, -0.5341, 0.1638], [-0.6685, -0.2523, -0.2219],
    [0.4181, -0.4313, 0.2723], [0.0568, 0.4246, 0.2249], [1.6577, -0.6637, 1.1992],
])  # fmt: skip
LENGTHS = np.array([6.420441, 2.179364, 5.150343, 4.798504, 4.732846, 5.530277])
POSTURES = [
    ([-0.19740485219329745, 0.2546940215685492, 0.8382150748899145, -0.43995200639964904],
     [-2.2320668743959216, 0.5203141577933671, -2.9971238937381295]),
    ([-0.3399981198551259, 0.6712775782238438, 0.2567544504367999, -0.6065186259710478],
     [-1.8957735419267765, 0.6127547433235913, -3.191971981465956]),
    ([-0.1898233474576985, -0.1937242031808378, -0.67950173657871, 0.6817003886227592],
     [-1.021457783322454, -1.7208776164180266, -3.2253927543632264]),
    ([-0.2655492832527194, -0.24328085852079695, -0.5786468447124583, 0.7317553082456371],
     [-0.5812306593082299, -2.0832287401527365, -3.1472238097533243]),
]  # fmt: skip
"""Unit quaternions (w, x, y, z) and positions: all real postures."""


def product(a, b):
    """Of two quaternions."""
    real = a[0] * b[0] - a[1:] @ b[1:]
    return np.r_[real, a[0] * b[1:] + b[0] * a[1:] + np.cross(a[1:], b[1:])]


def platform_equations(X):
    """Six legs and the Study quadric, of a dual quaternion x + ε y with 2 y x* = |x|² p."""
    x, y = X[:4], X[4:]
    conjugate = x * [1, -1, -1, -1]
    rows = []
    for a, b, length in zip(PLATFORM, BASE, LENGTHS, strict=True):
        turned = product(product(x, np.r_[0, a]), conjugate)[1:]
        along = 2 * product(y, conjugate)[1:]
        across = 2 * product(conjugate, y)[1:]
        rows.append(
            (a @ a + b @ b - length**2) * (x @ x)
            + 4 * y @ y
            + 2 * (a @ across - b @ along - b @ turned)
        )
    return np.array([rows[0], *(np.array(rows[1:]) - rows[0]), x @ y])


def platform():
    """Pattern and coefficients by polarisation."""
    one, pattern = np.eye(8), dense(8)
    single = [platform_equations(e) for e in one]
    c = [
        single[p] if p == q else platform_equations(one[p] + one[q]) - single[p] - single[q]
        for p, q in zip(*np.triu_indices(8), strict=True)
    ]
    return pattern, np.array(c).T.ravel()


def postures():
    """Dual quaternions of the real postures."""
    return np.array([
        np.r_[q, product(np.r_[0, p], np.array(q)) / 2] for q, p in POSTURES
    ])  # fmt: skip


def test_real_postures_of_a_platform_are_proved():
    pattern, c = platform()
    found = certify(pattern, c, 1e-14 * (1 + np.abs(c)), postures())
    assert found.real.all()
    assert found.distinct.all()
    length = np.linalg.norm(found.x, axis=1) / np.linalg.norm(postures(), axis=1)
    gaps = np.abs(np.abs(found.x) - length[:, None] * np.abs(postures())).max(axis=1)
    np.testing.assert_array_less(gaps, found.radius + 1e-12)


def test_a_platform_never_has_more_than_forty_solutions_and_its_real_postures():
    pattern, c = platform()
    rng = np.random.default_rng(0)
    starts = rng.normal(size=(3000, 8)) + 1j * rng.normal(size=(3000, 8))
    refined = certify(pattern, c, 1e-14 * np.abs(c), starts).x
    refined = certify(pattern, c, 1e-14 * np.abs(c), refined[np.isfinite(refined).all(axis=1)]).x
    found = certify(pattern, c, 1e-14 * np.abs(c), refined[np.isfinite(refined).all(axis=1)])
    assert 20 < found.distinct.sum() <= 40
    assert (found.distinct & found.real).sum() <= len(POSTURES)


def test_balls_agree_with_double_precision():
    pattern, c = platform()
    start = postures()[0] + 0j
    found = certify(pattern, c, 0 * c, start[None])
    ball = certify_one(pattern, fractions_of(c), start)
    assert ball.verdict == Verdict.real
    assert ball.radius < 1e-15
    assert np.abs(ball.x - found.x[0]).max() < found.radius[0] + ball.radius
    np.testing.assert_allclose(ball.reach, found.reach[0], rtol=1e-6)


# arguments


def test_candidates_that_are_no_numbers_or_zero_fail():
    pattern, c, roots = products_of_forms(3, True, 5)
    x = np.vstack([doubles(roots), np.zeros((1, 3)), np.full((2, 3), np.nan)])
    x[-1] = [np.inf, 1, 1]
    for exact in (None, lambda: fractions_of(c)):
        found = certify(pattern, c, 0 * c, x, exact)
        assert found.proved.tolist() == [True] * 4 + [False] * 3
        assert np.all(np.isinf(found.radius[4:]))
        assert np.all(found.reach[4:] == 0)
        assert found.distinct.tolist() == [True] * 4 + [False] * 3


def test_a_candidate_does_not_see_its_neighbours():
    pattern, c, roots = products_of_forms(6, [False, True, True, False, True], 1)
    x = doubles(roots)
    found = certify(pattern, c, 0 * c, x)
    for i in range(len(x)):
        alone = certify(pattern, c, 0 * c, x[i : i + 1])
        assert alone.x.tobytes() == found.x[i].tobytes()
        assert alone.radius[0] == found.radius[i]


@pytest.mark.parametrize("power", [-300, -200, 200, 300])
def test_equations_and_candidates_of_any_size(power):
    pattern, c, roots = products_of_forms(3, True, 5)
    c = c * np.where(pattern.rows == 0, 10.0**power, 1.0)
    found = certify(pattern, c, 0 * c, doubles(roots) * 10.0**power)
    assert_sound(found, roots)
    assert found.proved.all()


def test_overflow_proves_nothing():
    """Errors as large as numbers can be."""
    pattern, c, roots = products_of_forms(3, True, 5)
    assert not certify(pattern, c, np.full(len(c), 1e308), doubles(roots)).proved.any()


def test_an_equation_without_entries_proves_nothing():
    pattern = Quadratics(3, np.array([0, 0]), np.array([0, 1]), np.array([0, 1]))
    for exact in (None, lambda: fractions_of([1, -1])):
        assert not certify(pattern, [1, -1], [0, 0], np.ones((2, 3)), exact).proved.any()


def test_no_candidates():
    found = certify(dense(3), np.ones(12), np.zeros(12), np.empty((0, 3)))
    assert found.x.shape == (0, 3)
    assert found.clashes.shape == (0, 2)
    assert found.distinct.shape == found.lone.shape == (0,)


def test_exact_coefficients_are_asked_only_where_needed():
    def never():
        raise AssertionError

    pattern, c, roots = products_of_forms(3, True, 5)
    assert certify(pattern, c, 0 * c, doubles(roots), never).real.all()


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"coefficients": np.ones(4)}, r"coefficients has shape \(4,\), expected \(3,\)"),
        ({"coefficients": np.ones((3, 1))}, r"coefficients has shape \(3, 1\), expected \(ent"),
        ({"coefficients": np.ones(3) * 1j}, "coefficients holds complex128, expected real"),
        ({"coefficients": [1, np.nan, 1]}, r"coefficients\[1\] is not finite"),
        ({"errors": np.ones(2)}, r"errors has shape \(2,\), expected \(3,\)"),
        ({"errors": [0, 0, -1]}, r"errors\[2\] is -1.0, expected"),
        ({"errors": [0, np.inf, 0]}, r"errors\[1\] is inf, expected"),
        ({"candidates": np.ones(2)}, r"candidates has shape \(2,\), expected \(k, n\)"),
        ({"candidates": np.ones((4, 3))}, r"candidates has shape \(4, 3\), expected \(4, 2\)"),
        ({"candidates": [["a", "b"]]}, "candidates holds <U1, expected complex"),
        ({"exact": lambda: [Fraction(1)]}, "exact gives 1 coefficients, expected 3"),
        ({"exact": lambda: [Fraction(2)] * 3}, "exact gives 2.0 as coefficient 0, expected within"),
    ],
)
def test_wrong_arguments_are_named(change, words):
    given = {
        "coefficients": np.ones(3),
        "errors": np.zeros(3),
        "candidates": [[1, 1]],
        "exact": lambda: [Fraction(1)] * 3,
    }
    given["coefficients"] = [1, -2, 1]  # fails, so that exact is asked
    with pytest.raises(ValueError, match=words):
        certify(dense(2), **(given | change))


def test_neither_numba_nor_flint_is_loaded_with_the_face():
    code = (
        "import sys, gough.numerics.certificates as c; "
        "sys.exit(bool({'numba', 'flint'} & set(sys.modules)))"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
