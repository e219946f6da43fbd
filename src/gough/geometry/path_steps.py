"""Steps along a path: from one closed configuration to the next, on the same solution.

What is proved of a step from s₀ to s₁. With the positions of the path known, the other equations
are square, quadratic and homogeneous, F(x; c(s)) = 0. One certificate with errors that cover c(s)
for every s of the step (`path_proofs`) gives a point z with two radii: in the chart of z, for every
s, one real solution lies within the radius of z, none other nearer than the reach, and F has full
rank there. By the implicit function theorem that solution is continuous in s; it meets no other, so
no singularity of F lies on the way, and its homogenising unknown does not vanish.

Steps join. At s₁ a certificate for the point alone gives a solution x* within ρ of y. If, scaled to
the chart of a step, it is nearer than the reach (`Ball.holds`), it is the one of that step at s₁:
of the step that arrives there, and of the one that leaves. So all steps follow one continuous
solution.

Where all legs have closed forms, what is under their roots is enclosed over the whole step. While
it is positive, and the values are finite, each formula is a continuous function of s, with the
sign of its branch for ever.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gough.assembly import Assembler
from gough.geometry.closing import Closing
from gough.geometry.inverse import InverseGeometry
from gough.geometry.path_proofs import Ball, Stretches
from gough.geometry.path_routes import Route
from gough.geometry.placing import Placing
from gough.geometry.quadratic_closure import QuadraticClosure
from gough.geometry.rates import Kinematics

Array = NDArray[np.float64]

CLOSED = 1e-8
"""Largest closure residual of a configuration that counts: sines, characteristic lengths."""
SAME = 1e-6
"""How far, scaled, a solution may be from the configuration it is refined from; a guess."""
STRAY = 0.1
"""How far an unproved solution may be from where it is expected, as a part of the step."""
LONGEST = 0.2
"""Longest unproved step of a configuration, rad or characteristic lengths; a guess."""


@dataclass(frozen=True, eq=False)
class State:
    """A closed configuration on a path."""

    s: float
    q: Array
    """(positions,)"""
    unknowns: Array
    """What the follower continues: homogeneous unknowns of about length 1, or q."""
    ball: Ball | None = None
    """Where the solution is proved to be."""


class Follower(ABC):
    """Follows one solution along a route.

    Attributes:
        certified: whether its steps are proofs.
        failed: why the last step that failed did, "" where it was too long to be proved.
    """

    certified: bool

    def __init__(self, route: Route, assembler: Assembler) -> None:
        self.route, self.assembler = route, assembler
        self.failed = ""

    @abstractmethod
    def start(self, q: Array) -> State | None:
        """The solution at s = 0 next to a configuration; None if there is none."""

    @abstractmethod
    def step(self, state: State, s: float) -> State | None:
        """The solution at s further on, on the same straight piece; None if that failed."""

    @abstractmethod
    def measure(self, state: State) -> float:
        """How far a solution is from where it meets another, 0 there: about linear in x."""

    @abstractmethod
    def expect(self, states: tuple[State, State], s: float) -> State | None:
        """An unproved solution where two states before, extrapolated to s, expect one."""

    def along(self, states: tuple[State, State], part: float) -> Array:
        """A configuration on the line through two states, 0 at the first and 1 at the second."""
        a, b = states
        return np.asarray(a.q + part * (b.q - a.q))


class QuadraticFollower(Follower):
    """Certified steps on the square quadratic system of a problem."""

    certified = True

    def __init__(self, route: Route, closure: QuadraticClosure, placing: Placing) -> None:
        super().__init__(route, closure.problem.assembler)
        self.closure, self.placing = closure, placing
        self.stretches = Stretches(closure)

    def start(self, q: Array) -> State | None:
        """The proved solution at s = 0 next to a configuration."""
        problem = self.closure.problem
        values = problem.measured(q, self.assembler.p)[problem.left]
        x = np.concatenate([[1.0], values]) / self.closure.size
        found = self._at(0.0, x, q)
        near = found is not None and np.abs(_affine(found.unknowns) - x).max() <= SAME
        return found if near else None

    def _at(self, s: float, candidate: Array, near: Array) -> State | None:
        """The solution at s that a candidate leads to, proved, with its configuration."""
        ball = self.stretches.at(self.route.box(s, s), candidate / np.linalg.norm(candidate))
        self.failed = ""
        if not ball.real:
            return None
        x, q = ball.centre, self.route.configuration(s)
        unknowns = (_affine(x) * self.closure.size)[None, 1:]
        placed = self.placing.configurations(q[None], unknowns, near)[0]
        if not self.assembler.gaps(placed) <= CLOSED:
            self.failed = "the other equations are not satisfied there: the loops do not close"
            return None
        return State(s, placed, x, ball)

    def step(self, state: State, s: float) -> State | None:
        """The solution at s, the same all along the way; see the top of this file."""
        route, span = self.route, (state.s, s)
        stretch = route.middle(*span), route.box(*span), route.change(*span)
        ball = self.stretches.along(*stretch, state.unknowns)
        self.failed = ""
        assert state.ball is not None
        if not ball.real or not ball.holds(state.ball):
            return None
        end = self._at(s, ball.centre, state.q)
        return end if end and end.ball and ball.holds(end.ball) else None

    def measure(self, state: State) -> float:
        """Least singular value of the equations, each of size 1, where x₀ is 1."""
        pattern, c, _ = self.closure.proof(self.route.configuration(state.s))
        J = pattern.jacobian(c, _affine(state.unknowns))[:, 1:]
        s = np.linalg.svd(J / np.linalg.norm(J, axis=1, keepdims=True), compute_uv=False)
        return float(s[-1])

    def expect(self, states: tuple[State, State], s: float) -> State | None:
        """As `Follower.expect`; that there is a solution is proved, that it is the same is not."""
        x = self._line(states, _part(states, s))
        found = self._at(s, x, states[1].q)
        return (
            found
            if found and _expected(_affine(found.unknowns), x, self._line(states, 1.0))
            else None
        )

    def _line(self, states: tuple[State, State], part: float) -> Array:
        a, b = (_affine(state.unknowns) for state in states)
        return np.asarray(a + part * (b - a))

    def along(self, states: tuple[State, State], part: float) -> Array:
        """As `Follower.along`, linear in the natural coordinates."""
        q, x = self.route.configuration(states[1].s), self._line(states, part)
        unknowns = (x * self.closure.size)[None, 1:]
        return np.asarray(self.placing.configurations(q[None], unknowns, states[1].q)[0])


class ClosedFormFollower(Follower):
    """Certified steps on the closed forms of all legs, for paths of outputs.

    Attributes:
        signs: the branch of each leg, (branches,).
    """

    certified = True

    def __init__(self, route: Route, inverse: InverseGeometry) -> None:
        super().__init__(route, inverse.assembler)
        self.inverse = inverse
        self.signs = np.zeros(0)

    def start(self, q: Array) -> State | None:
        """The branches of a configuration, and their solution at s = 0."""
        self.signs = self.inverse.signs(q).astype(float)
        return self._at(0.0, q)

    def _at(self, s: float, near: Array) -> State | None:
        x = self.route.coordinates.of(self.route.configuration(s))
        q, ending, reasons = self.inverse.in_closed_form(x[None], near[None], self.signs)
        self.failed = reasons[0]
        return State(s, q[0], q[0]) if ending[0] == 0 else None

    def step(self, state: State, s: float) -> State | None:
        """The solution at s on the same branches; see the top of this file."""
        low, high = self.route.box(state.s, s)
        pairs = [np.ascontiguousarray(np.array([low, high]).T).ravel()]
        pairs += [np.repeat(values, 2) for values in (self.assembler.p, self.signs)]
        bounds = self.inverse.kernel.intervals(*pairs)
        n = len(bounds) - 4 * len(self.signs)
        if not np.all(np.isfinite(bounds[:n])) or not np.all(bounds[n + 1 :: 4, 0] > 0):
            self.failed = ""
            return None
        return self._at(s, state.q)

    def margins(self, s: float) -> Array:
        """What is under the root of each branch at s, (branches, 3): it, and how much is too short
        and too long."""
        q = self.route.configuration(s)
        found = self.inverse.kernel(q, self.assembler.p, self.signs)
        return np.asarray(self.inverse.parted(found)[1][:, 1:])

    def measure(self, state: State) -> float:
        """The root of the smallest margin."""
        return float(np.sqrt(max(self.margins(state.s)[:, 0].min(initial=1.0), 0.0)))

    def expect(self, states: tuple[State, State], s: float) -> State | None:
        """As `Follower.expect`, on the same branches."""
        found = self._at(s, states[1].q)
        expected = self.along(states, _part(states, s))
        return found if found and _expected(found.q, expected, states[1].q) else None


class NewtonFollower(Follower):
    """Damped Newton steps on all loops, not proved, kept short and straight."""

    certified = False

    def __init__(self, route: Route, kinematics: Kinematics) -> None:
        super().__init__(route, kinematics.assembler)
        self.kinematics = kinematics
        self.closing = Closing(kinematics.models, kinematics.assembler, route.coordinates)

    def start(self, q: Array) -> State | None:
        """The solution at s = 0 that Newton steps lead to, if it is next to the configuration."""
        found = self._at(0.0, q)
        return found if found and self.assembler.distance(found.q, q) <= SAME else None

    def _at(self, s: float, near: Array) -> State | None:
        x = self.route.coordinates.of(self.route.configuration(s))
        found = self.closing.solve(near[None], x[None], threads=1)
        closed = self.assembler.gaps(found.x[0]) <= CLOSED and found.gap[0] <= CLOSED
        self.failed = ""
        return State(s, found.x[0], found.x[0]) if closed else None

    def step(self, state: State, s: float) -> State | None:
        """Two halves that leave in one direction, each short."""
        middle = self._at(0.5 * (state.s + s), state.q)
        end = None if middle is None else self._at(s, middle.q)
        if middle is None or end is None:
            return None
        first, second = (
            (b.q - a.q) / self.assembler.position_scale for a, b in ((state, middle), (middle, end))
        )
        length = np.abs(first).max(initial=0.0)
        bend = np.abs(second - first).max(initial=0.0)
        # changes below the tolerance of a closed loop have no direction
        return end if length <= LONGEST and bend <= STRAY * length + 1e-10 else None

    def measure(self, state: State) -> float:
        """Distance to a singularity of type 2 for paths of inputs, of type 1 for outputs."""
        role = self.route.coordinates.role
        kinematics = self.kinematics
        found = kinematics.type_2 if role == "actuated" else kinematics.type_1
        return float(found(state.q))

    def expect(self, states: tuple[State, State], s: float) -> State | None:
        """As `Follower.expect`, by Newton steps from where it is expected."""
        expected = self.along(states, _part(states, s))
        found = self._at(s, expected)
        return found if found and _expected(found.q, expected, states[1].q) else None


def _affine(x: Array) -> Array:
    """Unknowns where the homogenising one is 1."""
    return np.asarray(x / x[0])


def _part(states: tuple[State, State], s: float) -> float:
    """How far s is along two states, 0 at the first and 1 at the second."""
    a, b = states
    return (s - a.s) / (b.s - a.s)


def _expected(found: Array, expected: Array, before: Array) -> bool:
    """Whether a solution is where it is expected, seen from the one before."""
    return bool(
        np.abs(found - expected).max() <= STRAY * np.abs(expected - before).max(initial=0.0) + SAME
    )
