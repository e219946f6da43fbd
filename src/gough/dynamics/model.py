"""The dynamics of one mechanism in independent rates: what was decided once, and its kernels."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Literal

import casadi
import numpy as np
from numpy.typing import NDArray

from gough.algebra import Scalar, Vector
from gough.assembly import Assembler
from gough.cache import from_environment
from gough.description.values import vector
from gough.dynamics import plans
from gough.dynamics.rotors import rotors_of
from gough.dynamics.writing import MODELS, PLAIN, Inputs, Place, Writing
from gough.errors import ConfigurationError
from gough.geometry.coordinates import Coordinates
from gough.geometry.samples import sample, with_more
from gough.kernels import Kernel
from gough.models import Models
from gough.symbolic.closing_rates import evaluated
from gough.symbolic.plans import best_independent, generic_rank, relations
from gough.symbolic.trees.closed_form import ClosedForm
from gough.symbolic.trees.forces import Loads
from gough.symbolic.trees.frames import Frames
from gough.symbolic.trees.nodes import Tree
from gough.symbolic.trees.positions import JointPositions
from gough.symbolic.trees.reduced import Reduced
from gough.symbolic.trees.regrouping import Regrouped, regroupings
from gough.symbolic.trees.rotations import OnNode, short_rotations
from gough.symbolic.trees.selection import Selector

Array = NDArray[np.float64]
SX = casadi.SX
Space = Literal["platform", "joint"]
"""Whether outputs or motors are the first choice of independent rates."""

READINGS = 3
"""How often the structure is read, with more configurations each time."""
FRESH = (0.2, 0.4, 0.6, 0.8, 1.0, 1.2)
"""Lengths of the walks from home to where it is proved; see `Assembler.wander`."""
PROVED = 1e-9
"""Relative residual of closure equations up to which they are obeyed; rounding, no proof."""
FAR = 1e6
"""Sizes of second rates beyond which a state is too near to a singularity to tell anything."""
TRIED = 6
"""Equivalent inertias of which the operations are counted; the sparsest ones."""


class Model:
    """Expressions and kernels of the dynamics of one mechanism.

    Args:
        models: the mechanism.
        assembler: what closes its loops, with its live parameters.
        home: a closed configuration, (positions,).
        space: which rates are independent by preference.
        seed: of the configurations from which the structure is read.
        regrouped: whether inertia is moved between bodies, without effect, so that it takes fewer
            operations.
        searched: whether other trees of the mechanism may serve where outputs place it.
        first: variables that are independent by preference, before those of ``space``.

    Attributes:
        independent: the variables y whose rates are independent.
        kept: the variables that no constant relation binds, y among them.
        given: places of y among the kept ones.
        C: all rates v = C w of the kept ones.
        tree: the mechanism as single motions.
        selection: rows and blocks that give all rates.
        by_joints: the mechanism placed by a configuration.
    """

    def __init__(
        self,
        models: Models,
        assembler: Assembler,
        home: Array,
        space: Space,
        seed: int = 0,
        regrouped: bool = True,
        searched: bool = True,
        first: Sequence[int] = (),
    ) -> None:
        self.first = tuple(first)
        self.models, self.assembler, self.home, self.space = models, assembler, home, space
        self.structure, self.closure = models.structure, models.closure
        self._regrouped, self._searched, self._seed = regrouped, searched, seed
        self._kernels: dict[tuple[object, ...], Kernel] = {}
        self._read()

    # what is decided once

    def _read(self) -> None:
        """Read the structure at samples and prove it at others, farther from home.

        Where it does not hold, those are joined to the samples and it is read anew; in the end
        without relations between rates, which a single motion that is short may only seem to obey.

        Raises:
            ConfigurationError: it still does not hold.
        """
        rng = np.random.default_rng(self._seed + 1)
        self.sampled = sample(self.assembler, self.home, self._seed)
        for reading in range(READINGS + 1):
            self.independent, self.kept, self.C = self._rates(related=reading < READINGS)
            self.given = [self.kept.index(k) for k in self.independent]
            self.tree = Tree(self.closure, self.sampled.samples, self.C)
            self._frames = Frames(self.tree, JointPositions(self.tree, self.C, self.kept))
            self.selection = Selector(self.tree, self._frames, self.C, self.given).select()
            self.by_joints = Reduced(self._frames, self.C, self.selection)
            fresh = [self.assembler.wander(self.home, rng, reach) for reach in FRESH]
            found = [q for q in fresh if q is not None]
            # a mechanism that can not move away is at least tried where it is
            if self._violation(found or [self.home], rng) < PROVED:
                return
            self.sampled = with_more(self.sampled, self.assembler, found)
        raise ConfigurationError(
            f"{self.structure.mechanism.name}: what seems to hold of its rates near home does not "
            "hold farther away; give another home"
        )

    def _violation(self, q: Sequence[Array], rng: np.random.Generator) -> float:
        """How far rates and accelerations of the model are from obeying every closure equation.

        E v = 0 and E v̇ + Ė v = 0, with the rows that were left out, relative to their terms: a
        wrong relation between rates may keep inverse and direct dynamics consistent, but not these.
        """
        if not self.closure.residual.numel() or not self.given:
            return 0.0
        rates, rows = self._motion, self._residuals
        worst, p, scale = 0.0, self.assembler.p, self.assembler.row_scale
        for at in q:
            v, vd = rates(at, p, *rng.normal(size=(2, len(self.given))))
            first, second, carried = (np.array(x).ravel() * scale for x in rows(at, p, v, vd))
            size = float(np.abs(np.array(v)).max())
            terms = float(np.abs(second).max() + np.abs(carried).max())
            if np.isfinite(terms) and terms < FAR:
                worst = max(worst, float(np.abs(first).max()) / size)
                worst = max(worst, float(np.abs(second + carried).max()) / max(terms, size**2))
        return worst

    @property
    def _motion(self) -> casadi.Function:
        """(q, p, y, ẏ) -> v, v̇."""
        closure, reduced = self.closure, self.by_joints
        yd = [SX.sym(f"yd{k}") for k in range(len(self.given))]
        v = casadi.vertcat(*reduced.all_rates(reduced.rates))
        vd = casadi.vertcat(*reduced.all_rates(reduced.accelerations(yd)))
        columns = [casadi.vertcat(*reduced.y), casadi.vertcat(*yd)]
        return casadi.Function("motion", [closure.q, closure.p, *columns], [v, vd])

    @property
    def _residuals(self) -> casadi.Function:
        """(q, p, v, v̇) -> E v, E v̇, Ė v."""
        closure, count = self.closure, len(self.structure.variables)
        v, vd = SX.sym("v", count), SX.sym("vd", count)
        first = closure.jacobian @ v
        carried = casadi.jtimes(first, closure.q, closure.position_rates @ v)
        outputs = [first, closure.jacobian @ vd, carried]
        return casadi.Function("residuals", [closure.q, closure.p, v, vd], outputs)

    def _rates(self, related: bool) -> tuple[tuple[int, ...], tuple[int, ...], Array]:
        """Independent and kept variables, and how the others follow."""
        E, count = self.sampled.E, len(self.structure.variables)
        y = best_independent(E, self._preferred(), range(count))
        motors = [k for k in self.structure.columns("actuated") if k not in y]
        rest = [k for k in range(count) if k not in (*y, *motors)]
        samples = self.sampled.samples
        order, telling = [*y, *motors, *rest], samples.telling and related
        kept, C = relations(E, order, samples.rate_scale, telling)
        return tuple(y), kept, C

    def _preferred(self) -> list[int]:
        """The base where it floats, then outputs or motors."""
        floating = self.structure.mechanism.floating
        base = [k for k, v in enumerate(self.structure.variables) if floating and v.edge == 0]
        first, last = self.structure.columns("operational"), self.structure.columns("actuated")
        if self.space == "joint":
            first, last = last, first
        return list(dict.fromkeys([*self.first, *base, *first, *last]))

    @cached_property
    def by_outputs(self) -> Reduced | None:
        """The mechanism placed by its operational coordinates, or None without closed forms."""
        outputs = self.structure.columns("operational")
        if self._turned or not outputs:
            return None
        form = ClosedForm(self.tree, self.C, self.kept, outputs, first_mode=True)
        if form.left:
            return None
        positions = JointPositions(self.tree, self.C, self.kept, form.known)
        if not self._placed_by(positions):
            return None
        ways = [
            Reduced(Frames(self.tree, positions, whole), self.C, self.selection)
            for whole in (False, True)
        ]
        return min(ways, key=lambda way: self._operations_of(way, self._loads_of(None)))

    @cached_property
    def posed(self) -> Model | None:
        """The model that takes outputs: this one, or one of another tree that is cheaper."""
        if not self._searched or self.space != "platform":
            return self if self.by_outputs is not None else None
        cache, key = from_environment(), plans.key_of(self.models, str(self._seed))
        known = plans.kept(cache, key)
        if known is None:
            return self if self.by_outputs is not None else None
        if isinstance(known, plans.Plan) and (other := self._as_planned(known)) is not None:
            return other
        found, chosen = self._cheapest()
        plans.keep(cache, key, chosen)
        return found

    def _cheapest(self) -> tuple[Model | None, plans.Plan | None]:
        """The tree whose model takes the fewest operations, before inertia is moved."""
        best, chosen, least = None, None, np.inf
        for plan in [None, *plans.plans(self.structure)][: plans.MOST]:
            model = self if plan is None else self._as_planned(plan)
            if model is None or model.by_outputs is None:
                continue
            count = model._operations_of(model.by_outputs, model._loads_of(None))
            if count < least:
                best, chosen, least = model, plan, count
        return best, chosen

    def _as_planned(self, plan: plans.Plan) -> Model | None:
        """The same model on another tree, if that has the same independent rates."""
        found = plans.planned(plan, self.models, self.assembler, self.home)
        if found is None:
            return None
        try:
            other = Model(
                found.models,
                found.assembler,
                found.home,
                self.space,
                self._seed,
                self._regrouped,
                searched=False,
            )
            names = [m.structure.variables[k].name for m in (self, other) for k in m.independent]
            same = names[: len(names) // 2] == names[len(names) // 2 :]
            return other if same and other.by_outputs is not None else None
        except ConfigurationError:
            return None

    def _placed_by(self, positions: JointPositions) -> bool:
        """Whether outputs alone place every node."""
        frames = Frames(self.tree, positions)
        parts: list[Scalar] = []
        for node in self.tree.nodes[1:]:
            parts += [x for row in frames.from_root(node.frame) for x in row]
            parts += frames.arm(node)
        parts += [x for body in self.rotations.values() for x in body.phi(frames)]
        symbols = casadi.symvar(casadi.vertcat(*[SX(x) for x in parts]))
        own = [self.closure.q[k] for k in self.outputs.whole]
        own += [self.closure.p[k] for k in range(self.closure.p.numel())]
        known = {x.element_hash() for x in own}
        return all(x.element_hash() in known for x in symbols)

    @property
    def _turned(self) -> bool:
        """Whether outputs are entries of a rotation vector, which takes a solver."""
        return bool(self.outputs.turned)

    @cached_property
    def outputs(self) -> Coordinates:
        """Where the operational coordinates stand in q."""
        return Coordinates(self.models, "operational")

    @cached_property
    def quaternion(self) -> slice | None:
        """Where the quaternion of an operational pose stands in q."""
        for edge, part in zip(self.structure.edges, self.closure.slices, strict=True):
            inside = set(range(part.start, part.stop)) <= set(self.outputs.whole)
            if edge.link and edge.type.coordinates > edge.type.freedoms and inside:
                return slice(part.stop - 4, part.stop)
        return None

    @cached_property
    def equivalent(self) -> Regrouped | None:
        """The equivalent inertia that takes the fewest operations; None keeps it as described."""
        if not self._regrouped:
            return None
        given = set(self.independent)
        found = regroupings(self.tree, self._frames, given, TRIED)
        if not found:
            return None
        return min([*found, None], key=self._cost)

    def _cost(self, regrouped: Regrouped | None) -> float:
        return self._operations_of(self.by_joints, self._loads_of(regrouped))

    def _operations_of(self, reduced: Reduced, loads: Loads) -> float:
        """About how many operations inverse and half a direct model take."""
        yd: list[Scalar] = [SX.sym(f"yd{k}") for k in range(len(self.given))]
        mass = [x for row in reduced.mass_matrix(loads) for x in row]
        return _instructions(reduced.forces(yd, self.gravity, loads)) + 0.5 * _instructions(mass)

    def _loads_of(self, regrouped: Regrouped | None) -> Loads:
        if regrouped is None:
            return Loads(rotors=self.rotors, rotations=self.rotations)
        return Loads(
            regrouped.inertia,
            rotors=self.rotors,
            pairs=regrouped.pairs,
            rotations=self.rotations,
        )

    @cached_property
    def loads(self) -> Loads:
        """Inertia of bodies and motors."""
        return self._loads_of(self.equivalent)

    @cached_property
    def rotations(self) -> dict[int, OnNode]:
        """Bodies whose energy of rotation is a formula of its own, by node; never regrouped."""
        return short_rotations(self.tree)

    @cached_property
    def rotors(self) -> dict[int, Scalar]:
        """Inertia of motors and of laws as their freedoms feel it, by variable."""
        edges, joints = self.structure.edges, self.structure.flat.joints
        felt = {
            name: rotors_of(joint, self.closure.values)
            for name, joint in joints.items()
            if joint.motor is not None or joint.actuators
        }
        found: dict[int, Scalar] = {}
        for k, variable in enumerate(self.structure.variables):
            edge = edges[variable.edge]
            own = {} if edge.link else felt.get(edge.name, {})
            if variable.freedom in own:
                found[k] = own[variable.freedom]
        return found

    @cached_property
    def gravity(self) -> Vector:
        """Of the description, in base axes, m/s²."""
        g = (*vector(self.structure.mechanism.gravity, self.closure.values, 2, 3), 0.0)
        return g[0], g[1], g[2]

    @cached_property
    def actuated(self) -> list[int]:
        """Variables of the motors."""
        return self.structure.columns("actuated")

    @cached_property
    def motors_rank(self) -> int:
        """How many independent forces the motors give, generically."""
        if not self.actuated:
            return 0
        rows = self.by_joints.rows_of(self.actuated)
        numbers = evaluated(self.closure, self.sampled.samples, [x for row in rows for x in row])
        numbers = numbers.reshape(len(numbers), len(self.actuated), -1)
        return generic_rank(numbers, range(numbers.shape[2])) if numbers.size else 0

    # kernels

    @property
    def places(self) -> tuple[Place, ...]:
        """What a model can be placed by."""
        return ("q",) if self.posed is None else ("x", "q")

    def kernel(self, name: str, place: Place, inputs: Inputs = PLAIN) -> Kernel:
        """A kernel by its name in `MODELS`; see there what it gives.

        Inputs are the place ``x`` or ``q``, live parameters ``p``, rates ``y``, and by the model
        accelerations ``yd`` or efforts ``tau``, then ``gravity`` and ``wrenches`` where given.
        """
        key = name, place, inputs
        if key not in self._kernels:
            self._kernels[key] = MODELS[name](self.writing(place, inputs))
        return self._kernels[key]

    def writing(self, place: Place, inputs: Inputs = PLAIN) -> Writing:
        """What every model in a place is written from.

        Raises:
            ConfigurationError: outputs do not place the mechanism.
        """
        return Writing(self._for(place), place, inputs)

    def _for(self, place: Place) -> Model:
        found = self.posed if place == "x" else self
        if found is None:
            raise ConfigurationError(
                f"{self.structure.mechanism.name} has no closed form of all its legs; give a "
                "configuration q"
            )
        return found


def _instructions(values: Sequence[Scalar]) -> float:
    """About how many operations some scalars take."""
    column = casadi.cse(casadi.vertcat(*[SX(x) for x in values], SX(0, 1)))
    return float(casadi.Function("count", casadi.symvar(column), [column]).n_instructions())
