"""The loop of `path_tracking`: eight paths at a time, each with its own t and step.

A path in a lane goes through turns. Each turn corrects the point to the path, judges the
correction, and, where it was good, expands the path in powers of the step s from there,

    x(t + s) = S_0 + S_1 s + ... + S_8 s⁸ .

The equations are quadratic, with coefficients (1 - t) a + t b at t. With P_k the coefficients of
the products x_l x_r of a path, the terms of order k of the equations are

    Σ_e  a_e ((1 - t) P_k - P_{k-1}) + b_e (t P_k + P_{k-1})  =  0 ,

linear in S_k with the Jacobian at x(t): one LU factorisation serves all orders and the correction.
A lane whose path has ended takes the next from the queue; lanes never see each other.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numba

from gough.numerics.calling import address_of, compiled, digest, part, pointer_to
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
    fma,
    larger,
    load_eight,
    negative,
    root,
    smaller,
    splat_eight,
    store,
    where_equal,
    where_more,
)

called: Any = numba.njit(error_model="numpy")
"""A function that is compiled once and called, not made a part of its callers."""
Pointer = Any
"""To neighbouring numbers; indexed like an array."""

ORDER = 8
"""Of the series; `step_lengths` takes roots of this order."""
SERIES = ORDER + 1
"""Terms of a series."""
RUNNING = -1
ARRIVED, INFINITE, LOST, STEP_LIMIT, NOT_FINITE = range(5)
"""The endings in the order of `path_tracking.PathEnding`."""
TINY = 1e-300
CONTRACTION = 0.1
"""The second correction may be this much of the first, or else of rounding size."""
ROUNDING = 1e-10
FINISHED = 1e-14
"""Estimated error at which an end needs no more corrections."""
SHARP = 1e-10
"""Last correction of a regular end."""
BLURRED = 1e-6
"""Last correction of an end that still counts: of a double root, half of the digits; a guess."""
LAST_GAP = 1e-9
"""So close to the end steps may arrive at a singular point, where corrections only halve."""
POLISHES = 3
"""Turns spent on an end."""
NEAR_END = 0.9
FAR = 1e-7
"""Light part of a point at infinity, where the path arrived; a guess."""
FAR_ASTRAY = 1e-3
"""The same where it stopped before, or arrived at a singular point; a guess."""
LEAST_UNIT = 1e-12
"""Least dynamic unit of length."""
GROWTH = 1.5
"""By how much a step that was shortened may grow again each turn."""


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


class Rules(NamedTuple):
    """How to step, and when to stop."""

    tolerance: float
    share: float
    correction: float
    max_steps: int
    smallest: float


class Pattern(NamedTuple):
    """Where unknowns and coefficients stand in the equations."""

    starts: Pointer
    """Where the entries of each row start, (n,)."""
    product: Pointer
    """The product of each entry, (entries,)."""
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


class Paths(NamedTuple):
    """Data and results of all paths."""

    x: Pointer
    """Starts, then ends, n complex numbers each."""
    t: Pointer
    correction: Pointer
    ending: Pointer
    steps: Pointer
    rejected: Pointer
    count: int


class Lanes(NamedTuple):
    """State of eight paths and space to work in; complex numbers as in `complex_lanes`."""

    x: Pointer
    """n."""
    held: Pointer
    """The last corrected point, n."""
    S: Pointer
    """Series of x, n × orders; the first of each is x."""
    M: Pointer
    """The Jacobian, then its inverse, n × n."""
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


@part
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
            gradient = nought()
            for term in range(pattern.slots[i * n + j], pattern.slots[i * n + j + 1]):
                c = 4 * pattern.entry[term]
                r = fma(rest, splat_eight(pattern.c[c]), t * splat_eight(pattern.c[c + 2]))
                m = fma(rest, splat_eight(pattern.c[c + 1]), t * splat_eight(pattern.c[c + 3]))
                gradient = plus_product(gradient, fetch(lanes.x, pattern.other[term]), Eight(r, m))
            total = plus_product(total, gradient, fetch(lanes.x, j))
            gradient = scaled(gradient, scale * unit if j < shape.light else scale)
            put(lanes.M, i * n + j, gradient)
        put(lanes.F, i, scaled(total, splat_eight(-0.5) * scale))
    for j in range(n):
        x = fetch(lanes.x, j)
        x = Eight(x.r, negative(x.i))
        put(lanes.M, (n - 1) * n + j, scaled(x, splat_eight(1.0) / unit) if j < shape.light else x)
    put(lanes.F, n - 1, nought())


@called
def sum_rows(lanes: Lanes, shape: Shape, pattern: Pattern) -> None:
    """Write minus the scaled rows of a and b times Q as the right-hand side."""
    for i in range(shape.n - 1):
        first, second, third, fourth = nought(), nought(), nought(), nought()
        for e in range(pattern.starts[i], pattern.starts[i + 1]):
            q = 2 * pattern.product[e]
            A, B = fetch(lanes.Q, q), fetch(lanes.Q, q + 1)
            a, b = splat_eight(pattern.c[4 * e]), splat_eight(pattern.c[4 * e + 2])
            first = plus_scaled(first, A, a)
            second = plus_scaled(second, B, b)
            a, b = splat_eight(pattern.c[4 * e + 1]), splat_eight(pattern.c[4 * e + 3])
            third = plus_scaled(third, A, a)
            fourth = plus_scaled(fourth, B, b)
        real, turned = plus(first, second), plus(third, fourth)  # the latter times i
        total = Eight(turned.i - real.r, negative(real.i + turned.r))
        put(lanes.F, i, scaled(total, load_eight(lanes.row_scale, EIGHT * i)))
    put(lanes.F, shape.n - 1, nought())


@part
def multiply_points(lanes: Lanes, shape: Shape, pattern: Pattern) -> None:
    """Write the products of x, and Q for the equations at t."""
    t = load_eight(lanes.t, 0)
    rest = splat_eight(1.0) - t
    for m in range(shape.products):
        P = product(fetch(lanes.x, pattern.left[m]), fetch(lanes.x, pattern.right[m]))
        put(lanes.Q, 2 * m, scaled(P, rest))
        put(lanes.Q, 2 * m + 1, scaled(P, t))


def _multiply_series(k: int) -> Any:
    """`multiply_series` of one order, which makes its loops straight."""

    @part
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

    return multiply_series


def _expand(k: int) -> Any:
    """The function that writes the series up to order k."""
    if k == 0:
        return start_series
    lower, multiply_series = _expand(k - 1), _multiply_series(k)

    @part
    def expand(lanes: Lanes, shape: Shape, pattern: Pattern) -> None:
        lower(lanes, shape, pattern)
        multiply_series(lanes, shape, pattern)
        sum_rows(lanes, shape, pattern)
        solve(lanes, shape, k)

    return expand


@part
def start_series(lanes: Lanes, shape: Shape, pattern: Pattern) -> None:
    """Write order 0, the points of the lanes."""
    for j in range(shape.n):
        put(lanes.S, SERIES * j, fetch(lanes.x, j))


# linear equations


@part
def largest(M: Pointer, number: Pointer, k: int, n: int) -> Any:
    """Which row from k on has the largest number of column k, the first of equals."""
    best = square(fetch(M, k * n + k))
    for i in range(k + 1, n):
        best = larger(best, square(fetch(M, i * n + k)))
    chosen = splat_eight(number[k])
    for back in range(n - k):
        i = n - 1 - back
        chosen = where_equal(square(fetch(M, i * n + k)), best, splat_eight(number[i]), chosen)
    return chosen


@part
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
        pivot = chosen_of(M, number, k, n, chosen)
        upper = fetch(M, k * n + k)
        for i in range(n):
            factor = where_same(chosen, splat_eight(number[i]), upper, fetch(M, i * n + k))
            put(lanes.factors, i, factor)
        size = splat_eight(1.0) / (square(pivot) + splat_eight(TINY))
        reciprocal = Eight(pivot.r * size, negative(pivot.i) * size)
        less = Eight(negative(reciprocal.r), negative(reciprocal.i))
        for j in range(0, n, 2):  # a last single column is done twice, with the same result
            eliminate(lanes, k, j, min(j + 1, n - 1), n, chosen, reciprocal)
        for i in range(n):
            put(M, i * n + k, product(fetch(lanes.factors, i), less))
        put(M, k * n + k, reciprocal)
    for back in range(n):
        k = n - 1 - back
        chosen = load_eight(lanes.pivot, EIGHT * k)
        for i in range(n):
            swapped(M, i * n + k, 1, number, k, n, chosen)


@part
def chosen_of(M: Pointer, number: Pointer, j: int, n: int, chosen: Any) -> Eight:
    """The number of column j in the chosen row of each lane."""
    found = nought()
    for i in range(n):
        found = where_same(chosen, splat_eight(number[i]), fetch(M, i * n + j), found)
    return found


@part
def swapped(
    M: Pointer, first: int, stride: int, number: Pointer, k: int, n: int, chosen: Any
) -> Eight:
    """Swap number k of a row or column of M with the chosen of those behind it; its new value."""
    upper = fetch(M, first)
    new = upper
    for i in range(k + 1, n):
        row, at = splat_eight(number[i]), first + (i - k) * stride
        own = fetch(M, at)
        new = where_same(chosen, row, own, new)
        put(M, at, where_same(chosen, row, upper, own))
    put(M, first, new)
    return new


@part
def eliminate(
    lanes: Lanes, k: int, j: int, second: int, n: int, chosen: Any, reciprocal: Eight
) -> None:
    """Swap numbers of two columns in row k and in the chosen row, and subtract row k.

    No row before k is chosen: loops over all rows are shorter than their exact ends would be.
    """
    M, number, factors = lanes.M, lanes.number, lanes.factors
    u, v = nought(), nought()
    for i in range(n):
        row = splat_eight(number[i])
        u = plus(u, where_same(chosen, row, fetch(M, j * n + i), nought()))
        v = plus(v, where_same(chosen, row, fetch(M, second * n + i), nought()))
    u, v = product(u, reciprocal), product(v, reciprocal)
    upper, beside = fetch(M, j * n + k), fetch(M, second * n + k)
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
    for j in range(n):
        direct, turned = nought(), nought()  # the latter times i
        for i in range(n):
            entry, F = fetch(lanes.M, j * n + i), fetch(lanes.F, i)
            direct = plus_scaled(direct, F, entry.r)
            turned = plus_scaled(turned, F, entry.i)
        z = Eight(direct.r - turned.i, direct.i + turned.r)
        put(lanes.S, SERIES * j + k, scaled(z, unit) if j < shape.light else z)


# the turns of a path


@part
def correct(lanes: Lanes, shape: Shape, pattern: Pattern) -> None:
    """A Newton step and one with the same factors; the squared sizes of both."""
    choose_units(lanes, shape, pattern.power)
    unit = load_eight(lanes.unit, 0)
    linearise(lanes, shape, pattern)
    invert(lanes, shape.n)
    for again in range(2):
        if again:
            multiply_points(lanes, shape, pattern)
            sum_rows(lanes, shape, pattern)
        solve(lanes, shape, 0)
        size = weighted(lanes.S, 0, shape, unit)
        if again:
            store(lanes.second, 0, size)
        else:
            store(lanes.first, 0, size)
        for j in range(shape.n):
            put(lanes.x, j, plus(fetch(lanes.x, j), fetch(lanes.S, SERIES * j)))


@part
def is_good(lanes: Lanes, lane: int, rules: Rules) -> bool:
    """Whether the corrections of a lane show that its point belongs to its path."""
    first, second = lanes.first[lane], lanes.second[lane]
    if not first < rules.correction * rules.correction:
        return False
    if lanes.t[lane] == 1.0 and lanes.held_t[lane] > 1.0 - LAST_GAP:
        return second <= first
    return second <= CONTRACTION * CONTRACTION * first or second < ROUNDING * ROUNDING


@part
def judge(lanes: Lanes, lane: int, rules: Rules) -> int:
    """Take or refuse the point of a lane; how its path ended or RUNNING."""
    lanes.accepted[lane] = 0.0
    if lanes.path[lane] < 0:
        return RUNNING
    first, second = lanes.first[lane], lanes.second[lane]
    polished = lanes.held_t[lane] == 1.0
    if is_good(lanes, lane, rules):
        lanes.accepted[lane] = 1.0
        if lanes.shortened[lane] == 0.0:
            return LOST
        if lanes.t[lane] == 1.0:
            lanes.polishes[lane] += 1
            exact = second * second <= FINISHED * FINISHED * first
            if exact or lanes.polishes[lane] >= POLISHES:
                return ARRIVED if second <= BLURRED * BLURRED else LOST
        return STEP_LIMIT if lanes.steps[lane] >= rules.max_steps else RUNNING
    if polished:
        return ARRIVED if second <= BLURRED * BLURRED else LOST
    lanes.rejected[lane] += 1
    lanes.shortened[lane] *= 0.5
    if not lanes.t[lane] - lanes.held_t[lane] >= rules.smallest:
        finite = first < math.inf or lanes.steps[lane] > 0
        return LOST if finite else NOT_FINITE
    tried = lanes.steps[lane] + lanes.rejected[lane]
    return STEP_LIMIT if tried >= rules.max_steps else RUNNING


@part
def keep(lanes: Lanes, n: int) -> None:
    """Hold the points that were taken, and go back to the held ones in the other lanes."""
    accepted, one = load_eight(lanes.accepted, 0), splat_eight(1.0)
    for j in range(n):
        x = where_same(accepted, one, fetch(lanes.x, j), fetch(lanes.held, j))
        put(lanes.held, j, x)
        put(lanes.x, j, x)
    t = where_equal(accepted, one, load_eight(lanes.t, 0), load_eight(lanes.held_t, 0))
    store(lanes.held_t, 0, t)
    store(lanes.t, 0, t)


@part
def far_out(lanes: Lanes, lane: int, ending: int, shape: Shape) -> bool:
    """Whether the held point of a lane whose path has ended so is, or was to be, at infinity."""
    if not shape.light or not lanes.held_t[lane] > NEAR_END:
        return False
    light, total = 0.0, 0.0
    for j in range(shape.n):
        r, i = lanes.held[STRIDE * j + lane], lanes.held[STRIDE * j + EIGHT + lane]
        total += r * r + i * i
        if j < shape.light:
            light = total
    sharp = ending == ARRIVED and lanes.second[lane] <= SHARP * SHARP
    limit = FAR if sharp else FAR_ASTRAY
    return light <= limit * limit * total


@part
def release(lanes: Lanes, lane: int, ending: int, shape: Shape, paths: Paths) -> None:
    """Hand out the path of a lane."""
    path = lanes.path[lane]
    for j in range(shape.n):
        paths.x[2 * (path * shape.n + j)] = lanes.held[STRIDE * j + lane]
        paths.x[2 * (path * shape.n + j) + 1] = lanes.held[STRIDE * j + EIGHT + lane]
    paths.t[path] = lanes.held_t[lane]
    paths.correction[path] = math.sqrt(lanes.second[lane])
    paths.ending[path] = INFINITE if far_out(lanes, lane, ending, shape) else ending
    paths.steps[path] = lanes.steps[lane]
    paths.rejected[path] = lanes.rejected[lane]


@part
def enter(lanes: Lanes, lane: int, path: int, shape: Shape, paths: Paths) -> None:
    """Put a path into a lane, or the mark of none."""
    lanes.path[lane] = path if path < paths.count else -1
    if path >= paths.count:
        return
    for j in range(shape.n):
        r, i = paths.x[2 * (path * shape.n + j)], paths.x[2 * (path * shape.n + j) + 1]
        lanes.x[STRIDE * j + lane] = lanes.held[STRIDE * j + lane] = r
        lanes.x[STRIDE * j + EIGHT + lane] = lanes.held[STRIDE * j + EIGHT + lane] = i
    lanes.t[lane] = lanes.held_t[lane] = 0.0
    lanes.shortened[lane] = 1.0
    lanes.steps[lane] = lanes.rejected[lane] = lanes.polishes[lane] = 0


@part
def settle(
    lanes: Lanes, waiting: int, active: int, shape: Shape, paths: Paths, rules: Rules
) -> tuple[int, int]:
    """Judge all lanes, hand out the paths that have ended and take the next.

    Returns:
        the next waiting path, and how many lanes have paths.
    """
    for lane in range(EIGHT):
        lanes.ending[lane] = judge(lanes, lane, rules)
    keep(lanes, shape.n)
    for lane in range(EIGHT):
        if lanes.ending[lane] == RUNNING:
            continue
        release(lanes, lane, lanes.ending[lane], shape, paths)
        lanes.accepted[lane] = 0.0  # the lane waits for a correction of its new path
        enter(lanes, lane, waiting, shape, paths)
        if waiting < paths.count:
            waiting += 1
        else:
            active -= 1
    return waiting, active


@part
def measure(lanes: Lanes, shape: Shape, rules: Rules) -> None:
    """Write the lengths of steps that the series allow.

    The last term may be as large as the tolerance, and the step as long as a share of the radius
    of convergence, estimated from |S_8| / |S_7| and |S_8| / |S_6|. Sizes here are squared.
    """
    n, unit, tiny = shape.n, load_eight(lanes.unit, 0), splat_eight(TINY)
    last = weighted(lanes.S, ORDER, shape, unit) + tiny
    before = weighted(lanes.S, ORDER - 1, shape, unit) + tiny
    second = weighted(lanes.S, ORDER - 2, shape, unit) + tiny
    radius = smaller(root(root(second / last)), root(before / last))
    tolerance = splat_eight(rules.tolerance) * splat_eight(rules.tolerance)
    length = root(root(root(root(tolerance / last))))
    store(lanes.h, 0, smaller(length, splat_eight(rules.share) * radius))


@part
def step(lanes: Lanes, shape: Shape, rules: Rules) -> None:
    """Predict the points of the lanes that do not wait a step ahead."""
    measure(lanes, shape, rules)
    for lane in range(EIGHT):
        h, t = lanes.h[lane] * lanes.shortened[lane], lanes.t[lane]
        lanes.h[lane] = 0.0
        if lanes.accepted[lane] == 0.0 or t == 1.0:
            continue
        lanes.shortened[lane] = min(1.0, GROWTH * lanes.shortened[lane])
        if t + h >= 1.0 - rules.smallest:
            lanes.h[lane] = 1.0 - t
            lanes.t[lane] = 1.0
        elif h >= rules.smallest:
            lanes.h[lane] = h
            lanes.t[lane] = t + h
        else:
            lanes.shortened[lane] = 0.0  # a mark: the path ends at its next judgement
        lanes.steps[lane] += 1
    h = load_eight(lanes.h, 0)
    for j in range(shape.n):
        x = fetch(lanes.S, SERIES * j + ORDER)
        for k in range(1, ORDER + 1):
            x = plus_scaled(fetch(lanes.S, SERIES * j + ORDER - k), x, h)
        put(lanes.x, j, x)


expand = _expand(ORDER)


@part
def track_paths(
    shape: Shape, rules: Rules, starts: Any, product: Any, left: Any, right: Any, slots: Any,
    entry: Any, other: Any, power: Any, c: Any, x: Any, t: Any, correction: Any, ending: Any,
    steps: Any, rejected: Any, reals: Any, whole: Any,
) -> None:  # fmt: skip
    """Track all paths in place; arrays as in `Pattern` and `Paths`, and room to work in."""
    pattern = Pattern(
        pointer_to(starts, 0), pointer_to(product, 0), pointer_to(left, 0), pointer_to(right, 0),
        pointer_to(slots, 0), pointer_to(entry, 0), pointer_to(other, 0), pointer_to(power, 0),
        pointer_to(c, 0),
    )  # fmt: skip
    paths = Paths(
        pointer_to(x, 0), pointer_to(t, 0), pointer_to(correction, 0), pointer_to(ending, 0),
        pointer_to(steps, 0), pointer_to(rejected, 0), len(t),
    )  # fmt: skip
    lanes = new_lanes(shape, reals, whole)
    for lane in range(EIGHT):
        enter(lanes, lane, lane, shape, paths)
    active = min(EIGHT, paths.count)
    waiting = active
    while active:
        correct(lanes, shape, pattern)
        waiting, active = settle(lanes, waiting, active, shape, paths, rules)
        expand(lanes, shape, pattern)
        step(lanes, shape, rules)


def _loop() -> Any:
    sources = digest()

    @compiled
    def loop(*arguments: Any) -> None:
        assert sources  # so that it is in the key under which numba keeps the code
        track_paths(*arguments)

    return loop


track_paths_compiled = _loop()
"""`track_paths` as machine code."""
