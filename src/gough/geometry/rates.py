"""Velocities, accelerations, Jacobians and their measures over batches of configurations."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gough.assembly import Assembler
from gough.errors import ConfigurationError, UnknownName
from gough.geometry.rate_maps import RateMap
from gough.geometry.samples import Sampled, sample
from gough.models import Models
from gough.symbolic.plans import Kind, independent
from gough.topology import Chain, Role

Array = NDArray[np.float64]

OPEN = 1e-6
"""Scaled closure residual above which a configuration is refused as open; a guess."""
SINGULAR = 1e-9
"""Regularity of a block below which it counts as singular; the threshold of all ranks."""
EXACT = 1e-8
"""Relative residual of E v = 0 up to which rates obey the closure; a guess."""


class Kinematics:
    """Velocities and accelerations of one mechanism, over batches of closed configurations.

    Rates are in m/s and rad/s. With all six freedoms of the platform operational, ẋ is its twist
    (linear at its origin, angular) in base axes; with fewer, the rates of the outputs. All
    functions take q, (*batch, positions), closed and of the assembly of home, and refuse what is
    open or singular with the index of the first such row.

    Args:
        models: the mechanism.
        assembler: what closes its loops, with its live parameters.
        home: a closed configuration; found by the assembler by default.
        seed: of the configurations from which the structure of the equations is read.

    Attributes:
        length: characteristic length, m, that lengths are divided by where they meet angles.

    Raises:
        ClosureError: the loops do not close.
    """

    def __init__(
        self, models: Models, assembler: Assembler, home: Array | None = None, seed: int = 0
    ) -> None:
        self.models, self.assembler, self.length = models, assembler, assembler.length
        self.home = assembler.home().require().q if home is None else home
        self.seed = seed
        self._leg_maps: dict[str, RateMap] = {}

    # maps

    @cached_property
    def _sampled(self) -> Sampled:
        return sample(self.assembler, self.home, self.seed)

    @cached_property
    def from_operational(self) -> RateMap:
        """All rates from those of the outputs, ẋ.

        Raises:
            ConfigurationError: the mechanism has no outputs.
        """
        return self._map("operational", "actuated", "outputs", "from_actuated")

    @cached_property
    def from_actuated(self) -> RateMap:
        """All rates from those of the motors, q̇_a.

        Raises:
            ConfigurationError: the mechanism has no motors.
        """
        return self._map("actuated", "operational", "motors", "from_operational")

    def _map(self, given: Role, last: Role, what: str, other: str) -> RateMap:
        structure = self.models.structure
        columns = structure.columns(given)
        if not columns:
            raise ConfigurationError(
                f"{structure.mechanism.name} has no {what}; declare some or use {other}"
            )
        return RateMap(self.models, self._sampled, columns, structure.columns(last))

    # rates

    def velocity(self, q: ArrayLike, xd: ArrayLike) -> Array:
        """All rates v for output rates ẋ.

        Args:
            q: closed configurations, (*batch, positions).
            xd: output rates, (*batch, outputs), m/s and rad/s.

        Returns:
            (*batch, variables), m/s and rad/s, in the order of ``structure.variables``.

        Raises:
            ConfigurationError: a row is open, singular, or no motion has these output rates.
        """
        return self._velocity(self.from_operational, q, xd)

    def velocity_from_actuated(self, q: ArrayLike, qd: ArrayLike) -> Array:
        """All rates v for motor rates q̇_a, (*batch, actuated); see `velocity`."""
        return self._velocity(self.from_actuated, q, qd)

    def acceleration(self, q: ArrayLike, xd: ArrayLike, xdd: ArrayLike) -> Array:
        """All accelerations v̇ for output rates ẋ and accelerations ẍ.

        With six outputs ẍ is the acceleration of the platform's origin and its angular
        acceleration, in base axes.

        Args:
            q: closed configurations, (*batch, positions).
            xd: output rates, (*batch, outputs), m/s and rad/s.
            xdd: output accelerations, (*batch, outputs), m/s² and rad/s².

        Returns:
            (*batch, variables), m/s² and rad/s².

        Raises:
            ConfigurationError: as for `velocity`.
        """
        found = self.from_operational
        return self._acceleration(found, q, self._velocity(found, q, xd), xdd)

    def acceleration_from_actuated(self, q: ArrayLike, qd: ArrayLike, qdd: ArrayLike) -> Array:
        """All accelerations v̇ for motor rates and accelerations; see `acceleration`."""
        found = self.from_actuated
        return self._acceleration(found, q, self._velocity(found, q, qd), qdd)

    def _velocity(self, found: RateMap, q: ArrayLike, y: ArrayLike) -> Array:
        q, y = np.asarray(q, dtype=float), np.asarray(y, dtype=float)
        self._require_regular(found, q)
        v = found.rates(q, self.assembler.p, y)
        E = self._scaled_jacobian(q)
        gap = np.abs(np.einsum("...ij,...j->...i", E, v / self.assembler.rate_scale))
        size = np.abs(E).max(axis=(-2, -1), initial=0.0) * np.abs(
            v / self.assembler.rate_scale
        ).max(axis=-1, initial=0.0)
        self._require_obeyed(gap.max(axis=-1, initial=0.0) <= EXACT * size)
        return v

    def _acceleration(self, found: RateMap, q: ArrayLike, v: Array, yd: ArrayLike) -> Array:
        return found.accelerations(q, self.assembler.p, v, yd)

    # Jacobians

    def inverse_jacobian(self, q: ArrayLike) -> Array:
        """J⁻¹ with q̇_a = J⁻¹ ẋ, (*batch, actuated, outputs), SI units.

        The smallest motor rates where there are several (kinematic redundancy), least squares
        where ẋ must obey conditions; see ``from_operational.unique`` and ``.restricted``.

        Raises:
            ConfigurationError: a row is open or singular; there are no outputs.
        """
        return self._rows(self.from_operational, q, self._columns("actuated"))

    def jacobian(self, q: ArrayLike) -> Array:
        """J with ẋ = J q̇_a, (*batch, outputs, actuated), SI units.

        Least squares where motors must be synchronised (actuation redundancy), the smallest ẋ
        where motors do not determine it; see ``from_actuated.restricted`` and ``.unique``.

        Raises:
            ConfigurationError: a row is open or singular; there are no motors.
        """
        return self._rows(self.from_actuated, q, self._columns("operational"))

    def leg_variables(self, leg: str) -> tuple[str, ...]:
        """Names of the rates of a leg that no constant relation binds, from base to platform."""
        variables = self.models.structure.variables
        return tuple(variables[k].name for k in self._leg_columns(self._leg(leg)))

    def inverse_leg_jacobian(self, q: ArrayLike, leg: str) -> Array:
        """Rates of `leg_variables` from output rates, (*batch, leg variables, outputs)."""
        return self._rows(self.from_operational, q, self._leg_columns(self._leg(leg)))

    def leg_jacobian(self, q: ArrayLike, leg: str) -> Array:
        """Output rates from rates of `leg_variables`, (*batch, outputs, leg variables).

        Raises:
            ConfigurationError: the leg has fewer independent rates than the platform outputs,
                so that they do not determine them; or a row is open or singular.
        """
        return self._rows(self._leg_map(leg), q, self._columns("operational"))

    def leg_bias(self, q: ArrayLike, v: ArrayLike, leg: str) -> Array:
        """J̇ q̇ of a leg: output accelerations at constant rates of the leg, (*batch, outputs).

        With J the leg Jacobian ẍ = J q̈ + J̇ q̇.

        Args:
            q: closed configurations, (*batch, positions).
            v: all rates, (*batch, variables).
            leg: name of the leg.
        """
        found = self._leg_map(leg)
        q = np.asarray(q, dtype=float)
        self._require_regular(found, q)
        zero = np.zeros(len(found.plan.inputs))
        return found.accelerations(q, self.assembler.p, v, zero)[..., self._columns("operational")]

    def _leg(self, name: str) -> Chain:
        legs = {leg.name: leg for leg in self.models.structure.legs}
        if name not in legs:
            raise UnknownName("leg", name, legs)
        return legs[name]

    def _leg_columns(self, leg: Chain) -> list[int]:
        structure = self.models.structure
        joints = set(leg.joints)
        own = [
            k
            for k, variable in enumerate(structure.variables)
            if structure.edges[variable.edge].name in joints
        ]
        limit = len(self._columns("operational"))
        return independent(self._sampled.E, own, limit)

    def _leg_map(self, name: str) -> RateMap:
        if name not in self._leg_maps:
            columns, outputs = self._leg_columns(self._leg(name)), self._columns("operational")
            if len(columns) != len(outputs) or not outputs:
                raise ConfigurationError(
                    f"{name} has {len(columns)} independent rates and the platform "
                    f"{len(outputs)} outputs: they do not determine each other; use "
                    "inverse_leg_jacobian"
                )
            found = RateMap(self.models, self._sampled, columns, outputs)
            if found.restricted or not found.unique:
                raise ConfigurationError(
                    f"the rates of {name} do not determine all others; use inverse_leg_jacobian"
                )
            self._leg_maps[name] = found
        return self._leg_maps[name]

    def _rows(self, found: RateMap, q: ArrayLike, variables: Sequence[int]) -> Array:
        q = np.asarray(q, dtype=float)
        self._require_regular(found, q)
        return found.rows(variables)(q, self.assembler.p)

    def _columns(self, role: Role) -> list[int]:
        return self.models.structure.columns(role)

    # measures

    def velocity_factors(self, q: ArrayLike) -> Array:
        """Singular values of J, ascending: (*batch, min(outputs, actuated)).

        Lengths are divided by ``length`` where outputs (or motors) mix translations and
        rotations. For a redundantly actuated robot J is the pseudo-inverse of J⁻¹. Infinite
        where the outputs move with the motors locked.

        Raises:
            ConfigurationError: a row is open or singular; there are no outputs or no motors.
        """
        inverse = self.from_operational
        if inverse.restricted or not inverse.unique:
            s = np.linalg.svd(self._comparable(self.jacobian(q)), compute_uv=False)
            return np.asarray(s[..., ::-1])
        J = self.inverse_jacobian(q).swapaxes(-1, -2)
        s = np.linalg.svd(self._comparable(J, inverted=True), compute_uv=False)
        with np.errstate(divide="ignore"):
            return np.asarray(1.0 / s)

    @property
    def factors(self) -> int:
        """How many `velocity_factors` there are."""
        return min(len(self._columns("operational")), len(self._columns("actuated")))

    @property
    def factor_unit(self) -> str:
        """Unit of the `velocity_factors`: 1, or m/rad or rad/m where neither side mixes units."""
        outputs, motors = (
            {self.models.structure.variables[k].unit for k in self._columns(role)}
            for role in ("operational", "actuated")
        )
        one, two = ("m" if unit == {"m"} else "rad" for unit in (outputs, motors))
        return "1" if one == two else f"{one}/{two}"

    def conditioning(self, q: ArrayLike) -> Array:
        """Largest over smallest of the `velocity_factors`: (*batch); infinite where one is 0."""
        factors = self.velocity_factors(q)
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio = factors[..., -1] / factors[..., 0]
        return np.where(np.isnan(ratio), np.inf, ratio)

    def manipulability(self, q: ArrayLike) -> Array:
        """√det(J Jᵀ), the product of the `velocity_factors`: (*batch)."""
        return np.asarray(self.velocity_factors(q).prod(axis=-1))

    def type_1(self, q: ArrayLike) -> Array:
        """Distance to a type 1 singularity, where outputs are lost: (*batch), 0 at one.

        The smallest singular value of A in A q̇_a + B ẋ = 0 over the largest of E, with lengths
        divided by ``length``.
        """
        return self._smallest(q, "actuated")

    def type_2(self, q: ArrayLike) -> Array:
        """Distance to a type 2 singularity, where outputs move with locked motors: (*batch).

        The same of B in A q̇_a + B ẋ = 0.
        """
        return self._smallest(q, "operational")

    def determinant_sign(self, q: ArrayLike) -> Array:
        """Sign of the determinant of the direct kinematics, 1 at home: (*batch), 1, -1 or 0.

        It changes where the outputs gain a motion with the motors locked (type 2), and where
        passive joints alone do, as where a leg points along the first axis of its universal joint.

        Raises:
            ConfigurationError: a row is open; the mechanism has no square direct kinematics.
        """
        found = self.from_actuated
        if any(block.kind is not Kind.unique for block in found.plan.blocks):
            raise ConfigurationError(
                f"{self.models.structure.mechanism.name} has no determinant: its motors do not "
                "determine all rates, or are more than that; use type_2"
            )
        q = np.asarray(q, dtype=float)
        self.require_closed(q)
        signs = [self._determinant_sign(found, at) for at in (q, self.home)]
        return np.asarray(signs[0] * signs[1])

    def _determinant_sign(self, found: RateMap, q: Array) -> Array:
        sign = np.ones(q.shape[:-1])
        for matrix in found.block_matrices(q, self.assembler.p):
            sign = sign * np.linalg.slogdet(matrix)[0]
        return sign

    def _smallest(self, q: ArrayLike, role: Role) -> Array:
        q = np.asarray(q, dtype=float)
        self.require_closed(q)
        E, passive, own = self._scaled_jacobian(q), self._columns("passive"), self._columns(role)
        sampled = self._sampled
        eliminated = sampled.rank(passive)
        kept = sampled.rank(passive + own) - eliminated
        if not kept:
            raise ConfigurationError(
                f"{self.models.structure.mechanism.name} has no {role} rates to measure"
            )
        U = np.linalg.svd(E[..., passive])[0] if passive else np.eye(E.shape[-2])
        A = U[..., eliminated:].swapaxes(-1, -2) @ E[..., own]
        s, largest = np.linalg.svd(A, compute_uv=False), np.linalg.norm(E, 2, axis=(-2, -1))
        return np.asarray(s[..., kept - 1] / largest)

    def _comparable(self, J: Array, inverted: bool = False) -> Array:
        """J, or the transpose of its inverse, with lengths divided where they meet angles."""
        outputs, motors = (
            self._unit(self._columns(role)) ** (-1.0 if inverted else 1.0)
            for role in ("operational", "actuated")
        )
        return np.asarray(J / outputs[:, None] * motors)

    def _unit(self, columns: Sequence[int]) -> Array:
        lengths = self.models.rate_is_length[list(columns)]
        mixed = 0 < lengths.sum() < len(lengths)
        return np.where(lengths > 0, self.length if mixed else 1.0, 1.0)

    # what is refused

    def regularity(self, q: ArrayLike) -> Array:
        """How far the passive joints are from where ẋ stops to determine rates: (*batch).

        The smallest singular value of the blocks that give all rates from output rates, over the
        size of their rows of E: between 0 (singular) and 1. Only open configurations are refused.
        """
        q = np.asarray(q, dtype=float)
        self.require_closed(q)
        return self.from_operational.regularity(q, self.assembler.p)

    def _scaled_jacobian(self, q: Array) -> Array:
        E = self.models.jacobian(q, self.assembler.p)
        return np.asarray(self.assembler.row_scale[:, None] * E * self.assembler.rate_scale)

    def require_closed(self, q: Array) -> None:
        """Raise if a row of configurations is open.

        Raises:
            ConfigurationError: the first such row and its gap.
        """
        F = np.abs(self.assembler.row_scale * self.models.residual(q, self.assembler.p))
        gap = F.max(axis=-1, initial=0.0)
        _refuse(
            ~(gap <= OPEN),
            lambda row: (
                f"is not closed: its largest scaled gap is {gap[row]:.3g}; close the loops first"
            ),
        )

    def _require_regular(self, found: RateMap, q: Array) -> None:
        self.require_closed(q)
        p = self.assembler.p
        measure = found.regularity(q, p)
        _refuse(
            ~(measure >= SINGULAR),
            lambda row: (
                f"is singular for {found.worst_block(q[row], p)} (regularity {measure[row]:.1e}): "
                "these rates do not follow from the given ones there"
            ),
        )

    def _require_obeyed(self, obeyed: NDArray[np.bool_]) -> None:
        _refuse(
            ~obeyed,
            lambda row: (
                "has no motion with the given rates: they break the closure equations, or "
                "the configuration belongs to another assembly than home"
            ),
        )


def _refuse(bad: NDArray[np.bool_], why: Callable[[tuple[int, ...]], str]) -> None:
    """Raise for the first bad row of a batch."""
    if not np.any(bad):
        return
    row = tuple(int(k) for k in np.argwhere(bad)[0])
    count = int(np.sum(bad))
    others = f" ({count} of {bad.size} rows are refused)" if count > 1 else ""
    name = f"row {', '.join(map(str, row))}" if row else "the configuration"
    raise ConfigurationError(f"{name} {why(row)}{others}")
