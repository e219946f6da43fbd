"""Rates and accelerations of the frames of a closing, by the screws on the ways to them.

A way is a chain of segments (vectors from joint to joint) and screws (unit rates of its variables).
Both are sums over few terms: axes that stay parallel at every closed configuration turn together,
so an axis whose turns cancel, as in a parallelogram, leaves no term behind.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import casadi
import numpy as np
from numpy.typing import NDArray

from gough import algebra as al
from gough.algebra import Scalar, Transform, Vector
from gough.symbolic.closure import Closure
from gough.topology import Edge

Array = NDArray[np.float64]
SX = casadi.SX

SAME = 1e-8
"""Unit vectors that differ by less at every sample are the same; a guess, far above rounding."""


@dataclass(frozen=True)
class Screw:
    """Unit rate of one variable, in axes of the body where the way begins."""

    variable: int
    linear: Vector
    angular: Vector
    carried: int
    """How many of the way's screws, the first ones, move the axes it is fixed in."""
    slopes: dict[int, tuple[Vector, Vector]]
    """How (linear, angular) change besides, for unit rates of variables of the same joint."""


@dataclass(frozen=True)
class Segment:
    """A vector on the way, in axes of the body where the way begins."""

    vector: Vector
    carried: int
    """How many of the way's screws, the first ones, turn it."""
    shifted: tuple[int, ...] = ()
    """Screws of the way that also shift its end, by their linear part."""


@dataclass(frozen=True)
class Terms:
    """Velocities linear in the kept rates w: the sum of (form · w) vector."""

    linear: list[tuple[Array, Vector]]
    angular: list[tuple[Array, Vector]]


@dataclass(frozen=True)
class State:
    """Velocity of a frame, and its acceleration where the kept rates do not change."""

    linear: Vector
    angular: Vector
    linear_bias: Vector
    angular_bias: Vector


@dataclass
class Way:
    """The way from a body to a frame across joints of the tree.

    Args:
        closure: the mechanism.
        path: edges of the tree to cross.
        end: the frame on the last body, T_body_frame.
    """

    closure: Closure
    path: Sequence[int]
    end: Transform
    screws: list[Screw] = field(init=False, default_factory=list)
    segments: list[Segment] = field(init=False, default_factory=list)
    rotation: al.Matrix = field(init=False, default=al.IDENTITY)

    def __post_init__(self) -> None:
        for index in self.path:
            self._cross(index)
        self._shift(self.end[1])
        self.rotation = al.matmul(self.rotation, self.end[0])

    @property
    def pose(self) -> Transform:
        """T of the frame in the body where the way begins."""
        return self.rotation, _sum(segment.vector for segment in self.segments)

    def _shift(self, vector: Vector) -> None:
        """A segment given in axes of the body reached so far."""
        if not is_zero(vector):
            turned = al.turn(self.rotation, vector)
            self.segments.append(Segment(turned, len(self.screws)))

    def _cross(self, index: int) -> None:
        edge = self.closure.structure.edges[index]
        at_parent = self.closure.frame(edge, edge.parent)
        R_child, p_child = self.closure.frame(edge, edge.child)
        self._shift(at_parent[1])
        self.rotation = al.matmul(self.rotation, at_parent[0])
        self._joint(index, edge)
        self.rotation = al.matmul(self.rotation, al.transpose(R_child))
        self._shift(al.scale(-1.0, p_child))

    def _joint(self, index: int, edge: Edge) -> None:
        """Across the joint itself; its numbers stand in axes of its frame a."""
        R, p = edge.type.placement(self.closure.position(index), self.closure.dimensions(edge))
        before, freedoms = len(self.screws), edge.type.freedoms
        beyond = al.matmul(self.rotation, al.transpose(R) if edge.reversed else R)
        axes, carried = (beyond, before + freedoms) if edge.reversed else (self.rotation, before)
        sign = -1.0 if edge.reversed else 1.0
        signed = al.transpose(tuple(al.scale(sign, x) for x in al.transpose(axes)))  # type: ignore[arg-type]
        self.screws += self._screws(index, edge, signed, carried)
        if not is_zero(p):
            own = tuple(range(before, before + freedoms))
            self.segments.append(Segment(al.turn(signed, p), carried, own))
        self.rotation = beyond

    def _screws(self, index: int, edge: Edge, axes: al.Matrix, carried: int) -> list[Screw]:
        closure = self.closure
        q, H = closure.position(index), edge.type.position_rates(closure.position(index))
        first = sum(edge.type.freedoms for edge in closure.structure.edges[:index])
        screws = []
        for k, twist in enumerate(edge.type.twists(q, closure.dimensions(edge))):
            slopes = {}
            for j in range(edge.type.freedoms):
                change = [_slope(part, q, [row[j] for row in H]) for part in twist]
                if not all(map(is_zero, change)):
                    slopes[first + j] = al.turn(axes, change[0]), al.turn(axes, change[1])
            linear, angular = (al.turn(axes, part) for part in twist)
            screws.append(Screw(first + k, linear, angular, carried, slopes))
        return screws


class Motion:
    """How the frame at the end of a way moves, in kept rates w with v = C w.

    Args:
        way: the way.
        C: (variables, kept), exact where it is whole.
        evaluate: numbers of vectors at closed samples, (samples, vectors, 3); None where these
            are too few to tell what never changes.
        length: a length that small distances are compared to, m.
    """

    def __init__(
        self,
        way: Way,
        C: Array,
        evaluate: Callable[[list[Vector]], Array] | None,
        length: float,
    ) -> None:
        self.way = way
        self.forms = [C[screw.variable] for screw in way.screws]
        evaluate = evaluate or _Unlike()
        axes = evaluate([screw.angular for screw in way.screws])
        vectors = evaluate([segment.vector for segment in way.segments]) / length
        self._classify(axes)
        self.turning = [self._turning(k) for k in range(len(way.screws) + 1)]
        self.bundles = self._bundles(axes, vectors)

    def _classify(self, axes: Array) -> None:
        """The first screw with an axis parallel to that of each screw, and on which side."""
        self.first: list[int] = []
        self.sign: list[float] = []
        for k in range(len(self.forms)):
            for j in (*dict.fromkeys(self.first), k):
                ahead = float(np.abs(axes[:, k] - axes[:, j]).max(initial=0.0))
                behind = float(np.abs(axes[:, k] + axes[:, j]).max(initial=0.0))
                if min(ahead, behind) < SAME:
                    break
            self.first.append(j)
            self.sign.append(1.0 if ahead <= behind else -1.0)

    def _turning(self, count: int) -> dict[int, Array]:
        """By axis, the form of the angular velocity that the first screws make."""
        forms: dict[int, Array] = {}
        for k in range(count):
            if not is_zero(self.way.screws[k].angular):
                form = self.sign[k] * self.forms[k]
                forms[self.first[k]] = forms.get(self.first[k], 0.0) + form
        return {g: form for g, form in forms.items() if np.abs(form).max(initial=0.0) > SAME}

    def _bundles(self, axes: Array, vectors: Array) -> list[_Bundle]:
        """Segments with common turns; turns about an axis they always lie along are left out."""
        bundles: dict[tuple[tuple[int, bytes], ...], _Bundle] = {}
        for j, segment in enumerate(self.way.segments):
            turns = {}
            for g, form in self.turning[segment.carried].items():
                across = np.cross(axes[:, g], vectors[:, j])
                if np.abs(across).max(initial=0.0) > SAME:
                    turns[g] = form
            key = tuple((g, form.tobytes()) for g, form in turns.items())
            bundles.setdefault(key, _Bundle(turns, [])).segments.append(j)
        return [bundle for bundle in bundles.values() if bundle.turns]

    def _arm(self, segments: Sequence[int]) -> Vector:
        return _sum(self.way.segments[j].vector for j in segments)

    def terms(self) -> Terms:
        """Linear velocity of the frame's origin, and angular velocity."""
        arms: dict[tuple[int, bytes], tuple[int, Array, list[int]]] = {}
        for bundle in self.bundles:
            for g, form in bundle.turns.items():
                arm = arms.setdefault((g, form.tobytes()), (g, form, []))
                arm[2].extend(bundle.segments)
        linear = [
            (form, al.cross(self._axis(g), self._arm(sorted(segments))))
            for g, form, segments in arms.values()
        ]
        linear += [(self.forms[k], self.way.screws[k].linear) for k in self._slides]
        return Terms(linear, [(form, self._axis(g)) for g, form in self.turning[-1].items()])

    @property
    def _slides(self) -> list[int]:
        """Screws with a linear part that the kept rates use."""
        screws = enumerate(self.way.screws)
        return [k for k, s in screws if not is_zero(s.linear) and self.forms[k].any()]

    def _axis(self, g: int) -> Vector:
        return self.way.screws[g].angular

    def state(self, w: Sequence[Scalar]) -> State:
        """Velocity for kept rates w, and the acceleration that is left where they are constant.

        For each bundle of segments S: Ṡ = ω × S + slides, S̈ = ω̇ × S + ω × Ṡ + the slides' own
        rates, and these are ω × slides again where the slides turn with the segments.
        """
        velocity = [self._slide(k, w) for k in self._slides]
        bias, own = [], set(self._slides)
        for bundle in self.bundles:
            S, spin = self._arm(bundle.segments), self._spin(bundle.turns, w)
            turned, moved = al.cross(spin, S), [al.ZERO]
            for k in self._shifts(bundle):
                twice = self._turns_like(k, bundle.turns)
                moved.append(al.scale(2.0 if twice else 1.0, self._slide(k, w)))
                own -= {k} if twice else set()
            turning = al.cross(self._spin_rate(bundle.turns, w), S)
            velocity.append(turned)
            bias += [turning, al.cross(spin, al.plus(turned, _sum(moved)))]
        for k in sorted(own):
            rate = self._carried_rate(self.way.screws[k], self.way.screws[k].linear, 0, w)
            bias.append(al.scale(combined(self.forms[k], w), rate))
        turns = self.turning[-1]
        return State(_sum(velocity), self._spin(turns, w), _sum(bias), self._spin_rate(turns, w))

    def _shifts(self, bundle: _Bundle) -> list[int]:
        """Screws that shift the segments of a bundle."""
        shifted = {k for j in bundle.segments for k in self.way.segments[j].shifted}
        return sorted(shifted & set(self._slides))

    def _turns_like(self, k: int, turns: dict[int, Array]) -> bool:
        """Whether the linear part of a screw is fixed in a body with these turns."""
        screw = self.way.screws[k]
        own = self.turning[screw.carried]
        same = own.keys() == turns.keys() and all(np.array_equal(own[g], turns[g]) for g in own)
        return same and not screw.slopes

    def _slide(self, k: int, w: Sequence[Scalar]) -> Vector:
        return al.scale(combined(self.forms[k], w), self.way.screws[k].linear)

    def _spin(self, turns: dict[int, Array], w: Sequence[Scalar]) -> Vector:
        """Angular velocity of some turns."""
        return _sum(al.scale(combined(form, w), self._axis(g)) for g, form in turns.items())

    def _spin_rate(self, turns: dict[int, Array], w: Sequence[Scalar]) -> Vector:
        """Angular acceleration of some turns, where their rates are constant."""
        return _sum(
            al.scale(
                combined(form, w), self._carried_rate(self.way.screws[g], self._axis(g), 1, w, g)
            )
            for g, form in turns.items()
        )

    def _carried_rate(
        self, screw: Screw, vector: Vector, part: int, w: Sequence[Scalar], skip: int = -1
    ) -> Vector:
        """Rate of a vector of a screw: its axes turn, and its own joint changes it."""
        turns = {g: form for g, form in self.turning[screw.carried].items() if g != skip}
        own = {s.variable: form for s, form in zip(self.way.screws, self.forms, strict=True)}
        slopes = [
            al.scale(combined(own[variable], w), slope[part])
            for variable, slope in screw.slopes.items()
        ]
        return al.plus(al.cross(self._spin(turns, w), vector), _sum(slopes))


@dataclass(frozen=True)
class _Bundle:
    """Segments that the same turns move: the form of each turn by its axis."""

    turns: dict[int, Array]
    segments: list[int]


def combined(form: Array, w: Sequence[Scalar]) -> Scalar:
    """form · w."""
    used = np.flatnonzero(form).tolist()
    return al.total([al.mul(float(form[k]), w[k]) for k in used])


def combined_sparse(form: Array, w: Mapping[int, Scalar]) -> Scalar:
    """form · w with some w absent, which are zero."""
    used = np.flatnonzero(form).tolist()
    return al.total([al.mul(float(form[k]), w[k]) for k in used if k in w])


def is_zero(vector: Vector) -> bool:
    """Whether a vector is zero for certain."""
    return all(al.is_number(component) and component == 0 for component in vector)


def known(value: Any) -> Scalar:
    """A constant expression as the number it is."""
    if isinstance(value, SX) and value.is_constant():
        return float(value)
    return value


def _slope(vector: Vector, q: Sequence[SX], rates: Sequence[Scalar]) -> Vector:
    """Derivative of a vector along position rates."""
    slopes = []
    for component in vector:
        terms = [
            al.mul(known(casadi.gradient(component, x)), rate)
            for x, rate in zip(q, rates, strict=True)
            if not al.is_number(component)
        ]
        slopes.append(known(al.total(terms)))
    return (slopes[0], slopes[1], slopes[2])


class _Unlike:
    """Made-up numbers, no two vectors alike, which tell nothing of the vectors."""

    def __init__(self) -> None:
        self._rng = np.random.default_rng(0)

    def __call__(self, vectors: list[Vector]) -> Array:
        return self._rng.normal(size=(1, len(vectors), 3))


def _sum(vectors: Any) -> Vector:
    result = al.ZERO
    for vector in vectors:
        result = al.plus(result, vector)
    return result
