"""Spherical joint: every rotation about a point."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from gough import algebra as al
from gough.algebra import Scalar, Transform
from gough.joints import base, quaternion
from gough.joints.base import Dimensions, Element, JointType, Poses, Row, Twist


class Spherical(JointType):
    """Rotation of b about a common point; q a unit quaternion (w, x, y, z).

    Rates are the angular velocity of b relative to a in axes of a, so no position is special.
    """

    name = "spherical"
    letter = "S"
    holds = ("point",)
    rates = ("rad", "rad", "rad")

    @property
    def labels(self) -> tuple[str, ...]:
        return ("rx", "ry", "rz")

    @property
    def coordinates(self) -> int:
        return 4

    def neutral(self) -> tuple[float, ...]:
        return quaternion.IDENTITY_WXYZ

    @property
    def written(self) -> tuple[int, ...]:
        return (3, 4)

    def position(self, values: Sequence[float]) -> tuple[float, ...]:
        return quaternion.wxyz_from_written(values)

    def position_rates(self, q: Sequence[Scalar]) -> tuple[tuple[Scalar, ...], ...]:
        return quaternion.rates_wxyz(q)

    def retract(self, q: Sequence[float], step: Sequence[float]) -> tuple[float, ...]:
        return quaternion.turned_wxyz(q, step)

    def placement(self, q: Sequence[Scalar], dimensions: Dimensions) -> Transform:
        return al.rotation_from_quaternion_wxyz(q), al.ZERO

    def chain(self, dimensions: Dimensions) -> tuple[Element, ...]:
        return (Element("ball"),)

    def measured(self, T: Poses, dimensions: Mapping[str, float]) -> Poses:
        return quaternion.wxyz_from_rotations(T[..., :3, :3])

    def twists(self, q: Sequence[Scalar], dimensions: Dimensions) -> list[Twist]:
        return [(al.ZERO, axis) for axis in al.IDENTITY]

    def rows(self, a: Transform, b: Transform, dimensions: Dimensions) -> list[Row]:
        return base.points_coincide(a, b)
