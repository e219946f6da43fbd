"""Paths of coordinates in straight pieces, with boxes that enclose every part of them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gough.errors import ConfigurationError
from gough.geometry.coordinates import Coordinates

Array = NDArray[np.float64]
Path = ArrayLike | Callable[[float], ArrayLike]

ROUNDING = 2e-15
"""Relative room in boxes for the rounding of points on a path."""
UNIT = 1e-6
"""How far the length of a given quaternion may be from 1."""


class Route:
    """Coordinates along a path, s from 0 to 1.

    Waypoints stand at equal steps of s. Between two of them coordinates change at constant rates;
    quaternions run along the shorter great arc at a constant rate (slerp), so that the platform
    turns about one axis.

    Args:
        coordinates: which they are.
        base: a configuration that has all other positions, (positions,).
        points: waypoints, (m, n), m >= 2, finite; quaternions of length 1.

    Attributes:
        knots: the s of each waypoint, (m,).
    """

    def __init__(self, coordinates: Coordinates, base: Array, points: Array) -> None:
        self.coordinates, self.base = coordinates, base
        self.knots = np.linspace(0.0, 1.0, len(points))
        self.quaternions = [
            slice(k, k + 4) for k, name in enumerate(coordinates.names) if _is_quaternion(name)
        ]
        self.points = self._on_one_side(points)
        self.arcs = np.array(
            [
                [_angle(p[part], q[part]) for part in self.quaternions]
                for p, q in zip(self.points[:-1], self.points[1:], strict=True)
            ]
        ).reshape(len(points) - 1, -1)

    def _on_one_side(self, points: Array) -> Array:
        """Quaternions with the sign nearest to the one before."""
        points = np.array(points)
        for part in self.quaternions:
            for before, here in zip(points[:-1, part], points[1:, part], strict=True):
                if before @ here < 0:
                    here *= -1.0
        return points

    def _piece(self, s: float) -> tuple[int, float]:
        """The straight piece of s, and how far along it s is, 0 to 1."""
        pieces = len(self.knots) - 1
        k = min(max(int(np.searchsorted(self.knots, s, side="right")) - 1, 0), pieces - 1)
        return k, (s - self.knots[k]) / (self.knots[k + 1] - self.knots[k])

    def at(self, s: float) -> Array:
        """The coordinates, (n,)."""
        k, u = self._piece(s)
        p, q = self.points[k], self.points[k + 1]
        x = q.copy() if u == 1.0 else p + u * (q - p)
        for part, arc in zip(self.quaternions, self.arcs[k], strict=True):
            x[part] = _slerp(p[part], q[part], arc, u)
        return np.asarray(x)

    def configuration(self, s: float) -> Array:
        """A configuration with the coordinates of the path, all else as in the base."""
        return self.coordinates.put(self.base, self.at(s))

    def next_knot(self, s: float) -> float:
        """The first waypoint after s."""
        following = int(np.searchsorted(self.knots, s, "right"))
        return float(self.knots[min(following, len(self.knots) - 1)])

    def box(self, start: float, end: float) -> tuple[Array, Array]:
        """Bounds of the configurations between two values of s on one straight piece.

        What is linear in s lies between its ends. A function f of u from 0 to 1 with |f''| <= M is
        within M / 8 of its chord, and f' within M of f(1) - f(0). Along a great arc of φ rad each
        part of a unit quaternion has M <= φ². So it has for the quaternion of a rotation vector v
        that is linear in u, with φ = |Δv| / 2: it is exp(v / 2), whose second derivative is an
        integral of products of two factors Δv / 2 and unit quaternions, over a simplex of volume
        1/2, taken twice.
        """
        ends = self._ends(start, end)
        room = self._rounding(ends) + self._bend(start, end) / 8.0
        return ends.min(axis=0) - room, ends.max(axis=0) + room

    def change(self, start: float, end: float) -> tuple[Array, Array]:
        """Bounds of the derivative of configurations by u, 0 to 1 between two values of s."""
        ends = self._ends(start, end)
        room = 2 * self._rounding(ends) + self._bend(start, end)
        return ends[1] - ends[0] - room, ends[1] - ends[0] + room

    def middle(self, start: float, end: float) -> tuple[Array, Array]:
        """Bounds of the configuration half way between two values of s."""
        q = self.configuration(0.5 * (start + end))
        room = self._rounding(q[None])
        return q - room, q + room

    def _ends(self, start: float, end: float) -> Array:
        return np.array([self.configuration(start), self.configuration(end)])

    @staticmethod
    def _rounding(q: Array) -> Array:
        return np.asarray(ROUNDING * (1.0 + np.abs(q).max(axis=0)))

    def _bend(self, start: float, end: float) -> Array:
        """M of `box` for each position, (positions,)."""
        bend = np.zeros(len(self.base))
        k, _ = self._piece(start)
        share = (end - start) / (self.knots[k + 1] - self.knots[k])
        for part, arc in zip(self.quaternions, self.arcs[k], strict=True):
            bend[self.coordinates.whole[part]] = (arc * share) ** 2
        if self.coordinates.turned:
            places = [place for place, *_ in self.coordinates.turned]
            turn = (self.points[k + 1] - self.points[k])[places] * share
            bend[self.coordinates.turned[0][1]] = 0.25 * float(turn @ turn)
        return bend * (1 + 1e-12)


def checked_points(path: Path, coordinates: Coordinates, samples: int, what: str) -> Array:
    """The waypoints of a path; those of a callable at equal steps.

    Raises:
        ConfigurationError: the shape or a value is wrong; the message says what is expected.
    """
    n, names = len(coordinates), ", ".join(coordinates.names)
    if callable(path):
        rows = [_numbers(path(float(s)), "path(s)") for s in np.linspace(0, 1, samples)]
        for row in rows:
            if row.shape != (n,):
                raise ConfigurationError(
                    f"path(s) has shape {row.shape}, expected ({n},): the {what} {names}"
                )
        points = np.array(rows)
    else:
        points = _numbers(path, "path")
    if points.ndim != 2 or points.shape[1] != n or len(points) < 2:
        raise ConfigurationError(
            f"path has shape {points.shape}, expected (m, {n}) with two waypoints or more, or a "
            f"function of s: the {what} {names}"
        )
    if not np.all(np.isfinite(points)):
        bad = int(np.argmin(np.isfinite(points).all(axis=1)))
        raise ConfigurationError(f"path has entries that are not finite, the first in row {bad}")
    return _with_unit_quaternions(points, coordinates)


def _numbers(given: ArrayLike, what: str) -> Array:
    try:
        return np.array(given, dtype=float)
    except (TypeError, ValueError):
        raise ConfigurationError(
            f"{what} is {given!r:.60}, expected numbers in rows of one length"
        ) from None


def _with_unit_quaternions(points: Array, coordinates: Coordinates) -> Array:
    starts = [k for k, name in enumerate(coordinates.names) if _is_quaternion(name)]
    for k in starts:
        size = np.linalg.norm(points[:, k : k + 4], axis=1, keepdims=True)
        away = np.abs(size - 1).ravel()
        if away.max() > UNIT:
            worst = int(np.argmax(away))
            raise ConfigurationError(
                f"the length of the quaternion in row {worst} of path is {size[worst, 0]:.6g}; "
                f"it must be 1: {', '.join(coordinates.names[k : k + 4])}"
            )
        points[:, k : k + 4] /= size
    return points


def _is_quaternion(name: str) -> bool:
    return name.rpartition(".")[2] == "qw"


def _angle(p: Array, q: Array) -> float:
    """Angle between two unit quaternions, rad."""
    return 2.0 * float(np.arctan2(np.linalg.norm(q - p), np.linalg.norm(q + p)))


def _slerp(p: Array, q: Array, arc: float, u: float) -> Array:
    """The unit quaternion at the part u of a great arc."""
    if u == 1.0:
        return q
    if arc < 1e-6:
        x = p + u * (q - p)
        return np.asarray(x / np.linalg.norm(x))
    return np.asarray((np.sin((1 - u) * arc) * p + np.sin(u * arc) * q) / np.sin(arc))
