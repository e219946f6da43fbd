"""Ranks of the closure Jacobian E = [M N K], and the six defects they define.

Definitions after Zlatanov, Fenton and Benhabib (1995), exact for any mechanism: redundant,
under-actuated, overconstrained or at a singularity.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from gough.assembly import Assembler

Array = NDArray[np.float64]

EPSILON = 1e-9
"""Singular values below this times the largest of E count as zero, in every rank alike."""
ROUNDING = float(np.finfo(float).eps)


@dataclass(frozen=True)
class Linearisation:
    """M q̇_a + N q̇_p + K ẋ = 0 at one configuration.

    Lengths are divided by a characteristic length, so that entries compare and ranks do not
    depend on the unit of length.
    """

    M: Array
    """Columns of the actuated variables, (n, a)."""
    N: Array
    """Columns of the passive variables, (n, p)."""
    K: Array
    """Columns of the operational variables, (n, o)."""

    @cached_property
    def E(self) -> Array:
        """[M N K], (n, a + p + o)."""
        return np.hstack([self.M, self.N, self.K])

    @cached_property
    def threshold(self) -> float:
        """The one absolute threshold of all ranks: ε ‖E‖₂."""
        return EPSILON * spectral_norm(self.E)

    @property
    def counts(self) -> Counts:
        """How many variables of each role there are."""
        return Counts(self.M.shape[1], self.N.shape[1], self.K.shape[1])

    def rank(self, *blocks: Array) -> int:
        """Rank of blocks side by side."""
        return int(np.sum(singular_values(*blocks) > self.threshold))

    @cached_property
    def ranks(self) -> Ranks:
        """Ranks of the blocks that the definitions use."""
        M, N, K = self.M, self.N, self.K
        return Ranks(N=self.rank(N), MN=self.rank(M, N), NK=self.rank(N, K), E=self.rank(M, N, K))

    @cached_property
    def gap(self) -> float:
        """Smallest kept over largest dropped singular value, the worst of the four ranks.

        A dropped value below rounding counts as rounding, so the gap is finite.
        """
        floor = max(ROUNDING * spectral_norm(self.E), np.finfo(float).tiny)
        gaps = [kept / max(dropped, floor) for kept, dropped in self._edges()]
        return min(gaps, default=1 / ROUNDING)

    @cached_property
    def margin(self) -> float:
        """Smallest singular value that any of the four ranks keeps, over the largest of E."""
        largest = spectral_norm(self.E)
        return min((kept / largest for kept, _ in self._edges()), default=1.0)

    def _edges(self) -> Iterator[tuple[float, float]]:
        """Smallest kept and largest dropped singular value of each block with a rank."""
        M, N, K = self.M, self.N, self.K
        for blocks in ((N,), (M, N), (N, K), (M, N, K)):
            s = singular_values(*blocks)
            kept, dropped = s[s > self.threshold], s[s <= self.threshold]
            if kept.size:
                yield float(kept.min()), float(dropped.max(initial=0.0))

    @cached_property
    def kernel(self) -> Array:
        """Orthonormal basis of ker E, the tangent space: (variables, mobility)."""
        return null_space(self.E, self.threshold)


@dataclass(frozen=True)
class Counts:
    """Numbers of variables by role: a, p and o of the formulas."""

    actuated: int
    passive: int
    operational: int

    @property
    def total(self) -> int:
        """All variables."""
        return self.actuated + self.passive + self.operational


@dataclass(frozen=True)
class Ranks:
    """Ranks of N, [M N], [N K] and E = [M N K]."""

    N: int
    MN: int
    NK: int
    E: int

    def largest(self, other: Ranks) -> Ranks:
        """The larger of each rank: ranks are lower semicontinuous, so generic ones are maxima."""
        return Ranks(*(max(a, b) for a, b in zip(self._all(), other._all(), strict=True)))

    def below(self, other: Ranks) -> bool:
        """Whether any rank is below its value in ``other``."""
        return any(a < b for a, b in zip(self._all(), other._all(), strict=True))

    def _all(self) -> tuple[int, ...]:
        return (self.N, self.MN, self.NK, self.E)


@dataclass(frozen=True)
class Defects:
    """Dimensions of what is more or less than a plain robot has."""

    RPM: int
    """Redundant passive motion: passive joints move alone."""
    RI: int
    """Redundant input: motors move and the output does not."""
    RO: int
    """Redundant output: the output moves with the motors locked."""
    II: int
    """Impossible input: codimension of the motor rates that can occur."""
    IO: int
    """Impossible output: codimension of the output rates that can occur."""
    IIM: int
    """Increased instantaneous mobility, over the generic one."""

    def as_dict(self) -> dict[str, int]:
        """The six numbers by name."""
        return asdict(self)


def mobility(ranks: Ranks, counts: Counts) -> int:
    """Instantaneous mobility: variables minus rank of E."""
    return counts.total - ranks.E


def defects(ranks: Ranks, counts: Counts, generic: Ranks) -> Defects:
    """The six defects, exact for every mechanism."""
    return Defects(
        RPM=counts.passive - ranks.N,
        RI=counts.actuated + ranks.N - ranks.MN,
        RO=counts.operational + ranks.N - ranks.NK,
        II=ranks.E - ranks.NK,
        IO=ranks.E - ranks.MN,
        IIM=generic.E - ranks.E,
    )


def linearise(assembler: Assembler, q: Array) -> Linearisation:
    """The rates of a closed configuration q, split by roles."""
    E = assembler.scaled_jacobian(q)
    columns = assembler.models.structure.columns
    return Linearisation(
        E[:, columns("actuated")], E[:, columns("passive")], E[:, columns("operational")]
    )


def printed_tests(rates: Linearisation) -> dict[str, bool]:
    """Truth of conditions (5) to (10) of Lahouar, Zeghloul and Romdhane (2007) as printed there.

    They are offered for comparison. None of them is a definition used here: (5) and (6) misjudge
    redundancy, (8) to (10) together miss singularities of passive motion.
    """
    r_M, r_K, ranks, a = (
        rates.rank(rates.M),
        rates.rank(rates.K),
        rates.ranks,
        rates.counts.actuated,
    )
    return {
        "eq5_m_ge_a": mobility(ranks, rates.counts) >= a,
        "eq6_redundant": r_K < a,
        "eq7_under": r_M < r_K,
        "eq8": r_K == rates.counts.operational,
        "eq9": r_M + ranks.N == ranks.MN,
        "eq10": ranks.N + r_K == ranks.NK,
    }


def singular_values(*blocks: Array) -> Array:
    """Singular values of blocks side by side, largest first."""
    A = np.hstack(blocks)
    return np.asarray(np.linalg.svd(A, compute_uv=False)) if A.size else np.zeros(0)


def spectral_norm(A: Array) -> float:
    """Largest singular value."""
    return float(singular_values(A).max(initial=0.0))


def null_space(A: Array, threshold: float) -> Array:
    """Orthonormal basis of the vectors that A takes below the threshold, as columns."""
    if not A.size:
        return np.eye(A.shape[1])
    _, s, Vt = np.linalg.svd(A)
    return np.asarray(Vt[int(np.sum(s > threshold)) :].T)
