"""Twists in words: translations, rotations and screws with their axes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

ZERO = 1e-7
"""Relative size below which a component of a unit twist is called zero."""


@dataclass(frozen=True)
class NamedTwist:
    """One motion of a body, as a screw."""

    kind: Literal["translation", "rotation", "screw"]
    direction: tuple[float, float, float]
    """Unit vector in base axes."""
    point: tuple[float, float, float] | None
    """The point of the axis nearest to the body's origin, in base axes, m."""
    pitch: float | None
    """Advance for one turn, m; None of a translation."""
    text: str


def name_twist(
    twist: Array, origin: Array, length: float, body: str, tell_axis: bool = False
) -> NamedTwist:
    """The screw of a twist (linear at ``origin``, angular; base axes), in words.

    Args:
        twist: (6,), m/s and rad/s, not zero.
        origin: origin of the body in base axes, m.
        length: characteristic length, m, which a displacement of the axis is compared to.
        body: the name of what moves.
        tell_axis: whether the place of an axis through ``origin`` is told too.
    """
    v, w = twist[:3], twist[3:]
    turn = float(np.linalg.norm(w))
    if turn * length <= ZERO * float(np.linalg.norm(v)):
        direction = _unit(v)
        text = f"translation along {_direction(direction)} of {body}"
        return NamedTwist("translation", _triple(direction), None, None, text)
    direction = _unit(w)
    advance = float(v @ w) / turn**2
    arm = np.cross(w, v) / turn**2
    point = origin + arm
    at_origin = bool(np.linalg.norm(arm) <= ZERO * length)
    through = "" if at_origin and not tell_axis else f", axis through {_point(point)}"
    if abs(advance) <= ZERO * length:
        text = f"rotation about {_direction(direction)} of {body}{through}"
        return NamedTwist("rotation", _triple(direction), _triple(point), 0.0, text)
    pitch = 2 * np.pi * advance
    text = f"screw about {_direction(direction)} of {body}, pitch {pitch:.4g} m a turn{through}"
    return NamedTwist("screw", _triple(direction), _triple(point), pitch, text)


def name_space(twists: Array, origin: Array, length: float, body: str) -> list[NamedTwist]:
    """The motions that span a space of twists (6, k): pure translations first, then the others.

    Directions are the plainest the space has: those of base axes where they lie in it. The
    others are given the axis nearest to the body's origin that the translations allow.
    """
    scaled = twists / np.repeat([length, 1.0], 3)[:, None]
    basis = _span(scaled)
    slides, rest = _split(basis)
    named = [np.concatenate([column, np.zeros(3)]) for column in echelon(slides.T)]
    for row in echelon(rest[3:].T, companion=rest[:3].T):
        v = row[3:] - slides @ (slides.T @ row[3:]) if slides.size else row[3:]
        named.append(np.concatenate([v, row[:3]]))
    back = np.repeat([length, 1.0], 3)
    return [name_twist(back * twist, origin, length, body) for twist in named]


def echelon(rows: Array, companion: Array | None = None) -> Array:
    """Reduced echelon form by the largest pivots; small entries are zero.

    Args:
        rows: (k, n) of rank k.
        companion: further columns, (k, m), that go through the same operations; they are returned
            behind the columns of ``rows``.
    """
    n = rows.shape[1]
    table = rows.copy() if companion is None else np.hstack([rows, companion])
    for i in range(table.shape[0]):
        left = np.abs(table[i:, :n])
        r, c = divmod(int(np.argmax(np.round(left, 9))), n)
        table[[i, i + r]] = table[[i + r, i]]
        table[i] /= table[i, c]
        for k in range(table.shape[0]):
            if k != i:
                table[k] -= table[k, c] * table[i]
    table[np.abs(table) < ZERO * np.abs(table).max(initial=0.0)] = 0.0
    order = np.argsort([int(np.argmax(row[:n] != 0)) for row in table], kind="stable")
    return np.asarray(table[order])


def _span(columns: Array) -> Array:
    """Orthonormal basis of the columns."""
    U, s, _ = np.linalg.svd(columns, full_matrices=False)
    return np.asarray(U[:, s > ZERO * s.max(initial=0.0)])


def _split(basis: Array) -> tuple[Array, Array]:
    """Orthonormal translations (3, t) in a space of twists, and the rest of a basis (6, k - t)."""
    if not basis.size:
        return np.zeros((3, 0)), np.zeros((6, 0))
    _, s, Vt = np.linalg.svd(basis[3:])
    turning = int(np.sum(s > ZERO))
    return basis[:3] @ Vt[turning:].T, basis @ Vt[:turning].T


def _unit(v: Array) -> Array:
    """Unit vector along v, its first entry that is not zero positive."""
    u = v / np.linalg.norm(v)
    u = np.where(np.abs(u) < ZERO, 0.0, u)
    return np.asarray(u if u[np.argmax(u != 0)] > 0 else -u) + 0.0


def _direction(u: Array) -> str:
    for name, axis in zip("xyz", np.eye(3), strict=True):
        if np.allclose(u, axis, atol=10 * ZERO):
            return name
    return _point(u)


def _point(p: Array) -> str:
    return "(" + ", ".join(f"{round(float(c), 6) + 0.0:.4g}" for c in p) + ")"


def _triple(v: Array) -> tuple[float, float, float]:
    x, y, z = (float(c) for c in v)
    return x, y, z
