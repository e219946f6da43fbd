"""The proof of `certificates` for one candidate in ball arithmetic, with as many bits as it takes.

Coefficients are exact. Every number is a ball that holds the true one (Johansson 2017, Arb), so
rounding needs no bounds of its own. The chart is a·(x - a) = 0 with a of float64 numbers, the real
part of the centre that is handed back.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from fractions import Fraction
from functools import reduce
from typing import NamedTuple

import numpy as np
from flint import acb, acb_mat, arb, ctx, fmpq

from gough.numerics.certificates import Verdict
from gough.numerics.quadratics import Complex, Quadratics

BITS = (128, 256, 512)
"""Precisions to try; each starts where the last has ended."""
STEPS = 80
"""Most Newton steps at each. Near two solutions close to each other, or a double one, a step only
halves the distance until it is as small as theirs: from 1e-8, this tells apart what is 1e-30 apart.
Candidates that wander off take all of them, some 30 ms for eight unknowns."""


class Ball(NamedTuple):
    """What is proved of a candidate, as in `Certificates`."""

    x: Complex
    radius: float
    reach: float
    verdict: Verdict


def certify_one(
    pattern: Quadratics, coefficients: Sequence[Fraction], candidate: Complex
) -> Ball | None:
    """What can be proved of a candidate; None if nothing.

    Args:
        pattern: the equations.
        coefficients: of the entries, exact, (entries,).
        candidate: approximate solution, finite and not 0, (n,).
    """
    best, z = None, _turned(candidate)
    for bits in BITS:
        with ctx.workprec(bits):
            c = [arb(fmpq(value.numerator, value.denominator)) for value in coefficients]
            try:
                z, converged = _refine(pattern, c, z, bits)
                best = _prove(pattern, c, z) or best
            except ZeroDivisionError:  # J is singular
                break
        if not converged or (best is not None and best.verdict != Verdict.undecided):
            break
    return best


def _turned(candidate: Complex) -> list[acb]:
    """A candidate with a real part of length about 1, and as long as its phase allows."""
    x = candidate / max(np.abs(candidate.real).max(), np.abs(candidate.imag).max())
    square = complex(np.sum(x * x))
    if abs(square) > 0:
        x = x / np.sqrt(square / abs(square))
    x = x / np.linalg.norm(x.real)
    return [acb(value.real, value.imag) for value in x.tolist()]


def _doubles(numbers: Iterable[arb]) -> list[arb]:
    """The nearest float64 numbers."""
    return [arb(float(number.mid())) for number in numbers]


def _equations(
    pattern: Quadratics, c: list[arb], z: list[acb], a: list[arb]
) -> tuple[acb_mat, acb_mat]:
    """G (n, 1) and J (n, n) at a point in the chart of a."""
    n = pattern.unknowns
    G, J = acb_mat(n, 1), acb_mat(n, n)
    entries = zip(pattern.rows.tolist(), pattern.left.tolist(), pattern.right.tolist(), strict=True)
    for value, (i, left, right) in zip(c, entries, strict=True):
        first, second = value * z[left], value * z[right]
        G[i, 0] += first * z[right]
        J[i, left] += second
        J[i, right] += first
    for j in range(n):
        G[n - 1, 0] += a[j] * (z[j] - a[j])
        J[n - 1, j] = acb(a[j])
    return G, J


def _refine(pattern: Quadratics, c: list[arb], z: list[acb], bits: int) -> tuple[list[acb], bool]:
    """A solution by Newton steps, exact numbers in the chart of its rounded real part.

    Returns:
        the numbers, and whether the steps have become short.
    """
    a = _doubles(value.real for value in z)
    small, converged = arb(2) ** (-bits // 2), False
    for _ in range(STEPS):
        G, J = _equations(pattern, c, z, a)
        step = acb_mat(_middles(J)).solve(G).entries()
        z = [(value - change).mid() for value, change in zip(z, step, strict=True)]
        converged = all(change.abs_upper() < small for change in step)
        if converged:
            break
    a = _doubles(value.real for value in z)
    square = sum((value * value for value in a), arb(0))
    along = sum((value * number for value, number in zip(a, z, strict=True)), acb(0))
    return [(number * square / along).mid() for number in z], converged


def _middles(matrix: acb_mat) -> list[list[acb]]:
    """The middles of the balls of a matrix."""
    return [[entry.mid() for entry in row] for row in matrix.tolist()]


def _prove(pattern: Quadratics, c: list[arb], z: list[acb]) -> Ball | None:
    """Radii polynomial at a centre of exact numbers."""
    a = _doubles(value.real for value in z)
    G, J = _equations(pattern, c, z, a)
    Y = acb_mat(_middles(acb_mat(_middles(J)).inv()))
    eta = _largest((Y * G).entries())
    delta = _norm((Y * J - acb_mat(len(z), len(z), 1)).tolist())
    kappa = 2 * _norm(_curvatures(pattern, c, Y))
    q = 1 - delta
    square = q * q - 2 * kappa * eta
    if not (q > 0 and square > 0):
        return None
    q += square.sqrt()
    return _ball(z, a, 2 * eta / q, q / kappa)


def _largest(numbers: Iterable[acb]) -> arb:
    """Largest modulus, rounded up; NaN if one is NaN, which Python's max may drop."""
    return reduce(arb.max, (value.abs_upper() for value in numbers))


def _norm(rows: Iterable[Iterable[acb]]) -> arb:
    """Largest sum of the moduli of a row, rounded up."""
    return _largest(acb(sum((value.abs_upper() for value in row), arb(0))) for row in rows)


def _curvatures(pattern: Quadratics, c: list[arb], Y: acb_mat) -> list[list[acb]]:
    """Σ_j Y_ij c_j,pair for each i and each pair of unknowns."""
    pairs: dict[tuple[int, int], list[tuple[int, arb]]] = {}
    entries = zip(pattern.left.tolist(), pattern.right.tolist(), pattern.rows.tolist(), strict=True)
    for value, (left, right, row) in zip(c, entries, strict=True):
        pairs.setdefault((left, right), []).append((row, value))
    return [
        [sum((Y[i, row] * value for row, value in terms), acb(0)) for terms in pairs.values()]
        for i in range(pattern.unknowns)
    ]


def _ball(z: list[acb], a: list[arb], radius: arb, reach: arb) -> Ball:
    """The ball round the float64 numbers next to a centre, and the verdict."""
    imaginary = _largest(acb(value.imag) for value in z)
    if 2 * imaginary + radius < reach:
        verdict, parts = Verdict.real, [arb(0)] * len(z)
    else:
        verdict = Verdict.not_real if imaginary > radius else Verdict.undecided
        parts = _doubles(value.imag for value in z)
    centre = [acb(real, part) for real, part in zip(a, parts, strict=True)]
    distance = _largest(value - number for value, number in zip(z, centre, strict=True))
    x = np.array([complex(float(value.real), float(value.imag)) for value in centre])
    wide, far = float((radius + distance).upper()), float((reach - distance).lower())
    return Ball(
        x, float(np.nextafter(wide, np.inf)), max(0.0, float(np.nextafter(far, 0))), verdict
    )
