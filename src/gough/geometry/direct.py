"""Direct geometry: operational coordinates for given actuated positions, near a known solution.

Where the legs leave only the platform's coordinates unknown, Newton's method works on these alone,
compiled into one kernel for a whole step: a leg's equation is its length, and its derivative by the
platform's twist. The determinant of these derivatives changes its sign where the step crosses a
singularity of type 2; such a step ends with that name. Other mechanisms close all their loops
with damped steps.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from functools import cached_property

import casadi
import numpy as np
from numpy.typing import ArrayLike, NDArray

from gough.errors import ConfigurationError
from gough.geometry.assembly_modes import DirectProblem
from gough.geometry.closing import Closing
from gough.geometry.inverse import InverseGeometry
from gough.kernels import Kernel
from gough.kernels.solves import lu_solve_with_determinant
from gough.numerics.stepping import StepEnding, step_batch

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

TOLERANCE = 1e-12
"""Largest error of a leg's length, in characteristic lengths, of a solution."""
PARTS = 4
"""Parts of the way that damped steps follow to stay on their mode; a guess."""


class Found(Enum):
    """How the direct problem ended for one row; the text is what the user reads."""

    closed = "every loop closes"
    crossed = "the way from near crosses a singularity of type 2"
    open = "no solution was found near: there may be none, or none nearer than another mode"


ENDINGS = tuple(Found)


@dataclass(frozen=True)
class DirectSolution:
    """Operational coordinates for a batch of actuated positions."""

    x: Array
    """Operational coordinates, (*batch, n); the nearest point found where not closed."""
    ending: NDArray[np.int8]
    """The place in `ENDINGS` of each row's, (*batch,)."""

    @property
    def closed(self) -> Mask:
        """Which rows are solutions, (*batch,)."""
        return np.asarray(self.ending == 0)


class DirectGeometry:
    """The direct problem of one mechanism, one mode at a time.

    Args:
        direct: its equations.
        inverse: its inverse geometry, to find configurations near poses.
    """

    def __init__(self, direct: DirectProblem, inverse: InverseGeometry) -> None:
        self.direct, self.inverse = direct, inverse
        self.models, self.assembler = direct.models, direct.assembler
        self.home_x = direct.operational.of(direct.home)

    def solve(
        self, q_actuated: ArrayLike, near: ArrayLike | None = None, threads: int | None = None
    ) -> DirectSolution:
        """Solutions near others.

        Args:
            q_actuated: positions of the actuated joints, (*batch, actuated).
            near: operational coordinates near those wanted, (*batch, n); those of home by default.
            threads: how many work on it; all cores for large batches by default.
        """
        given = np.asarray(q_actuated, dtype=float)
        n = len(self.direct.actuated)
        if given.ndim == 0 or given.shape[-1] != n:
            names = ", ".join(self.direct.actuated.names)
            raise ConfigurationError(
                f"q_actuated has shape {given.shape}, expected (..., {n}): {names}"
            )
        start = self.inverse.checked(self.home_x if near is None else near)
        batch = given.shape[:-1]
        rows = np.ascontiguousarray(given.reshape(-1, n))
        starts = np.broadcast_to(start, (*batch, start.shape[-1])).reshape(len(rows), -1)
        if self.reduced is not None:
            x, ending = self._by_platform(rows, starts, threads)
        else:
            x, ending = self._by_loops(rows, starts, threads)
        return DirectSolution(x.reshape(*batch, -1), ending.reshape(batch))

    # the platform alone

    @cached_property
    def reduced(self) -> Reduced | None:
        """Newton's step on the platform's coordinates; None where more is unknown."""
        return Reduced.of(self.direct)

    def _by_platform(
        self, given: Array, starts: Array, threads: int | None
    ) -> tuple[Array, NDArray[np.int8]]:
        reduced = self.reduced
        assert reduced is not None
        addresses = reduced.step.addresses
        found = step_batch(
            addresses.wide, addresses.scalar, np.ascontiguousarray(starts), given,
            self.assembler.p, TOLERANCE, threads=threads,
        )  # fmt: skip
        ending = np.full(len(given), ENDINGS.index(Found.open), np.int8)
        ending[found.ended(StepEnding.closed)] = ENDINGS.index(Found.closed)
        ending[found.ended(StepEnding.crossed)] = ENDINGS.index(Found.crossed)
        return found.x, ending

    # all loops

    def _by_loops(
        self, given: Array, starts: Array, threads: int | None
    ) -> tuple[Array, NDArray[np.int8]]:
        closing = Closing(self.models, self.assembler, self.direct.actuated)
        near = self.inverse.solve(starts, threads=threads)
        q = np.where(near.reached[:, None], near.q, self.direct.home)
        solution = closing.solve(q, given, steps=PARTS, threads=threads)
        closed = self.assembler.gaps(solution.x) <= 1e-9
        ending = np.where(closed, 0, ENDINGS.index(Found.open)).astype(np.int8)
        return self.direct.operational.of(solution.x), ending


@dataclass(frozen=True)
class Reduced:
    """One Newton step on the platform's coordinates.

    Attributes:
        step: kernel of (x, a, p) -> (x', gap, determinant).
    """

    step: Kernel

    @classmethod
    def of(cls, direct: DirectProblem) -> Reduced | None:
        """The step of a mechanism, or None if more than its platform is unknown."""
        natural, models = direct.problem.natural, direct.models
        platform = models.structure.mechanism.platform
        if platform is None or direct.operational.turned:
            return None
        cluster = natural.of_body[platform]
        owners = {cluster.name, natural.families[cluster.family].name}
        if not {natural.unknowns[u].owner for u in direct.problem.left} <= owners:
            return None
        values = natural.measured(direct.problem.base_poses)
        lengths = [
            condition.polynomial.value(values) / (2.0 * condition.length)
            for condition in natural.conditions
            if not natural.keeps_shape(condition) and condition.length is not None
        ]
        whole = direct.operational.whole
        edge = models.structure.edge_to[platform]
        columns = [
            k for k, v in enumerate(models.structure.variables)
            if v.edge == edge and v.role == "operational"
        ]  # fmt: skip
        others = [c for c in natural.conditions if not natural.keeps_shape(c)]
        if len(lengths) != len(columns) or len(others) != len(lengths):
            return None
        return cls(_step(direct, casadi.vertcat(*lengths), whole, columns))


def _step(
    direct: DirectProblem, lengths: casadi.SX, whole: list[int], columns: list[int]
) -> Kernel:
    """x' = x - J⁻¹ r with unit quaternions, the largest |r|, and det J; lengths in units of L."""
    closure, length = direct.models.closure, direct.assembler.length
    H = closure.position_rates[whole, columns]
    r = lengths / length
    J = casadi.jacobian(r, closure.q[whole]) @ H
    scale = casadi.SX(direct.assembler.rate_scale[columns])
    step, determinant = lu_solve_with_determinant(J @ casadi.diag(scale), r)
    moved = closure.q[whole] - H @ (scale * step)
    if len(whole) > len(columns):
        moved[-4:] = moved[-4:] / casadi.norm_2(moved[-4:])
    gap = casadi.SX(0.0)
    for k in range(r.numel()):
        gap = casadi.fmax(gap, casadi.fabs(r[k]))
    actuated = direct.actuated.whole
    output = casadi.vertcat(moved, gap, determinant)
    # what is neither wanted nor known keeps home's value
    rest = [k for k in range(closure.q.numel()) if k not in {*whole, *actuated}]
    output = casadi.substitute(output, closure.q[rest], casadi.SX(direct.home[rest]))
    inputs = {"x": closure.q[whole], "a": closure.q[actuated], "p": closure.p}
    return Kernel("direct_geometry_step", inputs, output, (output.numel(),))
