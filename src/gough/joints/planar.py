"""Planar joint: two translations in a plane and a rotation about its normal."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from gough import algebra as al
from gough.algebra import Scalar, Transform
from gough.joints import base
from gough.joints.base import Dimensions, Element, JointType, Poses, Row, Twist


class Planar(JointType):
    """Translation along x and y of frame a (m), then rotation about z (rad)."""

    name = "planar"
    letter = "E"
    holds = ("axis", "level")
    rates = ("m", "m", "rad")

    @property
    def labels(self) -> tuple[str, ...]:
        return ("x", "y", "rz")

    def placement(self, q: Sequence[Scalar], dimensions: Dimensions) -> Transform:
        return al.rotation_about("z", q[2]), (q[0], q[1], 0.0)

    def chain(self, dimensions: Dimensions) -> tuple[Element, ...]:
        return Element("slide", 0), Element("slide", 1, 1), Element("turn", 2, 2)

    def measured(self, T: Poses, dimensions: Mapping[str, float]) -> Poses:
        return np.stack([T[..., 0, 3], T[..., 1, 3], base.angle_about_z(T)], axis=-1)

    def twists(self, q: Sequence[Scalar], dimensions: Dimensions) -> list[Twist]:
        return [(al.X, al.ZERO), (al.Y, al.ZERO), (al.ZERO, al.Z)]

    def rows(self, a: Transform, b: Transform, dimensions: Dimensions) -> list[Row]:
        return [Row(base.along_axis(a, b), "m"), *base.axes_parallel(a, b)]

    def alignment(self, a: Transform, b: Transform, dimensions: Dimensions) -> list[Scalar]:
        return [base.axes_agree(a, b)]
