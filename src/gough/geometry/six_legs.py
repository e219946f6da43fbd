"""Six legs of one platform, recognised from the closure equations of a mechanism."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from gough import algebra as al
from gough.algebra import Scalar
from gough.geometry.problem import Problem
from gough.geometry.quadratic_closure import QuadraticClosure
from gough.kernels import Kernel
from gough.symbolic.natural.parts import Condition

Array = NDArray[np.float64]

AGREES = 1e-10
"""Relative size of a coefficient that should be zero."""


@dataclass(frozen=True)
class SixLegs:
    """Points joined by legs of given lengths, |R a + p - b| = L."""

    base: Array
    """The points b, in base axes, (6, 3), m."""
    platform: Array
    """The points a, in axes of the platform, (6, 3), m."""
    lengths: Array
    """(6,), m."""


class LegEquations:
    """The legs of a platform as functions of what is known.

    With the platform's position p and vectors u_j = R g_j of it as unknowns, a leg's equation is

        p·p + 2 p·(Σ β_j u_j - b) - 2 b·(Σ β_j u_j) + constant = 0,    a = Σ β_j g_j.
    """

    def __init__(self, kernel: Kernel, p: Array) -> None:
        self._kernel, self._p = kernel, p

    @classmethod
    def of(cls, problem: Problem, closure: QuadraticClosure) -> LegEquations | None:
        """The legs of a mechanism, or None if its equations are of another kind."""
        places = _Places.of(problem, closure)
        if places is None:
            return None
        natural = problem.natural
        legs = [k for k, c in enumerate(natural.conditions) if not natural.keeps_shape(c)]
        for q in problem.states:
            tables = closure.tables(q)
            if not all(places.is_leg(tables[k]) for k in legs):
                return None
        scalars = [x for k in legs for x in places.leg(problem, natural.conditions[k])]
        return cls(problem.kernel("six_legs", scalars), problem.assembler.p)

    def at(self, q: Array) -> SixLegs:
        """The legs for the known positions in q."""
        table = self._kernel(q, self._p).reshape(6, 7)
        return SixLegs(table[:, :3].copy(), table[:, 3:6].copy(), table[:, 6].copy())


@dataclass(frozen=True)
class _Places:
    """Where the unknowns of a platform stand."""

    position: list[int]
    """Unknowns of the platform's position."""
    vectors: list[list[int]]
    """Unknowns of each of its vectors."""
    place: dict[int, int]
    """The place of each unknown in the closure's tables."""

    @classmethod
    def of(cls, problem: Problem, closure: QuadraticClosure) -> _Places | None:
        """The places, or None if more or less than a free platform on six legs is unknown."""
        natural = problem.natural
        platform = problem.models.structure.mechanism.platform
        kinds = {natural.unknowns[u].kind for u in problem.left}
        legs = [c for c in natural.conditions if not natural.keeps_shape(c)]
        if platform is None or natural.planar or kinds != {"pose", "platform"} or len(legs) != 6:
            return None
        cluster = natural.of_body[platform]
        family = natural.families[cluster.family]
        position = [u for part in cluster.position for u in part.unknowns]
        vectors = [[u for part in image for u in part.unknowns] for image in family.images]
        used = {u for part in (position, *vectors) for u in part}
        if len(position) != 3 or len(vectors) < 2 or not used <= closure.place.keys():
            return None
        return cls(position, vectors, closure.place)

    def is_leg(self, table: Array) -> bool:
        """Whether an equation, an upper triangle of coefficients, is that of a leg."""
        p = [self.place[u] for u in self.position]
        if abs(table[p[0], p[0]]) < AGREES * np.abs(table).max():
            return False
        full = (table + table.T) / (2 * table[p[0], p[0]])
        expected = np.zeros_like(full)
        expected[p, p], expected[0, 0] = 1, full[0, 0]
        b = -full[0, p]
        expected[0, p] = expected[p, 0] = -b
        for unknowns, i in product(self.vectors, range(3)):
            v = [self.place[u] for u in unknowns]
            beta = full[p[0], v[0]]
            expected[p[i], v[i]] = expected[v[i], p[i]] = beta
            expected[0, v[i]] = expected[v[i], 0] = -b[i] * beta
        return bool(np.abs(full - expected).max() <= AGREES * max(1.0, np.abs(full).max()))

    def leg(self, problem: Problem, condition: Condition) -> list[Scalar]:
        """b, a in axes of the platform, and L of a leg."""
        polynomial, natural = condition.polynomial, problem.natural
        one = self.position[0]
        twice = al.mul(2.0, polynomial.coefficient(one, one))
        b = [al.mul(-1.0, polynomial.coefficient(u)) / twice for u in self.position]
        platform = str(problem.models.structure.mechanism.platform)
        cluster = natural.of_body[platform]
        a: al.Vector = al.ZERO
        basis = natural.families[cluster.family].basis
        for g, unknowns in zip(basis, self.vectors, strict=True):
            beta = polynomial.coefficient(*sorted((one, unknowns[0])))
            a = al.plus(a, al.scale(_quotient(beta, twice), g))
        R = al.matmul(cluster.turn, cluster.places[platform][0])
        return [*b, *al.turn(al.transpose(R), a), condition.length]


def _quotient(a: Scalar, b: Scalar) -> Scalar:
    return 0.0 if al.is_number(a) and a == 0 else a / b
