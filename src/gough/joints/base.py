"""What every joint type states: its freedom, its placement, and the rows it closes a loop with."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from gough import algebra as al
from gough.algebra import Scalar, Transform, Vector

Unit = Literal["m", "rad"]
Poses = NDArray[np.float64]
Dimensions = Mapping[str, Scalar]
Hold = Literal["point", "axis", "orientation", "line", "level", "circle", "crossed", "advance"]
"""A condition on frames a and b: their origins coincide; their z axes agree; all axes agree; the
origin of b lies on the z axis of a, in its x-y plane, or there on a circle of the joint's
``length``; the x axis of a is normal to the y axis of b; b advances along z by the joint's
``pitch`` for each turn."""
Twist = tuple[Vector, Vector]
"""(linear, angular): velocity of the origin of frame b, angular velocity; in axes of frame a."""


@dataclass(frozen=True)
class Element:
    """One step of a joint written as a chain of single motions from frame a to frame b.

    First the shift, along the axes reached so far; then a turn (rad) about an axis, a slide (m)
    along it, or a ball, any rotation with a unit quaternion as position. The motion is ``factor``
    times the position of the freedom.
    """

    kind: Literal["turn", "slide", "ball"]
    axis: int = 2
    """0, 1 or 2 for x, y or z."""
    freedom: int = 0
    """The freedom that moves it, the first of three for a ball."""
    factor: Scalar = 1.0
    shift: Vector = al.ZERO


@dataclass(frozen=True)
class Row:
    """One scalar closure equation: its residual, zero when closed, and the unit of the residual."""

    residual: Scalar
    unit: Unit


class JointType(ABC):
    """A type of joint between a frame a and a frame b; stateless.

    Positions ``q`` may be more numbers than freedoms (unit quaternions); rates always are one per
    freedom. ``dimensions`` are the numbers a type needs besides its frames, such as a pitch.
    """

    name: ClassVar[str]
    letter: ClassVar[str]
    """The letter of the joint in the name of a leg: U, P and S in 6-UPS."""
    holds: ClassVar[tuple[Hold, ...]] = ()
    """What it says of frames a and b."""
    algebraic: ClassVar[bool] = True
    """Whether polynomials can say ``holds``; an angle that is also a length is transcendental."""
    required: ClassVar[tuple[str, ...]] = ()
    optional: ClassVar[tuple[str, ...]] = ()
    planar: ClassVar[bool] = False
    """Whether the type exists in a mechanism that moves in one plane."""

    @property
    @abstractmethod
    def rates(self) -> tuple[Unit, ...]:
        """Unit of the rate of each freedom, without the second; its length counts the freedoms."""

    @property
    def freedoms(self) -> int:
        """How many freedoms the joint has."""
        return len(self.rates)

    @property
    def labels(self) -> tuple[str, ...]:
        """A short name for each freedom; a single freedom needs none."""
        return ("",) if self.freedoms == 1 else tuple(str(k + 1) for k in range(self.freedoms))

    @property
    def coordinates(self) -> int:
        """How many numbers a position takes."""
        return len(self.rates)

    def neutral(self) -> tuple[float, ...]:
        """The position in which frames a and b coincide, as far as the type can."""
        return (0.0,) * self.coordinates

    def position(self, values: Sequence[float]) -> tuple[float, ...]:
        """The position for the numbers a person writes under ``home``."""
        return tuple(values)

    @property
    def written(self) -> tuple[int, ...]:
        """How many numbers a person may write for one position."""
        return (self.coordinates,)

    def position_rates(self, q: Sequence[Scalar]) -> tuple[tuple[Scalar, ...], ...]:
        """Matrix H with dq/dt = H rates, (coordinates, freedoms)."""
        n = self.freedoms
        return tuple(tuple(1.0 if i == k else 0.0 for k in range(n)) for i in range(n))

    def coordinate_of(self, freedom: int) -> int | None:
        """Which number of the position has the freedom's rate as its own, if there is one."""
        return freedom if self.coordinates == self.freedoms else None

    def retract(self, q: Sequence[float], step: Sequence[float]) -> tuple[float, ...]:
        """The position reached from q by rates ``step`` held for a unit of time."""
        return tuple(x + d for x, d in zip(q, step, strict=True))

    @abstractmethod
    def placement(self, q: Sequence[Scalar], dimensions: Dimensions) -> Transform:
        """T_a_b for a position."""

    @abstractmethod
    def chain(self, dimensions: Dimensions) -> tuple[Element, ...]:
        """The joint as single motions one after the other; its placement is their product."""

    @abstractmethod
    def measured(self, T: Poses, dimensions: Mapping[str, float]) -> Poses:
        """The position of frame b in frame a, the inverse of ``placement``.

        Args:
            T: T_a_b as the joint allows them, (*batch, 4, 4).
            dimensions: numbers the type needs besides its frames.

        Returns:
            Positions, angles in (-π, π], (*batch, coordinates).
        """

    @abstractmethod
    def twists(self, q: Sequence[Scalar], dimensions: Dimensions) -> list[Twist]:
        """The twist of frame b relative to frame a for a unit rate of each freedom."""

    @abstractmethod
    def rows(self, a: Transform, b: Transform, dimensions: Dimensions) -> list[Row]:
        """The equations that frames a and b, in common axes, obey when this joint joins them."""

    def planar_rows(self, a: Transform, b: Transform, dimensions: Dimensions) -> list[Row]:
        """The same for a mechanism that moves in the x-y plane of the common axes."""
        raise TypeError(f"{self.name} has no planar form")

    def alignment(self, a: Transform, b: Transform, dimensions: Dimensions) -> list[Scalar]:
        """Cosines that are 1 where the joint is closed on the side it can reach.

        Antiparallel axes and half turns solve the rows too, with a cosine of -1 here. What is
        missing to 1 has no slope at a closed joint: it adds nothing to the rows, and tells sides.
        """
        return []


def points_coincide(a: Transform, b: Transform) -> list[Row]:
    """Origins of a and b coincide: p_b - p_a, 3 rows of rank 3."""
    return [Row(component, "m") for component in al.minus(b[1], a[1])]


def axes_parallel(a: Transform, b: Transform) -> list[Row]:
    """The z axes are parallel: x_a·z_b and y_a·z_b, 2 rows of rank 2.

    The gradient of z_a·z_b - 1 is zero at the solution, so that form is never used.
    """
    z = al.column(b[0], 2)
    return [Row(al.dot(al.column(a[0], k), z), "rad") for k in (0, 1)]


def axes_agree(a: Transform, b: Transform) -> Scalar:
    """z_a·z_b: 1 where parallel axes point the same way, -1 where they oppose."""
    return al.dot(al.column(a[0], 2), al.column(b[0], 2))


def orientations_coincide(a: Transform, b: Transform) -> list[Row]:
    """½ vee(E - Eᵀ) with E = R_aᵀ R_b: 3 rows of rank 3; half turns solve them too."""
    E = al.matmul(al.transpose(a[0]), b[0])
    pairs = ((2, 1), (0, 2), (1, 0))
    return [Row(al.mul(0.5, al.sub(E[i][k], E[k][i])), "rad") for i, k in pairs]


def orientations_agree(a: Transform, b: Transform) -> Scalar:
    """(trace(R_aᵀ R_b) - 1) / 2: the cosine of the angle of the turn from a to b."""
    E = al.matmul(al.transpose(a[0]), b[0])
    return al.mul(0.5, al.sub(al.total([E[0][0], E[1][1], E[2][2]]), 1.0))


def across_axis(a: Transform, b: Transform) -> list[Row]:
    """The origin of b lies on the z axis of a: 2 rows."""
    offset = al.minus(b[1], a[1])
    return [Row(al.dot(al.column(a[0], k), offset), "m") for k in (0, 1)]


def along_axis(a: Transform, b: Transform) -> Scalar:
    """Coordinate of the origin of b along the z axis of a, m."""
    return al.dot(al.column(a[0], 2), al.minus(b[1], a[1]))


def planar_points_coincide(a: Transform, b: Transform) -> list[Row]:
    """Origins coincide in the x-y plane: 2 rows."""
    return points_coincide(a, b)[:2]


def planar_axes_parallel(a: Transform, b: Transform) -> list[Row]:
    """The sine of the angle between the z axes, which lie in the x-y plane: 1 row."""
    z_a, z_b = al.column(a[0], 2), al.column(b[0], 2)
    return [Row(al.cross(z_a, z_b)[2], "rad")]


def planar_orientations_coincide(a: Transform, b: Transform) -> list[Row]:
    """The sine of the angle from a to b about the common z axis: 1 row."""
    k = _in_plane(a)
    x_a, x_b = al.column(a[0], k), al.column(b[0], k)
    return [Row(al.sub(al.mul(x_a[0], x_b[1]), al.mul(x_a[1], x_b[0])), "rad")]


def _in_plane(frame: Transform) -> int:
    """A column of a frame in the plane: x, or y where x is the normal."""
    out_of_plane = frame[0][2][0]
    return 1 if al.is_number(out_of_plane) and abs(out_of_plane) > 0.5 else 0


def angle_about_z(T: Poses) -> Poses:
    """The angle of a rotation about z, rad, (*batch,)."""
    return np.asarray(np.arctan2(T[..., 1, 0], T[..., 0, 0]))
