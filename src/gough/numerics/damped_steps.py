"""Damped least-squares steps of sixteen rows at once, by orthogonal columns.

The step s minimises |F + J s|² + d |s|². With at least as many equations m as unknowns n it is the
least-squares solution of

    [  J  ]       [ -F ]
    [ √d I ] s  =  [  0 ]

and with fewer the first part of the shortest solution of [J √d I] (s; t) = -F. Either way the long
side of the stacked matrix is made orthogonal by modified Gram-Schmidt with the right-hand side as a
last column, or with the elimination in reverse, which is as stable as reflections (Björck 1996,
ch. 2.4) and does not square the condition number as JᵀJ would.

Redundant rows leave singular values of rounding size, ε. Along these a step has the length ε r / d
with r the part of F that J does not reach, of the order |F|² near a root, so that a damping of
1e-22 |J|² and more keeps it small; singular values above 1e-10 |J| are solved for as they are.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from gough.numerics.calling import part
from gough.numerics.lanes import (
    LANES,
    fma,
    gather,
    larger,
    load,
    negative,
    root,
    scatter,
    size,
    smaller,
    splat,
    store,
)

Pointer = Any

FLOOR = 1e-22
"""Least damping relative to the sum of the squares of the entries of J."""
TINY = 1e-300
W = LANES


class Work(NamedTuple):
    """Scratch space for sixteen rows: flat, sixteen neighbours to a number."""

    J: Pointer
    F: Pointer
    Q: Pointer
    """Columns of the stacked matrix, each of short + long numbers, and a right-hand side."""
    R: Pointer
    """Products of the columns, short × (short + 1), the last column that of the right-hand side."""
    inverse: Pointer
    """One over the sizes of the columns."""
    s: Pointer


@part
def measure(
    F: Pointer, first: int, m: int, row_scale: Pointer, square: Pointer, largest: Pointer
) -> None:
    """Write |F|² and the largest |entry| of sixteen scaled rows; NaN if an entry is not finite."""
    total, most, nothing = splat(0.0), splat(0.0), splat(0.0)
    for i in range(m):
        entry = gather(F, first * m + i, m) * splat(row_scale[i])
        total = fma(entry, entry, total)
        most = larger(most, size(entry))
        nothing = nothing + (entry - entry)
    store(square, first, total)
    store(largest, first, most + nothing)


@part
def read_model(
    J: Pointer, F: Pointer, first: int, m: int, n: int, row_scale: Pointer, scale: Pointer,
    work: Work,
) -> tuple[Any, Any]:  # fmt: skip
    """Bring J and F of sixteen rows into lanes; |J|² and the squared slope |Jᵀ F|²."""
    square, slope = splat(0.0), splat(0.0)
    for i in range(m):
        store(work.F, W * i, gather(F, first * m + i, m) * splat(row_scale[i]))
    for j in range(n):
        along = splat(0.0)
        for i in range(m):
            entry = gather(J, first * m * n + i * n + j, m * n) * splat(scale[i * n + j])
            store(work.J, W * (i * n + j), entry)
            square = fma(entry, entry, square)
            along = fma(entry, load(work.F, W * i), along)
        slope = fma(along, along, slope)
    return square, slope


@part
def stack(m: int, n: int, weight: Any, work: Work) -> None:
    """Write the columns of the stacked matrix with the weight √d, and the right-hand side -F."""
    short, long, by_column, by_row = (n, m, 1, n) if n <= m else (m, n, n, 1)
    length, zero = long + short, splat(0.0)
    for k in range(short):
        for i in range(long):
            store(work.Q, W * (k * length + i), load(work.J, W * (k * by_column + i * by_row)))
        for i in range(short):
            store(work.Q, W * (k * length + long + i), weight if i == k else zero)
    if n <= m:
        for i in range(m):
            store(work.Q, W * (short * length + i), negative(load(work.F, W * i)))
        for i in range(m, length):
            store(work.Q, W * (short * length + i), zero)


@part
def orthogonalise(short: int, long: int, columns: int, work: Work) -> None:
    """Make the first ``short`` columns orthonormal and take them out of those after them."""
    Q, length = work.Q, long + short
    for k in range(short):
        used, own = long + k + 1, k * length
        square = splat(0.0)
        for i in range(used):
            entry = load(Q, W * (own + i))
            square = fma(entry, entry, square)
        inverse = splat(1.0) / root(square)
        store(work.inverse, W * k, inverse)
        for i in range(used):
            store(Q, W * (own + i), load(Q, W * (own + i)) * inverse)
        take_out(k, k + 1, columns, short, long, work)


@part
def take_out(k: int, begin: int, end: int, short: int, long: int, work: Work) -> None:
    """Make columns begin to end - 1 orthogonal to column k, two at a time to save loads."""
    Q, R, length, used = work.Q, work.R, long + short, long + k + 1
    own = W * k * length
    for j in range(begin, end, 2):
        # a last single column is done twice, with the same result
        first = W * j * length
        second = W * min(j + 1, end - 1) * length
        along, beside = splat(0.0), splat(0.0)
        for i in range(0, W * used, W):
            entry = load(Q, own + i)
            along = fma(entry, load(Q, first + i), along)
            beside = fma(entry, load(Q, second + i), beside)
        store(R, W * (k * (short + 1) + j), along)
        store(R, W * (k * (short + 1) + min(j + 1, end - 1)), beside)
        along, beside = negative(along), negative(beside)
        for i in range(0, W * used, W):
            entry = load(Q, own + i)
            one = fma(along, entry, load(Q, first + i))
            two = fma(beside, entry, load(Q, second + i))
            store(Q, first + i, one)
            store(Q, second + i, two)


@part
def solve_tall(n: int, work: Work) -> None:
    """The unknowns from R, at least as many equations as unknowns."""
    for back in range(n):
        k = n - 1 - back
        rest = load(work.R, W * (k * (n + 1) + n))
        for j in range(k + 1, n):
            rest = fma(negative(load(work.R, W * (k * (n + 1) + j))), load(work.s, W * j), rest)
        store(work.s, W * k, rest * load(work.inverse, W * k))


@part
def solve_wide(m: int, n: int, work: Work) -> None:
    """The unknowns of least size, fewer equations than unknowns."""
    R, length = work.R, n + m
    solution = W * m * length
    for i in range(length):
        store(work.Q, solution + W * i, splat(0.0))
    for k in range(m):
        rest = negative(load(work.F, W * k))
        for i in range(k):
            known = load(R, W * (i * (m + 1) + m))
            rest = fma(negative(load(R, W * (i * (m + 1) + k))), known, rest)
        store(R, W * (k * (m + 1) + m), rest * load(work.inverse, W * k))
    for back in range(m):
        k = m - 1 - back
        own, missing = k * length, load(R, W * (k * (m + 1) + m))
        for i in range(n + k + 1):
            entry = load(work.Q, solution + W * i)
            missing = fma(negative(load(work.Q, W * (own + i))), entry, missing)
        for i in range(n + k + 1):
            at = solution + W * i
            store(work.Q, at, fma(missing, load(work.Q, W * (own + i)), load(work.Q, at)))
    for j in range(n):
        store(work.s, W * j, load(work.Q, solution + W * j))


@part
def shorten(m: int, n: int, longest: float, work: Work) -> Any:
    """Make no step longer than allowed; how much it lowers |F|² if F is linear."""
    square = splat(0.0)
    for j in range(n):
        square = fma(load(work.s, W * j), load(work.s, W * j), square)
    factor = smaller(splat(1.0), splat(longest) / root(square))
    for j in range(n):
        store(work.s, W * j, load(work.s, W * j) * factor)
    promised = splat(0.0)
    for i in range(m):
        change, F = splat(0.0), load(work.F, W * i)
        for j in range(n):
            change = fma(load(work.J, W * (i * n + j)), load(work.s, W * j), change)
        promised = promised - change * (F + F + change)
    return promised


@part
def damped_steps(
    J: Pointer, F: Pointer, F_square: Pointer, trust: Pointer, first: int, m: int, n: int,
    row_scale: Pointer, scale: Pointer, longest: float, work: Work, step: Pointer,
    promised: Pointer, slope: Pointer,
) -> None:  # fmt: skip
    """Steps of rows first to first + 15.

    Args:
        J: Jacobians, (rows, m, n), not scaled.
        F: residuals, (rows, m), not scaled.
        F_square: |F|² of each row, scaled.
        trust: what multiplies the damping min(|F|, 1)² of each row.
        first: the first of sixteen rows.
        m: equations.
        n: unknowns.
        row_scale: what multiplies the entries of F, (m,).
        scale: what multiplies the entries of J, (m, n).
        longest: longest step allowed.
        work: scratch space.
        step: where the steps go, (rows, n) flat, scaled.
        promised: where goes by how much each lowers |F|² if F is linear.
        slope: where |Jᵀ F|² / (|J|² |F|²) goes, zero at a minimum of |F|².
    """
    J_square, along = read_model(J, F, first, m, n, row_scale, scale, work)
    F_squares = load(F_square, first)
    store(slope, first, along / (J_square * F_squares + splat(TINY)))
    damping = load(trust, first) * smaller(F_squares, splat(1.0)) + splat(FLOOR) * J_square
    stack(m, n, root(damping + splat(TINY)), work)
    if n <= m:
        orthogonalise(n, m, n + 1, work)
        solve_tall(n, work)
    else:
        orthogonalise(m, n, m, work)
        solve_wide(m, n, work)
    store(promised, first, shorten(m, n, longest, work))
    for j in range(n):
        scatter(step, first * n + j, n, load(work.s, W * j))
