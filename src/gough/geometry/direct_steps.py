"""Newton steps of direct geometry as kernels: on the platform's coordinates, or on natural ones."""

from __future__ import annotations

from abc import ABC, abstractmethod

import casadi
import numpy as np
from numpy.typing import NDArray

from gough import algebra as al
from gough.algebra import Scalar, Transform
from gough.geometry.direct_problem import DirectProblem
from gough.geometry.inverse import InverseGeometry
from gough.joints import Free
from gough.kernels import Kernel
from gough.kernels.solves import lu_solve_with_determinant
from gough.numerics.stepping import Stepped, step_batch
from gough.symbolic.natural.parts import Condition

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
SX = casadi.SX

SHORTEST = 1e-3
"""Least length, in characteristic lengths, that errors of a leg are measured by."""
ALIKE = 1e-9
"""Largest difference, relative, of expressions that are the same but for rounding."""
LONGEST = 0.25
"""Longest first step to a solution, rad and characteristic lengths; a guess."""
TOLERANCE = 1e-13
"""Largest gap of a solution, by root of the sum of squares; lengths in characteristic lengths."""
CLOSED = 1e-9
"""Largest closure residual of a configuration that counts: sines, characteristic lengths."""


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
        equations = LegRows(direct, columns)
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


class LegRows:
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
        q, _ = configurations_near(self.inverse, x)
        problem = self.direct.problem
        return np.ascontiguousarray(problem.measured(q, problem.assembler.p)[:, problem.left])

    def outputs(self, z: Array, given: Array, near: Array) -> tuple[Array, Mask]:
        """Operational coordinates of the configurations with these natural coordinates."""
        start = self.direct.actuated.put(configurations_near(self.inverse, near)[0], given)
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


def configurations_near(inverse: InverseGeometry, x: Array) -> tuple[Array, Mask]:
    """Configurations at operational coordinates, and which are reached; equal rows cost one."""
    alike = bool(np.all(x == x[:1]))
    found = inverse.solve(x[:1] if alike else x)
    q = np.broadcast_to(found.q, (len(x), found.q.shape[-1]))
    return q, np.broadcast_to(found.reached, len(x))
