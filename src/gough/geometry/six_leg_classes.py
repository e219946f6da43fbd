"""How many complex solutions a six-leg platform has because of the places of its points.

General platforms have 40, for general lengths. Points of several legs, common mirrors and affinely
equal hexagons send some of them to infinity. The numbers here were counted with this package at
random members of each class; those of 6-5, 5-5, 6-4, 6-3, 3-3, hexagonal and affinely equal
platforms agree with exact counts over a finite field. A platform may be special in other ways.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Legs = Sequence[int]
"""The point of each leg."""

GENERAL = 40
SAME = 1e-11
"""Differences below this, relative to the size of the points, count as none; a guess."""
NEARLY = 1e-3
"""Differences of points rounded for a drawing are below this; a guess."""
PER_MIRROR = 4
"""Solutions lost to each mirror that base and platform share."""
HALF_TURN = 24
"""Planar base and platform, both unchanged by half a turn that swaps the same legs."""
AFFINE = 16
"""Planar base and platform of which one is an affine image of the other."""
SHARED_POINTS = {
    32: "001123/010234 001123/012345 001234/010123 012345/001123",
    24: "001123/010213 001123/012304 001234/010223 001234/012234",
    16: "000123/012012 000123/012013 000123/012034 000123/012345 001122/010203 001122/010212 "
    "001122/010213 001122/010234 001122/012345 001123/010123 001123/010203 001123/010212 "
    "001123/010233 001123/012301 001123/012302 001123/012344 001234/010023 001234/010122 "
    "001234/012233 012345/000123 012345/001122",
    8: "000112/012010 000112/012012 000112/012013 000112/012030 000112/012031 000112/012033 "
    "000112/012034 000112/012340 000112/012343 000112/012345 000123/012001 000123/012003 "
    "000123/012033 000123/012334 001122/010102 001122/010123 001123/010102 001123/010122 "
    "001123/010201 001123/010211 001123/012300 001234/010012 001234/010022 001234/010222 "
    "001234/012223 012345/000112",
    0: "000123/012333",
}
"""Solutions where legs share points: for each leg its point of the platform / of the base."""


def rank_margin(rows: Array) -> float:
    """How far six conditions are from depending on each other in all poses.

    If a mixture of the rows leaves N alone, it is a multiple of N = 0: either it holds for no pose
    or it says nothing.

    Args:
        rows: coefficients of the seventeen forms, N first, (6, 17).

    Returns:
        The least singular value of the rows without N, each of length 1.
    """
    free = rows[:, 1:]
    sizes = np.linalg.norm(free, axis=1, keepdims=True)
    if not np.all(sizes > 0):
        return 0.0
    return float(np.linalg.svd(free / sizes, compute_uv=False)[-1])


def expected_counts(a: Array, b: Array) -> tuple[int, ...]:
    """Numbers of complex solutions that are to be expected for general lengths.

    The first is that of the class of the platform. Where points have been rounded, the solutions
    that a special platform lacks are there, but very far away; the second is that without them.
    None is given where platforms of a class differ.

    Args:
        a: points of the platform, about their centre and of about length 1, (6, 3).
        b: points of the base, likewise, (6, 3).
    """
    counts = [_count(a, b, tolerance) for tolerance in (SAME, NEARLY)]
    return tuple(dict.fromkeys(count for count in counts if count is not None))


def _count(a: Array, b: Array, same: float) -> int | None:
    """Solutions of platforms like this, differences below `same` counting as none."""
    shared = _count_of_shared(_points(a, same), _points(b, same))
    mirrors = int(np.sum(_mirrored(a, same) & _mirrored(b, same)))
    if shared < GENERAL:
        return shared if shared <= AFFINE or not mirrors else None
    if _rank(a, same) < 3 and _rank(b, same) < 3:
        if _rank(np.concatenate([a, b], axis=1), same) < 3:
            return AFFINE
        if np.any(_turned(a, same) & _turned(b, same)):
            return None if mirrors else HALF_TURN
    return GENERAL - PER_MIRROR * mirrors


def _rank(points: Array, same: float) -> int:
    """Of numbers of about 1."""
    return int(np.sum(np.linalg.svd(points, compute_uv=False) > same))


def _points(points: Array, same: float) -> list[int]:
    """For each leg the first one with the same point."""
    apart = np.abs(points[:, None] - points).max(axis=2)
    return [int(k) for k in np.argmax(apart < same, axis=1)]


def _count_of_shared(platform: Legs, base: Legs) -> int:
    """Solutions where legs share points, and nothing else is special."""
    sizes = [sorted(side.count(p) for p in set(side))[-2:] for side in (platform, base)]
    if any(size[-1] > 3 or size == [3, 3] for size in sizes):
        return 0
    if all(size[-1] == 1 for size in sizes):
        return GENERAL
    return _table().get(_kind(platform, base), GENERAL)


@cache
def _table() -> dict[tuple[object, ...], int]:
    """`SHARED_POINTS` by kind."""
    table = {}
    for count, kinds in SHARED_POINTS.items():
        for kind in kinds.split():
            platform, base = ([int(p) for p in side] for side in kind.split("/"))
            table[_kind(platform, base)] = count
    return table


def _kind(platform: Legs, base: Legs) -> tuple[object, ...]:
    """What tells how legs share points, whatever their order.

    A leg is known by how many legs have its points, and then by what is known of those, three times
    over. That tells all 90 ways apart.
    """
    known: list[object] = [
        (platform.count(p), base.count(q)) for p, q in zip(platform, base, strict=True)
    ]
    legs = range(len(known))
    for _ in range(3):
        known = [
            (
                known[i],
                *(
                    tuple(sorted((known[j] for j in legs if side[j] == side[i]), key=repr))
                    for side in (platform, base)
                ),
            )
            for i in legs
        ]
    return tuple(sorted(known, key=repr))


def _pairings(legs: list[int]) -> list[list[tuple[int, int]]]:
    """All ways to make pairs."""
    if not legs:
        return [[]]
    first, *others = legs
    return [
        [(first, partner), *rest]
        for partner in others
        for rest in _pairings([leg for leg in others if leg != partner])
    ]


PAIRINGS = np.array(_pairings(list(range(6))))
"""The 15 ways to pair six legs, (15, 3, 2)."""


def _mirrored(points: Array, same: float) -> NDArray[np.bool_]:
    """For each pairing whether a mirror through the centre swaps all pairs, (15,)."""
    first, second = points[PAIRINGS[..., 0]], points[PAIRINGS[..., 1]]
    apart, middle = first - second, first + second
    sizes = np.linalg.norm(apart, axis=2)
    longest = np.argmax(sizes, axis=1)
    each = np.arange(len(PAIRINGS))
    normal = apart[each, longest] / np.maximum(sizes[each, longest], same)[:, None]
    across = apart - np.einsum("pki,pi->pk", apart, normal)[..., None] * normal[:, None]
    along = np.einsum("pki,pi->pk", middle, normal)
    off = np.maximum(np.abs(across).max(axis=(1, 2)), np.abs(along).max(axis=1))
    return np.asarray((off < same) & (sizes.max(axis=1) > same))


def _turned(points: Array, same: float) -> NDArray[np.bool_]:
    """For each pairing whether points of a pair are opposite about the centre, (15,)."""
    return np.asarray(np.abs(points[PAIRINGS].sum(axis=2)).max(axis=(1, 2)) < same)
