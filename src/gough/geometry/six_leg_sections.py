"""Six conditions on a pose as a linear section of the rigid motions, and ways between sections.

A pose is a homogeneous dual quaternion X = (x, y), eight numbers up to a common factor with
x·y = 0 (the Study quadric). With N = x·x, the rotation R and the position p,

    N R v = x v x*,    N p = 2 vec(y x*),    N Rᵀp = 2 vec(x* y),

are quadratic in X, and so are N and 4 y·y = N p·p. A distance leg |R a + p - b| = L is linear in
these seventeen forms (Husty 1996; Wampler 1996):

    N (a·a + b·b - L²) + 4 y·y + 2 a·(N Rᵀp) - 2 b·(N p) - 2 bᵀ(N R) a = 0,

a plane n·(R a + p - b) = 0 too. The motions span a variety of degree 40 in the space of the forms,
so six linear conditions have at most 40 isolated solutions (Ronga and Vust 1992).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gough.numerics.quadratics import Quadratics

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

DEGREE = 40
"""Most isolated solutions of six conditions."""
FORM_COUNT = 17
"""N; y·y; N Rᵀp (3); N p (3); N R (9, by rows)."""
START_FILE = Path(__file__).with_name("six_leg_start.npz")

X_PAIRS = [(i, j) for i in range(4) for j in range(i, 4)]
MIXED_PAIRS = [(i, j) for i in range(4) for j in range(4, 8)]
Y_SQUARES = [(j, j) for j in range(4, 8)]
STUDY_PAIRS = [(i, i + 4) for i in range(4)]
SHORT = len(X_PAIRS) + len(MIXED_PAIRS)
"""Entries of a row without y·y."""
LONG = SHORT + len(Y_SQUARES)
ENTRIES = LONG + 5 * SHORT + len(STUDY_PAIRS)
LIGHT = 4
"""The first four unknowns, x, are small beside the others where the platform is far away."""


def _pattern() -> Quadratics:
    """Six rows, y·y in the first alone, and the Study quadric."""
    short = X_PAIRS + MIXED_PAIRS
    blocks = [short + Y_SQUARES, *[short] * 5, STUDY_PAIRS]
    rows = np.repeat(np.arange(7), [len(block) for block in blocks])
    left, right = np.ascontiguousarray(np.array([pair for block in blocks for pair in block]).T)
    return Quadratics(8, rows, left, right)


PATTERN = _pattern()
"""The equations of a section, in the entries that `entries` writes."""
SQUARES = np.array(
    [
        first + np.flatnonzero([i == j for i, j in X_PAIRS])
        for first in [0, *range(LONG, ENTRIES - 4, SHORT)]
    ]
)
"""The places of x0², x1², x2², x3² in each row, (6, 4): what a multiple of N adds to."""


def _quaternion_product() -> Array:
    """(a b)_k is the sum of T[k, i, j] a_i b_j, (4, 4, 4)."""
    T = np.zeros((4, 4, 4))
    for k in range(4):
        T[k, 0, k] = T[k, k, 0] = 1
    for k in range(1, 4):
        T[0, k, k] = -1
        i, j = k % 3 + 1, (k + 1) % 3 + 1
        T[k, i, j], T[k, j, i] = 1, -1
    return T


PRODUCT = _quaternion_product()
CONJUGATE = np.array([1.0, -1.0, -1.0, -1.0])


def _forms() -> Array:
    """The seventeen forms in x_i x_j, x_i y_j and y·y, (17, 27)."""
    G = np.zeros((FORM_COUNT, 8, 8))
    G[0, :4, :4] = np.eye(4)
    G[2:5, :4, 4:] = 2 * np.einsum("kij,i->kij", PRODUCT[1:], CONJUGATE)
    G[5:8, 4:, :4] = 2 * np.einsum("kji,i->kji", PRODUCT[1:], CONJUGATE)
    turned = np.einsum("rsb,sac,b->rcab", PRODUCT[1:], PRODUCT[:, :, 1:], CONJUGATE)
    G[8:, :4, :4] = turned.reshape(9, 4, 4)
    G = G + G.swapaxes(1, 2)
    forms = np.zeros((FORM_COUNT, SHORT + 1))
    for m, (i, j) in enumerate(X_PAIRS + MIXED_PAIRS):
        forms[:, m] = G[:, i, j] / (2 if i == j else 1)
    forms[1, SHORT] = 1
    return forms


FORMS = _forms()
SIZES = np.abs(FORMS)
WHOLE_FORMS = FORMS.astype(np.int64).astype(object)
"""For fractions."""


def entries(rows: NDArray[np.number]) -> NDArray[np.number]:
    """Coefficients of `PATTERN`.

    Args:
        rows: coefficients of the forms, without y·y from the second row on, (6, 17).
    """
    forms = WHOLE_FORMS if rows.dtype == object else FORMS
    return _filled(rows @ forms, 1)


def entry_sizes(sizes: Array) -> Array:
    """What bounds the sums of magnitudes behind each entry, of bounds on the coefficients."""
    return np.asarray(_filled(sizes @ SIZES, 0), np.float64)


def _filled(table: NDArray[np.number], study: int) -> NDArray[np.number]:
    c = np.empty(ENTRIES, table.dtype)
    c[:SHORT] = table[0, :SHORT]
    c[SHORT:LONG] = table[0, SHORT]
    c[LONG:-4] = table[1:, :SHORT].ravel()
    c[-4:] = study
    return c


@dataclass(frozen=True)
class Split:
    """A section by rows that suit tracking: orthonormal, y·y in the first row alone."""

    first: NDArray[np.number]
    """(17,); its coefficient of y·y is 1, or it has length 1 where there is no y·y."""
    others: NDArray[np.number]
    """Orthonormal, without y·y, (5, 17)."""

    @property
    def entries(self) -> NDArray[np.number]:
        """Coefficients of `PATTERN`."""
        return entries(np.concatenate([self.first[None], self.others]))


def split(rows: NDArray[np.number]) -> Split:
    """Rows (6, 17) mixed so that they suit tracking.

    A reflection takes y·y out of all rows but the first; those are made orthonormal, and the first
    orthogonal to them.
    """
    c = rows[:, 1].copy()
    size = np.linalg.norm(c)
    if size > 0:
        # reflected with v = c + (phase of c0) |c| e0, c becomes a multiple of e0
        v = c.copy()
        v[0] += size * (c[0] / abs(c[0]) if c[0] != 0 else 1.0)
        rows = rows - np.outer(v, v.conj() @ rows) * (2 / np.real(v.conj() @ v))
    others = rows[1:].T.copy()
    others[1] = 0
    sizes = np.linalg.norm(others, axis=0)
    Q = np.linalg.qr(others / np.where(sizes > 0, sizes, 1.0))[0]
    first = rows[0] - Q @ (Q.conj().T @ rows[0])
    scale = first[1] if size > 0 else np.linalg.norm(first) or 1.0
    return Split(first / scale, Q.T)


@dataclass(frozen=True)
class StartSet:
    """A section and the solutions to start from."""

    entries: Complex
    """Coefficients of `PATTERN`, (164,)."""
    x: Complex
    """Its solutions, (solutions, 8)."""


@dataclass(frozen=True)
class GenericStart:
    """A generic section with its 40 solutions, from which any section can be reached."""

    rows: Split
    start: StartSet

    @classmethod
    def of(cls, rows: Complex, x: Complex) -> GenericStart:
        """The start of rows (6, 17) that are split already, and their solutions, (40, 8)."""
        good = Split(rows[0], rows[1:])
        return cls(good, StartSet(np.asarray(good.entries), x))

    def target(self, rows: NDArray[np.number]) -> Complex:
        """Coefficients of a section, its rows mixed to be near those of the start.

        The mixture is the unitary factor of the polar decomposition: of all orthonormal rows that
        describe the section, those nearest to the rows of the start.

        Args:
            rows: (6, 17).

        Returns:
            (164,).
        """
        end = split(rows)
        U, _, V = np.linalg.svd(self.rows.others @ end.others.T.conj())
        first = end.first.astype(np.complex128)
        if end.first[1] == 0:
            across = np.vdot(end.first, self.rows.first)
            first = first * (across / abs(across) if across else 1.0)
        mixed = np.concatenate([first[None], U @ V @ end.others])
        return np.asarray(entries(mixed))


@cache
def generic_start() -> GenericStart:
    """The generic section that comes with the package (made by `tools/six_leg_start.py`)."""
    with np.load(START_FILE) as data:
        return GenericStart.of(data["rows"], data["x"])
