"""Damped Newton steps for F(q) = 0 with redundant equations and any number of freedoms."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

LARGEST_STEP = 0.5
"""Longest step of one iteration in scaled units: half a radian, half a characteristic length."""
ROUNDING = 1e-15
NOISE = 1e-13
"""Singular values below this times the largest are rounding."""
TINY = 1e-300
CLOSED_AT_START = 1e-13
"""A start this close to a root is kept as it is: at a singular root a step would only lead away."""
STALL = 1e-9
"""A gradient this small relative to its factors means a minimum of the residual, not a root."""


class Ending(Enum):
    """How a solve ended; the text is what the user reads."""

    closed = "every loop closes within tolerance"
    open = "the gap stopped shrinking: this configuration is probably out of reach"
    step_limit = "the gap was still shrinking when the steps ran out"
    not_finite = "the equations have no finite value at the start"


@dataclass(frozen=True)
class Solution:
    """Outcome of a solve."""

    q: Array
    gap: float
    """Largest absolute residual, scaled."""
    ending: Ending
    steps: int


def solve(
    residual: Callable[[Array], Array],
    jacobian: Callable[[Array], Array],
    retract: Callable[[Array, Array], Array],
    q: Array,
    tolerance: float = 1e-12,
    max_steps: int = 120,
) -> Solution:
    """Levenberg-Marquardt steps with damping |F|², of quadratic convergence at redundant rows too.

    Off the solution redundant rows gain rank of the order of the residual; cutting their singular
    values off would make steps jump, damping does not (Yamashita and Fukushima 2001).

    Args:
        residual: F, scaled so that its entries compare.
        jacobian: derivative of F by the step.
        retract: the configuration a step leads to.
        q: the start.
        tolerance: largest residual of a root.
        max_steps: steps before giving up.
    """
    F = residual(q)
    if not np.all(np.isfinite(F)):
        return Solution(q, float("inf"), Ending.not_finite, 0)
    gap, trust = _largest(F), 1.0
    if gap <= CLOSED_AT_START:
        return Solution(q, gap, Ending.closed, 0)
    for steps in range(max_steps):
        if gap <= ROUNDING:
            return Solution(q, gap, Ending.closed, steps)
        slope = _Slope(jacobian(q), F)
        if gap > tolerance and slope.is_minimum():
            return Solution(q, gap, Ending.open, steps)
        new = _improved(residual, retract, q, F, slope, trust)
        if new is None:
            ending = Ending.closed if gap <= tolerance else Ending.open
            return Solution(q, gap, ending, steps)
        q, F, trust = new
        before, gap = gap, _largest(F)
        if gap <= tolerance and gap > 0.5 * before:
            return Solution(q, gap, Ending.closed, steps + 1)
    ending = Ending.closed if gap <= tolerance else Ending.step_limit
    return Solution(q, gap, ending, max_steps)


class _Slope:
    """The linear model of F at one point, in its singular directions."""

    def __init__(self, J: Array, F: Array) -> None:
        U, s, self.Vt = np.linalg.svd(J, full_matrices=False)
        # singular values of rounding size would only drive what is held
        self.s = np.where(s > NOISE * s.max(initial=0.0), s, 0.0)
        self.along = U.T @ F
        self.size = float(np.linalg.norm(F))

    def is_minimum(self) -> bool:
        """Whether the squared residual has no slope left although the equations do not hold."""
        slope = float(np.linalg.norm(self.s * self.along))
        return slope <= STALL * float(self.s.max(initial=0.0)) * self.size

    def step(self, trust: float) -> tuple[Array, float]:
        """The damped step, not longer than allowed, and how much it lowers |F|² if F is linear."""
        damping = trust * min(self.size, 1.0) ** 2
        along = self.s * self.along / (self.s * self.s + damping + TINY)
        length = float(np.linalg.norm(along))
        if length > LARGEST_STEP:
            along *= LARGEST_STEP / length
        left = self.along - self.s * along
        return -self.Vt.T @ along, float(self.along @ self.along - left @ left)


def _improved(
    residual: Callable[[Array], Array],
    retract: Callable[[Array, Array], Array],
    q: Array,
    F: Array,
    slope: _Slope,
    trust: float,
) -> tuple[Array, Array, float] | None:
    """The first of ever more damped steps that lowers the residual about as promised, or None."""
    for _ in range(30):
        step, promised = slope.step(trust)
        new_q = retract(q, step)
        new_F = residual(new_q)
        gained = slope.size**2 - float(new_F @ new_F)
        if np.isfinite(gained) and gained > 0.01 * promised and gained > 0:
            easier = 0.1 if gained > 0.5 * promised else 1.0
            return new_q, new_F, max(trust * easier, 1e-3)
        trust = max(trust, 1e-6) * 10
    return None


def _largest(F: Array) -> float:
    return float(np.max(np.abs(F), initial=0.0))
