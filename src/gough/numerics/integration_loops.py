"""The loop of `integration`: many initial value problems at once, each with steps of its own.

Runs stand in lanes. Each turn makes one trial step in every lane; a lane then takes its step,
repeats it shorter, or looks for an event inside it; a lane whose run has ended takes the next run.
Nothing a lane does depends on its neighbours, so numbers do not depend on how many lanes there are
nor on who stands in the others.

An event is located by making the step again and again shorter or longer until its end is at the
event (Illinois), so that steps end at events and no interpolation comes in.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from gough.numerics.calling import (
    address_of,
    call_tile,
    compiled,
    digest,
    part,
    pointer_to,
    routine,
)
from gough.numerics.dormand_prince import (
    INTERPOLANT,
    NODES,
    STAGES,
    error,
    stage_2,
    stage_3,
    stage_4,
    stage_5,
    stage_6,
    stage_7,
)
from gough.numerics.lanes import (
    fma,
    larger,
    load_wide,
    root,
    size,
    smaller,
    splat_wide,
    store,
    where_more,
)
from gough.numerics.projecting import Projection, normalise, project

Pointer = Any
"""To neighbouring numbers; indexed like an array."""

FINISHED, STOPPED, GUARDED, STEP_LIMIT, TOO_SMALL, NOT_FINITE, DRIFTED = range(7)
"""The endings in the order of `integration.Ending`."""
SWITCH, MARK, STOP, GUARD = range(4)
"""Kinds of events: a branch changes; the time is noted; the run ends there; it ends at once."""
LARGEST_FACTOR, SMALLEST_FACTOR, SAFETY = 5.0, 0.2, 0.9
LEAST_ERROR = 1e-12
"""Squared errors below this all give the largest factor."""
SMALLEST_STEP = 1e-14
"""Steps shorter than this times the whole duration are given up."""
LEAST_FIRST = 1e-10
"""First steps that are chosen are not shorter than this times the whole duration."""
PASSED = 1e-12
"""Breaks of signals this near, in parts of the duration, count as passed."""
SMOOTH = 1e-12
"""Signals that differ by less than this, in parts of themselves, do not jump."""
LOCATING = 40
"""Trials for one event at most."""
FREE, RUNNING = -1, -1
LAST, BREAK, JUMP = 1, 2, 3
"""What a step ends at: the end of the run, a break of signals, one where they jump."""
TINY = 5e-324
"""Below the smallest number above zero there is only zero."""
P = np.array(INTERPOLANT).ravel()
C2, C3, C4, C5 = NODES[1:5]


class Shape(NamedTuple):
    """Sizes of a problem: its tile holds t, states, signals, branches, prepared numbers."""

    states: int
    signals: int
    switches: int
    events: int
    """Switches, then all others."""
    prepared: int


class Rules(NamedTuple):
    """How to step, and when to stop."""

    start: float
    end: float
    rtol: float
    first_step: float
    """0 to choose it."""
    largest_step: float
    reversal: float
    """A switch changes where its value is below this on the wrong side."""
    closeness: float
    """How closely other events are located, s."""
    guard: float
    """A run ends where a guard's value falls below this."""
    exact: bool
    """Whether steps end at marks too; else their times are interpolated within steps."""
    once: bool
    """Whether only the first of each interpolated mark is noted."""
    most_steps: int


class Rows(NamedTuple):
    """Data and results of all runs, a row each."""

    states: Pointer
    """Start, then end."""
    prepared: Pointer
    branches: Pointer
    atol: Pointer
    """One for all runs, (states,)."""
    times: Pointer
    """End of each run; its start where it ended by chance is not kept."""
    ending: Pointer
    counts: Pointer
    """Steps taken, steps refused, evaluations, events, (runs, 4)."""
    event_times: Pointer
    event_kinds: Pointer
    room: int
    """Events of a run that there is room for; more are only counted."""
    samples: Pointer
    """States at sample times, (runs, samples, states)."""
    sample_times: Pointer
    sampled: int


class Signals(NamedTuple):
    """Piecewise polynomials of time, the same for all runs: (pieces, signals, 6) coefficients."""

    breaks: Pointer
    coefficients: Pointer
    pieces: int
    passed: float
    """Pieces that begin this soon after the start of a step count as begun, s."""


class Events(NamedTuple):
    """What each event does."""

    kind: Pointer
    direction: Pointer
    """1 rising, -1 falling, 0 both; of switches and guards unused."""


class Lane(NamedTuple):
    """State of the lanes; reals, whole numbers."""

    t: Pointer
    h: Pointer
    long: Pointer
    """The step that was tried before an event shortened it."""
    before: Pointer
    """Longest step known to end before an event, and the event's value there."""
    value_before: Pointer
    after: Pointer
    value_after: Pointer
    run: Pointer
    event: Pointer
    """Which is being located, or -1."""
    side: Pointer
    trials: Pointer
    sample: Pointer
    refused: Pointer
    last: Pointer
    """What the step ends at: LAST, BREAK, JUMP, or 0 for nothing."""
    stops: Pointer
    """1 where an event stops the run after the step, 2 where a guard does."""
    seen: Pointer
    """A bit for each mark that was noted."""
    flips: Pointer
    """How often switches were changed since the last step."""


class Tiles(NamedTuple):
    """Where numbers of all lanes stand."""

    given: Pointer
    """What the kernel takes; after a trial its states are those at the end of the step."""
    y: Pointer
    stages: Pointer
    """Rates and event values of each stage."""
    h: Pointer
    t: Pointer
    error: Pointer
    factor: Pointer
    alarm: Pointer
    """Not 0 where something may have happened in a step."""
    taken: Pointer
    """0 where a lane does not take its step, 1 where it does, 2 where that is all."""
    one_in: Pointer
    """The same of a single lane."""
    one_out: Pointer


def room(width: int, shape: Shape) -> tuple[int, int]:
    """How many float64 and int64 a call of `run_rows` needs to work in."""
    inside = 1 + shape.states + shape.signals + shape.switches + shape.prepared
    out = shape.states + shape.events
    wide = inside + shape.states + STAGES * out + 6 + 7
    return wide * width + inside + out + 24, 10 * width + 8


@part
def new_tiles(width: int, shape: Shape, reals: Pointer) -> tuple[Tiles, int]:
    """Tiles in a room, and the place behind them."""
    inside = 1 + shape.states + shape.signals + shape.switches + shape.prepared
    out = shape.states + shape.events
    y = inside * width
    stages = y + shape.states * width
    h = stages + STAGES * out * width
    one = h + 6 * width
    tiles = Tiles(
        reals,
        pointer_to(reals, y),
        pointer_to(reals, stages),
        pointer_to(reals, h),
        pointer_to(reals, h + width),
        pointer_to(reals, h + 2 * width),
        pointer_to(reals, h + 3 * width),
        pointer_to(reals, h + 4 * width),
        pointer_to(reals, h + 5 * width),
        pointer_to(reals, one),
        pointer_to(reals, one + inside),
    )
    return tiles, one + inside + out


@part
def new_lanes(width: int, reals: Pointer, at: int, whole: Pointer) -> Lane:
    """States of lanes in a room from a place on."""
    return Lane(
        pointer_to(reals, at),
        pointer_to(reals, at + width),
        pointer_to(reals, at + 2 * width),
        pointer_to(reals, at + 3 * width),
        pointer_to(reals, at + 4 * width),
        pointer_to(reals, at + 5 * width),
        pointer_to(reals, at + 6 * width),
        pointer_to(whole, 0),
        pointer_to(whole, width),
        pointer_to(whole, 2 * width),
        pointer_to(whole, 3 * width),
        pointer_to(whole, 4 * width),
        pointer_to(whole, 5 * width),
        pointer_to(whole, 6 * width),
        pointer_to(whole, 7 * width),
        pointer_to(whole, 8 * width),
        pointer_to(whole, 9 * width),
    )


# a step of all lanes


@part
def signal(signals: Signals, count: int, k: int, t: float, start: float) -> float:
    """Value of one signal in a step with a start: steps end where pieces do, so all of a step
    lies in the piece of its start, also where the next one begins with a jump."""
    low, high, begun = 0, signals.pieces - 1, start + signals.passed
    while low < high:
        middle = (low + high + 1) // 2
        if signals.breaks[middle] <= begun:
            low = middle
        else:
            high = middle - 1
    at, s = (low * count + k) * 6, t - signals.breaks[low]
    total = 0.0
    for power in range(6):
        total = total * s + signals.coefficients[at + 5 - power]
    return total


@part
def set_time(share: float, width: Any, tiles: Tiles, shape: Shape, signals: Signals) -> None:
    """Time and signals of a stage."""
    wide = len(width)
    t = fma(splat_wide(share, width), load_wide(tiles.h, 0, width), load_wide(tiles.t, 0, width))
    store(tiles.given, 0, t)
    for k in range(shape.signals):
        for r in range(wide):
            at = (1 + shape.states + k) * wide + r
            tiles.given[at] = signal(signals, shape.signals, k, tiles.given[r], tiles.t[r])


@part
def evaluate(code: int, number: int, width: int, tiles: Tiles, shape: Shape) -> None:
    """Rates and event values of the stage that stands in the tile."""
    at = number * (shape.states + shape.events) * width
    call_tile(code, tiles.given, pointer_to(tiles.stages, at))


def _stage(number: int, share: float, increment: Any) -> Any:
    """The function that makes one stage."""

    def make(code: int, width: Any, tiles: Tiles, shape: Shape, signals: Signals) -> None:
        wide = len(width)
        apart = (shape.states + shape.events) * wide
        h = load_wide(tiles.h, 0, width)
        for j in range(shape.states):
            y = load_wide(tiles.y, j * wide, width)
            y = fma(h, increment(tiles.stages, j * wide, apart, width), y)
            store(tiles.given, (1 + j) * wide, y)
        set_time(share, width, tiles, shape, signals)
        evaluate(code, number, wide, tiles, shape)

    return part(make)


_make_2, _make_3 = _stage(1, C2, stage_2), _stage(2, C3, stage_3)
_make_4, _make_5 = _stage(3, C4, stage_4), _stage(4, C5, stage_5)
_make_6, _make_7 = _stage(5, 1.0, stage_6), _stage(6, 1.0, stage_7)


@routine
def make_trials(code: int, width: Any, tiles: Tiles, shape: Shape, signals: Signals) -> None:
    """One trial step in every lane; its end stays in the tile."""
    _make_2(code, width, tiles, shape, signals)
    _make_3(code, width, tiles, shape, signals)
    _make_4(code, width, tiles, shape, signals)
    _make_5(code, width, tiles, shape, signals)
    _make_6(code, width, tiles, shape, signals)
    _make_7(code, width, tiles, shape, signals)


@part
def squares(j: int, width: Any, h: Any, tiles: Tiles, shape: Shape, atol: Pointer,
            rtol: float) -> tuple[Any, Any]:  # fmt: skip
    """Squares of the error of a state and of what is allowed."""
    wide = len(width)
    apart = (shape.states + shape.events) * wide
    y, y1 = load_wide(tiles.y, j * wide, width), load_wide(tiles.given, (1 + j) * wide, width)
    allowed = fma(splat_wide(rtol, width), larger(size(y), size(y1)), splat_wide(atol[j], width))
    wrong = h * error(tiles.stages, j * wide, apart, width)
    return wrong * wrong, allowed * allowed


@routine
def measure(width: Any, tiles: Tiles, shape: Shape, atol: Pointer, rtol: float) -> None:
    """Mean squared error in tolerances, and what to multiply steps by.

    The factor is 0.9 e^(-3/32) for the mean square e, close to the power -1/5 of its root; square
    roots round alike everywhere.
    """
    even = shape.states - shape.states % 2
    h, total = load_wide(tiles.h, 0, width), splat_wide(0.0, width)
    for j in range(0, even, 2):  # two quotients in one: a/b + c/d = (a d + c b)/(b d)
        a, b = squares(j, width, h, tiles, shape, atol, rtol)
        c, d = squares(j + 1, width, h, tiles, shape, atol, rtol)
        total = total + fma(a, d, c * b) / (b * d)
    if even < shape.states:
        a, b = squares(even, width, h, tiles, shape, atol, rtol)
        total = total + a / b
    total = total * splat_wide(1.0 / shape.states, width)
    store(tiles.error, 0, total)
    fourth = root(root(larger(total, splat_wide(LEAST_ERROR, width))))
    sixteenth = root(root(fourth))
    factor = splat_wide(SAFETY, width) / (sixteenth * root(sixteenth))
    factor = smaller(larger(factor, splat_wide(SMALLEST_FACTOR, width)),
                     splat_wide(LARGEST_FACTOR, width))  # fmt: skip
    store(tiles.factor, 0, factor)


@routine
def watch(width: Any, tiles: Tiles, shape: Shape, level: float, reversal: float) -> None:
    """Raise the alarm in lanes where an event may lie in the step.

    The last event is the guard, if there is one; a level of -inf leaves it out.
    """
    wide = len(width)
    out, inside = shape.states + shape.events, 1 + shape.states + shape.signals
    zero, one, two = splat_wide(0.0, width), splat_wide(1.0, width), splat_wide(2.0, width)
    alarm = zero
    for k in range(shape.switches):
        s = two * load_wide(tiles.given, (inside + k) * wide, width) - one
        least = s * load_wide(tiles.stages, (shape.states + k + out) * wide, width)
        for stage in range(2, STAGES):
            at = (stage * out + shape.states + k) * wide
            least = smaller(least, s * load_wide(tiles.stages, at, width))
        alarm = where_more(splat_wide(-reversal, width), least, one, alarm)
    for k in range(shape.switches, shape.events):
        at = (shape.states + k) * wide
        start = load_wide(tiles.stages, at, width)
        end = load_wide(tiles.stages, at + (STAGES - 1) * out * wide, width)
        alarm = where_more(start * end, zero, alarm, one)
        if k == shape.events - 1:
            alarm = where_more(splat_wide(level, width), end, one, alarm)
    store(tiles.alarm, 0, alarm)


@routine
def commit(width: Any, tiles: Tiles, shape: Shape, quaternions: int, places: Pointer) -> None:
    """States and first stages of the next step in lanes that take theirs.

    Quaternions are made unit again.
    """
    wide = len(width)
    out, half = shape.states + shape.events, splat_wide(0.5, width)
    taken = load_wide(tiles.taken, 0, width)
    for j in range(shape.states):
        y1, y = load_wide(tiles.given, (1 + j) * wide, width), load_wide(tiles.y, j * wide, width)
        store(tiles.y, j * wide, where_more(taken, half, y1, y))
    for j in range(out):
        last = load_wide(tiles.stages, ((STAGES - 1) * out + j) * wide, width)
        first = load_wide(tiles.stages, j * wide, width)
        store(tiles.stages, j * wide, where_more(taken, half, last, first))
    one = splat_wide(1.0, width)
    for n in range(quaternions):
        at, total = places[n] * wide, splat_wide(0.0, width)
        for k in range(4):
            x = load_wide(tiles.y, at + k * wide, width)
            total = fma(x, x, total)
        factor = where_more(taken, half, one / root(total), one)
        for k in range(4):
            store(tiles.y, at + k * wide, factor * load_wide(tiles.y, at + k * wide, width))


# one lane


@routine
def evaluate_one(code: int, r: int, wide: int, tiles: Tiles, shape: Shape, lane: Lane,
                 signals: Signals) -> None:  # fmt: skip
    """Rates and event values at the start of a lane's next step."""
    states, inside = shape.states, 1 + shape.states + shape.signals
    tiles.one_in[0] = lane.t[r]
    for j in range(states):
        tiles.one_in[1 + j] = tiles.y[j * wide + r]
    for k in range(shape.signals):
        t = lane.t[r]
        tiles.one_in[1 + states + k] = signal(signals, shape.signals, k, t, t)
    for k in range(inside, inside + shape.switches + shape.prepared):
        tiles.one_in[k] = tiles.given[k * wide + r]
    call_tile(code, tiles.one_in, tiles.one_out)
    for k in range(states + shape.events):
        tiles.stages[k * wide + r] = tiles.one_out[k]


@routine
def first_step(r: int, wide: int, tiles: Tiles, shape: Shape, rules: Rules, rows: Rows) -> float:
    """A step in which states change by a hundredth of their size in tolerances, or the given one.

    (Hairer, Norsett and Wanner 1993, II.4.)
    """
    if rules.first_step > 0.0:
        return min(rules.first_step, rules.largest_step)
    whole = rules.end - rules.start
    value, slope = 0.0, 0.0
    for j in range(shape.states):
        y, rate = tiles.y[j * wide + r], tiles.stages[j * wide + r]
        allowed = rows.atol[j] + rules.rtol * abs(y)
        value += (y / allowed) ** 2
        slope += (rate / allowed) ** 2
    step = 1e-3 * whole
    if not slope * whole * whole < 1e-20 * value and slope != 0.0:
        step = min(0.01 * np.sqrt(max(value, 1.0) / slope), 0.01 * whole)
    if not step > LEAST_FIRST * whole:  # also where rates are not finite
        step = LEAST_FIRST * whole
    return float(min(step, rules.largest_step))


@routine
def fill(run: int, r: int, code: int, wide: int, tiles: Tiles, shape: Shape, lane: Lane,
         rules: Rules, rows: Rows, signals: Signals, projection: Projection) -> None:  # fmt: skip
    """Put a run into a lane."""
    states, inside = shape.states, 1 + shape.states + shape.signals
    for j in range(states):
        tiles.y[j * wide + r] = rows.states[run * states + j]
    for k in range(shape.switches):
        tiles.given[(inside + k) * wide + r] = rows.branches[run * shape.switches + k]
    for k in range(shape.prepared):
        at = (inside + shape.switches + k) * wide + r
        tiles.given[at] = rows.prepared[run * shape.prepared + k]
    lane.run[r], lane.t[r], lane.event[r] = run, rules.start, -1
    lane.sample[r], lane.refused[r], lane.last[r], lane.stops[r], lane.seen[r] = 0, 0, 0, 0, 0
    lane.flips[r] = 0
    for k in range(4):
        rows.counts[run * 4 + k] = 0
    evaluate_one(code, r, wide, tiles, shape, lane, signals)
    rows.counts[run * 4 + 2] = 1
    while lane.sample[r] < rows.sampled and rows.sample_times[lane.sample[r]] <= rules.start:
        take_sample(r, wide, 0.0, tiles, shape, lane, rows, projection)
    lane.h[r] = first_step(r, wide, tiles, shape, rules, rows)
    lane.long[r] = lane.h[r]


@part
def interpolated(share: float, j: int, r: int, wide: int, tiles: Tiles, shape: Shape,
                 lane: Lane) -> float:  # fmt: skip
    """A state at a share of a lane's trial step."""
    apart, total = (shape.states + shape.events) * wide, 0.0
    if share > 0.0:
        for k in range(STAGES):
            w = P[4 * k + 2] + share * P[4 * k + 3]
            w = share * (P[4 * k] + share * (P[4 * k + 1] + share * w))
            total += w * tiles.stages[k * apart + j * wide + r]
    return float(tiles.y[j * wide + r] + lane.h[r] * total)


@routine
def take_sample(r: int, wide: int, share: float, tiles: Tiles, shape: Shape, lane: Lane,
                rows: Rows, projection: Projection) -> None:  # fmt: skip
    """The states at a share of the step that a lane has made, by the interpolant, put back."""
    states = shape.states
    at = (lane.run[r] * rows.sampled + lane.sample[r]) * states
    for j in range(states):
        rows.samples[at + j] = interpolated(share, j, r, wide, tiles, shape, lane)
    taken = pointer_to(rows.samples, at)
    project(projection, lane.run[r], taken, 1, 0)
    normalise(projection, taken, 1, 0)
    lane.sample[r] += 1


@routine
def finish(r: int, ending: int, wide: int, tiles: Tiles, shape: Shape, lane: Lane,
           rows: Rows) -> None:  # fmt: skip
    """Hand a run out; its lane is free."""
    run, inside = lane.run[r], 1 + shape.states + shape.signals
    for j in range(shape.states):
        rows.states[run * shape.states + j] = tiles.y[j * wide + r]
    for k in range(shape.switches):
        rows.branches[run * shape.switches + k] = tiles.given[(inside + k) * wide + r]
    rows.times[run], rows.ending[run] = lane.t[r], ending
    lane.run[r] = FREE


@part
def sign_of(k: int, r: int, wide: int, tiles: Tiles, shape: Shape, events: Events,
            value: float) -> float:  # fmt: skip
    """1 or -1 so that times it an event's value falls through zero, or 0 if it is not armed."""
    if events.kind[k] == SWITCH:
        inside = 1 + shape.states + shape.signals
        return float(2.0 * tiles.given[(inside + k) * wide + r] - 1.0)
    direction = events.direction[k]
    if direction != 0:
        return -float(direction) if direction * value < 0.0 else 0.0
    return 1.0 if value > 0.0 else (-1.0 if value < 0.0 else 0.0)


@part
def value_at(stage: int, k: int, r: int, wide: int, tiles: Tiles, shape: Shape) -> float:
    """Value of an event at a stage."""
    at = stage * (shape.states + shape.events) + shape.states + k
    return float(tiles.stages[at * wide + r])


@part
def note(run: int, k: int, t: float, rows: Rows) -> None:
    """Keep the time of an event; without room it is only counted."""
    count = rows.counts[run * 4 + 3]
    if count < rows.room:
        rows.event_times[run * rows.room + count] = t
        rows.event_kinds[run * rows.room + count] = k
    rows.counts[run * 4 + 3] = count + 1


@routine
def comes_back(r: int, wide: int, tiles: Tiles, shape: Shape, rules: Rules) -> bool:
    """Whether a switch that starts at zero is on its wrong side at the end of a step, and was on
    the right one in between."""
    for k in range(shape.switches):
        s = 2.0 * tiles.given[(1 + shape.states + shape.signals + k) * wide + r] - 1.0
        start, end = value_at(0, k, r, wide, tiles, shape), value_at(6, k, r, wide, tiles, shape)
        if s * start <= 0.0 and s * end < -rules.reversal:
            for stage in range(1, STAGES - 1):
                if s * value_at(stage, k, r, wide, tiles, shape) > rules.reversal:
                    return True
    return False


@routine
def flip(r: int, wide: int, tiles: Tiles, shape: Shape, lane: Lane, rules: Rules,
         rows: Rows) -> bool:  # fmt: skip
    """Change the switches that stand on their wrong side all along a step; whether there are."""
    inside, changed = 1 + shape.states + shape.signals, False
    for k in range(shape.switches):
        s = 2.0 * tiles.given[(inside + k) * wide + r] - 1.0
        start, end = value_at(0, k, r, wide, tiles, shape), value_at(6, k, r, wide, tiles, shape)
        if s * start <= 0.0 and s * end < -rules.reversal:
            tiles.given[(inside + k) * wide + r] = 0.5 - 0.5 * s
            changed = True
            if lane.t[r] > rules.start:
                note(lane.run[r], k, lane.t[r], rows)
    return changed


@routine
def find_event(r: int, wide: int, tiles: Tiles, shape: Shape, lane: Lane, rules: Rules, rows: Rows,
               events: Events) -> int:  # fmt: skip
    """Whether an event lies in a lane's trial step: 1, and its bracket is set; else 0.

    2 where a switch stood on its wrong side from the start and has been changed; 3 where one went
    there and back between the ends of the step, which the stages in between show.
    """
    if comes_back(r, wide, tiles, shape, rules):
        return 3
    if flip(r, wide, tiles, shape, lane, rules, rows):
        return 2
    first, inside = 2.0, 1 + shape.states + shape.signals
    for k in range(shape.events):
        if events.kind[k] == GUARD or (events.kind[k] == MARK and not rules.exact):
            continue
        start, end = value_at(0, k, r, wide, tiles, shape), value_at(6, k, r, wide, tiles, shape)
        s, switch = sign_of(k, r, wide, tiles, shape, events, start), events.kind[k] == SWITCH
        if s == 0.0 or not s * end < (-rules.reversal if switch else TINY):
            continue
        if start / (start - end) < first:
            first = start / (start - end)
            lane.event[r], lane.side[r], lane.trials[r] = k, 0, 0
            lane.before[r], lane.value_before[r] = 0.0, s * start
            lane.after[r], lane.value_after[r] = lane.h[r], s * end
    if lane.event[r] >= 0:
        lane.h[r] *= first
        return 1
    for k in range(shape.switches):
        s = 2.0 * tiles.given[(inside + k) * wide + r] - 1.0
        for stage in range(1, STAGES - 1):
            if s * value_at(stage, k, r, wide, tiles, shape) < -rules.reversal:
                return 3
    return 0


@routine
def go_on_locating(r: int, wide: int, tiles: Tiles, shape: Shape, lane: Lane, rules: Rules,
                   events: Events) -> bool:  # fmt: skip
    """Whether the trial's end is not yet at the event; the next step to try is then set."""
    k = lane.event[r]
    start, v = value_at(0, k, r, wide, tiles, shape), value_at(6, k, r, wide, tiles, shape)
    v *= sign_of(k, r, wide, tiles, shape, events, start)
    lane.trials[r] += 1
    close = v <= 0.0 and lane.h[r] - lane.before[r] <= rules.closeness
    close = close or (events.kind[k] == SWITCH and abs(v) <= 0.5 * rules.reversal)
    if close or (v <= 0.0 and lane.trials[r] > LOCATING):
        return False
    if v > 0.0:
        lane.before[r], lane.value_before[r] = lane.h[r], v
        if lane.side[r] == 1:
            lane.value_after[r] *= 0.5
        lane.side[r] = 1
    else:
        lane.after[r], lane.value_after[r] = lane.h[r], v
        if lane.side[r] == 2:
            lane.value_before[r] *= 0.5
        lane.side[r] = 2
    a, b = lane.before[r], lane.after[r]
    if b - a <= rules.closeness or lane.trials[r] > LOCATING:
        lane.h[r] = b
        return True
    # a little to the other side than last, so that the bracket closes from both
    aside = 0.25 * rules.closeness if v > 0.0 else -0.25 * rules.closeness
    share = lane.value_before[r] / (lane.value_before[r] - lane.value_after[r])
    margin = 0.1 * rules.closeness
    lane.h[r] = min(max(a + (b - a) * share + aside, a + margin), b - margin)
    return True


@routine
def earlier(r: int, wide: int, tiles: Tiles, shape: Shape, lane: Lane, rules: Rules,
            events: Events) -> bool:  # fmt: skip
    """Whether another event comes before the one that was located; it is located then.

    The first of a step is found from straight lines between its ends, which may cross otherwise.
    """
    k, h, trials = lane.event[r], lane.h[r], lane.trials[r]
    for other in range(shape.events):
        if other == k or events.kind[other] == GUARD or trials > LOCATING:
            continue
        if events.kind[other] == MARK and not rules.exact:
            continue
        start = value_at(0, other, r, wide, tiles, shape)
        end = value_at(6, other, r, wide, tiles, shape)
        s = sign_of(other, r, wide, tiles, shape, events, start)
        least = -rules.reversal if events.kind[other] == SWITCH else 0.0
        if s * start <= 0.0 or not s * end < least:
            continue
        share = start / (start - end)
        if h * (1.0 - share) > rules.closeness:
            lane.event[r], lane.side[r], lane.trials[r] = other, 0, 0
            lane.before[r], lane.value_before[r] = 0.0, s * start
            lane.after[r], lane.value_after[r] = h, s * end
            lane.h[r] = h * share
            return True
    return False


@routine
def note_marks(r: int, code: int, wide: int, tiles: Tiles, shape: Shape, lane: Lane, rules: Rules,
               rows: Rows, events: Events, signals: Signals) -> None:  # fmt: skip
    """Keep the times of marks inside a lane's step.

    The value where a straight line would be zero, by the interpolant, and those at the ends make a
    parabola; a step of Newton's method on that finds its zero.
    """
    for k in range(shape.switches, shape.events):
        if events.kind[k] != MARK or (rules.once and lane.seen[r] >> (k % 63) & 1):
            continue
        start, end = value_at(0, k, r, wide, tiles, shape), value_at(6, k, r, wide, tiles, shape)
        s = sign_of(k, r, wide, tiles, shape, events, start)
        if s == 0.0 or not s * end < TINY:
            continue
        share = start / (start - end)
        if 0.0 < share < 1.0:
            evaluate_inside(share, code, r, wide, tiles, shape, lane, signals)
            rows.counts[lane.run[r] * 4 + 2] += 1
            value = tiles.one_out[shape.states + k]
            first, second = (value - start) / share, (end - value) / (1.0 - share)
            slope = first + (second - first) * share
            if slope != 0.0:
                share = min(max(share - value / slope, 0.0), 1.0)
        note(lane.run[r], k, lane.t[r] + share * lane.h[r], rows)
        lane.seen[r] |= 1 << (k % 63)


@routine
def evaluate_inside(share: float, code: int, r: int, wide: int, tiles: Tiles, shape: Shape,
                    lane: Lane, signals: Signals) -> None:  # fmt: skip
    """Rates and event values at a share of a lane's trial step."""
    states, inside = shape.states, 1 + shape.states + shape.signals
    t = lane.t[r] + share * lane.h[r]
    tiles.one_in[0] = t
    for j in range(states):
        tiles.one_in[1 + j] = interpolated(share, j, r, wide, tiles, shape, lane)
    for k in range(shape.signals):
        tiles.one_in[1 + states + k] = signal(signals, shape.signals, k, t, lane.t[r])
    for k in range(inside, inside + shape.switches + shape.prepared):
        tiles.one_in[k] = tiles.given[k * wide + r]
    call_tile(code, tiles.one_in, tiles.one_out)


@routine
def happen(r: int, wide: int, tiles: Tiles, shape: Shape, lane: Lane, rules: Rules, rows: Rows,
           events: Events) -> bool:  # fmt: skip
    """What the located event does at the end of a step, and whether the run stops.

    Every switch that vanishes there and was falling changes with it.
    """
    located, run, stops = lane.event[r], lane.run[r], False
    inside = 1 + shape.states + shape.signals
    for k in range(shape.events):
        if events.kind[k] == GUARD or (events.kind[k] == MARK and not rules.exact):
            continue
        start, end = value_at(0, k, r, wide, tiles, shape), value_at(6, k, r, wide, tiles, shape)
        s = sign_of(k, r, wide, tiles, shape, events, start)
        if events.kind[k] == SWITCH:
            due = abs(end) <= rules.reversal and s * start > s * end
        else:
            due = s * start > 0.0 and s * end <= 0.0
        if k != located and not due:
            continue
        note(run, k, lane.t[r] + lane.h[r], rows)
        if events.kind[k] == SWITCH:
            tiles.given[(inside + k) * wide + r] = 0.5 - 0.5 * s
        stops = stops or events.kind[k] == STOP
    return stops


@part
def guarded(r: int, wide: int, tiles: Tiles, shape: Shape, events: Events, level: float) -> bool:
    """Whether a guard has fallen below its level at the end of a step."""
    for k in range(shape.switches, shape.events):
        if events.kind[k] == GUARD and not value_at(6, k, r, wide, tiles, shape) >= level:
            return True
    return False


@routine
def pass_samples(r: int, wide: int, tiles: Tiles, shape: Shape, lane: Lane, rules: Rules,
                 rows: Rows, signals: Signals, projection: Projection) -> None:  # fmt: skip
    """Samples and time of a lane that takes its step; `commit` does the rest."""
    t1 = lane.t[r] + lane.h[r]
    if lane.last[r] == LAST:
        t1 = rules.end
    elif lane.last[r] >= BREAK:
        t1 = next_break(signals, lane.t[r], rules.end)
    while lane.sample[r] < rows.sampled and rows.sample_times[lane.sample[r]] <= t1:
        share = (rows.sample_times[lane.sample[r]] - lane.t[r]) / lane.h[r]
        take_sample(r, wide, share, tiles, shape, lane, rows, projection)
    lane.t[r] = t1
    rows.counts[lane.run[r] * 4] += 1
    lane.refused[r], lane.flips[r] = 0, 0
    tiles.taken[r] = 1.0


@part
def refuse(r: int, factor: float, lane: Lane, rules: Rules, rows: Rows) -> None:
    """Make a lane's next trial shorter."""
    rows.counts[lane.run[r] * 4 + 1] += 1
    lane.refused[r], lane.event[r] = 1, -1
    lane.h[r] *= min(factor, 1.0) if factor == factor else SMALLEST_FACTOR
    lane.long[r] = lane.h[r]


@routine
def stuck(r: int, tiles: Tiles, lane: Lane, rules: Rules, rows: Rows) -> int:
    """The ending of a run that can not go on, or RUNNING for none."""
    if lane.h[r] < SMALLEST_STEP * (rules.end - rules.start):
        return NOT_FINITE if tiles.error[r] != tiles.error[r] else TOO_SMALL
    if rows.counts[lane.run[r] * 4] + rows.counts[lane.run[r] * 4 + 1] >= rules.most_steps:
        return STEP_LIMIT
    return RUNNING


@routine
def judge(r: int, code: int, wide: int, tiles: Tiles, shape: Shape, lane: Lane, rules: Rules,
          rows: Rows, events: Events, signals: Signals,
          projection: Projection) -> None:  # fmt: skip
    """Whether a lane takes its trial step, and what happens in it; `settle` goes on from there."""
    run = lane.run[r]
    rows.counts[run * 4 + 2] += STAGES - 1
    if not tiles.error[r] <= 1.0:
        refuse(r, tiles.factor[r], lane, rules, rows)
        ending = stuck(r, tiles, lane, rules, rows)
        if ending != RUNNING:
            finish(r, ending, wide, tiles, shape, lane, rows)
        return
    if lane.event[r] >= 0:
        if (go_on_locating(r, wide, tiles, shape, lane, rules, events)
                or earlier(r, wide, tiles, shape, lane, rules, events)):  # fmt: skip
            lane.last[r] = 0
            return
        lane.stops[r] = 1 if happen(r, wide, tiles, shape, lane, rules, rows, events) else 0
    elif tiles.alarm[r] != 0.0:
        found = find_event(r, wide, tiles, shape, lane, rules, rows, events)
        if found == 1:
            lane.long[r], lane.last[r] = lane.after[r], 0
            return
        if found == 2:
            lane.flips[r] += 1
            if lane.flips[r] > shape.switches:  # both ways lead across: shorter steps may not
                refuse(r, 0.5, lane, rules, rows)
            evaluate_one(code, r, wide, tiles, shape, lane, signals)
            rows.counts[run * 4 + 2] += 1
            ending = stuck(r, tiles, lane, rules, rows)
            if ending != RUNNING:
                finish(r, ending, wide, tiles, shape, lane, rows)
            return
        if found == 3 and lane.h[r] > 1e3 * SMALLEST_STEP * (rules.end - rules.start):
            refuse(r, 0.5, lane, rules, rows)
            return
    if tiles.alarm[r] != 0.0 and not rules.exact:
        note_marks(r, code, wide, tiles, shape, lane, rules, rows, events, signals)
    take(r, wide, tiles, shape, lane, rules, rows, events, signals, projection)


@routine
def jumps(r: int, shape: Shape, lane: Lane, rules: Rules, signals: Signals) -> bool:
    """Whether signals jump where the piece that a lane's step lies in ends."""
    start, t = lane.t[r], next_break(signals, lane.t[r], rules.end)
    for k in range(shape.signals):
        before = signal(signals, shape.signals, k, t, start)
        behind = signal(signals, shape.signals, k, t, t)
        if not abs(behind - before) <= SMOOTH * (abs(behind) + abs(before)):
            return True
    return False


@part
def take(r: int, wide: int, tiles: Tiles, shape: Shape, lane: Lane, rules: Rules, rows: Rows,
         events: Events, signals: Signals, projection: Projection) -> None:  # fmt: skip
    """Take a lane's step, and choose the next."""
    grow = tiles.factor[r]
    if lane.refused[r] == 1:
        grow = min(grow, 1.0)
    long = lane.h[r] * grow
    if lane.event[r] >= 0:
        long = max(long, 0.2 * lane.long[r])
    if tiles.alarm[r] != 0.0 and guarded(r, wide, tiles, shape, events, rules.guard):
        lane.stops[r] = max(lane.stops[r], 2 - lane.stops[r])
    if lane.last[r] == BREAK and jumps(r, shape, lane, rules, signals):
        lane.last[r] = JUMP
    pass_samples(r, wide, tiles, shape, lane, rules, rows, signals, projection)
    lane.h[r] = min(long, rules.largest_step)
    lane.long[r] = lane.h[r]


@routine
def settle(r: int, code: int, wide: int, tiles: Tiles, shape: Shape, lane: Lane, rules: Rules,
           rows: Rows, signals: Signals, projection: Projection) -> None:  # fmt: skip
    """Put the states of a lane that took its step back onto what they obey; end its run if due."""
    run = lane.run[r]
    moved = project(projection, run, tiles.y, wide, r)
    if moved > 0:
        normalise(projection, tiles.y, wide, r)
    if lane.event[r] >= 0 or moved > 0 or lane.last[r] == JUMP:
        evaluate_one(code, r, wide, tiles, shape, lane, signals)
        rows.counts[run * 4 + 2] += 1
    lane.event[r] = -1
    stops, lane.stops[r] = lane.stops[r], 0
    if moved < 0:
        finish(r, DRIFTED, wide, tiles, shape, lane, rows)
    elif stops == 1:
        finish(r, STOPPED, wide, tiles, shape, lane, rows)
    elif lane.last[r] == LAST:
        finish(r, FINISHED, wide, tiles, shape, lane, rows)
    elif stops == 2:
        finish(r, GUARDED, wide, tiles, shape, lane, rows)
    else:
        ending = stuck(r, tiles, lane, rules, rows)
        if ending != RUNNING:
            finish(r, ending, wide, tiles, shape, lane, rows)


@part
def run_lanes(
    width: Any, code: int, code_one: int, shape: Shape, rules: Rules, rows: Rows, events: Events,
    signals: Signals, projection: Projection, first: int, last: int, reals: Pointer, whole: Pointer,
) -> None:  # fmt: skip
    """Runs ``first`` up to ``last``, in as many lanes as ``width`` is long."""
    wide = len(width)
    tiles, at = new_tiles(wide, shape, reals)
    lane = new_lanes(wide, reals, at, whole)
    for r in range(wide):
        lane.run[r] = FREE
    following = first
    last_event = shape.events - 1
    level = -np.inf
    if last_event >= shape.switches and events.kind[last_event] == GUARD:
        level = rules.guard
    while True:
        active = 0
        for r in range(wide):
            if lane.run[r] == FREE and following < last:
                fill(following, r, code_one, wide, tiles, shape, lane, rules, rows, signals,
                     projection)  # fmt: skip
                following += 1
            active += set_step(r, tiles, lane, rules, signals)
        if active == 0:
            return
        make_trials(code, width, tiles, shape, signals)
        measure(width, tiles, shape, rows.atol, rules.rtol)
        watch(width, tiles, shape, level, rules.reversal)
        for r in range(wide):
            tiles.taken[r] = 0.0
            if lane.run[r] != FREE and not take_quickly(r, tiles, lane, rules, rows):
                judge(r, code_one, wide, tiles, shape, lane, rules, rows, events, signals,
                      projection)  # fmt: skip
        commit(width, tiles, shape, projection.quaternions, projection.places)
        for r in range(wide):
            if tiles.taken[r] == 1.0 or (tiles.taken[r] != 0.0 and projection.rows != 0):
                settle(r, code_one, wide, tiles, shape, lane, rules, rows, signals,
                       projection)  # fmt: skip


@part
def take_quickly(r: int, tiles: Tiles, lane: Lane, rules: Rules, rows: Rows) -> bool:
    """Take a step in which nothing happens, as most are; whether that was all.

    The same as `judge` and `settle` make of it.
    """
    h, run = lane.h[r], lane.run[r]
    plain = tiles.error[r] <= 1.0 and tiles.alarm[r] == 0.0 and lane.event[r] < 0
    if not plain or lane.last[r] != 0:
        return False
    t1, steps = lane.t[r] + h, rows.counts[run * 4] + 1
    if lane.sample[r] < rows.sampled and rows.sample_times[lane.sample[r]] <= t1:
        return False
    grow = min(tiles.factor[r], 1.0) if lane.refused[r] == 1 else tiles.factor[r]
    following = min(h * grow, rules.largest_step)
    least = SMALLEST_STEP * (rules.end - rules.start)
    if following < least or steps + rows.counts[run * 4 + 1] >= rules.most_steps:
        return False
    rows.counts[run * 4] = steps
    rows.counts[run * 4 + 2] += STAGES - 1
    lane.t[r], lane.h[r], lane.long[r] = t1, following, following
    lane.refused[r], lane.flips[r] = 0, 0
    tiles.taken[r] = 2.0
    return True


@part
def set_step(r: int, tiles: Tiles, lane: Lane, rules: Rules, signals: Signals) -> int:
    """Start and length of a lane's next trial, none if it is free; 1 if it is not.

    Steps end where a piece of the signals ends.
    """
    tiles.h[r], tiles.t[r] = 0.0, rules.start
    if lane.run[r] == FREE:
        return 0
    if lane.event[r] < 0:
        lane.last[r] = 0
        until = next_break(signals, lane.t[r], rules.end)
        if lane.t[r] + lane.h[r] * 1.0000001 >= until:
            lane.h[r] = until - lane.t[r]
            lane.last[r] = LAST if until == rules.end else BREAK
    tiles.h[r], tiles.t[r] = lane.h[r], lane.t[r]
    return 1


@part
def next_break(signals: Signals, t: float, end: float) -> float:
    """Where the piece of the signals in which a step starts ends, or the end."""
    low, high, begun = 0, signals.pieces, t + signals.passed
    while low < high:
        middle = (low + high) // 2
        if signals.breaks[middle] <= begun:
            low = middle + 1
        else:
            high = middle
    return min(signals.breaks[low], end) if low < signals.pieces else end


class Arrays(NamedTuple):
    """The arrays behind `Rows`, `Signals`, `Events` and `Projection`, in their order."""

    states: Any
    prepared: Any
    branches: Any
    atol: Any
    times: Any
    ending: Any
    counts: Any
    event_times: Any
    event_kinds: Any
    samples: Any
    sample_times: Any
    breaks: Any
    coefficients: Any
    kinds: Any
    directions: Any
    quaternions: Any
    p: Any
    given: Any
    found: Any


class Equations(NamedTuple):
    """What states must obey: addresses and sizes of a `Projection`."""

    rows: int
    move: int
    unknowns: int
    positions: int
    tolerance: float


@part
def run_rows(
    width: Any, code: int, code_one: int, shape: Shape, rules: Rules, equations: Equations,
    first: int, last: int, arrays: Arrays, reals: Any, whole: Any,
) -> None:  # fmt: skip
    """Runs ``first`` up to ``last`` in place.

    Args:
        width: a tuple as long as there are lanes.
        code: of the kernel for that many lanes.
        code_one: of the same for one.
        shape: sizes.
        rules: how to step.
        equations: what states must obey.
        first: first run.
        last: behind the last run.
        arrays: data and results.
        reals: room to work in, as large as `room` says.
        whole: the same for whole numbers.
    """
    a = arrays
    place = (-address_of(pointer_to(reals, 0)) // 8) % 8  # lines of the cache stay whole
    rows = Rows(
        pointer_to(a.states, 0), pointer_to(a.prepared, 0), pointer_to(a.branches, 0),
        pointer_to(a.atol, 0), pointer_to(a.times, 0), pointer_to(a.ending, 0),
        pointer_to(a.counts, 0), pointer_to(a.event_times, 0), pointer_to(a.event_kinds, 0),
        a.event_times.shape[1], pointer_to(a.samples, 0), pointer_to(a.sample_times, 0),
        len(a.sample_times),
    )  # fmt: skip
    passed = PASSED * (rules.end - rules.start)
    signals = Signals(pointer_to(a.breaks, 0), pointer_to(a.coefficients, 0), len(a.breaks), passed)
    events = Events(pointer_to(a.kinds, 0), pointer_to(a.directions, 0))
    projection = Projection(
        equations.rows, equations.move, equations.unknowns, equations.positions, a.p.shape[1],
        len(a.quaternions), pointer_to(a.quaternions, 0), equations.tolerance,
        pointer_to(a.given, 0), pointer_to(a.found, 0), pointer_to(a.p, 0),
    )  # fmt: skip
    run_lanes(width, code, code_one, shape, rules, rows, events, signals, projection, first, last,
              pointer_to(reals, place), pointer_to(whole, 0))  # fmt: skip


def _loop() -> Any:
    sources = digest()

    @compiled
    def loop(*arguments: Any) -> None:
        assert sources  # so that it is in the key under which numba keeps the code
        run_rows(*arguments)

    return loop


run_rows_compiled = _loop()
"""`run_rows` as machine code."""
