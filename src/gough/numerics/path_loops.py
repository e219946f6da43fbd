"""The loop of `path_tracking`: eight paths at a time, each with its own t and step.

A path in a lane goes through turns. Each turn corrects the point to the path, judges the
correction, and, where it was good, expands the path in powers of t from there and goes a step
along. A lane whose path has ended takes the next from the queue; lanes never see each other.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from gough.numerics.calling import compiled, digest, part, pointer_to
from gough.numerics.complex_lanes import STRIDE, fetch, plus, plus_scaled, put, where_same
from gough.numerics.lanes import EIGHT, load_eight, root, smaller, splat_eight, store, where_equal
from gough.numerics.path_equations import (
    ORDER,
    SERIES,
    TINY,
    Lanes,
    Pattern,
    Pointer,
    Shape,
    choose_units,
    expand,
    invert,
    linearise,
    multiply_points,
    new_lanes,
    solve,
    sum_rows,
    weighted,
)

RUNNING = -1
ARRIVED, INFINITE, LOST, STEP_LIMIT, NOT_FINITE = range(5)
"""The endings in the order of `path_tracking.PathEnding`."""
CONTRACTION = 0.1
"""The second correction may be this much of the first, or else of rounding size."""
ROUNDING = 1e-10
FINISHED = 1e-14
"""Estimated error at which an end needs no more corrections."""
SHARP = 1e-10
"""Estimated error of a regular end."""
BLURRED = 1e-6
"""The same of an end that still counts: of a double root, half of the digits; a guess."""
LAST_GAP = 1e-9
"""So close to the end steps may arrive at a singular point, where corrections only halve."""
POLISHES = 3
"""Turns spent on an end."""
NEAR_END = 0.999
"""A path that stops behind this may have run to infinity; a guess."""
FAR = 1e-7
"""Light part of a point at infinity, where the path arrived; a guess."""
FAR_ASTRAY = 1e-3
"""The same where it stopped before, or arrived at a singular point; a guess."""
GROWTH = 1.5
"""By how much a step that was shortened may grow again each turn."""


class Rules(NamedTuple):
    """How to step, and when to stop."""

    tolerance: float
    share: float
    correction: float
    max_steps: int
    smallest: float


class Paths(NamedTuple):
    """Data and results of all paths."""

    x: Pointer
    """Starts, then ends, n complex numbers each."""
    t: Pointer
    correction: Pointer
    ending: Pointer
    steps: Pointer
    rejected: Pointer
    total: int


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
        return bool(second <= first)
    return bool(second <= CONTRACTION * CONTRACTION * first or second < ROUNDING * ROUNDING)


@part
def error(lanes: Lanes, lane: int) -> float:
    """The squared size that a third correction would have, by the ratio of the first two."""
    first: float = lanes.first[lane]
    second: float = lanes.second[lane]
    return second * (second / first) if second < first else second


@part
def judge(lanes: Lanes, lane: int, rules: Rules) -> int:
    """Take or refuse the point of a lane; how its path ended or RUNNING."""
    lanes.accepted[lane] = 0.0
    if lanes.path[lane] < 0:
        return RUNNING
    if is_good(lanes, lane, rules):
        lanes.accepted[lane] = 1.0
        if lanes.shortened[lane] == 0.0:
            return LOST
        if lanes.t[lane] == 1.0:
            return polished(lanes, lane)
        return STEP_LIMIT if lanes.steps[lane] >= rules.max_steps else RUNNING
    if lanes.held_t[lane] == 1.0:
        return ARRIVED if error(lanes, lane) <= BLURRED * BLURRED else LOST
    return refused(lanes, lane, rules)


@part
def polished(lanes: Lanes, lane: int) -> int:
    """How the path of a lane ended whose point at t = 1 was taken, or RUNNING for another turn."""
    lanes.polishes[lane] += 1
    left = error(lanes, lane)
    if left > FINISHED * FINISHED and lanes.polishes[lane] < POLISHES:
        return RUNNING
    return ARRIVED if left <= BLURRED * BLURRED else LOST


@part
def refused(lanes: Lanes, lane: int, rules: Rules) -> int:
    """Shorten the next step of a lane; how its path ended or RUNNING."""
    lanes.rejected[lane] += 1
    lanes.shortened[lane] *= 0.5
    if not lanes.t[lane] - lanes.held_t[lane] >= rules.smallest:
        finite = lanes.first[lane] < math.inf or lanes.steps[lane] > 0
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
    sharp = ending == ARRIVED and error(lanes, lane) <= SHARP * SHARP
    limit = FAR if sharp else FAR_ASTRAY
    return light <= limit * limit * total


@part
def release(lanes: Lanes, lane: int, ending: int, shape: Shape, paths: Paths) -> None:
    """Hand out the path of a lane, its point with unit norm."""
    path, total = lanes.path[lane], 0.0
    for j in range(shape.n):
        r, i = lanes.held[STRIDE * j + lane], lanes.held[STRIDE * j + EIGHT + lane]
        total += r * r + i * i
    size = math.sqrt(total)
    for j in range(shape.n):
        paths.x[2 * (path * shape.n + j)] = lanes.held[STRIDE * j + lane] / size
        paths.x[2 * (path * shape.n + j) + 1] = lanes.held[STRIDE * j + EIGHT + lane] / size
    paths.t[path] = lanes.held_t[lane]
    paths.correction[path] = math.sqrt(error(lanes, lane))
    paths.ending[path] = INFINITE if far_out(lanes, lane, ending, shape) else ending
    paths.steps[path] = lanes.steps[lane]
    paths.rejected[path] = lanes.rejected[lane]


@part
def enter(lanes: Lanes, lane: int, path: int, shape: Shape, paths: Paths) -> None:
    """Put a path into a lane, or the mark of none."""
    lanes.path[lane] = path if path < paths.total else -1
    if path >= paths.total:
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
        if waiting < paths.total:
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
    unit, tiny = load_eight(lanes.unit, 0), splat_eight(TINY)
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
    h, nothing = load_eight(lanes.h, 0), splat_eight(0.0)
    for j in range(shape.n):
        x = fetch(lanes.S, SERIES * j + ORDER)
        for k in range(1, ORDER + 1):
            x = plus_scaled(fetch(lanes.S, SERIES * j + ORDER - k), x, h)
        # a series may not be finite where the lane waits
        put(lanes.x, j, where_same(h, nothing, fetch(lanes.S, SERIES * j), x))


def _loop() -> Any:
    sources = digest()

    @compiled
    def track_paths(
        shape: Shape, rules: Rules, starts: Any, product: Any, twin: Any, left: Any, right: Any,
        slots: Any, entry: Any, other: Any, power: Any, c: Any, x: Any, t: Any, correction: Any,
        ending: Any, steps: Any, rejected: Any, reals: Any, whole: Any,
    ) -> None:  # fmt: skip
        assert sources  # so that it is in the key under which numba keeps the code
        pattern = Pattern(
            pointer_to(starts, 0), pointer_to(product, 0), pointer_to(twin, 0),
            pointer_to(left, 0), pointer_to(right, 0), pointer_to(slots, 0), pointer_to(entry, 0),
            pointer_to(other, 0), pointer_to(power, 0), pointer_to(c, 0),
        )  # fmt: skip
        paths = Paths(
            pointer_to(x, 0), pointer_to(t, 0), pointer_to(correction, 0), pointer_to(ending, 0),
            pointer_to(steps, 0), pointer_to(rejected, 0), len(t),
        )  # fmt: skip
        lanes = new_lanes(shape, reals, whole)
        for lane in range(EIGHT):
            enter(lanes, lane, lane, shape, paths)
        active = min(EIGHT, paths.total)
        waiting = active
        while active:
            correct(lanes, shape, pattern)
            waiting, active = settle(lanes, waiting, active, shape, paths, rules)
            expand(lanes, shape, pattern)
            step(lanes, shape, rules)

    return track_paths


track_paths = _loop()
"""Track all paths in place; arrays as in `Pattern` and `Paths`, and room to work in."""
