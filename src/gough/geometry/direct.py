"""Direct geometry: operational coordinates for given actuated positions, near a known solution.

Newton's method works on the unknowns that the legs leave: the platform's coordinates where these
are all, else natural coordinates. One kernel makes a whole step. Two guards keep a solution on the
mode it starts from:

- the determinant of the step's equations changes its sign at singularities of type 2; a step that
  would lead across ends there;
- a first step counts only if the second is a quarter of it or less, in units that do not depend on
  the equations (Deuflhard 2004, ch. 3). Rows that start too far for that are led along the straight
  line of actuated positions, in steps that pass the test.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
from functools import cached_property

import casadi
import numpy as np
from numpy.typing import ArrayLike, NDArray

from gough import algebra as al
from gough.algebra import Scalar
from gough.errors import ConfigurationError
from gough.geometry.assembly_modes import DirectProblem
from gough.geometry.inverse import InverseGeometry
from gough.kernels import Kernel
from gough.kernels.solves import lu_solve_with_determinant
from gough.numerics.stepping import StepEnding, Stepped, step_batch
from gough.symbolic.natural import NaturalClosure
from gough.symbolic.natural.parts import Condition

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

TOLERANCE = 1e-13
"""Largest residual of a solution; lengths in characteristic lengths."""
CLOSED = 1e-9
"""Largest closure residual of a configuration that counts: sines, characteristic lengths."""
CONTRACTION = 0.25
"""Largest second step, in first steps, of a start that is near enough."""
NOTHING = 1e-7
"""First steps below this, relative, are near whatever follows: rounding is all there is."""
FINEST = 2.0**-14
"""Least part of the way to the wanted positions that is tried."""


class Found(Enum):
    """How the direct problem ended for one row; the text is what the user reads."""

    closed = "every loop closes"
    crossed = "the way from near meets a singularity of type 2"
    open = "no solution was found on the way from near"


ENDINGS = tuple(Found)


@dataclass(frozen=True)
class DirectSolution:
    """Operational coordinates for a batch of actuated positions."""

    x: Array
    """Operational coordinates, (*batch, n); the last solution on the way where not closed."""
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
        self.assembler = direct.assembler
        self.home_x = direct.operational.of(direct.home)

    @cached_property
    def newton(self) -> Newton:
        """The step of Newton's method, on as few unknowns as there are."""
        return PlatformNewton.of(self.direct) or NaturalNewton(self.direct, self.inverse)

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
        batch = np.broadcast_shapes(given.shape[:-1], start.shape[:-1])
        rows = np.broadcast_to(given, (*batch, n)).reshape(-1, n)
        starts = np.broadcast_to(start, (*batch, start.shape[-1])).reshape(len(rows), -1)
        x, ending = self._rows(np.ascontiguousarray(rows), np.ascontiguousarray(starts), threads)
        return DirectSolution(x.reshape(*batch, -1), ending.reshape(batch))

    def _rows(
        self, given: Array, starts: Array, threads: int | None
    ) -> tuple[Array, NDArray[np.int8]]:
        newton = self.newton
        z = newton.start(starts)
        sure = newton.is_near(z, given)
        found = newton.solve(z, given, threads)
        closed = found.ended(StepEnding.closed)
        ending = np.where(closed, 0, ENDINGS.index(Found.open)).astype(np.int8)
        far = np.flatnonzero(~(sure & closed))
        if far.size:
            found.x[far], ending[far] = self._led(z[far], starts[far], given[far])
        x, placed = newton.outputs(found.x, given, starts)
        ending[(ending == 0) & ~placed] = ENDINGS.index(Found.open)
        return x, ending

    def _led(self, z: Array, starts: Array, given: Array) -> tuple[Array, NDArray[np.int8]]:
        """Solutions along the straight way from the actuated positions of the starts."""
        near = self.inverse.solve(starts)
        own = self.direct.actuated.of(near.q)
        way = _shortest(given - own, self.direct.actuated.units)
        ending = np.full(len(z), ENDINGS.index(Found.open), np.int8)
        z, t, h = z.copy(), np.zeros(len(z)), np.full(len(z), 0.25)
        active = np.array(near.reached)
        while active.any():
            rows = np.flatnonzero(active)
            reach = np.minimum(t[rows] + h[rows], 1.0)
            goal = own[rows] + reach[:, None] * way[rows]
            sure = self.newton.is_near(z[rows], goal)
            step = self.newton.solve(z[rows], goal, None)
            passed = sure & step.ended(StepEnding.closed)
            z[rows[passed]], t[rows[passed]] = step.x[passed], reach[passed]
            h[rows] *= np.where(passed, 2.0, 0.5)
            ending[rows[step.ended(StepEnding.crossed)]] = ENDINGS.index(Found.crossed)
            ending[active & (t >= 1)] = ENDINGS.index(Found.closed)
            active &= (t < 1) & (h >= FINEST)
        return z, ending


def _shortest(way: Array, units: list[str]) -> Array:
    """Ways between positions, of angles by less than half a turn."""
    angles = [k for k, unit in enumerate(units) if unit == "rad"]
    way = np.array(way)
    way[:, angles] -= 2 * np.pi * np.round(way[:, angles] / (2 * np.pi))
    return way


# steps


class Newton(ABC):
    """Newton's method on some unknowns z.

    Attributes:
        step: kernel of (z, a, p) -> (z', largest residual at z, determinant at z).
        size: what each number of z is a multiple of, (n,).
    """

    step: Kernel
    size: Array

    def __init__(self, direct: DirectProblem) -> None:
        self.direct = direct

    @abstractmethod
    def start(self, x: Array) -> Array:
        """Unknowns at operational coordinates, (rows, n)."""

    @abstractmethod
    def outputs(self, z: Array, given: Array, near: Array) -> tuple[Array, Mask]:
        """Operational coordinates of solutions, and whether every loop closes there."""

    def solve(self, z: Array, given: Array, threads: int | None) -> Stepped:
        """Steps to solutions."""
        addresses, p = self.step.addresses, self.direct.assembler.p
        return step_batch(addresses.wide, addresses.scalar, z, given, p, TOLERANCE, threads=threads)

    def is_near(self, z: Array, given: Array) -> Mask:
        """Whether the second step is so much smaller than the first that the solution is near."""
        p, n = self.direct.assembler.p, len(self.size)
        with np.errstate(all="ignore"):
            first = self.step(z, given, p)[..., :n]
            second = self.step(first, given, p)[..., :n]
            steps = [
                np.max(np.abs(b - a) / self.size, axis=-1) for a, b in ((z, first), (first, second))
            ]
            return np.asarray((steps[1] <= CONTRACTION * steps[0]) | (steps[0] <= NOTHING))


class PlatformNewton(Newton):
    """On the platform's own coordinates: a leg's equation is its length."""

    @classmethod
    def of(cls, direct: DirectProblem) -> PlatformNewton | None:
        """The method for a mechanism, or None if more than its platform is unknown."""
        natural, models = direct.problem.natural, direct.models
        platform = models.structure.mechanism.platform
        if platform is None or direct.operational.turned:
            return None
        cluster = natural.of_body[platform]
        owners = {cluster.name, natural.families[cluster.family].name}
        if not {natural.unknowns[u].owner for u in direct.problem.left} <= owners:
            return None
        edge = models.structure.edge_to[platform]
        columns = [
            k
            for k, v in enumerate(models.structure.variables)
            if v.edge == edge and v.role == "operational"
        ]
        legs = [c for c in natural.conditions if not natural.keeps_shape(c)]
        if len(legs) != len(columns) or any(c.length is None for c in legs):
            return None
        values = natural.measured(direct.problem.base_poses)
        lengths = [_excess(natural, c, values) / (2.0 * c.length) for c in legs]
        return cls(direct, casadi.vertcat(*lengths), columns)

    def __init__(self, direct: DirectProblem, lengths: casadi.SX, columns: list[int]) -> None:
        super().__init__(direct)
        closure, assembler = direct.models.closure, direct.assembler
        whole = direct.operational.whole
        self.size = assembler.position_scale[whole]
        H = closure.position_rates[whole, columns]
        r = lengths / assembler.length
        scale = casadi.SX(assembler.rate_scale[columns])
        J = casadi.jacobian(r, closure.q[whole]) @ H @ casadi.diag(scale)
        step, determinant = lu_solve_with_determinant(J, r)
        moved = closure.q[whole] - H @ (scale * step)
        if len(whole) > len(columns):
            moved[-4:] = moved[-4:] / casadi.norm_2(moved[-4:])
        self.step = _step_kernel(direct, closure.q[whole], moved, r, determinant)

    def start(self, x: Array) -> Array:
        return x

    def outputs(self, z: Array, given: Array, near: Array) -> tuple[Array, Mask]:
        return z, np.ones(len(z), dtype=bool)


def _excess(natural: NaturalClosure, condition: Condition, values: Sequence[Scalar]) -> Scalar:
    """How much the square of a vector's length is too large.

    Written out it is a polynomial with many terms; of the vector itself it takes few operations.
    """
    for family in natural.families:
        if family.name == condition.source and len(family.basis) == 1:
            parts = [
                natural.solved[u].value(values) if u in natural.solved else values[u]
                for part in family.images[0]
                for u in part.unknowns
            ]
            return al.sub(al.dot(parts, parts), al.mul(condition.length, condition.length))
    return condition.polynomial.value(values)


class NaturalNewton(Newton):
    """On the natural coordinates that linear equations leave."""

    def __init__(self, direct: DirectProblem, inverse: InverseGeometry) -> None:
        super().__init__(direct)
        self.inverse = inverse
        closure, problem = direct.closure, direct.problem
        self.size = closure.size[1:]
        z = casadi.SX.sym("z", len(problem.left))
        values = dict(zip(problem.left, (z[k] for k in range(z.numel())), strict=True))
        rows = [int(i) for i in (*closure.linear, *closure.square)]
        conditions = problem.natural.conditions
        r = casadi.vertcat(
            *(conditions[i].polynomial.value(values) / closure.row_size[i] for i in rows)
        )
        J = casadi.jacobian(r, z) @ casadi.diag(casadi.SX(self.size))
        step, determinant = lu_solve_with_determinant(J, r)
        self.step = _step_kernel(direct, z, z - self.size * step, r, determinant)

    def start(self, x: Array) -> Array:
        q = self.inverse.solve(x).q
        problem = self.direct.problem
        return np.ascontiguousarray(problem.measured(q, problem.assembler.p)[:, problem.left])

    def outputs(self, z: Array, given: Array, near: Array) -> tuple[Array, Mask]:
        start = self.direct.actuated.put(self.inverse.solve(near).q, given)
        q = self.direct.placing.configurations(start, z, start)
        return self.direct.operational.of(q), self.direct.assembler.gaps(q) <= CLOSED


def _step_kernel(
    direct: DirectProblem, z: casadi.SX, moved: casadi.SX, r: casadi.SX, determinant: casadi.SX
) -> Kernel:
    """z', the largest |r| and the determinant, in z, actuated positions and live parameters."""
    closure = direct.models.closure
    gap = casadi.SX(0.0)
    for k in range(r.numel()):
        gap = casadi.fmax(gap, casadi.fabs(r[k]))
    output = casadi.vertcat(moved, gap, determinant)
    # what is neither unknown nor actuated keeps home's value
    actuated = direct.actuated.whole
    used = {z[k].__hash__() for k in range(z.numel())}
    rest = [
        k
        for k in range(closure.q.numel())
        if k not in actuated and closure.q[k].__hash__() not in used
    ]
    output = casadi.substitute(output, closure.q[rest], casadi.SX(direct.home[rest]))
    inputs = {"z": z, "a": closure.q[actuated], "p": closure.p}
    return Kernel("direct_geometry_step", inputs, output, (output.numel(),))
