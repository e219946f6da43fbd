"""Motions to follow: positions, rates and accelerations as expressions of time.

A reference is of operational coordinates, or of positions of joints, and says so only when it is
written for a mechanism: `Followed` then tells names, units and where quaternions stand. Rates of a
quaternion are an angular velocity in base axes. Entries of a rotation vector, where some rotations
are outputs but not all six freedoms, have their own derivatives as rates here.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import abc
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal, NamedTuple, Protocol

import casadi
import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import make_interp_spline

from gough import algebra as al
from gough.algebra import Scalar, Vector
from gough.dynamics.dynamics import Dynamics
from gough.dynamics.model import Model
from gough.dynamics.trajectory import ROUNDED, columns_of, motion_of
from gough.errors import ConfigurationError, UnknownName
from gough.formats import trajectory as files
from gough.numerics.integration import signal_values

Array = NDArray[np.float64]
SX = casadi.SX
Of = Literal["outputs", "inputs"] | abc.Sequence[str] | None
"""What a reference is of: operational coordinates, positions of the motors, or joints by name; None
for outputs, and for motors where there are none."""

RESTING = 1e-3
"""Rates at the last row of a table below this part of the largest are rest; a guess: what a spline
through rounded numbers leaves."""
MEETING = 1e-6
"""How far what follows in a sequence may begin from where the one before ended, m and rad."""


# what a reference is of


@dataclass(frozen=True)
class Followed:
    """The coordinates that a reference is of."""

    names: tuple[str, ...]
    """Of the positions; a quaternion has four."""
    units: tuple[str, ...]
    rates: tuple[str, ...]
    """Names of what moves; a quaternion turns about three axes."""
    periodic: tuple[bool, ...]
    """Of the positions: whether whole turns make no difference."""
    home: Array
    """Positions at home."""
    of: Callable[[Array], Array]
    """Positions from configurations, (*batch, positions)."""
    variables: tuple[int, ...]
    """Of the tree, in the order of ``rates``."""
    turned: bool = False
    """Whether several entries of a rotation vector are among them."""

    @property
    def blocks(self) -> Iterator[tuple[slice, slice]]:
        """Positions and rates, number by number and quaternion by quaternion."""
        k = moving = 0
        while k < len(self.names):
            whole = self.names[k].rpartition(".")[2] == "qw" and self.units[k] == "1"
            width, turns = (4, 3) if whole else (1, 1)
            yield slice(k, k + width), slice(moving, moving + turns)
            k, moving = k + width, moving + turns

    def checked(self, name: str, given: Array) -> Array:
        """Positions with quaternions of length 1.

        Raises:
            ConfigurationError: they are not as many as they should be, or a quaternion is none.
        """
        if given.shape != (len(self.names),):
            raise ConfigurationError(
                f"{name} has shape {given.shape}, expected ({len(self.names)},): "
                f"{', '.join(self.names)}"
            )
        found = given.copy()
        for at, _ in self.blocks:
            if at.stop - at.start == 4:
                found[at] = _unit_quaternion(name, found[at])
        return found

    def apart(self, a: Array, b: Array) -> Array:
        """How far positions are from each other, by block: m, or rad the shorter way round."""
        found = []
        for at, _ in self.blocks:
            if at.stop - at.start == 4:
                found.append(2 * np.arccos(min(1.0, abs(float(a[at] @ b[at])))))
                continue
            gap = float(b[at.start] - a[at.start])
            if self.periodic[at.start]:
                gap -= 2 * np.pi * np.round(gap / (2 * np.pi))
            found.append(abs(gap))
        return np.array(found)


def followed(model: Model, of: Of = None) -> Followed:
    """The coordinates of a mechanism that references are of.

    Raises:
        UnknownName: there is no joint of that name.
        ConfigurationError: there are no such coordinates, or a joint has no position of its own.
    """
    structure = model.structure
    outputs = structure.columns("operational")
    if of is None:
        of = "outputs" if outputs else "inputs"
    if of == "outputs":
        return _outputs(model)
    variables = structure.variables
    if of == "inputs":
        chosen = structure.columns("actuated")
        if not chosen:
            raise ConfigurationError(f"{structure.mechanism.name} has no motors")
    else:
        places = {v.name: k for k, v in enumerate(variables)}
        names = [of] if isinstance(of, str) else list(of)
        for name in names:
            if name not in places:
                raise UnknownName("joint variable", name, places)
        chosen = [places[name] for name in names]
    return _joints(model, chosen)


def _outputs(model: Model) -> Followed:
    structure, outputs = model.structure, model.outputs
    columns = structure.columns("operational")
    if not columns:
        raise ConfigurationError(
            f"{structure.mechanism.name} has no outputs; follow its motors: of='inputs'"
        )
    places = {place for place, *_ in outputs.turned}
    plain = [k for k in range(len(outputs)) if k not in places]
    periodic = [k in plain and unit == "rad" for k, unit in enumerate(outputs.units)]
    for k in columns:
        variable = structure.variables[k]
        if "advance" in structure.edges[variable.edge].type.holds:
            own = outputs.whole.index(model.closure.slices[variable.edge].start)
            periodic[own] = False
    return Followed(
        tuple(outputs.names),
        tuple(outputs.units),
        tuple(structure.variables[k].name for k in columns),
        tuple(periodic),
        outputs.of(model.home),
        outputs.of,
        tuple(columns),
        len(places) > 1,
    )


def _joints(model: Model, chosen: abc.Sequence[int]) -> Followed:
    structure, places, periodic = model.structure, [], []
    variables = [structure.variables[k] for k in chosen]
    for variable in variables:
        edge = structure.edges[variable.edge]
        if edge.type.coordinates > edge.type.freedoms:
            raise ConfigurationError(
                f"{variable.name} has no position of its own: a quaternion holds it; follow the "
                "outputs, or other joints"
            )
        places.append(model.closure.slices[variable.edge].start + variable.freedom)
        periodic.append(variable.unit == "rad" and "advance" not in edge.type.holds)
    names = tuple(variable.name for variable in variables)
    units = tuple(str(variable.unit) for variable in variables)
    home = model.home[places]
    return Followed(
        names, units, names, tuple(periodic), home, lambda q: q[..., places], tuple(chosen)
    )


# signals


@dataclass(frozen=True)
class Signals:
    """Piecewise polynomials of time, as `numerics.integration` takes them.

    The first piece begins at the start, the last one goes on for ever.
    """

    names: tuple[str, ...] = ()
    breaks: Array = field(default_factory=lambda: np.zeros(0))
    """Where pieces begin, s, (pieces,)."""
    coefficients: Array = field(default_factory=lambda: np.zeros((0, 0, 6)))
    """Of powers of the time since then, (pieces, signals, 6)."""

    def at(self, times: ArrayLike) -> Array:
        """Values, (times, signals)."""
        return signal_values(self.breaks, self.coefficients, np.atleast_1d(times).astype(float))

    def later(self, delay: float) -> Signals:
        """The same after a delay."""
        return replace(self, breaks=self.breaks + delay)


def joined(parts: abc.Sequence[Signals]) -> Signals:
    """Signals side by side on common pieces."""
    parts = [part for part in parts if len(part.breaks)]
    if not parts:
        return Signals()
    breaks = np.unique(np.concatenate([part.breaks for part in parts]))
    columns = [_rebased(part, breaks) for part in parts]
    names = tuple(name for part in parts for name in part.names)
    return Signals(names, breaks, np.concatenate(columns, axis=1))


def _rebased(part: Signals, breaks: Array) -> Array:
    """Coefficients on finer pieces."""
    piece = np.clip(np.searchsorted(part.breaks, breaks, side="right") - 1, 0, None)
    s = (breaks - part.breaks[piece])[:, None]
    found = part.coefficients[piece].copy()
    # the scheme of Horner gives the coefficients about s one after the other
    for first in range(5):
        for power in reversed(range(first, 5)):
            found[..., power] += s * found[..., power + 1]
    return found


def corners(*times: float) -> Signals:
    """No signal, but moments where something that depends on time is not smooth."""
    breaks = np.unique([min(0.0, *times) - 1.0, *times])
    return Signals((), breaks, np.zeros((len(breaks), 0, 6)))


# references


class Moment(NamedTuple):
    """What a reference asks for at a time."""

    positions: list[Scalar]
    rates: list[Scalar]
    accelerations: list[Scalar]


@dataclass(frozen=True)
class Given:
    """What a reference is written with."""

    t: Scalar
    """Time since the reference begins, s."""
    followed: Followed
    told: Mapping[str, Scalar]
    """Its signals by name."""
    name: str = "reference"
    """Before the names of signals."""

    def part(self, k: int, begins: float) -> Given:
        """For a part of the reference that begins at a time."""
        return replace(self, t=al.sub(self.t, begins), name=f"{self.name}.{k}")


class Reference(ABC):
    """A motion to follow."""

    end: float
    """When it comes to rest for good, s; infinite if it never does."""

    @abstractmethod
    def at(self, given: Given) -> Moment:
        """Positions, rates and accelerations as expressions of time."""

    def signals(self, followed: Followed, name: str = "reference") -> Signals:
        """Functions of time that it is told, and moments where it is not smooth."""
        return Signals()


def evaluated(
    reference: Reference, followed: Followed, times: ArrayLike
) -> tuple[Array, Array, Array]:
    """Positions, rates and accelerations of a reference at some times, (times, ·) each."""
    t = SX.sym("t")
    given = reference.signals(followed)
    symbols = SX.sym("told", len(given.names))
    told = {name: symbols[k] for k, name in enumerate(given.names)}
    moment = reference.at(Given(t, followed, told))
    columns = [casadi.vertcat(*[SX(x) for x in part], SX(0, 1)) for part in moment]
    function = casadi.Function("reference", [t, symbols], columns)
    at = np.atleast_1d(times).astype(float)
    values = given.at(at) if given.names else np.zeros((len(at), 0))
    rows = [[np.array(x).ravel() for x in function(*row)] for row in zip(at, values, strict=True)]
    positions, rates, accelerations = (np.array([row[k] for row in rows]) for k in range(3))
    return positions, rates, accelerations


def require_start(
    reference: Reference,
    followed: Followed,
    positions: Array,
    rates: Array | None = None,
    t: float = 0.0,
    tolerance: float = 1e-6,
) -> None:
    """Raise where a reference begins away from a state.

    Args:
        reference: the motion.
        followed: what it is of.
        positions: of the state, (positions,).
        rates: of the state, (rates,), if they count too.
        t: when the run starts, s.
        tolerance: how far may be, m and rad, and their rates.

    Raises:
        ConfigurationError: how far it is, and in what.
    """
    wanted, moving, _ = evaluated(reference, followed, [t])
    blocks = list(followed.blocks)
    names = [_block_name(followed, at) for at, _ in blocks]
    units = [
        "rad" if followed.units[at.start] == "1" else followed.units[at.start] for at, _ in blocks
    ]
    gaps = followed.apart(positions, wanted[0])
    worst = int(np.argmax(gaps)) if len(gaps) else 0
    if len(gaps) and not gaps[worst] <= tolerance:
        raise ConfigurationError(
            f"the reference begins {gaps[worst]:.4g} {units[worst]} away from the start, in "
            f"{names[worst]}: start the run at {_told(wanted[0])}, or begin the reference at "
            f"{_told(positions)}, or allow more than {tolerance:g}"
        )
    if rates is None:
        return
    off = np.abs(moving[0] - rates)
    worst = int(np.argmax(off)) if len(off) else 0
    if len(off) and not off[worst] <= tolerance:
        raise ConfigurationError(
            f"the reference begins with a rate of {followed.rates[worst]} that is {off[worst]:.4g} "
            f"away from that of the start: start the run with rates {_told(moving[0])}"
        )


def _block_name(followed: Followed, at: slice) -> str:
    name = followed.names[at.start]
    return name if at.stop - at.start == 1 else "orientation"


def _told(values: Array) -> str:
    return "[" + ", ".join(f"{x:.6g}" for x in values) + "]"


# profiles


class Profile(Protocol):
    """How a share of the way grows with a share of the time."""

    def written(self, u: Scalar) -> tuple[Scalar, Scalar, Scalar]:
        """The share s and its derivatives by u; 0 before u = 0, 1 after u = 1."""

    def corners(self) -> tuple[float, ...]:
        """Where it is not smooth, between 0 and 1."""


@dataclass(frozen=True)
class Quintic:
    """s = 10 u³ - 15 u⁴ + 6 u⁵: rates and accelerations are 0 at both ends."""

    def written(self, u: Scalar) -> tuple[Scalar, Scalar, Scalar]:
        """The share of the way and its derivatives."""
        u = al.minimum(al.maximum(u, 0.0), 1.0)
        left = 1.0 - u
        # the second half is written from the end, so that the end is 1 without rounding
        s = casadi.if_else(u < 0.5, _quintic(u), 1.0 - _quintic(left))
        return s, 30.0 * (u * left) ** 2, 60.0 * u * left * (left - u)

    def corners(self) -> tuple[float, ...]:
        """Its ends."""
        return 0.0, 1.0


def _quintic(u: Scalar) -> Scalar:
    return u * u * u * (10.0 + u * (6.0 * u - 15.0))


@dataclass(frozen=True)
class Trapezoid:
    """A rate that grows evenly, stays and falls evenly.

    Args:
        ramp: share of the time in which it grows, and falls; 1/2 leaves no part in between.
    """

    ramp: float = 0.25

    def __post_init__(self) -> None:
        if not 0.0 < self.ramp <= 0.5:
            raise ConfigurationError(
                f"ramp is {self.ramp!r}; it is a share of the time, above 0 and up to 0.5"
            )

    def written(self, u: Scalar) -> tuple[Scalar, Scalar, Scalar]:
        """The share of the way and its derivatives."""
        r, v = self.ramp, 1.0 / (1.0 - self.ramp)
        inside = al.minimum(al.maximum(u, 0.0), 1.0)
        near = al.minimum(inside, 1.0 - inside)
        half = v * (al.minimum(near, r) ** 2 / (2 * r) + al.maximum(near - r, 0.0))
        s = casadi.if_else(inside < 0.5, half, 1.0 - half)
        up = casadi.logic_and(u >= 0.0, u < r)
        down = casadi.logic_and(u >= 1.0 - r, u < 1.0)
        # with r = 1/2 the two meet, and at their edges the later one counts
        slope = casadi.if_else(down, -v / r, casadi.if_else(up, v / r, 0.0))
        return s, (v / r) * al.minimum(near, r), slope

    def corners(self) -> tuple[float, ...]:
        """Where its acceleration jumps."""
        return 0.0, self.ramp, 1.0 - self.ramp, 1.0


PROFILES: dict[str, Profile] = {"quintic": Quintic(), "trapezoid": Trapezoid()}


def _profile(given: str | Profile) -> Profile:
    if not isinstance(given, str):
        return given
    if given not in PROFILES:
        raise UnknownName("profile", given, PROFILES)
    return PROFILES[given]


class _Timed(Reference):
    """A motion that a profile leads through from rest to rest."""

    def __init__(self, duration: float, profile: str | Profile, delay: float) -> None:
        self.duration = _number("duration", duration)
        self.delay = _number("delay", delay)
        if not self.duration > 0:
            raise ConfigurationError(f"duration is {duration!r} s; it must be positive")
        if self.delay < 0:
            raise ConfigurationError(f"delay is {delay!r} s; it can not be negative")
        self.profile = _profile(profile)
        self.end = self.delay + self.duration

    def share(self, t: Scalar) -> tuple[Scalar, Scalar, Scalar]:
        """Share of the way and its derivatives by time."""
        T = self.duration
        s, first, second = self.profile.written((t - self.delay) / T)
        return s, first / T, second / T**2

    def signals(self, followed: Followed, name: str = "reference") -> Signals:
        """The corners of its profile."""
        return corners(*[self.delay + self.duration * u for u in self.profile.corners()])


class Hold(Reference):
    """Rest at a position.

    Args:
        positions: where, in the coordinates of the reference.
        duration: for how long, in a sequence, s.
    """

    def __init__(self, positions: ArrayLike, duration: float = 0.0) -> None:
        self.positions = _row("positions", positions)
        self.end = _number("duration", duration)
        if self.end < 0:
            raise ConfigurationError(f"duration is {duration!r} s; it can not be negative")

    def at(self, given: Given) -> Moment:
        """The position, without rates."""
        still = [0.0] * len(given.followed.rates)
        found = given.followed.checked("positions", self.positions)
        return Moment(found.tolist(), still, list(still))


class PointToPoint(_Timed):
    """From one position to another along a straight line.

    An orientation given by a quaternion turns about the axis, constant in base axes, that leads
    from one to the other the shorter way.

    Args:
        start: positions at the start.
        end: positions at the end.
        duration: of the motion, s.
        profile: "quintic", "trapezoid", or one made from `Quintic` or `Trapezoid`.
        delay: rest before it begins, s.
    """

    def __init__(
        self,
        start: ArrayLike,
        end: ArrayLike,
        duration: float,
        profile: str | Profile = "quintic",
        delay: float = 0.0,
    ) -> None:
        super().__init__(duration, profile, delay)
        self.first, self.last = _row("start", start), _row("end", end)
        if self.first.shape != self.last.shape:
            raise ConfigurationError(
                f"start has {len(self.first)} numbers and end has {len(self.last)}"
            )

    def at(self, given: Given) -> Moment:
        """The point of the line."""
        first = given.followed.checked("start", self.first)
        last = given.followed.checked("end", self.last)
        s, sd, sdd = self.share(given.t)
        moment = Moment([], [], [])
        for at, _ in given.followed.blocks:
            a, b = first[at].tolist(), last[at].tolist()
            if len(a) == 4:
                quaternion, way = _turning(a, b, s)
                moment.positions.extend(quaternion)
            else:
                way = [b[0] - a[0]]
                moment.positions.append(al.add(al.mul(1.0 - s, a[0]), al.mul(s, b[0])))
            moment.rates.extend(al.mul(sd, x) for x in way)
            moment.accelerations.extend(al.mul(sdd, x) for x in way)
        return moment


class Circle(_Timed):
    """Round a circle with the origin of the platform.

    Args:
        centre: of the circle in base axes, (3,), or (2,) in the plane of a planar mechanism, m.
        radius: in m.
        normal: of its plane; it is gone round counter-clockwise about this.
        laps: how often, a fraction too; negative the other way round.
        duration: of the motion, s.
        profile: as in `PointToPoint`.
        orientation: all other coordinates, which stay as they are: the quaternion of a pose, angles
            where some rotations are outputs; those of home by default.
        begin: direction from the centre to where it begins, laid into the plane; by default the
            base axis x, and y if the normal is nearer to x than 26°.
        delay: rest before it begins, s.
    """

    def __init__(
        self,
        centre: ArrayLike,
        radius: float,
        normal: ArrayLike = (0.0, 0.0, 1.0),
        laps: float = 1.0,
        *,
        duration: float,
        profile: str | Profile = "quintic",
        orientation: ArrayLike | None = None,
        begin: ArrayLike | None = None,
        delay: float = 0.0,
    ) -> None:
        super().__init__(duration, profile, delay)
        self.centre, n = _row("centre", centre), _row("normal", normal)
        if len(self.centre) == 2:
            self.centre = np.append(self.centre, 0.0)
        self.radius, self.laps = _number("radius", radius), _number("laps", laps)
        if self.centre.shape != (3,) or n.shape != (3,):
            raise ConfigurationError(
                f"centre and normal have {len(self.centre)} and {len(n)} numbers, expected 3 each"
            )
        if not self.radius > 0:
            raise ConfigurationError(f"radius is {radius!r} m; it must be positive")
        if not np.linalg.norm(n) > 0:
            raise ConfigurationError("normal has the length 0; it says how the circle lies")
        n /= np.linalg.norm(n)
        direction = (
            np.eye(3)[1 if abs(n[0]) > 0.9 else 0] if begin is None else _row("begin", begin)
        )
        if direction.shape != (3,) or not np.linalg.norm(np.cross(n, direction)) > 1e-9:
            raise ConfigurationError(
                f"begin is {begin!r}, expected a direction of 3 numbers other than the normal"
            )
        e = direction - n * (n @ direction)
        e /= np.linalg.norm(e)
        self.axes = e, np.cross(n, e)
        self.orientation = None if orientation is None else _row("orientation", orientation)

    def at(self, given: Given) -> Moment:
        """The point of the circle."""
        followed = given.followed
        places = self._places(followed)
        still = self._still(followed, places)
        s, sd, sdd = self.share(given.t)
        whole = 2 * np.pi * self.laps
        c, n = al.cos(whole * s), al.sin(whole * s)
        w, wd = whole * sd, whole * sdd
        moment = Moment(still.tolist(), [0.0] * len(followed.rates), [0.0] * len(followed.rates))
        for at, moving in followed.blocks:
            if at.start not in places:
                continue
            axis = places[at.start]
            a, b = (self.radius * float(e[axis]) for e in self.axes)
            out, along = al.add(al.mul(c, a), al.mul(n, b)), al.sub(al.mul(c, b), al.mul(n, a))
            moment.positions[at.start] = float(self.centre[axis]) + out
            moment.rates[moving.start] = al.mul(w, along)
            turning = al.sub(al.mul(wd, along), al.mul(w * w, out))
            moment.accelerations[moving.start] = turning
        return moment

    def _places(self, followed: Followed) -> dict[int, int]:
        """Axis for each coordinate that is one of the platform's origin."""
        found = {k: "xyz".index(name) for k, name in enumerate(followed.names) if name in AXES}
        missing = {0, 1, 2} - set(found.values())
        for axis in missing:
            if max(abs(float(e[axis])) for e in self.axes) > 1e-12:
                raise ConfigurationError(
                    f"a circle needs the coordinate {'xyz'[axis]}; the reference is of "
                    f"{', '.join(followed.names)}"
                )
        return found

    def _still(self, followed: Followed, places: Mapping[int, int]) -> Array:
        """Positions with the coordinates that stay as they are."""
        still = followed.home.copy()
        rest = [k for k in range(len(still)) if k not in places]
        if self.orientation is None:
            return still
        if len(self.orientation) != len(rest):
            raise ConfigurationError(
                f"orientation has {len(self.orientation)} numbers, expected {len(rest)}: "
                f"{', '.join(followed.names[k] for k in rest) or 'there is none'}"
            )
        still[rest] = self.orientation
        return followed.checked("orientation", still)


AXES = ("x", "y", "z")


class Formula(Reference):
    """Positions as a formula of time; rates and accelerations are its derivatives.

    Args:
        function: takes the time, a CasADi SX, and gives as many expressions as there are positions;
            a quaternion of them needs no length.
        end: when it has come to rest, s, which it then must have by itself.
    """

    def __init__(self, function: Callable[[SX], abc.Sequence[Scalar]], end: float = np.inf) -> None:
        self.function, self.end = function, float(end)

    def at(self, given: Given) -> Moment:
        """The formula and its derivatives."""
        t = SX.sym("t")
        found = [SX(x) for x in self.function(t)]
        count = len(given.followed.names)
        if len(found) != count or any(x.numel() != 1 for x in found):
            raise ConfigurationError(
                f"the formula gives {len(found)} expressions, expected {count}: "
                f"{', '.join(given.followed.names)}"
            )
        column = casadi.vertcat(*found)
        first = casadi.jacobian(column, t)
        second = casadi.jacobian(first, t)
        now = SX(given.t)
        values = casadi.substitute([column, first, second], [t], [now])
        return _moment(given.followed, *([x[k] for k in range(count)] for x in values))


class Sequence(Reference):
    """Several motions, each beginning when the one before is at rest.

    Args:
        references: the motions; each begins where the one before ends.
    """

    def __init__(self, *references: Reference) -> None:
        if not references:
            raise ConfigurationError("a sequence needs one reference at least")
        for k, one in enumerate(references[:-1]):
            if not np.isfinite(one.end):
                raise ConfigurationError(
                    f"reference {k + 1} of {len(references)} never ends; only the last one may"
                )
        self.references = references
        ends = np.cumsum([0.0, *(one.end for one in references)]).tolist()
        self.begins, self.end = ends[:-1], ends[-1]

    def at(self, given: Given) -> Moment:
        """That of the reference whose time it is."""
        self._require_meeting(given.followed)
        parts = [
            one.at(given.part(k, begins))
            for k, (one, begins) in enumerate(zip(self.references, self.begins, strict=True))
        ]
        found = parts[0]
        for begins, part in zip(self.begins[1:], parts[1:], strict=True):
            before = given.t < begins
            pairs = [zip(a, b, strict=True) for a, b in zip(found, part, strict=True)]
            found = Moment(*([casadi.if_else(before, a, b) for a, b in pair] for pair in pairs))
        return found

    def signals(self, followed: Followed, name: str = "reference") -> Signals:
        """Those of all references, each from its beginning on."""
        pairs = enumerate(zip(self.references, self.begins, strict=True))
        parts = [one.signals(followed, f"{name}.{k}").later(begins) for k, (one, begins) in pairs]
        return joined(parts)

    def _require_meeting(self, followed: Followed) -> None:
        for k, (one, other) in enumerate(zip(self.references, self.references[1:], strict=False)):
            end, moving, _ = evaluated(one, followed, [one.end])
            try:
                require_start(other, followed, end[0], moving[0], tolerance=MEETING)
            except ConfigurationError as error:
                count = len(self.references)
                raise ConfigurationError(
                    f"reference {k + 2} of {count} does not begin where the one before ends: "
                    f"{error}"
                ) from None


class Table(Reference):
    """A motion through rows, by polynomials of degree 5 that match all of each row.

    Before the first row and after the last one it rests there; so the last row must be at rest.
    Rates at the last row below 1e-3 of the largest count as rest. At the first row it may be in
    motion already if that is not later than 0, when runs start.

    Args:
        times: of the rows, rising, s.
        positions: (rows, n); quaternions may have either sign, and rounded lengths.
        rates: (rows, m); of a quaternion the angular velocity in base axes.
        accelerations: (rows, m).
        names: of the positions, if they are to be compared with those of the mechanism.
    """

    def __init__(
        self,
        times: ArrayLike,
        positions: ArrayLike,
        rates: ArrayLike,
        accelerations: ArrayLike,
        names: abc.Sequence[str] | None = None,
    ) -> None:
        self.times = _row("times", times)
        rows = len(self.times)
        self.positions, self.rates, self.accelerations = (
            _rows(name, rows, values)
            for name, values in (
                ("positions", positions),
                ("rates", rates),
                ("accelerations", accelerations),
            )
        )
        self.names = None if names is None else tuple(names)
        if rows < 2:
            raise ConfigurationError(f"the table has {rows} row, expected two at least")
        back = np.flatnonzero(np.diff(self.times) <= 0)
        if back.size:
            k = int(back[0])
            raise ConfigurationError(
                f"time {self.times[k + 1]:.9g} s does not come after {self.times[k]:.9g} s"
            )
        if self.rates.shape != self.accelerations.shape:
            raise ConfigurationError(
                f"rates have shape {self.rates.shape} and accelerations {self.accelerations.shape}"
            )
        self._require_rest()
        self.end = float(self.times[-1])

    @classmethod
    def read(cls, robot: HasDynamics, source: str | Path | Mapping[str, ArrayLike]) -> Table:
        """The table of a CSV file, or of columns by name.

        Columns are called and derived as by ``gough dynamics``: time, positions, their rates with a
        d before the name, accelerations with dd; rates and accelerations that are missing are
        derivatives of splines.

        Args:
            robot: whose coordinates the columns are.
            source: path of the file, or the columns.

        Raises:
            DescriptionError: something in the file is wrong; every problem.
            ConfigurationError: the last row is not at rest; there is no time.
        """
        dynamics = robot.dynamics
        known = columns_of(dynamics)
        if isinstance(source, Mapping):
            table = _as_file(source, known.known)
        else:
            table = files.open_table(source, known.known)
        motion = motion_of(dynamics, table)
        if motion.time is None:
            raise ConfigurationError(f"{table.source} has no column time")
        rates, accelerations = motion.rates.copy(), motion.accelerations.copy()
        inverse = dynamics.inverse_geometry
        turned = () if inverse is None else inverse.coordinates.turned
        if len(turned) > 1:
            # angular velocities are no rates of the entries of a rotation vector
            degree = 5 if len(motion) > 5 else 3
            for place, *_ in turned:
                spline = make_interp_spline(motion.time, motion.at[:, place], k=degree)
                rates[:, place] = spline.derivative(1)(motion.time)
                accelerations[:, place] = spline.derivative(2)(motion.time)
        names = [name for name, _ in known.positions]
        return cls(motion.time, motion.at, rates, accelerations, names)

    def _require_rest(self) -> None:
        rates = self.rates
        least = RESTING * np.abs(rates).max(axis=0, initial=0.0)
        moving = np.flatnonzero(np.abs(rates[-1]) > least)
        if moving.size:
            k = int(moving[0])
            raise ConfigurationError(
                f"the last row, at {self.times[-1]:.6g} s, is not at rest: rate {k + 1} of "
                f"{rates.shape[1]} is {rates[-1, k]:.4g}. Add rows that bring the motion to rest"
            )
        rates[-1] = 0.0
        moving = np.flatnonzero(np.abs(rates[0]) > least)
        if moving.size and self.times[0] > 0:
            k = int(moving[0])
            raise ConfigurationError(
                f"the first row, at {self.times[0]:.6g} s, is not at rest: rate {k + 1} of "
                f"{rates.shape[1]} is {rates[0, k]:.4g}. Begin at 0 s, or add rows that start "
                "from rest"
            )

    def at(self, given: Given) -> Moment:
        """The polynomials, quaternions made unit."""
        followed, count = given.followed, len(given.followed.names)
        parts = [[given.told[f"{given.name}.{n}.{k}"] for k in range(count)] for n in range(3)]
        return _moment(followed, *parts)

    def signals(self, followed: Followed, name: str = "reference") -> Signals:
        """Positions and their first two derivatives."""
        first = self._hermite(followed)
        pieces, n, _ = first.shape
        second, third = np.zeros((2, pieces, n, 6))
        second[..., :5] = first[..., 1:] * np.arange(1, 6)
        third[..., :5] = second[..., 1:] * np.arange(1, 6)
        names = tuple(f"{name}.{order}.{k}" for order in range(3) for k in range(n))
        breaks = np.concatenate([[min(0.0, self.times[0]) - 1.0], self.times])
        return Signals(names, breaks, np.concatenate([first, second, third], axis=1))

    def _hermite(self, followed: Followed) -> Array:
        """Coefficients of the positions, rest before and behind, (pieces, n, 6)."""
        p, v, a = self._components(followed)
        h = np.diff(self.times)[:, None]
        way = p[1:] - p[:-1] - v[:-1] * h - a[:-1] * h**2 / 2
        gain = (v[1:] - v[:-1] - a[:-1] * h) * h
        change = (a[1:] - a[:-1]) * h**2
        found = np.zeros((len(p) + 1, p.shape[1], 6))
        inner = found[1:-1]
        inner[..., 0], inner[..., 1], inner[..., 2] = p[:-1], v[:-1], a[:-1] / 2
        inner[..., 3] = (10 * way - 4 * gain + change / 2) / h**3
        inner[..., 4] = (-15 * way + 7 * gain - change) / h**4
        inner[..., 5] = (6 * way - 3 * gain + change / 2) / h**5
        found[0, :, 0], found[-1, :, 0] = p[0], p[-1]
        return found

    def _components(self, followed: Followed) -> tuple[Array, Array, Array]:
        """Positions, and their own first and second derivatives; those of quaternions too.

        q̇ = ½ ω q,    q̈ = ½ ω̇ q - ¼ |ω|² q
        """
        n, m = len(followed.names), len(followed.rates)
        if self.positions.shape[1] != n or self.rates.shape[1] != m:
            raise ConfigurationError(
                f"the table has {self.positions.shape[1]} positions and {self.rates.shape[1]} "
                f"rates, expected {n}: {', '.join(followed.names)}; and {m}: "
                f"{', '.join(followed.rates)}"
            )
        if self.names is not None and self.names != followed.names:
            raise ConfigurationError(
                f"the table is of {', '.join(self.names)}, the reference of "
                f"{', '.join(followed.names)}"
            )
        p, v, a = (
            self.positions.copy(),
            np.zeros_like(self.positions),
            np.zeros_like(self.positions),
        )
        for at, moving in followed.blocks:
            v[:, at.start], a[:, at.start] = (
                x[:, moving.start] for x in (self.rates, self.accelerations)
            )
            if at.stop - at.start == 4:
                q = np.array([_unit_quaternion("positions", row) for row in p[:, at]])
                sides = np.where(np.sum(q[1:] * q[:-1], axis=1) < 0, -1.0, 1.0)
                q *= np.concatenate([[1.0], np.cumprod(sides)])[:, None]
                w, wd = self.rates[:, moving], self.accelerations[:, moving]
                p[:, at], v[:, at] = q, 0.5 * _times(w, q)
                a[:, at] = 0.5 * _times(wd, q) - 0.25 * np.sum(w * w, axis=1)[:, None] * q
        return p, v, a


class HasDynamics(Protocol):
    """A robot."""

    @property
    def dynamics(self) -> Dynamics:
        """Its dynamics."""


# quaternions


def _moment(followed: Followed, p: list[Scalar], v: list[Scalar], a: list[Scalar]) -> Moment:
    """Positions with unit quaternions and angular velocities, from numbers and derivatives.

    With q = s/|s|, r = |s| and the vector parts of products:

        ω = 2 (ṡ q*) / r,    ω̇ = 2 (s̈ q* - (q·ṡ) ω) / r
    """
    moment = Moment([], [], [])
    for at, _ in followed.blocks:
        if at.stop - at.start == 1:
            for part, values in zip(moment, (p, v, a), strict=True):
                part.append(values[at.start])
            continue
        r = al.sqrt(al.dot(p[at], p[at]))
        q = [x / r for x in p[at]]
        w = al.scale(2.0 / r, _vector_part(v[at], q))
        growth = al.scale(al.dot(q, v[at]), w)
        second = al.minus(_vector_part(a[at], q), growth)
        moment.positions.extend(q)
        moment.rates.extend(w)
        moment.accelerations.extend(al.scale(2.0 / r, second))
    return moment


def _vector_part(a_wxyz: abc.Sequence[Scalar], b_wxyz: abc.Sequence[Scalar]) -> Vector:
    """The vector part of a b*."""
    (aw, *a), (bw, *b) = a_wxyz, b_wxyz
    va, vb = (a[0], a[1], a[2]), (b[0], b[1], b[2])
    return al.minus(al.minus(al.scale(bw, va), al.scale(aw, vb)), al.cross(va, vb))


def _turning(a: list[float], b: list[float], s: Scalar) -> tuple[list[Scalar], list[float]]:
    """The quaternion a share of the way from one to another, and the rotation vector of the way."""
    w = sum(x * y for x, y in zip(a, b, strict=True))
    way = np.array(_vector_part(b, a), dtype=float) * (1.0 if w >= 0 else -1.0)
    sine = float(np.linalg.norm(way))
    half = float(np.arctan2(sine, abs(w)))
    if sine == 0.0:
        return list(a), [0.0, 0.0, 0.0]
    axis = (way / sine).tolist()
    c, n = al.cos(half * s), al.sin(half * s)
    x, y, z = (al.mul(n, k) for k in axis)
    return _product([c, x, y, z], a), [2.0 * half * k for k in axis]


def _product(p: abc.Sequence[Scalar], q: abc.Sequence[Scalar]) -> list[Scalar]:
    """Product of quaternions."""
    (a, b, c, d), (w, x, y, z) = p, q
    m, total = al.mul, al.total
    return [
        al.sub(m(a, w), total([m(b, x), m(c, y), m(d, z)])),
        al.sub(total([m(a, x), m(b, w), m(c, z)]), m(d, y)),
        al.sub(total([m(a, y), m(c, w), m(d, x)]), m(b, z)),
        al.sub(total([m(a, z), m(b, y), m(d, w)]), m(c, x)),
    ]


def _times(w: Array, q_wxyz: Array) -> Array:
    """Products of vectors and quaternions, (rows, 4)."""
    real = -np.sum(w * q_wxyz[:, 1:], axis=1, keepdims=True)
    return np.hstack([real, q_wxyz[:, :1] * w + np.cross(w, q_wxyz[:, 1:])])


def _unit_quaternion(name: str, q_wxyz: Array) -> Array:
    size = float(np.linalg.norm(q_wxyz))
    if not abs(size - 1.0) <= ROUNDED:
        raise ConfigurationError(
            f"the quaternion of {name} has the length {size:.6g}; it must be 1"
        )
    return np.asarray(q_wxyz / size)


# numbers that a person gives


def _number(name: str, given: float) -> float:
    try:
        found = float(given)
    except (TypeError, ValueError):
        found = np.nan
    if not np.isfinite(found):
        raise ConfigurationError(f"{name} is {given!r}, expected a finite number")
    return found


def _row(name: str, given: ArrayLike) -> Array:
    return _finite(name, given, 1)


def _rows(name: str, rows: int, given: ArrayLike) -> Array:
    found = _finite(name, given, 2)
    if len(found) != rows:
        raise ConfigurationError(f"{name} has {len(found)} rows, and there are {rows} times")
    return found


def _finite(name: str, given: ArrayLike, dimensions: int) -> Array:
    try:
        found = np.array(given, dtype=float)
    except (TypeError, ValueError):
        raise ConfigurationError(f"{name} is {given!r}, expected numbers") from None
    if found.ndim != dimensions:
        shape = "(n,)" if dimensions == 1 else "(rows, n)"
        raise ConfigurationError(f"{name} has shape {found.shape}, expected {shape}")
    if not np.isfinite(found).all():
        raise ConfigurationError(f"{name} has entries that are not finite")
    return found


def _as_file(columns: Mapping[str, ArrayLike], known: Mapping[str, str]) -> files.Table:
    """Columns as if a file had held them."""
    found: dict[str, list[float]] = {}
    for name, values in columns.items():
        if name not in known:
            raise UnknownName("column", name, known)
        found[name] = _row(name, values).tolist()
    lengths = {len(values) for values in found.values()}
    if len(lengths) != 1:
        raise ConfigurationError(f"columns have {sorted(lengths)} numbers, expected as many each")
    return files.Table("the table", 1, found, range(2, 2 + lengths.pop()))
