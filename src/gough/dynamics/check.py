"""Proof by laws: the models of a robot against Lagrange's equations of its bodies, and themselves.

Lagrange's equations of the tree come from the poses of the bodies by automatic differentiation and
share no step with the models. Rates v and accelerations v̇ of the tree are first seen to obey the
closure equations; then forces along the independent rates y are Gᵀ τ, with v = G y.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import casadi
import numpy as np
from numpy.typing import NDArray

from gough.dynamics.dynamics import LIMIT, Dynamics
from gough.dynamics.model import Model, Space
from gough.errors import ConfigurationError, GoughError
from gough.geometry.inverse import InverseGeometry
from gough.symbolic.lagrange import Lagrange

Array = NDArray[np.float64]
SX = casadi.SX

AGREED = 1e-9
"""Largest relative difference that passes."""
REACH = 0.1
"""How far from home states are, as for `Assembler.wander`; a guess at what stays regular."""
TRIES = 10
"""Walks for each state that is asked for."""
FAR = 1e-3
"""Regularity above which direct dynamics are compared: below, digits are lost on the way."""


@dataclass(frozen=True)
class Law:
    """One law, and how far the models are from it."""

    name: str
    space: Space
    difference: float
    """The largest, as a part of the terms that it is made of; NaN where no state was tried."""
    states: int
    """In how many states it was tried."""

    @property
    def holds(self) -> bool:
        """Whether it held in every state in which it was tried."""
        return self.states == 0 or self.difference <= AGREED


@dataclass(frozen=True)
class DynamicsCheck:
    """Laws of dynamics at random closed states of one robot."""

    mechanism: str
    laws: tuple[Law, ...]
    states: int
    seed: int

    @property
    def passed(self) -> bool:
        """Whether every law holds."""
        return all(law.holds for law in self.laws)

    @property
    def worst(self) -> float:
        """The largest difference of all laws that were tried."""
        return max((law.difference for law in self.laws if law.states), default=0.0)

    def as_dict(self) -> dict[str, Any]:
        """The content as plain data."""
        return {
            "mechanism": self.mechanism,
            "passed": self.passed,
            "states": self.states,
            "seed": self.seed,
            "threshold": AGREED,
            "laws": [
                {
                    "name": law.name,
                    "space": law.space,
                    "states": law.states,
                    "difference": law.difference if np.isfinite(law.difference) else None,
                    "holds": law.holds,
                }
                for law in self.laws
            ],
        }

    def __str__(self) -> str:
        verdict = "every law holds" if self.passed else "a law is broken"
        lines = [
            f"{self.mechanism}: {verdict} (seed {self.seed}; differences by size of the terms, "
            f"at most {AGREED:g})"
        ]
        width = max((len(law.name) for law in self.laws), default=0)
        for law in self.laws:
            word = "holds" if law.holds else "BROKEN"
            found = f"{law.difference:8.1e}  {word}" if law.states else "       -  no state"
            lines.append(f"  {law.space:8}  {law.name:{width}}  {law.states:4} states  {found}")
        return "\n".join(lines)


def check_dynamics(
    dynamics: Dynamics, states: int = 20, seed: int = 0, space: Space | None = None
) -> DynamicsCheck:
    """Try the laws of dynamics at random closed states near home.

    Args:
        dynamics: the robot's.
        states: how many.
        seed: of the states.
        space: whose models are tried; those of both spaces by default, where there are outputs.

    Raises:
        ConfigurationError: too few closed states were found, or ``states`` is not positive.
    """
    if states < 1:
        raise ConfigurationError(f"states is {states!r}, expected at least 1")
    spaces: list[Space] = ["platform", "joint"] if space is None else [space]
    if space is None and not dynamics.structure.columns("operational"):
        spaces = ["joint"]
    truth, laws = _Truth(dynamics), []
    for each in spaces:
        laws += _Trial(dynamics, each, truth, states, seed).laws()
    return DynamicsCheck(dynamics.structure.mechanism.name, tuple(laws), states, seed)


class _Truth:
    """Closure and Lagrange's equations of the tree, by automatic differentiation.

    Attributes:
        function: of (q, p, v, v̇) columns, by name: E v and its rate, the size of either by rows,
            forces of the tree, kinetic and potential energy, the rate of their sum and its parts.
    """

    def __init__(self, dynamics: Dynamics) -> None:
        closure, model = dynamics.models.closure, dynamics.model("joint")
        self.p = dynamics.assembler.p
        count = len(dynamics.structure.variables)
        v, vd = SX.sym("v", count), SX.sym("vd", count)
        gravity, lagrange = SX(casadi.vertcat(*model.gravity)), Lagrange(closure)
        kinetic, forces = lagrange.kinetic(v), lagrange.forces(v, vd, gravity)
        for k, rotor in model.rotors.items():
            kinetic += rotor * v[k] ** 2 / 2
            forces[k] += rotor * vd[k]
        potential, flow = lagrange.potential(gravity), closure.position_rates @ v
        gap, E = closure.jacobian @ v, closure.jacobian
        turning = casadi.jtimes(gap, closure.q, flow)
        energies = casadi.vertcat(kinetic, potential)
        parts = [casadi.jtimes(energies, closure.q, flow), casadi.jtimes(kinetic, v, vd)]
        named = {
            "gap": gap,
            "gap_size": casadi.fabs(E) @ casadi.fabs(v),
            "second": E @ vd + turning,
            "second_size": casadi.fabs(E) @ casadi.fabs(vd) + casadi.fabs(turning),
            "forces": forces,
            "energies": energies,
            "power": casadi.vertcat(*parts),
        }
        outputs = [casadi.densify(x) for x in named.values()]
        self._names = list(named)
        self._function = casadi.Function("laws", [closure.q, closure.p, v, vd], outputs)

    def at(self, q: Array, v: Array, vd: Array) -> Mapping[str, Array]:
        """All of them, (states, ·)."""
        rows = [self._function(*x) for x in zip(q, [self.p] * len(q), v, vd, strict=True)]
        columns = zip(*rows, strict=True)
        found = [np.array([np.array(x).ravel() for x in column]) for column in columns]
        return dict(zip(self._names, found, strict=True))


class _Trial:
    """The models of one space at some states."""

    def __init__(
        self, dynamics: Dynamics, space: Space, truth: _Truth, states: int, seed: int
    ) -> None:
        self.dynamics, self.space = dynamics, space
        self.model: Model = dynamics.model(space)
        self._p = (dynamics.assembler.p,) if dynamics.assembler.p.size else ()
        self.rng = np.random.default_rng(seed)
        y = list(self.model.independent)
        self.x, self.q = self._states(states)
        self.y, self.yd = self.rng.normal(size=(2, len(self.q), len(y)))
        self.scale = dynamics.assembler.rate_scale[y]
        self.y, self.yd = self.y * self.scale, self.yd * self.scale
        self.v = self._kernel("rates", self.y)
        self.vd = self._kernel("accelerations", self.y, self.yd)
        units = np.eye(len(y))
        self.G = np.stack([self._kernel("rates", e + 0 * self.y) for e in units], axis=-1)
        self.truth = truth.at(self.q, self.v, self.vd)
        self.forces = self._kernel("forces", self.y, self.yd)
        found = self.truth["forces"][..., None]
        self.lagrange = np.sum(self.G * found, axis=-2)
        self.size = np.abs(self.G * found).sum(axis=-2)

    def _kernel(self, name: str, *more: Array) -> Array:
        return self.model.kernel(name, "q")(self.q, *self._p, *more)

    # states

    def _states(self, count: int) -> tuple[Array | None, Array]:
        """Closed configurations near home, and in platform space outputs that lead to them."""
        dynamics, found = self.dynamics, []
        inverse = dynamics.inverse_geometry if self.space == "platform" else None
        for _ in range(TRIES * count):
            q = dynamics.assembler.wander(dynamics.home, self.rng, self.rng.uniform(0.2, 1) * REACH)
            state = None if q is None else self._placed(inverse, q)
            if state is not None:
                found.append(state)
            if len(found) == count:
                break
        else:
            raise ConfigurationError(
                f"{dynamics.structure.mechanism.name}: {len(found)} of {count} closed states found"
            )
        x = None if inverse is None else np.array([x for x, _ in found])
        return x, np.array([q for _, q in found])

    def _placed(self, inverse: InverseGeometry | None, q: Array) -> tuple[Array, Array] | None:
        """Outputs of a configuration, and the configuration that they lead back to."""
        if inverse is None:
            return np.zeros(0), q
        x, still = inverse.coordinates.of(q), self.dynamics.structure.columns("operational")
        try:
            return x, self.dynamics.motion(x, np.zeros(len(still)), np.zeros(len(still)))[0]
        except GoughError:
            return None

    # laws

    def laws(self) -> list[Law]:
        """Every law that applies."""
        truth = self.truth
        found = [
            self._law("rates obey the closure", truth["gap"], truth["gap_size"]),
            self._law("accelerations obey the closure", truth["second"], truth["second_size"]),
            self._law(
                "forces are Lagrange's",
                (self.forces - self.lagrange) * self.scale,
                self.size * self.scale,
            ),
            *self._of_matrix(),
            *self._of_energy(),
        ]
        if self.x is not None and "x" in self.model.places:
            found.append(self._by_outputs(self.x))
        return [*found, *self._of_inverse()]

    def _law(self, name: str, differences: Array, sizes: Array) -> Law:
        """Differences by the largest size in their row."""
        rows = np.abs(differences).max(axis=-1, initial=0.0)
        size = np.abs(sizes).max(axis=-1, initial=0.0)
        parts = rows / np.where(size > 0, size, 1.0)
        largest = float(np.max(parts)) if len(parts) else float("nan")
        return Law(name, self.space, largest, len(parts))

    def _of_matrix(self) -> list[Law]:
        """A is symmetric, has no negative eigenvalue, and gives the forces with the bias."""
        A = self._kernel("mass_matrix") * self.scale[:, None] * self.scale
        h, yd = self._kernel("bias", self.y) * self.scale, self.yd / self.scale
        flat = A.reshape(len(A), -1)
        odd = (A - np.swapaxes(A, -1, -2)).reshape(len(A), -1)
        lowest = np.minimum(np.linalg.eigvalsh(A)[:, :1], 0.0)
        terms = np.einsum("nij,nj->ni", A, yd)
        parts = np.einsum("nij,nj->ni", np.abs(A), np.abs(yd)) + np.abs(h)
        return [
            self._law("A ẏ + bias = forces", terms + h - self.forces * self.scale, parts),
            self._law("A is symmetric", odd, flat),
            self._law("A is positive", lowest, flat),
        ]

    def _of_energy(self) -> list[Law]:
        """Energy is Lagrange's, its potential part but for a constant; power is its rate."""
        found, expected = self._kernel("energy", self.y), self.truth["energies"]
        kinetic = (found - expected)[:, :1]
        change = found[:, 1:] - expected[:, 1:]
        change = change - change[:1]
        size = np.abs(found[:, 1:]) + np.abs(expected[:, 1:])
        parts = self.truth["power"]
        power = np.sum(self.y * self.forces, axis=-1) - parts.sum(axis=-1)
        sizes = np.sum(np.abs(self.y) * self.size, axis=-1) + np.abs(parts).sum(axis=-1)
        return [
            self._law("kinetic energy is Lagrange's", kinetic, expected[:, :1]),
            self._law("potential energy is Lagrange's", change, size),
            self._law("power is the rate of energy", power[:, None], sizes[:, None]),
        ]

    def _by_outputs(self, x: Array) -> Law:
        """The model that is placed by outputs gives the same forces."""
        kernel = self.model.kernel("forces", "x")
        given = kernel(x, *self._p, self.y, self.yd)
        difference = (given - self.forces) * self.scale
        return self._law("closed forms give the same", difference, self.size * self.scale)

    def _of_inverse(self) -> list[Law]:
        """Direct and inverse dynamics undo each other, one way where motors are too few."""
        model = self.model
        motors, count = len(model.actuated), len(model.independent)
        rank = model.motors_rank if motors else 0
        laws = []
        if rank == count:
            laws.append(self._direct_of_inverse())
        if motors and rank == motors:
            laws.append(self._inverse_of_direct())
        return laws

    def _efforts(self, forces: Array, J: Array) -> Array:
        """Smallest τ with Jᵀ τ = forces, as near as can be."""
        JT = np.swapaxes(J, -1, -2)
        return np.asarray(np.linalg.pinv(JT) @ forces[..., None])[..., 0]

    def _regular(self, J: Array) -> Any:
        """States far from singularities of type 2."""
        rows = self.dynamics.assembler.rate_scale[self.model.actuated]
        s = np.linalg.svd(J / rows[:, None] * self.scale, compute_uv=False)
        return s[..., -1] > FAR * s[..., 0]

    def _direct_of_inverse(self) -> Law:
        """ẏ found again from the efforts that it takes."""
        J, name = self._kernel("motor_jacobian"), "direct(inverse(ẏ)) = ẏ"
        kept = self._regular(J)
        if self._simple:
            tau = self._kernel("inverse", self.y, self.yd)
            kept, tau = kept & (tau[..., -1] > LIMIT), tau[..., :-1]
        else:
            tau = self._efforts(self.forces, J)
        found = self._kernel("direct", self.y, tau)
        kept = kept & (found[..., -1] > LIMIT)
        difference = (found[..., :-1] - self.yd) / self.scale
        return self._law(name, difference[kept], self._accelerations_size()[kept])

    def _accelerations_size(self) -> Array:
        """Terms that ẏ is the difference of: A⁻¹ of the parts of the forces."""
        A = self._kernel("mass_matrix") * self.scale[:, None] * self.scale
        inverse = np.linalg.pinv(A, hermitian=True)
        parts = np.einsum("nij,nj->ni", np.abs(inverse), self.size * self.scale)
        return np.asarray(parts + np.abs(self.yd / self.scale))

    def _inverse_of_direct(self) -> Law:
        """Efforts found again from the accelerations that they give."""
        J, name = self._kernel("motor_jacobian"), "inverse(direct(τ)) = τ"
        size = np.abs(self._efforts(self.size, J)).max(axis=-1, keepdims=True)
        tau = self.rng.normal(size=J.shape[:-1]) * np.where(size > 0, size, 1.0)
        moved = self._kernel("direct", self.y, tau)
        kept = self._regular(J) & (moved[..., -1] > LIMIT)
        forces = self._kernel("forces", self.y, np.where(kept[:, None], moved[..., :-1], 0.0))
        if self._simple:
            yd = np.where(kept[:, None], moved[..., :-1], 0.0)
            back = self._kernel("inverse", self.y, yd)[..., :-1]
        else:
            back = self._efforts(forces, J)
        parts = np.abs(tau) + self._efforts_size(forces, J)
        return self._law(name, (back - tau)[kept], parts[kept])

    def _efforts_size(self, forces: Array, J: Array) -> Array:
        inverse = np.abs(np.linalg.pinv(np.swapaxes(J, -1, -2)))
        return np.asarray(inverse @ (np.abs(forces) + self.size)[..., None])[..., 0]

    @property
    def _simple(self) -> bool:
        """Whether there is a kernel of inverse dynamics."""
        model = self.model
        least = min(len(model.actuated), len(model.independent))
        return least > 0 and model.motors_rank == least
