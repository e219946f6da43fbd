"""The direct problem: every assembly mode for given actuated positions.

Platforms on six legs have a way of their own (`six_leg_platforms`). All other mechanisms are solved
from a start set that monodromy finds once and the cache on disk keeps (`monodromy`): its solutions
are followed to the coefficients of the wanted actuated positions (`complex_solutions`).
"""

from __future__ import annotations

import io
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gough.assembly import Assembler
from gough.cache import digest, from_environment
from gough.errors import ConfigurationError
from gough.geometry import monodromy
from gough.geometry.assembly_modes import AssemblyModes
from gough.geometry.complex_solutions import Solutions
from gough.geometry.coordinates import Coordinates, constant_turn, position_names
from gough.geometry.placing import Placing
from gough.geometry.problem import Problem
from gough.geometry.quadratic_closure import QuadraticClosure
from gough.geometry.six_leg_platforms import SixLegPlatform
from gough.geometry.six_legs import LegEquations, SixLegs
from gough.joints import Free
from gough.models import Models

Array = NDArray[np.float64]

Motion = str
MOTIONS = ("home", "any")
"""Whether a platform that keeps its orientation on home's motion has to keep it in every mode."""

CLOSED = 1e-8
"""Largest closure residual of a mode: sines, characteristic lengths."""
ALIKE = 1e-7
"""Poses, or positions, that differ by less are one: rad, characteristic lengths."""
SAMPLES = 8
"""Real members of the family of a mechanism that its start set is found in."""


class DirectProblem:
    """Assembly modes of one mechanism.

    Args:
        models: the mechanism's models.
        assembler: what closes its loops.
        home: a closed configuration, (positions,).
        motion: "home" for modes in which a platform that only translates at home has home's
            orientation too, "any" for all.

    Raises:
        ConfigurationError: the equations are no polynomials, or the actuated joints leave freedoms.
    """

    def __init__(
        self, models: Models, assembler: Assembler, home: Array, motion: Motion = "home"
    ) -> None:
        if motion not in MOTIONS:
            raise ConfigurationError(f"motion is {motion!r}, expected one of {', '.join(MOTIONS)}")
        self.models, self.assembler, self.home, self.motion = models, assembler, home, motion
        self.actuated = Coordinates(models, "actuated")
        self.operational = Coordinates(models, "operational")
        known = [edge.name for edge in models.structure.edges if edge.actuated]
        turn = (
            constant_turn(models, assembler, assembler.walked(home)) if motion == "home" else None
        )
        self.turn = turn
        self.problem = Problem(models, assembler, home, known, turn)
        self.closure = QuadraticClosure(self.problem)
        self.placing = Placing(self.problem)
        self._platforms: dict[bytes, SixLegPlatform] = {}
        self._position_names = position_names(models)

    # solutions

    def modes(self, q_actuated: ArrayLike) -> AssemblyModes:
        """All assembly modes.

        Args:
            q_actuated: positions of the actuated joints, (actuated,), rad and m.

        Raises:
            ConfigurationError: it has another shape, or numbers that are not finite.
        """
        given = self.checked(q_actuated)
        q = self.actuated.put(self.home, given)
        if self.legs is not None:
            return self._of_six_legs(given, q, self.legs.at(q))
        return self._of_any(given, q)

    @cached_property
    def legs(self) -> LegEquations | None:
        """The legs of a platform on six legs, None for other mechanisms."""
        return LegEquations.of(self.problem, self.closure)

    def checked(self, q_actuated: ArrayLike) -> Array:
        """The actuated positions as an array."""
        return self.actuated.numbers("q_actuated", q_actuated, self.assembler.length, batch=False)

    # six legs

    def _of_six_legs(self, given: Array, q: Array, legs: SixLegs) -> AssemblyModes:
        platform = self._platform(legs)
        found = platform.modes(legs.lengths)
        poses = found.poses
        x = poses if self._outputs_are_pose else self.operational.of(self._posed(q, poses))
        notes = (found.completeness.value,) if not found.complex_count else ()

        def configurations() -> Array:
            rows = self._posed(q, poses)
            left = self.problem.measured(rows, self.assembler.p)[:, self.problem.left]
            return self.placing.configurations(rows, left, self.home)

        return AssemblyModes(
            self.models.structure.mechanism.name,
            given,
            x,
            poses,
            found.certified,
            found.completeness.name if found.completeness.name != "dependent" else "found",
            found.complex_count,
            found.expected,
            found.endings,
            notes,
            tuple(self.operational.names),
            self._position_names,
            configurations,
        )

    def _platform(self, legs: SixLegs) -> SixLegPlatform:
        """The platform on these points, kept so that new lengths use its own start set."""
        key = legs.base.tobytes() + legs.platform.tobytes()
        if key not in self._platforms:
            self._platforms.clear()
            self._platforms[key] = SixLegPlatform(legs.base, legs.platform)
        return self._platforms[key]

    @cached_property
    def _outputs_are_pose(self) -> bool:
        structure = self.models.structure
        part = self.models.closure.slices[structure.edge_to[str(structure.mechanism.platform)]]
        return self.operational.whole == list(range(part.start, part.stop)) and not (
            self.operational.turned
        )

    def _posed(self, q: Array, poses: Array) -> Array:
        """Configurations with the platform at poses, all else as in q."""
        structure = self.models.structure
        part = self.models.closure.slices[structure.edge_to[str(structure.mechanism.platform)]]
        rows = np.tile(q, (len(poses), 1))
        rows[:, part] = poses
        return rows

    # any mechanism

    def _of_any(self, given: Array, q: Array) -> AssemblyModes:
        ends = Solutions(self, q)
        rows = np.tile(q, (len(ends.real), 1))
        near = self.home
        found = self.placing.configurations(rows, ends.real, near)
        closed = self.assembler.gaps(found) <= CLOSED
        missed = int(np.sum(~closed & ends.surely))
        found, certified = found[closed], ends.certified[closed]
        kept = self._told_apart(found)
        found, certified = found[kept], certified[kept]
        return AssemblyModes(
            self.models.structure.mechanism.name,
            given,
            self.operational.of(found),
            self._poses(found),
            certified,
            "expected" if ends.saturated and not missed else "found",
            ends.count,
            ends.expected,
            ends.endings,
            self._notes(ends, missed),
            tuple(self.operational.names),
            self._position_names,
            lambda: found,
        )

    def _told_apart(self, q: Array) -> list[int]:
        """Configurations of different poses of the platform, or of bodies without one, in order.

        Of those with one pose, that nearest to home. Outputs fall, the first first.
        """
        if not len(q):
            return []
        away = [self.assembler.distance(row, self.home) for row in q]
        poses = self._poses(q)
        keys = poses if len(poses) else q / self.assembler.position_scale
        keys = keys / ([self.assembler.length] * 3 + [1] * 4) if len(poses) else keys
        kept: list[int] = []
        for k in np.argsort(away, kind="stable").tolist():
            if not any(np.max(np.abs(keys[k] - keys[other])) < ALIKE for other in kept):
                kept.append(k)
        order = self._order(q[kept])
        return [kept[k] for k in order]

    def _notes(self, ends: Solutions, missed: int) -> tuple[str, ...]:
        notes = []
        if missed:
            notes.append(f"real solutions that could not be placed, and are not listed: {missed}")
        if ends.ways > 1:
            notes.append(
                f"passive joints fit each mode in {ends.ways} ways; the nearest to home is given"
            )
        if ends.singular and not len(self.closure.others):
            notes.append(
                "some modes may be at a singularity of type 2, where two or more meet: not proved"
            )
        if self.turn is not None:
            notes.append(
                "the platform keeps the orientation of home; motion='any' lists modes in which it "
                "is turned too"
            )
        if self.closure.n and not self.start_set.saturated:
            notes.append(
                f"the search for start solutions was cut short at {len(self.start_set.x)}: there "
                "may be more modes"
            )
        if ends.routes:
            notes.append(
                f"paths were lost: {ends.routes} other routes to all solutions found "
                f"{ends.besides} more; there may be others"
            )
        if ends.surplus:
            notes.append(
                f"solutions that fit some of the equations but not all: {ends.surplus}; the "
                "mechanism has redundant ones"
            )
        return tuple(notes)

    def _poses(self, q: Array) -> Array:
        """Poses of the platform in the base, (k, 7)."""
        structure = self.models.structure
        platform = structure.mechanism.platform
        if platform is None:
            return np.zeros((0, 7))
        poses = self.models.poses(q, self.assembler.p)
        T = poses[:, structure.bodies.index(platform)]
        if structure.mechanism.floating:
            T = np.linalg.inv(poses[:, structure.bodies.index(structure.mechanism.base)]) @ T
        poses = Free().measured(T, {})
        return np.where(poses[:, 3:4] < 0, np.concatenate([poses[:, :3], -poses[:, 3:]], 1), poses)

    def _order(self, q: Array) -> NDArray[np.intp]:
        """Falling outputs, or positions where there are none; the first counts first."""
        keys = self.operational.of(q) if len(self.operational) else q
        rounded = np.round(keys / 1e-9) * 1e-9
        return np.lexsort(-rounded.T[::-1]) if keys.shape[1] else np.arange(len(q))

    # the start set

    @cached_property
    def start_set(self) -> monodromy.StartSet:
        """All solutions of a general member of the mechanism's family, from disk or found anew."""
        disk, key = from_environment(), self._key
        content = disk.get(key)
        if content is not None:
            with np.load(io.BytesIO(content)) as data:
                flags = (bool(data["complete"]), bool(data["saturated"]), int(data["loops"]))
                return monodromy.StartSet(data["coefficients"], data["x"], *flags)
        found = self._search()
        file = io.BytesIO()
        np.savez(file, **vars(found))
        disk.put(key, file.getvalue())
        return found

    @cached_property
    def _samples(self) -> Array:
        """Coefficients for various actuated positions, those of the start last."""
        rng = np.random.default_rng(1)
        scale = self.assembler.rate_scale
        steps = rng.normal(size=(SAMPLES, len(scale))) * 0.3 * scale
        configurations = [self.models.retract(self.home, step) for step in steps]
        found = [*configurations, self.closure.start]
        return np.array([self.closure.coefficients(q)[0] for q in found])

    @property
    def _key(self) -> bytes:
        pattern = self.closure.pattern
        samples = np.round(self._samples, 9) + 0.0
        parts = (pattern.rows, pattern.left, pattern.right, self.closure.loose, samples)
        return digest(*(part.tobytes() for part in parts), "start set 4")

    @cached_property
    def family(self) -> monodromy.Family:
        """What the start set is searched for in."""
        return monodromy.Family(self.closure.pattern, self._samples[:-1], self.closure.loose)

    def _search(self) -> monodromy.StartSet:
        x = self.closure.homogeneous(self.closure.start)
        rng = np.random.default_rng(0)
        return monodromy.find_start_set(self.family, self._samples[-1], x, rng)
