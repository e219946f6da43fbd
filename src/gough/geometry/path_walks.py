"""Paths followed through closed configurations, on one solution from beginning to end.

`path_steps` says what is proved of a step. Steps grow while they succeed and are halved when they
fail. They fail for every length only where a singularity stands on the path:

- two solutions merge and end (a fold): steps shrink in proportion to the way that is left, so that
  it is approached geometrically. With d the way left the two solutions are √d apart, and so is the
  smallest singular value of the equations from zero; its square, extrapolated, tells where the fold
  is;
- solutions cross (a bifurcation), as at a flat parallelogram. An unproved step across, to where
  the solution is expected, finds it beyond.

Other singularities change nothing for the equations that are solved: type 2 for paths of outputs,
toggles of legs for paths of inputs. They show as changes of a sign between steps, and are located
by bisection, each half proved again. What happens twice within one step can not be seen this way.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from gough.geometry.path_events import Signs, Watch
from gough.geometry.path_reports import Ending, Event, Given, Kind, Track
from gough.geometry.path_routes import Route
from gough.geometry.path_steps import (
    ClosedFormFollower,
    QuadraticFollower,
    State,
)

if TYPE_CHECKING:
    from gough.geometry.tracking import OnSingularity, Tracker

Array = NDArray[np.float64]

SMALLEST = 1e-10
"""Shortest step, a part of the whole path."""
GROWTH = 1.5
"""Factor of the next step after one that succeeded."""
MOST_STEPS = 20_000
"""Steps, failed ones included, before giving up."""
NEAR = 0.03
"""Measure below which a path that can not go on is at a singularity; a guess."""
APART, TRAIL = 1.3, 500
"""How many times the measure of a state that of an earlier one must be to extrapolate, and among
how many it is looked for."""
CROSSING = 1e-3
"""Steps shorter than this part of the way to where the measure vanishes, if it does so linearly:
at folds steps are in proportion to that way, so solutions probably cross."""
FAR = 0.05
"""Longest way to a crossing that one unproved step may go, a part of the path; a guess."""
RESOLVED = 1e-11
"""How closely events are located."""
TOGETHER = 1e-7
"""Events nearer than this are one."""
SAME_START = 1e-9
"""Largest difference of the first waypoint to the configuration to start from, scaled."""


@dataclass
class Walk:
    """One path on the way.

    Attributes:
        rows: the states at samples, with their signs.
        events: what happened so far.
        certified: whether every step so far is proved.
        trail: the last states.
        measures: `Follower.measure` of states, by their s.
    """

    tracker: Tracker
    given: Given
    route: Route
    near: Array
    on_singularity: OnSingularity
    samples: int
    rows: list[tuple[State, Signs]] = field(default_factory=list)
    events: list[Event] = field(default_factory=list)
    steps: int = 0
    tries: int = 0
    certified: bool = True
    ending: Ending = Ending.arrived
    reason: str = ""
    measures: dict[float, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        tracker = self.tracker
        self.follower = tracker.follower(self.given, self.route)
        self.certified = self.follower.certified
        direct = tracker.inputs_known(self.near)
        self.watch = Watch(
            tracker.kinematics, tracker.inverse, direct[0] if direct else None, self.given
        )

    def track(self) -> Track:
        """The whole path."""
        start = self._start()
        if start is not None:
            self._advance(start)
        return self._report()

    # the beginning

    def _start(self) -> State | None:
        """The first state, None and an ending if there is none."""
        q = self.near if self._closed_form else self._led_in()
        state = None if q is None else self.follower.start(q)
        if state is None:
            self.ending = Ending.no_start
            self.reason = self.reason or self.follower.failed
        return state

    @property
    def _closed_form(self) -> bool:
        return isinstance(self.follower, ClosedFormFollower)

    def _led_in(self) -> Array | None:
        """The configuration at the first point, along a straight line from the one given."""
        here = self.route.coordinates.of(self.near)
        ends = np.array([here, self.route.points[0]])
        lead = Route(self.route.coordinates, self.near, ends)
        if np.abs(lead.points[1] - lead.points[0]).max(initial=0.0) <= SAME_START:
            return self.near
        walk = replace(self, route=lead, samples=2, rows=[], events=[], measures={})
        found = walk.track()
        if not found.arrived:
            self.reason = f"on the way to it, at s = {found.s[-1]:.6g} of a straight line: " + (
                found.reason or found.ending.value
            )
            return None
        self.certified &= found.certified
        return np.asarray(found.q[-1])

    # the way

    def _advance(self, state: State) -> None:
        """Steps from the first state to the end of the path."""
        self.grid = np.linspace(0.0, 1.0, self.samples)
        signs, h = self.watch.signs(state.q), float(self.grid[1])
        self.rows.append((state, signs))
        self.trail = deque([state], TRAIL)
        while state.s < 1.0 and self.ending is Ending.arrived:
            goal = self._goal(state.s, h)
            found = self._try(state, goal)
            if found is None:
                h = 0.5 * (goal - state.s)
                beyond = self._blocked(state, h)
                if beyond is not None:
                    h = max(beyond.s - state.s, SMALLEST * 100)
                    state, signs = beyond, self.watch.signs(beyond.q)
                    self.trail = deque([state], TRAIL)
                continue
            if goal >= state.s + h:
                h *= GROWTH
            after = self.watch.signs(found.q)
            if after != signs and self._happened(state, found, signs, after):
                break
            state, signs = found, after
            self.trail.append(state)
            if np.any(self.grid == state.s):
                self.rows.append((state, signs))
        if self.rows[-1][0].s < state.s:
            self.rows.append((state, signs))

    def _goal(self, s: float, h: float) -> float:
        """Where the next step ends: no farther than the next sample or waypoint."""
        sample = self.grid[min(int(np.searchsorted(self.grid, s, "right")), self.samples - 1)]
        limit = min(float(sample), self.route.next_knot(s))
        return limit if s + h > limit - SMALLEST else s + h

    def _try(self, state: State, s: float) -> State | None:
        self.tries += 1
        if self.tries > MOST_STEPS:
            self.ending = Ending.step_limit
            return None
        found = self.follower.step(state, s)
        self.steps += found is not None
        return found

    # events between two states

    def _happened(self, a: State, b: State, before: Signs, after: Signs) -> bool:
        """Note what changed between two states; whether that ends the path."""
        changes = self.watch.changes(before, after)
        found = sorted(
            (self._located(a, b, before, kind, place) for kind, place in changes),
            key=lambda event: event.s,
        )
        self.events += found
        if not found or self.on_singularity == "continue":
            return False
        self.events = [e for e in self.events if e.s <= found[0].s + TOGETHER]
        self._stop(found[0].s, found[0].q, Ending.stopped)
        return True

    def _located(self, a: State, b: State, before: Signs, kind: Kind, place: int) -> Event:
        """Where a sign changes, by bisection with steps from the near side: just before it."""
        while b.s - a.s > RESOLVED:
            s = 0.5 * (a.s + b.s)
            middle = self.follower.step(a, s)
            if middle is None or not a.s < s < b.s:
                break
            if (kind, place) in self.watch.changes(before, self.watch.signs(middle.q)):
                b = middle
            else:
                a = middle
        return Event(a.s, kind, self.watch.text(kind, place, a.q), a.q)

    def _stop(self, s: float, q: Array, ending: Ending, reason: str = "") -> None:
        last, signs = self.rows[-1]
        if last.s < s:
            self.rows.append((State(s, q, q), signs))
        self.ending, self.reason = ending, reason

    # where no step succeeds

    def _blocked(self, state: State, h: float) -> State | None:
        """See what stands in the way of a step as short as h; a state beyond it to go on from."""
        if self.ending is not Ending.arrived or h > CROSSING * FAR:
            return None
        if self._closed_form:
            return self._at_margin(state) if h < SMALLEST else None
        beyond, before = None, self._earlier(state)
        if before is not None and self._may_cross(before, state, h):
            beyond = self._across(before, state)
        if h < SMALLEST and beyond is None and self.ending is Ending.arrived:
            self._at_fold(before, state)
        return beyond

    def _earlier(self, state: State) -> State | None:
        """The last state that was clearly farther from where solutions meet."""
        here = self._measure(state)
        if here >= NEAR:
            return None
        return next((s for s in reversed(self.trail) if self._measure(s) > APART * here), None)

    def _measure(self, state: State) -> float:
        """The follower's measure of a state, found once."""
        if state.s not in self.measures:
            self.measures[state.s] = self.follower.measure(state)
        return self.measures[state.s]

    def _may_cross(self, before: State, state: State, h: float) -> bool:
        """Whether solutions may cross ahead, not merge; at last that is tried in any case."""
        way = self._way_to_crossing(before, state)
        return 0 < way < FAR and (h < CROSSING * way or h < SMALLEST)

    def _way_to_crossing(self, before: State, state: State) -> float:
        """How far it is to where the measure vanishes, if it is linear in s."""
        a, b = self.follower.measure(before), self.follower.measure(state)
        return b * (state.s - before.s) / (a - b)

    def _across(self, before: State, state: State) -> State | None:
        """A state beyond a crossing of solutions, where the one followed is expected to be."""
        way = self._way_to_crossing(before, state)
        s = min(state.s + 2 * way, self.route.next_knot(state.s))
        beyond = self.follower.expect((before, state), s) if s > state.s + 1.5 * way else None
        if beyond is None:
            return None
        at, q = self._crossing(state, beyond)
        kind = self._own_kind()
        text = f"solutions cross; {self.watch.text(kind, 0, q)}"
        signs = (self.watch.signs(there.q) for there in (state, beyond))
        if any(other != kind for other, _ in self.watch.changes(*signs)):
            kind = "type 3"
        self.certified = False
        self.events.append(Event(at, kind, text, q))
        if self.on_singularity == "stop":
            self._stop(at, q, Ending.stopped)
            return None
        self.rows += self._skipped(state, beyond)
        return beyond

    def _crossing(self, a: State, b: State) -> tuple[float, Array]:
        """Where solutions cross between two states, and the configuration there.

        The measure is |k (s - s*)| with about the same k on both sides.
        """
        for _ in range(4):
            near, far = self.follower.measure(a), self.follower.measure(b)
            part = near / (near + far)
            at, gap = a.s + part * (b.s - a.s), 0.01 * (b.s - a.s)
            closer = [self.follower.expect((a, b), at + side * gap) for side in (-1, 1)]
            if closer[0] is None or closer[1] is None:
                break
            a, b = closer[0], closer[1]
        return at, self.follower.along((a, b), part)

    def _skipped(self, a: State, b: State) -> Iterator[tuple[State, Signs]]:
        """Rows at the samples between two states, where solutions are expected and found."""
        for s in self.grid[(self.grid > a.s) & (self.grid <= b.s)]:
            found = b if s == b.s else self.follower.expect((a, b), float(s))
            if found is not None:
                yield found, self.watch.signs(found.q)

    def _own_kind(self) -> Kind:
        """What a singularity of the equations that are solved is."""
        return "type 2" if self.given == "inputs" else "type 1"

    def _at_fold(self, before: State | None, state: State) -> None:
        """End where two solutions merge, or where nothing tells why no step succeeds."""
        if self.follower.failed:
            self.events.append(Event(state.s, "not reached", self.follower.failed, state.q))
            self._stop(state.s, state.q, Ending.open, self.follower.failed)
            return
        if before is None:
            self._stop(state.s, state.q, Ending.too_small, Ending.too_small.value)
            return
        a, b = self.follower.measure(before), self.follower.measure(state)
        # a² and b² are in proportion to the way left
        at = state.s + b * b * (state.s - before.s) / (a * a - b * b)
        q = self.follower.along((before, state), 1.0 + b / (a - b))
        kind = self._own_kind()
        modes = "assembly modes" if self.given == "inputs" else "working modes"
        text = f"two {modes} merge and end; {self.watch.text(kind, 0, q)}"
        self.events.append(Event(at, kind, text, q))
        self._stop(at, q, Ending.merged, text)

    # closed forms

    def _at_margin(self, state: State) -> State | None:
        """What a margin that vanishes means: a leg out of reach, or two branches that touch."""
        follower = self.follower
        assert isinstance(follower, ClosedFormFollower)
        if follower.failed:
            self.events.append(Event(state.s, "not reached", follower.failed, state.q))
            self._stop(state.s, state.q, Ending.open, follower.failed)
            return None
        limit = self.route.next_knot(state.s)
        s = state.s
        for k in range(8):  # steps from twice to 2·10⁴ times the shortest
            s = min(state.s + 2 * SMALLEST * 4.0**k, limit)
            margins = follower.margins(s)[:, 0]
            if margins.min(initial=1.0) < 0:
                self._out_of_reach(follower, state, s, int(np.argmin(margins)))
                return None
        return self._touched(state, s)

    def _out_of_reach(self, follower: ClosedFormFollower, a: State, s: float, leg: int) -> None:
        """Bisect for where the margin of a leg vanishes, and end there."""
        low, high = a.s, s
        while high - low > 1e-15:
            middle = 0.5 * (low + high)
            if not low < middle < high:
                break
            if follower.margins(middle)[leg, 0] > 0:
                low = middle
            else:
                high = middle
        _, short, _ = follower.margins(s)[leg]
        branch = follower.inverse.branches.branches[leg] if follower.inverse.branches else None
        assert branch is not None
        how = "does not reach" if branch.short is None else "is too short for" if short > 0 else (
            "is too long for"
        )  # fmt: skip
        reason = f"{branch.source} {how} what comes next"
        text = f"the two branches of {branch.source} meet; {self.watch.text('type 1', 0, a.q)}"
        self.events.append(Event(low, "type 1", text, a.q))
        self.events.append(Event(low, "not reached", reason, a.q))
        self._stop(low, a.q, Ending.out_of_reach, reason)

    def _touched(self, state: State, s: float) -> State | None:
        """Go on on the same branch where two touch, unproved."""
        follower = self.follower
        assert isinstance(follower, ClosedFormFollower)
        margins = follower.margins(state.s)[:, 0]
        beyond = follower._at(s, state.q)
        if beyond is None or margins.min(initial=1.0) > NEAR**2:
            self._stop(state.s, state.q, Ending.too_small, Ending.too_small.value)
            return None
        source = self.watch.labels[int(np.argmin(margins))]
        text = f"the two branches of {source} touch; {self.watch.text('type 1', 0, state.q)}"
        self.certified = False
        self.events.append(Event(state.s, "type 1", text, state.q))
        if self.on_singularity == "stop":
            self._stop(state.s, state.q, Ending.stopped)
            return None
        return beyond

    # the result

    def _report(self) -> Track:
        tracker, rows = self.tracker, [state for state, _ in self.rows]
        q = np.array([row.q for row in rows]).reshape(len(rows), len(self.near))
        signs = [signs for _, signs in self.rows]
        return Track(
            tracker.models.structure.mechanism.name,
            self.given,
            np.array([row.s for row in rows]),
            q,
            tracker.coordinates["outputs"].of(q),
            tracker.coordinates["inputs"].of(q),
            tuple(sign.word for sign in signs),
            np.array([sign.determinant for sign in signs], dtype=np.int8),
            tuple(_merged(sorted(self.events, key=lambda event: event.s))),
            self.ending,
            self.reason,
            self.certified and self.ending is not Ending.no_start,
            self.steps,
            self.watch.labels,
            self._notes(),
        )

    def _notes(self) -> tuple[str, ...]:
        notes = []
        if not self.follower.certified:
            notes.append(
                "the equations have no square system of polynomials with these coordinates known: "
                "steps are short and straight, but not proved"
            )
        follower = self.follower
        if isinstance(follower, QuadraticFollower) and len(follower.closure.others):
            notes.append(
                "redundant equations, of which the proofs know nothing and which were checked at "
                f"every step in numbers: {len(follower.closure.others)}"
            )
        return tuple(notes)


def _merged(events: list[Event]) -> list[Event]:
    """Events at one place as one: type 1 and type 2 together are type 3."""
    found: list[Event] = []
    for event in events:
        last = found[-1] if found else None
        kinds = {event.kind, last.kind} if last else set()
        if last is None or event.s - last.s > TOGETHER:
            found.append(event)
        elif event.text == last.text:
            continue
        elif "type 2" in kinds and len(kinds) > 1:
            found[-1] = Event(last.s, "type 3", f"{last.text}; {event.text}", last.q)
        else:
            found.append(event)
    return found
