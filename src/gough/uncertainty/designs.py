"""Designs: which points of the unit cube are simulated.

Every row can be computed by itself, so chunks of any size hold the same bits as the whole.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gough.errors import UnknownName
from gough.uncertainty.errors import DesignError
from gough.uncertainty.permutations import ROUNDS, permuted
from gough.uncertainty.plain import count

Array = NDArray[np.float64]
Rows = NDArray[np.int64]

Kind = Literal["random", "latin-hypercube", "sobol"]
KINDS = ("random", "latin-hypercube", "sobol")

BITS = 30
"""Of the numbers of a Sobol' sequence, as in scipy; it has 2^30 rows."""
SMALLEST, LARGEST = 2.0**-54, 1 - 2.0**-53
"""Rounding to 0 or 1 is undone: inverse distribution functions are infinite there."""
SLAB = 2**18
"""Numbers that are computed at a time, to keep the working memory small."""


@dataclass(frozen=True)
class Design:
    """Rows of numbers in (0, 1).

    *random* rows are independent. A *latin-hypercube* has one row in each of the n equal parts of
    every column (McKay, Beckman and Conover 1979). *sobol* is Sobol's sequence, scrambled (Owen
    1998, by Matoušek's linear scramble in scipy.stats.qmc); it is balanced where n is a power of 2.
    """

    kind: Kind
    n: int
    columns: int
    seed: int = 0

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise UnknownName("design", self.kind, KINDS)
        for name, least in (("n", 1), ("columns", 1), ("seed", 0)):
            _checked(name, getattr(self, name), least)
        if self.kind == "sobol":
            self._check_sobol()

    def _check_sobol(self) -> None:
        from scipy.stats import qmc

        if self.n > 2**BITS:
            raise DesignError(f"n is {self.n}: a Sobol' sequence has at most 2^{BITS} rows")
        if self.columns > qmc.Sobol.MAXDIM:
            raise DesignError(
                f"{self.columns} columns: a Sobol' sequence has at most {qmc.Sobol.MAXDIM}; a "
                "Latin hypercube has any number"
            )

    def __len__(self) -> int:
        return self.n

    def rows(self, start: int = 0, stop: int | None = None) -> Array:
        """Rows start … stop-1, (rows, columns); bit for bit the same in any chunks.

        Raises:
            DesignError: the design does not have these rows.
        """
        start, stop = _range(start, stop, self.n)
        if start == stop:
            return np.empty((0, self.columns))
        if self.kind == "sobol":
            return self._sobol(start, stop)
        if self.kind == "random":
            return self._random(start, stop, 0)
        return self._latin(start, stop)

    def chunks(self, size: int) -> Iterator[tuple[int, int]]:
        """Where chunks of at most some rows start and stop."""
        return _chunks(self.n, size)

    def _random(self, start: int, stop: int, stream: int) -> Array:
        bits = np.random.PCG64(np.random.SeedSequence((self.seed, stream)))
        bits.advance(start * self.columns)
        found = np.random.Generator(bits).random((stop - start, self.columns))
        return np.maximum(found, SMALLEST, out=found)

    def _latin(self, start: int, stop: int) -> Array:
        """(π_j(i) + u_ij) / n with a permutation π_j for each column and u_ij in (0, 1)."""
        words = np.random.Generator(np.random.PCG64(np.random.SeedSequence((self.seed, 1))))
        keys = words.integers(0, 2**64, (ROUNDS, self.columns), dtype=np.uint64)
        found = self._random(start, stop, 2)
        step = max(SLAB // self.columns, 1)
        for first in range(start, stop, step):
            rows = np.arange(first, min(first + step, stop))
            found[rows[0] - start : rows[-1] + 1 - start] += permuted(rows, self.n, keys)
        found /= self.n
        return np.minimum(found, LARGEST, out=found)

    def _sobol(self, start: int, stop: int) -> Array:
        """Points of the sequence, moved from the corners of their cells to the middles."""
        engine = _sobol_engine(self.columns, self.seed)
        if start:
            engine.fast_forward(start)
        found, step = np.empty((stop - start, self.columns)), max(SLAB // self.columns, 1)
        done = 0
        while done < len(found):
            # row 0 by itself: scipy warns of other first batches than powers of 2
            rows = min(step, len(found) - done) if start + done else 1
            found[done : done + rows] = engine.random(rows)
            done += rows
        found += 0.5 ** (BITS + 1)
        return found

    def as_dict(self) -> dict[str, Any]:
        """The content as plain data: the rows follow from it."""
        return {"kind": self.kind, "n": self.n, "columns": self.columns, "seed": self.seed}

    def __str__(self) -> str:
        size = f"{count(self.n, 'row')}, {count(self.columns, 'column')}"
        text = f"{self.kind}: {size}, seed {self.seed}"
        if self.kind == "sobol" and self.n & (self.n - 1):
            below = 1 << (self.n.bit_length() - 1)
            text += f"; {below} or {2 * below} rows would be balanced"
        return text


@dataclass(frozen=True)
class SaltelliDesign:
    """Rows from which first-order and total Sobol' indices are estimated.

    Two independent blocks A and B of a base design, and for each factor i the block A_B^i: A with
    column i of B (Saltelli and others 2010). The k + 2 rows that share a base row stand together:
    A, B, A_B^1 … A_B^k, then those of the next base row. So an ensemble that stops early, or goes
    on later, is a Saltelli design too.
    """

    base: int
    """Base rows N; there are N (k + 2) rows."""
    factors: int
    """k."""
    kind: Kind = "sobol"
    """Of the base design, which has 2 k columns."""
    seed: int = 0

    def __post_init__(self) -> None:
        _checked("base", self.base, 1)
        _checked("factors", self.factors, 1)
        assert self.design.n == self.base

    @property
    def design(self) -> Design:
        """The base design: columns of A, then of B."""
        return Design(self.kind, self.base, 2 * self.factors, self.seed)

    @property
    def blocks(self) -> int:
        """k + 2."""
        return self.factors + 2

    def __len__(self) -> int:
        return self.base * self.blocks

    def rows(self, start: int = 0, stop: int | None = None) -> Array:
        """Rows start … stop-1, (rows, factors); bit for bit the same in any chunks.

        Raises:
            DesignError: the design does not have these rows.
        """
        start, stop = _range(start, stop, len(self))
        first, last = start // self.blocks, -(-stop // self.blocks)
        A, B = np.split(self.design.rows(first, max(first, last)), 2, axis=1)
        found = np.empty((len(A), self.blocks, self.factors))
        found[:] = A[:, None]
        found[:, 1] = B
        columns = np.arange(self.factors)
        found[:, columns + 2, columns] = B
        flat = found.reshape(-1, self.factors)
        return flat[start - first * self.blocks : stop - first * self.blocks]

    def chunks(self, size: int) -> Iterator[tuple[int, int]]:
        """Where chunks of at most some rows start and stop."""
        return _chunks(len(self), size)

    def place(self, rows: ArrayLike) -> tuple[Rows, Rows]:
        """The base row of some rows, and their block: 0 is A, 1 is B, 2 + i is A_B^i."""
        found = np.asarray(rows, np.int64)
        return found // self.blocks, found % self.blocks

    def block_name(self, row: int) -> str:
        """A, B or A_B^i, with i counted from 1."""
        block = int(self.place(row)[1])
        return ("A", "B")[block] if block < 2 else f"A_B^{block - 1}"

    def as_dict(self) -> dict[str, Any]:
        """The content as plain data: the rows follow from it."""
        return {"kind": self.kind, "base": self.base, "factors": self.factors, "seed": self.seed}

    def __str__(self) -> str:
        return (
            f"Saltelli design on {self.design.kind}: {count(self.base, 'base row')} × "
            f"({self.factors} + 2) = {count(len(self), 'row')}, seed {self.seed}"
        )


def _sobol_engine(columns: int, seed: int) -> Any:
    from scipy.stats import qmc

    random = np.random.default_rng(np.random.SeedSequence((seed, 3)))
    try:
        return qmc.Sobol(columns, scramble=True, bits=BITS, rng=random)
    except TypeError:  # before scipy 1.15
        return qmc.Sobol(columns, scramble=True, bits=BITS, seed=random)


def _chunks(rows: int, size: int) -> Iterator[tuple[int, int]]:
    _checked("size", size, 1)
    return ((first, min(first + size, rows)) for first in range(0, rows, size))


def _checked(name: str, value: object, least: int) -> None:
    whole = isinstance(value, int | np.integer) and not isinstance(value, bool)
    if not whole or value < least:  # type: ignore[operator]
        raise DesignError(f"{name} is {value!r}, expected a whole number, at least {least}")


def _range(start: int, stop: int | None, n: int) -> tuple[int, int]:
    stop = n if stop is None else stop
    if not 0 <= start <= stop <= n:
        raise DesignError(f"rows {start} to {stop} of a design with rows 0 to {n}")
    return start, stop
