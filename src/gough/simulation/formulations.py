"""Which coordinates a run is computed in, and how states go from one choice to another.

Outputs are taken where they place the whole mechanism in closed form, since then there is nothing
to drift. Else a whole configuration is integrated with as many independent rates as there are
freedoms, and put back onto the closure equations as it drifts. Where a choice of independent rates
loses its regularity a better one is taken: rates of all joints are known, so nothing is lost.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import casadi
import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from gough.dynamics.dynamics import Dynamics
from gough.dynamics.model import Model
from gough.dynamics.writing import Place
from gough.kernels import Kernel
from gough.kernels.tiled import TiledKernel
from gough.numerics.integration import Constraints, Problem
from gough.simulation.equations import Equations, Setting
from gough.simulation.forces import has_position

Array = NDArray[np.float64]
SX = casadi.SX

GOOD = 0.3
"""Independent rates this good, in parts of the best, are kept; a guess."""
ABOUT, NOTHING = 0.25, 1e-3
"""How much changes of angles may differ from their mean rates, in parts and in rad; what differs
more is only looked at more slowly."""
WANTED = 0.5
"""Of the rates that are as independent as this, in parts of the best, motors are preferred."""


class Formulation:
    """Equations of motion in one choice of coordinates.

    Args:
        dynamics: of the mechanism.
        model: whose independent rates are taken.
        place: operational coordinates or a configuration.
        setting: what acts.
    """

    def __init__(self, dynamics: Dynamics, model: Model, place: Place, setting: Setting) -> None:
        self.dynamics, self.model, self.place = dynamics, model, place
        self.equations = Equations(model, place, setting)
        self.layout = self.equations.layout

    @property
    def independent(self) -> tuple[str, ...]:
        """Names of the independent rates."""
        variables = self.model.structure.variables
        return tuple(variables[k].name for k in self.model.independent)

    def problem(self, q: Array, breaks: Array, coefficients: Array) -> Problem:
        """What is integrated from near a configuration on."""
        equations = self.equations
        return Problem(
            equations.motion.address,
            self.layout.states,
            tuple(event for event, _ in equations.events),
            breaks=breaks,
            coefficients=coefficients,
            quaternions=self.layout.quaternions,
            constraints=self._constraints(q) if self.place == "q" else None,
        )

    # states

    def positions(self, q: Array) -> Array:
        """Positions of a state for configurations, (*batch, positions)."""
        return self.model.outputs.of(q) if self.place == "x" else q

    def rates(self, v: Array) -> Array:
        """Independent rates of a state for all rates, (*batch, independent)."""
        return np.asarray(v[..., list(self.model.independent)])

    def configurations(self, positions: Array, near: Array) -> Array:
        """Configurations for positions of states, (*batch, positions)."""
        if self.place == "q":
            return positions
        assert self.dynamics.inverse_geometry is not None
        return self.dynamics.inverse_geometry.solve(positions, near).q

    def all_rates(self, q: Array, y: Array) -> Array:
        """Rates of all variables of the tree, (*batch, variables)."""
        p = self.dynamics.assembler.p
        return self.model.kernel("rates", "q")(q, *([p] if p.size else []), y)

    def along(self, positions: Array, y: Array, times: Array, near: Array) -> tuple[Array, Array]:
        """Configurations and rates of all variables along a motion, (times, ·).

        Where outputs leave a choice, a configuration is the one that the motion before it leads to:
        closed forms alone would change to the mirrored mode of a leg that passes its flat position.
        Angles go on through whole turns.
        """
        q = self.configurations(positions, near)
        v = self.all_rates(q, y)
        if self.place == "q" or self._smooth(q, v, times):
            return q, v
        models = self.dynamics.models
        for k in range(len(times)):
            if k:
                near = models.retract(q[k - 1], v[k - 1] * (times[k] - times[k - 1]))
            q[k] = self.configurations(positions[k], near)
            turns = np.round((near - q[k]) / (2 * np.pi))
            q[k] += np.where(self._angles, 2 * np.pi * turns, 0.0)
            v[k] = self.all_rates(q[k], y[k])
        return q, v

    @cached_property
    def _angles(self) -> NDArray[np.bool_]:
        """Which numbers of a configuration are angles."""
        found: list[bool] = []
        for edge in self.dynamics.structure.edges:
            plain = edge.type.coordinates == edge.type.freedoms
            found += [plain and unit == "rad" for unit in edge.type.rates]
            found += [False] * (edge.type.coordinates - edge.type.freedoms)
        return np.array(found, dtype=bool)

    def _smooth(self, q: Array, v: Array, times: Array) -> bool:
        """Whether angles move from each time to the next about as their rates say."""
        structure, slices = self.dynamics.structure, self.dynamics.models.closure.slices
        columns = [
            k
            for k, x in enumerate(structure.variables)
            if self._angles[slices[x.edge].start + x.freedom]
        ]
        places = [slices[structure.variables[k].edge].start + structure.variables[k].freedom
                  for k in columns]  # fmt: skip
        mean = 0.5 * (v[1:, columns] + v[:-1, columns]) * np.diff(times)[:, None]
        off = np.abs(np.diff(q[:, places], axis=0) - mean)
        return bool(np.all(off <= ABOUT * np.abs(mean) + NOTHING))

    # equations that positions obey

    def _constraints(self, q: Array) -> Constraints | None:
        kernels = self._closing(q)
        if kernels is None:
            return None
        rows, move, unknowns = kernels
        return Constraints(rows.address(1), move.address(1), unknowns, len(q))

    def _closing(self, q: Array) -> tuple[TiledKernel, TiledKernel, int] | None:
        """Kernels of the closure equations and of a step of the dependent rates.

        Only rates that no constant relation gives are solved for: the integration keeps linear
        relations by itself, and what they leave stays regular at more places.
        """
        assembler, closure, model = self.dynamics.assembler, self.model.closure, self.model
        unknown = [k for k in range(len(model.kept)) if k not in set(model.given)]
        if not unknown:
            return None
        B = model.C[:, unknown]
        E = closure_jacobian(self.dynamics, q) @ (B / assembler.rate_scale[:, None])
        order = scipy.linalg.qr(E.T, pivoting=True, mode="r")[1]
        rows = sorted(order[: len(unknown)].tolist())
        key = tuple(rows)
        if key not in self._kernels:
            F = closure.residual[rows] * casadi.DM(assembler.row_scale[rows])
            along = closure.position_rates @ casadi.sparsify(casadi.DM(B))
            step = SX.sym("step", len(unknown))
            inputs = {"q": closure.q, "p": closure.p} if closure.p.numel() else {"q": closure.q}
            both = casadi.vertcat(F, casadi.vec((casadi.jacobian(F, closure.q) @ along).T))
            found = Kernel("closing", inputs, casadi.cse(both), (both.numel(),))
            moved = self._moved(along @ step)
            move = Kernel("moved", {**inputs, "step": step}, moved, (moved.numel(),))
            self._kernels[key] = TiledKernel(found), TiledKernel(move)
        return *self._kernels[key], len(unknown)

    @cached_property
    def _kernels(self) -> dict[tuple[int, ...], tuple[TiledKernel, TiledKernel]]:
        return {}

    def _moved(self, change: SX) -> SX:
        """q + change with unit quaternions."""
        moved = self.model.closure.q + change
        for first in self.layout.quaternions:
            tail = slice(first, first + 4)
            moved[tail] = moved[tail] / casadi.norm_2(moved[tail])
        return moved


@dataclass
class Formulations:
    """Every choice of coordinates that runs of one mechanism under one setting have needed."""

    dynamics: Dynamics
    setting: Setting

    def __post_init__(self) -> None:
        self._found: dict[tuple[str, ...], Formulation] = {}

    def first(self, q: Array) -> Formulation:
        """The choice for runs that start at a configuration."""
        return self.by_outputs or self.at(q)

    @cached_property
    def by_outputs(self) -> Formulation | None:
        """Outputs as coordinates, if they place the mechanism and every law sees its position."""
        dynamics = self.dynamics
        outputs = dynamics.structure.columns("operational")
        if not outputs:
            return None
        model = dynamics.model("platform")
        if "x" not in model.places or sorted(model.independent) != sorted(outputs):
            return None
        owner = model.writing("x").model
        if not all(has_position(owner, law, "x") for law in self.setting.laws):
            return None
        return Formulation(dynamics, model, "x", self.setting)

    def at(self, q: Array) -> Formulation:
        """The best configuration's rates near a configuration."""
        chosen = self._best(q)
        return self._with(chosen)

    def better(self, formulation: Formulation, q: Array) -> Formulation | None:
        """A choice that is much better than another at a configuration, if there is one."""
        T = self._motions(q)
        chosen = self._best(q)
        own = smallest(T[list(formulation.model.independent)])
        if own > GOOD * smallest(T[chosen]):
            return None
        return self._with(chosen)

    def _with(self, chosen: Sequence[int]) -> Formulation:
        """The formulation with some independent variables, on configurations."""
        dynamics = self.dynamics
        names = tuple(sorted(dynamics.structure.variables[k].name for k in chosen))
        if names not in self._found:
            model = dynamics.model("joint")
            own = sorted(dynamics.structure.variables[k].name for k in model.independent)
            if tuple(own) != names:
                model = Model(
                    dynamics.models, dynamics.assembler, dynamics.home, "joint", first=chosen
                )
            self._found[names] = Formulation(dynamics, model, "q", self.setting)
        return self._found[names]

    def _motions(self, q: Array) -> Array:
        """An orthonormal basis of the comparable rates that are possible at a configuration."""
        E = closure_jacobian(self.dynamics, q)
        freedoms = len(self.dynamics.model("joint").independent)
        Vt = np.linalg.svd(E)[2] if E.size else np.eye(E.shape[1])
        return np.asarray(Vt[len(Vt) - freedoms :].T)

    def _best(self, q: Array) -> list[int]:
        """The most independent rates; motors and outputs where they are about as good."""
        T = self._motions(q)
        freedoms = T.shape[1]
        order = scipy.linalg.qr(T.T, pivoting=True, mode="r")[1][:freedoms].tolist()
        best = smallest(T[order])
        structure = self.dynamics.structure
        for wanted in (structure.columns("actuated"), structure.columns("operational")):
            if len(wanted) == freedoms and smallest(T[wanted]) > WANTED * best:
                return list(wanted)
        return sorted(order)


def closure_jacobian(dynamics: Dynamics, q: Array) -> Array:
    """E at a configuration with comparable rows and rates, (rows, variables)."""
    assembler = dynamics.assembler
    if not dynamics.models.closure.residual.numel():
        return np.zeros((0, len(assembler.rate_scale)))
    E = dynamics.models.jacobian(q, assembler.p)
    return np.asarray(assembler.row_scale[:, None] * E * assembler.rate_scale)


def smallest(rows: Array) -> float:
    """The smallest singular value."""
    return float(np.linalg.svd(rows, compute_uv=False).min(initial=np.inf))
