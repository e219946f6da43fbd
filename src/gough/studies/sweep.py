"""Smallest singular values of A and B over a slice of the operational space."""

from __future__ import annotations

import heapq
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gough.analysis import elimination
from gough.analysis.analysis import Analysis
from gough.analysis.ranks import Linearisation, linearise, null_space, singular_values
from gough.assembly import Assembler
from gough.robot import Robot
from gough.studies.follow import Follower
from gough.topology import Structure

Array = NDArray[np.float64]
Cell = tuple[int, ...]

SPAN = {"m": 1.0, "rad": 1.5}
"""Largest displacement from home to either side: characteristic lengths, rad."""
LOOKS = 3
"""Coarse sweeps that cut the span down to what is reached."""
COARSE = 9
TRIES = 3
"""Neighbours that a point is tried from."""
CURVE_POINTS = 8
"""A curve has this many times the points of one side of a map."""
TELL_EVERY = 50


@dataclass(frozen=True)
class Axis:
    """One coordinate that is varied."""

    name: str
    unit: str
    variable: int
    """Index of its variable."""
    offset: float
    """Its position at home, which displacements add to; 0 if they are turns from home."""
    displacements: Array
    """From home, in equal steps, 0 among them, (n,)."""

    @property
    def home(self) -> int:
        """Index of the start configuration."""
        return int(np.argmin(np.abs(self.displacements)))

    @property
    def values(self) -> Array:
        """Positions, (n,), rad or m."""
        return self.offset + self.displacements

    @property
    def label(self) -> str:
        """Name and unit, to write beside an axis."""
        return f"{self.name} ({self.unit})"


@dataclass(frozen=True)
class Sweep:
    """Values over a grid of one or two coordinates, the second along the rows."""

    axes: tuple[Axis, ...]
    held: tuple[str, ...]
    """Variables that keep their value at home."""
    following: tuple[str, ...]
    """Outputs that can not be held beside those and follow them."""
    reached: NDArray[np.bool_]
    """Whether the assembly of home reaches a point, (n,) or (rows, columns)."""
    sigma_a: Array | None
    """Smallest singular value of the generic rank of A = OᵀM, scaled; NaN out of reach; None if
    that rank is 0."""
    sigma_b: Array | None
    """The same of B = OᵀK."""

    @property
    def home(self) -> Cell:
        """Index of the start configuration."""
        return tuple(axis.home for axis in self.axes[::-1])


def sweep(
    robot: Robot, analysis: Analysis, points: int, progress: Callable[[str], None]
) -> Sweep | str:
    """Smallest singular values around home, or a sentence that says why there are none.

    The first two operational translations are varied, without two the first two operational
    coordinates, and with one it alone. The other outputs are held, and motors beyond those that
    the outputs need.

    Args:
        robot: the robot.
        analysis: at its home configuration.
        points: along each of two coordinates.
        progress: told how far it is.
    """
    structure = robot.structure
    if not structure.columns("operational"):
        return "There is no sweep: the mechanism has no operational coordinates."
    choice = _Choice(robot.assembler, robot.home.q, analysis)
    if not choice.varied:
        return "There is no sweep: no operational coordinate can move."
    if not choice.rank_A and not choice.rank_B:
        return "There is no sweep: no equation relates motors and outputs."
    progress("sweep: looking for what is in reach")
    spans = _spans(choice)
    for _ in range(LOOKS):
        walk = _Walk(choice, _axes(choice, spans, COARSE))
        walk.run(lambda done, total: None)
        smaller = [_smaller(span, k, walk) for k, span in enumerate(spans)]
        if smaller == spans:
            break
        spans = smaller
    count = points if len(spans) == 2 else CURVE_POINTS * points
    walk = _Walk(choice, _axes(choice, spans, count))
    walk.run(lambda done, total: progress(f"sweep: {done} of {total} points"))
    return walk.result(choice.names(choice.kept), choice.names(choice.following))


class _Choice:
    """Which variables are varied, which are held."""

    def __init__(self, assembler: Assembler, home: Array, analysis: Analysis) -> None:
        self.assembler, self.home = assembler, home
        self.structure = assembler.models.structure
        generic, q = analysis.generic.ranks, self._elsewhere(analysis.seed)
        self.rank_A, self.rank_B = generic.MN - generic.N, generic.NK - generic.N
        outputs = self._in_order()
        E, threshold = assembler.scaled_jacobian(q), linearise(assembler, q).threshold
        tangents = null_space(E, threshold)
        free = self._independent(tangents, outputs)
        self.varied, self.kept = free[:2], free[2:]
        self.following = [k for k in outputs if k not in free]
        motors = self.structure.columns("actuated")
        self.kept += self._independent(tangents, motors, free)
        self.rank_free = self._rank(np.delete(E, self.varied + self.kept, axis=1), threshold)

    def names(self, variables: list[int]) -> tuple[str, ...]:
        """Names of some variables."""
        return tuple(short_name(self.structure, k) for k in variables)

    def _elsewhere(self, seed: int) -> Array:
        """A closed configuration that is generic if there is one: ranks at home may be special."""
        other = self.assembler.wander(self.home, np.random.default_rng(seed))
        return self.home if other is None else other

    def _in_order(self) -> list[int]:
        """The outputs, translations first where there are two or more."""
        outputs = self.structure.columns("operational")
        shifts = [k for k in outputs if self.structure.variables[k].unit == "m"]
        if len(shifts) < 2:
            return outputs
        return shifts + [k for k in outputs if k not in shifts]

    def _independent(
        self, tangents: Array, wanted: list[int], given: list[int] | None = None
    ) -> list[int]:
        """The wanted variables whose rates can be chosen beside each other and the given."""
        given, chosen = list(given or []), list[int]()
        for k in wanted:
            together = tangents[[*given, *chosen, k]]
            if self._rank(together, 1e-7) == len(together):
                chosen.append(k)
        return chosen

    @staticmethod
    def _rank(A: Array, threshold: float) -> int:
        return int(np.sum(singular_values(A) > threshold))


Span = tuple[float, float]
"""How far an axis goes below and above home, both positive."""


def _spans(choice: _Choice) -> list[Span]:
    units = [choice.structure.variables[k].unit for k in choice.varied]
    length = choice.assembler.length
    sides = [SPAN[unit] * (length if unit == "m" else 1.0) for unit in units]
    return [(side, side) for side in sides]


def _smaller(span: Span, axis: int, walk: _Walk) -> Span:
    """The span cut down to one step beyond what was reached, where that is much less."""
    displacements = walk.axes[axis].displacements
    others = tuple(k for k in range(walk.reached.ndim) if k != walk.dimension(axis))
    seen = displacements[walk.reached.any(axis=others)]
    step = float(displacements[1] - displacements[0])
    below, above = step - float(seen.min()), step + float(seen.max())
    return (
        below if below < 0.8 * span[0] else span[0],
        above if above < 0.8 * span[1] else span[1],
    )


def _axes(choice: _Choice, spans: list[Span], count: int) -> tuple[Axis, ...]:
    axes = []
    for variable, (below, above) in zip(choice.varied, spans, strict=True):
        about = choice.structure.variables[variable]
        edge = choice.structure.edges[about.edge]
        # translations stand first in a position, so only turns of a quaternion have no place
        has_place = about.unit == "m" or edge.type.coordinates == edge.type.freedoms
        part = choice.home[choice.assembler.models.closure.slices[about.edge]]
        offset = float(part[about.freedom]) if has_place else 0.0
        name = short_name(choice.structure, variable)
        name = name if has_place else f"turn {name} from home"
        step = (below + above) / (count - 1)
        displacements = step * (np.arange(count, dtype=np.float64) - round(below / step))
        axes.append(Axis(name, about.unit, variable, offset, displacements))
    return tuple(axes)


def short_name(structure: Structure, variable: int) -> str:
    """The name of a variable; of the platform's coordinates the letter alone."""
    about = structure.variables[variable]
    platform = f"{structure.mechanism.platform}."
    name = about.name
    return name.removeprefix(platform) if about.role == "operational" else name


class _Walk:
    """A grid that is closed point by point from home outwards."""

    def __init__(self, choice: _Choice, axes: tuple[Axis, ...]) -> None:
        self.choice, self.axes = choice, axes
        held = choice.varied + choice.kept
        self.follower = Follower(choice.assembler, choice.home, held, choice.rank_free)
        self.shape = tuple(len(axis.displacements) for axis in axes[::-1])
        self.reached = np.zeros(self.shape, dtype=bool)
        self.sigma = np.full((2, *self.shape), np.nan)

    def dimension(self, axis: int) -> int:
        """The dimension of the grid along an axis: the first axis runs along the rows."""
        return len(self.axes) - 1 - axis

    def run(self, tell: Callable[[int, int], None]) -> None:
        """Close what can be reached: nearest to home first, each from a closed neighbour."""
        home: Cell = tuple(axis.home for axis in self.axes[::-1])
        closed: dict[Cell, Array] = {}
        tries: dict[Cell, int] = {}
        todo: list[tuple[int, Cell, Cell]] = [(0, home, home)]
        while todo:
            _, cell, source = heapq.heappop(todo)
            if cell in closed or tries.get(cell, 0) >= TRIES:
                continue
            tries[cell] = tries.get(cell, 0) + 1
            q = self._closed(cell, source, closed)
            if q is None:
                continue
            closed[cell] = q
            self._note(cell, q)
            if len(closed) % TELL_EVERY == 0:
                tell(len(closed), self.reached.size)
            for other in self._neighbours(cell):
                if other not in closed:
                    away = sum((a - b) ** 2 for a, b in zip(other, home, strict=True))
                    heapq.heappush(todo, (away, other, cell))

    def result(self, held: tuple[str, ...], following: tuple[str, ...]) -> Sweep:
        """What was found."""
        ranks = (self.choice.rank_A, self.choice.rank_B)
        A, B = (self.sigma[k] if rank else None for k, rank in enumerate(ranks))
        return Sweep(self.axes, held, following, self.reached, A, B)

    def _closed(self, cell: Cell, source: Cell, closed: dict[Cell, Array]) -> Array | None:
        if not closed:
            return self.choice.home
        return self.follower.move(
            closed[source], self._displacement(source), self._displacement(cell)
        )

    def _displacement(self, cell: Cell) -> Array:
        """Rates held for a unit of time from home to a point, (variables,)."""
        step = np.zeros(len(self.choice.structure.variables))
        for axis, index in zip(self.axes, cell[::-1], strict=True):
            step[axis.variable] = axis.displacements[index]
        return step

    def _neighbours(self, cell: Cell) -> Iterator[Cell]:
        for shift in np.ndindex(*(3,) * len(cell)):
            other = tuple(i + d - 1 for i, d in zip(cell, shift, strict=True))
            inside = all(0 <= i < n for i, n in zip(other, self.shape, strict=True))
            if inside and other != cell:
                yield other

    def _note(self, cell: Cell, q: Array) -> None:
        self.reached[cell] = True
        rates = linearise(self.choice.assembler, q)
        for k, value in enumerate(smallest(rates, self.choice.rank_A, self.choice.rank_B)):
            self.sigma[(k, *cell)] = value


def smallest(rates: Linearisation, rank_A: int, rank_B: int) -> tuple[float, float]:
    """The singular values of A = OᵀM and B = OᵀK that vanish first; NaN for a rank of 0.

    Args:
        rates: the rates at one configuration, scaled.
        rank_A, rank_B: generic ranks: the values numbered so, from the largest, are taken, since
            those behind them are zero everywhere.
    """
    O_T = elimination.by_svd(rates).T
    return _numbered(O_T @ rates.M, rank_A), _numbered(O_T @ rates.K, rank_B)


def _numbered(A: Array, rank: int) -> float:
    s = singular_values(A)
    if not rank:
        return float("nan")
    return float(s[rank - 1]) if len(s) >= rank else 0.0
