"""Direct geometry: operational coordinates for given actuated positions, near a known solution.

Newton's method works on the unknowns that the legs leave: the platform's coordinates where these
are all, else natural coordinates. One kernel makes a whole step, and `numerics.stepping` repeats
it, with two guards that keep a solution on the mode it starts from: the determinant of the step's
equations, which changes its sign at singularities of type 2, and the lengths of the steps, which
have to shrink. Rows that start too far for that are led along the straight line of actuated
positions, in parts that pass both.
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
from gough.algebra import Scalar, Transform
from gough.errors import ConfigurationError
from gough.geometry.assembly_modes import DirectProblem
from gough.geometry.inverse import InverseGeometry
from gough.joints import Free
from gough.kernels import Kernel
from gough.kernels.solves import lu_solve_with_determinant
from gough.numerics.stepping import ENDINGS as STEP_ENDINGS
from gough.numerics.stepping import StepEnding, Stepped, Stepper, step_batch
from gough.symbolic.natural.parts import Condition

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
SX = casadi.SX

TOLERANCE = 1e-13
"""Largest gap of a solution, by root of the sum of squares; lengths in characteristic lengths."""
CLOSED = 1e-9
"""Largest closure residual of a configuration that counts: sines, characteristic lengths."""
LONGEST = 0.25
"""Longest first step to a solution, rad and characteristic lengths; a guess."""
FINEST = 2.0**-20
"""Least part of the way to the wanted positions that is tried. Where a way passes by a singularity,
parts are as long as what is left to it; through one that it meets steps would be next to nothing,
which the test of their lengths lets pass."""
UNIT = 1e-12
"""How much the square of a quaternion's length may be off 1 to be taken as it is."""
ROUGHLY_UNIT = 1e-6
"""How much a quaternion's length may be off 1 to be made 1."""
SHORTEST = 1e-3
"""Least length, in characteristic lengths, that errors of a leg are measured by."""
ALIKE = 1e-9
"""Largest difference, relative, of expressions that are the same but for rounding."""


class Found(Enum):
    """How the direct problem ended for one row; the text is what the user reads."""

    closed = "every loop closes"
    crossed = "the way from near meets a singularity of type 2"
    open = "no solution was found on the way from near"


ENDINGS = tuple(Found)
_STEPPED = STEP_ENDINGS.index(StepEnding.closed)
_LED = {StepEnding.closed: Found.closed, StepEnding.crossed: Found.crossed}
# nothing but a singularity asks for finer parts than the finest
_LED |= {StepEnding.far: Found.crossed}
_OF_WAYS = np.array([ENDINGS.index(_LED.get(e, Found.open)) for e in STEP_ENDINGS], np.int8)
"""The ending of a way for that of its last part."""


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
        names = direct.operational.names
        self._quaternion = any(name.rpartition(".")[2] == "qw" for name in names)

    @cached_property
    def newton(self) -> Newton:
        """The step of Newton's method, on as few unknowns as there are."""
        return PlatformNewton.of(self.direct) or NaturalNewton(self.direct, self.inverse)

    # one row

    def quick(self, q_actuated: ArrayLike, near: ArrayLike | None = None) -> Array | None:
        """The solution of one row in some microseconds, the same bits as from `solve`.

        None if it takes more than steps of the platform's coordinates from an unobjectionable
        start: `solve` then finds out.

        Args:
            q_actuated: positions of the actuated joints, (actuated,).
            near: operational coordinates near those wanted, (n,); those of home by default.
        """
        stepper = self._stepper
        if stepper is None or getattr(q_actuated, "ndim", 1) != 1:
            return None
        start = self.home_x if near is None else near
        try:
            x, ending, _ = stepper(start, q_actuated)
            if ending != _STEPPED:
                return None
            if self._quaternion:
                w, a, b, c = np.asarray(start).tolist()[-4:]
                if not abs(w * w + a * a + b * b + c * c - 1.0) <= UNIT:
                    return None
        except ValueError:
            return None
        return x

    @cached_property
    def _stepper(self) -> Stepper | None:
        newton, p = self.newton, self.assembler.p
        if not isinstance(newton, PlatformNewton):
            return None
        n = len(self.direct.operational)
        return Stepper(newton.step, n, len(self.direct.actuated), p, TOLERANCE, longest=LONGEST)

    # many rows

    def solve(
        self, q_actuated: ArrayLike, near: ArrayLike | None = None, threads: int | None = None
    ) -> DirectSolution:
        """Solutions near others.

        Args:
            q_actuated: positions of the actuated joints, (*batch, actuated).
            near: operational coordinates near those wanted, (*batch, n); those of home by default.
            threads: how many work on it; all cores for large batches by default.

        Raises:
            ConfigurationError: an argument has the wrong shape, entries that are not finite, or
                quaternions that do not have length 1.
        """
        given = self._checked("q_actuated", q_actuated, self.direct.actuated.names)
        names = self.direct.operational.names
        start = self._checked("near", self.home_x if near is None else near, names)
        if self._quaternion:
            start = _with_unit_quaternions(start)
        try:
            batch = np.broadcast_shapes(given.shape[:-1], start.shape[:-1])
        except ValueError:
            raise ConfigurationError(
                f"the leading axes of q_actuated {given.shape} and near {start.shape} do not "
                "broadcast with each other"
            ) from None
        rows, starts = (
            np.ascontiguousarray(np.broadcast_to(a, (*batch, a.shape[-1]))).reshape(-1, a.shape[-1])
            for a in (given, start)
        )
        x, ending = self._rows(rows, starts, threads)
        return DirectSolution(x.reshape(*batch, len(names)), ending.reshape(batch))

    def _checked(self, name: str, given: ArrayLike, names: Sequence[str]) -> Array:
        """Finite numbers with a last axis as long as there are names."""
        try:
            values = np.asarray(given)
        except ValueError:  # ragged
            values = np.array(None)
        if not np.can_cast(values.dtype, np.float64, "same_kind"):
            raise ConfigurationError(f"{name} is no array of real numbers")
        values = values.astype(np.float64, copy=False)
        if values.ndim == 0 or values.shape[-1] != len(names):
            raise ConfigurationError(
                f"{name} has shape {values.shape}, expected (..., {len(names)}): {', '.join(names)}"
            )
        finite = np.isfinite(values)
        if not finite.all():
            place = np.argwhere(~finite)[0].tolist()
            row = f" in row {', '.join(map(str, place[:-1]))}" if place[:-1] else ""
            raise ConfigurationError(f"{name} has a {names[place[-1]]} that is not finite{row}")
        return values

    def _rows(
        self, given: Array, starts: Array, threads: int | None
    ) -> tuple[Array, NDArray[np.int8]]:
        newton = self.newton
        z = newton.start(starts)
        found = newton.solve(z, given, threads)
        ending = np.zeros(len(z), np.int8)
        far = np.flatnonzero(found.ending != _STEPPED)
        if far.size:
            found.x[far], ending[far] = self._led(z[far], starts[far], given[far], threads)
        x, placed = newton.outputs(found.x, given, starts)
        ending[(ending == 0) & ~placed] = ENDINGS.index(Found.open)
        return x, ending

    def _led(
        self, z: Array, starts: Array, given: Array, threads: int | None
    ) -> tuple[Array, NDArray[np.int8]]:
        """Solutions along the straight way from the actuated positions of the starts.

        Args:
            z: unknowns at the starts, (rows, n).
            starts: operational coordinates, (rows, n).
            given: actuated positions where the ways end, (rows, actuated).
            threads: see `solve`.

        Returns:
            the last solution on each way, (rows, n), and the place in `ENDINGS` of its ending.
        """
        q, reached = _configurations(self.inverse, starts)
        own = self.direct.actuated.of(q)
        way = _shortest(given - own, self.direct.actuated.units)
        side = self.newton.side(z, own)
        ending = np.full(len(z), ENDINGS.index(Found.open), np.int8)
        z, t, h = z.copy(), np.zeros(len(z)), np.full(len(z), 0.25)
        rows = np.flatnonzero(reached)
        while rows.size:
            reach = np.minimum(t[rows] + h[rows], 1.0)
            goal = own[rows] + reach[:, None] * way[rows]
            step = self.newton.solve(z[rows], goal, threads, side[rows])
            passed = step.ended(StepEnding.closed)
            z[rows[passed]], t[rows[passed]] = step.x[passed], reach[passed]
            h[rows] *= np.where(passed, 2.0, 0.5)
            ending[rows] = _OF_WAYS[step.ending]
            rows = rows[(t[rows] < 1) & (h[rows] >= FINEST)]
        return z, ending


def _with_unit_quaternions(x: Array) -> Array:
    """Poses whose trailing quaternions have length 1 but for rounding, (*batch, n)."""
    w, a, b, c = np.moveaxis(x[..., -4:], -1, 0)
    off = np.abs(w * w + a * a + b * b + c * c - 1.0)
    if off.max(initial=0.0) <= UNIT:
        return x
    x = x.copy()
    size = np.linalg.norm(x[..., -4:], axis=-1, keepdims=True)
    away = float(np.abs(size - 1).max())
    if away > ROUGHLY_UNIT:
        raise ConfigurationError(
            f"the length of the quaternion of near is off by {away:.3g}; it must be 1: w, x, y, z "
            "stand last"
        )
    x[..., -4:] /= size
    return x


def _configurations(inverse: InverseGeometry, x: Array) -> tuple[Array, Mask]:
    """Configurations at operational coordinates, and which are reached; equal rows cost one."""
    alike = bool(np.all(x == x[:1]))
    found = inverse.solve(x[:1] if alike else x)
    q = np.broadcast_to(found.q, (len(x), found.q.shape[-1]))
    return q, np.broadcast_to(found.reached, len(x))


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
        step: kernel of (z, a, p) -> (z', gap and determinant at z, length of the step); see
            `numerics.stepping`. The length is the root of the sum of squares, in characteristic
            lengths and radians.
    """

    step: Kernel

    def __init__(self, direct: DirectProblem) -> None:
        self.direct = direct

    @abstractmethod
    def start(self, x: Array) -> Array:
        """Unknowns at operational coordinates, (rows, n)."""

    @abstractmethod
    def outputs(self, z: Array, given: Array, near: Array) -> tuple[Array, Mask]:
        """Operational coordinates of solutions, and whether every loop closes there."""

    def solve(
        self, z: Array, given: Array, threads: int | None, side: Array | None = None
    ) -> Stepped:
        """Steps to solutions, on the side of the singularity that z is on, or that is given."""
        p = self.direct.assembler.p
        return step_batch(
            self.step, z, given, p, TOLERANCE, threads=threads, longest=LONGEST, side=side
        )

    def side(self, z: Array, given: Array) -> Array:
        """The determinant, whose sign tells the side, (rows,)."""
        return np.ascontiguousarray(self.step(z, given, self.direct.assembler.p)[:, -2])


class PlatformNewton(Newton):
    """On the platform's own coordinates: a leg's equation is its length, r = (|d|² - L²) / 2.

    Steps are the platform's rates and solve J step = r in SI units: elimination with partial
    pivoting compares within columns only, so units of columns do not matter.

    Attributes:
        r: the equations in positions q, (legs, 1), in m².
        J: their derivative by the platform's rates, (legs, rates).
        columns: the platform's rates among all.
    """

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
        return cls(direct, legs, columns)

    def __init__(self, direct: DirectProblem, legs: list[Condition], columns: list[int]) -> None:
        super().__init__(direct)
        self.columns = columns
        closure, assembler = direct.models.closure, direct.assembler
        whole = direct.operational.whole
        equations = LegEquations(direct, columns)
        rows = [equations.of(leg) for leg in legs]
        self.r, self.J = (casadi.vertcat(*parts) for parts in zip(*rows, strict=True))
        # by the lengths at home: a relative error of a leg compares with one of another
        homes = direct.problem.probe([leg.length for leg in legs])[0]
        weights = 1.0 / (np.maximum(homes, SHORTEST * assembler.length) * assembler.length)
        step, determinant = lu_solve_with_determinant(self.J, self.r)
        moved = closure.q[whole] - closure.position_rates[whole, columns] @ step
        if len(whole) > len(columns):
            moved[-4:] = moved[-4:] / casadi.norm_2(moved[-4:])
        size = step / SX(assembler.rate_scale[columns])
        self.step = _step_kernel(
            direct, closure.q[whole], moved, SX(weights) * self.r, determinant, size
        )

    def start(self, x: Array) -> Array:
        """The operational coordinates themselves."""
        return x

    def outputs(self, z: Array, given: Array, near: Array) -> tuple[Array, Mask]:
        """The unknowns themselves; other joints close wherever legs have their lengths."""
        return z, np.ones(len(z), dtype=bool)


class LegEquations:
    """What the lengths of legs ask of a platform, and how that changes as it moves.

    The vector along a leg is d = R b + C p - a, with p and R the platform's position and
    orientation; C is mostly 1. With the platform's twist (v, ω) at p (Merlet 2006, ch. 5)

        r = (d·d - L²) / 2,   dr/dt = d·C v + (R b × d)·ω.

    Args:
        direct: the problem.
        columns: the variables that are the platform's freedoms.
    """

    def __init__(self, direct: DirectProblem, columns: list[int]) -> None:
        self.direct, self.natural = direct, direct.problem.natural
        closure, structure = direct.models.closure, direct.models.structure
        platform = str(structure.mechanism.platform)
        self.T = direct.problem.base_poses[platform]
        self.R, self.p = SX.sym("R", 3, 3), SX.sym("p", 3)
        u, v, w = ((self.R[i, 0], self.R[i, 1], self.R[i, 2]) for i in range(3))
        self.values = self._values(platform, ((u, v, w), (self.p[0], self.p[1], self.p[2])))
        whole = direct.operational.whole
        self.positions, self.rates = closure.q[whole], closure.position_rates[whole, columns]
        kind = structure.edges[structure.edge_to[platform]].type
        twists = kind.twists((), {}) if isinstance(kind, Free) else []
        self.twists = [twists[structure.variables[k].freedom] for k in columns if twists]

    def _values(self, platform: str, T: Transform) -> list[Scalar]:
        """Every unknown for T_base_platform; those that are not the platform's mean nothing."""
        cluster = self.natural.of_body[platform]
        at = al.compose(T, al.inverse(cluster.places[platform]))
        turn = al.matmul(at[0], al.transpose(cluster.turn))
        family = self.natural.families[cluster.family].name
        poses = self.direct.problem.base_poses
        return self.natural.measured({**poses, family: (turn, at[1]), cluster.name: at})

    def of(self, leg: Condition) -> tuple[SX, SX]:
        """r and its derivative by the platform's rates, (1, rates)."""
        L = leg.length
        square = self._placed(leg.polynomial.value(self.values)) / 2
        plain = square, casadi.jacobian(square, self.positions) @ self.rates
        for vector in self._vectors(leg):
            found = self._of_vector(vector, al.mul(L, L))
            if self._same(casadi.horzcat(*plain), casadi.horzcat(*found)):
                return found
        return plain

    def _vectors(self, leg: Condition) -> list[SX]:
        """Vectors whose length the condition may be about, in R and p."""
        found = []
        for family in self.natural.families:
            for image in family.images if family.name == leg.source else ():
                parts = [
                    self.natural.solved[u].value(self.values)
                    if u in self.natural.solved
                    else self.values[u]
                    for part in image
                    for u in part.unknowns
                ]
                found.append(casadi.vertcat(*parts, *[0.0] * (3 - len(parts))))
        return found

    def _of_vector(self, d: SX, square: Scalar) -> tuple[SX, SX]:
        """r and its derivative for the vector along a leg and the square of its length."""
        C = casadi.jacobian(d, self.p)
        arm = self._placed(casadi.jacobian(d, casadi.vec(self.R)) @ casadi.vec(self.R))
        d = self._placed(casadi.substitute(d, self.R, SX.zeros(3, 3))) + arm
        linear, angular = d.T @ C, casadi.cross(arm, d)
        row = [linear @ SX(list(v)) + angular.T @ SX(list(w)) for v, w in self.twists]
        return (casadi.sumsqr(d) - square) / 2, casadi.horzcat(*row)

    def _placed(self, expression: Scalar) -> SX:
        """An expression in R and p at the platform's own."""
        R, p = self.T
        actual = [casadi.vertcat(*(casadi.horzcat(*row) for row in R)), casadi.vertcat(*p)]
        return casadi.substitute([SX(expression)], [self.R, self.p], list(map(SX, actual)))[0]

    def _same(self, a: SX, b: SX) -> bool:
        """Whether two rows are the same at every state that is looked at."""
        if a.shape != b.shape:
            return False
        first, second = (self.direct.problem.probe(casadi.vertsplit(row.T)) for row in (a, b))
        return bool(np.all(np.abs(first - second) <= ALIKE * np.max(np.abs(first))))


class NaturalNewton(Newton):
    """On the natural coordinates that linear equations leave."""

    def __init__(self, direct: DirectProblem, inverse: InverseGeometry) -> None:
        super().__init__(direct)
        self.inverse = inverse
        closure, problem = direct.closure, direct.problem
        sizes = SX(closure.size[1:])
        z = SX.sym("z", len(problem.left))
        values = dict(zip(problem.left, (z[k] for k in range(z.numel())), strict=True))
        rows = [int(i) for i in (*closure.linear, *closure.square)]
        conditions = problem.natural.conditions
        r = casadi.vertcat(
            *(conditions[i].polynomial.value(values) / closure.row_size[i] for i in rows)
        )
        J = casadi.jacobian(r, z) @ casadi.diag(sizes)
        step, determinant = lu_solve_with_determinant(J, r)
        self.step = _step_kernel(direct, z, z - sizes * step, r, determinant, step)

    def start(self, x: Array) -> Array:
        """Natural coordinates of configurations at operational coordinates, (rows, n)."""
        q, _ = _configurations(self.inverse, x)
        problem = self.direct.problem
        return np.ascontiguousarray(problem.measured(q, problem.assembler.p)[:, problem.left])

    def outputs(self, z: Array, given: Array, near: Array) -> tuple[Array, Mask]:
        """Operational coordinates of the configurations with these natural coordinates."""
        start = self.direct.actuated.put(_configurations(self.inverse, near)[0], given)
        q = self.direct.placing.configurations(start, z, start)
        return self.direct.operational.of(q), self.direct.assembler.gaps(q) <= CLOSED


def _step_kernel(
    direct: DirectProblem, z: SX, moved: SX, r: SX, determinant: SX, step: SX
) -> Kernel:
    """z', |r|, the determinant and |step|, in z, actuated positions and live parameters."""
    closure = direct.models.closure
    # roots of sums of squares keep a NaN, which the largest of some numbers may lose
    output = casadi.vertcat(moved, casadi.norm_2(r), determinant, casadi.norm_2(step))
    # what is neither unknown nor actuated keeps home's value
    actuated = direct.actuated.whole
    used = {z[k].__hash__() for k in range(z.numel())}
    rest = [
        k
        for k in range(closure.q.numel())
        if k not in actuated and closure.q[k].__hash__() not in used
    ]
    output = casadi.substitute(output, closure.q[rest], SX(direct.home[rest]))
    inputs = {"z": z, "a": closure.q[actuated], "p": closure.p}
    return Kernel("direct_geometry_step", inputs, output, (output.numel(),))
