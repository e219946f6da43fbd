"""Configurations with given coordinates by damped Newton steps, in batches."""

from __future__ import annotations

from functools import cached_property

import casadi
import numpy as np
from numpy.typing import NDArray

from gough.assembly import TOLERANCE, Assembler
from gough.geometry.coordinates import Coordinates
from gough.kernels import Kernel
from gough.models import Models
from gough.numerics.batch_newton import BatchSolution, solve_batch

Array = NDArray[np.float64]


class Closing:
    """Closes the loops with some coordinates given.

    The equations are the closure's, scaled, those that tell the reachable side of each closing, and
    coordinate - given value for each coordinate.
    """

    def __init__(self, models: Models, assembler: Assembler, coordinates: Coordinates) -> None:
        self.models, self.assembler, self.coordinates = models, assembler, coordinates

    def solve(
        self, q: Array, x: Array, *, steps: int = 1, threads: int | None = None
    ) -> BatchSolution:
        """Configurations with coordinates x.

        Args:
            q: where to start, (rows, positions).
            x: coordinates, (rows, n).
            steps: how many parts to go the way from q's own coordinates in, each closed.
            threads: see `solve_batch`.
        """
        start = self.coordinates.of(q)
        for k in range(1, steps + 1):
            goal = start + (self._nearest(x, start) - start) * (k / steps)
            solution = self._solved(q, goal, threads)
            q = solution.x
        return solution

    def _nearest(self, x: Array, start: Array) -> Array:
        """Quaternions of the sign nearest to where one starts from."""
        x = np.array(x)
        for first in self._quaternions:
            part = slice(first, first + 4)
            opposed = np.sum(x[:, part] * start[:, part], axis=1, keepdims=True) < 0
            x[:, part] = np.where(opposed, -x[:, part], x[:, part])
        return x

    @cached_property
    def _quaternions(self) -> list[int]:
        names = self.coordinates.names
        return [k for k, name in enumerate(names) if name.rpartition(".")[2] == "qw"]

    def _solved(self, q: Array, goal: Array, threads: int | None) -> BatchSolution:
        p = np.concatenate(
            [np.broadcast_to(self.assembler.p, (len(q), len(self.assembler.p))), goal], axis=1
        )
        residual, jacobian, retraction = self._kernels
        return solve_batch(
            residual.addresses.wide,
            jacobian.addresses.wide,
            q,
            p,
            residual.shape[0],
            TOLERANCE,
            retraction=retraction.addresses.wide,
            row_scale=self._row_scale,
            x_scale=self.assembler.rate_scale,
            threads=threads,
        )

    @cached_property
    def _row_scale(self) -> Array:
        length = self.assembler.length
        own = [1 / length if unit == "m" else 1.0 for unit in self.coordinates.units]
        sides = np.ones(self.models.closure.sides.numel())
        return np.concatenate([self.assembler.row_scale, sides, own])

    @cached_property
    def _kernels(self) -> tuple[Kernel, Kernel, Kernel]:
        closure = self.models.closure
        goal = casadi.SX.sym("goal", len(self.coordinates))
        found = self.coordinates.expression(closure.q)
        rows = casadi.vertcat(closure.residual, closure.sides, found - goal)
        slopes = casadi.jacobian(rows, closure.q) @ closure.position_rates
        step = casadi.SX.sym("step", len(self.models.structure.variables))
        p = casadi.vertcat(closure.p, goal)
        inputs = {"q": closure.q, "p": p}
        return (
            Kernel("closing", inputs, rows, (rows.numel(),)),
            Kernel("closing_slopes", inputs, slopes),
            Kernel(
                "retraction",
                {"q": closure.q, "step": step},
                self._moved(step),
                (closure.q.numel(),),
            ),
        )

    def _moved(self, step: casadi.SX) -> casadi.SX:
        """q + H step with unit quaternions: the retraction to second order."""
        closure = self.models.closure
        moved = closure.q + closure.position_rates @ step
        for edge, part in zip(self.models.structure.edges, closure.slices, strict=True):
            if edge.type.coordinates > edge.type.freedoms:
                tail = slice(part.stop - 4, part.stop)
                moved[tail] = moved[tail] / casadi.norm_2(moved[tail])
        return moved
