"""Prismatic joint: one translation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from gough import algebra as al
from gough.algebra import Scalar, Transform
from gough.joints import base
from gough.joints.base import Dimensions, Element, JointType, Poses, Row, Twist


class Prismatic(JointType):
    """Translation of b along the common z axis; q in m."""

    name = "prismatic"
    letter = "P"
    holds = ("orientation", "line")
    rates = ("m",)
    planar = True

    def placement(self, q: Sequence[Scalar], dimensions: Dimensions) -> Transform:
        return al.IDENTITY, (0.0, 0.0, q[0])

    def chain(self, dimensions: Dimensions) -> tuple[Element, ...]:
        return (Element("slide"),)

    def measured(self, T: Poses, dimensions: Mapping[str, float]) -> Poses:
        return np.array(T[..., 2, 3, None])

    def twists(self, q: Sequence[Scalar], dimensions: Dimensions) -> list[Twist]:
        return [(al.Z, al.ZERO)]

    def rows(self, a: Transform, b: Transform, dimensions: Dimensions) -> list[Row]:
        return base.across_axis(a, b) + base.orientations_coincide(a, b)

    def planar_rows(self, a: Transform, b: Transform, dimensions: Dimensions) -> list[Row]:
        axis = al.column(a[0], 2)
        normal = (al.sub(0.0, axis[1]), axis[0], 0.0)
        aside = al.dot(normal, al.minus(b[1], a[1]))
        return [Row(aside, "m"), *base.planar_orientations_coincide(a, b)]

    def alignment(self, a: Transform, b: Transform, dimensions: Dimensions) -> list[Scalar]:
        return [base.orientations_agree(a, b)]
