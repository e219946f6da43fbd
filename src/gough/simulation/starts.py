"""Starts of the rows of an ensemble: each is closed with the parameters of its own."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property

import casadi
import numpy as np
from numpy.typing import NDArray

from gough.assembly import Assembler
from gough.description import Frame
from gough.description.frames import transform
from gough.dynamics.dynamics import Dynamics
from gough.errors import GoughError
from gough.geometry.coordinates import Coordinates
from gough.geometry.inverse import InverseGeometry
from gough.joints import Free
from gough.joints.quaternion import turned_wxyz, wxyz_from_rotations
from gough.kernels import Kernel
from gough.numerics.newton import Ending
from gough.simulation.factors import Factors
from gough.simulation.formulations import Formulation
from gough.simulation.run import Start
from gough.simulation.simulate import Request

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

AGREES = 1e-9
"""How near to home the described pose has to be to stand for it."""
NEAR = 0.5
"""A joint that moves less than this, in rad and characteristic lengths, to outputs that are given
stays in its mode; a guess. Where one moves more, the inverse geometry that keeps modes is asked."""
MISSED = 1e-9
"""Part of the largest rate that given rates may be missed by."""


class Starts:
    """Where the rows of an ensemble start.

    Args:
        dynamics: of the nominal mechanism.
        request: what all runs have in common.
        nominal: start of the nominal run.
        formulation: that all rows are run in.
        factors: what varies.
        probes: parameters of some rows.
    """

    def __init__(
        self,
        dynamics: Dynamics,
        request: Request,
        nominal: Start,
        formulation: Formulation,
        factors: Factors,
        probes: Array,
    ) -> None:
        self.dynamics, self.request, self.nominal = dynamics, request, nominal
        self.formulation, self.factors, self._probes = formulation, factors, probes
        self.coordinates = Coordinates(dynamics.models, "operational")
        self.columns = dynamics.structure.columns("operational")
        self.x0, self.v0 = self.coordinates.of(nominal.q), nominal.v[self.columns]
        self._same = not factors.place("parameter")
        self._moved = bool(factors.place("position") or factors.place("turn"))

    def of(self, values: Array, p: Array) -> tuple[Array, Array, Mask]:
        """Positions and rates of the formulation's states, and which rows close.

        Args:
            values: of the factors, (rows, factors).
            p: live parameters, (rows, parameters).
        """
        if self.formulation.place == "x":
            positions, closed = self._outputs(values, p)
            rates = self._output_rates(values)
            order = [self.columns.index(k) for k in self.formulation.model.independent]
            return positions, rates[:, order], closed
        q, closed = self._configurations(values, p)
        v, possible = self._rates(q, values, p)
        return q, self.formulation.rates(v), closed & possible

    # outputs place the mechanism

    def _outputs(self, values: Array, p: Array) -> tuple[Array, Mask]:
        rows = len(values)
        closed: Mask = np.ones(rows, dtype=bool)
        if self._same or self.request.x0 is not None:
            x = np.tile(self.x0, (rows, 1))
        elif self._home is not None:
            x = self._home(p)
            closed = np.asarray(np.isfinite(x).all(axis=1))
        else:
            q, closed = self._closings(p)
            x = self.coordinates.of(q)
        return self._varied(x, values), closed

    def _varied(self, x: Array, values: Array) -> Array:
        """Outputs with those that vary set, and poses turned."""
        for k, place in self.factors.place("position"):
            x[:, place] = values[:, k]
        turns = self.factors.place("turn")
        if not turns:
            return x
        first = [name.rpartition(".")[2] for name in self.coordinates.names].index("qw")
        quaternion = slice(first, first + 4)
        for row in range(len(x)):  # one by one: numpy's sine may depend on who stands beside
            phi = [0.0] * 3
            for k, axis in turns:
                phi[axis] = float(values[row, k])
            x[row, quaternion] = turned_wxyz(x[row, quaternion].tolist(), phi)
        return x

    def _output_rates(self, values: Array) -> Array:
        rates = np.tile(self.v0, (len(values), 1))
        for k, place in self.factors.place("rate"):
            rates[:, place] = values[:, k]
        return rates

    @cached_property
    def _home(self) -> Callable[[Array], Array] | None:
        """The described pose of the platform for live parameters, where home is that pose."""
        described = self._described()
        if described is None or self.request.q0 is not None:
            return None
        p = np.concatenate([self.dynamics.assembler.p[None], self._probes])
        q, closed = self._closings(p)
        found = described(p)
        same = np.allclose(found, self.coordinates.of(q), rtol=0, atol=AGREES)
        return described if bool(closed.all()) and same else None

    def _described(self) -> Callable[[Array], Array] | None:
        closure, structure = self.dynamics.models.closure, self.dynamics.structure
        edges = {structure.variables[k].edge for k in self.columns}
        if len(self.x0) != 7 or len(self.columns) != 6 or len(edges) != 1:
            return None
        edge = structure.edges[edges.pop()]
        if not isinstance(edge.home, Frame) or not isinstance(edge.type, Free):
            return None
        R, p = transform(edge.home, closure.values, closure.nominal)
        numbers = [*p, *(x for row in R for x in row)]
        column = casadi.vertcat(*[casadi.SX(x) for x in numbers])
        kernel = Kernel("home", {"p": closure.p}, column, (12,))

        def placed(parameters: Array) -> Array:
            found = kernel(parameters, threads=1)
            turns = wxyz_from_rotations(found[:, 3:].reshape(-1, 3, 3))
            return np.concatenate([found[:, :3], turns], axis=1)

        return placed

    # configurations

    def _closings(self, p: Array) -> tuple[Array, Mask]:
        """The configuration each row starts from where outputs are not given, one by one."""
        q, closed = np.tile(self.nominal.q, (len(p), 1)), np.ones(len(p), dtype=bool)
        if self._same:
            return q, closed
        for row, parameters in enumerate(p):
            try:
                assembler = Assembler(self.dynamics.models, parameters)
                q[row] = self._closing(assembler)
            except (GoughError, ArithmeticError):  # open, or no value of an expression
                closed[row] = False
        return q, closed

    def _closing(self, assembler: Assembler) -> Array:
        """The home of some parameters, or q0 put onto their closure equations."""
        if self.request.q0 is None:
            return assembler.home().require().q
        found = assembler.close(self.nominal.q)
        if found.ending is not Ending.closed:
            raise ArithmeticError(found.ending.value)
        return found.q

    def _configurations(self, values: Array, p: Array) -> tuple[Array, Mask]:
        if not self._moved and (self._same or self.request.x0 is None):
            return self._closings(p)
        q, closed = np.tile(self.nominal.q, (len(p), 1)), np.ones(len(p), dtype=bool)
        x = np.tile(self.x0, (len(p), 1))
        if not self._same and self.request.x0 is None:
            q, closed = self._closings(p)
            x = self.coordinates.of(q)
        x = self._varied(x, values)
        if self._same:
            assert self.dynamics.inverse_geometry is not None
            reached = self.dynamics.inverse_geometry.solve(x, q, threads=1)
            return reached.q, closed & reached.reached
        for row in np.flatnonzero(closed).tolist():
            try:
                q[row] = self._reached(x[row], q[row], p[row])
            except (GoughError, ArithmeticError):
                closed[row] = False
        return q, closed

    def _reached(self, x: Array, near: Array, p: Array) -> Array:
        """The configuration with some outputs and parameters, in the mode of another.

        Raises:
            ClosureError, ArithmeticError: there is none.
        """
        models = self.dynamics.models
        assembler = Assembler(models, p)
        if not self.coordinates.turned:
            held = np.zeros(len(models.structure.variables), dtype=bool)
            held[self.columns] = True
            found = assembler.close(self.coordinates.put(near, x), held)
            moved = np.abs(found.q - near) / assembler.position_scale
            if found.ending is Ending.closed and moved.max() < NEAR:
                return found.q
        home = assembler.home().require().q
        reached = InverseGeometry(models, assembler, home).solve(x, threads=1)
        if not reached.reached:
            raise ArithmeticError(reached.reasons[0])
        return reached.q

    def _rates(self, q: Array, values: Array, p: Array) -> tuple[Array, Mask]:
        """Rates of all variables for those that are given, and which rows can have them."""
        outputs = bool(self.columns)
        model = self.dynamics.model("platform" if outputs else "joint")
        columns = self.columns if outputs else list(model.independent)
        given = np.tile(self.nominal.v[columns], (len(q), 1))
        for k, place in self.factors.place("rate"):
            given[:, place] = values[:, k]
        if not np.any(given):
            return np.zeros((len(q), len(self.nominal.v))), np.ones(len(q), dtype=bool)
        y = np.zeros((len(q), len(model.independent)))
        for place, k in enumerate(model.independent):
            if k in columns:
                y[:, place] = given[:, columns.index(k)]
        kernel = model.kernel("rates", "q")
        v = np.asarray(kernel(q, *([p] if p.size else []), y, threads=1))
        missed = np.abs(v[:, columns] - given).max(axis=1)
        scale = np.maximum(1.0, np.abs(y).max(axis=1))
        return v, np.isfinite(v).all(axis=1) & (missed <= MISSED * scale)
