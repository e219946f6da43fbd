"""What is watched along a path: branches of legs, signs of determinants, and their names."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from gough.errors import ConfigurationError
from gough.geometry.inverse import InverseGeometry
from gough.geometry.path_reports import Given, Kind
from gough.geometry.quadratic_closure import QuadraticClosure
from gough.geometry.rate_maps import RateMap
from gough.geometry.rates import Kinematics
from gough.symbolic.plans import Kind as BlockKind
from gough.topology import Role

Array = NDArray[np.float64]

RANK = 1e-7
"""Relative singular value of the passive columns below which they have lost rank; a guess."""
NAMED = 0.05
"""Share of the largest rate from which a joint or an output is named."""


@dataclass(frozen=True)
class Signs:
    """What tells the side of every singularity that a configuration is on."""

    determinant: int
    """Of the direct kinematics; 0 where there is none."""
    outputs: int
    """Of the determinant of the inverse kinematics; 0 where there is none."""
    branches: tuple[int, ...]
    """The branch of each leg."""

    @property
    def word(self) -> str:
        """The working mode: + and -."""
        return "".join("+" if sign > 0 else "-" for sign in self.branches)


class Watch:
    """The signs of one mechanism, with words for what changes.

    Args:
        kinematics: its rates.
        inverse: its inverse geometry; None without outputs.
        direct: the equations with known motors; None where they are no polynomials.
        given: what the path is of.
    """

    def __init__(
        self,
        kinematics: Kinematics,
        inverse: InverseGeometry | None,
        direct: QuadraticClosure | None,
        given: Given,
    ) -> None:
        self.kinematics, self.inverse, self.direct, self.given = kinematics, inverse, direct, given
        found = inverse.branches if inverse is not None and inverse.closed_form else None
        self.branches = found.branches if found is not None else []

    @property
    def labels(self) -> tuple[str, ...]:
        """The leg, joint or body at which each branch splits."""
        return tuple(self.inverse.leg_of(b.source) for b in self.branches) if self.inverse else ()

    def signs(self, q: Array) -> Signs:
        """All signs of a closed configuration."""
        # with motors as inputs, legs tell their own; what closed forms do not, the rates tell
        outputs = 0 if self.branches or self.given == "outputs" else self._outputs(q)
        branches = self.inverse.signs(q).tolist() if self.inverse and self.branches else []
        return Signs(self._determinant(q), outputs, tuple(branches))

    # determinants

    @cached_property
    def _determinant(self) -> Callable[[Array], int]:
        """Sign of the determinant of the direct problem's equations, else of the rates, 1 at home.

        The rates' sign changes where passive joints alone gain a motion too, as where a leg points
        along the first axis of its universal joint; the equations leave such motions out.
        """
        direct = self.direct
        if direct is not None and not len(direct.others) and direct.left:
            home = self._of_equations(direct, self.kinematics.home)
            return lambda q: home * self._of_equations(direct, q)
        try:
            self.kinematics.determinant_sign(self.kinematics.home)
        except ConfigurationError:
            return lambda q: 0
        return lambda q: int(self.kinematics.determinant_sign(q))

    @staticmethod
    def _of_equations(direct: QuadraticClosure, q: Array) -> int:
        pattern, c, _ = direct.proof(q)
        values = direct.problem.measured(q, direct.problem.assembler.p)[direct.left]
        x = np.concatenate([[1.0], values]) / direct.size
        return int(np.linalg.slogdet(pattern.jacobian(c, x)[:, 1:])[0])

    @cached_property
    def _outputs(self) -> Callable[[Array], int]:
        """Sign of the determinant of the inverse kinematics."""
        try:
            found = self.kinematics.from_operational
        except ConfigurationError:
            return lambda q: 0
        if any(block.kind is not BlockKind.unique for block in found.plan.blocks):
            return lambda q: 0
        return lambda q: self._of_blocks(found, q)

    def _of_blocks(self, found: RateMap, q: Array) -> int:
        sign = 1.0
        for matrix in found.block_matrices(q, self.kinematics.assembler.p):
            sign *= float(np.linalg.slogdet(matrix)[0])
        return int(sign)

    # words

    def changes(self, before: Signs, after: Signs) -> list[tuple[Kind, int]]:
        """What differs: the kind, and the place of a branch that toggles."""
        found: list[tuple[Kind, int]] = []
        if self.given == "inputs":
            pairs = zip(before.branches, after.branches, strict=True)
            found += [("toggle", k) for k, (a, b) in enumerate(pairs) if a != b]
            if before.outputs * after.outputs < 0:
                found.append(("type 1", 0))
        if before.determinant * after.determinant < 0:
            found.append(("type 2", 0))
        return found

    def text(self, kind: Kind, place: int, q: Array) -> str:
        """What happens at a configuration next to an event, in words."""
        if kind == "toggle":
            return f"{self.labels[place]} passes from one branch to the other"
        if kind == "type 1":
            return self._type_1(q)
        return self._type_2(q)

    def _type_1(self, q: Array) -> str:
        names = [name for name, _ in self._motion(q, "actuated")]
        verb = "moves" if len(names) == 1 else "move"
        return (
            f"{', '.join(names)} {verb} with the outputs at rest" if names else "outputs are lost"
        )

    def _type_2(self, q: Array) -> str:
        terms = self._motion(q, "operational")
        if not terms:
            return "joints move with the motors locked"
        lead = terms[0][1]
        words = [f"{value / lead:+.3g} {name}" for name, value in terms]
        motion = " ".join(words).removeprefix("+1 ").replace("-", "- ").replace("+", "+ ")
        return f"the outputs move with the motors locked: {motion}"

    def _motion(self, q: Array, role: Role) -> list[tuple[str, float]]:
        """The rates of a role that are possible with the other role at rest, the largest first.

        The smallest right singular vector of A in A q̇_a + B ẋ = 0 (or of B), in SI units.
        """
        models, assembler = self.kinematics.models, self.kinematics.assembler
        columns, passive = models.structure.columns(role), models.structure.columns("passive")
        if not columns:
            return []
        E = assembler.scaled_jacobian(q)
        U, s = np.linalg.svd(E[:, passive])[:2] if passive else (np.eye(len(E)), np.zeros(0))
        rank = int(np.sum(s > RANK * np.linalg.norm(E, 2)))
        rates = np.linalg.svd(U[:, rank:].T @ E[:, columns])[2][-1]
        order = np.argsort(-np.abs(rates), kind="stable")
        named = [k for k in order if abs(rates[k]) >= NAMED * abs(rates[order[0]])]
        rates = rates * assembler.rate_scale[columns]
        return [(models.structure.variables[columns[k]].name, float(rates[k])) for k in named]
