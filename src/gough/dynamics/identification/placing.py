"""From series of coordinates to motions of a mechanism, in platform space or in joint space."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gough.dynamics.identification.regressor import Regressor, States
from gough.dynamics.identification.series import turned
from gough.errors import ConfigurationError, SingularError
from gough.numerics.newton import Ending

Array = NDArray[np.float64]

STEPS = 8
"""Parts of the way from the centre to the first row of a motion in joint space."""
JUMP = 0.5
"""Change of a passive joint between two rows, over that of the motion, rad or characteristic
lengths, above which the assembly may have changed; a guess."""


@dataclass(frozen=True)
class Motion:
    """Rows of a motion as a user gives them, and as the regressor takes them."""

    x: Array
    xd: Array
    xdd: Array
    states: States | None
    """None where some rows are out of reach."""
    missed: float
    """The part of the rows that is out of reach."""


class Placing(ABC):
    """Coordinates that a series can move freely.

    Attributes:
        names: of the coordinates; a pose has rx, ry and rz, the rotation vector from its centre.
        units: m or rad.
        centre: what the series is added to, (n,); 0 for a rotation vector.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    centre: Array

    @abstractmethod
    def motion(self, s: Array, sd: Array, sdd: Array) -> Motion:
        """The motion with these coordinates from the centre, (rows, n), rates and accelerations."""


class PlatformPlacing(Placing):
    """Operational coordinates: as they are, or a rotation vector in place of a quaternion."""

    def __init__(self, regressor: Regressor, centre: ArrayLike | None) -> None:
        dynamics = regressor.dynamics
        inverse = dynamics.inverse_geometry
        assert inverse is not None
        self._regressor, coordinates = regressor, inverse.coordinates
        if coordinates.turned:
            raise ConfigurationError(
                f"some rotations of {dynamics.structure.mechanism.platform} are outputs and some "
                "are not, so that rates are no derivatives; use space='joint'"
            )
        given = coordinates.of(dynamics.home) if centre is None else centre
        self.whole = np.asarray(inverse.checked(given))
        if self.whole.ndim != 1:
            raise ConfigurationError("the centre is one set of coordinates")
        outputs = dynamics.structure.columns("operational")
        variables = [dynamics.structure.variables[k] for k in outputs]
        self.names = tuple(v.name for v in variables)
        self.units = tuple(v.unit for v in variables)
        places = [k for k, unit in enumerate(coordinates.units) if unit == "1"]
        self._quaternion = slice(places[0], places[0] + 4) if places else None
        self.centre = self.whole
        if self._quaternion is not None:
            start = self._quaternion.start
            tail = self.whole[start + 4 :]
            self.centre = np.concatenate([self.whole[:start], np.zeros(3), tail])

    def motion(self, s: Array, sd: Array, sdd: Array) -> Motion:
        """The motion with these coordinates, of a pose with its twists."""
        x, xd, xdd = self._operational(s, sd, sdd)
        try:
            return Motion(x, xd, xdd, self._regressor.states(x, xd, xdd), 0.0)
        except SingularError as error:
            return Motion(x, xd, xdd, None, len(error.rows) / len(x))

    def _operational(self, s: Array, sd: Array, sdd: Array) -> tuple[Array, Array, Array]:
        value = self.centre + s
        if self._quaternion is None:
            return value, sd, sdd
        start = self._quaternion.start
        part = slice(start, start + 3)
        q, omega, alpha = turned(
            s[:, part], sd[:, part], sdd[:, part], self.whole[self._quaternion]
        )
        xd, xdd = sd.copy(), sdd.copy()
        xd[:, part], xdd[:, part] = omega, alpha
        return np.hstack([value[:, :start], q, value[:, start + 3 :]]), xd, xdd


class JointPlacing(Placing):
    """Independent joints, each with a position of its own; the others follow from row to row."""

    def __init__(self, regressor: Regressor, centre: ArrayLike | None) -> None:
        self._regressor, dynamics = regressor, regressor.dynamics
        structure, closure = dynamics.structure, dynamics.models.closure
        if structure.mechanism.floating:
            raise ConfigurationError(
                f"{structure.mechanism.name} floats, and nothing holds its base on a chosen path; "
                "give states that were measured"
            )
        self._places = []
        for k in regressor.model.independent:
            variable = structure.variables[k]
            edge = structure.edges[variable.edge]
            if edge.type.coordinates > edge.type.freedoms:
                raise ConfigurationError(f"{variable.name} has no position of its own")
            self._places.append(closure.slices[variable.edge].start + variable.freedom)
        variables = [structure.variables[k] for k in regressor.model.independent]
        self.names = tuple(v.name for v in variables)
        self.units = tuple(v.unit for v in variables)
        self._q = dynamics.home if centre is None else dynamics.state(centre)
        self.centre = self._q[self._places]
        self._held = np.isin(np.arange(len(structure.variables)), regressor.model.independent)

    def motion(self, s: Array, sd: Array, sdd: Array) -> Motion:
        """The motion with these positions, closed row by row."""
        x = self.centre + s
        found = self._followed(x)
        states = States(found, sd, sdd) if len(found) == len(x) else None
        return Motion(x, sd, sdd, states, 1 - len(found) / len(x))

    def _followed(self, x: Array) -> Array:
        """Closed configurations up to the first one that is not reached, (rows, positions)."""
        assembler, q = self._regressor.dynamics.assembler, self._q.copy()
        for share in np.linspace(0, 1, STEPS + 1)[1:-1]:
            q[self._places] = self.centre + share * (x[0] - self.centre)
            q = assembler.close(q, self._held).q
        found: list[Array] = []
        for row in x:
            before = q.copy()
            q = q.copy()
            q[self._places] = row
            solution = assembler.close(q, self._held)
            moved = float(np.abs(row - before[self._places]).max())
            jump = assembler.distance(solution.q, before) > JUMP + 10 * moved
            if solution.ending is not Ending.closed or jump:
                break
            q = solution.q
            found.append(q)
        return np.array(found).reshape(-1, len(self._q))


def placing_of(regressor: Regressor, centre: ArrayLike | None) -> Placing:
    """Coordinates that a series can move, in the space of a regressor."""
    kind = PlatformPlacing if regressor.space == "platform" else JointPlacing
    return kind(regressor, centre)
