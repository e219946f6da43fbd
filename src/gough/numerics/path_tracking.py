"""Paths of the solutions of quadratic systems, from known ones to those wanted.

The system of pattern F with coefficients a has known solutions; those with coefficients b are
wanted. Along t from 0 to 1 solutions of

    F(x; (1 - t) a + t b) = 0

move from the former to the latter, many at once. Each is followed by its Taylor series, to order
eight, corrected by Newton's method after each step. The equations are homogeneous: x stands for all
its multiples, and is kept at unit norm. With generic complex a no path meets a singular point
before its end, and the ends are all isolated solutions if the starts were.
"""

from __future__ import annotations

import cmath
from dataclasses import dataclass, fields
from enum import Enum
from functools import lru_cache
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gough.numerics.quadratics import Complex, Quadratics, Whole

Array = NDArray[np.float64]


class PathEnding(Enum):
    """How a path ended; the text is what the user reads."""

    arrived = "the path reached a solution"
    infinite = "the path runs to infinity"
    lost = "the steps became too small before the end: the path meets a singular point"
    step_limit = "the path was still under way when the steps ran out"
    not_finite = "the equations have no finite value at the start"


ENDINGS = tuple(PathEnding)
"""The ending of each code."""


@dataclass(frozen=True)
class Settings:
    """How to step along paths."""

    tolerance: float = 1e-4
    """Largest last term of the series in a step; |x| = 1."""
    share: float = 0.8
    """Of the estimated radius of convergence: the longest step."""
    correction: float = 1e-2
    """Largest correction of a point."""
    max_steps: int = 500
    smallest: float = 1e-12
    """Steps in t shorter than this end a path."""


CAREFUL = (
    Settings(tolerance=1e-5, share=0.6),
    Settings(tolerance=1e-6, share=0.5, correction=1e-3),
    Settings(tolerance=1e-7, share=0.4, correction=1e-4, max_steps=1000),
)
"""For paths that ended badly, one after another."""

COLLIDING = 1e-6
"""Ends nearer than this are the same, or of a double solution."""


@dataclass(frozen=True)
class Paths:
    """Ends of paths."""

    x: Complex
    """The last point of each path, of unit norm, (paths, n)."""
    t: Array
    """Where it is, (paths,); 1 at the end."""
    ending: NDArray[np.int8]
    """How each path ended: its place in `ENDINGS`, (paths,)."""
    steps: Whole
    """Steps taken, (paths,)."""
    rejected: Whole
    """Steps refused and tried shorter, (paths,)."""
    correction: Array
    """Estimated size that one more correction would have, (paths,): of the order of rounding at
    regular ends, but half as many digits at double solutions."""

    def ended(self, ending: PathEnding) -> NDArray[np.bool_]:
        """Which paths ended so."""
        return np.asarray(self.ending == ENDINGS.index(ending))


def track(
    pattern: Quadratics,
    start: ArrayLike,
    target: ArrayLike,
    x0: ArrayLike,
    settings: Settings = Settings(),
    *,
    light: int = 0,
) -> Paths:
    """Follow each path from its start; one path's numbers do not depend on the others.

    Solutions far out, or at infinity, have some unknowns that are small together: the homogenising
    one, or the four of the rotation in a dual quaternion. These are then measured in a unit of
    their own, their size over that of the others, and a row is divided by the power of it that
    its largest terms hold: none if it has a product of two other unknowns, the first if it has a
    product of only one, the second if all its products are of light unknowns. Apart from this,
    rows of comparable size are up to the caller.

    A path is infinite when its light part is less than 1e-7 of it at a regular end, or less than
    1e-3 at a singular end or where it stopped with t > 0.999.

    Args:
        pattern: the system.
        start: its coefficients at t = 0, (entries,).
        target: its coefficients at t = 1, (entries,).
        x0: a solution at t = 0 for each path, of any norm, (paths, n).
        settings: how to step.
        light: how many of the first unknowns become small together at infinity.

    Raises:
        ValueError: an argument has the wrong shape or value; the message names it.
    """
    entries, n = len(pattern.rows), pattern.unknowns
    if isinstance(light, bool) or not isinstance(light, int | np.integer) or not 0 <= light <= n:
        raise ValueError(f"light is {light!r}, expected a whole number from 0 to {n}")
    c = np.stack(
        [_complex("start", start, (entries,)), _complex("target", target, (entries,))], axis=1
    )
    x = _complex("x0", x0, ("paths", n)).copy()
    count = len(x)
    found = Paths(
        x,
        np.zeros(count),
        np.zeros(count, np.int8),
        np.zeros(count, np.int64),
        np.zeros(count, np.int64),
        np.zeros(count),
    )
    if count:
        _run(_tables(pattern, int(light)), c, settings, found)
    return found


def track_carefully(
    pattern: Quadratics,
    start: ArrayLike,
    target: ArrayLike,
    x0: ArrayLike,
    settings: Settings = Settings(),
    *,
    light: int = 0,
    twists: int = 2,
    seed: int = 0,
) -> Paths:
    """As `track`, and again, more carefully, those paths that got lost or that met another's.

    Two paths never end together at a regular point: one has jumped. If trouble stays, all paths
    are tracked to the same ends another way, where b is multiplied by a phase. The ends are then
    joined to other starts. What is returned is of one way, the one with the least trouble.

    Args:
        pattern: the system.
        start: its coefficients at t = 0, (entries,).
        target: its coefficients at t = 1, (entries,).
        x0: a solution at t = 0 for each path, of any norm, (paths, n).
        settings: of the first try.
        light: how many of the first unknowns become small together at infinity.
        twists: other ways to try at most.
        seed: of the phases.

    Raises:
        ValueError: an argument has the wrong shape or value; the message names it.
    """
    b = _complex("target", target, (len(pattern.rows),))
    rng = np.random.default_rng(seed)
    best, least = None, 0
    for way in range(twists + 1):
        phase = cmath.exp(2j * cmath.pi * rng.uniform(-0.2, 0.2)) if way else 1.0
        found = _retracked(pattern, start, phase * b, x0, settings, light)
        trouble = int(np.sum(_troubled(pattern, b, found, light)))
        if best is None or trouble < least:
            best, least = found, trouble
        if not least:
            break
    assert best is not None
    return best


def _retracked(
    pattern: Quadratics,
    start: ArrayLike,
    target: Complex,
    x0: ArrayLike,
    settings: Settings,
    light: int,
) -> Paths:
    """Paths of one way, those in trouble with ever more care."""
    found = track(pattern, start, target, x0, settings, light=light)
    for careful in CAREFUL:
        again = np.flatnonzero(_troubled(pattern, target, found, light))
        if not len(again):
            break
        new = track(pattern, start, target, np.asarray(x0)[again], careful, light=light)
        better = new.ended(PathEnding.arrived) | new.ended(PathEnding.infinite)
        for name in (field.name for field in fields(Paths)):
            getattr(found, name)[again[better]] = getattr(new, name)[better]
    return found


def _troubled(pattern: Quadratics, c: Complex, found: Paths, light: int) -> NDArray[np.bool_]:
    """Which paths are lost, out of steps, or end where another ends."""
    troubled = found.ended(PathEnding.lost) | found.ended(PathEnding.step_limit)
    arrived = np.flatnonzero(found.ended(PathEnding.arrived))
    x = found.x[arrived]
    cosines = np.abs(x.conj() @ x.T)
    for i, j in np.argwhere(np.triu(cosines > 1 - COLLIDING**2, 1)):
        distance = np.linalg.norm(x[j] - x[i] * np.vdot(x[i], x[j]))
        if distance < COLLIDING and distance < 0.01 * _regularity(pattern, c, x[i], light):
            troubled[arrived[[i, j]]] = True
    return troubled


def _regularity(pattern: Quadratics, c: Complex, x: Complex, light: int) -> float:
    """The least singular value of the Jacobian at x over the largest, scaled as in the loops.

    Different solutions are no nearer to each other than about this.
    """
    J = np.vstack([pattern.jacobian(c, x), x.conj()[None]])
    heavy = np.linalg.norm(x[light:])
    unit = min(1.0, float(np.linalg.norm(x[:light]) / heavy)) if light and heavy else 1.0
    J[:, :light] *= max(unit, 1e-300)
    J /= np.maximum(np.linalg.norm(J, axis=1, keepdims=True), 1e-300)
    s = np.linalg.svd(J, compute_uv=False)
    return float(s[-1] / s[0])


def _run(tables: _Tables, c: Complex, settings: Settings, found: Paths) -> None:
    """Track the paths in place; numba is loaded here."""
    from gough.numerics import path_equations as equations
    from gough.numerics import path_loops as loops

    reals, whole = equations.room(tables.shape[0], tables.shape[1])
    loops.track_paths(
        equations.Shape(*tables.shape),
        loops.Rules(
            float(settings.tolerance),
            float(settings.share),
            float(settings.correction),
            int(settings.max_steps),
            float(settings.smallest),
        ),
        *tables.arrays,
        c.view(np.float64),
        found.x.view(np.float64),
        found.t,
        found.correction,
        found.ending,
        found.steps,
        found.rejected,
        np.zeros(reals),
        np.zeros(whole, np.int64),
    )


@dataclass(frozen=True)
class _Tables:
    """A pattern as the loops read it."""

    shape: tuple[int, int, int, int]
    """Unknowns, products, squares and light unknowns."""
    arrays: tuple[Whole, ...]
    """The tables of `path_equations.Pattern`, without the coefficients."""


@lru_cache(maxsize=64)
def _tables(pattern: Quadratics, light: int) -> _Tables:
    n = pattern.unknowns
    rows, left, right = (
        np.asarray(part, np.int64) for part in (pattern.rows, pattern.left, pattern.right)
    )
    # a code of each product, squares first
    code = np.where(left == right, 0, n * n) + left * n + right
    products, product = np.unique(code, return_inverse=True)
    squares = int(np.sum(products < n * n))
    # the terms of the gradient: each entry under its left and under its right factor
    place = np.concatenate([rows * n + left, rows * n + right])
    order = np.argsort(place, kind="stable")
    slots = np.searchsorted(place[order], np.arange((n - 1) * n + 1))
    entry = np.tile(np.arange(len(rows)), 2)[order]
    other = np.concatenate([right, left])[order]
    power = np.full(n - 1, 2)
    np.minimum.at(power, rows, (left < light).astype(int) + (right < light))
    of_row = np.split(product, pattern.starts[1:-1])
    twin = [np.array_equal(*pair) for pair in pairwise(of_row)] + [False]
    arrays = (
        pattern.starts,
        product,
        np.array(twin),
        products % (n * n) // n,
        products % n,
        slots,
        entry,
        other,
        power,
    )
    ready = tuple(np.require(array, np.int64, ["C", "A", "W"]) for array in arrays)
    return _Tables((n, len(products), squares, light), ready)


def _complex(name: str, given: ArrayLike, shape: tuple[int | str, ...]) -> Complex:
    """An array of complex128 that compiled loops may read as it stands."""
    values = np.asarray(given)
    expected = f"({', '.join(map(str, shape))}{',' if len(shape) == 1 else ''})"
    fits = len(shape) == values.ndim and all(
        isinstance(size, str) or size == actual
        for size, actual in zip(shape, values.shape, strict=True)
    )
    if not fits:
        raise ValueError(f"{name} has shape {values.shape}, expected {expected}")
    if not np.can_cast(values.dtype, np.complex128, "same_kind"):
        raise ValueError(f"{name} holds {values.dtype}, expected numbers")
    return np.require(values, np.complex128, ["C", "A", "W"])
