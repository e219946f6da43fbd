"""Convex outlines of points in a plane."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def outline(points: Array, tolerance: float) -> Array:
    """Corners of the convex hull of points in a plane, counter-clockwise.

    Andrew's monotone chain: sorted by x, the lower and the upper chain keep left turns only.

    Args:
        points: (k, 2), m.
        tolerance: distance below which a point counts as on a line, m.

    Returns:
        Corners, (c, 2), m; c is 2 where all points are on one line, 1 where they are one.
    """
    ordered = points[np.lexsort((points[:, 1], points[:, 0]))]
    lower = _chain(ordered, tolerance)
    upper = _chain(ordered[::-1], tolerance)
    corners = np.array([*lower[:-1], *upper[:-1]] or [ordered[0]])
    if len(corners) == 2 and np.linalg.norm(corners[1] - corners[0]) <= tolerance:
        return corners[:1]
    return corners


def _chain(points: Iterable[Array], tolerance: float) -> list[Array]:
    chain: list[Array] = []
    for point in points:
        while len(chain) >= 2 and not _turns_left(chain[-2], chain[-1], point, tolerance):
            chain.pop()
        chain.append(point)
    return chain


def _turns_left(a: Array, b: Array, c: Array, tolerance: float) -> bool:
    """Whether c lies to the left of the line from a through b, or b is not yet a direction."""
    across = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
    reach = max(float(np.linalg.norm(b - a)), float(np.linalg.norm(c - a)))
    return bool(across > tolerance * reach)
