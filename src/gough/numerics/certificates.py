"""Proofs that solutions of homogeneous quadratic equations exist, each alone in a ball.

The equations F(x) = 0 have real coefficients, known within errors. A solution is a ray of x; one
point of it is picked by a real linear equation, the chart. That of a candidate z is

    a·(x - a) = 0,    a = Re z,

after its phase has been turned so that Re z is as long as it can be, and of length about 1. With
these n equations G, their derivative J, any matrix Y (an approximate inverse of J) and the norm
|x| = max |x_j|, let

    η >= |Y G(z)|,    δ >= |I - Y J(z)|,    κ >= |Y F''|.

If η - (1 - δ) r + κ r² / 2 has two roots r₁ < r₂, then one solution lies within r₁ of z, and it is
the only one in the chart nearer than r₂. For with T(x) = x - Y G(x) and h = x - z,

    |T(x) - z| <= η + δ |h| + κ |h|² / 2,

so T maps the ball of radius r₁ into itself, and there |T'| <= δ + κ r₁ < 1. As G is quadratic, two
solutions differ by e with 0 = Y J(m) e at their mean m, which |m - z| < (1 - δ) / κ = (r₁ + r₂) / 2
rules out unless e = 0 (radii polynomials: Hungria, Lessard and Mireles James 2016; Newton and
Kantorovich's theorem; Rump 2010, ch. 13).

If x* solves the equations, so does its conjugate, in the same chart, and |x* - conj z| <= r₁ too.
With i the largest |Im z_j|: if 2 i + r₁ < r₂, both are in the ball of the only solution, so
x* is real, and within r₁ of Re z; if i > r₁, it is not.

`certificate_loops` says how rounding is bounded. Everything holds for each system whose
coefficients are within the errors: with errors as large as the change of the coefficients along a
stretch of a path, one certificate holds all along it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import IntEnum
from fractions import Fraction
from functools import cached_property
from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gough.numerics.quadratics import Array, Complex, Quadratics, Whole

Mask = NDArray[np.bool_]
Kind = TypeVar("Kind", np.float64, np.complex128)


class Verdict(IntEnum):
    """What is proved of a candidate."""

    failed = 0
    """Nothing."""
    real = 1
    """A real solution is near, alone."""
    not_real = 2
    """A solution that is not real is near, alone. Its conjugate is another."""
    undecided = 3
    """A solution is near, alone; whether it is real is open."""


@dataclass(frozen=True)
class Certificates:
    """What is proved of each candidate. Norms are largest moduli.

    Candidate i has the chart a·(x - a) = 0 with a = Re x_i. There a solution lies within its radius
    of x_i, and none other nearer than its reach.
    """

    x: Complex
    """Refined candidates, with a real part of about length 1, (k, n); real where `real` says so."""
    radius: Array
    """Within which the solution lies, (k,); inf where nothing is proved."""
    reach: Array
    """Within which it is the only one, (k,); 0 where that is less than numbers here can tell."""
    verdict: NDArray[np.int8]
    """A `Verdict` each, (k,)."""

    @property
    def proved(self) -> Mask:
        """Which have a solution, (k,)."""
        return np.asarray(self.verdict != Verdict.failed)

    @property
    def real(self) -> Mask:
        """Which have a real solution, (k,)."""
        return np.asarray(self.verdict == Verdict.real)

    @cached_property
    def clashes(self) -> Whole:
        """Pairs (i, j), i < j, of proved ones whose solutions are not proved distinct, (pairs, 2).

        Solutions are distinct as rays: neither is a multiple of the other.
        """
        meets = self._meets(self.x) & self.proved & self.proved[:, None]
        return np.argwhere(np.triu(meets, 1))

    @cached_property
    def distinct(self) -> Mask:
        """The proved ones without those that clash with one before, (k,).

        Their solutions are proved to be pairwise distinct, so there are at least that many.
        """
        chosen = self.proved.copy()
        for i, j in self.clashes:  # in order, so that i is settled
            chosen[j] &= not chosen[i]
        return chosen

    @cached_property
    def lone(self) -> Mask:
        """Which are not real and have a conjugate that is proved to be none of the others, (k,).

        One of these proves that the list lacks a solution.
        """
        meets = (self._meets(self.x.conj()) & self.proved).any(axis=1)
        return np.asarray((self.verdict == Verdict.not_real) & ~meets)

    def _meets(self, x: Complex) -> Mask:
        """Which balls round x may hold the same solution as those here, (k, k)."""
        from gough.numerics import certificate_loops as loops

        meets = np.zeros((len(x), len(x)), np.bool_)
        radii, room = np.tile(self.radius, 2), np.empty((2, *x.shape))
        loops.compare_compiled(x, self.x, radii, *room, meets)
        return meets


def certify(
    pattern: Quadratics,
    coefficients: ArrayLike,
    errors: ArrayLike,
    candidates: ArrayLike,
    exact: Callable[[], Sequence[Fraction]] | None = None,
) -> Certificates:
    """What can be proved of each candidate, after a few Newton steps.

    Args:
        pattern: the equations.
        coefficients: of the entries, (entries,).
        errors: how far each may be from the true one, (entries,); from 0 up.
        candidates: approximate solutions of any length and phase, (k, n). Those that are 0 or not
            finite fail.
        exact: gives the true coefficients, each within its error. It is asked where double
            precision does not decide; those candidates are tried again in ball arithmetic, for
            milliseconds each. If the errors are 0, `fractions_of` makes them.

    Raises:
        ValueError: an argument has the wrong shape or value; the message names it.
    """
    c = _given("coefficients", coefficients, ("entries",), np.float64)
    spread = _given("errors", errors, ("entries",), np.float64)
    z = _given("candidates", candidates, ("k", "n"), np.complex128)
    _check(pattern, c, spread, z)
    found = Certificates(
        np.empty(z.shape, np.complex128),
        np.empty(len(z)),
        np.empty(len(z)),
        np.empty(len(z), np.int8),
    )
    _run(pattern, c, spread, z, found)
    if exact is not None:
        _try_again(pattern, c, spread, z, exact, found)
    return found


def fractions_of(coefficients: ArrayLike) -> list[Fraction]:
    """The exact values of floating-point numbers, (entries,)."""
    return [Fraction(c) for c in np.asarray(coefficients, np.float64).tolist()]


def _run(
    pattern: Quadratics, c: Array, errors: Array, candidates: Complex, found: Certificates
) -> Array:
    """Judge the candidates in double precision; η, δ, κ and the largest |z_j| of each, (k, 4)."""
    from gough.numerics import certificate_loops as loops

    reals, whole = loops.room(pattern.unknowns, len(c))
    bounds = np.empty((len(candidates), 4))
    loops.certify_compiled(
        pattern.unknowns,
        pattern.rows,
        pattern.left,
        pattern.right,
        pattern.starts,
        c,
        errors,
        candidates,
        found.x,
        found.radius,
        found.reach,
        found.verdict,
        bounds,
        np.empty(reals),
        np.empty(whole, np.int64),
    )
    return bounds


def _try_again(
    pattern: Quadratics,
    c: Array,
    errors: Array,
    candidates: Complex,
    exact: Callable[[], Sequence[Fraction]],
    found: Certificates,
) -> None:
    """Judge those that are not decided in ball arithmetic, in place."""
    unsettled = (found.verdict == Verdict.failed) | (found.verdict == Verdict.undecided)
    unsettled &= np.isfinite(candidates).all(axis=1) & candidates.any(axis=1)
    if not unsettled.any():
        return
    from gough.numerics.certificate_balls import certify_one

    true = _true_coefficients(exact(), c, errors)
    for i in np.flatnonzero(unsettled):
        ball = certify_one(pattern, true, candidates[i])
        if ball is not None:
            found.x[i], found.radius[i], found.reach[i], found.verdict[i] = ball


def _true_coefficients(given: Sequence[Fraction], c: Array, errors: Array) -> list[Fraction]:
    """The exact coefficients, checked."""
    true = [Fraction(value) for value in given]
    if len(true) != len(c):
        raise ValueError(f"exact gives {len(true)} coefficients, expected {len(c)}")
    near = zip(true, fractions_of(c), fractions_of(errors), strict=True)
    for e, (value, about, error) in enumerate(near):
        if abs(value - about) > error:
            raise ValueError(
                f"exact gives {float(value)!r} as coefficient {e}, "
                f"expected within {float(error)!r} of {float(about)!r}"
            )
    return true


def _given(name: str, given: ArrayLike, shape: tuple[str, ...], kind: type[Kind]) -> NDArray[Kind]:
    """An array that compiled loops may read as it stands."""
    values = np.asarray(given)
    if values.ndim != len(shape):
        expected = f"({', '.join(shape)}{',' if len(shape) == 1 else ''})"
        raise ValueError(f"{name} has shape {values.shape}, expected {expected}")
    if not np.can_cast(values.dtype, kind, "same_kind"):
        numbers = "real" if kind is np.float64 else "complex"
        raise ValueError(f"{name} holds {values.dtype}, expected {numbers} numbers")
    # one type for numba: in order, aligned and, though never written, writeable
    return np.require(values, kind, ["C", "A", "W"])


def _check(pattern: Quadratics, c: Array, errors: Array, candidates: Complex) -> None:
    """Raise if shapes or values do not fit."""
    entries, n = len(pattern.rows), pattern.unknowns
    for name, values, expected in (
        ("coefficients", c, (entries,)),
        ("errors", errors, (entries,)),
        ("candidates", candidates, (len(candidates), n)),
    ):
        if values.shape != expected:
            raise ValueError(f"{name} has shape {values.shape}, expected {expected}")
    if not np.isfinite(c).all():
        raise ValueError(f"coefficients[{np.argmin(np.isfinite(c))}] is not finite")
    if not (np.isfinite(errors) & (errors >= 0)).all():
        bad = np.argmin(np.isfinite(errors) & (errors >= 0))
        raise ValueError(f"errors[{bad}] is {errors[bad]}, expected a finite number from 0 up")
