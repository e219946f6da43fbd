"""The loops of `stepping`: a step kernel called again and again, for many rows or for one.

Rows stand in slots. Each turn makes a step in every slot at work and looks at what the kernel says
of the points that the steps were made from; rows that have ended are handed out, and the last ones
at work take their slots. New rows come in when few are left, not before, so that rows of one age
stand together: most often all of them go on, or nearly all end, and the processor guesses right.
A row never sees its neighbours, so its numbers do not depend on who they are.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, partial
from typing import Any, NamedTuple

import numba
import numpy as np

from gough.numerics.calling import address_of, call_kernel, compiled, digest, part, pointer_to

Pointer = Any
"""To neighbouring numbers; indexed like an array."""

SLOTS = 128
"""Rows at a time: enough to fill the lanes, few enough for the nearest cache."""
REFILL = 4
"""New rows come in when at most one slot in this many is at work; a guess."""
SAID = 3
"""Numbers that a kernel says of a point, behind the next: gap, determinant, size of the step."""
CLOSED, CROSSED, NOT_FINITE, FAR, DIVERGED, STEP_LIMIT = range(6)
"""The endings in the order of `stepping.StepEnding`."""
RUNNING = -1
NOBODY = -1
"""In a slot whose row has ended."""
WRONG_SIZE = -2
"""What `step_row` says of a start or data of another size than the kernel's."""


class Kernels(NamedTuple):
    """Addresses of one step kernel, with the same bits."""

    wide: int
    scalar: int


class Shape(NamedTuple):
    """Sizes of the kernel's inputs, and slots."""

    n: int
    """Numbers of a point x."""
    k: int
    """Numbers a that each row has for itself."""
    m: int
    """Numbers p that all rows share."""
    slots: int


class Rules(NamedTuple):
    """When to stop."""

    tolerance: float
    max_steps: int
    growths: int
    """So many times on end the gap may grow."""
    contraction: float
    """Longest step, in steps before."""
    nothing: float
    """A step up to this may be followed by any other."""
    longest: float
    """Length of the longest first step."""


class Rows(NamedTuple):
    """Data and results of all rows."""

    x: Pointer
    """Starts, then the best points."""
    a: Pointer
    p: Pointer
    side: Pointer
    """Numbers with the sign that determinants have to have; 0 for that at the start."""
    gap: Pointer
    ending: Pointer
    steps: Pointer


class Slots(NamedTuple):
    """State of the rows at work; the first slots are at work, the others are free."""

    a: Pointer
    gap: Pointer
    """At the point before."""
    best: Pointer
    """The smallest gap so far."""
    side: Pointer
    """The determinant at the point before, whose sign is that at the start; at first as given."""
    size: Pointer
    """Of the step from the point before; at first such that the next may be the longest."""
    growths: Pointer
    """How many times on end the gap has grown."""
    steps: Pointer
    row: Pointer


def room(n: int, k: int, slots: int) -> tuple[int, int]:
    """How many float64 and int64 `step_rows` needs to work in."""
    return slots * (3 * (n + SAID) + k + 4), 3 * slots + 8


class Turn(NamedTuple):
    """Points of the slots, rows of n + SAID numbers."""

    before: Pointer
    """That the last step was made from."""
    points: Pointer
    """That it led to."""
    output: Pointer
    """That the next step leads to, with what the kernel says of `points`."""


@part
def new_slots(shape: Shape, reals: Pointer, whole: Pointer) -> tuple[Slots, Turn]:
    """Slots in a room."""
    slots, size = shape.slots, shape.slots * (shape.n + SAID)
    a = 3 * size
    gap = a + slots * shape.k
    state = Slots(
        pointer_to(reals, a), pointer_to(reals, gap), pointer_to(reals, gap + slots),
        pointer_to(reals, gap + 2 * slots), pointer_to(reals, gap + 3 * slots),
        pointer_to(whole, 0), pointer_to(whole, slots), pointer_to(whole, 2 * slots),
    )  # fmt: skip
    turn = Turn(pointer_to(reals, 0), pointer_to(reals, size), pointer_to(reals, 2 * size))
    return state, turn


@part
def enter(
    slots: Slots, points: Pointer, free: int, first: int, count: int, shape: Shape, rows: Rows,
    rules: Rules,
) -> None:  # fmt: skip
    """Put rows from `first` on into slots from `free` on."""
    n, k = shape.n, shape.k
    place = pointer_to(points, free * (n + SAID))
    for i in range(count):
        for j in range(n):
            place[i * (n + SAID) + j] = rows.x[(first + i) * n + j]
    for j in range(count * k):
        slots.a[free * k + j] = rows.a[first * k + j]
    for i in range(count):
        slots.gap[free + i] = np.inf
        slots.best[free + i] = np.inf
        slots.side[free + i] = rows.side[first + i]
        slots.size[free + i] = rules.longest / rules.contraction
        slots.growths[free + i] = 0
        slots.steps[free + i] = 0
        slots.row[free + i] = first + i


@part
def move(slots: Slots, turn: Turn, source: int, target: int, shape: Shape) -> None:
    """Move a row to another slot."""
    n, k = shape.n, shape.k
    for j in range(n):
        turn.points[target * (n + SAID) + j] = turn.points[source * (n + SAID) + j]
        turn.output[target * (n + SAID) + j] = turn.output[source * (n + SAID) + j]
    for j in range(k):
        slots.a[target * k + j] = slots.a[source * k + j]
    slots.gap[target] = slots.gap[source]
    slots.best[target] = slots.best[source]
    slots.side[target] = slots.side[source]
    slots.size[target] = slots.size[source]
    slots.growths[target] = slots.growths[source]
    slots.steps[target] = slots.steps[source]
    slots.row[target] = slots.row[source]


@part
def evaluate(
    kernels: Kernels, slots: Slots, turn: Turn, active: int, shape: Shape, p: Pointer,
    table: Pointer,
) -> None:  # fmt: skip
    """Run the kernel on the slots at work; inputs without numbers are left out."""
    steps = pointer_to(table, 4)
    table[0], steps[0] = address_of(turn.points), 8 * (shape.n + SAID)
    used = 1
    if shape.k:
        table[used], steps[used] = address_of(slots.a), 8 * shape.k
        used += 1
    if shape.m:
        table[used], steps[used] = address_of(p), 0
        used += 1
    table[used], steps[used] = address_of(turn.output), 8 * (shape.n + SAID)
    call_kernel(kernels.wide if active > 1 else kernels.scalar, table, steps, active)


@part
def crossed(side: float, d: float) -> bool:
    """Whether d is no longer on a side of 0."""
    return ((side > 0) & (d <= 0)) | ((side < 0) & (d >= 0))


@part
def is_far(before: float, size: float, rules: Rules) -> bool:
    """Whether a step is too long after the one before, if that was not next to nothing."""
    return (before > rules.nothing) & (size > rules.contraction * before)


@part
def all_go_on(slots: Slots, output: Pointer, active: int, n: int, rules: Rules) -> bool:
    """Whether each row has come closer and needs another step, as most often all do."""
    ready = 0
    for s in range(active):
        said = pointer_to(output, s * (n + SAID) + n)
        gap, d, size = said[0], said[1], said[2]
        open_yet = (gap <= slots.best[s]) & (gap > rules.tolerance) & (gap < np.inf)
        regular = (abs(d) < np.inf) & (not crossed(slots.side[s], d))
        near = not is_far(slots.size[s], size, rules)
        ready += open_yet & regular & near & (slots.steps[s] < rules.max_steps)
    return ready == active


@part
def go_on(slots: Slots, output: Pointer, active: int, n: int) -> None:
    """Make the points of all rows their best ones."""
    for s in range(active):
        said = pointer_to(output, s * (n + SAID) + n)
        slots.gap[s] = slots.best[s] = said[0]
        slots.side[s] = said[1]
        slots.size[s] = said[2]
        slots.growths[s] = 0
        slots.steps[s] += 1


@part
def judge(slots: Slots, s: int, said: Pointer, rules: Rules) -> int:
    """How the row in a slot ended, or RUNNING, from what the kernel says of its point."""
    gap, d, size = said[0], said[1], said[2]
    if not (gap < np.inf and abs(d) < np.inf):
        return NOT_FINITE
    if crossed(slots.side[s], d):
        return CROSSED
    if is_far(slots.size[s], size, rules):
        return FAR
    if gap <= rules.tolerance:
        return CLOSED
    if slots.growths[s] >= rules.growths:
        return DIVERGED
    return STEP_LIMIT if slots.steps[s] >= rules.max_steps else RUNNING


@part
def visit(slots: Slots, s: int, turn: Turn, n: int, rows: Rows, rules: Rules) -> int:
    """Look at the point in a slot; how its row ended or RUNNING.

    The best point goes to the results when its row ends or has gone on to a worse one.
    """
    at, row, last = s * (n + SAID), slots.row[s], slots.gap[s]
    said = pointer_to(turn.output, at + n)
    gap = said[0]
    slots.growths[s] = slots.growths[s] + 1 if gap > last else 0
    ending = judge(slots, s, said, rules)
    better = gap <= slots.best[s] and ending != CROSSED and ending != NOT_FINITE
    if not better and last == slots.best[s] and slots.steps[s] > 0:
        for j in range(n):
            rows.x[row * n + j] = turn.before[at + j]
    if better and ending != RUNNING:
        for j in range(n):
            rows.x[row * n + j] = turn.points[at + j]
    slots.gap[s], slots.side[s], slots.size[s] = gap, said[1], said[2]
    if better:
        slots.best[s] = gap
    return ending


@part
def settle(slots: Slots, turn: Turn, active: int, shape: Shape, rows: Rows, rules: Rules) -> int:
    """Look at the points of all slots at work and hand out the rows that have ended.

    Returns:
        how many rows are left, in front.
    """
    if all_go_on(slots, turn.output, active, shape.n, rules):
        go_on(slots, turn.output, active, shape.n)
        return active
    ended = 0
    for s in range(active):
        ending, row = visit(slots, s, turn, shape.n, rows, rules), slots.row[s]
        if ending == RUNNING:
            slots.steps[s] += 1
            continue
        rows.gap[row] = slots.best[s]
        rows.ending[row] = ending
        rows.steps[row] = slots.steps[s]
        slots.row[s] = NOBODY
        ended += 1
    return closed_up(slots, turn, active, shape) if ended else active


@part
def closed_up(slots: Slots, turn: Turn, active: int, shape: Shape) -> int:
    """Fill slots whose rows have ended from behind; how many rows are left."""
    s, left = 0, active
    while s < left:
        if slots.row[s] != NOBODY:
            s += 1
            continue
        left -= 1
        if slots.row[left] != NOBODY:
            move(slots, turn, left, s, shape)
    return left


@part
def step_rows(kernels: Kernels, shape: Shape, rules: Rules, first: int, last: int, rows: Rows,
              reals: Pointer, whole: Pointer) -> None:  # fmt: skip
    """Solve rows first to last - 1 in place, in a room as large as `room` says."""
    slots, turn = new_slots(shape, reals, whole)
    table = pointer_to(whole, 3 * shape.slots)
    active, waiting = 0, first
    while active or waiting < last:
        if REFILL * active <= shape.slots and waiting < last:
            count = min(shape.slots - active, last - waiting)
            enter(slots, turn.points, active, waiting, count, shape, rows, rules)
            active += count
            waiting += count
        evaluate(kernels, slots, turn, active, shape, rows.p, table)
        active = settle(slots, turn, active, shape, rows, rules)
        turn = Turn(turn.points, turn.output, turn.before)


def _batch() -> Any:
    sources = digest()

    @compiled
    def batch(
        kernels: Kernels, shape: Shape, rules: Rules, first: int, last: int, x: Any, a: Any, p: Any,
        side: Any, gap: Any, ending: Any, steps: Any, reals: Any, whole: Any,
    ) -> None:  # fmt: skip
        assert sources  # so that it is in the key under which numba keeps the code
        rows = Rows(
            pointer_to(x, 0), pointer_to(a, 0), pointer_to(p, 0), pointer_to(side, 0),
            pointer_to(gap, 0), pointer_to(ending, 0), pointer_to(steps, 0),
        )  # fmt: skip
        step_rows(
            kernels, shape, rules, first, last, rows, pointer_to(reals, 0), pointer_to(whole, 0)
        )

    return batch


batch_compiled = _batch()
"""`step_rows` of arrays as machine code: x (rows, n), a (rows, k), p (m,), results (rows,)."""


class RowRoom(NamedTuple):
    """What `step_row` works with: a kernel, its data, and room; all of it in two arrays."""

    reals: Any
    """Tolerance, contraction, nothing, longest, side, gap, p, and the room."""
    whole: Any
    """Address, n, k, m, max_steps, growths, ending, steps, and the room."""


def row_room(address: int, shape: Shape, rules: Rules, p: Any) -> RowRoom:
    """A room for rows of one kernel."""
    reals, whole = room(shape.n, shape.k, 1)
    sizes = (address, shape.n, shape.k, shape.m, rules.max_steps, rules.growths, 0, 0)
    limits = (rules.tolerance, rules.contraction, rules.nothing, rules.longest, 0.0, 0.0)
    return RowRoom(
        np.concatenate([limits, p, np.zeros(reals)]),
        np.concatenate([sizes, np.zeros(whole)]).astype(np.int64),
    )


def _row() -> Callable[..., Any]:
    sources = digest()

    def step_row(x: Any, a: Any, reals: Any, whole: Any) -> tuple[int, int]:
        assert sources
        address, n, k, m = whole[0], whole[1], whole[2], whole[3]
        if len(x) != n or len(a) != k:
            return WRONG_SIZE, 0
        rules = Rules(reals[0], whole[4], whole[5], reals[1], reals[2], reals[3])
        rows = Rows(
            pointer_to(x, 0), pointer_to(a, 0), pointer_to(reals, 6), pointer_to(reals, 4),
            pointer_to(reals, 5), pointer_to(whole, 6), pointer_to(whole, 7),
        )  # fmt: skip
        step_rows(
            Kernels(address, address), Shape(n, k, m, 1), rules, 0, 1, rows,
            pointer_to(reals, 6 + m), pointer_to(whole, 8),
        )  # fmt: skip
        return whole[6], whole[7]

    return step_row


@cache
def row_compiled() -> Any:
    """`step_rows` of one row as machine code: x (n,), start, then result, and a (k,).

    It takes contiguous arrays of float64 and nothing else. The interpreter's lock is held for the
    microsecond it takes, so two threads never work in the same room.
    """
    signature = "UniTuple(int64, 2)(float64[::1], float64[::1], float64[::1], int64[::1])"
    njit: Any = partial(numba.njit, signature, error_model="numpy")
    try:
        return njit(cache=True)(_row())
    except RuntimeError:  # no place to write
        return njit()(_row())
