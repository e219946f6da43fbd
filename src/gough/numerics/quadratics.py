"""Systems of homogeneous quadratic equations, as sparse patterns with coefficients.

Equation i is the sum of c_e x[left_e] x[right_e] over the entries e with row_e = i. A pattern is
fixed for a mechanism; the coefficients c are numbers of one of its states. Affine equations are
made homogeneous with one more unknown, which is 1 in the chart where they are affine.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
Whole = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Quadratics:
    """The pattern of n - 1 homogeneous quadratic equations in n unknowns."""

    unknowns: int
    """n."""
    rows: Whole
    """The equation of each entry, ascending, each from 0 to n - 2, (entries,)."""
    left: Whole
    """The first factor of each entry, (entries,)."""
    right: Whole
    """The second factor, not before the first, (entries,). No entry of a row stands twice."""

    def __post_init__(self) -> None:
        for name in ("rows", "left", "right"):
            # compiled loops read these as they stand
            values = np.require(getattr(self, name), np.int64, ["C", "A", "W"])
            object.__setattr__(self, name, values)
        assert np.all(np.diff(self.rows) >= 0)
        assert np.all(self.left <= self.right)

    @cached_property
    def starts(self) -> Whole:
        """Where the entries of each equation start, and where the last end, (n,)."""
        return np.searchsorted(self.rows, np.arange(self.unknowns)).astype(np.int64)

    def values(self, c: NDArray[np.number], x: NDArray[np.number]) -> NDArray[np.number]:
        """The left sides of the equations.

        Args:
            c: coefficients, (*batch, entries).
            x: unknowns, (*batch, n).

        Returns:
            (*batch, n - 1).
        """
        products = c * x[..., self.left] * x[..., self.right]
        return np.asarray(np.add.reduceat(products, self.starts[:-1], axis=-1))

    def jacobian(self, c: NDArray[np.number], x: NDArray[np.number]) -> NDArray[np.number]:
        """Derivatives of the left sides by the unknowns, (*batch, n - 1, n)."""
        kind = np.result_type(c, x)
        shape = np.broadcast_shapes(c.shape[:-1], x.shape[:-1])
        J = np.zeros((*shape, self.unknowns - 1, self.unknowns), kind)
        for e, (i, a, b) in enumerate(zip(self.rows, self.left, self.right, strict=True)):
            J[..., i, a] += c[..., e] * x[..., b]
            J[..., i, b] += c[..., e] * x[..., a]
        return J
