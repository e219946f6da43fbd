"""Putting positions back onto the equations that they must obey, within loops over runs."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from gough.numerics.calling import call_tile, part, pointer_to, routine

Pointer = Any
"""To neighbouring numbers; indexed like an array."""

ITERATIONS = 8
FINEST = 1e-2
"""Iterations end at this share of the gap that calls for them, or where roundings are the gap."""


class Projection(NamedTuple):
    """The equations F(q, p) = 0 of the first states q, solved for some of their rates."""

    rows: int
    """Address of (q, p) -> F, ∂F/∂δ; 0 if there are no equations."""
    move: int
    """Address of (q, p, δ) -> q."""
    unknowns: int
    positions: int
    parameters: int
    quaternions: int
    """How many unit quaternions the states hold."""
    places: Pointer
    """Where each begins among the states."""
    tolerance: float
    """Largest gap that is left alone."""
    given: Pointer
    """q, p, δ."""
    found: Pointer
    """F, then the matrix; then moved q."""
    p: Pointer
    """Parameters of each run."""


@part
def normalise(projection: Projection, states: Pointer, apart: int, r: int) -> None:
    """Make quaternions unit again; number k of the states stands at k · apart + r."""
    for n in range(projection.quaternions):
        first, total = projection.places[n], 0.0
        for k in range(first, first + 4):
            total += states[k * apart + r] ** 2
        factor = 1.0 / np.sqrt(total)
        for k in range(first, first + 4):
            states[k * apart + r] *= factor


@part
def exchange(A: Pointer, b: Pointer, n: int, i: int, k: int) -> None:
    """Exchange two rows of A x = b."""
    for j in range(n):
        A[i * n + j], A[k * n + j] = A[k * n + j], A[i * n + j]
    b[i], b[k] = b[k], b[i]


@routine
def solve(A: Pointer, b: Pointer, n: int) -> bool:
    """Put x with A x = b in place of b, by elimination with partial pivoting."""
    for k in range(n):
        pivot = k
        for i in range(k + 1, n):
            if abs(A[i * n + k]) > abs(A[pivot * n + k]):
                pivot = i
        if not abs(A[pivot * n + k]) > 0.0:
            return False
        if pivot != k:
            exchange(A, b, n, pivot, k)
        for i in range(k + 1, n):
            factor = A[i * n + k] / A[k * n + k]
            for j in range(k + 1, n):
                A[i * n + j] -= factor * A[k * n + j]
            b[i] -= factor * b[k]
    for k in range(n - 1, -1, -1):
        for j in range(k + 1, n):
            b[k] -= A[k * n + j] * b[j]
        b[k] /= A[k * n + k]
    return True


@routine
def project(projection: Projection, run: int, states: Pointer, apart: int, r: int) -> int:
    """How many steps of Newton's method it took; -1 where they do not close the gap.

    The independent positions stay, so that only what follows from them moves.
    """
    n, m, k = projection.positions, projection.unknowns, projection.parameters
    if projection.rows == 0:
        return 0
    given, found = projection.given, projection.found
    for j in range(n):
        given[j] = states[j * apart + r]
    for j in range(k):
        given[n + j] = projection.p[run * k + j]
    wanted, before = projection.tolerance, np.inf
    for iteration in range(ITERATIONS):
        call_tile(projection.rows, given, found)
        gap = 0.0
        for j in range(m):
            gap = max(gap, abs(found[j])) if found[j] == found[j] else np.inf
        if gap <= wanted or (gap <= projection.tolerance and gap > 0.5 * before):
            for j in range(n):
                states[j * apart + r] = given[j]
            return iteration
        wanted, before = projection.tolerance * FINEST, gap
        if not gap < np.inf or not solve(pointer_to(found, m), found, m):
            return -1
        for j in range(m):
            given[n + k + j] = -found[j]
        call_tile(projection.move, given, found)
        for j in range(n):
            given[j] = found[j]
    return -1
