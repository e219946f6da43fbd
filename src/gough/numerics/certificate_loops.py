"""The loops of `certificates`: the bounds of sixteen candidates at once, rounding included.

Notation: u = 2⁻⁵³, γ_k = k u / (1 - k u). A sum of products computed in any order, where no term
passes more than k roundings, is off by at most γ_k times the sum of the sizes of its terms (Higham
2002, lemma 3.1 and ch. 3.4). This stays true if multiplications and additions are fused. If the
numbers are complex, this holds for the real and for the imaginary part, and with

    (|a||c| + |b||d|)² + (|a||d| + |b||c|)² <= 2 |a + ib|² |c + id|²

the sum of Πs is off by at most √2 γ_k Σ|Π| in modulus. Here no term passes more than K = 3 n + 1:

    J_jk = Σ_e c_e z        at most n + 1 entries, one fused rounding each
    G_j  = ½ Σ_k J_jk z_k   2 n more
    D_ik = Σ_j Y_ij J_jk    2 n more
    Σ_j Y_ij c_j            at most n - 1

so that g = √2 γ_K serves all: with s_e = error_e + g |c_e| for the entries, for every system
whose coefficients are within the errors,

    |G_j(z)|        <= |fl G_j| + Σ_e s_e |z_l| |z_r|
    Σ_k |I - Y J|_ik  <= Σ_k |fl D - I|_ik + Σ_j |Y_ij| Σ_e s_e (|z_l| + |z_r|) + g
    ½ Σ |Y F''|_i   <= Σ_pairs |fl Σ_j Y_ij c_j,pair| + Σ_j |Y_ij| Σ_e s_e

The last equation, a·(x - a) = 0 with a = Re z, has the exact coefficients a; its residual is
i a·Im z. The right-hand sides are sums of numbers that are not negative. None of these passes more
than (n + 6)² roundings, so they are multiplied by 1 + 2 (n + 6)² u.

Underflow: equations are multiplied by powers of two that bring their largest coefficient or error
to between ½ and 1, and a candidate with a number above 16 fails, so that what is lost, also where
a processor flushes to zero or where the square of a number in a modulus is too small, is less than
n³ 1e-150 for each result; TINY is added to each. Overflow leaves inf or NaN, and the candidate
fails.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from gough.numerics.calling import address_of, compiled, digest, part, pointer_to
from gough.numerics.lanes import (
    LANES,
    fma,
    larger,
    load,
    negative,
    root,
    size,
    splat,
    store,
)

Pointer = Any
"""To neighbouring numbers; indexed like an array."""
Lanes = Any
"""Sixteen float64."""

W = LANES
FAILED, REAL, NOT_REAL, UNDECIDED = range(4)
"""The verdicts in the order of `certificates.Verdict`."""
ROUNDING = 2.0**-53
TINY = 1e-140
"""More than underflow may take from any bound."""
LARGEST = 16.0
"""Largest number of a centre. Starts have a real part of length 1."""
UP, DOWN = 1 + 2.0**-50, 1 - 2.0**-50
"""Factors that make up for five roundings."""
STEPS = 3
"""Newton steps to refine a candidate."""


class System(NamedTuple):
    """The equations, each multiplied by a power of two."""

    n: int
    """Unknowns."""
    rows: Pointer
    left: Pointer
    right: Pointer
    starts: Pointer
    """As in `Quadratics`."""
    c: Pointer
    """Coefficients, (entries,)."""
    slack: Pointer
    """s_e, (entries,)."""
    total: Pointer
    """Sum of the s_e of each equation, (n - 1,)."""
    order: Pointer
    """Entries in the order of their pairs (left, right)."""


class Work(NamedTuple):
    """Scratch space of sixteen candidates: flat, complex numbers as 16 real and 16 imaginary."""

    z: Pointer
    """Centres, (n,) complex."""
    F: Pointer
    """Left sides G, (n,) complex."""
    J: Pointer
    """(n, n) complex."""
    Y: Pointer
    """(n, n) complex."""
    sizes: Pointer
    """|z_j|, (n,)."""
    residual: Pointer
    """Bounds of |G_j|, (n,)."""
    change: Pointer
    """Bounds of what J lacks: Σ_e s_e (|z_l| + |z_r|), (n,)."""
    bounds: Pointer
    """η, δ, κ and the largest |z_j|, (4,)."""
    pivots: Pointer
    """Whole numbers, (n,)."""


def room(n: int, entries: int) -> tuple[int, int]:
    """How many float64 and int64 a call of `certify_candidates` needs to work in."""
    return 2 * entries + n + W * (4 * n * n + 7 * n + 4) + W, entries + n * (n + 1) // 2 + W * n


# data


@part
def new_system(
    n: int, rows: Any, left: Any, right: Any, starts: Any, c: Any, errors: Any, reals: Any,
    whole: Any,
) -> System:  # fmt: skip
    """The equations made ready at the front of a room."""
    entries = len(c)
    system = System(
        n, pointer_to(rows, 0), pointer_to(left, 0), pointer_to(right, 0), pointer_to(starts, 0),
        pointer_to(reals, 0), pointer_to(reals, entries), pointer_to(reals, 2 * entries),
        pointer_to(whole, 0),
    )  # fmt: skip
    g = rounding_of(n)
    for j in range(n - 1):
        most, total = 0.0, 0.0
        for e in range(starts[j], starts[j + 1]):
            most = max(most, abs(c[e]), errors[e])
        power = -math.frexp(most)[1]
        for e in range(starts[j], starts[j + 1]):
            system.c[e] = math.ldexp(c[e], power)
            system.slack[e] = math.ldexp(errors[e], power) + g * abs(system.c[e])
            total += system.slack[e]
        system.total[j] = total
    sort_by_pairs(system, entries, pointer_to(whole, entries))
    return system


@part
def rounding_of(n: int) -> float:
    """√2 γ_K, rounded up."""
    lost = (3 * n + 1) * ROUNDING
    return 1.4143 * lost / (1 - lost)


@part
def pair_of(system: System, e: int) -> int:
    """The number of the pair of unknowns of an entry."""
    left: int = system.left[e]
    right: int = system.right[e]
    return left * (2 * system.n - left - 1) // 2 + right


@part
def sort_by_pairs(system: System, entries: int, places: Pointer) -> None:
    """Write the entries in the order of their pairs, by counting."""
    pairs = system.n * (system.n + 1) // 2
    for k in range(pairs):
        places[k] = 0
    for e in range(entries):
        places[pair_of(system, e)] += 1
    place = 0
    for k in range(pairs):
        place, places[k] = place + places[k], place
    for e in range(entries):
        k = pair_of(system, e)
        system.order[places[k]] = e
        places[k] += 1


@part
def new_work(n: int, entries: int, reals: Any, whole: Any) -> Work:
    """Scratch space in a room, behind the equations."""
    z = 2 * entries + n
    z += (-address_of(pointer_to(reals, z)) // 8) % W  # lines of the cache stay whole
    F = z + 2 * W * n
    J = F + 2 * W * n
    Y = J + 2 * W * n * n
    sizes = Y + 2 * W * n * n
    return Work(
        pointer_to(reals, z), pointer_to(reals, F), pointer_to(reals, J), pointer_to(reals, Y),
        pointer_to(reals, sizes), pointer_to(reals, sizes + W * n),
        pointer_to(reals, sizes + 2 * W * n), pointer_to(reals, sizes + 3 * W * n),
        pointer_to(whole, entries + n * (n + 1) // 2),
    )  # fmt: skip


# complex lanes


@part
def load_pair(p: Pointer, index: int) -> tuple[Lanes, Lanes]:
    """Real and imaginary parts of a number."""
    return load(p, 2 * W * index), load(p, 2 * W * index + W)


@part
def store_pair(p: Pointer, index: int, value: tuple[Lanes, Lanes]) -> None:
    """Write real and imaginary parts."""
    store(p, 2 * W * index, value[0])
    store(p, 2 * W * index + W, value[1])


@part
def add_product(
    total: tuple[Lanes, Lanes], a: tuple[Lanes, Lanes], b: tuple[Lanes, Lanes]
) -> tuple[Lanes, Lanes]:
    """total + a b."""
    real = fma(a[0], b[0], fma(negative(a[1]), b[1], total[0]))
    return real, fma(a[0], b[1], fma(a[1], b[0], total[1]))


@part
def add_multiple(
    total: tuple[Lanes, Lanes], c: Lanes, b: tuple[Lanes, Lanes]
) -> tuple[Lanes, Lanes]:
    """total + c b, c real."""
    return fma(c, b[0], total[0]), fma(c, b[1], total[1])


@part
def modulus(a: tuple[Lanes, Lanes]) -> Lanes:
    """|a|, after three roundings."""
    return root(fma(a[0], a[0], a[1] * a[1]))


@part
def inverse_of(a: tuple[Lanes, Lanes]) -> tuple[Lanes, Lanes]:
    """1 / a."""
    square = fma(a[0], a[0], a[1] * a[1])
    return a[0] / square, negative(a[1]) / square


# centres


@part
def enter(candidates: Any, first: int, n: int, z: Pointer) -> None:
    """Bring candidates into lanes, turned so that the real part is longest, and of length 1.

    Lanes behind the last candidate repeat it.
    """
    for lane in range(W):
        row = min(first + lane, len(candidates) - 1)
        most = 0.0
        for j in range(n):
            most = max(most, abs(candidates[row, j].real), abs(candidates[row, j].imag))
        square = 0j
        for j in range(n):
            number = candidates[row, j]
            number = complex(number.real / most, number.imag / most)
            square += number * number
        turn, length = turn_of(square), 0.0
        for j in range(n):
            number = candidates[row, j]
            number = complex(number.real / most, number.imag / most) * turn
            z[2 * W * j + lane], z[2 * W * j + W + lane] = number.real, number.imag
            length += number.real * number.real
        length = math.sqrt(length)
        for j in range(n):
            z[2 * W * j + lane] /= length
            z[2 * W * j + W + lane] /= length


@part
def turn_of(square: complex) -> complex:
    """The number of modulus 1 whose product with x has the longest real part; square is Σ x_j²."""
    distance = abs(square)
    if distance == 0:
        return 1 + 0j
    real, imaginary = square.real / distance, square.imag / distance
    cosine, sine = math.sqrt(max(0.0, (1 + real) / 2)), math.sqrt(max(0.0, (1 - real) / 2))
    return complex(cosine, -sine if imaginary > 0 else sine)


@part
def evaluate(system: System, work: Work) -> None:
    """Write J and G at the centres; the last equation is a·(x - a) = 0, a = Re z."""
    n, z, J = system.n, work.z, work.J
    zero = splat(0.0)
    for i in range((n - 1) * n):
        store_pair(J, i, (zero, zero))
    for e in range(system.starts[n - 1]):
        c, i, a, b = splat(system.c[e]), system.rows[e] * n, system.left[e], system.right[e]
        store_pair(J, i + a, add_multiple(load_pair(J, i + a), c, load_pair(z, b)))
        store_pair(J, i + b, add_multiple(load_pair(J, i + b), c, load_pair(z, a)))
    along = zero
    for k in range(n):
        a, b = load_pair(z, k)
        along = fma(a, b, along)
        store_pair(J, (n - 1) * n + k, (a, zero))
    for i in range(n - 1):
        value = zero, zero
        for k in range(n):
            value = add_product(value, load_pair(J, i * n + k), load_pair(z, k))
        store_pair(work.F, i, (splat(0.5) * value[0], splat(0.5) * value[1]))
    store_pair(work.F, n - 1, (zero, along))


@part
def exchange(M: Pointer, n: int, lane: int, first: int, second: int, across: int, by: int) -> None:
    """Exchange two rows, or columns, of the matrix of a lane."""
    for j in range(n):
        one = 2 * W * (first * by + j * across) + lane
        two = 2 * W * (second * by + j * across) + lane
        M[one], M[two] = M[two], M[one]
        M[one + W], M[two + W] = M[two + W], M[one + W]


@part
def choose_pivots(M: Pointer, n: int, k: int, pivots: Pointer) -> None:
    """Bring the largest number of column k, from row k on, to row k in each lane."""
    for lane in range(W):
        best, most = k, -1.0
        for i in range(k, n):
            at = 2 * W * (i * n + k) + lane
            square = M[at] * M[at] + M[at + W] * M[at + W]
            if square > most:
                best, most = i, square
        pivots[k * W + lane] = best
        if best != k:
            exchange(M, n, lane, k, best, 1, n)


@part
def clear_column(M: Pointer, n: int, k: int) -> None:
    """Make one step of Gauss and Jordan in place: column k holds that of the inverse after it."""
    zero, one = splat(0.0), splat(1.0)
    factor = inverse_of(load_pair(M, k * n + k))
    store_pair(M, k * n + k, (one, zero))
    for j in range(n):
        entry = load_pair(M, k * n + j)
        store_pair(M, k * n + j, add_product((zero, zero), factor, entry))
    for i in range(n):
        if i == k:
            continue
        real, imaginary = load_pair(M, i * n + k)
        factor = negative(real), negative(imaginary)
        store_pair(M, i * n + k, (zero, zero))
        for j in range(n):
            entry = load_pair(M, i * n + j)
            store_pair(M, i * n + j, add_product(entry, factor, load_pair(M, k * n + j)))


@part
def invert(system: System, work: Work) -> None:
    """Write approximate inverses of J to Y; inf or NaN where there is none."""
    n, M = system.n, work.Y
    for i in range(2 * n * n):
        store(M, W * i, load(work.J, W * i))
    for k in range(n):
        choose_pivots(M, n, k, work.pivots)
        clear_column(M, n, k)
    for back in range(n):
        k = n - 1 - back
        for lane in range(W):
            if work.pivots[k * W + lane] != k:
                exchange(M, n, lane, k, work.pivots[k * W + lane], n, 1)


@part
def refine(system: System, work: Work) -> None:
    """Make Newton steps, then write G, J and its approximate inverse Y at the last centres."""
    n = system.n
    for turn in range(STEPS + 1):
        evaluate(system, work)
        invert(system, work)
        if turn == STEPS:
            break
        for i in range(n):
            step = splat(0.0), splat(0.0)
            for j in range(n):
                step = add_product(step, load_pair(work.Y, i * n + j), load_pair(work.F, j))
            real, imaginary = load_pair(work.z, i)
            store_pair(work.z, i, (real - step[0], imaginary - step[1]))


# bounds


@part
def bound_equations(system: System, work: Work) -> None:
    """Write what each row of Y is multiplied by: bounds of |G_j| and of what J_j lacks."""
    n = system.n
    tiny, g, extent = splat(TINY), splat(rounding_of(n)), splat(0.0)
    along, length = tiny, tiny
    for j in range(n):
        a, b = load_pair(work.z, j)
        z = modulus((a, b))
        store(work.sizes, W * j, z)
        extent = larger(extent, z)
        length = fma(g, size(a), length)
        along = fma(g, size(a) * size(b), along)
    store(work.bounds, 3 * W, extent)
    for j in range(n - 1):
        residual, change = tiny, tiny
        for e in range(system.starts[j], system.starts[j + 1]):
            a, b = load(work.sizes, W * system.left[e]), load(work.sizes, W * system.right[e])
            residual = fma(splat(system.slack[e]), a * b, residual)
            change = fma(splat(system.slack[e]), a + b, change)
        store(work.residual, W * j, residual + modulus(load_pair(work.F, j)))
        store(work.change, W * j, change)
    store(work.residual, W * (n - 1), along + size(load(work.F, W * (2 * n - 1))))
    store(work.change, W * (n - 1), length)


@part
def defect(system: System, work: Work, i: int) -> Lanes:
    """Σ_k |fl D - I|_ik."""
    n, total = system.n, splat(0.0)
    for k in range(n):
        entry = splat(-1.0 if i == k else 0.0), splat(0.0)
        for j in range(n):
            entry = add_product(entry, load_pair(work.Y, i * n + j), load_pair(work.J, j * n + k))
        total = total + modulus(entry)
    return total


@part
def curvature(system: System, work: Work, i: int) -> Lanes:
    """Σ_pairs |fl Σ_j Y_ij c_j,pair|."""
    n, entries = system.n, system.starts[system.n - 1]
    zero = splat(0.0)
    total, entry, last = zero, (zero, zero), -1
    for place in range(entries):
        e = system.order[place]
        pair = pair_of(system, e)
        if pair != last:
            total, entry, last = total + modulus(entry), (zero, zero), pair
        factor = load_pair(work.Y, i * n + system.rows[e])
        entry = add_multiple(entry, splat(system.c[e]), factor)
    return total + modulus(entry)


@part
def bound(system: System, work: Work) -> None:
    """Write η, δ and κ; NaN or inf if any number is not finite."""
    n = system.n
    bound_equations(system, work)
    largest = splat(0.0), splat(0.0), splat(0.0)
    nothing = splat(0.0)
    for i in range(n):
        eta, delta, kappa = splat(0.0), defect(system, work, i), splat(0.0)
        for j in range(n):
            y = modulus(load_pair(work.Y, i * n + j))
            eta = fma(y, load(work.residual, W * j), eta)
            delta = fma(y, load(work.change, W * j), delta)
            kappa = fma(y, splat(system.total[j] if j < n - 1 else 0.0), kappa)
        kappa = kappa + curvature(system, work, i)
        nothing = nothing + splat(0.0) * (eta + delta + kappa)
        largest = larger(largest[0], eta), larger(largest[1], delta), larger(largest[2], kappa)
    more, tiny = splat(1 + 2 * (n + 6) ** 2 * ROUNDING), splat(TINY) + nothing
    store(work.bounds, 0, fma(more, largest[0], tiny))
    store(work.bounds, W, fma(more, largest[1] + splat(rounding_of(n)), tiny))
    store(work.bounds, 2 * W, fma(more, splat(2.0) * largest[2], tiny))


@part
def radii(eta: float, delta: float, kappa: float) -> tuple[float, float]:
    """The roots of η - (1 - δ) r + κ r² / 2, the first rounded up and the second down.

    Returns:
        inf and 0 if they are not proved to be two.
    """
    q = (1 - delta) * DOWN
    square = (q * q * DOWN - 2 * kappa * eta * UP) * DOWN
    if not (q > 0 and square > 0):
        return math.inf, 0.0
    q += math.sqrt(square) * DOWN
    return 2 * eta / q * UP, q * DOWN / kappa * DOWN


@part
def judge(radius: float, reach: float, imaginary: float) -> int:
    """The verdict on a centre whose largest imaginary part is given."""
    if radius == math.inf:
        return FAILED
    if (2 * imaginary + radius) * UP < reach:
        return REAL
    return NOT_REAL if imaginary > radius else UNDECIDED


@part
def leave(
    work: Work, first: int, n: int, x: Any, radius: Any, reach: Any, verdict: Any, bounds: Any
) -> None:
    """Hand out the results of sixteen candidates."""
    for lane in range(min(W, len(x) - first)):
        row, imaginary = first + lane, 0.0
        for j in range(n):
            x[row, j] = complex(work.z[2 * W * j + lane], work.z[2 * W * j + W + lane])
            imaginary = max(imaginary, abs(x[row, j].imag))
        for k in range(4):
            bounds[row, k] = work.bounds[k * W + lane]
        r, far = radii(bounds[row, 0], bounds[row, 1], bounds[row, 2])
        if not bounds[row, 3] <= LARGEST:
            r, far = math.inf, 0.0
        verdict[row] = judge(r, far, imaginary)
        if verdict[row] == REAL:
            far = (far - imaginary) * DOWN
            for j in range(n):
                x[row, j] = complex(x[row, j].real, 0.0)
        radius[row], reach[row] = r, far


@part
def certify_candidates(
    n: int, rows: Any, left: Any, right: Any, starts: Any, c: Any, errors: Any, candidates: Any,
    x: Any, radius: Any, reach: Any, verdict: Any, bounds: Any, reals: Any, whole: Any,
) -> None:  # fmt: skip
    """Refine and judge all candidates.

    Args:
        n: unknowns.
        rows: the pattern, with ``left``, ``right`` and ``starts``.
        left: the same.
        right: the same.
        starts: the same.
        c: coefficients, (entries,).
        errors: their errors, (entries,).
        candidates: (k, n) complex.
        x: where centres go, (k, n) complex.
        radius: (k,).
        reach: (k,).
        verdict: (k,), int8.
        bounds: where η, δ, κ and the largest |z_j| go, (k, 4).
        reals: room to work in, as large as `room` says.
        whole: the same for whole numbers.
    """
    system = new_system(n, rows, left, right, starts, c, errors, reals, whole)
    work = new_work(n, len(c), reals, whole)
    for first in range(0, len(candidates), W):
        enter(candidates, first, n, work.z)
        refine(system, work)
        bound(system, work)
        leave(work, first, n, x, radius, reach, verdict, bounds)


# pairs


@part
def modulus_of(a: complex) -> float:
    """|a|, after three roundings."""
    return math.sqrt(a.real * a.real + a.imag * a.imag)


@part
def measure_numbers(x: Any, sizes: Any) -> None:
    """Write the moduli of the numbers of each centre, (k, n)."""
    for i in range(x.shape[0]):
        for j in range(x.shape[1]):
            sizes[i, j] = modulus_of(x[i, j])


@part
def apart(a: Any, a_sizes: Any, r: float, b: Any, b_sizes: Any, s: float, p: int) -> bool:
    """Whether no point of a ball round a is a multiple of a point of a ball round b.

    If a + h = t (b + g), then x_p y_q = x_q y_p for x = a + h and y = b + g, so the centres have

        |a_p b_q - a_q b_p| <= r (|b_p| + |b_q|) + s (|a_p| + |a_q|) + 2 r s

    for all q. The products here pass no more than four roundings each; 16 u is more than √2 γ_4.

    Args:
        a: centre, (n,).
        a_sizes: |a_j|, (n,).
        r: radius.
        b: the other centre, with ``b_sizes`` and ``s``.
        b_sizes: the same.
        s: the same.
        p: where |a_p| is largest.
    """
    for q in range(len(a)):
        minor = modulus_of(a[p] * b[q] - a[q] * b[p])
        limit = r * (b_sizes[p] + b_sizes[q]) + s * (a_sizes[p] + a_sizes[q]) + 2 * r * s
        limit += 16 * ROUNDING * (a_sizes[p] * b_sizes[q] + a_sizes[q] * b_sizes[p])
        if minor > limit * (1 + 64 * ROUNDING) + TINY:
            return True
    return False


@part
def compare_all(x: Any, y: Any, radius: Any, sizes: Any, others: Any, meets: Any) -> None:
    """Write which balls are not proved to be apart.

    Args:
        x: centres, (k, n).
        y: other centres, (m, n).
        radius: of the balls round the first and then the others, (k + m,).
        sizes: room for their moduli, (k, n).
        others: the same, (m, n).
        meets: where the answers go, (k, m).
    """
    measure_numbers(x, sizes)
    measure_numbers(y, others)
    for i in range(len(x)):
        p = int(np.argmax(sizes[i]))
        for k in range(len(y)):
            meets[i, k] = not apart(
                x[i], sizes[i], radius[i], y[k], others[k], radius[len(x) + k], p
            )


def _loops() -> Any:
    sources = digest()

    @compiled
    def certify(*arguments: Any) -> None:
        assert sources  # so that it is in the key under which numba keeps the code
        certify_candidates(*arguments)

    @compiled
    def compare(*arguments: Any) -> None:
        assert sources
        compare_all(*arguments)

    return certify, compare


certify_compiled, compare_compiled = _loops()
"""`certify_candidates` and `compare_all` as machine code."""
