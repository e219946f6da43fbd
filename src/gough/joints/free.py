"""Free joint: nothing holds b to a."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from gough import algebra as al
from gough.algebra import Scalar, Transform
from gough.joints import quaternion
from gough.joints.base import Dimensions, Element, JointType, Poses, Row, Twist, Unit

TRANSLATIONS = ("x", "y", "z")
ROTATIONS = ("rx", "ry", "rz")
POSE = TRANSLATIONS + ROTATIONS
AROUND = {"x": (1, 2), "y": (2, 0), "z": (0, 1)}
"""The plane that a rotation about an axis turns, from the first axis to the second."""


@dataclass(frozen=True)
class Free(JointType):
    """Translations, then a rotation, of b in axes of a; all six freedoms or a part of them.

    With all rotations the position ends in a unit quaternion (w, x, y, z) and the rates are the
    twist (linear, angular) of the origin of b in axes of a. A part has any translations and
    either no rotation or one.
    """

    moves: tuple[str, ...] = POSE

    name = "free"
    letter = "F"

    @property
    def rates(self) -> tuple[Unit, ...]:
        return tuple("m" if move in TRANSLATIONS else "rad" for move in self.moves)

    @property
    def labels(self) -> tuple[str, ...]:
        return self.moves

    @property
    def _turns(self) -> tuple[str, ...]:
        return tuple(move for move in self.moves if move in ROTATIONS)

    @property
    def _shifts(self) -> tuple[str, ...]:
        return tuple(move for move in self.moves if move in TRANSLATIONS)

    @property
    def coordinates(self) -> int:
        return len(self._shifts) + (4 if len(self._turns) == 3 else len(self._turns))

    def neutral(self) -> tuple[float, ...]:
        shifts = (0.0,) * len(self._shifts)
        return shifts + (
            quaternion.IDENTITY_WXYZ if len(self._turns) == 3 else (0.0,) * len(self._turns)
        )

    @property
    def written(self) -> tuple[int, ...]:
        n = len(self._shifts)
        return (n + 3, n + 4) if len(self._turns) == 3 else (self.coordinates,)

    def position(self, values: Sequence[float]) -> tuple[float, ...]:
        """Translations as written; three rotations as for a spherical joint."""
        if len(self._turns) < 3:
            return tuple(values)
        n = len(self._shifts)
        return tuple(values[:n]) + quaternion.wxyz_from_written(values[n:])

    def position_rates(self, q: Sequence[Scalar]) -> tuple[tuple[Scalar, ...], ...]:
        if len(self._turns) < 3:
            return super().position_rates(q)
        n, m = len(self._shifts), self.freedoms
        unit = tuple(tuple(1.0 if i == k else 0.0 for k in range(m)) for i in range(n))
        return unit + tuple((0.0,) * n + row for row in quaternion.rates_wxyz(q[n:]))

    def coordinate_of(self, freedom: int) -> int | None:
        return freedom if len(self._turns) < 3 or freedom < len(self._shifts) else None

    def retract(self, q: Sequence[float], step: Sequence[float]) -> tuple[float, ...]:
        if len(self._turns) < 3:
            return super().retract(q, step)
        n = len(self._shifts)
        return super().retract(q[:n], step[:n]) + quaternion.turned_wxyz(q[n:], step[n:])

    def placement(self, q: Sequence[Scalar], dimensions: Dimensions) -> Transform:
        n = len(self._shifts)
        shift = dict(zip(self._shifts, q[:n], strict=True))
        p = tuple(shift.get(axis, 0.0) for axis in TRANSLATIONS)
        return self._rotation(q[n:]), p

    def _rotation(self, q: Sequence[Scalar]) -> al.Matrix:
        match self._turns:
            case ():
                return al.IDENTITY
            case (turn,):
                return al.rotation_about(turn[1], q[0])
        return al.rotation_from_quaternion_wxyz(q)

    def chain(self, dimensions: Dimensions) -> tuple[Element, ...]:
        slides = [
            Element("slide", TRANSLATIONS.index(move), k) for k, move in enumerate(self._shifts)
        ]
        n = len(slides)
        if len(self._turns) == 3:
            return (*slides, Element("ball", freedom=n))
        turns = [Element("turn", ROTATIONS.index(move), n) for move in self._turns]
        return (*slides, *turns)

    def measured(self, T: Poses, dimensions: Mapping[str, float]) -> Poses:
        shifts = [T[..., TRANSLATIONS.index(move), 3] for move in self._shifts]
        if len(self._turns) == 3:
            turns = list(np.moveaxis(quaternion.wxyz_from_rotations(T[..., :3, :3]), -1, 0))
        else:
            pairs = [AROUND[move[1]] for move in self._turns]
            turns = [np.arctan2(T[..., k, i], T[..., i, i]) for i, k in pairs]
        return np.stack([*shifts, *turns], axis=-1) if self.moves else np.zeros((*T.shape[:-2], 0))

    def twists(self, q: Sequence[Scalar], dimensions: Dimensions) -> list[Twist]:
        linear = [(al.AXES[move], al.ZERO) for move in self._shifts]
        return linear + [(al.ZERO, al.AXES[move[1]]) for move in self._turns]

    def rows(self, a: Transform, b: Transform, dimensions: Dimensions) -> list[Row]:
        return []

    def from_pose(self, T: Transform) -> tuple[float, ...]:
        """The position that places b at a pose of numbers, as far as the freedoms reach."""
        R, p = T
        shifts = tuple(p[TRANSLATIONS.index(move)] for move in self._shifts)
        match self._turns:
            case ():
                return shifts
            case (turn,):
                return (*shifts, _angle_about(turn[1], R))
        return shifts + quaternion.wxyz_from_rotation(R)


def _angle_about(axis: str, R: al.Matrix) -> float:
    i, k = AROUND[axis]
    return float(al.atan2(R[k][i], R[i][i]))
