"""Six legs of one platform, recognised from the closure equations of a mechanism."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from gough.geometry.problem import Problem
from gough.geometry.quadratic_closure import QuadraticClosure
from gough.symbolic.natural.parts import Family

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


def six_legs(problem: Problem, closure: QuadraticClosure, q: Array) -> SixLegs | None:
    """The legs, or None if the equations are of another kind.

    With the platform's position p and vectors u_j = R g_j of it as unknowns, a leg's equation is

        p·p + 2 p·(Σ β_j u_j - b) - 2 b·(Σ β_j u_j) + constant = 0,    a = Σ β_j g_j.
    """
    natural = problem.natural
    legs = [k for k, c in enumerate(natural.conditions) if not natural.keeps_shape(c)]
    kinds = {natural.unknowns[u].kind for u in problem.left}
    platform = problem.models.structure.mechanism.platform
    if platform is None or kinds != {"pose", "platform"} or len(legs) != 6 or natural.planar:
        return None
    cluster = natural.of_body[platform]
    family = natural.families[cluster.family]
    position = [next(iter(part.unknowns), None) for part in cluster.position]
    if None in position or len(family.basis) < 2:
        return None
    places = [closure.place[u] for u in position if u is not None]
    vectors = _vector_places(closure, family)
    if vectors is None:
        return None
    tables = closure.tables(q)
    lengths = problem.lengths(q)
    found = [_leg(tables[k], places, vectors) for k in legs]
    if any(leg is None for leg in found):
        return None
    g = problem.probe([x for v in family.basis for x in v])[0].reshape(-1, 3)
    R, _ = problem.body_in_class(platform)
    base = np.array([leg[0] for leg in found if leg is not None])
    own = np.array([leg[1] @ g[: len(leg[1])] for leg in found if leg is not None])
    return SixLegs(base, own @ R, np.array([lengths[k] for k in legs]))


def _vector_places(closure: QuadraticClosure, family: Family) -> list[list[int]] | None:
    """Places of the coordinates of each vector of the platform."""
    places = []
    for image in family.images:
        unknowns = [next(iter(part.unknowns), None) for part in image]
        if None in unknowns or any(u not in closure.place for u in unknowns if u is not None):
            return None
        places.append([closure.place[u] for u in unknowns if u is not None])
    return places


def _leg(table: Array, p: list[int], vectors: list[list[int]]) -> tuple[Array, Array] | None:
    """b and β of an equation given as an upper triangle; None if it is no leg's."""
    table = table / np.abs(table).max()
    k = table[p[0], p[0]]
    if abs(k) < AGREES:
        return None
    full = (table + table.T) / (2 * k)
    b = -full[0, p]
    beta = np.array([full[p[0], u[0]] for u in vectors])
    expected = np.zeros_like(full)
    expected[p, p] = 1
    expected[0, p] = expected[p, 0] = -b
    for (j, u), i in product(enumerate(vectors), range(3)):
        expected[p[i], u[i]] = expected[u[i], p[i]] = beta[j]
        expected[0, u[i]] = expected[u[i], 0] = -b[i] * beta[j]
    expected[0, 0] = full[0, 0]
    if np.abs(full - expected).max() > AGREES * max(1.0, np.abs(full).max()):
        return None
    return b, beta
