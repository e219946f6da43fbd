"""Forces over a position or a rate that laws are made of.

A curve is written ``[b, a]`` for the force b + a w, or as a table, a list of rows ``[w, F]`` with
increasing w: linear between the rows, and beyond the ends with the slope of the last piece.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from typing import Any

from gough import algebra as al
from gough.algebra import Scalar

Curve = Any
"""(b, a), or rows (w, F)."""
MAX_ROWS = 1000
"""A table is written out in every model that has it."""


def problem(name: str, curve: Any) -> str | None:
    """What is wrong with a curve made of floats, or None."""
    wanted = f"{name} is [b, a], for the force b + a w, or a table of rows [w, F]"
    if not isinstance(curve, tuple):
        return f"{wanted}; got the number {curve:g}"
    if not is_table(curve):
        lone = len(curve) == 2 and not any(isinstance(x, tuple) for x in curve)
        return None if lone else f"{wanted}; got a list of {len(curve)}"
    for k, row in enumerate(curve):
        if not isinstance(row, tuple) or len(row) != 2 or any(isinstance(x, tuple) for x in row):
            return f"{wanted}; row {k} is something else (rows are counted from 0)"
    if not 2 <= len(curve) <= MAX_ROWS:
        return f"{name} is a table of {len(curve)} rows; there must be 2 to {MAX_ROWS}"
    for k, ((w, _), (after, _)) in enumerate(pairwise(curve)):
        if after <= w:
            return (
                f"the positions of the table {name} must increase: {after:g} in row {k + 1} comes "
                f"after {w:g} (rows are counted from 0)"
            )
    return None


def is_table(curve: Curve) -> bool:
    """Whether a curve is written as a table."""
    return isinstance(curve[0], tuple)


def value(curve: Curve, w: Scalar) -> Scalar:
    """The force at position w."""
    if not is_table(curve):
        b, a = curve
        return al.add(b, al.mul(a, w))
    (w0, F0), slopes = curve[0], _slopes(curve)
    result = al.add(F0, al.mul(slopes[0], al.sub(w, w0)))
    for (corner, _), before, after in zip(curve[1:-1], slopes, slopes[1:], strict=False):
        result = al.add(result, al.mul(after - before, al.maximum(al.sub(w, corner), 0.0)))
    return result


def corners(curve: Curve) -> tuple[float, ...]:
    """Positions of the rows; none for a straight line."""
    return tuple(w for w, _ in curve) if is_table(curve) else ()


def slopes_beside(curve: Curve, w: float) -> tuple[float, float]:
    """The slopes just below and just above a position, of a curve made of floats."""
    if not is_table(curve):
        return curve[1], curve[1]
    slopes = _slopes(curve)
    inner = corners(curve)[1:-1]
    below = sum(corner < w for corner in inner)
    above = sum(corner <= w for corner in inner)
    return slopes[below], slopes[above]


def _slopes(table: Curve) -> list[Scalar]:
    return [(F1 - F0) / (w1 - w0) for (w0, F0), (w1, F1) in pairwise(table)]


def stribeck(v: Scalar, coulomb: Scalar, static: Scalar | None, rate: Scalar) -> Scalar:
    """Friction force that falls from ``static`` at rest to ``coulomb``.

        g(v) = coulomb + (static - coulomb) exp(-(v / rate)²)

    Without ``static`` it is ``coulomb`` at every rate.
    """
    if static is None:
        return coulomb
    x = v / rate
    return coulomb + (static - coulomb) * al.exp(-(x * x))


def stribeck_problems(
    coulomb: float, static: float | None, rate: float | None
) -> Iterator[tuple[str, str]]:
    """What is wrong with the numbers of a Stribeck curve."""
    if static is None:
        return
    if static < coulomb:
        yield (
            "static",
            f"static is {static:g} and less than coulomb, {coulomb:g}; friction at rest is the "
            "larger one: leave static out where they are equal",
        )
    if rate is None:
        yield "stribeck", "static needs stribeck too: the rate at which friction has fallen"
