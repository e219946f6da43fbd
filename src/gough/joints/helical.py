"""Helical joint: a screw."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from gough import algebra as al
from gough.algebra import Scalar, Transform
from gough.joints import base
from gough.joints.base import Dimensions, Element, JointType, Poses, Row, Twist


class Helical(JointType):
    """Rotation of b about the common z axis with an advance of ``pitch`` m a turn; q in rad."""

    name = "helical"
    letter = "H"
    holds = ("axis", "line", "advance")
    algebraic = False
    required = ("pitch",)
    rates = ("rad",)

    def placement(self, q: Sequence[Scalar], dimensions: Dimensions) -> Transform:
        return al.rotation_about("z", q[0]), (0.0, 0.0, _advance(dimensions) * q[0])

    def chain(self, dimensions: Dimensions) -> tuple[Element, ...]:
        return Element("turn"), Element("slide", factor=_advance(dimensions))

    def measured(self, T: Poses, dimensions: Mapping[str, float]) -> Poses:
        turns = T[..., 2, 3] / dimensions["pitch"]
        angle = base.angle_about_z(T)
        # the advance tells the number of turns, the rotation the angle
        return (angle + 2 * np.pi * np.round(turns - angle / (2 * np.pi)))[..., None]

    def twists(self, q: Sequence[Scalar], dimensions: Dimensions) -> list[Twist]:
        return [((0.0, 0.0, _advance(dimensions)), al.Z)]

    def rows(self, a: Transform, b: Transform, dimensions: Dimensions) -> list[Row]:
        lag = al.mul(_advance(dimensions), self._lag(a, b, dimensions))
        return [*base.across_axis(a, b), *base.axes_parallel(a, b), Row(lag, "m")]

    def alignment(self, a: Transform, b: Transform, dimensions: Dimensions) -> list[Scalar]:
        return [base.axes_agree(a, b)]

    @staticmethod
    def _lag(a: Transform, b: Transform, dimensions: Dimensions) -> Scalar:
        """Angle of b about z beyond what its advance asks for, rad, in a half turn either way.

        Turns are counted by the advance, so any number of them is told apart.
        """
        turned = al.rotation_about("z", base.along_axis(a, b) / _advance(dimensions))
        expected = al.matmul(a[0], turned)
        x_b = al.column(b[0], 0)
        x, y = (al.dot(al.column(expected, k), x_b) for k in (0, 1))
        return al.atan2(y, x)


def _advance(dimensions: Dimensions) -> Scalar:
    """Advance for one radian, m."""
    return dimensions["pitch"] / (2 * math.pi)
