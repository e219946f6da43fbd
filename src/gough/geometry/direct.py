"""Direct geometry: operational coordinates for given actuated positions, near a known solution.

Newton's method works on the unknowns that the legs leave: the platform's coordinates where these
are all, else natural coordinates. One kernel makes a whole step, and `numerics.stepping` repeats
it, with two guards that keep a solution on the mode it starts from: the determinant of the step's
equations, which changes its sign at singularities of type 2, and the lengths of the steps, which
have to shrink. Rows that start too far for that are led along the straight line of actuated
positions, in parts that pass both.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
from functools import cached_property

import casadi
import numpy as np
from numpy.typing import ArrayLike, NDArray

from gough.errors import ConfigurationError
from gough.geometry.direct_problem import DirectProblem
from gough.geometry.direct_steps import (
    LONGEST,
    TOLERANCE,
    NaturalNewton,
    Newton,
    PlatformNewton,
    configurations_near,
)
from gough.geometry.inverse import InverseGeometry
from gough.numerics.stepping import ENDINGS as STEP_ENDINGS
from gough.numerics.stepping import StepEnding, Stepper

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
SX = casadi.SX

FINEST = 2.0**-20
"""Least part of the way to the wanted positions that is tried. Where a way passes by a singularity,
parts are as long as what is left to it; through one that it meets steps would be next to nothing,
which the test of their lengths lets pass."""
UNIT = 1e-12
"""How much the square of a quaternion's length may be off 1 to be taken as it is."""
ROUGHLY_UNIT = 1e-6
"""How much a quaternion's length may be off 1 to be made 1."""


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
        q, reached = configurations_near(self.inverse, starts)
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


def _shortest(way: Array, units: list[str]) -> Array:
    """Ways between positions, of angles by less than half a turn."""
    angles = [k for k, unit in enumerate(units) if unit == "rad"]
    way = np.array(way)
    way[:, angles] -= 2 * np.pi * np.round(way[:, angles] / (2 * np.pi))
    return way
