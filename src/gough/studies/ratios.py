"""Velocity factors and condition numbers over the first two translations of a robot."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import product
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from gough.errors import ConfigurationError
from gough.geometry.coordinates import Coordinates
from gough.geometry.maps import workspace_map
from gough.geometry.rates import SINGULAR
from gough.robot import Robot

if TYPE_CHECKING:
    import xarray

Array = NDArray[np.float64]

NEAR, WIDE = 1.0, 1.5
"""Largest displacement from home to either side, characteristic lengths; the second for robots that
only translate and whose legs have closed forms, which costs little."""
LOOKS = 3
"""Coarse grids that cut what is mapped down to what is reached."""
COARSE = 9
"""Points along each translation of the grid that finds what is in reach, and where to start."""
ISOTROPIC = 1e-6
"""Largest excess of a condition number over 1 at an isotropic point."""
NOTHING = 1e-7
"""Translations below this times the characteristic length are taken for 0 at such a point."""
HALVINGS = 34
"""Of the step towards an isotropic point; the last is 1e-10 of the first."""
MOST_STEPS = 200
QUATERNION = ("qw", "qx", "qy", "qz")
TURNS = ("rx", "ry", "rz")


@dataclass(frozen=True)
class Output:
    """One operational coordinate."""

    name: str
    unit: str
    home: float

    @property
    def label(self) -> str:
        """Name and unit, to write beside an axis."""
        return f"{self.name} ({self.unit})"


@dataclass(frozen=True)
class Isotropy:
    """Where all velocity factors are equal."""

    place: dict[str, float]
    """The translations."""
    factor: float


@dataclass(frozen=True)
class Ratios:
    """Measures over a plane of two translations."""

    outputs: tuple[Output, ...]
    axes: tuple[Output, Output]
    held: dict[str, float]
    """The other outputs, rad and m."""
    map: xarray.Dataset
    side: Array | None
    """Changes its sign at singularities of type 2, (second, first); None if there is no sign."""
    isotropy: Isotropy | None
    unit: str
    """Of the factors."""
    translational: bool
    """Whether every output is a translation."""

    def factor(self, which: int) -> Array:
        """One of the velocity factors over the plane, ascending, (second, first)."""
        return np.asarray(self.map.velocity_factors.isel(factor=which)).T

    @property
    def conditioning(self) -> Array:
        """The condition number over the plane, (second, first)."""
        return np.asarray(self.map.conditioning).T

    @property
    def best(self) -> float:
        """The smallest condition number of the map."""
        return float(np.nanmin(self.conditioning))

    @property
    def through_home(self) -> bool:
        """Whether home lies in the plane."""
        home = {output.name: output.home for output in self.outputs}
        return all(abs(home[name] - value) < 1e-9 for name, value in self.held.items())

    @property
    def points(self) -> tuple[Array, Array]:
        """Positions of the grid along the two axes."""
        first, second = self.axes
        return np.asarray(self.map[first.name]), np.asarray(self.map[second.name])


def ratios(robot: Robot, points: int, progress: Callable[[str], None]) -> Ratios | str:
    """The map, or a sentence that says why there is none.

    Args:
        robot: the robot.
        points: along each translation.
        progress: told what is going on.
    """
    if not robot.structure.columns("operational"):
        return "There are no velocity factors: the mechanism has no operational coordinates."
    if not robot.structure.columns("actuated"):
        return "There are no velocity factors: the mechanism has no motors."
    try:
        found = outputs(robot)
        translations = [output for output in found if output.unit == "m"]
        if len(translations) < 2:
            return (
                "Velocity factors are mapped over two translations; the outputs of "
                f"{robot.name} have {['none', 'one'][len(translations)]}."
            )
        progress("velocity factors: looking for what is in reach")
        return _Mapping(robot, found, translations).ratios(points, progress)
    except ConfigurationError as error:
        return f"Velocity factors are not mapped: {error}."


def outputs(robot: Robot) -> list[Output]:
    """The operational coordinates at home; of a pose the rotation vector in place of four."""
    known = Coordinates(robot.models, "operational")
    names, units, home = list(known.names), list(known.units), robot.home.x
    if tuple(names[-4:]) == QUATERNION:
        names[-4:], units[-4:] = TURNS, ["rad"] * 3
        home = np.concatenate([home[:-4], _rotation_vector(home[-4:])])
    return [Output(*item) for item in zip(names, units, home.tolist(), strict=True)]


def _rotation_vector(q_wxyz: Array) -> Array:
    size = float(np.linalg.norm(q_wxyz[1:]))
    angle = 2 * np.arctan2(size, q_wxyz[0])
    return q_wxyz[1:] * (angle / size if size > 0 else 2.0)


class _Mapping:
    """What is looked at on the way to a map."""

    def __init__(self, robot: Robot, found: list[Output], translations: list[Output]) -> None:
        self.robot, self.outputs, self.translations = robot, tuple(found), translations
        self.home = {output.name: output.home for output in found}
        self.names = [output.name for output in translations]
        self.translational = len(found) == len(translations)
        self.quick = robot.has_closed_form

    def ratios(self, points: int, progress: Callable[[str], None]) -> Ratios:
        """The map over the plane through the isotropic point, or through home."""
        spans = self._spans()
        isotropy = self._isotropy(spans) if self.translational else None
        held = self.home | (isotropy.place if isotropy else {})
        axes = self.translations[0], self.translations[1]
        count = 2 * points - 1 if self.quick else points
        grid = {output.name: np.linspace(*spans[output.name], count) for output in axes}
        held = {name: value for name, value in held.items() if name not in grid}
        progress("velocity factors: mapping")
        found, side = self._map(held | grid)
        unit = self.robot.kinematics.factor_unit
        return Ratios(self.outputs, axes, held, found, side, isotropy, unit, self.translational)

    def _spans(self) -> dict[str, tuple[float, float]]:
        """How far each translation goes: so many lengths, less where that is not reached."""
        L = (WIDE if self.translational and self.quick else NEAR) * self.robot.assembler.length
        spans = {name: (self.home[name] - L, self.home[name] + L) for name in self.names}
        for _ in range(LOOKS if self.quick else 1):
            grid = {name: np.linspace(*span, COARSE) for name, span in spans.items()}
            places = _mesh(grid)
            reached = self.robot.reach(self._outputs(places)).reached
            for k, name in enumerate(self.names):
                low, high = spans[name]
                step = (high - low) / (COARSE - 1)
                seen = places[reached, k]
                if len(seen):
                    spans[name] = max(low, seen.min() - step), min(high, seen.max() + step)
        return spans

    def _map(self, axes: dict[str, Any]) -> tuple[xarray.Dataset, Array | None]:
        """Factors and condition numbers, and the side of each point, NaN where not regular."""
        seen = []

        def inverse(x: Array) -> tuple[Array, NDArray[np.bool_]]:
            found = self.robot.reach(x)
            seen.append(found.q)
            return found.q, found.reached

        measures = ["velocity_factors", "conditioning"]
        found = workspace_map(self.robot.kinematics, inverse, measures, **axes)
        regular = np.asarray(found.regular)
        side = self._side(seen[0][regular.ravel()]) if regular.any() else None
        if side is None:
            return found, None
        values = np.full(regular.shape, np.nan)
        values[regular] = side
        return found, values.T

    def _side(self, q: Array) -> Array | None:
        """det J⁻¹ over that of home: 0 at singularities of type 2, None where J is not square."""
        kinematics = self.robot.kinematics
        found = kinematics.from_operational
        there, here = (kinematics.inverse_jacobian(at) for at in (q, self.robot.home.q))
        if here.shape[0] != here.shape[1] or found.restricted or not found.unique:
            return None
        at_home = float(np.linalg.det(here))
        return np.asarray(np.linalg.det(there) / at_home) if at_home else None

    # isotropic points

    def _isotropy(self, spans: dict[str, tuple[float, float]]) -> Isotropy | None:
        """An isotropic point on home's side of the singularities of type 2, if one is found.

        The variance of the logarithms of the factors is smooth where they meet, unlike their ratio;
        a pattern of points around the best is moved, or made smaller where none is better.
        """
        places = _mesh({name: np.linspace(*span, COARSE) for name, span in spans.items()})
        places = np.vstack([[self.home[name] for name in self.names], places])
        values = self._variance(places)
        values[np.abs(values) < 1e-12] = 0.0  # so that home comes first where all are isotropic
        if not np.isfinite(values).any():
            return None
        here, best = places[np.argmin(values)], float(values.min())
        step = max(b - a for a, b in spans.values()) / (COARSE - 1)
        pattern = np.array(list(product((-1.0, 0.0, 1.0), repeat=len(self.names))))
        halvings = 0
        for _ in range(MOST_STEPS):
            around = here + step * pattern
            values = self._variance(around)
            if values.min() < best:
                here, best = around[np.argmin(values)], float(values.min())
                continue
            step, halvings = step / 2, halvings + 1
            if halvings == HALVINGS:
                break
        return self._at(here)

    def _at(self, place: Array) -> Isotropy | None:
        x = self._outputs(place[None])
        found = self.robot.reach(x)
        factors = self.robot.kinematics.velocity_factors(found.q)[0]
        if not factors[-1] <= (1 + ISOTROPIC) * factors[0]:
            return None
        rounded = np.where(np.abs(place) < NOTHING * self.robot.assembler.length, 0.0, place)
        return Isotropy(dict(zip(self.names, rounded.tolist(), strict=True)), float(factors[0]))

    def _variance(self, places: Array) -> Array:
        """Variance of the logarithms of the factors, infinite where there are none."""
        kinematics = self.robot.kinematics
        found = self.robot.reach(self._outputs(places))
        values = np.full(len(places), np.inf)
        good = np.flatnonzero(found.reached)
        if good.size:
            good = good[kinematics.regularity(found.q[good]) >= SINGULAR]
        if good.size:
            factors = kinematics.velocity_factors(found.q[good])
            with np.errstate(divide="ignore", invalid="ignore"):
                spread = np.var(np.log(factors), axis=-1)
            side = self._side(found.q[good])
            usable = np.isfinite(spread) & (side > 0 if side is not None else True)
            values[good] = np.where(usable, spread, np.inf)
        return values

    def _outputs(self, places: Array) -> Array:
        """Operational coordinates with these translations and all else as at home."""
        x = np.tile(self.robot.home.x, (len(places), 1))
        known = Coordinates(self.robot.models, "operational").names
        x[:, [known.index(name) for name in self.names]] = places
        return x


def _mesh(grid: dict[str, Array]) -> Array:
    """Every point of a grid, the last axis fastest, (points, axes)."""
    axes = np.meshgrid(*grid.values(), indexing="ij")
    return np.stack([axis.ravel() for axis in axes], axis=-1)
