"""Cylindrical joint: a rotation and a translation about one axis."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from gough import algebra as al
from gough.algebra import Scalar, Transform
from gough.joints import base
from gough.joints.base import Dimensions, Element, JointType, Poses, Row, Twist


class Cylindrical(JointType):
    """Rotation (rad) of b about the common z axis, then translation (m) along it."""

    name = "cylindrical"
    letter = "C"
    holds = ("axis", "line")
    rates = ("rad", "m")

    @property
    def labels(self) -> tuple[str, ...]:
        return ("angle", "length")

    def placement(self, q: Sequence[Scalar], dimensions: Dimensions) -> Transform:
        return al.rotation_about("z", q[0]), (0.0, 0.0, q[1])

    def chain(self, dimensions: Dimensions) -> tuple[Element, ...]:
        return Element("turn"), Element("slide", freedom=1)

    def measured(self, T: Poses, dimensions: Mapping[str, float]) -> Poses:
        return np.stack([base.angle_about_z(T), T[..., 2, 3]], axis=-1)

    def twists(self, q: Sequence[Scalar], dimensions: Dimensions) -> list[Twist]:
        return [(al.ZERO, al.Z), (al.Z, al.ZERO)]

    def rows(self, a: Transform, b: Transform, dimensions: Dimensions) -> list[Row]:
        return base.across_axis(a, b) + base.axes_parallel(a, b)

    def alignment(self, a: Transform, b: Transform, dimensions: Dimensions) -> list[Scalar]:
        return [base.axes_agree(a, b)]
