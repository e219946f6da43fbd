"""Dynamics of a mechanism with loops in independent rates, block by block, as scalar expressions.

With v = C w, w = (y, u), J u + P y = 0 in the chosen rows, and h the forces of the tree:

    u = -J⁻¹ P y,    h_y' = h_y - Pᵀ J⁻ᵀ h_u    (inverse dynamics: the forces that y feels)
    A = M_yy - Pᵀ J⁻ᵀ M_uy - (…)ᵀ + Pᵀ (J⁻ᵀ M_uu J⁻¹) P    (direct dynamics)

J falls into the blocks of the legs, P is used row by row and never formed with J⁻¹: the models of
Khalil and Guégan (2004) come out, each leg reflected to the platform where it closes. Where only
the length of a leg is felt, as of one without inertia, its rate takes the place of the leg's row.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from functools import cached_property

import casadi
import numpy as np
from numpy.typing import NDArray

from gough import algebra as al
from gough.algebra import Scalar, Vector
from gough.symbolic.trees.factors import Factors, Grid
from gough.symbolic.trees.forces import Loads, mass_matrix, tree_forces
from gough.symbolic.trees.frames import Frames, Rates
from gough.symbolic.trees.motion import Motion
from gough.symbolic.trees.nodes import Node, Tree
from gough.symbolic.trees.reflecting import Reflecting
from gough.symbolic.trees.selection import Selection
from gough.symbolic.trees.solving import Solver

Array = NDArray[np.float64]
SX = casadi.SX


class Reduced:
    """One placing of a tree, with all rates from the given ones.

    Args:
        frames: the tree where it stands.
        C: all rates v = C w, (variables, kept).
        selection: rows and blocks.
    """

    def __init__(self, frames: Frames, C: Array, selection: Selection) -> None:
        self.frames, self.C, self.selection = frames, C, selection
        self.tree = frames.tree
        self.y = [SX.sym(f"y{k}") for k in range(len(selection.given))]
        """Symbols of the given rates."""

    # by which rows

    @cached_property
    def _whole(self) -> Solver:
        """By the rows that are good for all rates."""
        return Solver(self.frames, self.C, self.selection, self.y)

    @cached_property
    def _short(self) -> Solver:
        """By the rows that are good for what the inertia of the tree feels."""
        if not self._lengths:
            return self._whole
        short = Solver(self.frames, self.C, self.selection.shortened(self._lengths), self.y)
        return min(self._whole, short, key=lambda solver: solver.operations(self._lengths))

    @cached_property
    def _lengths(self) -> set[int]:
        """Rows of lengths in the short choice."""
        return self.selection.replaced(self._kept(_felt(self.tree, Loads())))

    def _solver(self, variables: Iterable[int]) -> Solver:
        """The rows for the rates of some variables."""
        short = self._lengths <= self.selection.replaced(self._kept(variables))
        return self._short if short else self._whole

    def _kept(self, variables: Iterable[int]) -> set[int]:
        """Kept rates that variables depend on."""
        return {k for v in variables for k in np.flatnonzero(self.C[v]).tolist()}

    # rates

    @property
    def rates(self) -> Rates:
        """All kept rates."""
        return self._whole.rates

    def rates_for(self, variables: Iterable[int]) -> Rates:
        """Kept rates that are good for the rates of some variables."""
        return self._solver(variables).rates

    def length(self, variable: int) -> Scalar | None:
        """Position of a slide from the length that its rate is taken from, if it is."""
        if self._short is self._whole:
            return None
        for i in self._lengths:
            tie = self.selection.lengths[i].tie
            assert tie.slide is not None
            end = tie.slide.end
            if end.node.variables[0] == variable:
                offset = self.frames.between(
                    tie.a.node, tie.a.point, tie.b.node, tie.b.point, self.selection.lengths[i].axes
                )
                rest = al.dot(al.plus(end.node.arm, end.point), tie.slide.unit)
                return al.mul(al.sub(al.norm(offset), rest), 1.0 / tie.terms[0][1])
        return None

    def position(self, variable: int) -> Scalar:
        """Position of a turn within half a turn, or of a slide."""
        node = next(n for n in self.tree.nodes if variable in n.variables[:1])
        if node.kind == "slide":
            return al.mul(1.0 / node.factor, self.frames.positions.length(node))
        c, s = self.frames.positions.circle(node)
        return al.mul(1.0 / node.factor, al.atan2(s, c))

    def accelerations(self, yd: Sequence[Scalar]) -> Rates:
        """All kept accelerations for those of the given rates."""
        return self._whole.accelerations(yd)

    def all_rates(self, kept: Rates) -> list[Scalar]:
        """v = C w."""
        return [
            al.total([al.mul(float(form[k]), kept[k]) for k in np.flatnonzero(form).tolist()])
            for form in self.C
        ]

    # dynamics

    def forces(self, yd: Sequence[Scalar], gravity: Vector | None, loads: Loads) -> list[Scalar]:
        """Generalised forces along the given rates that a motion takes."""
        solver = self._solver(_felt(self.tree, loads))
        motion = Motion(self.frames, self.C, solver.rates, solver.accelerations(yd), gravity)
        return solver.onto_given(tree_forces(self.frames, motion, loads, len(self.C)))

    def rows_of(self, variables: Sequence[int]) -> Grid:
        """Rates of some variables for unit given rates, (variables, given)."""
        solver, found = self._solver(variables), []
        for variable in variables:
            h = [0.0] * len(self.C)
            h[variable] = 1.0
            found.append(solver.onto_given(h))
        return found

    def mass_matrix(self, loads: Loads) -> Grid:
        """A of the given rates, symmetric positive definite, leg by leg."""
        solver = self._solver(_felt(self.tree, loads))
        M = mass_matrix(self.frames, loads, len(self.C))
        half = [solver.onto_kept(row) for row in M]
        columns = [solver.onto_kept(column) for column in zip(*half, strict=True)]
        width = self.C.shape[1]
        kept = [[columns[min(i, k)][max(i, k)] for k in range(width)] for i in range(width)]
        return Reflecting(solver, kept).given()

    def regularity(self, results: Sequence[Scalar]) -> Scalar:
        """The smallest determinant of a block over its typical size: 0 where rates are lost.

        Blocks that results do not need do not count: rates of a passive joint that carries no
        inertia may well be lost.
        """
        found: Scalar = 1.0
        column = [SX(x) for x in results if not al.is_number(x)]
        for factors, typical in self._factors():
            if al.is_number(factors.determinant) or not _made_with(column, factors.pivot):
                continue
            size = casadi.fabs(factors.determinant) * (1.0 / typical)
            found = size if al.is_number(found) else casadi.fmin(found, size)
        return found

    def _factors(self) -> Iterator[tuple[Factors, float]]:
        """Of each block, with the typical size of its determinant."""
        for solver in dict.fromkeys((self._whole, self._short)):
            yield from zip(solver.factors, solver.selection.typical, strict=True)


def _made_with(column: Sequence[SX], x: SX) -> bool:
    """Whether an expression has another in it, which then costs nothing but its output."""
    if x.is_op(casadi.OP_NEG):
        x = x.dep(0)
    return _instructions([*column, x]) == _instructions(column) + 1


def _felt(tree: Tree, loads: Loads) -> set[int]:
    """Variables that move what loads act on."""
    nodes = [node for node in tree.nodes if _acts_on(loads, node)]
    nodes += [end for pair in loads.pairs for end in (pair.a, pair.b)]
    carrying = {v for node in nodes for n in node.ancestors() for v in n.variables}
    return carrying | set(loads.rotors) | set(loads.efforts)


def _acts_on(loads: Loads, node: Node) -> bool:
    """Whether a node has inertia, or a wrench is given on it."""
    body = loads.of(node)
    massive = body.turns or body.leans or not (al.is_number(body.mass) and body.mass == 0)
    given = any(name in loads.wrenches for name in node.bodies)
    return massive or given or node.index in loads.rotations


def _instructions(column: Sequence[SX]) -> int:
    """Instructions of some expressions; what they share counts once."""
    whole = casadi.vertcat(*column, SX(0, 1))
    return int(casadi.Function("count", casadi.symvar(whole), [whole]).n_instructions())
