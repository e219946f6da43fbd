"""Parallelogram joint: b moves on a circle without turning."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from gough import algebra as al
from gough.algebra import Scalar, Transform
from gough.joints import base
from gough.joints.base import Dimensions, Element, JointType, Poses, Row, Twist


class Parallelogram(JointType):
    """Two parallel bars of equal ``length`` join a and b; q their angle from x about z, rad.

    ``width`` is the distance of the bars, along y. Bars with a ``bar_mass`` (each a thin uniform
    rod) move as bodies of their own: the description then expands the joint to two bars, three
    pins and two couplings.
    """

    name = "parallelogram"
    letter = "Pa"
    holds = ("orientation", "circle")
    required = ("length", "width")
    optional = ("bar_mass",)
    rates = ("rad",)
    planar = True

    def placement(self, q: Sequence[Scalar], dimensions: Dimensions) -> Transform:
        (x, _, _) = al.transpose(al.rotation_about("z", q[0]))
        return al.IDENTITY, al.scale(dimensions["length"], x)

    def chain(self, dimensions: Dimensions) -> tuple[Element, ...]:
        out = (dimensions["length"], 0.0, 0.0)
        return Element("turn"), Element("turn", factor=-1.0, shift=out)

    def measured(self, T: Poses, dimensions: Mapping[str, float]) -> Poses:
        return np.asarray(np.arctan2(T[..., 1, 3], T[..., 0, 3]))[..., None]

    def twists(self, q: Sequence[Scalar], dimensions: Dimensions) -> list[Twist]:
        (_, y, _) = al.transpose(al.rotation_about("z", q[0]))
        return [(al.scale(dimensions["length"], y), al.ZERO)]

    def rows(self, a: Transform, b: Transform, dimensions: Dimensions) -> list[Row]:
        level = Row(base.along_axis(a, b), "m")
        return [self._circle(a, b, dimensions), level, *base.orientations_coincide(a, b)]

    def planar_rows(self, a: Transform, b: Transform, dimensions: Dimensions) -> list[Row]:
        return [self._circle(a, b, dimensions), *base.planar_orientations_coincide(a, b)]

    def alignment(self, a: Transform, b: Transform, dimensions: Dimensions) -> list[Scalar]:
        return [base.orientations_agree(a, b)]

    @staticmethod
    def _circle(a: Transform, b: Transform, dimensions: Dimensions) -> Row:
        """(|p_b - p_a|² - length²) / (2 length): the distance but for second order, m."""
        length = dimensions["length"]
        offset = al.minus(b[1], a[1])
        return Row((al.dot(offset, offset) - length * length) / (2.0 * length), "m")
