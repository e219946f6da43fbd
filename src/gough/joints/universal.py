"""Universal joint: two rotations about crossed axes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from gough import algebra as al
from gough.algebra import Scalar, Transform
from gough.joints import base
from gough.joints.base import Dimensions, Element, JointType, Poses, Row, Twist


class Universal(JointType):
    """Rotation about x of frame a, then about y of frame b; q in rad. R = R_x R_y."""

    name = "universal"
    letter = "U"
    holds = ("point", "crossed")
    rates = ("rad", "rad")

    @property
    def labels(self) -> tuple[str, ...]:
        return ("rx", "ry")

    def placement(self, q: Sequence[Scalar], dimensions: Dimensions) -> Transform:
        return al.matmul(al.rotation_about("x", q[0]), al.rotation_about("y", q[1])), al.ZERO

    def chain(self, dimensions: Dimensions) -> tuple[Element, ...]:
        return Element("turn", axis=0), Element("turn", axis=1, freedom=1)

    def measured(self, T: Poses, dimensions: Mapping[str, float]) -> Poses:
        first = np.arctan2(T[..., 2, 1], T[..., 1, 1])
        second = np.arctan2(T[..., 0, 2], T[..., 0, 0])
        return np.stack([first, second], axis=-1)

    def twists(self, q: Sequence[Scalar], dimensions: Dimensions) -> list[Twist]:
        second = al.column(al.rotation_about("x", q[0]), 1)
        return [(al.ZERO, al.X), (al.ZERO, second)]

    def rows(self, a: Transform, b: Transform, dimensions: Dimensions) -> list[Row]:
        crossed = al.dot(al.column(a[0], 0), al.column(b[0], 1))
        return [*base.points_coincide(a, b), Row(crossed, "rad")]
