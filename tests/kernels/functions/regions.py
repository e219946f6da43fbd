"""Arguments of each function: every size, every stretch of its formula and both sides of breaks."""

from __future__ import annotations

import zlib
from collections.abc import Callable

import numpy as np

from gough.kernels.functions.sines import LIMIT
from gough.kernels.reference import Array

Region = Callable[[np.random.Generator, int], Array]


def between(low: float, high: float) -> Region:
    """Evenly spread numbers."""
    return lambda rng, n: rng.uniform(low, high, n)


def sizes(low: float, high: float, signed: bool = True) -> Region:
    """Numbers of all sizes from 2^low to 2^high."""

    def region(rng: np.random.Generator, n: int) -> Array:
        size = np.ldexp(rng.uniform(1, 2, n), np.floor(rng.uniform(low, high, n)).astype(int))
        return size * rng.choice([-1.0, 1.0], n) if signed else size

    return region


def about(centre: float, closest: float, farthest: float) -> Region:
    """Numbers at distances of all sizes from a number."""
    return lambda rng, n: centre + sizes(closest, farthest)(rng, n)


def beside(*breaks: float) -> Region:
    """The float64 next to some numbers, on both sides, and their opposites."""

    def region(rng: np.random.Generator, n: int) -> Array:
        numbers = [
            sign * (b + k * np.spacing(b)) for b in breaks for k in range(-8, 9) for sign in (1, -1)
        ]
        return np.array(numbers)

    return region


ANGLES = [between(-4, 4), between(-LIMIT, LIMIT), sizes(-1074, 5), sizes(4, 1024), beside(LIMIT)]
UNIT = [between(-1, 1), sizes(-1074, 0), beside(0.5)]
REGIONS: dict[str, list[Region]] = {
    "sin": ANGLES,
    "cos": ANGLES,
    "tan": ANGLES,
    "asin": [*UNIT, lambda rng, n: 1 - sizes(-53, -1, signed=False)(rng, n)],
    "acos": [*UNIT, lambda rng, n: sizes(-53, -1, signed=False)(rng, n) - 1],
    "atan": [between(-3, 3), between(0.5, 0.52), sizes(-1074, 1024), beside(0.5, 2.0)],
    "exp": [
        *(between(-1, 1), between(-708, 709.7), between(-746, -707), sizes(-60, 3)),
        beside(np.log(2) / 2, 709.78271289338399, 745.13321910194110, 800.0),
    ],
    "expm1": [between(-1, 2), between(36, 38), between(-45, 709.7), sizes(-1074, 3)],
    "log": [sizes(-1074, 1024, signed=False), between(0.65, 1.5), about(1, -53, -2)],
    "log1p": [
        *(sizes(-1074, 1024, signed=False), between(-1, 3), sizes(-60, -1), about(0, -3, -1)),
        lambda rng, n: sizes(-53, -1, signed=False)(rng, n) - 1,
    ],
    "sinh": [between(-1.1, 1.1), between(18, 20), between(-710.4, 710.4), sizes(-1074, 4)],
    "cosh": [between(-1.1, 1.1), between(18, 20), between(-710.4, 710.4), sizes(-1074, 4)],
    "tanh": [between(-1.1, 1.1), between(0.54, 0.6), between(-25, 25), sizes(-1074, 4)],
    "erf": [between(-1.1, 1.1), between(0.95, 1.5), between(-6.5, 6.5), sizes(-1074, 3)],
}


def arguments(name: str, count: int) -> Array:
    """About ``count`` arguments of a function of one argument."""
    rng = np.random.default_rng(zlib.crc32(name.encode()))
    regions = REGIONS[name]
    return np.concatenate([region(rng, count // len(regions)) for region in regions])


def vectors(count: int) -> tuple[Array, Array]:
    """Pairs (y, x) for atan2."""
    rng, n = np.random.default_rng(2), count // 5
    pairs = [
        (between(-3, 3)(rng, n), between(-3, 3)(rng, n)),
        (sizes(-4, 4)(rng, n), sizes(-4, 4)(rng, n)),
        (sizes(-1074, 1024)(rng, n), sizes(-1074, 1024)(rng, n)),
        (sizes(1000, 1024)(rng, n), sizes(990, 1024)(rng, n)),
        (sizes(-1074, -1020)(rng, n), sizes(-1074, -1000)(rng, n)),
    ]
    return np.concatenate([y for y, _ in pairs]), np.concatenate([x for _, x in pairs])


def bases_and_exponents(count: int) -> tuple[Array, Array]:
    """Pairs (x, y) for pow, most with results between the smallest and the largest float64."""
    rng, n = np.random.default_rng(3), count // 5
    positive = [
        sizes(-1074, 1024, signed=False)(rng, n),
        between(0.5, 2)(rng, n),
        np.abs(about(1, -52, -1)(rng, n)),
    ]
    x = np.concatenate([*positive, between(-10, 10)(rng, n), between(0.01, 10)(rng, n)])
    limits = rng.uniform(-745, 709.7, 3 * n)
    y = np.concatenate(
        [limits / np.log(x[: 3 * n]), np.round(between(-20, 20)(rng, n)), between(-5, 5)(rng, n)]
    )
    return x, y
