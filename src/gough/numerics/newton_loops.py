"""The loop of `batch_newton`: many rows at once, each with its own damping and ending.

Rows stand in slots. Each turn fills free slots, makes a step in every one, and lets each take its
trial or refuse it; rows that have ended are handed out. A row never sees its neighbours, so its
numbers do not depend on who they are.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from gough.numerics.calling import address_of, call_kernel, compiled, digest, part, pointer_to
from gough.numerics.damped_steps import Work, damped_steps, measure
from gough.numerics.lanes import LANES

Pointer = Any
"""To neighbouring numbers; indexed like an array."""

SLOTS = 32
"""Rows at a time, a multiple of the lanes: few enough for the nearest cache."""
CLOSED, OPEN, STEP_LIMIT, NOT_FINITE = range(4)
"""The endings in the order of `newton.Ending`."""
RUNNING = -1


class Kernels(NamedTuple):
    """Addresses of the equations."""

    residual: int
    jacobian: int
    retraction: int
    """0 if a step is added to x."""


class Shape(NamedTuple):
    """Sizes of the equations."""

    n: int
    """Numbers of a point x."""
    v: int
    """Numbers of a step."""
    m: int
    """Equations."""
    k: int
    """Parameters p."""
    own: bool
    """Whether each row has its own parameters."""


class Rules(NamedTuple):
    """When to stop, and how far to go at once."""

    tolerance: float
    max_steps: int
    closed_at_start: float
    rounding: float
    stall: float
    largest_step: float
    tries: int


class Rows(NamedTuple):
    """Data and results of all rows."""

    x: Pointer
    """Starts, then the best points."""
    p: Pointer
    gap: Pointer
    ending: Pointer
    steps: Pointer
    row_scale: Pointer
    """What multiplies each equation."""
    x_scale: Pointer
    """What multiplies each number of a step."""
    scale: Pointer
    """What multiplies each entry of the Jacobian."""


class Slots(NamedTuple):
    """State of the rows at work; the first slots are at work, the others are free."""

    x: Pointer
    """The best point so far."""
    p: Pointer
    trial: Pointer
    """Where the residual is wanted."""
    F: Pointer
    """Residual at x."""
    F_trial: Pointer
    J: Pointer
    step: Pointer
    size: Pointer
    """|F|², scaled."""
    gap: Pointer
    size_trial: Pointer
    gap_trial: Pointer
    trust: Pointer
    promised: Pointer
    slope: Pointer
    tries: Pointer
    steps: Pointer
    row: Pointer


def room(n: int, v: int, m: int, k: int) -> tuple[int, int]:
    """How many float64 and int64 a call of `solve_rows` needs to work in."""
    short = min(m, v)
    rows = SLOTS * (2 * n + k + 2 * m + m * v + v + 7)
    lanes = LANES * (m * v + m + (short + 1) * (m + v) + short * (short + 2) + v)
    return rows + lanes + m * v + 2 * LANES, 3 * SLOTS + 6


@part
def new_slots(shape: Shape, reals: Pointer, at: int, whole: Pointer) -> tuple[Slots, int]:
    """Slots in a room from a place on, and the place behind them."""
    n, v, m, k, _ = shape
    x = at
    p = x + SLOTS * n
    trial = p + SLOTS * k
    F = trial + SLOTS * n
    F_trial = F + SLOTS * m
    J = F_trial + SLOTS * m
    step = J + SLOTS * m * v
    size = step + SLOTS * v
    slots = Slots(
        pointer_to(reals, x), pointer_to(reals, p), pointer_to(reals, trial),
        pointer_to(reals, F), pointer_to(reals, F_trial), pointer_to(reals, J),
        pointer_to(reals, step), pointer_to(reals, size), pointer_to(reals, size + SLOTS),
        pointer_to(reals, size + 2 * SLOTS), pointer_to(reals, size + 3 * SLOTS),
        pointer_to(reals, size + 4 * SLOTS), pointer_to(reals, size + 5 * SLOTS),
        pointer_to(reals, size + 6 * SLOTS), pointer_to(whole, 0), pointer_to(whole, SLOTS),
        pointer_to(whole, 2 * SLOTS),
    )  # fmt: skip
    return slots, size + 7 * SLOTS


@part
def new_work(shape: Shape, reals: Pointer, at: int) -> tuple[Work, int]:
    """Scratch space for steps in a room from a place on, and the place behind it."""
    v, m = shape.v, shape.m
    short = min(m, v)
    F = at + LANES * m * v
    Q = F + LANES * m
    R = Q + LANES * (short + 1) * (m + v)
    inverse = R + LANES * short * (short + 1)
    s = inverse + LANES * short
    work = Work(
        pointer_to(reals, at), pointer_to(reals, F), pointer_to(reals, Q), pointer_to(reals, R),
        pointer_to(reals, inverse), pointer_to(reals, s),
    )  # fmt: skip
    return work, s + LANES * v


@part
def enter(slots: Slots, s: int, row: int, shape: Shape, rows: Rows) -> None:
    """Put a row into a slot."""
    n, k = shape.n, shape.k
    for j in range(n):
        slots.trial[s * n + j] = rows.x[row * n + j]
    if shape.own:
        for j in range(k):
            slots.p[s * k + j] = rows.p[row * k + j]
    slots.row[s] = row
    slots.steps[s] = 0
    slots.trust[s] = 1.0


@part
def move(slots: Slots, source: int, target: int, shape: Shape) -> None:
    """Move a row that has taken or refused its trial to another slot."""
    n, m, k = shape.n, shape.m, shape.k
    for j in range(n):
        slots.x[target * n + j] = slots.x[source * n + j]
    if shape.own:
        for j in range(k):
            slots.p[target * k + j] = slots.p[source * k + j]
    for i in range(m):
        slots.F[target * m + i] = slots.F[source * m + i]
    slots.size[target] = slots.size[source]
    slots.gap[target] = slots.gap[source]
    slots.trust[target] = slots.trust[source]
    slots.tries[target] = slots.tries[source]
    slots.steps[target] = slots.steps[source]
    slots.row[target] = slots.row[source]


@part
def take(slots: Slots, s: int, shape: Shape) -> None:
    """Make the trial the point of a slot."""
    n, m = shape.n, shape.m
    for j in range(n):
        slots.x[s * n + j] = slots.trial[s * n + j]
    for i in range(m):
        slots.F[s * m + i] = slots.F_trial[s * m + i]
    slots.size[s] = slots.size_trial[s]
    slots.gap[s] = slots.gap_trial[s]
    slots.tries[s] = 0


@part
def begin(slots: Slots, s: int, shape: Shape, rules: Rules) -> int:
    """Judge the start of a slot; how the row ended or RUNNING."""
    take(slots, s, shape)
    if not slots.gap[s] < np.inf:
        slots.gap[s] = np.inf
        return NOT_FINITE
    if slots.gap[s] <= rules.closed_at_start:
        return CLOSED
    if rules.max_steps == 0:
        return CLOSED if slots.gap[s] <= rules.tolerance else STEP_LIMIT
    return RUNNING


@part
def judge(slots: Slots, s: int, shape: Shape, rules: Rules) -> int:
    """Take or refuse the trial of a slot; how the row ended or RUNNING."""
    before, gap = slots.gap[s], slots.gap_trial[s]
    if before > rules.tolerance and not slots.slope[s] > rules.stall * rules.stall:
        # no slope left, or none that is finite
        return OPEN if slots.slope[s] >= 0 or slots.steps[s] > 0 else NOT_FINITE
    gained, promised = slots.size[s] - slots.size_trial[s], slots.promised[s]
    if not (0 < gained < np.inf and gained > 0.01 * promised):
        return refused(slots, s, rules)
    easier = 0.1 if gained > 0.5 * promised else 1.0
    slots.trust[s] = max(slots.trust[s] * easier, 1e-3)
    take(slots, s, shape)
    slots.steps[s] += 1
    if gap <= rules.tolerance:
        polished = gap <= rules.rounding or gap > 0.5 * before
        return CLOSED if polished or slots.steps[s] >= rules.max_steps else RUNNING
    return STEP_LIMIT if slots.steps[s] >= rules.max_steps else RUNNING


@part
def refused(slots: Slots, s: int, rules: Rules) -> int:
    """Damp the next step of a slot more; a row within tolerance is at rounding and has closed."""
    if slots.gap[s] <= rules.tolerance:
        return CLOSED
    slots.trust[s] = max(slots.trust[s], 1e-6) * 10
    slots.tries[s] += 1
    return OPEN if slots.tries[s] >= rules.tries else RUNNING


@part
def release(slots: Slots, s: int, last: int, ending: int, shape: Shape, rows: Rows) -> None:
    """Hand out the row of a slot and put that of the last slot in its place."""
    n, row = shape.n, slots.row[s]
    for j in range(n):
        rows.x[row * n + j] = slots.x[s * n + j]
    rows.gap[row] = slots.gap[s]
    rows.ending[row] = ending
    rows.steps[row] = slots.steps[s]
    if s < last:
        move(slots, last, s, shape)


@part
def settle(
    slots: Slots, first: int, active: int, started: bool, shape: Shape, rows: Rows, rules: Rules
) -> int:
    """Judge the trials, or the starts, from a slot on and hand out the rows that have ended.

    Returns:
        how many rows are left, in front.
    """
    for group in range(first // LANES * LANES, active, LANES):
        measure(slots.F_trial, group, shape.m, rows.row_scale, slots.size_trial, slots.gap_trial)
    left = active
    for s in range(active - 1, first - 1, -1):  # those that move forward have been judged
        ending = judge(slots, s, shape, rules) if started else begin(slots, s, shape, rules)
        if ending != RUNNING:
            left -= 1
            release(slots, s, left, ending, shape, rows)
    return left


@part
def make_trials(slots: Slots, active: int, shape: Shape, rows: Rows, rules: Rules, work: Work,
                retraction: int, table: Pointer) -> None:  # fmt: skip
    """Make the next trial of each row at work, where J has been evaluated."""
    n, v, m = shape.n, shape.v, shape.m
    for first in range(0, active, LANES):
        damped_steps(
            slots.J, slots.F, slots.size, slots.trust, first, m, v, rows.row_scale, rows.scale,
            rules.largest_step, work, slots.step, slots.promised, slots.slope,
        )  # fmt: skip
    for s in range(active):
        for j in range(v):
            slots.step[s * v + j] *= rows.x_scale[j]
    if v and retraction:
        table[0] = address_of(slots.x)
        table[1] = address_of(slots.step)
        table[2] = address_of(slots.trial)
        table[3] = table[5] = 8 * n
        table[4] = 8 * v
        call_kernel(retraction, table, pointer_to(table, 3), active)
    else:
        for j in range(active * n):
            slots.trial[j] = slots.x[j] + (slots.step[j] if v else 0.0)


@part
def evaluate(
    kernel: int, x: Pointer, output: Pointer, size: int, slots: Slots, first: int, last: int,
    shape: Shape, rows: Rows, table: Pointer,
) -> None:  # fmt: skip
    """Run a kernel of x and p on slots first to active - 1; inputs without numbers are left out."""
    used = 0
    if shape.n:
        table[used] = address_of(x) + 8 * shape.n * first
        table[3 + used] = 8 * shape.n
        used += 1
    if shape.k:
        step = 8 * shape.k if shape.own else 0
        table[used] = (address_of(slots.p) if shape.own else address_of(rows.p)) + step * first
        table[3 + used] = step
        used += 1
    if not used:  # a kernel of no inputs has one that it does not read
        table[0] = address_of(x)
        table[3] = 0
        used = 1
    table[used] = address_of(output) + 8 * size * first
    table[3 + used] = 8 * size
    call_kernel(kernel, table, pointer_to(table, 3), last - first)


@part
def solve_rows(
    kernels: Kernels, shape: Shape, rules: Rules, first: int, last: int, x: Any, p: Any,
    row_scale: Any, x_scale: Any, gap: Any, ending: Any, steps: Any, reals: Any, whole: Any,
) -> None:  # fmt: skip
    """Solve rows first to last - 1 in place.

    Args:
        kernels: addresses.
        shape: sizes.
        rules: when to stop.
        first: first row.
        last: behind the last row.
        x: starts, then results, (rows, n).
        p: parameters, (rows, k), or (1, k) for all rows.
        row_scale: what multiplies each equation, (m,).
        x_scale: what multiplies each number of a step, (v,).
        gap: where the largest residuals go, (rows,).
        ending: where the endings go, (rows,).
        steps: where the numbers of steps go, (rows,).
        reals: room to work in, as large as `room` says.
        whole: the same for whole numbers.
    """
    place = (-address_of(pointer_to(reals, 0)) // 8) % LANES  # lines of the cache stay whole
    slots, place = new_slots(shape, reals, place, whole)
    work, place = new_work(shape, reals, place)
    for i in range(shape.m):
        for j in range(shape.v):
            reals[place + i * shape.v + j] = row_scale[i] * x_scale[j]
    rows = Rows(
        pointer_to(x, 0), pointer_to(p, 0), pointer_to(gap, 0), pointer_to(ending, 0),
        pointer_to(steps, 0), pointer_to(row_scale, 0), pointer_to(x_scale, 0),
        pointer_to(reals, place),
    )  # fmt: skip
    table = pointer_to(whole, 3 * SLOTS)
    active, waiting = 0, first
    while active or waiting < last:
        held = active
        while active < SLOTS and waiting < last:
            enter(slots, active, waiting, shape, rows)
            active += 1
            waiting += 1
        if active > held:
            evaluate(kernels.residual, slots.trial, slots.F_trial, shape.m, slots, held, active,
                     shape, rows, table)  # fmt: skip
            active = settle(slots, held, active, False, shape, rows, rules)
        if not active:
            continue
        if shape.v:
            evaluate(kernels.jacobian, slots.x, slots.J, shape.m * shape.v, slots, 0, active,
                     shape, rows, table)  # fmt: skip
        make_trials(slots, active, shape, rows, rules, work, kernels.retraction, table)
        evaluate(kernels.residual, slots.trial, slots.F_trial, shape.m, slots, 0, active,
                 shape, rows, table)  # fmt: skip
        active = settle(slots, 0, active, True, shape, rows, rules)


def _loop() -> Any:
    sources = digest()

    @compiled
    def loop(*arguments: Any) -> None:
        assert sources  # so that it is in the key under which numba keeps the code
        solve_rows(*arguments)

    return loop


solve_rows_compiled = _loop()
"""`solve_rows` as machine code."""
