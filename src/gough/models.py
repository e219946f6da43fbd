"""The models of one mechanism: expressions joined with kernels, made on demand and kept."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import casadi
import numpy as np
from numpy.typing import NDArray

from gough.algebra import Scalar
from gough.description.values import evaluate_parameters
from gough.errors import ConfigurationError, UnknownName
from gough.kernels import Kernel
from gough.symbolic.closure import Closure, filled
from gough.topology import Structure

Array = NDArray[np.float64]


CLOSURE_MODELS = {
    "residual": "closure equations F(q)",
    "jacobian": "Jacobian E(q) of the closure equations by the rates of the variables",
    "poses": "T_root_body, a 4×4 matrix for each body of the tree",
}
"""What each kernel that is not for search alone computes."""


class Models:
    """Kernels of one structure; every kernel takes positions ``q`` and live parameters ``p``."""

    def __init__(self, structure: Structure) -> None:
        self.structure = structure
        self.closure = Closure(structure)
        self._body_jacobians: dict[str, Kernel] = {}

    @cached_property
    def residual(self) -> Kernel:
        """F(q): (*batch, rows)."""
        rows = self.closure.residual.numel()
        return self._kernel("residual", self.closure.residual, (rows,))

    @cached_property
    def jacobian(self) -> Kernel:
        """E(q) = [M N K], columns in the order of the variables: (*batch, rows, variables)."""
        return self._kernel("jacobian", self.closure.jacobian)

    @cached_property
    def sides(self) -> Kernel:
        """Zero where closings are on their reachable side, up to 2 elsewhere: (*batch, values)."""
        count = self.closure.sides.numel()
        return self._kernel("sides", self.closure.sides, (count,))

    @cached_property
    def side_jacobian(self) -> Kernel:
        """Derivative of ``sides`` by the rates: (*batch, values, variables)."""
        return self._kernel("side_jacobian", self.closure.side_jacobian)

    @cached_property
    def poses(self) -> Kernel:
        """T_root_body as 4×4 matrices in the order of ``structure.bodies``."""
        bodies = self.structure.bodies
        stacked = [_homogeneous(*self.closure.poses[body]) for body in bodies]
        output = casadi.vertcat(*stacked) if stacked else casadi.SX(0, 4)
        return self._kernel("poses", output, (len(bodies), 4, 4))

    def body_jacobian(self, body: str) -> Kernel:
        """Twist of a body (linear at its origin, angular; root axes): (*batch, 6, variables)."""
        if body not in self._body_jacobians:
            output = self.closure.body_jacobian(body)
            self._body_jacobians[body] = self._kernel("body_jacobian", output)
        return self._body_jacobians[body]

    def kernels(self) -> dict[str, Kernel]:
        """The kernels of `CLOSURE_MODELS` that have results, by name."""
        found = {name: getattr(self, name) for name in CLOSURE_MODELS}
        return {name: kernel for name, kernel in found.items() if 0 not in kernel.shape}

    def _kernel(self, name: str, output: casadi.SX, shape: tuple[int, ...] | None = None) -> Kernel:
        return Kernel(name, {"q": self.closure.q, "p": self.closure.p}, output, shape)

    # positions and parameters

    @property
    def positions(self) -> int:
        """How many numbers a configuration q has."""
        return int(self.closure.q.numel())

    def parameters(self, given: dict[str, Any] | None = None) -> Array:
        """The vector p of live parameters, with some of them replaced.

        Raises:
            UnknownName: a given name is no live parameter.
            ConfigurationError: a value has another shape than the parameter.
        """
        given = given or {}
        for name in given:
            if name not in self.closure.live:
                raise UnknownName("live parameter", name, self.closure.live)
        parts = []
        for name, value in self.closure.live.items():
            expected = np.asarray(value, dtype=float)
            new = _numbers(name, given.get(name, value))
            if new.shape != expected.shape:
                raise ConfigurationError(
                    f"parameter {name} has shape {new.shape}, expected {expected.shape}"
                )
            if not np.all(np.isfinite(new)):
                raise ConfigurationError(
                    f"parameter {name} is {given[name]!r}, which is not finite"
                )
            parts.append(new.ravel())
        return np.concatenate(parts) if parts else np.zeros(0)

    def parameter_values(self, p: Array) -> dict[str, Any]:
        """Every parameter as a number or nested tuples of numbers, live ones from p."""
        numbers = iter(p.tolist())
        given = {name: filled(value, numbers) for name, value in self.closure.live.items()}
        return evaluate_parameters(self.structure.flat.parameters, given)

    def retract(self, q: Array, step: Array) -> Array:
        """The configuration reached from q by rates ``step`` held for a unit of time."""
        out, start = np.empty_like(q), 0
        for edge, part in zip(self.structure.edges, self.closure.slices, strict=True):
            rates = step[start : start + edge.type.freedoms]
            out[part] = edge.type.retract(q[part].tolist(), rates.tolist())
            start += edge.type.freedoms
        return out

    @cached_property
    def row_is_length(self) -> Array:
        """1 for each closure row in m, 0 for a direction or an angle."""
        return np.array([float(row.unit == "m") for row in self.closure.rows])

    @cached_property
    def rate_is_length(self) -> Array:
        """1 for each variable in m, 0 for an angle."""
        return np.array([float(v.unit == "m") for v in self.structure.variables])

    @cached_property
    def position_is_length(self) -> Array:
        """1 for each number of a configuration in m, 0 for angles and quaternions."""
        marks: list[float] = []
        for edge in self.structure.edges:
            own = [float(unit == "m") for unit in edge.type.rates]
            # a quaternion stands last and has one number more than rates
            marks += own + [0.0] * (edge.type.coordinates - len(own))
        return np.array(marks)


def _numbers(name: str, value: Any) -> Array:
    try:
        return np.asarray(value, dtype=float)
    except (TypeError, ValueError):
        raise ConfigurationError(f"parameter {name} is {value!r}, expected numbers") from None


def _homogeneous(R: Any, p: tuple[Scalar, ...]) -> casadi.SX:
    rows = [casadi.horzcat(*R[i], p[i]) for i in range(3)]
    matrix: casadi.SX = casadi.vertcat(*rows, casadi.horzcat(0.0, 0.0, 0.0, 1.0))
    return matrix
