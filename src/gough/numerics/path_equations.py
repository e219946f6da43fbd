"""Quadratic equations at the points of eight paths, and the series of the paths.

The coefficients at t are (1 - t) a + t b. With x(t + s) = S_0 + S_1 s + ... + S_8 s⁸ on a path and
P_k the coefficients of the products x_l x_r, the terms of order k of the equations are

    Σ_e  a_e ((1 - t) P_k - P_{k-1}) + b_e (t P_k + P_{k-1})  =  0 ,

linear in S_k with the Jacobian at x(t): one inverse serves all orders and the corrections. It
stands for the LU factors, which would take fewer operations but more time: a solution with them is
a chain of operations that wait for each other, and ten are wanted.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple, TypeVar, cast

import numba

from gough.numerics.calling import address_of, part, pointer_to
from gough.numerics.complex_lanes import (
    STRIDE,
    Eight,
    fetch,
    minus_product,
    nought,
    plus,
    plus_product,
    plus_scaled,
    product,
    put,
    scaled,
    square,
    where_same,
)
from gough.numerics.lanes import (
    EIGHT,
    larger,
    load_eight,
    negative,
    root,
    splat_eight,
    store,
    where_equal,
    where_more,
)

Function = TypeVar("Function", bound=Callable[..., Any])
Pointer = Any
"""To neighbouring numbers; indexed like an array."""

ORDER = 8
"""Of the series; `measure` takes roots of this order."""
SERIES = ORDER + 1
"""Terms of a series."""
TINY = 1e-300
LEAST_UNIT = 1e-8
"""Least dynamic unit of length: less counts as infinite."""


def called(function: Function) -> Function:
    """A function that is compiled once and called, not made a part of its callers."""
    njit: Any = numba.njit(error_model="numpy")
    return cast(Function, njit(function))


class Shape(NamedTuple):
    """Sizes of the equations."""

    n: int
    """Unknowns."""
    products: int
    """Different products of unknowns."""
    squares: int
    """How many of them, in front, are squares."""
    light: int
    """Leading unknowns that become small together at infinity."""


class Pattern(NamedTuple):
    """Where unknowns and coefficients stand in the equations."""

    starts: Pointer
    """Where the entries of each row start, (n,)."""
    product: Pointer
    """The product of each entry, (entries,)."""
    twin: Pointer
    """1 where the next row has the same products, else 0, (n - 1,)."""
    left: Pointer
    """The factors of each product, (products,)."""
    right: Pointer
    slots: Pointer
    """Where the terms of each number of the Jacobian start, ((n - 1) n + 1,)."""
    entry: Pointer
    """The entry of each term, (2 entries,)."""
    other: Pointer
    """The unknown of each term, (2 entries,)."""
    power: Pointer
    """Each row is divided by this power of the unit of length, (n - 1,)."""
    c: Pointer
    """Start and target coefficient of each entry, four float64 numbers."""


class Lanes(NamedTuple):
    """State of eight paths and space to work in; complex numbers as in `complex_lanes`."""

    x: Pointer
    """n."""
    held: Pointer
    """The last corrected point, n."""
    S: Pointer
    """Series of x, n × orders; the first of each is x."""
    M: Pointer
    """The Jacobian, then its inverse, n × n by columns."""
    F: Pointer
    """Right-hand side, n."""
    factors: Pointer
    """Column of the Jacobian that is eliminated, n."""
    P: Pointer
    """Products of the last order, without the terms in S of that order."""
    Q: Pointer
    """What a and b multiply, 2 for each product."""
    pivot: Pointer
    """The row that each row was swapped with, n × 8 float64."""
    row_scale: Pointer
    """n × 8 float64."""
    number: Pointer
    """0, 1, ..., n - 1 as float64."""
    t: Pointer
    held_t: Pointer
    """t of the last corrected point."""
    unit: Pointer
    """Dynamic unit of length."""
    first: Pointer
    """|first correction|²."""
    second: Pointer
    h: Pointer
    """Length of the step, 0 where the lane waits."""
    accepted: Pointer
    """1 where the point was taken, else 0."""
    shortened: Pointer
    """Which part of its length a step may have after a rejection."""
    path: Pointer
    """Which path is in each lane, -1 for none."""
    steps: Pointer
    rejected: Pointer
    polishes: Pointer
    """Turns at t = 1."""
    ending: Pointer


def room(n: int, products: int) -> tuple[int, int]:
    """How many float64 and int64 a call of `track_paths` needs to work in."""
    numbers = 4 * n + SERIES * n + n * n + 3 * products
    return STRIDE * numbers + EIGHT * (2 * n + 8) + n + EIGHT, 5 * EIGHT


@part
def new_lanes(shape: Shape, reals: Pointer, whole: Pointer) -> Lanes:
    """Lanes in a room."""
    n, products = shape.n, shape.products
    x = (-address_of(pointer_to(reals, 0)) // 8) % EIGHT  # lines of the cache stay whole
    held = x + STRIDE * n
    S = held + STRIDE * n
    M = S + STRIDE * SERIES * n
    F = M + STRIDE * n * n
    factors = F + STRIDE * n
    P = factors + STRIDE * n
    Q = P + STRIDE * products
    pivot = Q + 2 * STRIDE * products
    scale = pivot + EIGHT * n
    t = scale + EIGHT * n
    number = t + 8 * EIGHT
    for j in range(n):
        reals[number + j] = float(j)
    return Lanes(
        pointer_to(reals, x), pointer_to(reals, held), pointer_to(reals, S), pointer_to(reals, M),
        pointer_to(reals, F), pointer_to(reals, factors), pointer_to(reals, P),
        pointer_to(reals, Q), pointer_to(reals, pivot), pointer_to(reals, scale),
        pointer_to(reals, number), pointer_to(reals, t), pointer_to(reals, t + EIGHT),
        pointer_to(reals, t + 2 * EIGHT), pointer_to(reals, t + 3 * EIGHT),
        pointer_to(reals, t + 4 * EIGHT), pointer_to(reals, t + 5 * EIGHT),
        pointer_to(reals, t + 6 * EIGHT), pointer_to(reals, t + 7 * EIGHT),
        pointer_to(whole, 0), pointer_to(whole, EIGHT), pointer_to(whole, 2 * EIGHT),
        pointer_to(whole, 3 * EIGHT), pointer_to(whole, 4 * EIGHT),
    )  # fmt: skip


# the equations at the points of the lanes


@part
def weighted(S: Pointer, k: int, shape: Shape, unit: Any) -> Any:
    """|S_k|² with the light part in units of length of its own."""
    light, heavy = splat_eight(0.0), splat_eight(0.0)
    for j in range(shape.light):
        light = light + square(fetch(S, SERIES * j + k))
    for j in range(shape.light, shape.n):
        heavy = heavy + square(fetch(S, SERIES * j + k))
    return light / (unit * unit) + heavy


@part
def choose_units(lanes: Lanes, shape: Shape, power: Pointer) -> None:
    """Make |x| = 1; the unit |x_light| / |x_heavy| where less than 1, and the scales of rows."""
    one = splat_eight(1.0)
    light, heavy = splat_eight(0.0), splat_eight(0.0)
    for j in range(shape.light):
        light = light + square(fetch(lanes.x, j))
    for j in range(shape.light, shape.n):
        heavy = heavy + square(fetch(lanes.x, j))
    factor = one / root(light + heavy)
    for j in range(shape.n):
        put(lanes.x, j, scaled(fetch(lanes.x, j), factor))
    unit = one
    if shape.light and shape.light < shape.n:
        unit = where_more(heavy, light, root(light / heavy), one)
        unit = where_more(splat_eight(LEAST_UNIT), unit, splat_eight(LEAST_UNIT), unit)
    store(lanes.unit, 0, unit)
    for i in range(shape.n - 1):
        scale = one
        for _ in range(power[i]):
            scale = scale / unit
        store(lanes.row_scale, EIGHT * i, scale)


@called
def linearise(lanes: Lanes, shape: Shape, pattern: Pattern) -> None:
    """Write the scaled Jacobian and, as right-hand side, minus the scaled equations.

    A quadratic form is half its gradient times x. The last row keeps the correction at right
    angles to x.
    """
    n, t = shape.n, load_eight(lanes.t, 0)
    rest, unit = splat_eight(1.0) - t, load_eight(lanes.unit, 0)
    for i in range(n - 1):
        total, scale = nought(), load_eight(lanes.row_scale, EIGHT * i)
        for j in range(n):
            first, second, third, fourth = nought(), nought(), nought(), nought()
            for term in range(pattern.slots[i * n + j], pattern.slots[i * n + j + 1]):
                x, c = fetch(lanes.x, pattern.other[term]), 4 * pattern.entry[term]
                first = plus_scaled(first, x, splat_eight(pattern.c[c]))
                second = plus_scaled(second, x, splat_eight(pattern.c[c + 1]))
                third = plus_scaled(third, x, splat_eight(pattern.c[c + 2]))
                fourth = plus_scaled(fourth, x, splat_eight(pattern.c[c + 3]))
            real = plus_scaled(scaled(first, rest), third, t)
            turned = plus_scaled(scaled(second, rest), fourth, t)  # times i
            gradient = Eight(real.r - turned.i, real.i + turned.r)
            total = plus_product(total, gradient, fetch(lanes.x, j))
            gradient = scaled(gradient, scale * unit if j < shape.light else scale)
            put(lanes.M, j * n + i, gradient)
        put(lanes.F, i, scaled(total, splat_eight(-0.5) * scale))
    for j in range(n):
        x = fetch(lanes.x, j)
        x = Eight(x.r, negative(x.i))
        put(lanes.M, j * n + n - 1, scaled(x, splat_eight(1.0) / unit) if j < shape.light else x)
    put(lanes.F, n - 1, nought())


@called
def sum_rows(lanes: Lanes, shape: Shape, pattern: Pattern) -> None:
    """Write minus the scaled rows of a and b times Q as the right-hand side.

    Rows of the same products are summed two at a time to save loads, with the same result.
    """
    i = 0
    while i < shape.n - 1:
        if i + 1 < shape.n - 1 and pattern.twin[i]:
            sum_two(lanes, i, pattern)
            i += 2
        else:
            sum_one(lanes, i, pattern)
            i += 1
    put(lanes.F, shape.n - 1, nought())


@part
def sum_one(lanes: Lanes, i: int, pattern: Pattern) -> None:
    """One row; see `sum_rows`."""
    first, second, third, fourth = nought(), nought(), nought(), nought()
    for e in range(pattern.starts[i], pattern.starts[i + 1]):
        A, B = fetch(lanes.Q, 2 * pattern.product[e]), fetch(lanes.Q, 2 * pattern.product[e] + 1)
        first = plus_scaled(first, A, splat_eight(pattern.c[4 * e]))
        second = plus_scaled(second, A, splat_eight(pattern.c[4 * e + 1]))
        third = plus_scaled(third, B, splat_eight(pattern.c[4 * e + 2]))
        fourth = plus_scaled(fourth, B, splat_eight(pattern.c[4 * e + 3]))
    put_row(lanes, i, plus(first, third), plus(second, fourth))


@part
def sum_two(lanes: Lanes, i: int, pattern: Pattern) -> None:
    """A row and the next, of the same products; see `sum_rows`."""
    first, second, third, fourth = nought(), nought(), nought(), nought()
    fifth, sixth, seventh, eighth = nought(), nought(), nought(), nought()
    count = pattern.starts[i + 1] - pattern.starts[i]
    for e in range(pattern.starts[i], pattern.starts[i + 1]):
        A, B = fetch(lanes.Q, 2 * pattern.product[e]), fetch(lanes.Q, 2 * pattern.product[e] + 1)
        first = plus_scaled(first, A, splat_eight(pattern.c[4 * e]))
        second = plus_scaled(second, A, splat_eight(pattern.c[4 * e + 1]))
        third = plus_scaled(third, B, splat_eight(pattern.c[4 * e + 2]))
        fourth = plus_scaled(fourth, B, splat_eight(pattern.c[4 * e + 3]))
        f = e + count
        fifth = plus_scaled(fifth, A, splat_eight(pattern.c[4 * f]))
        sixth = plus_scaled(sixth, A, splat_eight(pattern.c[4 * f + 1]))
        seventh = plus_scaled(seventh, B, splat_eight(pattern.c[4 * f + 2]))
        eighth = plus_scaled(eighth, B, splat_eight(pattern.c[4 * f + 3]))
    put_row(lanes, i, plus(first, third), plus(second, fourth))
    put_row(lanes, i + 1, plus(fifth, seventh), plus(sixth, eighth))


@part
def put_row(lanes: Lanes, i: int, real: Eight, turned: Eight) -> None:
    """Write minus a scaled row, the sum of a part and i times another."""
    row = Eight(turned.i - real.r, negative(real.i + turned.r))
    put(lanes.F, i, scaled(row, load_eight(lanes.row_scale, EIGHT * i)))


@part
def multiply_points(lanes: Lanes, shape: Shape, pattern: Pattern) -> None:
    """Write the products of x, and Q for the equations at t."""
    t = load_eight(lanes.t, 0)
    rest = splat_eight(1.0) - t
    for m in range(shape.products):
        P = product(fetch(lanes.x, pattern.left[m]), fetch(lanes.x, pattern.right[m]))
        put(lanes.Q, 2 * m, scaled(P, rest))
        put(lanes.Q, 2 * m + 1, scaled(P, t))


def _write_order(k: int) -> Any:
    """`write_order` of one order, which makes its loops straight."""

    @called
    def multiply_series(lanes: Lanes, shape: Shape, pattern: Pattern) -> None:
        """Write the products of order k, as far as known, and Q for the equations of order k.

        Order k of x_l x_r is Σ S_i[l] S_{k-i}[r], i from 0 to k. The terms with S_k are left to
        the Jacobian; here those of the order before are added, whose S is known by now.
        """
        t, two = load_eight(lanes.t, 0), splat_eight(2.0)
        rest = splat_eight(1.0) - t
        for m in range(shape.products):
            left = pointer_to(lanes.S, STRIDE * SERIES * pattern.left[m])
            P = nought()
            if m < shape.squares:
                before = product(fetch(left, 0), fetch(left, k - 1))
                for i in range(1, (k + 1) // 2):
                    P = plus_product(P, fetch(left, i), fetch(left, k - i))
                P = scaled(P, two)
                if k % 2 == 0:
                    P = plus_product(P, fetch(left, k // 2), fetch(left, k // 2))
                if k > 1:
                    before = plus_scaled(fetch(lanes.P, m), before, two)
            else:
                right = pointer_to(lanes.S, STRIDE * SERIES * pattern.right[m])
                before = product(fetch(left, 0), fetch(right, k - 1))
                if k > 1:
                    before = plus_product(before, fetch(left, k - 1), fetch(right, 0))
                    before = plus(before, fetch(lanes.P, m))
                for i in range(1, k):
                    P = plus_product(P, fetch(left, i), fetch(right, k - i))
            put(lanes.P, m, P)
            put(lanes.Q, 2 * m + 1, plus_scaled(before, P, t))
            less = Eight(negative(before.r), negative(before.i))
            put(lanes.Q, 2 * m, plus_scaled(less, P, rest))

    @part
    def write_order(lanes: Lanes, shape: Shape, pattern: Pattern) -> None:
        """Write order k of the series."""
        multiply_series(lanes, shape, pattern)
        sum_rows(lanes, shape, pattern)
        solve(lanes, shape, k)

    return write_order


# linear equations


@part
def largest(M: Pointer, number: Pointer, k: int, n: int) -> Any:
    """Which row from k on has the largest number of column k, the first of equals."""
    best = square(fetch(M, k * n + k))
    for i in range(k + 1, n):
        best = larger(best, square(fetch(M, k * n + i)))
    chosen = splat_eight(number[k])
    for back in range(n - k):
        i = n - 1 - back
        chosen = where_equal(square(fetch(M, k * n + i)), best, splat_eight(number[i]), chosen)
    return chosen


@called
def invert(lanes: Lanes, n: int) -> None:
    """Replace M by its inverse; each lane swaps rows of its own, the largest pivot first.

    Gauss-Jordan elimination in place: with the pivot p in row and column k, f_i = M_ik the rest
    of its column and u_j = M_kj / p that of its row,

        M_ij - f_i u_j ,    M_ik = - f_i / p ,    M_kj = u_j ,    M_kk = 1 / p .

    Swapped rows of M are columns of the inverse, swapped back at last.
    """
    M, number = lanes.M, lanes.number
    for k in range(n):
        chosen = largest(M, number, k, n)
        store(lanes.pivot, EIGHT * k, chosen)
        pivot = chosen_of(M, number, k, k, n, chosen)
        upper = fetch(M, k * n + k)
        for i in range(n):
            factor = where_same(chosen, splat_eight(number[i]), upper, fetch(M, k * n + i))
            put(lanes.factors, i, factor)
        size = splat_eight(1.0) / (square(pivot) + splat_eight(TINY))
        reciprocal = Eight(pivot.r * size, negative(pivot.i) * size)
        less = Eight(negative(reciprocal.r), negative(reciprocal.i))
        for j in range(0, n, 2):  # a last single column is done twice, with the same result
            eliminate(lanes, k, j, min(j + 1, n - 1), n, chosen, reciprocal)
        for i in range(n):
            put(M, k * n + i, product(fetch(lanes.factors, i), less))
        put(M, k * n + k, reciprocal)
    for back in range(n):
        k = n - 1 - back
        chosen = load_eight(lanes.pivot, EIGHT * k)
        for i in range(n):
            swap_columns(M, k, i, number, n, chosen)


@part
def chosen_of(M: Pointer, number: Pointer, k: int, j: int, n: int, chosen: Any) -> Eight:
    """The number of column j in the chosen row of each lane."""
    found = fetch(M, j * n + k)
    for i in range(k + 1, n):
        found = where_same(chosen, splat_eight(number[i]), fetch(M, j * n + i), found)
    return found


@part
def swap_columns(M: Pointer, k: int, i: int, number: Pointer, n: int, chosen: Any) -> None:
    """Swap the numbers of row i in column k and in the chosen column behind it."""
    left = fetch(M, k * n + i)
    new = left
    for j in range(k + 1, n):
        column, own = splat_eight(number[j]), fetch(M, j * n + i)
        new = where_same(chosen, column, own, new)
        put(M, j * n + i, where_same(chosen, column, left, own))
    put(M, k * n + i, new)


@part
def eliminate(
    lanes: Lanes, k: int, j: int, second: int, n: int, chosen: Any, reciprocal: Eight
) -> None:
    """Swap numbers of two columns in row k and in the chosen row, and subtract row k.

    Rows before k are never chosen: one loop over all rows takes less time than two exact ones.
    """
    M, number, factors = lanes.M, lanes.number, lanes.factors
    upper, beside = fetch(M, j * n + k), fetch(M, second * n + k)
    u, v = upper, beside
    for i in range(k + 1, n):
        row = splat_eight(number[i])
        u = where_same(chosen, row, fetch(M, j * n + i), u)
        v = where_same(chosen, row, fetch(M, second * n + i), v)
    u, v = product(u, reciprocal), product(v, reciprocal)
    for i in range(n):
        row, factor = splat_eight(number[i]), fetch(factors, i)
        own = where_same(chosen, row, upper, fetch(M, j * n + i))
        other = where_same(chosen, row, beside, fetch(M, second * n + i))
        put(M, j * n + i, minus_product(own, factor, u))
        put(M, second * n + i, minus_product(other, factor, v))
    put(M, j * n + k, u)
    put(M, second * n + k, v)


@called
def solve(lanes: Lanes, shape: Shape, k: int) -> None:
    """Write the solution for the right-hand side as order k, all unknowns in the common unit."""
    n, unit = shape.n, load_eight(lanes.unit, 0)
    for j in range(0, n, 2):  # two at a time to save loads; a last single one is done twice
        second = min(j + 1, n - 1)
        a, b, c, d = nought(), nought(), nought(), nought()
        for i in range(n):
            F, u, v = fetch(lanes.F, i), fetch(lanes.M, i * n + j), fetch(lanes.M, i * n + second)
            a, b = plus_scaled(a, F, u.r), plus_scaled(b, F, u.i)
            c, d = plus_scaled(c, F, v.r), plus_scaled(d, F, v.i)
        put_solution(lanes, shape, j, k, Eight(a.r - b.i, a.i + b.r), unit)
        put_solution(lanes, shape, second, k, Eight(c.r - d.i, c.i + d.r), unit)


@part
def put_solution(lanes: Lanes, shape: Shape, j: int, k: int, z: Eight, unit: Any) -> None:
    """Write an unknown as its order k."""
    put(lanes.S, SERIES * j + k, scaled(z, unit) if j < shape.light else z)


# the series

order_1, order_2, order_3, order_4, order_5, order_6, order_7, order_8 = (
    _write_order(k) for k in range(1, SERIES)
)


@part
def expand(lanes: Lanes, shape: Shape, pattern: Pattern) -> None:
    """Write the series of the paths from the points of the lanes."""
    for j in range(shape.n):
        put(lanes.S, SERIES * j, fetch(lanes.x, j))
    order_1(lanes, shape, pattern)
    order_2(lanes, shape, pattern)
    order_3(lanes, shape, pattern)
    order_4(lanes, shape, pattern)
    order_5(lanes, shape, pattern)
    order_6(lanes, shape, pattern)
    order_7(lanes, shape, pattern)
    order_8(lanes, shape, pattern)
