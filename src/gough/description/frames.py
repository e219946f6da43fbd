"""Frames of a description as transforms."""

from __future__ import annotations

from typing import Any

from gough import algebra as al
from gough.algebra import Matrix, Transform, Vector
from gough.description.expression import ExpressionError
from gough.description.parts import Frame
from gough.description.values import Values, scalar, vector
from gough.errors import GoughError

STEEP = 0.7
"""An axis with a z component beyond this, some 45 degrees, takes its x from the body's x axis."""
UNIT_TOLERANCE = 1e-6
"""How far the length of an axis may be from 1. Axes typed with seven digits pass."""


class FrameError(GoughError, ValueError):
    """A frame can not be built; ``field`` names the entry at fault."""

    def __init__(self, field: str, message: str) -> None:
        self.field = field
        super().__init__(message)


def transform(frame: Frame, values: Values, nominal: Values | None = None) -> Transform:
    """T_body_frame.

    Args:
        frame: the frame as described.
        values: value of each parameter, numbers or symbols.
        nominal: numbers for the same parameters where ``values`` holds symbols; choices are
            made with these.

    Raises:
        FrameError: an entry has no value, an axis is no unit vector, directions are parallel.
    """
    R = _rotation(frame, values, values if nominal is None else nominal)
    origin = _vector(frame, "point", values)
    if frame.offset is not None:
        origin = al.plus(origin, al.turn(R, _vector(frame, "offset", values)))
    return R, origin


def _rotation(frame: Frame, values: Values, nominal: Values) -> Matrix:
    if frame.axis is None:
        if frame.across is not None:
            raise FrameError("across", "across goes with axis, which is missing")
        return _rotate(frame, values)
    if frame.rotate:
        raise FrameError("rotate", "a frame has axis or rotate, not both")
    return _from_axes(frame, values, nominal)


def _rotate(frame: Frame, values: Values) -> Matrix:
    R = al.IDENTITY
    for axis, angle in frame.rotate:
        try:
            R = al.matmul(R, al.rotation_about(axis, scalar(angle, values)))
        except ExpressionError as error:
            raise FrameError("rotate", str(error)) from None
    return _snapped(R)


def _from_axes(frame: Frame, values: Values, nominal: Values) -> Matrix:
    """Columns x, y, z with z the axis and x the part of ``across`` normal to it."""
    axis = _vector(frame, "axis", nominal)
    length = float(al.norm(axis))
    if length == 0:
        raise FrameError("axis", "the axis is zero and gives no direction")
    if abs(length - 1) > UNIT_TOLERANCE:
        ready = ", ".join(f"{component / length:.9g}" for component in axis)
        raise FrameError("axis", f"the axis has length {length:.6g}, not 1: write [{ready}]")
    if frame.across is None:
        across: Vector = al.Z if abs(axis[2]) < STEEP else al.X
    else:
        if float(al.norm(al.cross(axis, _vector(frame, "across", nominal)))) < UNIT_TOLERANCE:
            raise FrameError("across", "across is zero or parallel to the axis")
        across = _vector(frame, "across", values)
    z = al.unit(_vector(frame, "axis", values))
    x = al.unit(al.minus(across, al.scale(al.dot(across, z), z)))
    return _snapped(al.from_columns(x, al.cross(z, x), z))


def _snapped(R: Matrix) -> Matrix:
    return tuple(tuple(al.snap(entry) for entry in row) for row in R)  # type: ignore[return-value]


def _vector(frame: Frame, field: str, values: Values) -> Vector:
    try:
        items: tuple[Any, ...] = vector(getattr(frame, field), values, 2, 3)
    except ExpressionError as error:
        raise FrameError(field, str(error)) from None
    return (items[0], items[1], items[2] if len(items) == 3 else 0.0)
