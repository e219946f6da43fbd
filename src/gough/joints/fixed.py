"""Fixed joint: no freedom."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from gough import algebra as al
from gough.algebra import Scalar, Transform
from gough.joints import base
from gough.joints.base import Dimensions, Element, JointType, Poses, Row, Twist


class Fixed(JointType):
    """Frames a and b coincide."""

    name = "fixed"
    letter = ""
    holds = ("orientation", "point")
    rates = ()
    planar = True

    def placement(self, q: Sequence[Scalar], dimensions: Dimensions) -> Transform:
        return al.HERE

    def chain(self, dimensions: Dimensions) -> tuple[Element, ...]:
        return ()

    def measured(self, T: Poses, dimensions: Mapping[str, float]) -> Poses:
        return np.zeros((*T.shape[:-2], 0))

    def twists(self, q: Sequence[Scalar], dimensions: Dimensions) -> list[Twist]:
        return []

    def rows(self, a: Transform, b: Transform, dimensions: Dimensions) -> list[Row]:
        return base.points_coincide(a, b) + base.orientations_coincide(a, b)

    def planar_rows(self, a: Transform, b: Transform, dimensions: Dimensions) -> list[Row]:
        points = base.planar_points_coincide(a, b)
        return points + base.planar_orientations_coincide(a, b)

    def alignment(self, a: Transform, b: Transform, dimensions: Dimensions) -> list[Scalar]:
        return [base.orientations_agree(a, b)]
