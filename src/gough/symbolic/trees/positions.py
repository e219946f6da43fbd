"""Where the single motions of a tree stand, from a configuration or from known circles."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from gough import algebra as al
from gough.algebra import Matrix, Scalar
from gough.symbolic.trees.nodes import Node, Tree, rotation

Array = NDArray[np.float64]

CONSTANT = 1e-9
"""How much a sum of positions may differ between samples and count as constant; a guess."""
Place = tuple[Scalar, Scalar] | Scalar
"""Cosine and sine of an angle, or a length."""


class JointPositions:
    """Positions of nodes in terms of a configuration q, and of those that follow from others.

    Args:
        tree: the tree.
        C: all rates v = C w of kept rates.
        kept: the variables of w.
        known: cosine and sine, or length, of variables that are known otherwise than by q.
    """

    def __init__(
        self, tree: Tree, C: Array, kept: tuple[int, ...], known: Mapping[int, Place] | None = None
    ) -> None:
        self.tree, self.C, self.kept = tree, C, kept
        self.known = dict(known or {})
        self._nodes = {v: node for node in tree.nodes for v in node.variables[:1]}
        self._circles: dict[int, tuple[Scalar, Scalar]] = {}

    def circle(self, node: Node) -> tuple[Scalar, Scalar]:
        """Cosine and sine of the angle of a turn, with its factor."""
        c, s = self.own_circle(node.variables[0])
        return c, al.mul(node.factor, s)

    def length(self, node: Node) -> Scalar:
        """Distance of a slide, with its factor."""
        return al.mul(node.factor, self.own_length(node.variables[0]))

    def ball(self, node: Node) -> Matrix:
        """Rotation of a ball."""
        return rotation(node, self.tree.closure.q)

    def own_length(self, variable: int) -> Scalar:
        """Position of a variable in m, or an angle as a number."""
        if variable in self.known:
            return self.known[variable]
        if (terms := self.sum_of(variable)) is not None and self._nodes[variable].kind == "slide":
            constant, parts = terms
            lengths = [al.mul(factor, self.own_length(other)) for other, factor in parts]
            return al.total([_exact(constant), *lengths])
        return self.tree.closure.q[self._nodes[variable].place.start]

    def own_circle(self, variable: int) -> tuple[Scalar, Scalar]:
        """Cosine and sine of a variable."""
        if variable not in self._circles:
            self._circles[variable] = self._circle(variable)
        return self._circles[variable]

    def _circle(self, variable: int) -> tuple[Scalar, Scalar]:
        if variable in self.known:
            return self.known[variable]
        if (terms := self.sum_of(variable)) is not None:
            constant, parts = terms
            found = _exact(np.cos(constant)), _exact(np.sin(constant))
            for other, sign in parts:
                c, s = self.own_circle(other)
                found = _added(found, (c, al.mul(sign, s)))
            return found
        angle = self.tree.closure.q[self._nodes[variable].place.start]
        return al.cos(angle), al.sin(angle)

    def sum_of(self, variable: int) -> tuple[float, list[tuple[int, float]]] | None:
        """A position as a constant and a sum of others, if it always is one.

        An angle is one of angles with factors 1 and -1, a length one of lengths.
        """
        return self._sums.get(variable)

    @cached_property
    def _sums(self) -> dict[int, tuple[float, list[tuple[int, float]]]]:
        found = {}
        for variable, node in self._nodes.items():
            form = self.C[variable]
            if variable in self.kept or node.kind not in ("turn", "slide"):
                continue
            parts = [(self.kept[k], float(form[k])) for k in np.flatnonzero(form)]
            whole = node.kind == "slide" or all(abs(factor) == 1 for _, factor in parts)
            if whole and all(self._alike(variable, other) for other, _ in parts):
                constant = self._constant(variable, parts)
                if constant is not None:
                    found[variable] = constant, parts
        return found

    def _alike(self, variable: int, other: int) -> bool:
        """Whether another position is of the same kind."""
        return other in self._nodes and self._nodes[other].kind == self._nodes[variable].kind

    def _constant(self, variable: int, parts: list[tuple[int, float]]) -> float | None:
        """What a position differs by from the sum, the same at every sample but for whole turns."""
        q = self.tree.samples.q
        rest = q[:, self._nodes[variable].place.start].copy()
        for other, sign in parts:
            rest -= sign * q[:, self._nodes[other].place.start]
        off = rest - rest[0]
        if self._nodes[variable].kind == "turn":
            off = np.remainder(off + np.pi, 2 * np.pi) - np.pi
        return None if np.abs(off).max() > CONSTANT else float(rest[0])


def _added(a: tuple[Scalar, Scalar], b: tuple[Scalar, Scalar]) -> tuple[Scalar, Scalar]:
    """Cosine and sine of a sum."""
    return (
        al.sub(al.mul(a[0], b[0]), al.mul(a[1], b[1])),
        al.add(al.mul(a[1], b[0]), al.mul(a[0], b[1])),
    )


def _exact(x: float) -> float:
    return float(round(x)) if abs(x - round(x)) < CONSTANT else float(x)
