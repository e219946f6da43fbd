"""Assembly modes of platforms on six legs: the ends of paths judged, poses, and what is proved."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import Enum
from fractions import Fraction
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gough.geometry.six_leg_sections import (
    DEGREE,
    FORMS,
    MIXED_PAIRS,
    PATTERN,
    X_PAIRS,
    Array,
    Complex,
)
from gough.numerics.certificates import Certificates, Verdict, certify
from gough.numerics.path_tracking import PathEnding, Paths

Mask = NDArray[np.bool_]

ROUNDING = 2.0**-53
INFINITE = 1e-6
"""Where |x·x| is below this times |X|² a path that did not arrive went to infinity; a guess."""
NEAR_END = 0.9
"""Paths that stop from here on may be at a solution of the end all the same."""
ALIKE = 1e-4
"""Ends of paths closer than this, of length 1, are those of one multiple solution; a guess."""
ALIKE_POSES = 1e-6
"""Numbers of poses that differ by less, in the unit of the platform, are ordered by the next."""
ZERO = 1e-12
"""Numbers of unit quaternions below this count as 0 when a sign is chosen."""
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


def share_of_rotation(x: Complex) -> Array:
    """|x·x| / |X|², near 0 where the platform is very far away, (k,)."""
    return np.asarray(
        np.abs((x[:, :4] * x[:, :4]).sum(axis=1)) / (x.real**2 + x.imag**2).sum(axis=1)
    )


def closeness(x: Complex) -> Array:
    """Sines of the angles between rays, (k, k)."""
    x = x / np.linalg.norm(x, axis=1, keepdims=True)
    along = x.conj() @ x.T
    # the part across, not the root of 1 - cos²: that would lose half of the digits
    across = x[None, :, :] - along[:, :, None] * x[:, None, :]
    return np.asarray(np.linalg.norm(across, axis=2))


class Ends:
    """The ends of the paths to one section, judged."""

    def __init__(self, section: Section, paths: Paths, again: bool = False) -> None:
        self.section, self.paths, self.again = section, paths, again
        arrived = paths.ended(PathEnding.arrived)
        stopped = paths.ended(PathEnding.lost) | paths.ended(PathEnding.step_limit)
        near = arrived | (stopped & (paths.t > NEAR_END))
        self.tried = np.flatnonzero(near)
        """The paths whose ends are tried."""
        x = paths.x if near.all() else paths.x[self.tried]
        self.share = share_of_rotation(x)
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
    alike = closeness(x) < near
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


def nowhere(frames: Frames) -> PlatformModes:
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
