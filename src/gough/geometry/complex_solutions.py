"""Every complex solution for some actuated positions, filtered, and the real ones proved."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from gough.geometry import monodromy
from gough.numerics.certificates import Certificates, Verdict, certify
from gough.numerics.path_tracking import PathEnding, Paths, track_carefully

if TYPE_CHECKING:
    from gough.geometry.direct_problem import DirectProblem

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
Mask = NDArray[np.bool_]

ROUTES = 4
"""Most other routes that are taken to the solutions when paths were lost."""
NEAR, POLISH = 1e-3, 4
"""How far, relative, and in how many steps an end is refined with all equations."""
SATISFIED = 1e-9
"""Largest residual, relative, of equations that a complex solution has to satisfy besides."""
NEARLY_REAL = 1e-5
"""Largest imaginary part, relative, of a solution whose real part is tried without proof."""


class Solutions:
    """Ends of the paths from the start set to some actuated positions, judged.

    Attributes:
        real: the unknowns left, of each real solution, (k, left).
        certified: which of them are proved, (k,).
        surely: which of them certainly are solutions, (k,).
        singular: whether some are only nearly real, or not regular.
        count: finite complex solutions that satisfy every equation, told apart by the platform.
        surplus: those that do not satisfy every equation.
        routes: how many other routes were taken because paths were lost.
        besides: complex solutions that only these led to.
        ways: in how many ways passive joints fit each of them.
        saturated: whether every path of a complete start set ended at a solution of its own.
    """

    def __init__(self, direct: DirectProblem, q: Array) -> None:
        self.direct, self.closure = direct, direct.closure
        c, self.T = self.closure.coefficients(q)
        self.endings: dict[str, int] = {}
        self.blurred = np.zeros((0, 1 + self.closure.n), dtype=complex)
        self.saturated = self.closure.n == 0
        self.expected: tuple[int, ...] = ()
        self.routes = self.besides = 0
        self.q = q
        x = self._tracked(c) if self.closure.n else np.ones((1, 1), dtype=complex)
        x = self._polished(x)
        x = monodromy.distinct(x) if len(x) else x
        satisfied = self._satisfied(x)
        self.surplus = int(np.sum(~satisfied))
        x = x[satisfied]
        self.count = self._poses(x)
        self.ways = len(x) // self.count if self.count else 1
        if self.ways > 1:
            self.expected = ()
        self._prove(x)

    def _tracked(self, c: Array) -> Complex:
        start = self.direct.start_set
        paths = self._walked(start.coefficients, c, start.x)
        for ending in PathEnding:
            count = int(paths.ended(ending).sum())
            if count:
                self.endings[ending.name.replace("_", " ")] = count
        x = paths.x[paths.ended(PathEnding.arrived)]
        finite = np.abs(x[:, 0]) > monodromy.FINITE
        regular = self._regular(c, x)
        self._count_ends(finite, regular)
        self.blurred = x[finite & ~regular]
        found = x[finite & regular]
        found = monodromy.distinct(found) if len(found) else found
        if _lost(paths):
            found = self._by_other_routes(c, found)
        self.saturated = start.complete and len(found) == len(start.x)
        if start.complete and not len(self.closure.others):
            self.expected = (len(start.x),)
        return found

    def _by_other_routes(self, c: Array, found: Complex) -> Complex:
        """With the ends of paths over other members, until a route loses none and finds none new.

        Each route leads from all start solutions to all solutions, in another order and past other
        members where paths come near one another, so that what one loses another finds.
        """
        start, rng = self.direct.start_set, np.random.default_rng(0)
        known = len(found)
        while self.routes < ROUTES:
            self.routes += 1
            middle = self.direct.family.member(rng)
            there = self._walked(start.coefficients, middle, start.x)
            paths = self._walked(middle, c, there.x[there.ended(PathEnding.arrived)])
            x = paths.x[paths.ended(PathEnding.arrived)]
            x = x[(np.abs(x[:, 0]) > monodromy.FINITE) & self._regular(c, x)]
            before, every = len(found), np.vstack([found, x])
            found = monodromy.distinct(every) if len(every) else found
            if len(found) == before and not (_lost(there) or _lost(paths)):
                break
        self.besides = len(found) - known
        return found

    def _walked(self, start: Complex, target: NDArray[np.number], x: Complex) -> Paths:
        pattern = self.closure.pattern
        return track_carefully(pattern, start, np.asarray(target, dtype=complex), x, light=1)

    def _regular(self, c: Array, x: Complex) -> Mask:
        regular = monodromy.regular(self.closure.pattern, c, x) if len(x) else np.ones(0)
        return np.asarray(regular, dtype=bool)

    def _poses(self, x: Complex) -> int:
        """How many poses of the platform there are among solutions; all of them without one."""
        poses = self.closure.platform(self.q, x @ self.T.T) if len(x) else None
        if poses is None:
            return len(x)
        poses = poses / np.maximum(np.abs(poses).max(axis=0), 1e-12)
        return len(monodromy.first_of_each(poses))

    def _count_ends(self, finite: Mask, regular: Mask) -> None:
        for name, mask in (("at infinity", ~finite), ("at a singular solution", finite & ~regular)):
            if mask.any():
                self.endings[name] = int(mask.sum())
                self.endings["arrived"] -= int(mask.sum())

    def _satisfied(self, x: Complex) -> Mask:
        """Whether solutions satisfy the equations that were not solved."""
        if not len(x) or not len(self.closure.others):
            return np.ones(len(x), dtype=bool)
        rest = self.closure.residuals(self.q, x / x[:, :1])
        size = np.max(np.abs(x / x[:, :1]) ** 2, axis=1)
        return np.asarray(np.max(np.abs(rest), axis=1) <= SATISFIED * size)

    def _polished(self, x: Complex) -> Complex:
        """Solutions by steps of least squares on all equations, where these lead not far.

        A multiple solution of the equations that were solved may be a simple one of all: its end
        has half the digits, and gets the others back.
        """
        if not len(self.closure.others):
            return x
        refined = [self._least_squares(z / z[0]) for z in x]
        near = [
            np.max(np.abs(z / z[0] - r)) < NEAR * np.max(np.abs(r))
            for z, r in zip(x, refined, strict=True)
        ]
        return np.array([r if ok else z for z, r, ok in zip(x, refined, near, strict=True)])

    def _least_squares(self, x: Complex) -> Complex:
        Q = self.closure.equations(self.q)
        for _ in range(POLISH):
            J = np.einsum("mab,b->ma", Q + Q.transpose(0, 2, 1), x)
            r = 0.5 * J @ x
            step = np.linalg.lstsq(J[:, 1:], -r, rcond=1e-12)[0]
            x = np.concatenate([x[:1], x[1:] + step])
        return x

    def _prove(self, x: Complex) -> None:
        """Keep the real solutions, and say which are proved.

        Solutions that are real but for rounding, as near singularities, count by their real part;
        whether loops close there is told later.
        """
        affine = np.asarray(np.concatenate([x, self.blurred]) @ self.T.T, dtype=complex)
        found = self._certificates(affine)
        real, proved = found.real, found.real & found.distinct
        scaled = affine / affine[:, :1]
        size = np.max(np.abs(scaled), axis=1, initial=1.0)
        nearly = np.max(np.abs(scaled.imag), axis=1, initial=0.0) <= NEARLY_REAL * size
        keep = real | (nearly & (found.verdict != Verdict.not_real))
        centres = np.where(real[:, None], found.x, affine)
        values = (centres / np.where(centres[:, :1] == 0, 1, centres[:, :1])).real
        self.real = (values * self.closure.size)[keep][:, 1:]
        self.certified = proved[keep] & (not len(self.closure.others))
        self.surely = real[keep]
        self.singular = bool(np.any(~real[keep]))

    def _certificates(self, affine: Complex) -> Certificates:
        pattern, c, errors = self.closure.proof(self.q)
        return certify(pattern, c, errors, affine)


def _lost(paths: Paths) -> bool:
    """Whether some paths led neither to a solution nor to infinity."""
    ends = paths.ended(PathEnding.arrived) | paths.ended(PathEnding.infinite)
    return not bool(np.all(ends))
