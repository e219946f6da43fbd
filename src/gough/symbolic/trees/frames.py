"""Turning vectors between the classes of a tree, and where its nodes stand."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from gough import algebra as al
from gough.algebra import Matrix, Scalar, Vector
from gough.symbolic.trees.nodes import Node, Tree, turned

Array = NDArray[np.float64]


class Positions(Protocol):
    """Where the single motions of a tree stand."""

    def circle(self, node: Node) -> tuple[Scalar, Scalar]:
        """Cosine and sine of the angle of a turn."""

    def length(self, node: Node) -> Scalar:
        """Distance of a slide along its axis times its factor, m."""

    def ball(self, node: Node) -> Matrix:
        """Rotation of a ball."""


class Frames:
    """Rotations between classes and arms between nodes, in class axes; every part made once.

    Args:
        tree: the tree.
        positions: of its nodes.
        whole: whether vectors are turned between a class and the root by one matrix, rather than
            step by step; which takes fewer operations depends on the mechanism.
    """

    def __init__(self, tree: Tree, positions: Positions, whole: bool = False) -> None:
        self.tree, self.positions, self.whole = tree, positions, whole
        self._steps: dict[int, Matrix] = {}
        self._wholes: dict[int, Matrix] = {}
        self._arms: dict[int, Vector] = {}

    def above(self, frame: Node) -> Node:
        """The class that a class is carried by."""
        assert frame.parent is not None
        return frame.parent.frame

    def step(self, frame: Node) -> Matrix:
        """Rotation from a class to the one it is carried by."""
        if frame.index not in self._steps:
            self._steps[frame.index] = al.matmul(frame.joint_axes, self._own(frame))
        return self._steps[frame.index]

    def _own(self, frame: Node) -> Matrix:
        if frame.kind == "turn":
            return turned(frame.axis, *self.positions.circle(frame))
        if frame.kind == "ball":
            return self.positions.ball(frame)
        return al.IDENTITY

    def from_root(self, frame: Node) -> Matrix:
        """R_root_class."""
        if frame.index not in self._wholes:
            if frame.parent is None:
                R: Matrix = al.IDENTITY
            else:
                R = al.matmul(self.from_root(self.above(frame)), self.step(frame))
            self._wholes[frame.index] = R
        return self._wholes[frame.index]

    def turn(self, x: Vector, a: Node, b: Node) -> Vector:
        """A vector given in axes of class a, in axes of class b."""
        if a is b or all(al.is_number(k) and k == 0 for k in x):
            return x
        if self.whole and a.parent is None:
            return al.turn(al.transpose(self.from_root(b)), x)
        if self.whole and b.parent is None:
            return al.turn(self.from_root(a), x)
        up, down = self._way(a, b)
        for frame in up:
            x = self._up(frame, x)
        for frame in down:
            x = self._down(frame, x)
        return x

    def _way(self, a: Node, b: Node) -> tuple[list[Node], list[Node]]:
        """Classes to leave upwards, then to enter downwards."""
        up, down = self._line(a), self._line(b)
        while up and down and up[-1] is down[-1]:
            up.pop()
            down.pop()
        return up, down[::-1]

    def _line(self, frame: Node) -> list[Node]:
        line = []
        while frame.parent is not None:
            line.append(frame)
            frame = self.above(frame)
        return line

    def _up(self, frame: Node, x: Vector) -> Vector:
        """Constant axes and the joint's own motion one after the other, since both have zeros."""
        if frame.kind != "turn":
            return al.turn(self.step(frame), x)
        return al.turn(frame.joint_axes, al.turn(self._own(frame), x))

    def _down(self, frame: Node, x: Vector) -> Vector:
        if frame.kind != "turn":
            return al.turn(al.transpose(self.step(frame)), x)
        inner = al.turn(al.transpose(frame.joint_axes), x)
        return al.turn(al.transpose(self._own(frame)), inner)

    def arm(self, node: Node) -> Vector:
        """From the origin of the parent to that of a node, in class axes of the parent."""
        if node.index not in self._arms:
            arm = node.arm
            if node.kind == "slide":
                along = al.scale(self.positions.length(node), self._unit(node))
                arm = al.plus(arm, along)
            self._arms[node.index] = arm
        return self._arms[node.index]

    @staticmethod
    def _unit(node: Node) -> Vector:
        """Axis of a slide without its factor."""
        return al.column(node.joint_axes, node.axis)

    def root_position(self, node: Node, p: Vector) -> Vector:
        """A point of a node, given in class axes, in root axes."""
        at = self.turn(p, node.frame, self.tree.root)
        while node.parent is not None:
            at = al.plus(at, self.turn(self.arm(node), node.parent.frame, self.tree.root))
            node = node.parent
        return at

    def between(self, start: Node, x: Vector, end: Node, y: Vector, axes: Node) -> Vector:
        """From a point of one node to a point of another, in axes of a class."""
        left, right = list(start.ancestors()), list(end.ancestors())
        common = next(node for node in left if node in right)
        found = al.ZERO
        for sign, node, point in ((-1.0, start, x), (1.0, end, y)):
            found = al.plus(found, al.scale(sign, self.turn(point, node.frame, axes)))
            while node is not common:
                assert node.parent is not None
                arm = self.turn(self.arm(node), node.parent.frame, axes)
                found = al.plus(found, al.scale(sign, arm))
                node = node.parent
        return found


Rates = Mapping[int, Scalar]
"""Rate of each kept variable; absent ones are zero."""
