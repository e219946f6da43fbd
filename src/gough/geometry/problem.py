"""One question about a mechanism: the positions of some joints are known, the others wanted."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import cached_property

import casadi
import numpy as np
from numpy.typing import NDArray

from gough import algebra as al
from gough.algebra import Matrix, Scalar, Transform
from gough.assembly import Assembler
from gough.kernels import Kernel
from gough.models import Models
from gough.symbolic.natural import NaturalClosure

Array = NDArray[np.float64]

STATES = 3
"""At how many states it is looked at what is constant or zero: the home and others near it."""


class Problem:
    """A mechanism with some positions known.

    Args:
        models: the mechanism's models.
        assembler: what closes its loops.
        home: a closed configuration q, (positions,).
        known: names of joints whose positions are known, and of the platform where its pose is.
        turn: R_base_platform of a platform that keeps its orientation.
        seed: of the states that are looked at.

    Attributes:
        natural: the equations with symbols, in positions q of what is known.
        left: the unknowns that its linear equations leave.

    Raises:
        ConfigurationError: the equations are no polynomials.
    """

    def __init__(
        self,
        models: Models,
        assembler: Assembler,
        home: Array,
        known: Iterable[str],
        turn: Matrix | None = None,
        seed: int = 0,
    ) -> None:
        self.models, self.assembler, self.home = models, assembler, home
        self.known, self.turn = set(known), turn
        self.states = self._states(np.random.default_rng(seed))
        self.natural = self._natural()
        conditions = [*self.natural.conditions]
        self.left = sorted({u for c in conditions for u in c.polynomial.unknowns})

    def _states(self, rng: np.random.Generator) -> Array:
        """The home, and states near it whose known positions are anything."""
        rates = len(self.models.structure.variables)
        steps = rng.normal(size=(STATES - 1, rates)) * 0.1 * self.assembler.rate_scale
        return np.array([self.home, *(self.models.retract(self.home, step) for step in steps)])

    def probe(self, scalars: Sequence[Scalar]) -> Array:
        """Numbers of some scalars at the states looked at, (states, scalars)."""
        closure = self.models.closure
        column = casadi.vertcat(*(casadi.SX(x) for x in scalars))
        function = casadi.Function("probe", [closure.q, closure.p], [column])
        p = self.assembler.p
        return np.array([np.array(function(q, p)).reshape(-1) for q in self.states])

    def _natural(self) -> NaturalClosure:
        closure, structure = self.models.closure, self.models.structure
        platform = structure.mechanism.platform
        positions = {
            edge.name: closure.position(k)
            for k, edge in enumerate(structure.edges)
            if edge.name in self.known and not edge.link
        }
        pose: Transform | None = None
        if platform is not None and platform in self.known:
            R, p = self.base_poses[platform]
            pose = (R if self.turn is None else self.turn, p)
        turn = self.turn if pose is None else None
        return NaturalClosure(
            structure,
            closure.values,
            closure.nominal,
            positions,
            self.probe,
            self.assembler.length,
            pose,
            turn,
        )

    @cached_property
    def base_poses(self) -> dict[str, Transform]:
        """T_base_body of every body, in positions q."""
        poses = self.models.closure.poses
        base = self.models.structure.mechanism.base
        if base == self.models.structure.root:
            return {**poses, base: al.HERE}
        back = al.inverse(poses[base])
        return {body: al.compose(back, T) for body, T in poses.items()}

    @cached_property
    def measured(self) -> Kernel:
        """The value of every unknown at a configuration q: (*batch, unknowns)."""
        return self.kernel("natural_coordinates", self.natural.measured(self.base_poses))

    def kernel(self, name: str, scalars: Sequence[Scalar]) -> Kernel:
        """Scalars in q and p as a kernel."""
        closure = self.models.closure
        column = casadi.vertcat(*(casadi.SX(x) for x in scalars)) if scalars else casadi.SX(0, 1)
        return Kernel(name, {"q": closure.q, "p": closure.p}, column, (len(scalars),))
