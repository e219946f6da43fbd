"""All poses of a platform held by six legs: its assembly modes, with proofs.

Leg i joins a_i, fixed in the platform, to b_i, fixed in the base:

    |R a_i + p - b_i| = L_i,    i = 1 ... 6.

This is a 6-UPS platform; it is a 6-RUS or 6-PUS one too, with its elbows or carriages as points of
the base. There are at most 40 isolated complex solutions (Ronga and Vust 1992), and all 40 can be
real (Dietmaier 1998). They are found by following those of a section whose solutions are known to
the one asked for (`six_leg_sections`), and each is proved by an argument of Newton and Kantorovich
(`numerics.certificates`; Breiding, Rose and Timme 2020 for a like one). Where 40 distinct solutions
are proved, no other can exist.

Lengths have any one unit; it is also that of the results. Platforms further away than about a
thousand times the size of their points count as infinitely far and are not found.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from fractions import Fraction
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gough.geometry.six_leg_classes import expected_counts, rank_margin
from gough.geometry.six_leg_modes import (
    ROUNDING,
    Completeness,
    Ends,
    Frames,
    Outcome,
    PlatformModes,
    Section,
    closeness,
    nowhere,
    share_of_rotation,
)
from gough.geometry.six_leg_sections import (
    FORM_COUNT,
    LIGHT,
    PATTERN,
    SQUARES,
    Array,
    Complex,
    StartSet,
    entries,
    entry_sizes,
    generic_start,
    split,
)
from gough.numerics.path_tracking import PathEnding, Paths, track, track_carefully

__all__ = [
    "Completeness",
    "Outcome",
    "PlatformModes",
    "SixLegPlatform",
    "leg_rows",
]

SLACK = 32 * ROUNDING
"""Relative error bound of sums of at most ten products of rounded numbers; see `_Legs`."""
TINY = 1e-290
"""More than underflow takes from a coefficient."""
DEPENDENT = 1e-11
"""Rows whose least singular value is below this count as dependent; a guess well above rounding."""
REGULAR = 1e-10
"""Least inverse condition number of a solution to start from; a guess."""
FAR = 1e-9
"""Least |x·x| / |X|² of a solution to start from where their number is not known; a guess."""
SAME_RAY = 1e-7
"""Starts closer than this are the same; a guess."""
START_TRIES = 3
LARGEST = 1e100
"""Numbers as large as this are refused."""


class SixLegPlatform:
    """A platform on six legs, of any lengths.

    The first call of `modes` starts from a generic section. For further calls the platform gets a
    start set of its own, made once (`prepare`): its solutions for some complex lengths. From there
    ways are short, and none goes to infinity because of the class of the platform.
    """

    def __init__(self, base: ArrayLike, platform: ArrayLike) -> None:
        """Make a platform.

        Args:
            base: the points b_i in the base frame, (6, 3).
            platform: the points a_i in the platform frame, (6, 3), in the same unit.

        Raises:
            ValueError: not six points of finite numbers.
        """
        self.base = _numbers("base", base, (6, 3))
        self.platform = _numbers("platform", platform, (6, 3))
        self._legs = _Legs(self.base, self.platform)
        self._lengths: Array | None = None
        """Those of the first call."""
        self._start: StartSet | None = None
        self._prepared = False

    @property
    def expected(self) -> tuple[int, ...]:
        """Complex solutions, for general lengths, of platforms of this class.

        Nearly special ones have two numbers: with, and without, far ones that special ones lack.
        """
        return self._legs.expected

    def modes(self, lengths: ArrayLike) -> PlatformModes:
        """All poses with these lengths of the legs.

        Args:
            lengths: (6,), from 0 up.

        Raises:
            ValueError: not six finite lengths from 0 up.
        """
        L = _numbers("lengths", lengths, (6,))
        if np.any(L < 0):
            raise ValueError(f"lengths[{np.argmax(L < 0)}] is {L.min()}, expected 0 or more")
        legs = self._legs
        squares = legs.squares(L)
        if legs.margin < DEPENDENT:
            return nowhere(legs.frames)
        if not self._prepared and self._lengths is not None:
            self.prepare(self._lengths)
        self._lengths = L
        section = legs.section(L, squares)
        routes = [_from_generic(legs.rows_with(squares))]
        if self._start is not None:
            routes.insert(0, (self._start, lambda: legs.target(squares).astype(np.complex128)))
        return _solve(section, routes)

    def prepare(self, lengths: ArrayLike) -> int:
        """Make the start set of this platform, best for lengths about like these.

        It is used if it has as many solutions as platforms of this class.

        Returns:
            How many it has.
        """
        squares = self._legs.squares(_numbers("lengths", lengths, (6,)))
        self._prepared = True
        if self._legs.margin < DEPENDENT:
            return 0
        start = self._legs.start_set(squares)
        self._start = start if len(start.x) in self.expected or not self.expected else None
        return len(start.x)


class _Legs:
    """The equations of the legs, as far as they do not depend on lengths.

    The proof uses the first leg and the differences of the others from it, so that y·y stands in
    the first row alone. Points a' = (a - ca) / unit are off by a factor 1 + u at most, u = 2⁻⁵³
    (the centres are numbers as they stand, and the unit is a power of two). No term of an entry
    passes more than 16 roundings; `SLACK` times the sum of their sizes bounds its error.
    """

    def __init__(self, base: Array, platform: Array) -> None:
        self.base, self.platform = base, platform
        ca, cb = platform.mean(axis=0), base.mean(axis=0)
        a, b = platform - ca, base - cb
        self.frames = Frames(_unit_of(a, b), ca, cb)
        a, b = a / self.frames.unit, b / self.frames.unit
        self.rows = leg_rows(a, b)
        sizes = np.abs(self.rows)
        self.proof = np.asarray(entries(_differences(self.rows)))
        self.errors = SLACK * entry_sizes(np.concatenate([sizes[:1], sizes[1:] + sizes[0]])) + TINY
        self.margin = rank_margin(self.rows)
        self._points = a, b

    @cached_property
    def expected(self) -> tuple[int, ...]:
        """What `expected_counts` says."""
        return expected_counts(*self._points)

    @cached_property
    def mixture(self) -> tuple[Array, Array]:
        """What mixes the rows so that they suit tracking, (6, 6), and their entries, (164,)."""
        rows = self.rows.copy()
        rows[:, 0] = 0
        good = split(rows)
        M = np.concatenate([good.first[None], good.others])[:, 1:] @ np.linalg.pinv(rows[:, 1:])
        return M, np.asarray(entries(M @ self.rows))

    def squares(self, lengths: Array) -> Array:
        """Squared lengths in normal coordinates, (6,)."""
        return np.asarray((lengths / self.frames.unit) ** 2)

    def rows_with(self, squares: NDArray[np.number]) -> NDArray[np.number]:
        """Rows of the legs of given squared lengths, (6, 17)."""
        rows = self.rows.astype(squares.dtype)
        rows[:, 0] -= squares
        return rows

    def target(self, squares: NDArray[np.number]) -> NDArray[np.number]:
        """Entries for given squared lengths, (164,), their rows mixed."""
        M, fixed = self.mixture
        c = fixed.astype(squares.dtype)
        c[SQUARES] -= (M @ squares)[:, None]
        return c

    def section(self, lengths: Array, squares: Array) -> Section:
        """The equations to prove solutions of."""
        c, errors = self.proof.copy(), self.errors.copy()
        change, size = -squares, squares.copy()
        change[1:] += squares[0]
        size[1:] += squares[0]
        c[SQUARES] += change[:, None]
        errors[SQUARES] += (SLACK * size)[:, None]
        return Section(c, errors, lambda: self._exact(lengths), lambda: self.expected, self.frames)

    def _exact(self, lengths: Array) -> list[Fraction]:
        """Coefficients of the proof without rounding, (164,)."""
        unit = Fraction(self.frames.unit)

        def points(given: Array, centre: Array) -> NDArray[np.object_]:
            return np.asarray((_fractions(given) - _fractions(centre)) / unit)

        rows = leg_rows(points(self.platform, self.frames.ca), points(self.base, self.frames.cb))
        rows[:, 0] -= (_fractions(lengths) / unit) ** 2
        return list(entries(_differences(rows)))

    def start_set(self, squares: Array) -> StartSet:
        """The solutions for complex lengths about like some given ones.

        There should be as many as platforms of this class have; otherwise other lengths are tried,
        and the largest set is kept.
        """
        best: StartSet | None = None
        for seed in range(START_TRIES):
            rng = np.random.default_rng(seed)
            change = rng.normal(size=(2, 6)).T @ np.array([0.3, 0.6j])
            lengths = squares + (squares.mean() or 1.0) * change
            start = generic_start()
            c = start.target(self.rows_with(lengths))
            for follow in (track, track_carefully):
                paths = follow(PATTERN, start.start.entries, c, start.start.x, light=LIGHT)
                x = _regular(c, paths, self.expected)
                if best is None or len(x) > len(best.x):
                    best = StartSet(self.target(lengths).astype(np.complex128), x)
                if len(best.x) in self.expected:
                    return best
        assert best is not None
        return best


def leg_rows(a: NDArray[Any], b: NDArray[Any]) -> NDArray[Any]:
    """Coefficients of the forms for legs of length 0.

    Subtract squared lengths from the first column to get those for other lengths.

    Args:
        a: points of the platform, (6, 3).
        b: points of the base, (6, 3).

    Returns:
        (6, 17).
    """
    rows = np.empty((len(a), FORM_COUNT), a.dtype)
    rows[:, 0] = (a * a).sum(axis=1) + (b * b).sum(axis=1)
    rows[:, 1] = 4
    rows[:, 2:5] = 2 * a
    rows[:, 5:8] = -2 * b
    rows[:, 8:] = -2 * (b[:, :, None] * a[:, None, :]).reshape(len(a), 9)
    return rows


def _differences(rows: NDArray[Any]) -> NDArray[Any]:
    """The first row, and the differences of the others from it."""
    return np.concatenate([rows[:1], rows[1:] - rows[0]])


def _unit_of(a: Array, b: Array) -> float:
    """The power of two nearest to the root mean square distance of points from their centres."""
    most = float(max(np.abs(a).max(), np.abs(b).max()))
    if most == 0:
        return 1.0
    square = float(np.sum((a / most) ** 2) + np.sum((b / most) ** 2)) / 12
    return float(2.0 ** round(math.log2(most) + math.log2(square) / 2))


def _fractions(values: Array) -> NDArray[np.object_]:
    """Floating-point numbers as fractions, in an array of their shape."""
    return np.array([Fraction(v) for v in values.ravel().tolist()], object).reshape(values.shape)


def _regular(c: Complex, paths: Paths, expected: tuple[int, ...]) -> Complex:
    """The finite regular solutions among the ends of paths, each once, nearest first.

    Paths to infinity may arrive too, near a singular solution there; those are what is left over
    when the number of solutions is known.
    """
    x = paths.x[paths.ended(PathEnding.arrived)]
    if not len(x):
        return x
    x = x[~np.triu(closeness(x) < SAME_RAY, 1).any(axis=0)]
    J = np.concatenate([PATTERN.jacobian(c, x), x.conj()[:, None]], axis=1)
    share = share_of_rotation(x)
    near = np.argsort(-share, kind="stable")
    near = near[np.linalg.cond(J[near]) < 1 / REGULAR]
    enough = [count for count in expected if count <= len(near)]
    return np.asarray(x[near[: enough[0]] if enough else near[share[near] > FAR]])


Route = tuple[StartSet, Callable[[], Complex]]
"""Where paths start, and what gives the coefficients of their ends."""


def _from_generic(rows: NDArray[np.number]) -> Route:
    """The route to rows (6, 17) from the section that comes with the package."""
    start = generic_start()
    return start.start, lambda: start.target(rows)


def _solve(section: Section, routes: list[Route]) -> PlatformModes:
    """Follow all paths and judge their ends, by other routes and with more care as needed."""
    best: Ends | None = None
    for follow, (start, target) in [
        *((track, route) for route in routes),
        (track_carefully, routes[-1]),
    ]:
        paths = follow(PATTERN, start.entries, target(), start.x, light=LIGHT)
        ends = Ends(section, paths, again=best is not None)
        best = ends if best is None else max(best, ends, key=lambda e: e.merit)
        if best.settled:
            break
    assert best is not None
    return best.modes()


def _numbers(name: str, given: ArrayLike, shape: tuple[int, ...]) -> Array:
    """An array of finite real numbers of moderate size."""
    values = np.array(given, np.float64)
    if values.shape != shape:
        raise ValueError(f"{name} has shape {values.shape}, expected {shape}")
    if not np.all(np.abs(values) < LARGEST):
        worst = np.unravel_index(np.argmax(~(np.abs(values) < LARGEST)), shape)
        place = ", ".join(str(k) for k in worst)
        raise ValueError(f"{name}[{place}] is {values[worst]}, expected a number below {LARGEST}")
    return values
