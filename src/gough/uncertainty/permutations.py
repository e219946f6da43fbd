"""Random permutations of any length whose entries are computed one by one.

A Feistel network is a one-to-one map of the numbers of some bits, whatever its round functions are:
the two halves of the bits are changed in turn, each by a scrambled copy of the other. Numbers that
leave the range 0 … n-1 are sent through again until they are back (cycle walking; Black and Rogaway
2002), so the map stays one-to-one on the range.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Words = NDArray[np.uint64]

ROUNDS = 8
"""Four make a network look random on a large range; a short range needs more. A guess, which the
tests try on ranges of a few numbers."""


def permuted(rows: NDArray[np.int64], n: int, keys: Words) -> NDArray[np.int64]:
    """Where some rows go in one permutation for each column.

    Args:
        rows: numbers of rows, 0 … n-1, (rows,).
        n: the length of the permutations.
        keys: random words, (ROUNDS, columns).

    Returns:
        0 … n-1, (rows, columns).
    """
    x = np.repeat(rows.astype(np.uint64)[:, None], keys.shape[1], axis=1)
    x = _network(x, n, keys)
    outside = np.nonzero(x >= n)
    while outside[0].size:
        moved = _network(x[outside], n, keys[:, outside[1]])
        x[outside] = moved
        still = moved >= n
        outside = outside[0][still], outside[1][still]
    return x.astype(np.int64)


def _network(x: Words, n: int, keys: Words) -> Words:
    """One pass through the network; the bits are as many as n - 1 has, at least two."""
    bits = max(int(n - 1).bit_length(), 2)
    low = np.uint64(bits // 2)
    left_mask = np.uint64((1 << (bits - bits // 2)) - 1)
    right_mask = np.uint64((1 << (bits // 2)) - 1)
    left, right = x >> low, x & right_mask
    for k in range(0, ROUNDS, 2):
        left = left ^ (_mixed(right + keys[k]) & left_mask)
        right = right ^ (_mixed(left + keys[k + 1]) & right_mask)
    return np.asarray((left << low) | right)


def _mixed(x: Words) -> Words:
    """The finaliser of SplitMix64 (Steele, Lea and Flood 2014), its high half down."""
    x = (x ^ (x >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    x = (x ^ (x >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return x ^ (x >> np.uint64(31))
