"""Inverse geometry: configurations for given operational coordinates, every working mode."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import Enum
from functools import cached_property
from itertools import product
from math import prod
from typing import Any

import casadi
import numpy as np
from numpy.typing import ArrayLike, NDArray

from gough.algebra import Matrix
from gough.assembly import Assembler
from gough.errors import ConfigurationError
from gough.geometry.closing import Closing
from gough.geometry.coordinates import Coordinates, constant_turn
from gough.geometry.placing import Placing
from gough.geometry.problem import Problem
from gough.kernels import Kernel
from gough.models import Models
from gough.symbolic.branches import Branches

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

CLOSED = 1e-9
"""Largest closure residual of a configuration that counts: sines, characteristic lengths."""
PARTS = 8
"""Parts of the way that Newton steps follow to keep a mode; a guess."""
COMES_BACK = 1e-5
"""How near to home a closed form has to lead from home's own outputs; rounding, near singularities
that of square roots."""
MOST_MODES = 4096
"""Branches beyond this many are refused."""


class Reached(Enum):
    """How the inverse problem ended for one pose; the text is what the user reads."""

    reached = "every loop closes"
    out_of_reach = "a leg does not reach the pose"
    impossible = "the mechanism can not take this pose"
    no_direction = "the ends of a leg coincide there, so that its direction is open: a singularity"
    open = "no configuration was found: the pose may be out of reach"


ENDINGS = tuple(Reached)


@dataclass(frozen=True)
class InverseSolution:
    """Configurations for a batch of operational coordinates."""

    q: Array
    """Positions of all joints, (*batch, positions); where not reached, those nearest by a leg's
    measure, or those of ``near``."""
    ending: NDArray[np.int8]
    """The place in `ENDINGS` of each row's, (*batch,)."""
    reasons: tuple[str, ...]
    """What keeps each row of the flattened batch from being reached, "" where it is."""

    @property
    def reached(self) -> Mask:
        """Which rows have a configuration, (*batch,)."""
        return np.asarray(self.ending == 0)


@dataclass(frozen=True)
class WorkingModes:
    """Every configuration of the legs for one pose."""

    robot: str
    q: Array
    """Positions of all joints, (modes, positions)."""
    q_actuated: Array
    """Positions of the actuated joints, (modes, actuated)."""
    signs: NDArray[np.int8]
    """The branch taken by each leg, 1 or -1, (modes, branches)."""
    labels: tuple[str, ...]
    """The leg, joint or body at which each branch splits."""
    names: tuple[str, ...]
    """The actuated positions."""
    near: str
    """The word of the mode that choices are nearest to."""
    short: tuple[str, ...]
    """What legs do not reach, in words; empty where modes exist."""

    def __len__(self) -> int:
        return len(self.q)

    def as_dict(self) -> dict[str, Any]:
        """The content as plain data."""
        return {
            "branches": list(self.labels),
            "modes": self.words(),
            "q_actuated": self.q_actuated.tolist(),
            "q": self.q.tolist(),
        }

    def words(self) -> list[str]:
        """Each mode as a word of + and -, a letter for each branch."""
        return [_word(row) for row in self.signs]

    def __str__(self) -> str:
        plural = "" if len(self) == 1 else "s"
        lines = [f"{len(self)} working mode{plural} of {self.robot}", *self.short]
        if self.labels:
            lines.append("branches: " + ", ".join(self.labels))
        if not len(self):
            return "\n".join(lines)
        width = max(4, len(self.labels))
        cell = max(12, *(len(name) + 2 for name in self.names)) if self.names else 12
        lines.append("mode".ljust(width) + "".join(name.rjust(cell) for name in self.names))
        for word, q in zip(self.words(), self.q_actuated, strict=True):
            cells = "".join(f"{value:+.6f}".rjust(cell) for value in q)
            lines.append(f"{word.ljust(width)}{cells}" + ("  home" if word == self.near else ""))
        return "\n".join(lines)


class InverseGeometry:
    """The inverse problem of one mechanism.

    Where the platform's pose is all that is given, legs are solved one by one, in closed form where
    their equations allow it; otherwise damped Newton steps start from a configuration near by.

    Args:
        models: the mechanism's models.
        assembler: what closes its loops.
        home: a closed configuration, (positions,).

    Attributes:
        coordinates: where the operational coordinates stand in q.

    Raises:
        ConfigurationError: the mechanism has no operational coordinates.
    """

    def __init__(self, models: Models, assembler: Assembler, home: Array) -> None:
        self.models, self.assembler, self.home = models, assembler, home
        self.coordinates = Coordinates(models, "operational")
        if not len(self.coordinates):
            raise ConfigurationError(
                f"{models.structure.mechanism.name} has no operational coordinates; name some "
                "under operational in its description"
            )

    # the problem

    @cached_property
    def problem(self) -> Problem | None:
        """The problem with the platform known, or joints; None if the coordinates leave it open."""
        structure = self.models.structure
        platform = structure.mechanism.platform
        if platform is None:
            known = [e.name for e in structure.edges if e.name in structure.mechanism.operational]
            return self._posed(known, None)
        if not self.coordinates.fix_platform(self.assembler.walked(self.home)):
            return None
        return self._posed(
            [platform], constant_turn(self.models, self.assembler, self.assembler.walked(self.home))
        )

    def _posed(self, known: Sequence[str], turn: Matrix | None) -> Problem | None:
        try:
            return Problem(self.models, self.assembler, self.home, known, turn)
        except ConfigurationError:
            return None

    @cached_property
    def _symbols(self) -> list[casadi.SX]:
        return []

    @cached_property
    def branches(self) -> Branches | None:
        """Closed forms, or None where some equations have none."""
        if self.problem is None:
            return None
        measured = self.problem.natural.measured(self.problem.base_poses)
        found = Branches(self.problem.natural, measured, self._new_signs())
        return None if found.left or self._undetermined(found) else found

    def _undetermined(self, found: Branches) -> bool:
        """Whether unknowns are left that no equation asks for."""
        natural = self.problem.natural if self.problem else None
        assert natural is not None
        known = set(found.values) | {u for family, _ in natural.flips for u in family.pair or ()}
        needed = {u for p in natural.solved.values() for u in p.unknowns}
        return not needed <= known or len(known | natural.solved.keys()) < len(natural.unknowns)

    def _new_signs(self) -> Iterator[casadi.SX]:
        while True:
            self._symbols.append(casadi.SX.sym("sign"))
            yield self._symbols[-1]

    @cached_property
    def closed_form(self) -> bool:
        """Whether every leg is solved in closed form, and home comes back from its outputs."""
        if self.branches is None:
            return False
        x = self.coordinates.of(self.home)[None]
        q, ending, _ = self.in_closed_form(x, self.home[None])
        return bool(ending[0] == 0) and self.assembler.distance(q[0], self.home) < COMES_BACK

    @cached_property
    def kernel(self) -> Kernel:
        """Values of the unknowns, then side, margin, short and long of each branch."""
        assert self.branches is not None
        assert self.problem is not None
        closure = self.models.closure
        values = [self.branches.values[u] for u in self.problem.left]
        for branch in self.branches.branches:
            values += [branch.side, branch.margin]
            values += [0.0 if x is None else x for x in (branch.short, branch.long)]
        signs = casadi.vertcat(*self._symbols) if self._symbols else casadi.SX(0, 1)
        column = casadi.vertcat(*map(casadi.SX, values)) if values else casadi.SX(0, 1)
        inputs = {"q": closure.q, "p": closure.p, "signs": signs}
        return Kernel("inverse_geometry", inputs, column, (len(values),))

    @cached_property
    def placing(self) -> Placing:
        """Places bodies once the unknowns are known."""
        assert self.problem is not None
        return Placing(self.problem)

    # branches

    def signs(self, q: Array) -> NDArray[np.int8]:
        """The branch of each leg that a configuration is on, (branches,)."""
        count = len(self.branches.branches) if self.branches else 0
        signs = np.ones(count)
        for _ in range(count):
            sides = self.parted(self.kernel(q, self.assembler.p, signs))[1][..., 0]
            signs = np.where(sides < 0, -1.0, 1.0)
        return signs.astype(np.int8)

    def parted(self, found: Array) -> tuple[Array, Array]:
        """Unknowns, and (side, margin, short, long) of each branch."""
        assert self.problem is not None
        assert self.branches is not None
        n, count = len(self.problem.left), len(self.branches.branches)
        return found[..., :n], found[..., n:].reshape(*found.shape[:-1], count, 4)

    # solutions

    def solve(
        self, x: ArrayLike, near: ArrayLike | None = None, threads: int | None = None
    ) -> InverseSolution:
        """Configurations on the working mode of another.

        Args:
            x: operational coordinates, (*batch, n).
            near: the configuration whose mode is kept and whose angles are nearest; home by
                default, (positions,) or (*batch, positions).
            threads: see `numerics.batch_newton`.
        """
        x = self.checked(x)
        starts = self._starts(near, x.shape[:-1])
        rows = x.reshape(len(starts), x.shape[-1])
        if self.closed_form:
            q, ending, reasons = self.in_closed_form(rows, starts)
        else:
            q, ending, reasons = self._by_steps(rows, starts, threads)
        return InverseSolution(
            q.reshape(*x.shape[:-1], len(self.home)), ending.reshape(x.shape[:-1]), tuple(reasons)
        )

    def _starts(self, near: ArrayLike | None, batch: tuple[int, ...]) -> Array:
        """A configuration for each row of a batch, (rows, positions)."""
        n = len(self.home)
        try:
            given = self.home if near is None else np.asarray(near, dtype=float)
        except (TypeError, ValueError):
            raise ConfigurationError(f"near is {near!r}, expected joint positions") from None
        try:
            if given.shape[-1:] != (n,) or not np.all(np.isfinite(given)):
                raise ValueError
            starts = np.broadcast_to(given, (*batch, n))
        except ValueError:
            raise ConfigurationError(
                f"near has shape {given.shape}, expected (..., {n}): a configuration, "
                "all joint positions, all finite"
            ) from None
        return np.array(starts.reshape(prod(batch), n))

    def checked(self, x: ArrayLike) -> Array:
        """Operational coordinates as an array, quaternions of length 1."""
        x = self.coordinates.numbers("x", x, self.assembler.length)
        for k, name in enumerate(self.coordinates.names):
            if name.rpartition(".")[2] == "qw":
                x[..., k : k + 4] = _unit_quaternions(x[..., k : k + 4])
        return x

    def in_closed_form(
        self, x: Array, near: Array, signs: Array | None = None
    ) -> tuple[Array, NDArray[np.int8], list[str]]:
        """Configurations, endings and reasons of rows, on the branches of near or on given ones."""
        if signs is None:
            base = near if np.any(near != near[:1]) else near[:1]
            count = len(self.branches.branches) if self.branches else 0
            signs = np.array([self.signs(q) for q in base]).reshape(len(base), count)
        start = self.coordinates.put(near, x)
        signs = np.broadcast_to(signs, (len(x), signs.shape[-1])).astype(float)
        unknowns, parts = self.parted(self.kernel(start, self.assembler.p, signs))
        q = self.placing.configurations(start, unknowns, near)
        reachable = np.all(parts[..., 1] >= 0, axis=-1)
        closed = self.assembler.gaps(q) <= CLOSED
        lost = reachable & ~np.all(np.isfinite(q), axis=1)
        codes = [ENDINGS.index(e) for e in (Reached.out_of_reach, Reached.no_direction)]
        missed = np.where(reachable, ENDINGS.index(Reached.impossible), codes[0])
        ending = np.where(closed, 0, np.where(lost, codes[1], missed)).astype(np.int8)
        q = np.where(np.all(np.isfinite(q), axis=1, keepdims=True), q, near)
        reasons = [
            "" if not e else self._reason(p, ENDINGS[e])
            for e, p in zip(ending.tolist(), parts, strict=True)
        ]
        return q, ending, reasons

    def _reason(self, parts: Array, ending: Reached) -> str:
        """What keeps a pose from being reached."""
        assert self.branches is not None
        texts = []
        for branch, (_, margin, short, long) in zip(self.branches.branches, parts, strict=True):
            if margin >= 0:
                continue
            leg = self.leg_of(branch.source)
            if branch.short is None:
                texts.append(f"{leg} does not reach the pose")
            elif short > 0:
                texts.append(f"{leg} is {_length(short)} too short")
            else:
                texts.append(f"{leg} is {_length(long)} too long")
        return "; ".join(texts) or ending.value

    def leg_of(self, part: str) -> str:
        """The leg that a body or a joint belongs to, else the part itself."""
        legs = self.models.structure.legs
        return next((leg.name for leg in legs if part in leg.bodies + leg.joints), part)

    def _by_steps(
        self, x: Array, near: Array, threads: int | None
    ) -> tuple[Array, NDArray[np.int8], list[str]]:
        solution = self._closing.solve(near, x, steps=PARTS, threads=threads)
        closed = (self.assembler.gaps(solution.x) <= CLOSED) & (solution.gap <= CLOSED)
        ending = np.where(closed, 0, ENDINGS.index(Reached.open)).astype(np.int8)
        return solution.x, ending, ["" if ok else Reached.open.value for ok in closed]

    @cached_property
    def _closing(self) -> Closing:
        return Closing(self.models, self.assembler, self.coordinates)

    def working_modes(self, x: ArrayLike, near: ArrayLike | None = None) -> WorkingModes:
        """Every configuration for one pose, one for each choice of branches.

        Slides that take the length of a leg count with the sign they have at home, and spins and
        half turns of passive joints that move nothing else are those nearest to ``near``.

        Args:
            x: operational coordinates, (n,).
            near: what is nearest to; home by default, (positions,).

        Raises:
            ConfigurationError: not every leg has a closed form.
        """
        if self.branches is None or not self.closed_form:
            raise ConfigurationError(
                f"the legs of {self.models.structure.mechanism.name} have no closed form that is "
                "known here; inverse_geometry follows one working mode"
            )
        start = self._starts(near, ())[0]
        x = self.checked(x)
        if x.ndim != 1:
            raise ConfigurationError(f"x has shape {x.shape}, expected one pose")
        signs = self._choices()
        rows = np.broadcast_to(x, (len(signs), len(x)))
        q, ending, reasons = self.in_closed_form(rows, np.tile(start, (len(signs), 1)), signs)
        kept = (ending == 0) & self._first_of_each(q)
        actuated = Coordinates(self.models, "actuated")
        short = () if kept.any() else tuple(sorted(set(reasons)))
        labels = tuple(self.leg_of(branch.source) for branch in self.branches.branches)
        return WorkingModes(
            self.models.structure.mechanism.name,
            q[kept],
            actuated.of(q[kept]),
            signs[kept].astype(np.int8),
            labels,
            tuple(actuated.names),
            _word(self.signs(start)),
            short,
        )

    def _first_of_each(self, q: Array) -> Mask:
        """Which configurations are none of those before, as where two branches meet."""
        scaled = q / self.assembler.position_scale
        first = np.ones(len(q), dtype=bool)
        for k in range(1, len(q)):
            away = np.max(np.abs(scaled[:k] - scaled[k]), axis=1, initial=0.0)
            first[k] = not np.any(away < 1e-9)
        return first

    def _choices(self) -> Array:
        """A row of signs for each choice of branches."""
        assert self.branches is not None
        count = len(self.branches.branches)
        if 2**count > MOST_MODES:
            raise ConfigurationError(f"there are 2^{count} branches; no more than 4096 are listed")
        return np.array(list(product((1.0, -1.0), repeat=count))).reshape(2**count, count)


def _word(signs: NDArray[np.int8]) -> str:
    """+ and - for each branch."""
    return "".join("+" if sign > 0 else "-" for sign in signs)


def _unit_quaternions(q: Array) -> Array:
    size = np.linalg.norm(q, axis=-1, keepdims=True)
    away = np.abs(size - 1).max(initial=0.0)
    if away > 1e-6:
        raise ConfigurationError(
            f"the length of the quaternion of x is off by {away:.3g}; it must be 1: w, x, y, z "
            "stand last"
        )
    return np.asarray(q / size)


def _length(metres: float) -> str:
    return f"{1e3 * metres:.4g} mm" if metres < 1 else f"{metres:.4g} m"
