"""Fixed joint: no freedom."""

from __future__ import annotations

from collections.abc import Sequence

from gough import algebra as al
from gough.algebra import Scalar, Transform
from gough.joints import base
from gough.joints.base import Dimensions, JointType, Row, Twist


class Fixed(JointType):
    """Frames a and b coincide."""

    name = "fixed"
    letter = ""
    holds = ("orientation", "point")
    rates = ()
    planar = True

    def placement(self, q: Sequence[Scalar], dimensions: Dimensions) -> Transform:
        return al.HERE

    def twists(self, q: Sequence[Scalar], dimensions: Dimensions) -> list[Twist]:
        return []

    def rows(self, a: Transform, b: Transform, dimensions: Dimensions) -> list[Row]:
        return base.points_coincide(a, b) + base.orientations_coincide(a, b)

    def planar_rows(self, a: Transform, b: Transform, dimensions: Dimensions) -> list[Row]:
        points = base.planar_points_coincide(a, b)
        return points + base.planar_orientations_coincide(a, b)

    def alignment(self, a: Transform, b: Transform, dimensions: Dimensions) -> list[Scalar]:
        return [base.orientations_agree(a, b)]
