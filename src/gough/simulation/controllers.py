"""Controllers: efforts of the motors as expressions of time and state.

A controller is a source of commands for `equations.Equations`. It works in any choice of
independent rates y, in either place: what it follows are coordinates c of `trajectories.Followed`
with

    ċ = J y,    c̈ = J ẏ + b
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import casadi
import numpy as np
from numpy.typing import ArrayLike, NDArray

from gough import algebra as al
from gough.algebra import Scalar
from gough.dynamics.model import Model
from gough.errors import ConfigurationError, UnknownName
from gough.simulation.equations import Scene
from gough.simulation.trajectories import (
    Followed,
    Given,
    Moment,
    Of,
    Reference,
    Signals,
    followed,
    joined,
    require_start,
)
from gough.symbolic.trees.factors import Factors, Grid, solve_definite

Array = NDArray[np.float64]
SX = casadi.SX
Efforts = dict[str, Scalar]
"""By the name of the motor's variable, N and N m as its joint feels them."""

NEAR = 1e-12
"""Square of the vector part of a quaternion below which its angle is a series."""


# coordinates that are followed


class Tracked:
    """Coordinates of a scene, their rates, and how accelerations move them.

    Args:
        scene: a model and its state.
        of: which coordinates.
    """

    def __init__(self, scene: Scene, of: Of) -> None:
        self.scene, self.writing, self.model = scene, scene.writing, scene.model
        self.of = of
        self.followed: Followed = followed(scene.model, of)
        self._outputs = self.followed.names == tuple(scene.model.outputs.names)

    @cached_property
    def positions(self) -> list[Scalar]:
        """Positions as the state tells them."""
        if not self._outputs:
            return [self.scene.position(name) for name in self.followed.names]
        column = self.model.outputs.expression(self.model.closure.q)
        return [column[k] for k in range(column.numel())]

    @cached_property
    def rates(self) -> list[Scalar]:
        """ċ."""
        reduced = self.writing.reduced
        return self._moved(reduced.all_rates(reduced.rates))

    @cached_property
    def slopes(self) -> tuple[Grid, list[Scalar]]:
        """J and b."""
        reduced = self.writing.reduced
        yd = [SX.sym(f"yd{k}") for k in range(len(reduced.y))]
        found = self._moved(reduced.all_rates(reduced.accelerations(yd)))
        column = casadi.vertcat(*[SX(x) for x in self._carried(found)], SX(0, 1))
        symbols = SX(casadi.vertcat(*yd, SX(0, 1)))
        J = casadi.jacobian(column, symbols)
        b = casadi.substitute(column, symbols, SX.zeros(symbols.numel()))
        rows = [[_plain(J[i, k]) for k in range(J.shape[1])] for i in range(J.shape[0])]
        return rows, [_plain(b[k]) for k in range(b.numel())]

    def error(self, moment: Moment) -> list[Scalar]:
        """How far the reference is from the state, by rates: m, rad.

        Angles go the shorter way round; of orientations it is the rotation vector of R_ref Rᵀ in
        base axes, at most half a turn.
        """
        found: list[Scalar] = []
        for at, _ in self.followed.blocks:
            a, b = moment.positions[at], self.positions[at]
            if len(a) == 4:
                found += turn_between(a, b)
                continue
            gap = al.sub(a[0], b[0])
            found.append(_shorter(gap) if self.followed.periodic[at.start] else gap)
        return found

    # entries of a rotation vector

    @cached_property
    def _entries(self) -> tuple[list[int], SX, SX, slice] | None:
        """Which rates are those of entries of a rotation vector φ, ∂φ̇/∂ω, and the quaternion."""
        turned = self.model.outputs.turned if self._outputs else []
        if not turned:
            return None
        q, quaternion = self.model.closure.q, turned[0][1]
        moving = {at.start: rates.start for at, rates in self.followed.blocks}
        places = [moving[place] for place, *_ in turned]
        phi = self.model.outputs.expression(q)[[place for place, *_ in turned]]
        H = self._quaternion_rates(quaternion)
        return places, casadi.jacobian(phi, q[quaternion]) @ H, H, quaternion

    def _quaternion_rates(self, quaternion: slice) -> SX:
        return self.model.closure.position_rates[quaternion, self._axes(quaternion)]

    def _axes(self, quaternion: slice) -> list[int]:
        """Variables of the angular velocity of a quaternion."""
        structure = self.model.structure
        edge = next(
            k for k, part in enumerate(self.model.closure.slices) if part.stop == quaternion.stop
        )
        return [k for k, v in enumerate(structure.variables) if v.edge == edge][-3:]

    def _moved(self, v: Sequence[Scalar]) -> list[Scalar]:
        """Rates of the coordinates from those of the tree; accelerations but for b of entries."""
        found = [v[k] for k in self.followed.variables]
        if self._entries is not None:
            places, B, _, quaternion = self._entries
            w = casadi.vertcat(*[SX(v[k]) for k in self._axes(quaternion)])
            for place, x in zip(places, casadi.vertsplit(B @ w), strict=True):
                found[place] = x
        return found

    def _carried(self, accelerations: Sequence[Scalar]) -> list[Scalar]:
        """Accelerations with what the change of ∂φ̇/∂ω adds."""
        found = list(accelerations)
        if self._entries is None:
            return found
        places, B, H, quaternion = self._entries
        reduced = self.writing.reduced
        v = reduced.all_rates(reduced.rates)
        w = casadi.vertcat(*[SX(v[k]) for k in self._axes(quaternion)])
        still = SX.sym("w", 3)
        change = casadi.jtimes(B @ still, self.model.closure.q[quaternion], H @ w)
        added = casadi.vertsplit(casadi.substitute(change, still, w))
        for place, x in zip(places, added, strict=True):
            found[place] = al.add(found[place], x)
        return found


def turn_between(a_wxyz: Sequence[Scalar], b_wxyz: Sequence[Scalar]) -> list[Scalar]:
    """Rotation vector of R_a R_bᵀ, of at most half a turn, in the axes of both."""
    (aw, *a), (bw, *b) = a_wxyz, b_wxyz
    va, vb = (a[0], a[1], a[2]), (b[0], b[1], b[2])
    w = al.add(al.mul(aw, bw), al.dot(va, vb))
    v = al.minus(al.minus(al.scale(bw, va), al.scale(aw, vb)), al.cross(va, vb))
    square = al.dot(v, v)
    small = square < NEAR
    size = al.sqrt(casadi.if_else(small, 1.0, square))
    # 2 asin(s) / s = 2 + s²/3 + …
    per = casadi.if_else(small, 2.0 + square / 3.0, 2.0 * al.atan2(size, al.absolute(w)) / size)
    return list(al.scale(casadi.if_else(w < 0.0, -per, per), v))


def _shorter(angle: Scalar) -> Scalar:
    """The angle less whole turns, in half a turn either way."""
    return angle - 2 * np.pi * casadi.floor(angle / (2 * np.pi) + 0.5)


def _plain(x: SX) -> Scalar:
    return float(x) if x.is_constant() else x


# controllers


class Controller(ABC):
    """A source of efforts; two may be added."""

    @abstractmethod
    def commands(self, scene: Scene) -> Mapping[str, Scalar]:
        """Efforts by motor."""

    def signals(self, model: Model) -> Signals:
        """Functions of time that it is told, and moments where its efforts are not smooth."""
        return Signals()

    @property
    def followers(self) -> tuple[Following, ...]:
        """The parts that follow references."""
        return ()

    def require_start(
        self, model: Model, q: Array, t: float = 0.0, tolerance: float = 1e-6
    ) -> None:
        """Raise where a reference begins farther away from a configuration than a tolerance.

        Args:
            model: the mechanism.
            q: where the run starts, (positions,).
            t: when, s.
            tolerance: in m and rad.

        Raises:
            ConfigurationError: how far it is, and in what.
        """
        for one in self.followers:
            coordinates = one.followed(model)
            require_start(one.reference, coordinates, coordinates.of(q), t=t, tolerance=tolerance)

    def __add__(self, other: Controller) -> Controller:
        """Both together; their efforts add up."""
        return Sum(self, other)


class Following(Controller):
    """A controller that follows a reference.

    Args:
        reference: the motion.
        of: what the reference is of: "outputs", "inputs" for the motors, or names of joints; by
            default outputs, and motors where there are none.
        knows: live parameters as the controller believes them, by name; others are as in the run.
    """

    def __init__(
        self,
        reference: Reference,
        of: Of = None,
        knows: Mapping[str, ArrayLike] | None = None,
    ) -> None:
        if not isinstance(reference, Reference):
            raise ConfigurationError(
                f"the reference is {reference!r}; expected one such as Hold(x) or "
                "PointToPoint(start, end, duration)"
            )
        self.reference, self.of = reference, of
        self.knows = dict(knows or {})

    def followed(self, model: Model) -> Followed:
        """The coordinates that it follows."""
        return followed(model, self.of)

    def signals(self, model: Model) -> Signals:
        """Those of the reference."""
        return self.reference.signals(self.followed(model))

    @property
    def followers(self) -> tuple[Following, ...]:
        """Itself."""
        return (self,)

    def moment(self, scene: Scene, coordinates: Followed) -> Moment:
        """What the reference asks for."""
        return self.reference.at(Given(scene.t, coordinates, scene.told))


class ComputedTorque(Following):
    """Efforts that give each coordinate a linear differential equation of its error.

        c̈ = c̈_ref + damping (ċ_ref - ċ) + stiffness e

    so that ë + damping ė + stiffness e = 0 as long as the model is exact and the motors are strong
    enough. Of an orientation e is the rotation vector of R_ref Rᵀ and ċ the angular velocity, both
    in base axes; then this holds to first order in e, and exactly where all turns about one axis.
    Forces of other laws (springs, friction, stops) are not in the model.

    With fewer coordinates than freedoms, legs that spin or motors that are not followed, those left
    over move as they have to: efforts are found that give the coordinates what they need, and
    nothing is said of the rest.

    Args:
        reference: the motion.
        stiffness: 1/s², one for all coordinates or one for each rate.
        damping: 1/s, likewise.
        frequency: instead of these, the natural frequency, rad/s: stiffness = frequency².
        damping_ratio: with it, damping = 2 · ratio · frequency.
        of: see `Following`.
        knows: live parameters as the controller believes them, by name; others are as in the run.
    """

    def __init__(
        self,
        reference: Reference,
        stiffness: ArrayLike | None = None,
        damping: ArrayLike | None = None,
        *,
        frequency: ArrayLike | None = None,
        damping_ratio: ArrayLike = 1.0,
        of: Of = None,
        knows: Mapping[str, ArrayLike] | None = None,
    ) -> None:
        super().__init__(reference, of, knows)
        if frequency is not None:
            if stiffness is not None or damping is not None:
                raise ConfigurationError(
                    "give stiffness and damping, or frequency and damping_ratio, not both"
                )
            wn, ratio = _gains("frequency", frequency), _gains("damping_ratio", damping_ratio)
            self.stiffness, self.damping = wn**2, 2 * ratio * wn
            return
        if stiffness is None or damping is None:
            raise ConfigurationError("give stiffness and damping, or frequency and damping_ratio")
        self.stiffness, self.damping = _gains("stiffness", stiffness), _gains("damping", damping)

    def commands(self, scene: Scene) -> Efforts:
        """Efforts by motor."""
        tracked = Tracked(scene, self.of)
        moment = self.moment(scene, tracked.followed)
        pulled = _spring(tracked, moment, self.stiffness, self.damping)
        asked = [al.add(a, b) for a, b in zip(moment.accelerations, pulled, strict=True)]
        return _believing(scene, self.knows, lambda c: efforts_for_accelerations(tracked, c), asked)


def efforts_for_accelerations(tracked: Tracked, asked: Sequence[Scalar]) -> Efforts:
    """Efforts that give accelerations of the coordinates; the smallest where motors are to spare.

    As many coordinates as freedoms take inverse dynamics. With fewer, from A ẏ + h = Jₘᵀ τ:

        J A⁻¹ Jₘᵀ τ = c̈ - b + J A⁻¹ h

    Raises:
        ConfigurationError: the motors can not move the coordinates independently.
    """
    scene, w = tracked.scene, tracked.writing
    J, b = tracked.slopes
    rest = [al.sub(x, y) for x, y in zip(asked, b, strict=True)]
    count, freedoms, name = len(J), len(w.yd), scene.model.structure.mechanism.name
    if count > freedoms:
        raise ConfigurationError(
            f"{name} has {freedoms} freedoms, and the reference is of {count} coordinates: "
            f"{', '.join(tracked.followed.rates)}; name fewer: of=[…]"
        )
    if scene.model.motors_rank < count:
        raise ConfigurationError(
            f"{name} has motors for {scene.model.motors_rank} independent forces, too few to "
            f"follow {count} coordinates: {', '.join(tracked.followed.rates)}"
        )
    if count == freedoms:
        return scene.efforts(Factors(J).solve(rest))
    A, motors = w.reduced.mass_matrix(w.loads), w.motor_rows()
    w.require_inertia(A)
    h = w.forces([0.0] * freedoms)
    # rows of D: what unit efforts do to the coordinates
    D = [[al.dot(row, solve_definite(A, motor)[0]) for motor in motors] for row in J]
    fallen, _ = solve_definite(A, h)
    wanted = [al.add(x, al.dot(row, fallen)) for x, row in zip(rest, J, strict=True)]
    if len(motors) == count:
        tau = Factors(D).solve(wanted)
    else:
        square = [[al.dot(x, y) for y in D] for x in D]
        shares, _ = solve_definite(square, wanted)
        tau = [al.dot(column, shares) for column in zip(*D, strict=True)]
    return dict(zip(_motors(scene.model), tau, strict=True))


class PDGravity(Following):
    """Springs and dampers from the platform to the reference, and the load of gravity.

        Jᵀ (stiffness e + damping (ċ_ref - ċ)) + gravity along y = Jₘᵀ τ

    Errors are those of `ComputedTorque`.

    Args:
        reference: the motion.
        stiffness: N/m and N m/rad, one for all coordinates or one for each rate.
        damping: N s/m and N m s/rad, likewise.
        gravity: whether gravity is compensated.
        of: see `Following`.
        knows: live parameters as the controller believes them, by name; others are as in the run.
    """

    def __init__(
        self,
        reference: Reference,
        stiffness: ArrayLike,
        damping: ArrayLike,
        *,
        gravity: bool = True,
        of: Of = None,
        knows: Mapping[str, ArrayLike] | None = None,
    ) -> None:
        super().__init__(reference, of, knows)
        self.stiffness, self.damping = _gains("stiffness", stiffness), _gains("damping", damping)
        self.gravity = gravity

    def commands(self, scene: Scene) -> Efforts:
        """Efforts by motor."""
        tracked = Tracked(scene, self.of)
        moment = self.moment(scene, tracked.followed)
        force = _spring(tracked, moment, self.stiffness, self.damping)
        return _believing(scene, self.knows, lambda f: self._efforts(tracked, f), force)

    def _efforts(self, tracked: Tracked, force: Sequence[Scalar]) -> Efforts:
        """Efforts for forces along the coordinates."""
        scene, (J, _) = tracked.scene, tracked.slopes
        along = [al.dot(column, force) for column in zip(*J, strict=True)]
        if self.gravity:
            along = [al.add(x, y) for x, y in zip(along, gravity_load(scene), strict=True)]
        return scene.efforts_for(along)


class JointPD(Following):
    """A spring and a damper for each motor, and the load of gravity.

        τ = stiffness e + damping (q̇_ref - q̇) + efforts that hold the mechanism

    Args:
        reference: the motion, of positions of motors.
        stiffness: N/m and N m/rad, one for all motors or one for each.
        damping: N s/m and N m s/rad, likewise.
        gravity: whether gravity is compensated.
        of: "inputs", all motors, or some by name; the others only carry the load.
        knows: live parameters as the controller believes them, by name; others are as in the run.
    """

    def __init__(
        self,
        reference: Reference,
        stiffness: ArrayLike,
        damping: ArrayLike,
        *,
        gravity: bool = True,
        of: Of = "inputs",
        knows: Mapping[str, ArrayLike] | None = None,
    ) -> None:
        super().__init__(reference, of, knows)
        self.stiffness, self.damping = _gains("stiffness", stiffness), _gains("damping", damping)
        self.gravity = gravity

    def commands(self, scene: Scene) -> Efforts:
        """Efforts by motor."""
        tracked, motors = Tracked(scene, self.of), _motors(scene.model)
        for name in tracked.followed.names:
            if name not in motors:
                raise UnknownName("motor", name, motors)
        moment = self.moment(scene, tracked.followed)
        force = _spring(tracked, moment, self.stiffness, self.damping)
        own = dict(zip(tracked.followed.names, force, strict=True))
        held: Efforts = {}
        if self.gravity:
            held = _believing(
                scene, self.knows, lambda _: scene.efforts_for(gravity_load(scene)), ()
            )
        return {name: al.add(own.get(name, 0.0), held.get(name, 0.0)) for name in motors}


class Feedforward(Following):
    """Efforts of the reference itself, by inverse dynamics along it; to be added to others.

    It takes positions of all freedoms that place the mechanism in closed form: outputs.

    Args:
        reference: the motion of the outputs.
    """

    def __init__(self, reference: Reference) -> None:
        super().__init__(reference, "outputs")

    def commands(self, scene: Scene) -> Efforts:
        """Efforts by motor."""
        model, name = scene.model, scene.model.structure.mechanism.name
        if "x" not in model.places:
            raise ConfigurationError(
                f"{name} has no closed form of all its legs in its outputs, so it has no "
                "feedforward along a reference; use ComputedTorque"
            )
        w = model.writing("x", scene.writing.inputs)
        coordinates, structure = followed(w.model, "outputs"), w.model.structure
        independent = [structure.variables[k].name for k in w.model.independent]
        if sorted(independent) != sorted(coordinates.rates):
            raise ConfigurationError(
                f"outputs of {name} do not say all of its motion; use ComputedTorque"
            )
        moment = self.moment(scene, coordinates)
        order = [coordinates.rates.index(n) for n in independent]
        tau, _ = w.motor_efforts(w.forces([moment.accelerations[k] for k in order]))
        q = w.model.closure.q
        old = [*(q[k] for k in w.model.outputs.whole), *w.reduced.y]
        new = [*moment.positions, *(moment.rates[k] for k in order)]
        # another tree of the same mechanism has symbols of its own
        old += [w.model.closure.p[k] for k in range(w.model.closure.p.numel())]
        new += [model.closure.p[k] for k in range(model.closure.p.numel())]
        if w.inputs.gravity:
            old, new = [*old, *w.gravity], [*new, *scene.writing.gravity]
        both = _column(old), _column(new)
        found = casadi.substitute(_column(tau), *both)
        return {n: found[k] for k, n in enumerate(_motors(w.model))}


class Custom(Controller):
    """Efforts by a function that writes expressions.

    Args:
        function: takes the `Scene` and gives efforts by motor: numbers, or expressions of
            ``scene.t``, ``scene.position(name)`` and ``scene.rate(name)``, which are CasADi SX. It
            is called when the equations are written, not during a run: no `if` can ask for a
            value; use ``casadi.if_else``.
    """

    def __init__(self, function: Callable[[Scene], Mapping[str, Scalar]]) -> None:
        if not callable(function):
            raise ConfigurationError(f"the controller is {function!r}, expected a function")
        self.function = function

    def commands(self, scene: Scene) -> Efforts:
        """What the function gives, checked."""
        found = self.function(scene)
        if not isinstance(found, Mapping):
            raise ConfigurationError(
                f"the controller's function gives {found!r}, expected a dict of efforts by motor"
            )
        motors = _motors(scene.model)
        for name, effort in found.items():
            if name not in motors:
                raise UnknownName("motor", str(name), motors)
            _require_scalar(name, effort)
        return dict(found)


class Sum(Controller):
    """Several controllers whose efforts add up.

    Args:
        controllers: the parts.
    """

    def __init__(self, *controllers: Controller) -> None:
        own = [part.controllers if isinstance(part, Sum) else (part,) for part in controllers]
        self.controllers: tuple[Controller, ...] = tuple(c for part in own for c in part)

    def commands(self, scene: Scene) -> Efforts:
        """Sums by motor."""
        found: Efforts = {}
        for k, controller in enumerate(self.controllers):
            part, mark = copy(scene), f"{k}:"
            part.told = {
                n.removeprefix(mark): x for n, x in scene.told.items() if n.startswith(mark)
            }
            for name, effort in controller.commands(part).items():
                found[name] = al.add(found.get(name, 0.0), effort)
        return found

    def signals(self, model: Model) -> Signals:
        """Those of all parts, each with its number before the name."""
        parts = []
        for k, controller in enumerate(self.controllers):
            own = controller.signals(model)
            parts.append(replace(own, names=tuple(f"{k}:{name}" for name in own.names)))
        return joined(parts)

    @property
    def followers(self) -> tuple[Following, ...]:
        """Those of all parts."""
        return tuple(one for part in self.controllers for one in part.followers)


# controllers that are called during a run


@dataclass(frozen=True)
class Seen:
    """What a sampled controller sees."""

    x: Array
    """Operational coordinates, (n,)."""
    xd: Array
    """Their rates, (outputs,); of a pose the twist (linear, angular) in base axes."""
    positions: Mapping[str, float]
    """Of the joints' variables, rad and m; those that a quaternion holds are left out."""
    rates: Mapping[str, float]
    """Of the joints' variables, rad/s and m/s."""


def seen(model: Model, q: Array, v: Array) -> Seen:
    """What is seen of a configuration, (positions,), and all rates, (variables,)."""
    structure, slices = model.structure, model.closure.slices
    positions, rates = {}, {}
    for k, variable in enumerate(structure.variables):
        edge = structure.edges[variable.edge]
        rates[variable.name] = float(v[k])
        if edge.type.coordinates == edge.type.freedoms:
            positions[variable.name] = float(q[slices[variable.edge].start + variable.freedom])
    return Seen(model.outputs.of(q), v[structure.columns("operational")], positions, rates)


class Sampled:
    """A digital controller: a Python function that is called every period.

    Its efforts are held until the next call. It may be anything that Python can do: it may keep
    states of its own, which then go on from one run to the next.

    Args:
        function: takes the time, s, and what is `Seen`; gives efforts by motor, N and N m, or all
            of them in the order of ``robot.dynamics.motors``. Motors left out get none.
        period: time from call to call, s.
    """

    def __init__(self, function: Callable[[float, Seen], Any], period: float) -> None:
        if not callable(function):
            raise ConfigurationError(f"the controller is {function!r}, expected a function")
        try:
            self.period = float(period)
        except (TypeError, ValueError):
            self.period = float("nan")
        if not (np.isfinite(self.period) and self.period > 0):
            raise ConfigurationError(f"period is {period!r} s; it must be positive")
        self.function = function

    def commands(self, scene: Scene) -> Efforts:
        """None: the run tells the motors what the function gives."""
        return {}

    def efforts(self, t: float, state: Seen, motors: Sequence[str]) -> Array:
        """What the function gives at a time, checked, (motors,).

        Raises:
            ConfigurationError: it gives something other than finite efforts.
            UnknownName: a motor has no such name.
        """
        found = self.function(t, state)
        place = f"the controller's function at t = {t:.6g} s"
        if isinstance(found, Mapping):
            for name in found:
                if name not in motors:
                    raise UnknownName("motor", str(name), motors)
            found = [found.get(name, 0.0) for name in motors]
        try:
            efforts = np.array(found, dtype=float)
        except (TypeError, ValueError):
            raise ConfigurationError(f"{place} gives {found!r}, expected efforts") from None
        if efforts.shape != (len(motors),):
            raise ConfigurationError(
                f"{place} gives the shape {efforts.shape}, expected ({len(motors)},): "
                f"{', '.join(motors)}"
            )
        wrong = [name for name, x in zip(motors, efforts, strict=True) if not np.isfinite(x)]
        if wrong:
            raise ConfigurationError(f"{place} gives efforts that are not finite: {wrong[0]}")
        return efforts


# parts


def gravity_load(scene: Scene) -> list[Scalar]:
    """Forces along y that hold the mechanism at rest."""
    w = scene.writing
    still = SX(casadi.vertcat(*w.reduced.y, SX(0, 1)))
    column = _column(w.forces([0.0] * len(w.yd)))
    found = casadi.substitute(column, still, SX.zeros(still.numel()))
    return [_plain(found[k]) for k in range(found.numel())]


def _spring(tracked: Tracked, moment: Moment, stiffness: Array, damping: Array) -> list[Scalar]:
    """Stiffness times errors and damping times errors of rates."""
    names = tracked.followed.rates
    parts = []
    for name, gains in (("stiffness", stiffness), ("damping", damping)):
        if gains.ndim and gains.shape != (len(names),):
            raise ConfigurationError(
                f"{name} has {len(gains)} numbers, expected one, or {len(names)}: "
                f"{', '.join(names)}"
            )
        parts.append(np.broadcast_to(gains, (len(names),)).tolist())
    slow = [al.sub(a, b) for a, b in zip(moment.rates, tracked.rates, strict=True)]
    rows = zip(*parts, tracked.error(moment), slow, strict=True)
    return [al.add(al.mul(k, e), al.mul(d, ed)) for k, d, e, ed in rows]


def _believing(
    scene: Scene,
    knows: Mapping[str, ArrayLike],
    efforts: Callable[[Sequence[Scalar]], Efforts],
    given: Sequence[Scalar],
) -> Efforts:
    """Efforts for something given, with live parameters as the controller believes them.

    What is given is measured, and stays as it is.
    """
    if not knows:
        return efforts(given)
    closure = scene.model.closure
    believed: list[Scalar] = [closure.p[k] for k in range(closure.p.numel())]
    starts, at = {}, 0
    for name, value in closure.live.items():
        starts[name] = slice(at, at + np.size(value))
        at += np.size(value)
    for name, value in knows.items():
        if name not in starts:
            raise UnknownName("live parameter", name, starts)
        numbers = np.array(value, dtype=float).ravel()
        expected = starts[name].stop - starts[name].start
        if numbers.size != expected or not np.isfinite(numbers).all():
            raise ConfigurationError(f"{name} is {value!r}, expected {expected} finite numbers")
        believed[starts[name]] = numbers.tolist()
    symbols = [SX.sym(f"given{k}") for k in range(len(given))]
    found = efforts(symbols)
    column = casadi.substitute(_column(list(found.values())), closure.p, _column(believed))
    column = casadi.substitute(column, _column(symbols), _column(given))
    return {name: column[k] for k, name in enumerate(found)}


def _motors(model: Model) -> list[str]:
    return [model.structure.variables[k].name for k in model.actuated]


def _column(values: Sequence[Scalar]) -> SX:
    return SX(casadi.vertcat(*[SX(x) for x in values], SX(0, 1)))


def _gains(name: str, given: ArrayLike) -> Array:
    try:
        found = np.array(given, dtype=float)
    except (TypeError, ValueError):
        raise ConfigurationError(f"{name} is {given!r}, expected numbers") from None
    if found.ndim > 1 or not found.size:
        raise ConfigurationError(f"{name} has shape {found.shape}, expected one number or a list")
    if not (np.isfinite(found).all() and (found >= 0).all()):
        raise ConfigurationError(f"{name} is {given!r}; it must be finite and not negative")
    return found


def _require_scalar(name: str, effort: Scalar) -> None:
    """Raise unless an effort is one finite number or expression."""
    try:
        expression = isinstance(effort, SX)
        sound = effort.numel() == 1 if expression else bool(np.isfinite(float(effort)))
    except (TypeError, ValueError):
        sound = False
    if not sound:
        raise ConfigurationError(
            f"the controller's function gives {effort!r} for {name}, expected a finite number or "
            "an expression"
        )
