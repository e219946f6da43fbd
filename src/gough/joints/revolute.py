"""Revolute joint: one rotation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from gough import algebra as al
from gough.algebra import Scalar, Transform
from gough.joints import base
from gough.joints.base import Dimensions, Element, JointType, Poses, Row, Twist


class Revolute(JointType):
    """Rotation of b about the common z axis; q in rad."""

    name = "revolute"
    letter = "R"
    holds = ("point", "axis")
    rates = ("rad",)
    planar = True

    def placement(self, q: Sequence[Scalar], dimensions: Dimensions) -> Transform:
        return al.rotation_about("z", q[0]), al.ZERO

    def chain(self, dimensions: Dimensions) -> tuple[Element, ...]:
        return (Element("turn"),)

    def measured(self, T: Poses, dimensions: Mapping[str, float]) -> Poses:
        return base.angle_about_z(T)[..., None]

    def twists(self, q: Sequence[Scalar], dimensions: Dimensions) -> list[Twist]:
        return [(al.ZERO, al.Z)]

    def rows(self, a: Transform, b: Transform, dimensions: Dimensions) -> list[Row]:
        return base.points_coincide(a, b) + base.axes_parallel(a, b)

    def planar_rows(self, a: Transform, b: Transform, dimensions: Dimensions) -> list[Row]:
        return base.planar_points_coincide(a, b)

    def alignment(self, a: Transform, b: Transform, dimensions: Dimensions) -> list[Scalar]:
        return [base.axes_agree(a, b)]
