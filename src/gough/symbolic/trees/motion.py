"""Velocities and accelerations of the nodes of a tree, in class axes, found when asked for."""

from __future__ import annotations

from collections.abc import Collection, Mapping

import numpy as np
from numpy.typing import NDArray

from gough import algebra as al
from gough.algebra import Matrix, Scalar, Vector
from gough.symbolic.screws import combined_sparse
from gough.symbolic.trees.frames import Frames, Rates
from gough.symbolic.trees.nodes import Node

Array = NDArray[np.float64]
Twisted = tuple[Vector, Node]
"""A vector and the class in whose axes it stands."""


class Motion:
    """The motion of a tree for some rates.

    ω = ω_p + u q̇,  α = α_p + u q̈ + ω × u q̇,  a = a_p + (α̂ + ω̂²) r (+ u q̈ + 2 ω × u q̇ along slides)

    (Khalil and Dombre 2002, 9.5). Zero rates cost nothing.

    Args:
        frames: where the tree stands.
        C: all rates v = C w of kept rates w.
        w: kept rates.
        wd: kept accelerations; only velocities are asked for without.
        gravity: in root axes; the root then accelerates by its opposite.
        still: nodes that are at rest whatever their rates, for motions relative to one of them.
    """

    def __init__(
        self,
        frames: Frames,
        C: Array,
        w: Rates,
        wd: Rates | None = None,
        gravity: Vector | None = None,
        still: Collection[Node] = (),
    ) -> None:
        self.frames, self._C = frames, C
        self._w, self._wd = w, wd or {}
        self._root = al.ZERO if gravity is None else al.scale(-1.0, gravity)
        self._still = {node.index for node in still}
        self._spins: dict[int, Vector] = {}
        self._spin_rates: dict[int, Vector] = {}
        self._tensors: dict[int, Matrix] = {}
        self._velocities: dict[int, Vector] = {}
        self._accelerations: dict[int, Vector] = {}

    def _rates(self, node: Node, given: Mapping[int, Scalar]) -> tuple[Scalar, ...]:
        """Rates of a node's variables."""
        if node.index in self._still:
            return (0.0,) * len(node.variables)
        return tuple(combined_sparse(self._C[v], given) for v in node.variables)

    def rate(self, node: Node) -> Scalar:
        """Rate of a turn or a slide, without its factor."""
        return self._rates(node, self._w)[0]

    def rate_change(self, node: Node) -> Scalar:
        """Acceleration of a turn or a slide, without its factor."""
        return self._rates(node, self._wd)[0]

    def variable_rate(self, variable: int) -> Scalar:
        """Rate of one variable."""
        return combined_sparse(self._C[variable], self._w)

    def variable_rate_change(self, variable: int) -> Scalar:
        """Acceleration of one variable."""
        return combined_sparse(self._C[variable], self._wd)

    def ball_rate(self, node: Node, given: Mapping[int, Scalar]) -> Vector:
        """Angular rates of a ball: in outer axes, or in its own if the tree passes it backwards."""
        x, y, z = self._rates(node, given)
        axes = node.to_class if node.reversed else node.joint_axes
        return al.scale(node.factor, al.turn(axes, (x, y, z)))

    # angular

    def spin(self, frame: Node) -> Vector:
        """ω of a class."""
        if frame.index not in self._spins:
            self._spins[frame.index] = self._spin(frame)
        return self._spins[frame.index]

    def _spin(self, frame: Node) -> Vector:
        if frame.parent is None:
            return al.ZERO
        above = frame.parent.frame
        if frame.kind == "ball":
            if not frame.reversed:
                return self.frames.turn(self.outer_spin(frame), above, frame)
            own = self.ball_rate(frame, self._w)
        else:
            own = al.scale(self.rate(frame), frame.unit)
        return al.plus(self.frames.turn(self.spin(above), above, frame), own)

    def outer_spin(self, ball: Node) -> Vector:
        """ω of a ball, in axes of the class before it."""
        assert ball.parent is not None
        if ball.reversed:
            return self.frames.turn(self.spin(ball.frame), ball.frame, ball.outer)
        return al.plus(self.spin(ball.outer), self.ball_rate(ball, self._w))

    def spin_rate(self, frame: Node) -> Vector:
        """α of a class."""
        if frame.index not in self._spin_rates:
            self._spin_rates[frame.index] = self._spin_rate(frame)
        return self._spin_rates[frame.index]

    def _spin_rate(self, frame: Node) -> Vector:
        if frame.parent is None:
            return al.ZERO
        above = frame.parent.frame
        if frame.kind == "ball" and not frame.reversed:
            return self.frames.turn(self.outer_spin_rate(frame), above, frame)
        if frame.kind == "ball":
            rate, change = (self.ball_rate(frame, given) for given in (self._w, self._wd))
        else:
            rate = al.scale(self.rate(frame), frame.unit)
            change = al.scale(self.rate_change(frame), frame.unit)
        carried = self.frames.turn(self.spin_rate(above), above, frame)
        return al.plus(al.plus(carried, change), al.cross(self.spin(frame), rate))

    def outer_spin_rate(self, ball: Node) -> Vector:
        """α of a ball, in axes of the class before it."""
        if ball.reversed:
            return self.frames.turn(self.spin_rate(ball.frame), ball.frame, ball.outer)
        above = ball.outer
        turning = al.cross(self.spin(above), self.ball_rate(ball, self._w))
        return al.plus(al.plus(self.spin_rate(above), self.ball_rate(ball, self._wd)), turning)

    def tensor(self, frame: Node) -> Matrix:
        """α̂ + ω̂², which gives the acceleration of points fixed in a class."""
        if frame.index not in self._tensors:
            self._tensors[frame.index] = tensor(self.spin(frame), self.spin_rate(frame))
        return self._tensors[frame.index]

    # linear

    def velocity(self, node: Node) -> Vector:
        """Velocity of a node's origin, in its class axes."""
        if node.index not in self._velocities:
            if node.parent is None:
                self._velocities[node.index] = al.ZERO
            else:
                above = node.parent.frame
                found = self.frames.turn(self.outer_velocity(node), above, node.frame)
                self._velocities[node.index] = found
        return self._velocities[node.index]

    def outer_velocity(self, node: Node) -> Vector:
        """Velocity of a node's origin, in class axes of its parent."""
        parent = node.parent
        assert parent is not None
        carried = al.cross(self.spin(parent.frame), self.frames.arm(node))
        found = al.plus(self.velocity(parent), carried)
        if node.kind == "slide":
            found = al.plus(found, al.scale(self.rate(node), node.direction))
        return found

    def acceleration(self, node: Node) -> Vector:
        """Acceleration of a node's origin, in its class axes."""
        if node.index not in self._accelerations:
            if node.parent is None:
                self._accelerations[node.index] = self._root
            else:
                above = node.parent.frame
                found = self.frames.turn(self.outer_acceleration(node), above, node.frame)
                self._accelerations[node.index] = found
        return self._accelerations[node.index]

    def outer_acceleration(self, node: Node) -> Vector:
        """Acceleration of a node's origin, in class axes of its parent."""
        parent = node.parent
        assert parent is not None
        carried = al.turn(self.tensor(parent.frame), self.frames.arm(node))
        found = al.plus(self.acceleration(parent), carried)
        if node.kind == "slide":
            change = al.scale(self.rate_change(node), node.direction)
            rate = al.scale(al.mul(2.0, self.rate(node)), node.direction)
            turning = al.cross(self.spin(parent.frame), rate)
            found = al.plus(al.plus(found, change), turning)
        return found

    def point_velocity(self, node: Node, p: Vector) -> Twisted:
        """Velocity of a point fixed to a node, in the axes where it is cheapest."""
        if node.kind == "ball" and not node.reversed:
            r = self.frames.turn(p, node.frame, node.outer)
            turning = al.cross(self.outer_spin(node), r)
            return al.plus(self.outer_velocity(node), turning), node.outer
        return al.plus(self.velocity(node), al.cross(self.spin(node.frame), p)), node.frame

    def point_acceleration(self, node: Node, p: Vector) -> Twisted:
        """Acceleration of a point fixed to a node, in the axes where it is cheapest."""
        if node.kind == "ball" and not node.reversed:
            r, spin = self.frames.turn(p, node.frame, node.outer), self.outer_spin(node)
            turning = al.cross(spin, al.cross(spin, r))
            found = al.plus(al.cross(self.outer_spin_rate(node), r), turning)
            return al.plus(self.outer_acceleration(node), found), node.outer
        carried = al.turn(self.tensor(node.frame), p)
        return al.plus(self.acceleration(node), carried), node.frame


def tensor(spin: Vector, rate: Vector) -> Matrix:
    """α̂ + ω̂²."""
    xx, yy, zz = (al.mul(x, x) for x in spin)
    xy, xz, yz = (al.mul(spin[i], spin[k]) for i, k in ((0, 1), (0, 2), (1, 2)))

    def both(a: Scalar, b: Scalar) -> Scalar:
        return al.mul(-1.0, al.add(a, b))

    return (
        (both(yy, zz), al.sub(xy, rate[2]), al.add(xz, rate[1])),
        (al.add(xy, rate[2]), both(xx, zz), al.sub(yz, rate[0])),
        (al.sub(xz, rate[1]), al.add(yz, rate[0]), both(xx, yy)),
    )
