"""Elimination of the passive rates, and velocity maps between motors and platform.

O has a basis of the whole left null space of N in its columns, so that A q̇_a + B ẋ = 0 with
A = OᵀM, B = OᵀK keeps every equation without passive rates. Three constructions of O agree.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gough.analysis.ranks import Linearisation, null_space

Array = NDArray[np.float64]


def by_svd(rates: Linearisation) -> Array:
    """O from the left singular vectors of N, (n, n - rank N)."""
    return null_space(rates.N.T, rates.threshold)


def by_qr(rates: Linearisation) -> Array:
    """O from the QR factors of N with column pivoting, (n, n - rank N)."""
    import scipy.linalg

    if not rates.N.size:
        return np.eye(rates.N.shape[0])
    Q, R, _ = scipy.linalg.qr(rates.N, pivoting=True)
    rank = int(np.sum(np.abs(np.diag(R)) > rates.threshold))
    return np.asarray(Q[:, rank:])


@dataclass(frozen=True)
class Blocks:
    """Orthonormal vectors that the blocks of E add one after the other, (n, ·) each."""

    Q_N: Array
    """Span of N."""
    Q_M: Array
    """What M adds: the equations that relate motors and platform."""
    Q_K: Array
    """What K adds: pure restrictions of the output rates, d_IO of them."""
    Q_0: Array
    """The rest: redundant equations."""

    @property
    def complement(self) -> Array:
        """O: the complete left null space of N."""
        return np.hstack([self.Q_M, self.Q_K, self.Q_0])


def by_gram_schmidt(rates: Linearisation) -> Blocks:
    """O from block Gram-Schmidt over N, M, K and the identity, in this order.

    The idea of Lahouar et al. (2007, eq. 11) made complete: they stop after M and lose the
    restrictions of the outputs.
    """
    n = rates.E.shape[0]
    found = np.zeros((n, 0))
    parts = []
    # the identity completes the basis: its columns are kept down to rounding, not to the threshold
    for block, threshold in (
        (rates.N, rates.threshold),
        (rates.M, rates.threshold),
        (rates.K, rates.threshold),
        (np.eye(n), 1e-8),
    ):
        new = _orthonormalised(block, found, threshold)
        parts.append(new)
        found = np.hstack([found, new])
    return Blocks(*parts)


def _orthonormalised(block: Array, found: Array, threshold: float) -> Array:
    """Orthonormal vectors that the columns of a block add to those found, largest first."""
    left, new = block.copy(), np.zeros((block.shape[0], 0))
    limit = block.shape[0] - found.shape[1]
    while left.size and new.shape[1] < limit:
        for basis in (found, new, found, new):  # twice: once is not orthogonal to rounding
            left = left - basis @ (basis.T @ left)
        sizes = np.linalg.norm(left, axis=0)
        k = int(np.argmax(sizes))
        if sizes[k] <= threshold:
            break
        new = np.hstack([new, left[:, [k]] / sizes[k]])
        left = np.delete(left, k, axis=1)
    return new


@dataclass(frozen=True)
class VelocityMap:
    """A linear map between rates, with what it can not answer."""

    matrix: Array
    """Rates that come out for unit rates that go in; the smallest where there are several."""
    valid: bool
    """Whether every input rate is possible."""
    unique: bool
    """Whether the output rates follow from the input rates alone."""
    freedom: Array
    """Basis of the output rates that are possible with the input at rest, as columns."""
    refused: Array
    """Basis of the input rates that the equations refuse, as columns."""

    def in_units(self, output: Array, input_: Array) -> VelocityMap:
        """The map for rates that are multiples of other units.

        Args:
            output: unit of each output rate, (outputs,).
            input_: unit of each input rate, (inputs,).
        """
        return VelocityMap(
            output[:, None] * self.matrix / input_,
            self.valid,
            self.unique,
            output[:, None] * self.freedom,
            input_[:, None] * self.refused,
        )


def inverse_map(rates: Linearisation, complement: Array | None = None) -> VelocityMap:
    """q̇_a = -A⁺B ẋ: motor rates from output rates. Valid iff (I - AA⁺)B = 0."""
    O_T = (by_svd(rates) if complement is None else complement).T
    return _solved(O_T @ rates.M, O_T @ rates.K, rates.threshold)


def direct_map(rates: Linearisation, complement: Array | None = None) -> VelocityMap:
    """ẋ = -B⁺A q̇_a: output rates from motor rates. Unique iff d_RO = 0, valid iff d_II = 0."""
    O_T = (by_svd(rates) if complement is None else complement).T
    return _solved(O_T @ rates.K, O_T @ rates.M, rates.threshold)


def passive_map(rates: Linearisation) -> VelocityMap:
    """q̇_p from ẋ, with the motor rates that go with it. Unique iff motors and passive rates are."""
    whole = _solved(np.hstack([rates.N, rates.M]), rates.K, rates.threshold)
    p = rates.N.shape[1]
    freedom = _row_space(whole.freedom[:p].T, 1e-9)
    unique = freedom.shape[1] == 0
    return VelocityMap(whole.matrix[:p], whole.valid, unique, freedom, whole.refused)


def _solved(A: Array, B: Array, threshold: float) -> VelocityMap:
    """The map y = -A⁺B z of A y + B z = 0, by the singular values of A above the threshold."""
    n, y, z = A.shape[0], A.shape[1], B.shape[1]
    if A.size:
        U, s, Vt = np.linalg.svd(A)
        rank = int(np.sum(s > threshold))
    else:
        U, s, Vt, rank = np.eye(n), np.zeros(0), np.eye(y), 0
    U1, V1 = U[:, :rank], Vt[:rank].T
    matrix = -V1 @ ((U1.T @ B) / s[:rank, None]) if rank else np.zeros((y, z))
    left_over = U[:, rank:].T @ B
    refused = _row_space(left_over, threshold)
    return VelocityMap(matrix, refused.shape[1] == 0, rank == y, Vt[rank:].T, refused)


def _row_space(A: Array, threshold: float) -> Array:
    """Orthonormal basis of the inputs that A does not take to zero, as columns."""
    if not A.size:
        return np.zeros((A.shape[1], 0))
    _, s, Vt = np.linalg.svd(A)
    return np.asarray(Vt[: int(np.sum(s > threshold))].T)
