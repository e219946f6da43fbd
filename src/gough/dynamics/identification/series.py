"""Periodic motions as finite Fourier series, and rotations that follow a rotation vector."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

FINE = 64
"""Points of a period for each harmonic, at which the range of a series is read."""
SMALL = 0.05
"""Angle in rad below which power series take the place of quotients that lose digits."""


def series(coefficients: Array, frequency: float, time: Array) -> tuple[Array, Array, Array]:
    """Σ_l a_l sin(l ω t) + b_l cos(l ω t) with first and second derivative, (times, n) each.

    Args:
        coefficients: a and b of each coordinate, (n, 2, harmonics).
        frequency: of the first harmonic, Hz.
        time: s, (times,).
    """
    rates = 2 * np.pi * frequency * np.arange(1, coefficients.shape[2] + 1)
    s, c = np.sin(np.outer(time, rates)), np.cos(np.outer(time, rates))
    a, b = coefficients[:, 0], coefficients[:, 1]
    value = s @ a.T + c @ b.T
    first = (c * rates) @ a.T - (s * rates) @ b.T
    return value, first, -((s * rates**2) @ a.T + (c * rates**2) @ b.T)


def fitted(coefficients: Array, low: Array, high: Array) -> tuple[Array, Array]:
    """Series made smaller where they are wider than their ranges, and offsets that put them inside.

    Args:
        coefficients: (n, 2, harmonics).
        low: of each range, from the centre, (n,).
        high: (n,).

    Returns:
        Coefficients, (n, 2, harmonics), and offsets, (n,), as near to 0 as they can be.
    """
    count = FINE * coefficients.shape[2]
    value, _, _ = series(coefficients, 1.0, np.arange(count) / count)
    # between points a series is off by |s''| (h/2)²/2 at most, since s' = 0 at an extremum
    rates = 2 * np.pi * np.arange(1, coefficients.shape[2] + 1)
    between = np.hypot(coefficients[:, 0], coefficients[:, 1]) @ rates**2 / (8 * count**2)
    lowest, highest = value.min(axis=0) - between, value.max(axis=0) + between
    factor = np.minimum(1.0, (high - low) / np.maximum(highest - lowest, 1e-300))
    least, most = low - factor * lowest, high - factor * highest
    return coefficients * factor[:, None, None], np.clip(0.0, least, np.maximum(least, most))


# rotations


def turned(r: Array, rd: Array, rdd: Array, quaternion_wxyz: Array) -> tuple[Array, Array, Array]:
    """The rotation exp(r) after a constant one, its angular velocity and acceleration.

    In axes that do not turn, with A = (1 - cos θ)/θ², B = (θ - sin θ)/θ³ and θ = |r|:

        ω = J ṙ,   α = J r̈ + J̇ ṙ,   J = 1 + A [r] + B [r]²

    Args:
        r: rotation vectors, rad, (rows, 3).
        rd: their rates, (rows, 3).
        rdd: their second derivatives, (rows, 3).
        quaternion_wxyz: the constant rotation, unit, (4,).

    Returns:
        Unit quaternions (w, x, y, z), (rows, 4), rad/s, (rows, 3), and rad/s², (rows, 3).
    """
    A, B, dA, dB = _factors(np.linalg.norm(r, axis=1)[:, None])
    along = np.sum(r * rd, axis=1, keepdims=True)
    cross, twice = np.cross(r, rd), np.cross(r, np.cross(r, rd))
    omega = rd + A * cross + B * twice
    alpha = rdd + A * np.cross(r, rdd) + B * np.cross(r, np.cross(r, rdd))
    alpha += along * (dA * cross + dB * twice) + B * np.cross(rd, cross)
    return _product(_exponential(r), quaternion_wxyz), omega, alpha


def _factors(angle: Array) -> tuple[Array, Array, Array, Array]:
    """A, B, and their derivatives by θ over θ."""
    square, large = angle**2, np.where(angle < SMALL, 1.0, angle)
    s, c = np.sin(large), np.cos(large)
    exact = (
        (1 - c) / large**2,
        (large - s) / large**3,
        (large * s - 2 * (1 - c)) / large**4,
        (3 * s - 2 * large - large * c) / large**5,
    )
    near = (
        1 / 2 - square / 24 + square**2 / 720 - square**3 / 40320,
        1 / 6 - square / 120 + square**2 / 5040 - square**3 / 362880,
        -1 / 12 + square / 180 - square**2 / 6720 + square**3 / 453600,
        -1 / 60 + square / 1260 - square**2 / 60480 + square**3 / 4989600,
    )
    small = angle < SMALL
    A, B, dA, dB = (np.where(small, n, e) for n, e in zip(near, exact, strict=True))
    return A, B, dA, dB


def _exponential(r: Array) -> Array:
    """Unit quaternions of rotation vectors."""
    half = np.linalg.norm(r, axis=1, keepdims=True) / 2
    found = np.hstack([np.cos(half), 0.5 * np.sinc(half / np.pi) * r])
    return np.asarray(found / np.linalg.norm(found, axis=1, keepdims=True))


def _product(a: Array, b: Array) -> Array:
    """Quaternions a after a constant b, unit."""
    w, v = a[:, :1], a[:, 1:]
    u = np.broadcast_to(b[1:], v.shape)
    found = np.hstack([w * b[0] - v @ b[1:, None], w * u + b[0] * v + np.cross(v, u)])
    return np.asarray(found / np.linalg.norm(found, axis=1, keepdims=True))
