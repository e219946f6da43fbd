"""Closing the loops of a mechanism from a start, and finding other closed configurations."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from gough.description import Frame
from gough.description.frames import transform
from gough.description.values import Values, vector
from gough.errors import ClosureError
from gough.joints import Free
from gough.models import Models
from gough.numerics import newton
from gough.numerics.newton import Ending
from gough.topology import Edge

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

TOLERANCE = 1e-12
"""Largest residual of a closed loop: sines, and lengths over the characteristic length."""
KEPT, GUESS = 1e-9, 0.1
"""Changes up to which a given value is kept, a guessed one near; rad, characteristic lengths."""
WALKS, WALK = 6, 0.2
"""Configurations from which it is told what a motion leaves constant, and how far they are."""
RESTARTS = 6
"""Starts with perturbed passive joints that are tried when the described one does not close."""


@dataclass(frozen=True)
class Assembly:
    """Outcome of closing the loops from one start."""

    q: Array
    """Positions of the joints of the tree."""
    residual: float
    """Largest closure residual, m or sine of an angle."""
    steps: int
    restarts: int
    """Perturbed starts it took beyond the described one."""
    ending: Ending
    worst: str
    """Where the largest residual is: the joint and its loop."""
    moved: tuple[str, ...]
    """Motors and outputs whose described values had to give way."""
    reversed: bool = False
    """Whether the largest gap is that of a joint turned to its reverse side."""

    @property
    def moved_text(self) -> str:
        """What gave way, in words."""
        return (
            "the described home does not close; these were moved from where it puts them: "
            + ", ".join(self.moved)
        )

    def require(self) -> Assembly:
        """Self if every loop is closed.

        Raises:
            ClosureError: a loop is open; the message names the gap, the joint and the loop.
        """
        if self.ending is Ending.closed:
            return self
        if self.reversed:
            raise ClosureError(
                f"does not close: {self.worst} is turned to its reverse side; give its frames or a "
                "home on the other side"
            )
        raise ClosureError(
            f"does not close: the largest gap is {self.residual:.3g} (m, or sine of an angle) at "
            f"{self.worst}; {self.ending.value}"
        )


class Assembler:
    """Closes the loops of one mechanism for given live parameters.

    Attributes:
        values: every parameter as a number, live ones as given.
        start: the described positions of the joints of the tree, neutral where there are none.
        given: which variables have a described position.
        length: the characteristic length, m: root mean square distance of the joints from their
            centroid at the start, 1 if they are all at one point.
    """

    def __init__(self, models: Models, p: Array) -> None:
        self.models, self.p = models, p
        self.values = models.parameter_values(p)
        self.start, self.given = _start(models, self.values)
        self.length = self._characteristic_length()

    # scaled equations

    @cached_property
    def row_scale(self) -> Array:
        """Factor of each row: lengths are divided by the characteristic length.

        A coupling may be written in any unit, a gear as rad or as m, so its factors are brought
        to norm one.
        """
        scale = np.where(self.models.row_is_length, 1 / self.length, 1.0)
        E = self.models.jacobian(self.start, self.p) * self.rate_scale
        for block in self.models.closure.blocks:
            if block.kind == "coupling":
                scale[block.rows] = 1 / (float(np.linalg.norm(E[block.rows])) or 1.0)
        return scale

    @cached_property
    def rate_scale(self) -> Array:
        """What a rate is a multiple of: the characteristic length, or 1 rad."""
        return np.where(self.models.rate_is_length, self.length, 1.0)

    @property
    def position_scale(self) -> Array:
        """What each number of a configuration is a multiple of: the length, or 1."""
        return np.where(self.models.position_is_length, self.length, 1.0)

    def _characteristic_length(self) -> float:
        structure = self.models.structure
        found = self.models.poses(self.start, self.p)
        poses = dict(zip(structure.bodies, found, strict=True)) | {structure.root: np.eye(4)}
        points = []
        for part in structure.flat.links:
            for body, frame in zip(part.bodies, part.frames, strict=True):
                _, origin = transform(frame, self.values)
                if body in poses:
                    points.append((poses[body] @ np.array([*origin, 1.0]))[:3])
        if not points:
            return 1.0
        spread = np.array(points) - np.mean(points, axis=0)
        length = float(np.sqrt(np.mean(np.sum(spread**2, axis=1))))
        return length if length > 1e-12 else 1.0

    def scaled_jacobian(self, q: Array) -> Array:
        """E with lengths divided by the characteristic length, so that its entries compare."""
        E = self.models.jacobian(q, self.p)
        return np.asarray(self.row_scale[:, None] * E * self.rate_scale)

    def close(self, q: Array, held: Mask | None = None, max_steps: int = 120) -> newton.Solution:
        """Close the loops from q.

        Args:
            q: where to start.
            held: whether each variable keeps its value; none does by default.
            max_steps: steps before giving up.
        """
        free = np.ones(len(self.models.structure.variables), dtype=bool)
        if held is not None:
            free &= ~held

        def moved(at: Array, step: Array) -> Array:
            rates = np.zeros(len(free))
            rates[free] = step * self.rate_scale[free]
            return self.models.retract(at, rates)

        return newton.solve(
            self._gaps,
            lambda at: self._gap_slopes(at)[:, free],
            moved,
            q,
            TOLERANCE,
            max_steps,
        )

    def _gaps(self, q: Array) -> Array:
        """Scaled closure residuals, then what tells the reachable side of every closing."""
        closing = self.row_scale * self.models.residual(q, self.p)
        return np.concatenate([closing, self.models.sides(q, self.p)])

    def _gap_slopes(self, q: Array) -> Array:
        sides = self.models.side_jacobian(q, self.p) * self.rate_scale
        return np.vstack([self.scaled_jacobian(q), sides])

    # home

    def home(self, seed: int = 0) -> Assembly:
        """The closed configuration that the described start leads to.

        Given values of outputs and motors are kept where the loops close with them, else those of
        the platform alone, else those of the motors alone; all others only start from theirs.
        If the described start does not close, passive joints without a given value are perturbed
        (seeded).
        """
        rng = np.random.default_rng(seed)
        best: newton.Solution | None = None
        steps = 0
        for restart in range(RESTARTS + 1):
            q = self.start if restart == 0 else self._perturbed(rng)
            for held in self._holds():
                solution = self.close(q, held)
                steps += solution.steps
                if solution.ending is Ending.closed:
                    return self._assembly(solution, steps, restart)
                if best is None or solution.gap < best.gap:
                    best = solution
        assert best is not None
        return self._assembly(best, steps, RESTARTS)

    def _holds(self) -> Iterator[Mask]:
        """Which variables to keep, from the most to none."""
        structure = self.models.structure
        actuated, outputs, pose = (np.zeros(len(self.given), dtype=bool) for _ in range(3))
        actuated[structure.columns("actuated")] = True
        outputs[structure.columns("operational")] = True
        pose[structure.columns("operational")] = structure.platform_is_output
        before = np.zeros(len(self.given), dtype=bool)
        for wish in (actuated | outputs, pose, actuated):
            held = self.given & wish
            if held.any() and not np.array_equal(held, before):
                yield held
            before = held
        yield np.zeros(len(self.given), dtype=bool)

    def _perturbed(self, rng: np.random.Generator) -> Array:
        """The start with passive joints moved, those without a given value far more."""
        step = rng.uniform(-1.0, 1.0, size=len(self.given)) * self.rate_scale
        step *= np.where(self.given, 0.05, 1.0)
        step[self.given & self._promised] = 0.0
        return self.models.retract(self.start, step)

    @cached_property
    def _promised(self) -> Mask:
        """Which variables are motors or outputs."""
        promised = np.zeros(len(self.given), dtype=bool)
        structure = self.models.structure
        promised[structure.columns("actuated") + structure.columns("operational")] = True
        return promised

    def _assembly(self, solution: newton.Solution, steps: int, restarts: int) -> Assembly:
        F = np.abs(self.models.residual(solution.q, self.p))
        gaps = np.abs(self._gaps(solution.q))
        worst = self._place_of(int(np.argmax(gaps))) if gaps.size else ""
        turned = gaps.size > 0 and int(np.argmax(gaps)) >= F.size
        largest = float(F.max(initial=0.0))
        moved, ending = self._given_way(solution.q), solution.ending
        return Assembly(solution.q, largest, steps, restarts, ending, worst, moved, turned)

    def _given_way(self, q: Array) -> tuple[str, ...]:
        """Names of the motors and outputs that are not where the description puts them.

        The home of a joint that is an output often is a guess, so a small change of it counts for
        nothing.
        """
        structure = self.models.structure
        away = np.abs((q - self.start) / self.position_scale)
        lost = []
        for k in sorted(structure.columns("actuated") + structure.columns("operational")):
            variable = structure.variables[k]
            edge, part = structure.edges[variable.edge], self.models.closure.slices[variable.edge]
            shift = away[part]
            single = edge.type.coordinates == edge.type.freedoms or variable.unit == "m"
            change = shift[variable.freedom] if single else shift[-4:].max()
            guess = variable.role == "operational" and not edge.link
            if self.given[k] and change > (GUESS if guess else KEPT):
                lost.append(variable.name)
        return tuple(lost)

    def _place_of(self, gap: int) -> str:
        """The closing that a gap belongs to, and the joints of its loop."""
        closure = self.models.closure
        sides = gap - len(closure.rows)
        if sides >= 0:
            block = next(b for b in closure.blocks if b.name == closure.side_closings[sides])
        else:
            block = next(b for b in closure.blocks if b.rows.start <= gap < b.rows.stop)
        return f"{block.name} (loop of {', '.join(block.joints)})"

    # elsewhere

    def gaps(self, q: Array) -> Array:
        """Largest scaled closure residual of configurations, sides included, (*batch,)."""
        rows = self.row_scale * self.models.residual(q, self.p), self.models.sides(q, self.p)
        largest = np.max(np.abs(np.concatenate(rows, axis=-1)), axis=-1, initial=0.0)
        return np.where(np.isfinite(largest), largest, np.inf)

    def walked(self, q: Array, seed: int = 0) -> Array:
        """A configuration and others near it on the same motion, (rows, positions)."""
        rng = np.random.default_rng(seed)
        found = [self.wander(q, rng, WALK) for _ in range(WALKS)]
        return np.array([q, *(other for other in found if other is not None)])

    def distance(self, q: Array, other: Array) -> float:
        """Largest change of a position between two configurations: rad, characteristic lengths."""
        return float(np.max(np.abs((q - other) / self.position_scale), initial=0.0))

    def wander(self, q: Array, rng: np.random.Generator, reach: float = 0.5) -> Array | None:
        """Another closed configuration of the same assembly, or None if none was found.

        Small random steps along the mechanism's motions, each closed again, so that the walk
        stays on the side it starts from.
        """
        direction = rng.normal(size=len(self.given))
        moved = None
        for _ in range(4):
            step = _tangent(self.scaled_jacobian(q), direction)
            size = float(np.linalg.norm(step))
            if size == 0:
                return moved
            step *= reach / 4 * np.sqrt(len(step)) / max(size, 1e-12)
            step *= min(1.0, 0.25 / float(np.max(np.abs(step))))
            solution = self.close(self.models.retract(q, self.rate_scale * step), max_steps=40)
            if solution.ending is not Ending.closed:
                return moved
            q = moved = solution.q
        return moved


def _tangent(E: Array, direction: Array) -> Array:
    """The part of a direction that the equations allow to first order."""
    if not E.size:
        return direction
    _, s, Vt = np.linalg.svd(E)
    kept = Vt[: int(np.sum(s > 1e-7 * s[0]))]
    return np.asarray(direction - kept.T @ (kept @ direction))


def _start(models: Models, values: Values) -> tuple[Array, Mask]:
    """Described positions, neutral where there are none, and which variables were described."""
    q: list[float] = []
    given: list[bool] = []
    for edge in models.structure.edges:
        q.extend(_position(edge, values))
        given.extend([edge.home is not None] * edge.type.freedoms)
    return np.array(q, dtype=float), np.array(given, dtype=bool)


def _position(edge: Edge, values: Values) -> tuple[float, ...]:
    if edge.home is None:
        return edge.type.neutral()
    if isinstance(edge.home, Frame):
        assert isinstance(edge.type, Free)
        return edge.type.from_pose(transform(edge.home, values))
    return edge.type.position(vector(edge.home, values, *edge.type.written))
