"""The closure equations of one mechanism as a square system of quadratic equations in numbers.

`symbolic.natural` writes the equations once; here their coefficients become numbers for given
positions of the known joints, what is linear is solved, equations that repeat others are left out,
and lengths are scaled to about one.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from gough.algebra import Scalar
from gough.errors import ConfigurationError
from gough.geometry.problem import Problem
from gough.kernels import Kernel
from gough.numerics.quadratics import Quadratics
from gough.symbolic.polynomials import Monomial, Polynomial

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
Whole = NDArray[np.int64]

DATA = 1e-14
"""Relative error of coefficients that stands for the rounding of parameters and of constants."""
RANK = 1e-7
"""Relative size below which a pivot is zero; the lengths here are about one."""


class QuadraticClosure:
    """The equations of a problem with numbers as coefficients.

    Attributes:
        n: how many unknowns are left.
        start: a configuration where the equations are regular, home if they are there.
        pattern: the square system, homogeneous in 1 + n unknowns.
        loose: its equations that say more than that an angle, a rotation or a vector is one.

    Raises:
        ConfigurationError: the equations leave a freedom.
    """

    def __init__(self, problem: Problem) -> None:
        self.problem, self.natural, self.left = problem, problem.natural, problem.left
        self.place = {u: k + 1 for k, u in enumerate(self.left)}
        self.size = self._sizes()
        self._choose()

    # symbols

    @cached_property
    def _coefficients(self) -> Kernel:
        return self.problem.kernel("closure_coefficients", [value for *_, value in self.terms])

    @cached_property
    def terms(self) -> list[tuple[int, int, int, Scalar]]:
        """Equation, factors (0 is the homogenising unknown) and coefficient of each term."""
        return [
            (i, *self._factors(key), value)
            for i, condition in enumerate(self.natural.conditions)
            for key, value in sorted(condition.polynomial.terms.items())
        ]

    def _factors(self, key: Monomial) -> tuple[int, int]:
        places = [0] * (2 - len(key)) + [self.place[u] for u in key]
        return places[0], places[1]

    # scales

    def _sizes(self) -> Array:
        """What each homogeneous unknown is a multiple of, (1 + left,)."""
        sizes = [1.0, *(self.natural.sizes[u] for u in self.left)]
        # powers of two, so that scaling rounds nothing
        return np.asarray(2.0 ** np.round(np.log2(sizes)))

    # numbers

    def _full(self, q: Array) -> Array:
        """Scaled equations as matrices, (equations, 1 + left, 1 + left), upper triangles."""
        count = len(self.natural.conditions)
        full = np.zeros((count, len(self.size), len(self.size)))
        if self.terms:
            rows, left, right = self._indices
            values = self._coefficients(q, self.problem.assembler.p)
            full[rows, left, right] = values * self.size[left] * self.size[right]
        return full

    def tables(self, q: Array) -> Array:
        """Equations in SI units as matrices, (equations, 1 + left, 1 + left), upper triangles."""
        return self._full(q) / (self.size[:, None] * self.size)

    def proof(self, q: Array) -> tuple[Quadratics, Array, Array]:
        """The system to prove solutions of: linear equations too, in all the unknowns left.

        Returns:
            Its pattern, its coefficients, and how far the true ones may be from them: bounds of
            the rounding, by interval arithmetic, and `DATA` of the largest of each equation for
            the rounding of what is given.
        """
        rows = np.concatenate([self.linear, self.square]).astype(np.int64)
        order = np.argsort(rows)
        place = np.full(len(self.natural.conditions), -1)
        place[rows[order]] = np.arange(len(rows))
        terms, left, right = self._indices
        used = np.flatnonzero(place[terms] >= 0)
        scale = self.size[left] * self.size[right] / self.row_size[terms]
        low, high = np.moveaxis(self._bounds(q), -1, 0)
        c = (0.5 * (low + high) * scale)[used]
        pattern = Quadratics(len(self.size), place[terms[used]], left[used], right[used])
        largest = np.zeros(len(rows))
        np.maximum.at(largest, pattern.rows, np.abs(c))
        errors = (0.5 * (high - low) * scale)[used] * (1 + 1e-12) + DATA * largest[pattern.rows]
        return pattern, c, errors

    def proof_between(self, low: Array, high: Array) -> tuple[Quadratics, Array, Array]:
        """As `proof`, with errors that cover every q between two bounds.

        Args:
            low: lower bounds of the known positions, at their places in q, (positions,).
            high: upper bounds; what stands for unknown positions says nothing.
        """
        return self.proof(np.array([low, high]))

    def _bounds(self, q: Array) -> Array:
        """Lower and upper bound of each coefficient, (terms, 2).

        Args:
            q: a configuration, (positions,), or lower and upper bounds of it, (2, positions).
        """
        pairs = np.repeat(q, 2) if q.ndim == 1 else np.ascontiguousarray(q.T).ravel()
        return self._coefficients.intervals(pairs, np.repeat(self.problem.assembler.p, 2))

    @cached_property
    def _indices(self) -> tuple[Whole, Whole, Whole]:
        terms = np.array([term[:3] for term in self.terms], dtype=np.int64)
        rows, left, right = terms.reshape(-1, 3).T
        return rows, left, right

    def _choose(self) -> None:
        """Choose pivots of the linear equations, and equations that determine the unknowns."""
        largest = np.max([np.abs(self._full(q)) for q in self.problem.states], axis=0)
        self.row_size = 2.0 ** np.round(np.log2(largest.max(axis=(1, 2))))
        linear = np.array([c.polynomial.degree == 1 for c in self.natural.conditions], dtype=bool)
        self._choose_pivots(np.flatnonzero(linear))
        self.square = self._independent(np.flatnonzero(~linear))
        solved = {self.left[k - 1] for k in self.pivots}
        self.loose = np.flatnonzero([not self._keeps_shape(i, solved) for i in self.square])
        used = np.concatenate([self.square, self.linear])
        self.others = np.setdiff1d(np.arange(len(self.natural.conditions)), used)
        reduced = [np.abs(self._reduced(q)[0][self.square]) for q in self.problem.states]
        seen = np.max(reduced, axis=0) > 1e-13
        seen[self.loose, 0, 0] = True
        self.pattern = Quadratics(1 + self.n, *np.nonzero(seen))

    def _choose_pivots(self, rows: Whole) -> None:
        """Which linear equations are solved, and for what."""
        L = self._full(self.problem.states[1])[rows][:, 0, :] / self.row_size[rows, None]
        chosen, pivots = _pivots(L[:, 1:])
        self.linear, self.pivots = rows[chosen], pivots + 1
        self.kept = np.setdiff1d(np.arange(len(self.size)), self.pivots)
        self.n = len(self.kept) - 1

    def _independent(self, rows: Whole) -> Whole:
        """As many quadratic equations as unknowns, independent at home or near it.

        Raises:
            ConfigurationError: there are too few.
        """
        most = 0
        for q in self.problem.assembler.walked(self.problem.home):
            Q, x = self._reduced(q)[0][rows], self.homogeneous(q)
            J = np.einsum("mab,b->ma", Q + Q.transpose(0, 2, 1), x)[:, 1:]
            picked = rows[np.sort(_pivots(J)[0])] if J.size else rows[:0]
            if len(picked) == self.n:
                self.start = q
                return picked
            most = max(most, len(picked))
        raise ConfigurationError(
            f"what is known leaves {self.n - most} freedoms of "
            f"{self.problem.models.structure.mechanism.name} open: its solutions are no points"
        )

    def _keeps_shape(self, equation: int, solved: set[int]) -> bool:
        """Whether an equation says what the vectors of a class are, and none of these is solved."""
        condition, natural = self.natural.conditions[equation], self.natural
        owners = {
            natural.unknowns[u].owner
            for u in natural.solved.keys() | solved
            if natural.unknowns[u].kind in ("vector", "angle", "platform")
        }
        return natural.keeps_shape(condition) and condition.source not in owners

    def _reduced(self, q: Array) -> tuple[Array, Array]:
        """Equations in the unknowns kept, (equations, 1 + n, 1 + n), and T with x_all = T x."""
        full = self._full(q) / self.row_size[:, None, None]
        T = np.zeros((len(self.size), len(self.kept)))
        T[self.kept, np.arange(len(self.kept))] = 1.0
        if len(self.pivots):
            L = full[self.linear][:, 0, :]
            T[self.pivots] = -np.linalg.solve(L[:, self.pivots], L[:, self.kept])
        Q = T.T @ full @ T
        upper = np.triu(Q) + np.tril(Q, -1).transpose(0, 2, 1)
        return upper, T

    def coefficients(self, q: Array) -> tuple[Array, Array]:
        """Coefficients of the square system, (entries,), and T with x_all = T x."""
        Q, T = self._reduced(q)
        chosen = Q[self.square]
        return chosen[self.pattern.rows, self.pattern.left, self.pattern.right], T

    def homogeneous(self, q: Array) -> Array:
        """The unknowns kept at a closed configuration, scaled, the homogenising one first."""
        values = self.problem.measured(q, self.problem.assembler.p)[self.left]
        return (np.concatenate([[1.0], values]) / self.size)[self.kept]

    def equations(self, q: Array) -> Array:
        """Every quadratic equation in the unknowns kept, (equations, 1 + n, 1 + n)."""
        rows = np.concatenate([self.square, self.others]).astype(np.int64)
        return self._reduced(q)[0][rows]

    def residuals(self, q: Array, x: NDArray[np.number]) -> NDArray[np.number]:
        """What the equations that are not solved come to at solutions x, (*batch, others)."""
        Q, _ = self._reduced(q)
        return np.asarray(np.einsum("...a,mab,...b->...m", x, Q[self.others], x))

    # the platform

    @cached_property
    def _platform(self) -> list[Polynomial] | None:
        """Coordinates of the platform's pose in the unknowns left; None if these do not tell it."""
        natural = self.natural
        platform = self.problem.models.structure.mechanism.platform
        if platform is None:
            return None
        cluster = natural.of_body[platform]
        family = natural.families[cluster.family]
        vectors = [v for image in family.images for v in image]
        if family.pair is not None:
            vectors = [Polynomial.unknown(u) for u in family.pair]
        parts = [p.substituted(natural.solved) for p in (*cluster.position, *vectors)]
        known = all(p.unknowns <= set(self.left) for p in parts)
        return [p for p in parts if p.unknowns] if known else None

    @cached_property
    def _platform_terms(self) -> Kernel:
        terms = [x for p in self._platform or () for x in p.terms.values()]
        return self.problem.kernel("platform", terms)

    def platform(self, q: Array, x: NDArray[np.number]) -> NDArray[np.number] | None:
        """1 and the coordinates of the platform's pose; None where the unknowns do not tell it.

        Args:
            q: a configuration with the known positions in their places.
            x: solutions in all the unknowns left, homogeneous, (rows, 1 + left).

        Returns:
            (rows, 1 + coordinates).
        """
        if self._platform is None:
            return None
        values = (x / x[:, :1]) * self.size
        numbers = iter(self._platform_terms(q, self.problem.assembler.p).tolist())
        columns = [
            sum(
                next(numbers) * np.prod([values[:, self.place[u]] for u in key], axis=0)
                if key
                else next(numbers) * np.ones(len(x))
                for key in p.terms
            )
            for p in self._platform or ()
        ]
        return np.stack([np.ones(len(x)), *columns], axis=1)


def _pivots(A: Array) -> tuple[Whole, Whole]:
    """Rows and columns of a largest regular part of a matrix, by complete pivoting."""
    A = A.copy()
    rows: list[int] = []
    columns: list[int] = []
    top = np.abs(A).max(initial=0.0)
    while len(rows) < min(A.shape):
        i, k = np.unravel_index(np.argmax(np.abs(A)), A.shape)
        if abs(A[i, k]) <= RANK * top:
            break
        rows.append(int(i))
        columns.append(int(k))
        A = A - np.outer(A[:, k], A[i] / A[i, k])
        A[rows, :] = 0.0
        A[:, columns] = 0.0
    return np.array(rows, dtype=np.int64), np.array(columns, dtype=np.int64)
