"""Constraints between frames of two bodies that are no joint: they only close loops."""

from __future__ import annotations

from collections.abc import Callable

from gough.algebra import Scalar, Transform
from gough.joints import TYPES, base
from gough.joints.base import Row

Rows = Callable[[Transform, Transform], list[Row]]
Alignment = Callable[[Transform, Transform], list[Scalar]]


class Constraint:
    """Equations between two frames, in space and in the plane, and the side they hold on."""

    def __init__(
        self, rows: Rows, planar_rows: Rows, alignment: Alignment, *holds: base.Hold
    ) -> None:
        self.rows, self.planar_rows, self.alignment = rows, planar_rows, alignment
        self.holds = holds


CONSTRAINTS: dict[str, Constraint] = {
    "points-coincide": Constraint(
        base.points_coincide, base.planar_points_coincide, lambda a, b: [], "point"
    ),
    "directions-parallel": Constraint(
        base.axes_parallel,
        base.planar_axes_parallel,
        lambda a, b: [base.axes_agree(a, b)],
        "axis",
    ),
    "frames-coincide": Constraint(
        lambda a, b: TYPES["fixed"].rows(a, b, {}),
        lambda a, b: TYPES["fixed"].planar_rows(a, b, {}),
        lambda a, b: TYPES["fixed"].alignment(a, b, {}),
        "orientation",
        "point",
    ),
}
"""Every constraint by its name: frame origins coincide; z axes are parallel; frames coincide."""
