"""Helical joint: a screw."""

from __future__ import annotations

import math
from collections.abc import Sequence

from gough import algebra as al
from gough.algebra import Scalar, Transform
from gough.joints import base
from gough.joints.base import Dimensions, JointType, Row, Twist


class Helical(JointType):
    """Rotation of b about the common z axis with an advance of ``pitch`` m a turn; q in rad."""

    name = "helical"
    letter = "H"
    required = ("pitch",)
    rates = ("rad",)

    def placement(self, q: Sequence[Scalar], dimensions: Dimensions) -> Transform:
        return al.rotation_about("z", q[0]), (0.0, 0.0, _advance(dimensions) * q[0])

    def twists(self, q: Sequence[Scalar], dimensions: Dimensions) -> list[Twist]:
        return [((0.0, 0.0, _advance(dimensions)), al.Z)]

    def rows(self, a: Transform, b: Transform, dimensions: Dimensions) -> list[Row]:
        sine, _ = self._lag(a, b, dimensions)
        return [*base.across_axis(a, b), *base.axes_parallel(a, b), Row(sine, "rad")]

    def branch(self, a: Transform, b: Transform, dimensions: Dimensions) -> list[Scalar]:
        _, cosine = self._lag(a, b, dimensions)
        return [base.axes_agree(a, b), cosine]

    @staticmethod
    def _lag(a: Transform, b: Transform, dimensions: Dimensions) -> tuple[Scalar, Scalar]:
        """Sine and cosine of the angle of b about z beyond what its advance asks for.

        The angle is read from the advance and not by an arctangent, so any number of turns is
        told apart.
        """
        turned = al.rotation_about("z", base.along_axis(a, b) / _advance(dimensions))
        x = al.column(al.matmul(a[0], turned), 0)
        y = al.column(al.matmul(a[0], turned), 1)
        x_b = al.column(b[0], 0)
        return al.dot(y, x_b), al.dot(x, x_b)


def _advance(dimensions: Dimensions) -> Scalar:
    """Advance for one radian, m."""
    return dimensions["pitch"] / (2 * math.pi)
