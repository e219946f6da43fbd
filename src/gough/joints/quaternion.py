"""Unit quaternions (w, x, y, z) as positions of joints with three rotations."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from gough.algebra import Matrix, Scalar

IDENTITY_WXYZ = (1.0, 0.0, 0.0, 0.0)


def rates_wxyz(q: Sequence[Scalar]) -> tuple[tuple[Scalar, ...], ...]:
    """Matrix H with dq/dt = H omega for omega in axes of a, (4, 3): half of (0, omega) ⊗ q."""
    w, x, y, z = (0.5 * component for component in q)
    return ((-x, -y, -z), (w, z, -y), (-z, w, x), (y, -x, w))


def wxyz_from_rotation_vector(v: Sequence[float]) -> tuple[float, ...]:
    """Quaternion of the rotation by |v| rad about v."""
    angle = math.hypot(*v)
    half_sinc = 0.5 if angle < 1e-8 else math.sin(angle / 2) / angle
    return (math.cos(angle / 2), *(half_sinc * component for component in v))


def wxyz_from_written(values: Sequence[float]) -> tuple[float, ...]:
    """From three numbers, a rotation vector in rad; from four, a quaternion (w, x, y, z)."""
    if len(values) == 3:
        return wxyz_from_rotation_vector(values)
    return normalised_wxyz(values)


def normalised_wxyz(q: Sequence[float]) -> tuple[float, ...]:
    """q / |q|."""
    size = math.hypot(*q)
    return tuple(component / size for component in q)


def product_wxyz(a: Sequence[float], b: Sequence[float]) -> tuple[float, ...]:
    """a ⊗ b: the rotation b, then a."""
    aw, ax, ay, az = a
    bw, bx, by, bz = b
    return (
        aw * bw - ax * bx - ay * by - az * bz,
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
    )


def turned_wxyz(q: Sequence[float], v: Sequence[float]) -> tuple[float, ...]:
    """q turned by the rotation vector v, given in axes of a."""
    return normalised_wxyz(product_wxyz(wxyz_from_rotation_vector(v), q))


def wxyz_from_rotation(R: Matrix) -> tuple[float, ...]:
    """Unit quaternion of a rotation of numbers, by its largest component (Shepperd 1978)."""
    diagonal = (R[0][0], R[1][1], R[2][2])
    squares = [1 + sum(diagonal)] + [1 - sum(diagonal) + 2 * d for d in diagonal]
    largest = max(range(4), key=lambda k: squares[k])
    w = (squares[0], R[2][1] - R[1][2], R[0][2] - R[2][0], R[1][0] - R[0][1])
    x = (w[1], squares[1], R[0][1] + R[1][0], R[0][2] + R[2][0])
    y = (w[2], x[2], squares[2], R[1][2] + R[2][1])
    z = (w[3], x[3], y[3], squares[3])
    return normalised_wxyz((w, x, y, z)[largest])


def wxyz_from_rotations(R: NDArray[np.float64]) -> NDArray[np.float64]:
    """Unit quaternions of rotations, (*batch, 3, 3) -> (*batch, 4), as `wxyz_from_rotation`."""
    d = [R[..., k, k] for k in range(3)]
    squares = np.stack([1 + d[0] + d[1] + d[2]] + [1 - sum(d) + 2 * x for x in d], axis=-1)
    minus = [R[..., i, k] - R[..., k, i] for i, k in ((2, 1), (0, 2), (1, 0))]
    plus = {(i, k): R[..., i, k] + R[..., k, i] for i in range(3) for k in range(i)}
    rows = [
        [squares[..., 0], *minus],
        [minus[0], squares[..., 1], plus[1, 0], plus[2, 0]],
        [minus[1], plus[1, 0], squares[..., 2], plus[2, 1]],
        [minus[2], plus[2, 0], plus[2, 1], squares[..., 3]],
    ]
    table = np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)
    largest = np.argmax(squares, axis=-1)[..., None, None]
    q = np.take_along_axis(table, largest, axis=-2)[..., 0, :]
    return np.asarray(q / np.linalg.norm(q, axis=-1, keepdims=True))
