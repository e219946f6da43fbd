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
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import Enum
from fractions import Fraction
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gough.geometry.six_leg_classes import expected_counts, rank_margin
from gough.geometry.six_leg_sections import (
    DEGREE,
    FORM_COUNT,
    FORMS,
    LIGHT,
    MIXED_PAIRS,
    PATTERN,
    SQUARES,
    X_PAIRS,
    Array,
    Complex,
    StartSet,
    entries,
    entry_sizes,
    generic_start,
    split,
)
from gough.numerics.certificates import Certificates, Verdict, certify
from gough.numerics.path_tracking import PathEnding, Paths, track, track_carefully

Mask = NDArray[np.bool_]

ROUNDING = 2.0**-53
SLACK = 32 * ROUNDING
"""Relative error bound of sums of at most ten products of rounded numbers; see `_Legs`."""
TINY = 1e-290
"""More than underflow takes from a coefficient."""
DEPENDENT = 1e-11
"""Rows whose least singular value is below this count as dependent; a guess well above rounding."""
INFINITE = 1e-6
"""Where |x·x| is below this times |X|² a path that did not arrive went to infinity; a guess."""
NEAR_END = 0.9
"""Paths that stop from here on may be at a solution of the end all the same."""
ALIKE = 1e-4
"""Ends of paths closer than this, of length 1, are those of one multiple solution; a guess."""
REGULAR = 1e-10
"""Least inverse condition number of a solution to start from; a guess."""
FAR = 1e-9
"""Least |x·x| / |X|² of a solution to start from where their number is not known; a guess."""
SAME_RAY = 1e-7
"""Starts closer than this are the same; a guess."""
START_TRIES = 3
ALIKE_POSES = 1e-6
"""Numbers of poses that differ by less, in the unit of the platform, are ordered by the next."""
ZERO = 1e-12
"""Numbers of unit quaternions below this count as 0 when a sign is chosen."""
LARGEST = 1e100
"""Numbers as large as this are refused."""
MONOMIALS = np.array([*X_PAIRS, *MIXED_PAIRS]).T
POSE_FORMS = np.ascontiguousarray(FORMS[5:, : MONOMIALS.shape[1]].T)
"""N p and N R by products of two unknowns, (26, 12)."""
DOUBLE = 1e-7
"""Proved solutions nearer to each other than this, of length 1, are equal but for rounding of the
data; a guess: changes of 1e-15 in lengths move double solutions by some 1e-7."""
NEARLY_REAL = 1e-5
"""Largest imaginary part of an unproved solution, of length 1, that counts as real; a guess."""


class Completeness(Enum):
    """What is known about a list of modes; the text is what the user reads."""

    certified = "certified: 40 distinct complex solutions are proved, so no other mode exists"
    expected = "expected: as many complex solutions as platforms of this class have"
    found = "found: there may be more"
    dependent = "the six conditions depend on each other: they hold the platform nowhere"


class Outcome(Enum):
    """How a path ended; the text is what the user reads."""

    proved = "proved"
    double = "proved, one of those that are equal but for rounding: a singularity of type 2"
    repeated = "proved, but not to differ from one before"
    multiple = "met others at a singular solution: of type 2, or one of a continuum"
    unproved = "at a solution that is not proved"
    infinite = "went to infinity"
    lost = "lost"


OUTCOMES = tuple(Outcome)
INFINITE_CODE = OUTCOMES.index(Outcome.infinite)


@dataclass(frozen=True)
class Frames:
    """How normal coordinates lie in those of the user: a = ca + unit a', b = cb + unit b'."""

    unit: float
    """A power of two, so that scaling is exact."""
    ca: Array
    """Origin in the platform, (3,)."""
    cb: Array
    """Origin in the base, (3,)."""


@dataclass(frozen=True, eq=False)
class PlatformModes:
    """Assembly modes of a platform."""

    poses: Array
    """Position x y z and unit quaternion w x y z, w >= 0, of the platform in the base, (k, 7).

    Highest first, then by falling y, x, w and so on; near ties are broken alike each time.
    """
    certified: Mask
    """Which are proved to exist, alone near this pose, (k,).

    The others are numerical, or real only for data that differ by rounding: double solutions.
    """
    completeness: Completeness
    complex_count: int
    """Distinct finite complex solutions found, multiple ones once."""
    counts: Callable[[], tuple[int, ...]]
    """Gives the numbers that `SixLegPlatform.expected` says."""
    outcomes: NDArray[np.int8]
    """The place in `OUTCOMES` of each path's, (paths,)."""
    paths: Paths
    certificates: Certificates
    """Of the solutions tried; `solution` says which is that of a pose."""
    solution: NDArray[np.intp]
    """The row of `certificates` that a pose is from, (k,); -1 for multiple ones."""
    frames: Frames
    again: bool
    """Whether paths were in trouble and were tracked again, more carefully."""

    @property
    def expected(self) -> tuple[int, ...]:
        """Complex solutions that platforms of this class have; see `SixLegPlatform.expected`."""
        return self.counts()

    @property
    def infinite(self) -> int:
        """Paths that went to infinity."""
        return int(np.sum(self.outcomes == OUTCOMES.index(Outcome.infinite)))

    @property
    def lost(self) -> int:
        """Paths that were lost."""
        return int(np.sum(self.outcomes == OUTCOMES.index(Outcome.lost)))

    @cached_property
    def endings(self) -> dict[str, int]:
        """Paths by how they ended."""
        counts = np.bincount(self.outcomes, minlength=len(OUTCOMES)).tolist()
        return {o.value: n for o, n in zip(OUTCOMES, counts, strict=True) if n}

    @cached_property
    def pose_errors(self) -> Array:
        """Bounds of the errors of position, in the unit of lengths, and of the quaternion, (k, 2).

        Infinite for poses that are not certified. The certificate bounds each number of X by its
        radius r, so |dx| and |dy| by e = 2 r. With s = |x| - e:

            |dq| <= 2 e / s,    |dp'| <= 2 (e (|x| + |y| + e) + 2 |y| e (2 |x| + e) / |x|) / s²,

        and |dR| <= 2 |dq| acts on the centre of the platform. A multiple of the
        rounding unit is added for the arithmetic that leads from X to the pose.
        """
        bounds = np.full((len(self.poses), 2), np.inf)
        for k in np.flatnonzero(self.certified):
            i = self.solution[k]
            X, e = self.certificates.x[i].real, 2 * float(self.certificates.radius[i])
            x, y = float(np.linalg.norm(X[:4])), float(np.linalg.norm(X[4:]))
            if e < 0.5 * x:
                bounds[k] = _pose_error(x, y, e, self.frames)
        return bounds


def _pose_error(x: float, y: float, e: float, frames: Frames) -> tuple[float, float]:
    """Bounds of the errors of position and quaternion; see `PlatformModes.pose_errors`."""
    s = x - e
    turn = 2 * e / s
    shift = 2 * (e * (x + y + e) + 2 * y * e * (2 * x + e) / x) / s**2
    ca, cb = np.linalg.norm(frames.ca), np.linalg.norm(frames.cb)
    size = frames.unit * (2 * y / x + shift) + ca + cb
    position = frames.unit * shift + 2 * turn * ca + 64 * ROUNDING * size
    return float(position) * (1 + 1e-12), turn * (1 + 1e-12) + 32 * ROUNDING


@dataclass(frozen=True, eq=False)
class Section:
    """Six real conditions in normal coordinates: what solutions are proved of."""

    proof: Array
    """Coefficients of `PATTERN`, (164,)."""
    errors: Array
    """How far the true ones may be from them, (164,)."""
    exact: Callable[[], Sequence[Fraction]] | None
    """Gives the true ones, if they are known."""
    counts: Callable[[], tuple[int, ...]]
    """Gives the numbers of solutions that are to be expected, as far as known."""
    frames: Frames


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
            return _nowhere(legs.frames)
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


class SixConditions:
    """Any six conditions on a pose that are linear in the forms of `six_leg_sections`.

    `distance_condition` and `plane_condition` make rows. How many solutions there are is not known
    beforehand, but for the bound of 40.
    """

    def __init__(self, rows: ArrayLike, errors: ArrayLike | None = None) -> None:
        """Make conditions.

        Args:
            rows: coefficients of N; y·y; N Rᵀp; N p; N R by rows, (6, 17).
            errors: how far they may be from the true ones, (6, 17); 0 for y·y. What is certified
                then holds for all rows within them. By default the rows are exact.

        Raises:
            ValueError: not finite, or of the wrong shape, or errors below 0 or of y·y.
        """
        self.rows = _numbers("rows", rows, (6, FORM_COUNT))
        self._exact = errors is None
        given = np.zeros((6, FORM_COUNT)) if errors is None else errors
        self.errors = _numbers("errors", given, (6, FORM_COUNT))
        if np.any(self.errors < 0) or np.any(self.errors[:, 1]):
            raise ValueError("errors holds numbers below 0 or for y·y, expected 0 or more")

    def modes(self) -> PlatformModes:
        """All poses that satisfy the conditions."""
        unit = _unit_of_rows(self.rows)
        lengths = np.array([1.0, unit**2, *[unit] * 6, *[1.0] * 9])
        most = np.abs(self.rows * lengths).max(axis=1, keepdims=True)
        scale = lengths * 2.0 ** -np.round(np.log2(np.where(most > 0, most, 1.0)))
        rows, errors = self.rows * scale, self.errors * scale
        frames = Frames(unit, np.zeros(3), np.zeros(3))
        if rank_margin(rows) < DEPENDENT:
            return _nowhere(frames)
        order = np.argsort(-np.abs(rows[:, 1]), kind="stable")
        rows, errors, scale = rows[order], errors[order], scale[order]
        sizes = np.abs(rows)
        bounds = SLACK * entry_sizes(_without_y(sizes, sizes, 1)) + TINY
        bounds += 2 * entry_sizes(_without_y(errors, sizes, 1))

        def exact() -> list[Fraction]:
            true = _fractions(self.rows[order]) * _fractions(scale)
            return list(entries(_without_y(true, true, -1)))

        section = Section(
            np.asarray(entries(_without_y(rows, rows, -1))),
            bounds,
            exact if self._exact else None,
            tuple,
            frames,
        )
        return _solve(section, [_from_generic(rows)])


def _without_y(rows: NDArray[Any], weights: NDArray[Any], sign: int) -> NDArray[Any]:
    """Rows of which all but the first lose y·y: those of c0 row_i + sign c_i row_0.

    Products are those of numbers and of their like, so that y·y goes exactly.
    """
    c = weights[:, 1]
    if not c[0]:
        return rows
    return np.concatenate([rows[:1], c[0] * rows[1:] + sign * c[1:, None] * rows[0]])


def distance_condition(point: ArrayLike, centre: ArrayLike, length: float) -> Array:
    """The row of |R a + p - b| = L, (17,).

    Args:
        point: a, in the platform frame, (3,).
        centre: b, in the base frame, (3,).
        length: L.
    """
    a, b = _numbers("point", point, (3,)), _numbers("centre", centre, (3,))
    row = leg_rows(a[None], b[None])[0]
    row[0] -= length**2
    return np.asarray(row)


def plane_condition(point: ArrayLike, normal: ArrayLike, offset: float) -> Array:
    """The row of n·(R a + p) = d, (17,).

    Args:
        point: a, in the platform frame, (3,).
        normal: n, in the base frame, of any length, (3,).
        offset: d.
    """
    a, n = _numbers("point", point, (3,)), _numbers("normal", normal, (3,))
    return np.concatenate([[-offset, 0, 0, 0, 0], n, np.outer(n, a).ravel()])


def _unit_of_rows(rows: Array) -> float:
    """The power of two that best makes coefficients of lengths like those of numbers."""
    least = np.linalg.norm(np.delete(rows, [0, 1, *range(2, 8)], axis=1), axis=1)
    most = np.linalg.norm(rows[:, 2:8], axis=1)
    ratios = [a / b for a, b in zip(least, most, strict=True) if a > 0 and b > 0]
    return float(2.0 ** round(math.log2(float(np.median(ratios))))) if ratios else 1.0


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
    x = x[~np.triu(_closeness(x) < SAME_RAY, 1).any(axis=0)]
    J = np.concatenate([PATTERN.jacobian(c, x), x.conj()[:, None]], axis=1)
    share = _share_of_rotation(x)
    near = np.argsort(-share, kind="stable")
    near = near[np.linalg.cond(J[near]) < 1 / REGULAR]
    enough = [count for count in expected if count <= len(near)]
    return np.asarray(x[near[: enough[0]] if enough else near[share[near] > FAR]])


def _share_of_rotation(x: Complex) -> Array:
    """|x·x| / |X|², near 0 where the platform is very far away, (k,)."""
    return np.asarray(
        np.abs((x[:, :4] * x[:, :4]).sum(axis=1)) / (x.real**2 + x.imag**2).sum(axis=1)
    )


def _closeness(x: Complex) -> Array:
    """Sines of the angles between rays, (k, k)."""
    x = x / np.linalg.norm(x, axis=1, keepdims=True)
    along = x.conj() @ x.T
    # the part across, not the root of 1 - cos²: that would lose half of the digits
    across = x[None, :, :] - along[:, :, None] * x[:, None, :]
    return np.asarray(np.linalg.norm(across, axis=2))


Route = tuple[StartSet, Callable[[], Complex]]
"""Where paths start, and what gives the coefficients of their ends."""


def _from_generic(rows: NDArray[np.number]) -> Route:
    """The route to rows (6, 17) from the section that comes with the package."""
    start = generic_start()
    return start.start, lambda: start.target(rows)


def _solve(section: Section, routes: list[Route]) -> PlatformModes:
    """Follow all paths and judge their ends, by other routes and with more care as needed."""
    best: _Ends | None = None
    for follow, (start, target) in [
        *((track, route) for route in routes),
        (track_carefully, routes[-1]),
    ]:
        paths = follow(PATTERN, start.entries, target(), start.x, light=LIGHT)
        ends = _Ends(section, paths, again=best is not None)
        best = ends if best is None else max(best, ends, key=lambda e: e.merit)
        if best.settled:
            break
    assert best is not None
    return best.modes()


class _Ends:
    """The ends of the paths to one section, judged."""

    def __init__(self, section: Section, paths: Paths, again: bool = False) -> None:
        self.section, self.paths, self.again = section, paths, again
        arrived = paths.ended(PathEnding.arrived)
        stopped = paths.ended(PathEnding.lost) | paths.ended(PathEnding.step_limit)
        near = arrived | (stopped & (paths.t > NEAR_END))
        self.tried = np.flatnonzero(near)
        """The paths whose ends are tried."""
        x = paths.x if near.all() else paths.x[self.tried]
        self.share = _share_of_rotation(x)
        self.certificates = certify(PATTERN, section.proof, section.errors, x)
        self.distinct = self.certificates.distinct
        self.complete = int(self.distinct.sum()) == DEGREE and self._all_finite()
        self.multiples: list[NDArray[np.intp]] = []
        """Rows of `certificates` that are ends at the same multiple solution."""
        self.unproved: NDArray[np.intp] = np.empty(0, np.intp)
        """Rows at other solutions that are not proved."""
        if not self.complete:
            self._look_closer(arrived, x)

        self.doubles = self._doubles()
        """Rows of proved solutions that are equal but for rounding."""

    @property
    def settled(self) -> bool:
        """Whether no path needs another look."""
        if self.complete or int(self.distinct.sum()) in self.section.counts():
            return True
        ends = self.outcomes()
        return bool(np.all((ends <= OUTCOMES.index(Outcome.double)) | (ends == INFINITE_CODE)))

    @property
    def merit(self) -> tuple[int, int]:
        """What is best is largest: proved solutions, then paths that were not lost."""
        lost = int(np.sum(self.outcomes() == OUTCOMES.index(Outcome.lost)))
        return int(self.distinct.sum()), -lost

    def _doubles(self) -> list[NDArray[np.intp]]:
        """Rows of proved solutions that are real and equal but for rounding, group by group.

        One that is nearly real, but proved not to be, is near its conjugate, listed or not.
        """
        found = self.certificates
        near = np.flatnonzero((np.abs(found.x.imag).max(axis=1) < DOUBLE) & found.proved)
        if len(near) < 2:
            return []
        groups = [near[group] for group in _groups(found.x[near], DOUBLE)]
        return [g for g in groups if self.distinct[g].sum() > 1 or not found.real[g].all()]

    def _all_finite(self) -> bool:
        """Whether x·x differs from 0 at each of the proved solutions.

        In a ball of radius r round X, x·x changes by 2 r Σ|x_j| + 4 r² at most.
        """
        x = self.certificates.x[self.distinct, :4]
        r = self.certificates.radius[self.distinct]
        change = 2 * r * np.abs(x).sum(axis=1) + 4 * r * r + 1e-14 * (np.abs(x) ** 2).sum(axis=1)
        return bool(np.all(np.abs((x * x).sum(axis=1)) > change))

    def _look_closer(self, arrived: Mask, x: Complex) -> None:
        """Try again what is not proved, in ball arithmetic, and sort out the rest."""
        section, found = self.section, self.certificates
        finite = (self.share >= INFINITE) | (DEGREE in section.counts())
        again = np.flatnonzero(~found.proved & finite & arrived[self.tried])
        if len(again):
            second = certify(PATTERN, section.proof, section.errors, x[again], section.exact)
            found = _joined(found, second, again)
        lone = np.flatnonzero(found.lone)
        if len(lone):
            # a conjugate is a solution too
            others = found.x[lone].conj()
            third = certify(PATTERN, section.proof, section.errors, others, section.exact)
            found = _joined(found, third, lone[:0])
        self.certificates, self.distinct = found, found.distinct
        self.complete = int(self.distinct.sum()) == DEGREE and self._all_finite()
        left = np.flatnonzero(~found.proved[: len(x)] & (self.share >= INFINITE))
        if len(left):
            groups = _groups(x[left], ALIKE)
            self.multiples = [left[g] for g in groups if len(g) > 1]
            single = [left[g[0]] for g in groups if len(g) == 1]
            self.unproved = np.array([k for k in single if arrived[self.tried[k]]], np.intp)

    def outcomes(self) -> NDArray[np.int8]:
        """The place in `OUTCOMES` of each path's."""
        codes = {outcome: code for code, outcome in enumerate(OUTCOMES)}
        out = np.full(len(self.paths.t), codes[Outcome.lost], np.int8)
        tried = np.full(len(self.tried), codes[Outcome.lost], np.int8)
        proved = self.certificates.proved[: len(tried)]
        tried[self.share < INFINITE] = codes[Outcome.infinite]
        tried[proved] = codes[Outcome.repeated]
        tried[self.distinct[: len(tried)]] = codes[Outcome.proved]
        for group in self.doubles:
            tried[group[group < len(tried)]] = codes[Outcome.double]
        tried[self.unproved] = codes[Outcome.unproved]
        for group in self.multiples:
            tried[group] = codes[Outcome.multiple]
        out[self.tried] = tried
        out[self.paths.ended(PathEnding.infinite)] = codes[Outcome.infinite]
        return out

    def modes(self) -> PlatformModes:
        """All that is known about the modes."""
        section, found = self.section, self.certificates
        rows = np.flatnonzero(self.distinct & found.real)
        X, solution = found.x[rows].real, rows
        certified = np.ones(len(rows), np.bool_)
        count = int(self.distinct.sum())
        if not self.complete or len(self.doubles):
            more, where = self._numerical()
            X, solution = np.concatenate([X, more]), np.concatenate([rows, where])
            certified = np.concatenate([certified, np.zeros(len(more), np.bool_)])
            count += len(self.multiples) + len(self.unproved)
        poses = _poses(X, section.frames)
        order = _order(poses, section.frames.unit)
        return PlatformModes(
            poses[order],
            certified[order],
            self._completeness(),
            count,
            section.counts,
            self.outcomes(),
            self.paths,
            found,
            solution[order],
            section.frames,
            self.again,
        )

    def _completeness(self) -> Completeness:
        """Whether the list is complete, by proof or by number."""
        if self.complete:
            return Completeness.certified
        same = int(self.distinct.sum()) in self.section.counts()
        whole = not (len(self.multiples) or len(self.unproved) or len(self.certificates.clashes))
        return Completeness.expected if same and whole else Completeness.found

    def _numerical(self) -> tuple[Array, NDArray[np.intp]]:
        """Nearly real solutions that are not proved, and their rows; -1 for multiple ones."""
        ends, found = self.paths.x[self.tried], self.certificates
        x = [_mean(ends[group]) for group in self.multiples]
        x += [_mean(found.x[group]) for group in self.doubles if not found.real[group].any()]
        where = [-1] * len(x)
        undecided = (found.verdict == Verdict.undecided) & self.distinct
        for k in [*self.unproved.tolist(), *np.flatnonzero(undecided).tolist()]:
            x.append(_mean(ends[k : k + 1] if k < len(ends) else found.x[k : k + 1]))
            where.append(k)
        real = [k for k, z in enumerate(x) if np.abs(z.imag).max() < NEARLY_REAL]
        X = np.array([x[k].real for k in real]).reshape(-1, 8)
        return X, np.array([where[k] for k in real], np.intp)


def _joined(first: Certificates, second: Certificates, again: NDArray[np.intp]) -> Certificates:
    """Certificates with some rows replaced by the front ones of others, the rest appended."""
    n = len(again)

    def join(name: str) -> NDArray[Any]:
        values, new = getattr(first, name).copy(), getattr(second, name)
        values[again] = new[:n]
        return np.concatenate([values, new[n:]])

    return Certificates(*(join(name) for name in ("x", "radius", "reach", "verdict")))


def _groups(x: Complex, near: float) -> list[NDArray[np.intp]]:
    """Rows of rays that are near each other, in groups."""
    alike = _closeness(x) < near
    groups, free = [], np.ones(len(x), np.bool_)
    for k in range(len(x)):
        if free[k]:
            groups.append(np.flatnonzero(alike[k] & free))
            free[groups[-1]] = False
    return groups


def _mean(x: Complex) -> Complex:
    """The mean of like rays, (8,), of length 1, turned so that its real part is longest.

    Near a double solution the ends of its two paths lie on opposite sides of it.
    """
    turned = x * np.exp(-1j * np.angle(x @ x[0].conj()))[:, None]
    mean = turned.mean(axis=0)
    mean = mean * np.exp(-0.5j * np.angle(np.sum(mean * mean)))
    return np.asarray(mean / np.linalg.norm(mean))


def _poses(X: Array, frames: Frames) -> Array:
    """Poses of real dual quaternions in normal coordinates, (k, 7), in coordinates of the user."""
    X = X / np.linalg.norm(X[:, :4], axis=1, keepdims=True)
    forms = (X[:, MONOMIALS[0]] * X[:, MONOMIALS[1]]) @ POSE_FORMS
    turned = (forms[:, 3:].reshape(-1, 3, 3) @ frames.ca).reshape(-1, 3)
    poses = np.empty((len(X), 7))
    poses[:, :3] = frames.unit * forms[:, :3] + frames.cb - turned
    poses[:, 3:] = X[:, :4]
    for k in np.flatnonzero(X[:, 0] < ZERO):
        # of q and -q the one with w > 0; where w is 0, that with the next number above 0
        first = np.argmax(np.abs(X[k, :4]) > ZERO)
        poses[k, 3:] *= np.sign(X[k, first])
        poses[k, 3] = max(poses[k, 3], 0.0)
    return poses


def _order(poses: Array, unit: float) -> NDArray[np.intp]:
    """Highest first; numbers that differ by rounding alone count as equal."""
    keys = np.round(
        poses[:, [6, 5, 4, 3, 0, 1, 2]] / (ALIKE_POSES * np.array([1] * 4 + [unit] * 3))
    )
    return np.lexsort(-keys.T)


def _nowhere(frames: Frames) -> PlatformModes:
    """The outcome for a platform whose conditions depend on each other."""
    nothing = np.empty((0, 8), np.complex128)
    zero, whole = np.empty(0), np.empty(0, np.int64)
    return PlatformModes(
        np.empty((0, 7)),
        np.empty(0, np.bool_),
        Completeness.dependent,
        0,
        tuple,
        np.empty(0, np.int8),
        Paths(nothing, zero, np.empty(0, np.int8), whole, whole, zero),
        Certificates(nothing, zero, zero, np.empty(0, np.int8)),
        np.empty(0, np.intp),
        frames,
        False,
    )


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
