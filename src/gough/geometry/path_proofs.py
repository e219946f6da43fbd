"""Certificates that hold along a whole stretch of a path.

Along a stretch q(τ), τ from -1/2 to 1/2, each coefficient of the equations x·C_k x = 0 is

    c(τ) = c(0) + τ d,    d in D, the interval of ∂c/∂q q' over the stretch,

by the mean value theorem. A certificate takes errors of single coefficients and proves balls of one
radius, so equations and unknowns are brought to a form first where that loses little. With the
singular values of the Jacobian at a solution z, J = U Σ Vᵀ, unknowns are x = T y and equations are
multiplied by M:

    T = V W,   M = (W Σ)⁻¹ Uᵀ,   W = diag(√(σ_min / σ_k)),

so that balls are long in the direction in which solutions move most, that of σ_min, and the last
unknown, the null vector of J, is z itself. With D in middles m and radii r, and e the error of
c(0), each a matrix for every equation, the matrices of the new equations are within

    |Tᵀ (Σ M_ik m_k) T| / 2 + |T|ᵀ (Σ |M_ik| (r_k / 2 + e_k)) |T|

of Tᵀ (Σ M_ik C_k(0)) T. Near a fold the first part is small where the stretch runs along the fold,
however long M is. A certificate proves that the Jacobian of the new equations has full rank at the
solution; so M has, and both systems have the same solutions.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import casadi
import numpy as np
from numpy.typing import NDArray

from gough.geometry.quadratic_closure import DATA, QuadraticClosure
from gough.kernels import Kernel
from gough.numerics.certificates import Certificates, certify
from gough.numerics.quadratics import Quadratics

Array = NDArray[np.float64]
Whole = NDArray[np.int64]
Bounds = tuple[Array, Array]

UNIT = 2.0**-53
"""Rounding of one operation."""
ROUNDING = 1e-12
"""Room for the rounding of distances between points of about length one."""
SMALLEST = 1e-9
"""Least ratio of singular values that the form of the unknowns goes by."""


@dataclass(frozen=True, eq=False)
class Ball:
    """Where a solution is proved to be, and to be alone, along a stretch.

    Args:
        found: one certificate, for the unknowns y; its chart is a·(y - a) = 0.
        T: x = T y, (n, n).
    """

    found: Certificates
    T: Array

    @property
    def real(self) -> bool:
        """Whether a real solution is proved."""
        return bool(self.found.real[0])

    @property
    def centre(self) -> Array:
        """The solution in the middle of the stretch, about, x of length 1, (n,)."""
        return np.asarray(self.T @ self.found.x[0].real)

    def holds(self, point: Ball) -> bool:
        """Whether the solution of another ball, at one place of the stretch, is that of this one.

        With T of this ball and T' of the other, that solution is x* = T' (a' + e'), |e'| <= r'.
        So T⁻¹ x* = y + e with y = T⁻¹ T' a' and |e| <= ρ = |T⁻¹ T'| r'. With A = a·a and
        t = a·y > 0 it is y*' = A (y + e) / (a·(y + e)) in the chart of this ball, where

            | y*' - A y / t | <= A ρ (t + |y| |a|₁) / (t (t - |a|₁ ρ)),

        as |a·e| <= |a|₁ ρ. If that is nearer to a than the reach, it is the only solution there.
        The homogenising unknown x₀ must not vanish in the ball.
        """
        a, inverse, x = self.found.x[0].real, _inverse(self.T), point.centre
        x = x if a @ (inverse @ x) > 0 else -x
        y = inverse @ x
        t, A, sum_a = float(a @ y), float(a @ a), float(np.abs(a).sum())
        # y is not quite T⁻¹ x, the inverse not quite T⁻¹, and x not quite T' a'
        off = float(np.abs(self.T @ y - x).max()) + 1e-14
        rho = 2 * _size(inverse) * off + 1.001 * _size(inverse @ point.T) * point.found.radius[0]
        if not t > 2 * sum_a * rho:
            return False
        spread = A * rho * (t + np.abs(y).max() * sum_a) / (t * (t - sum_a * rho))
        distance = float(np.abs(A / t * y - a).max())
        finite = abs(self.T[0] @ a) > np.abs(self.T[0]).sum() * self.found.radius[0]
        near = (distance + spread) * (1 + ROUNDING) + ROUNDING < self.found.reach[0]
        return bool(finite and near)


class Stretches:
    """Certificates along stretches for the equations of one problem."""

    def __init__(self, closure: QuadraticClosure) -> None:
        self.closure, self.problem = closure, closure.problem
        self.p = np.repeat(closure.problem.assembler.p, 2)
        self.n = len(closure.size)

    @cached_property
    def _slopes(self) -> Kernel:
        """Derivative of every coefficient along a direction of q."""
        closure = self.problem.models.closure
        column = casadi.vertcat(*(casadi.SX(value) for *_, value in self.closure.terms))
        direction = casadi.SX.sym("direction", closure.q.numel())
        slopes = casadi.jtimes(column, closure.q, direction)
        inputs = {"q": closure.q, "p": closure.p, "direction": direction}
        return Kernel("closure_coefficient_slopes", inputs, slopes, (column.numel(),))

    @cached_property
    def _used(self) -> tuple[Whole, Array]:
        """The terms of the equations to prove, and the scale of each."""
        closure = self.closure
        rows, left, right = np.array([t[:3] for t in closure.terms], dtype=np.int64).T
        used = np.flatnonzero(np.isin(rows, np.concatenate([closure.linear, closure.square])))
        scale = closure.size[left] * closure.size[right] / closure.row_size[rows]
        return used, scale[used]

    @cached_property
    def _dense(self) -> tuple[Quadratics, Whole, Whole]:
        """The pattern with every product in every equation, and the places of the products."""
        left, right = (k.astype(np.int64) for k in np.triu_indices(self.n))
        equations = np.repeat(np.arange(self.n - 1), len(left))
        tiled = (np.tile(k, self.n - 1) for k in (left, right))
        return Quadratics(self.n, equations, *tiled), left, right

    def along(self, middle: Bounds, box: Bounds, change: Bounds, x: Array) -> Ball:
        """What is proved of a solution along a stretch.

        Args:
            middle: bounds of q in the middle, (positions,) each.
            box: bounds of q along the stretch.
            change: bounds of q' along it: of the change of q, at constant rates.
            x: about the solution, of about length 1, (n,).
        """
        m, r = self._derivatives(box, change)
        return self._ball(middle, m, r, x)

    def at(self, place: Bounds, x: Array) -> Ball:
        """What is proved of a solution at one place."""
        none = np.zeros(len(self._used[0]))
        return self._ball(place, none, none, x)

    def _ball(self, middle: Bounds, m: Array, r: Array, x: Array) -> Ball:
        pattern, c, e = self.closure.proof_between(*middle)
        M, T = _form(np.asarray(pattern.jacobian(c, x), dtype=float))
        C, D, E = (self._matrices(pattern, values) for values in (c, m, 0.5 * r + e))
        size, long = np.abs(M), np.abs(T)
        moved = np.abs(_folded(T.T @ _combined(M, D) @ T))
        # each product below is a sum of less than 8 n terms in all
        rounding = 8 * self.n * UNIT * _combined(size, np.abs(C) + np.abs(D))
        spread = 0.5 * moved + _folded(long.T @ (_combined(size, E) + rounding) @ long)
        found = _folded(T.T @ _combined(M, C) @ T)
        dense, left, right = self._dense
        values, errors = (A[:, left, right].ravel() for A in (found, spread * (1 + 1e-12)))
        return Ball(certify(dense, values, errors, np.linalg.solve(T, x)[None]), T)

    def _derivatives(self, box: Bounds, change: Bounds) -> Bounds:
        """Middles and radii of the derivatives of the coefficients, (entries,) each."""
        used, scale = self._used
        low, high = self._slopes.intervals(_pairs(box), self.p, _pairs(change))[used].T
        bounded = np.isfinite(low) & np.isfinite(high)
        low, high = np.where(bounded, low, -1e150), np.where(bounded, high, 1e150)
        mean = 0.5 * (low + high) * scale
        return mean, 0.5 * (high - low) * scale * (1 + 1e-12) + DATA * np.abs(mean)

    def _matrices(self, pattern: Quadratics, values: Array) -> Array:
        """Numbers of the entries as upper triangles, (equations, n, n)."""
        table = np.zeros((self.n - 1, self.n, self.n))
        table[pattern.rows, pattern.left, pattern.right] = values
        return table


def _form(J: Array) -> tuple[Array, Array]:
    """M and T for a Jacobian, (n - 1, n)."""
    U, s, Vt = np.linalg.svd(J)
    ratio = np.sqrt(np.maximum(s[-1] / s, SMALLEST))
    return (U / np.maximum(ratio * s, 1e-150)).T, Vt.T * np.append(ratio, 1.0)


def _combined(M: Array, tables: Array) -> Array:
    """Sums of matrices with weights, Σ M_ik A_k."""
    return np.asarray(np.tensordot(M, tables, axes=1))


def _folded(tables: Array) -> Array:
    """Square matrices as upper triangles with the same quadratic form."""
    return np.asarray(np.triu(tables) + np.tril(tables, -1).swapaxes(-1, -2))


def _inverse(A: Array) -> Array:
    return np.asarray(np.linalg.inv(A), dtype=float)


def _size(A: Array) -> float:
    """The norm of a matrix that goes with largest moduli."""
    return float(np.abs(A).sum(axis=1).max())


def _pairs(bounds: Bounds) -> Array:
    """Lower and upper bound side by side, (2 positions,)."""
    return np.ascontiguousarray(np.array(bounds).T).ravel()
