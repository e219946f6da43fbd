"""Inverse and direct dynamics over batches, in platform space and in joint space."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gough.assembly import Assembler
from gough.dynamics.model import Model, Space
from gough.dynamics.results import ENDINGS, DirectDynamics, Ending, InverseDynamics
from gough.dynamics.writing import PLAIN, Inputs, Place
from gough.errors import ConfigurationError, OutOfReach, SingularError, UnknownName
from gough.geometry.inverse import InverseGeometry
from gough.geometry.rates import Kinematics
from gough.kernels import Kernel
from gough.models import Models
from gough.numerics.newton import Ending as NewtonEnding

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Solution = TypeVar("Solution", InverseDynamics, DirectDynamics)
Wrench = ArrayLike | Mapping[str, ArrayLike] | None
"""(force, moment about its origin) on the platform, (*batch, 6), or the same by body; base axes."""

STEPS = 16
"""Parts of the way from home to a state."""
LIMIT = 1e-6
"""Regularity below which an answer is refused; see `results`. A guess: six digits are lost."""


class Dynamics:
    """The dynamics of one mechanism.

    In platform space a state is x with rates ẋ, as for geometry; in joint space it is a
    configuration q with rates of the `independent` variables. Efforts are those of the motors, in
    N and N m, as their joints feel them. Gravity is that of the description unless given.

    Args:
        models: the mechanism.
        assembler: what closes its loops, with its live parameters.
        home: a closed configuration, (positions,).
        inverse: its inverse geometry, None without outputs.
        kinematics: its rates.
    """

    def __init__(
        self,
        models: Models,
        assembler: Assembler,
        home: Array,
        inverse: InverseGeometry | None,
        kinematics: Kinematics,
    ) -> None:
        self.models, self.assembler, self.home = models, assembler, home
        self.inverse_geometry, self.kinematics = inverse, kinematics
        self.structure = models.structure
        self._models: dict[Space, Model] = {}

    def model(self, space: Space) -> Model:
        """Expressions and kernels in platform space or in joint space.

        Raises:
            ConfigurationError: the mechanism has no outputs, and platform space is asked for.
        """
        if space == "platform" and not self.structure.columns("operational"):
            raise ConfigurationError(
                f"{self.structure.mechanism.name} has no outputs; use joint space: "
                "inverse_dynamics_joint, direct_dynamics_joint"
            )
        if space not in self._models:
            self._models[space] = Model(self.models, self.assembler, self.home, space)
        return self._models[space]

    @property
    def motors(self) -> tuple[str, ...]:
        """Names of the efforts."""
        return tuple(self.structure.variables[k].name for k in self.structure.columns("actuated"))

    def independent(self, space: Space = "joint") -> tuple[str, ...]:
        """Names of the independent rates."""
        model = self.model(space)
        return tuple(self.structure.variables[k].name for k in model.independent)

    # the quick ways

    @cached_property
    def _quick_inverse(self) -> tuple[Kernel, tuple[Array, ...]] | None:
        return self._quick("inverse")

    @cached_property
    def _quick_direct(self) -> tuple[Kernel, tuple[Array, ...]] | None:
        return self._quick("direct")

    def _quick(self, name: str) -> tuple[Kernel, tuple[Array, ...]] | None:
        """The kernel that takes arguments as they come, if the mechanism is as simple as that."""
        model = self.model("platform")
        outputs = self.structure.columns("operational")
        plain = sorted(model.independent) == sorted(outputs) and "x" in model.places
        determined = model.motors_rank == len(model.independent)
        if not plain or not determined or list(model.independent) != outputs:
            return None
        return model.kernel(name, "x"), self._parameters

    @property
    def _parameters(self) -> tuple[Array, ...]:
        return (self.assembler.p,) if self.assembler.p.size else ()

    def quick_inverse(self, x: ArrayLike, xd: ArrayLike, xdd: ArrayLike) -> Array | None:
        """Efforts where every row is unobjectionable, else None: `inverse` then finds out why."""
        quick = self._quick_inverse
        return None if quick is None else _quickly(*quick, x, xd, xdd)

    def quick_direct(self, x: ArrayLike, xd: ArrayLike, tau: ArrayLike) -> Array | None:
        """Accelerations where every row is unobjectionable, else None."""
        quick = self._quick_direct
        return None if quick is None else _quickly(*quick, x, xd, tau)

    # platform space

    def inverse(
        self,
        x: ArrayLike,
        xd: ArrayLike,
        xdd: ArrayLike,
        wrench: Wrench = None,
        gravity: ArrayLike | None = None,
        near: ArrayLike | None = None,
        weights: ArrayLike | None = None,
    ) -> InverseDynamics:
        """Efforts for a motion of the outputs, row by row.

        Args:
            x: operational coordinates, (*batch, n); a pose where all six freedoms are.
            xd: their rates, (*batch, outputs); of a pose the twist (linear, angular).
            xdd: their accelerations, (*batch, outputs).
            wrench: what the surroundings do to the platform, (force, moment about its origin) in
                base axes, (*batch, 6), or such by the names of bodies.
            gravity: in base axes, (*batch, 3), m/s²; that of the description by default.
            near: a configuration whose working mode is kept, (*batch, positions).
            weights: of a redundantly actuated robot, (motors,): efforts take shares with these
                weights, so that the sum of (effort / weight)² is smallest; all 1 by default.

        Raises:
            ConfigurationError: an argument has the wrong shape; there are no outputs or motors.
        """
        state = self._platform_state(x, xd, xdd, near)
        return self._inverse("platform", state, wrench, gravity, weights)

    def direct(
        self,
        x: ArrayLike,
        xd: ArrayLike,
        tau: ArrayLike,
        wrench: Wrench = None,
        gravity: ArrayLike | None = None,
        near: ArrayLike | None = None,
    ) -> DirectDynamics:
        """Accelerations of the outputs for efforts, row by row; arguments as for `inverse`."""
        outputs = self.structure.columns("operational")
        state = self._platform_state(x, xd, None, near)
        found = self._direct("platform", state, tau, wrench, gravity)
        model = self.model("platform")
        names = tuple(self.structure.variables[k].name for k in outputs)
        if list(model.independent) == outputs:
            return found
        rows = self._all_accelerations(model, state, found.accelerations)[..., outputs]
        rows = np.where(found.solved[..., None], rows, np.nan)
        return DirectDynamics(found.ending, found.regularity, found.reasons, rows, names)

    def _all_accelerations(self, model: Model, state: _State, yd: Array) -> Array:
        kernel = model.kernel("accelerations", state.place)
        return kernel(state.at, *self._parameters, state.y, np.nan_to_num(yd))

    def _platform_state(
        self, x: ArrayLike, xd: ArrayLike, xdd: ArrayLike | None, near: ArrayLike | None
    ) -> _State:
        """Where rows are, their independent rates and accelerations, and which are sound."""
        model, inverse = self.model("platform"), self.inverse_geometry
        assert inverse is not None
        outputs = self.structure.columns("operational")
        x = _numbers("x", x, len(inverse.coordinates), inverse.coordinates.names)
        names = [self.structure.variables[k].name for k in outputs]
        xd = _numbers("xd", xd, len(outputs), names)
        xdd = None if xdd is None else _numbers("xdd", xdd, len(outputs), names)
        batch = _batch({"x": x, "xd": xd, **({} if xdd is None else {"xdd": xdd})})
        x = np.broadcast_to(x, (*batch, x.shape[-1]))
        xd = np.broadcast_to(xd, (*batch, len(outputs)))
        xdd = None if xdd is None else np.broadcast_to(xdd, (*batch, len(outputs)))
        finite = np.isfinite(x).all(-1) & np.isfinite(xd).all(-1)
        finite &= True if xdd is None else np.isfinite(xdd).all(-1)
        x = np.where(finite[..., None], x, inverse.coordinates.of(self.home))
        x = inverse.checked(x)
        state = _State("x", x, xd, xdd, np.where(finite, 0, _NOT_FINITE), {})
        plain = list(model.independent) == outputs
        if "x" in model.places and near is None and plain:
            return state
        return self._by_configuration(model, state, near, plain)

    def _by_configuration(
        self, model: Model, state: _State, near: ArrayLike | None, plain: bool
    ) -> _State:
        """The state with configurations in place of outputs."""
        assert self.inverse_geometry is not None
        found = self.inverse_geometry.solve(state.at, near)
        missed = (state.codes == 0) & ~found.reached
        codes = np.where(missed, _OUT_OF_REACH, state.codes)
        flat = missed.ravel()
        reasons = {k: found.reasons[k] for k in np.flatnonzero(flat).tolist()}
        y, yd = state.y, state.yd
        if not plain:
            y, yd, codes = self._completed(model, found.q, state, codes)
        return _State("q", found.q, y, yd, codes, reasons)

    def _completed(
        self, model: Model, q: Array, state: _State, codes: NDArray[Any]
    ) -> tuple[Array, Array | None, NDArray[Any]]:
        """Independent rates of a mechanism whose outputs leave some open: the smallest ones."""
        sound = (codes == 0)[..., None]
        from_outputs, y = self.kinematics.from_operational, list(model.independent)
        p = self.assembler.p
        xd = np.where(sound, state.y, 0.0)
        v = from_outputs.rates(q, p, xd)
        outputs = self.structure.columns("operational")
        off = np.abs(v[..., outputs] - xd).max(-1, initial=0.0)
        size = np.abs(xd).max(-1, initial=0.0)
        codes = np.where((codes == 0) & (off > 1e-8 * size), _NO_MOTION, codes)
        if state.yd is None:
            return v[..., y], None, codes
        vd = from_outputs.accelerations(q, p, v, np.where(sound, state.yd, 0.0))
        return v[..., y], vd[..., y], codes

    # joint space

    def inverse_joint(
        self,
        q: ArrayLike,
        v: ArrayLike,
        a: ArrayLike,
        wrench: Wrench = None,
        gravity: ArrayLike | None = None,
        weights: ArrayLike | None = None,
    ) -> InverseDynamics:
        """Efforts for a motion of the independent variables, row by row.

        Args:
            q: closed configurations, (*batch, positions).
            v: rates of `independent`, (*batch, independent), m/s and rad/s.
            a: their accelerations, (*batch, independent).
            wrench: as for `inverse`.
            gravity: as for `inverse`.
            weights: as for `inverse`.

        Raises:
            ConfigurationError: an argument has the wrong shape; there are no motors.
        """
        return self._inverse("joint", self._joint_state(q, v, a), wrench, gravity, weights)

    def direct_joint(
        self,
        q: ArrayLike,
        v: ArrayLike,
        tau: ArrayLike,
        wrench: Wrench = None,
        gravity: ArrayLike | None = None,
    ) -> DirectDynamics:
        """Accelerations of the independent variables for efforts; arguments as `inverse_joint`."""
        return self._direct("joint", self._joint_state(q, v, None), tau, wrench, gravity)

    def _joint_state(self, q: ArrayLike, v: ArrayLike, a: ArrayLike | None) -> _State:
        names = self.independent("joint")
        q = _numbers("q", q, len(self.home), ())
        v = _numbers("v", v, len(names), names)
        a = None if a is None else _numbers("a", a, len(names), names)
        batch = _batch({"q": q, "v": v, **({} if a is None else {"a": a})})
        q = np.broadcast_to(q, (*batch, len(self.home)))
        v = np.broadcast_to(v, (*batch, len(names)))
        a = None if a is None else np.broadcast_to(a, (*batch, len(names)))
        finite = np.isfinite(q).all(-1) & np.isfinite(v).all(-1)
        finite &= True if a is None else np.isfinite(a).all(-1)
        q = np.where(finite[..., None], q, self.home)
        self.kinematics.require_closed(q)
        return _State("q", q, v, a, np.where(finite, 0, _NOT_FINITE), {})

    def state(self, positions: ArrayLike) -> Array:
        """The closed configuration with given positions of the independent variables.

        Args:
            positions: of `independent`, (independent,), rad and m. The other joints go the way
                from home, in small steps, so that the assembly stays that of home.

        Raises:
            OutOfReach: the loops do not close there.
            ConfigurationError: the shape is wrong, a number is not finite, or an independent
                variable has no position of its own, as those of a ball or of a floating base.
        """
        model, structure = self.model("joint"), self.structure
        names = self.independent("joint")
        places = []
        for k in model.independent:
            edge = structure.edges[structure.variables[k].edge]
            if edge.type.coordinates > edge.type.freedoms:
                name = structure.variables[k].name
                raise ConfigurationError(f"{name} has no position of its own; give q in full")
            start = self.models.closure.slices[structure.variables[k].edge].start
            places.append(start + structure.variables[k].freedom)
        given = _finite("positions", _numbers("positions", positions, len(names), names))
        if given.ndim != 1:
            raise ConfigurationError(
                f"positions have shape {given.shape}, expected ({len(names)},)"
            )
        held = np.isin(np.arange(len(structure.variables)), model.independent)
        q = self.home.copy()
        for share in np.linspace(0, 1, STEPS + 1)[1:]:
            q[places] = self.home[places] + share * (given - self.home[places])
            found = self.assembler.close(q, held)
            q = found.q
            if found.ending is not NewtonEnding.closed:
                raise OutOfReach("configuration", 1, [0], [found.ending.value])
        return q

    # what the models are made of

    def mass_matrix(self, at: ArrayLike, space: Space = "platform") -> Array:
        """A with A ẏ + bias = forces along y, (*batch, independent, independent).

        Symmetric and positive definite; kg, kg m and kg m². With six outputs y is the twist.

        Args:
            at: operational coordinates in platform space, a configuration in joint space.
            space: whose rates y are, see `independent`.

        Raises:
            SingularError: a row is out of reach or singular.
            ConfigurationError: an argument has the wrong shape or is not finite.
        """
        state = self._state(space, at, None)
        return self._evaluated("mass_matrix", space, state, (), PLAIN)

    def bias(
        self,
        at: ArrayLike,
        rates: ArrayLike,
        wrench: Wrench = None,
        gravity: ArrayLike | None = None,
        space: Space = "platform",
    ) -> Array:
        """Forces along y that a motion with ẏ = 0 takes, (*batch, independent), N and N m.

        Coriolis and centrifugal forces, gravity and given wrenches.

        Args:
            at: operational coordinates in platform space, a configuration in joint space.
            rates: ẋ in platform space, rates of `independent` in joint space.
            wrench: as for `inverse`.
            gravity: as for `inverse`.
            space: whose rates y are.
        """
        inputs, loads = self._loads(wrench, gravity)
        state = self._state(space, at, rates)
        return self._evaluated("bias", space, state, (state.y, *loads), inputs)

    def gravity_load(
        self,
        at: ArrayLike,
        wrench: Wrench = None,
        gravity: ArrayLike | None = None,
        space: Space = "platform",
    ) -> Array:
        """Forces along y that hold the mechanism at rest, (*batch, independent); see `bias`."""
        inputs, loads = self._loads(wrench, gravity)
        state = self._state(space, at, None)
        return self._evaluated("gravity_load", space, state, loads, inputs)

    def energy(
        self,
        at: ArrayLike,
        rates: ArrayLike,
        gravity: ArrayLike | None = None,
        space: Space = "platform",
    ) -> tuple[Array, Array]:
        """Kinetic energy, and potential energy -Σ m g·x from the base's origin, J: (*batch)."""
        inputs, loads = self._loads(None, gravity)
        state = self._state(space, at, rates)
        found = self._evaluated("energy", space, state, (state.y, *loads), inputs)
        return found[..., 0], found[..., 1]

    def motor_jacobian(self, at: ArrayLike, space: Space = "platform") -> Array:
        """J with q̇_a = J y: efforts τ give the forces Jᵀ τ, (*batch, motors, independent)."""
        state = self._state(space, at, None)
        return self._evaluated("motor_jacobian", space, state, (), PLAIN)

    def reached(self, x: ArrayLike) -> Array:
        """Configurations for operational coordinates, (*batch, positions).

        Raises:
            SingularError: a row is out of reach.
        """
        assert self.inverse_geometry is not None
        found = self.inverse_geometry.solve(x)
        missed = np.flatnonzero(~found.reached.ravel()).tolist()
        if missed:
            reasons = [found.reasons[k] for k in missed]
            raise SingularError(found.reached.size, missed, reasons)
        return found.q

    def motion(
        self, at: ArrayLike, rates: ArrayLike, accelerations: ArrayLike, space: Space = "platform"
    ) -> tuple[Array, Array, Array]:
        """A motion in full: q, all rates v and all accelerations v̇ of the tree, (*batch, ·)."""
        if space == "platform":
            assert self.inverse_geometry is not None
            first = self._platform_state(at, rates, accelerations, None)
            model = self.model(space)
            plain = list(model.independent) == self.structure.columns("operational")
            state = (
                first if first.place == "q" else self._by_configuration(model, first, None, plain)
            )
        else:
            state = self._joint_state(at, rates, accelerations)
        self._require_sound(state)
        take = (state.at, *self._parameters, state.y)
        v = self.model(space).kernel("rates", "q")(*take)
        vd = self.model(space).kernel("accelerations", "q")(*take, state.yd)  # type: ignore[arg-type]
        return state.at, v, vd

    def _state(self, space: Space, at: ArrayLike, rates: ArrayLike | None) -> _State:
        if space not in ("platform", "joint"):
            raise UnknownName("space", str(space), ("platform", "joint"))
        if space == "platform":
            still = np.zeros(len(self.structure.columns("operational")))
            return self._platform_state(at, still if rates is None else rates, None, None)
        still = np.zeros(len(self.independent("joint")))
        return self._joint_state(at, still if rates is None else rates, None)

    def _evaluated(
        self, name: str, space: Space, state: _State, more: Sequence[Array], inputs: Inputs
    ) -> Array:
        """A model that has no ending of its own, where every row is sound."""
        self._require_sound(state)
        kernel = self.model(space).kernel(name, state.place, inputs)
        found = kernel(state.at, *self._parameters, *more)
        width = len(kernel.shape)
        lost = ~np.isfinite(found).all(axis=tuple(range(-width, 0)))
        if np.any(lost):
            rows = np.flatnonzero(lost.ravel()).tolist()
            missing = self._missing(state.at, lost.shape, rows) if state.place == "x" else ()
            reasons = [text or Ending.singular.value for text in missing]
            reasons = reasons or [Ending.singular.value] * len(rows)
            raise SingularError(lost.size, rows, reasons)
        return found

    def _require_sound(self, state: _State) -> None:
        rows = np.flatnonzero(state.codes.ravel()).tolist()
        if rows:
            flat = state.codes.ravel()
            reasons = [state.reasons.get(k, ENDINGS[flat[k]].value) for k in rows]
            raise SingularError(state.codes.size, rows, reasons)

    # both

    def _inverse(
        self,
        space: Space,
        state: _State,
        wrench: Wrench,
        gravity: ArrayLike | None,
        weights: ArrayLike | None,
    ) -> InverseDynamics:
        model = self.model(space)
        if not model.actuated:
            raise ConfigurationError(
                f"{self.structure.mechanism.name} has no motors; make joints actuated"
            )
        inputs, loads = self._loads(wrench, gravity)
        rates = (np.nan_to_num(state.y), np.nan_to_num(state.yd))  # type: ignore[arg-type]
        take = (state.at, *self._parameters, *rates, *loads)
        simple = model.motors_rank == min(len(model.actuated), len(model.independent))
        if simple and weights is None:
            found = model.kernel("inverse", state.place, inputs)(*take)
            efforts, regularity = found[..., :-1], found[..., -1]
        else:
            efforts, regularity = self._shared(model, state.place, inputs, take, weights)
        residual, null = self._rest(model, state.place, inputs, take, efforts)
        codes, reasons = self._ended(state, regularity)
        sound = (codes == 0)[..., None]
        return InverseDynamics(
            codes,
            regularity,
            reasons,
            np.where(sound, efforts, np.nan),
            np.where(sound, residual, np.nan),
            null,
            self.motors,
            self.independent(space),
        )

    def _shared(
        self,
        model: Model,
        place: Place,
        inputs: Inputs,
        take: Sequence[Array],
        weights: ArrayLike | None,
    ) -> tuple[Array, Array]:
        """Efforts by weights, or where motors neither give all forces nor are independent."""
        count = len(model.actuated)
        given = np.ones(count) if weights is None else np.asarray(weights, dtype=float)
        if given.shape != (count,) or not np.all(np.isfinite(given)) or np.any(given <= 0):
            raise ConfigurationError(
                f"weights have shape {given.shape}, expected ({count},), positive: "
                + ", ".join(self.motors)
            )
        W = model.kernel("forces", place, inputs)(*take)
        JT = np.swapaxes(self._motor_jacobian(model, place, take), -1, -2)
        U, s, Vt = np.linalg.svd(JT * given, full_matrices=False)
        rank = model.motors_rank
        part = np.einsum("...ik,...i->...k", U[..., :rank], W) / s[..., :rank]
        efforts = given * np.einsum("...kj,...k->...j", Vt[..., :rank, :], part)
        return efforts, s[..., rank - 1] / s[..., 0]

    def _motor_jacobian(self, model: Model, place: Place, take: Sequence[Array]) -> Array:
        n = 1 + len(self._parameters)
        return model.kernel("motor_jacobian", place)(*take[:n])

    def _rest(
        self, model: Model, place: Place, inputs: Inputs, take: Sequence[Array], efforts: Array
    ) -> tuple[Array, Array]:
        """What efforts do not give, and what only tightens the mechanism."""
        batch, motors, count = efforts.shape[:-1], len(model.actuated), len(model.independent)
        if motors == count == model.motors_rank:
            return np.zeros((*batch, count)), np.zeros((*batch, motors, 0))
        J = self._motor_jacobian(model, place, take)
        W = model.kernel("forces", place, inputs)(*take)
        residual = W - np.einsum("...ki,...k->...i", J, efforts)
        U = np.linalg.svd(J)[0]
        return residual, U[..., model.motors_rank :]

    def _direct(
        self,
        space: Space,
        state: _State,
        tau: ArrayLike,
        wrench: Wrench,
        gravity: ArrayLike | None,
    ) -> DirectDynamics:
        model = self.model(space)
        tau = _numbers("tau", tau, len(self.motors), self.motors)
        inputs, loads = self._loads(wrench, gravity)
        batch = np.broadcast_shapes(state.codes.shape, tau.shape[:-1])
        finite = np.isfinite(tau).all(-1)
        codes = np.where((state.codes == 0) & ~finite, _NOT_FINITE, state.codes)
        state = _State(
            state.place, state.at, state.y, None, np.broadcast_to(codes, batch), state.reasons
        )
        take = state.at, *self._parameters, np.nan_to_num(state.y), np.nan_to_num(tau)
        found = model.kernel("direct", state.place, inputs)(*take, *loads)
        codes, reasons = self._ended(state, found[..., -1])
        rows = np.where((codes == 0)[..., None], found[..., :-1], np.nan)
        return DirectDynamics(codes, found[..., -1], reasons, rows, self.independent(space))

    def _ended(self, state: _State, regularity: Array) -> tuple[NDArray[np.int8], tuple[str, ...]]:
        """The ending of every row, and its reason in words."""
        codes = np.broadcast_to(state.codes, regularity.shape).astype(np.int8)
        flat, found = codes.reshape(-1), regularity.reshape(-1)
        flat[(flat == 0) & ~(found >= LIMIT)] = _SINGULAR
        reasons = [""] * flat.size
        for k in np.flatnonzero(flat).tolist():
            reasons[k] = state.reasons.get(k, ENDINGS[flat[k]].value)
            if flat[k] == _SINGULAR:
                reasons[k] += f" (regularity {found[k]:.1e}, at least {LIMIT:g} is asked for)"
        if state.place == "x":  # where no number came out the pose may be out of reach
            rows = np.flatnonzero((flat == _SINGULAR) & ~(found >= 0)).tolist()
            for k, missing in zip(rows, self._missing(state.at, codes.shape, rows), strict=True):
                if missing:
                    flat[k], reasons[k] = _OUT_OF_REACH, missing
        return flat.reshape(codes.shape), tuple(reasons)

    def _missing(self, x: Array, batch: tuple[int, ...], rows: list[int]) -> Sequence[str]:
        """What keeps rows of a flattened batch of poses from being reached, "" where nothing."""
        if not rows:
            return ()
        assert self.inverse_geometry is not None
        poses = np.broadcast_to(x, (*batch, x.shape[-1])).reshape(-1, x.shape[-1])[rows]
        return self.inverse_geometry.solve(poses).reasons

    @staticmethod
    def require(solution: Solution) -> Solution:
        """The same if every row has an answer.

        Raises:
            SingularError: the first row without, and why.
        """
        missed = np.flatnonzero(~solution.solved.ravel())
        if missed.size:
            reasons = [solution.reasons[k] for k in missed]
            raise SingularError(solution.ending.size, missed.tolist(), reasons)
        return solution

    def _loads(self, wrench: Wrench, gravity: ArrayLike | None) -> tuple[Inputs, tuple[Array, ...]]:
        """What is given besides the state: its kind and its numbers."""
        arrays: list[Array] = []
        bodies: tuple[str, ...] = ()
        if gravity is not None:
            arrays.append(_finite("gravity", _numbers("gravity", gravity, 3, "xyz")))
        if wrench is not None:
            by_body = wrench if isinstance(wrench, Mapping) else {self._platform(): wrench}
            known = self.structure.flat.bodies
            for body in by_body:
                if body not in known:
                    raise UnknownName("body", body, known)
            bodies = tuple(by_body)
            names = ("fx", "fy", "fz", "mx", "my", "mz")
            parts = [
                _finite("wrench", _numbers("wrench", value, 6, names)) for value in by_body.values()
            ]
            batch = np.broadcast_shapes(*(part.shape[:-1] for part in parts))
            parts = [np.broadcast_to(part, (*batch, 6)) for part in parts]
            arrays.append(np.concatenate(parts, axis=-1))
        return Inputs(gravity is not None, bodies), tuple(arrays)

    def _platform(self) -> str:
        platform = self.structure.mechanism.platform
        if platform is None:
            raise ConfigurationError(
                f"{self.structure.mechanism.name} has no platform; give wrenches by body: "
                "{name: wrench}"
            )
        return platform


class _State:
    """Rows of a batch before they are solved."""

    def __init__(
        self,
        place: Place,
        at: Array,
        y: Array,
        yd: Array | None,
        codes: NDArray[Any],
        reasons: dict[int, str],
    ) -> None:
        self.place, self.at, self.y, self.yd = place, at, y, yd
        self.codes, self.reasons = codes, reasons


_SINGULAR, _OUT_OF_REACH, _NOT_FINITE, _NO_MOTION = (
    ENDINGS.index(ending)
    for ending in (Ending.singular, Ending.out_of_reach, Ending.not_finite, Ending.no_motion)
)


def _quickly(
    kernel: Kernel, p: tuple[Array, ...], x: ArrayLike, y: ArrayLike, given: ArrayLike
) -> Array | None:
    """Results without the regularity that stands last, or None if that is too low somewhere."""
    single = kernel.single
    try:
        if single is None or p or type(x) is not np.ndarray or x.ndim != 1:
            found = kernel(x, *p, y, given)
        else:
            found = single(x, y, given)
    except (TypeError, ValueError):
        return None
    if found.ndim == 1:
        return found[:-1] if found[-1] >= LIMIT else None
    return found[..., :-1] if np.all(found[..., -1] >= LIMIT) else None


def _numbers(name: str, given: ArrayLike, width: int, parts: Sequence[str]) -> Array:
    """An argument as numbers, (*batch, width)."""
    listed = f": {', '.join(parts)}" if len(parts) else ""
    try:
        values = np.asarray(given, dtype=float)
    except (TypeError, ValueError):
        raise ConfigurationError(f"{name} is {given!r}, expected numbers{listed}") from None
    if values.ndim == 0 or values.shape[-1] != width:
        raise ConfigurationError(
            f"{name} has shape {values.shape}, expected (..., {width}){listed}"
        )
    return values


def _finite(name: str, values: Array) -> Array:
    if not np.all(np.isfinite(values)):
        raise ConfigurationError(f"{name} has entries that are not finite")
    return values


def _batch(arrays: Mapping[str, Array]) -> tuple[int, ...]:
    """The common leading axes."""
    try:
        return np.broadcast_shapes(*(a.shape[:-1] for a in arrays.values()))
    except ValueError:
        shapes = ", ".join(f"{name} {a.shape}" for name, a in arrays.items())
        raise ConfigurationError(f"the batches do not go together: {shapes}") from None
