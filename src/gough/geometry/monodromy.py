"""All solutions of the generic member of a family of quadratic systems, from one solution.

The family is spanned by the coefficients that a mechanism has for various positions of its known
joints, with a free right-hand side for each equation but those that angles, rotations and vectors
fulfil by themselves. The points x that fulfil these are an irreducible variety V, and the points
(x, e) with x in V and F(x) = e are the graph of F over it. So they are irreducible too, and loops
in the parameters join each solution with every other (Sommese and Wampler 2005, ch. 15; Duff and
others 2019). Solutions are complete when loops find nothing new and their sum moves linearly with
the right-hand side (the trace test; Sommese, Verschelde and Wampler 2002); a trace that bends says
nothing where solutions run to infinity.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from gough.errors import ConfigurationError
from gough.numerics.path_tracking import PathEnding, track
from gough.numerics.quadratics import Quadratics

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

SAME = 1e-6
"""Distance in projective space below which two solutions are one."""
REGULAR = 1e-9
"""Least singular value, relative to the largest, of the Jacobian at a solution that counts."""
FINITE = 1e-7
"""Least share of the homogenising unknown in a solution that is not at infinity."""
FEW, MANY = 5, 20
"""Loops without a new solution after which to stop, with and without a trace that agrees."""
SMALL = 50
"""With fewer solutions loops go on to the last: they cost next to nothing, and may each miss the
only point that joins some."""
MOST_LOOPS, MOST_SOLUTIONS = 60, 600
"""When to stop in any case: after some ten seconds, with more solutions left to find; a guess."""
STRAIGHT = 1e-8
"""Relative bend of the trace of a complete set."""


@dataclass(frozen=True)
class StartSet:
    """Solutions of one generic member of a family."""

    coefficients: Complex
    """Of the member, (entries,)."""
    x: Complex
    """Its solutions, of unit length, (solutions, n)."""
    complete: bool
    """Whether the trace test says that there are no others."""
    saturated: bool
    """Whether the last loops found nothing new, so that it was not cut short."""
    loops: int
    """How many were tracked."""


class Family:
    """Members of a family of systems.

    Args:
        pattern: of all of them.
        samples: coefficients of some real members, (samples, entries).
        loose: the equations whose right-hand side is free.
    """

    def __init__(self, pattern: Quadratics, samples: Array, loose: NDArray[np.int64]) -> None:
        self.pattern, self.samples = pattern, samples
        at = (pattern.left == 0) & (pattern.right == 0) & np.isin(pattern.rows, loose)
        self.constants = np.flatnonzero(at)

    def member(self, rng: np.random.Generator) -> Complex:
        """A random complex member."""
        weights = _complex(rng, len(self.samples))
        weights += (1 - weights.sum()) / len(weights)
        c = weights @ self.samples
        c[self.constants] += self.right_hand_side(rng)
        return np.asarray(c)

    def right_hand_side(self, rng: np.random.Generator) -> Complex:
        """A random constant for each equation, of any size from one to ten."""
        return np.asarray(10.0 ** rng.uniform() * _complex(rng, len(self.constants)))


def _complex(rng: np.random.Generator, n: int) -> Complex:
    return np.asarray(rng.normal(size=n) + 1j * rng.normal(size=n))


def find_start_set(family: Family, real: Array, x: Array, rng: np.random.Generator) -> StartSet:
    """Every solution of a random member.

    Args:
        family: what it is a member of.
        real: coefficients of a real member, (entries,).
        x: a regular solution of that, (n,).
        rng: of the random choices.

    Raises:
        ConfigurationError: the solution leads nowhere.
    """
    base, found = _first(family, real, x, rng)
    fruitless = loops = 0
    complete = False
    while loops < MOST_LOOPS and len(found) < MOST_SOLUTIONS and not complete:
        round_trip = _loop(family, base, found, rng)
        more = distinct(np.vstack([found, round_trip]))
        loops += 1
        fruitless = 0 if len(more) > len(found) else fruitless + 1
        found = more
        if fruitless and fruitless % FEW == 0:
            complete = trace_agrees(family, base, found, rng)
        if fruitless >= MANY and len(found) >= SMALL:
            break
    return StartSet(base, found, complete, fruitless >= FEW, loops)


def _first(
    family: Family, real: Array, x: Array, rng: np.random.Generator
) -> tuple[Complex, Complex]:
    """A random member with the solution that a real one leads to."""
    for _ in range(20):
        base = family.member(rng)
        found = sound(family, base, _tracked(family, real.astype(complex), base, x[None]))
        if len(found):
            return base, found
    raise ConfigurationError(
        "no path leads from home to a general mechanism of its kind, so its modes can not be "
        "searched for; home may be singular: give another"
    )


def _loop(family: Family, base: Complex, x: Complex, rng: np.random.Generator) -> Complex:
    """Where the solutions come back to along a triangle of members."""
    corners = [base, family.member(rng), family.member(rng), base]
    for start, target in pairwise(corners):
        x = _tracked(family, start, target, x)
    return sound(family, base, x)


def _tracked(family: Family, start: Complex, target: Complex, x: NDArray[np.number]) -> Complex:
    """Ends of the paths that arrive."""
    paths = track(family.pattern, start, target, np.asarray(x, dtype=complex), light=1)
    return np.asarray(paths.x[paths.ended(PathEnding.arrived)])


def trace_agrees(family: Family, base: Complex, x: Complex, rng: np.random.Generator) -> bool:
    """Whether the sum of the solutions is linear along a line of right-hand sides."""
    if not len(family.constants):
        return False
    step = np.zeros_like(base)
    step[family.constants] = 0.3 * family.right_hand_side(rng)
    sums = [(x[:, 1:] / x[:, :1]).sum(axis=0)]
    for k in (1, 2):
        moved = _tracked(family, base, base + k * step, x)
        if len(moved) < len(x):
            return False
        sums.append((moved[:, 1:] / moved[:, :1]).sum(axis=0))
    bend = np.abs(sums[0] - 2 * sums[1] + sums[2]).max(initial=0.0)
    return bool(bend <= STRAIGHT * max(np.abs(sums).max(), 1.0))


def sound(family: Family, c: NDArray[np.number], x: Complex) -> Complex:
    """The solutions that are finite and regular."""
    x = x[np.abs(x[:, 0]) > FINITE * np.linalg.norm(x, axis=1)]
    return x[regular(family.pattern, c, x)] if len(x) else x


def regular(pattern: Quadratics, c: NDArray[np.number], x: Complex) -> NDArray[np.bool_]:
    """Whether the Jacobian at each solution has full rank, (solutions,)."""
    J = pattern.jacobian(c, x)
    size = np.maximum(np.linalg.norm(J, axis=-1, keepdims=True), 1e-300)
    patched = np.concatenate([J / size, x.conj()[:, None, :]], axis=1)
    s = np.linalg.svd(patched, compute_uv=False)
    return np.asarray(s[:, -1] > REGULAR * s[:, 0])


def distinct(x: Complex) -> Complex:
    """Solutions of unit length, each once, in the order of their first."""
    x = x / np.linalg.norm(x, axis=1, keepdims=True)
    return np.asarray(x[first_of_each(x)])


def first_of_each(x: Complex) -> list[int]:
    """The first of all rays that are the same, by their places, (rays, n)."""
    x = x / np.linalg.norm(x, axis=1, keepdims=True)
    alike = np.abs(x.conj() @ x.T) > 1 - SAME**2 / 2
    kept: list[int] = []
    for k in range(len(x)):
        if not alike[k, kept].any():
            kept.append(k)
    return kept
