"""The closure Jacobian and its rate, row by row, in as few operations as the loops allow."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import casadi
import numpy as np
from numpy.typing import NDArray

from gough import algebra as al
from gough.algebra import Scalar, Transform, Vector
from gough.description.frames import transform
from gough.description.values import scalar
from gough.joints import TYPES
from gough.joints.base import Row
from gough.joints.constraints import CONSTRAINTS
from gough.symbolic.closure import Closure
from gough.symbolic.screws import Motion, State, Way, known
from gough.topology import Closing

Array = NDArray[np.float64]
SX = casadi.SX


@dataclass(frozen=True)
class Samples:
    """Closed configurations of one assembly, from which is read what never changes."""

    q: Array
    """(samples, positions)."""
    p: Array
    """Live parameters of each, (samples, parameters)."""
    row_scale: Array
    """Factor that makes each closure row comparable, (rows,)."""
    rate_scale: Array
    """Unit of each variable's rate that makes them comparable, (variables,): m or 1."""
    length: float
    """Characteristic length, m."""
    telling: bool = True
    """Whether they are enough to tell what never changes."""


def evaluated(closure: Closure, samples: Samples, scalars: Sequence[Scalar]) -> Array:
    """Scalars of (q, p) at every sample, (samples, scalars)."""
    if not len(scalars):
        return np.zeros((len(samples.q), 0))
    column = casadi.densify(SX(casadi.vertcat(*[SX(x) for x in scalars])))
    function = casadi.Function("scalars", [closure.q, closure.p], [column])
    pairs = zip(samples.q, samples.p, strict=True)
    return np.array([np.array(function(q, p)).ravel() for q, p in pairs])


class ClosingRates:
    """E C and the rate of E C w at closed configurations, with v = C w of kept rates w.

    Args:
        closure: the closure equations.
        samples: closed configurations of the assembly; what holds at all of them is used.
        C: (variables, kept).
    """

    def __init__(self, closure: Closure, samples: Samples, C: Array) -> None:
        self.closure, self.samples, self.C = closure, samples, C

    @cached_property
    def _loops(self) -> list[_Loop]:
        closings = self.closure.structure.closings
        return [_Loop(self.closure, closing, self) for closing in closings]

    def motion(self, way: Way) -> Motion:
        """The motion at the end of a way."""
        return Motion(
            way, self.C, self._evaluated if self.samples.telling else None, self.samples.length
        )

    @cached_property
    def entries(self) -> list[dict[int, Scalar]]:
        """For each closure row, its entry for each kept rate on its loop."""
        rows = [entries for loop in self._loops for entries in loop.entries()]
        return rows + [self._coupling(name) for name in self._couplings]

    def bias(self, w: Sequence[Scalar]) -> list[Scalar]:
        """Second rate of every closure residual where the kept rates w do not change."""
        found = [value for loop in self._loops for value in loop.bias(w)]
        return found + [0.0] * len(self._couplings)

    @property
    def _couplings(self) -> list[str]:
        return list(self.closure.structure.flat.couplings)

    def _coupling(self, name: str) -> dict[int, Scalar]:
        """Row of a coupling: its factors are numbers or live parameters."""
        closure = self.closure
        index = {v.name: k for k, v in enumerate(closure.structure.variables)}
        row: dict[int, Scalar] = {}
        for joint, factor in closure.structure.flat.couplings[name].terms.items():
            form, value = self.C[index[joint]], scalar(factor, closure.values)
            for k in np.flatnonzero(form).tolist():
                row[k] = known(al.add(row.get(k, 0.0), al.mul(value, float(form[k]))))
        return row

    def _evaluated(self, vectors: list[Vector]) -> Array:
        """Vectors at every sample, (samples, vectors, 3)."""
        flat = [component for vector in vectors for component in vector]
        numbers = evaluated(self.closure, self.samples, flat)
        return numbers.reshape(len(numbers), len(vectors), 3)


class _Loop:
    """One closing with the ways to its two frames."""

    def __init__(self, closure: Closure, closing: Closing, rates: ClosingRates) -> None:
        to_a, to_b = closure.structure.loop(*closing.bodies)
        at_a, at_b = (transform(frame, closure.values, closure.nominal) for frame in closing.frames)
        self.a = rates.motion(Way(closure, to_a, at_a))
        self.b = rates.motion(Way(closure, to_b, at_b))
        self.poses = SX(casadi.vertcat(_flat(self.a.way.pose), _flat(self.b.way.pose)))
        self.symbols = SX.sym("frames", 24)
        self.rows = SX(casadi.vertcat(*[row.residual for row in self._rows(closure, closing)]))

    def _rows(self, closure: Closure, closing: Closing) -> list[Row]:
        a, b = _transform(self.symbols[:12]), _transform(self.symbols[12:])
        planar = closure.structure.mechanism.motion == "planar"
        if planar:  # rows ask which axis is the normal, and what is out of plane does not move
            a, b = _in_plane(a, self.a.way.rotation), _in_plane(b, self.b.way.rotation)
        if closing.kind == "joint":
            kind = TYPES[closing.type]
            rows = kind.planar_rows if planar else kind.rows
            return rows(a, b, closure.dimensions(closing))
        constraint = CONSTRAINTS[closing.type]
        return (constraint.planar_rows if planar else constraint.rows)(a, b)

    def entries(self) -> list[dict[int, Scalar]]:
        """Entries by row: power of the row's forces and moments with the screws of each rate."""
        slope = casadi.Function(
            "slope",
            [self.symbols, self.closure_parameters],
            [casadi.jacobian(self.rows, self.symbols)],
        )(self.poses, self.closure_parameters)
        found: list[dict[int, Scalar]] = []
        for i in range(self.rows.numel()):
            row: dict[int, Scalar] = {}
            for motion, start in ((self.a, 0), (self.b, 12)):
                values = [known(slope[i, start + k]) for k in range(12)]
                self._powers(row, motion, values)
            found.append(row)
        return found

    @property
    def closure_parameters(self) -> SX:
        """Symbols besides the frames that rows may hold: live dimensions of a joint."""
        return self.a.way.closure.p

    @staticmethod
    def _powers(row: dict[int, Scalar], motion: Motion, slope: list[Scalar]) -> None:
        """Add what the motion of one frame makes of a row with these slopes."""
        force = (slope[0], slope[1], slope[2])
        moment = al.ZERO
        for k in range(3):
            along = (slope[3 + k], slope[6 + k], slope[9 + k])
            moment = al.plus(moment, al.cross(al.column(motion.way.rotation, k), along))
        terms = motion.terms()
        for wrench, pairs in ((force, terms.linear), (moment, terms.angular)):
            for form, vector in pairs:
                power = al.dot(wrench, vector)
                for k in np.flatnonzero(form).tolist():
                    row[k] = known(al.add(row.get(k, 0.0), al.mul(float(form[k]), power)))

    def bias(self, w: Sequence[Scalar]) -> list[Scalar]:
        """Second rates of the rows where the kept rates w are constant."""
        x, p = self.symbols, self.closure_parameters
        first, second = SX.sym("first", 24), SX.sym("second", 24)
        slope = casadi.jtimes(self.rows, x, first)
        change = casadi.jtimes(slope, x, first) + casadi.jtimes(self.rows, x, second)
        ways = [(motion, motion.state(w)) for motion in (self.a, self.b)]
        rates = casadi.vertcat(*[_rate(motion.way.rotation, state) for motion, state in ways])
        biases = casadi.vertcat(*[_bias(motion.way.rotation, state) for motion, state in ways])
        function = casadi.Function("bias", [x, first, second, p], [change])
        column = function(self.poses, rates, biases, p)
        return [known(column[k]) for k in range(self.rows.numel())]


def _flat(T: Transform) -> SX:
    R, p = T
    return SX(casadi.vertcat(*p, *R[0], *R[1], *R[2]))


def _transform(x: SX) -> Transform:
    s = [x[k] for k in range(12)]
    return ((s[3], s[4], s[5]), (s[6], s[7], s[8]), (s[9], s[10], s[11])), (s[0], s[1], s[2])


def _in_plane(T: Transform, R: al.Matrix) -> Transform:
    """T with the numbers that its axes have along the normal of the plane."""
    normal = tuple(x if al.is_number(x) else s for x, s in zip(R[2], T[0][2], strict=True))
    return (T[0][0], T[0][1], normal), T[1]


def _rate(R: al.Matrix, state: State) -> SX:
    """(ṗ, Ṙ) with Ṙ = ω × R."""
    return _flat((_turned(state.angular, R), state.linear))


def _bias(R: al.Matrix, state: State) -> SX:
    """(p̈, R̈) with R̈ = ω̇ × R + ω × (ω × R)."""
    once, twice = _turned(state.angular_bias, R), _turned(state.angular, _turned(state.angular, R))
    both = tuple(al.plus(a, b) for a, b in zip(once, twice, strict=True))
    return _flat((both, state.linear_bias))  # type: ignore[arg-type]


def _turned(w: Vector, R: al.Matrix) -> al.Matrix:
    x, y, z = (al.cross(w, al.column(R, k)) for k in range(3))
    return al.from_columns(x, y, z)
