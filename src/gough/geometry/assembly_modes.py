"""Assembly modes: every solution of the direct problem, with what is known about the list.

Platforms on six legs have a way of their own (`six_leg_platforms`). All other mechanisms are solved
from a start set that monodromy finds once and the cache on disk keeps (`monodromy`): its solutions
are followed to the coefficients of the wanted actuated positions.
"""

from __future__ import annotations

import io
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gough.assembly import Assembler
from gough.cache import digest, from_environment
from gough.errors import ConfigurationError
from gough.geometry import monodromy
from gough.geometry.coordinates import Coordinates, constant_turn, position_names
from gough.geometry.placing import Placing
from gough.geometry.problem import Problem
from gough.geometry.quadratic_closure import QuadraticClosure
from gough.geometry.six_leg_platforms import SixLegPlatform
from gough.geometry.six_legs import LegEquations, SixLegs
from gough.models import Models
from gough.numerics.certificates import Certificates, Verdict, certify
from gough.numerics.path_tracking import PathEnding, track_carefully

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
Mask = NDArray[np.bool_]

Motion = str
MOTIONS = ("home", "any")
"""Whether a platform that keeps its orientation on home's motion has to keep it in every mode."""

CLOSED = 1e-8
"""Largest closure residual of a mode: sines, characteristic lengths."""
SATISFIED = 1e-7
"""Largest residual, relative, of equations that a complex solution has to satisfy besides."""
NEARLY_REAL = 1e-5
"""Largest imaginary part, relative, of a solution whose real part is tried without proof."""
ALIKE = 1e-7
"""Poses, or positions, that differ by less are one: rad, characteristic lengths."""
SHOWN = 8
"""Joints in the table of a mechanism without outputs."""
SAMPLES = 8
"""Real members of the family of a mechanism that its start set is found in."""


@dataclass(frozen=True, eq=False)
class AssemblyModes:
    """Every assembly mode for some actuated positions."""

    robot: str
    q_actuated: Array
    """The actuated positions, (actuated,)."""
    x: Array
    """Operational coordinates of each mode, (k, n)."""
    poses: Array
    """Poses of the platform, x y z and the quaternion w x y z, (k, 7); (0, 7) without platform."""
    certified: Mask
    """Which modes are proved to exist, real and alone near this solution, (k,)."""
    status: str
    """*certified*: the list is proved complete; *expected*: as many complex solutions were found as
    the count known, or saturated, for this mechanism; *found*: no claim."""
    complex_count: int
    """Distinct finite complex solutions, real ones among them."""
    expected: tuple[int, ...]
    """Complex solutions of general members of the mechanism's family; empty if not known."""
    endings: dict[str, int]
    """Paths by how they ended."""
    notes: tuple[str, ...] = ()
    """What a reader of the list should know."""
    names: tuple[str, ...] = ()
    """The operational coordinates."""
    position_names: tuple[str, ...] = ()
    """The numbers of a configuration."""
    _configurations: Callable[[], Array] = field(default=lambda: np.zeros((0, 0)), repr=False)

    def __len__(self) -> int:
        return len(self.certified)

    @cached_property
    def q(self) -> Array:
        """Positions of all joints in each mode, (k, positions); passive ones nearest to home."""
        return self._configurations()

    def __str__(self) -> str:
        count = f"{self.complex_count} complex solutions"
        if self.expected:
            known = " or ".join(map(str, self.expected))
            count = f"{self.complex_count} of {known} complex solutions"
        plural = "" if len(self) == 1 else "s"
        lines = [f"{len(self)} assembly mode{plural} of {self.robot}, {self.status} ({count})"]
        lines += self._table()
        endings = ", ".join(f"{n} {text}" for text, n in self.endings.items())
        if endings:
            lines.append(f"paths: {endings}")
        return "\n".join([*lines, *self.notes])

    def as_dict(self) -> dict[str, Any]:
        """The content as plain data."""
        return {
            "name": self.robot,
            "q_actuated": self.q_actuated.tolist(),
            "status": self.status,
            "complex_count": self.complex_count,
            "expected": list(self.expected),
            "coordinates": list(self.names),
            "x": self.x.tolist(),
            "poses": self.poses.tolist(),
            "certified": self.certified.tolist(),
            "endings": self.endings,
            "notes": list(self.notes),
        }

    def _table(self) -> list[str]:
        if not len(self):
            return []
        numbers, names = self._columns()
        width = max(11, *(len(name) + 2 for name in names)) if names else 11
        lines = ["   " + "".join(f"{name:>{width}}" for name in names) + "   proved"]
        for k, (row, proved) in enumerate(zip(numbers, self.certified, strict=True)):
            cells = "".join(f"{value + 0.0:+{width}.6f}" for value in row)
            lines.append(f"{k:3d}{cells}   {'yes' if proved else 'no'}")
        return lines

    def _columns(self) -> tuple[Array, tuple[str, ...]]:
        """Outputs, or without them the joints that tell the modes apart."""
        if self.names:
            return self.x, self.names
        if len(self.poses):
            return self.poses, ("x", "y", "z", "qw", "qx", "qy", "qz")
        differs = np.flatnonzero(np.ptp(self.q, axis=0) > 1e-9)[:SHOWN]
        return self.q[:, differs], tuple(self.position_names[k] for k in differs)


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
        ends = _Ends(self, q)
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

    def _notes(self, ends: _Ends, missed: int) -> tuple[str, ...]:
        notes = []
        if missed:
            notes.append(f"{missed} real solutions could not be placed; the list lacks them")
        if ends.ways > 1:
            notes.append(
                f"passive joints fit each mode in {ends.ways} ways; the nearest to home is given"
            )
        if ends.singular:
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
        if ends.surplus:
            notes.append(
                f"{ends.surplus} more solutions fit some of the equations but not all: the "
                "mechanism has redundant ones"
            )
        return tuple(notes)

    def _poses(self, q: Array) -> Array:
        """Poses of the platform in the base, (k, 7)."""
        structure = self.models.structure
        platform = structure.mechanism.platform
        if platform is None:
            return np.zeros((0, 7))
        from gough.joints import Free

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

    def _search(self) -> monodromy.StartSet:
        pattern, samples = self.closure.pattern, self._samples
        family = monodromy.Family(pattern, samples[:-1], self.closure.loose)
        x = self.closure.homogeneous(self.closure.start)
        return monodromy.find_start_set(family, samples[-1], x, np.random.default_rng(0))


class _Ends:
    """Ends of the paths from the start set to some actuated positions, judged.

    Attributes:
        real: the unknowns left, of each real solution, (k, left).
        certified: which of them are proved, (k,).
        surely: which of them certainly are solutions, (k,).
        singular: whether some are only nearly real, or not regular.
        count: finite complex solutions that satisfy every equation, told apart by the platform.
        surplus: those that do not satisfy every equation.
        ways: in how many ways passive joints fit each of them.
        saturated: whether every path of a complete start set ended at a solution of its own.
    """

    def __init__(self, direct: DirectProblem, q: Array) -> None:
        self.direct, self.closure = direct, direct.closure
        c, self.T = self.closure.coefficients(q)
        self.endings: dict[str, int] = {}
        self.blurred = np.zeros((0, 1 + self.closure.n), dtype=complex)
        self.saturated = self.closure.n == 0
        self.expected: tuple[int, ...] = ()
        self.q = q
        x = self._tracked(c) if self.closure.n else np.ones((1, 1), dtype=complex)
        satisfied = self._satisfied(x)
        self.surplus = int(np.sum(~satisfied))
        x = x[satisfied]
        self.count = self._poses(x)
        self.ways = len(x) // self.count if self.count else 1
        if self.ways > 1:
            self.expected = ()
        self._prove(x)

    def _tracked(self, c: Array) -> Complex:
        pattern, start = self.closure.pattern, self.direct.start_set
        paths = track_carefully(pattern, start.coefficients, c.astype(complex), start.x, light=1)
        for ending in PathEnding:
            count = int(paths.ended(ending).sum())
            if count:
                self.endings[ending.name.replace("_", " ")] = count
        x = paths.x[paths.ended(PathEnding.arrived)]
        finite = np.abs(x[:, 0]) > monodromy.FINITE
        regular = monodromy.regular(pattern, c, x) if len(x) else finite
        self._count_ends(finite, regular)
        self.blurred = x[finite & ~regular]
        found = x[finite & regular]
        found = monodromy.distinct(found) if len(found) else found
        self.saturated = start.complete and len(found) == len(start.x)
        if start.complete and not len(self.closure.others):
            self.expected = (len(start.x),)
        return found

    def _poses(self, x: Complex) -> int:
        """How many poses of the platform there are among solutions; all of them without one."""
        poses = self.closure.platform(self.q, x @ self.T.T) if len(x) else None
        if poses is None:
            return len(x)
        poses = poses / np.maximum(np.abs(poses).max(axis=0), 1e-12)
        return len(monodromy.first_of_each(poses))

    def _count_ends(self, finite: Mask, regular: Mask) -> None:
        for name, mask in (("at infinity", ~finite), ("at a singular solution", finite & ~regular)):
            if mask.any():
                self.endings[name] = int(mask.sum())
                self.endings["arrived"] -= int(mask.sum())

    def _satisfied(self, x: Complex) -> Mask:
        """Whether solutions satisfy the equations that were not solved."""
        if not len(x) or not len(self.closure.others):
            return np.ones(len(x), dtype=bool)
        rest = self.closure.residuals(self.q, x / x[:, :1])
        size = np.max(np.abs(x / x[:, :1]) ** 2, axis=1)
        return np.asarray(np.max(np.abs(rest), axis=1) <= SATISFIED * size)

    def _prove(self, x: Complex) -> None:
        """Keep the real solutions, and say which are proved.

        Solutions that are real but for rounding, as near singularities, count by their real part;
        whether loops close there is told later.
        """
        affine = np.asarray(np.concatenate([x, self.blurred]) @ self.T.T, dtype=complex)
        found = self._certificates(affine)
        real, proved = found.real, found.real & found.distinct
        scaled = affine / affine[:, :1]
        size = np.max(np.abs(scaled), axis=1, initial=1.0)
        nearly = np.max(np.abs(scaled.imag), axis=1, initial=0.0) <= NEARLY_REAL * size
        keep = real | (nearly & (found.verdict != Verdict.not_real))
        centres = np.where(real[:, None], found.x, affine)
        values = (centres / np.where(centres[:, :1] == 0, 1, centres[:, :1])).real
        self.real = (values * self.closure.size)[keep][:, 1:]
        self.certified = proved[keep] & (not len(self.closure.others))
        self.surely = real[keep]
        self.singular = bool(np.any(~real[keep]))

    def _certificates(self, affine: Complex) -> Certificates:
        pattern, c, errors = self.closure.proof(self.q)
        return certify(pattern, c, errors, affine)
