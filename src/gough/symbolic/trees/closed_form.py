"""Positions of legs in closed form, as cosines, sines and lengths: no trigonometric call.

Where a loop closes at a point, the point is seen from every node of the leg, once along the leg and
once the other way round. Components that agree, or distances from the node, that depend on a single
unsolved motion give it:

- a d + b = 0, or the root of a quadratic equation, for a slide;
- two equations a c + b s = k for a turn, or one and c² + s² = 1.

Branches are those of the samples. What is solved is put in, and the search goes on; loops that
share no unsolved variable are solved one after the other.
"""

from __future__ import annotations

import functools
import operator
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field

import casadi
import numpy as np
from numpy.typing import NDArray

from gough import algebra as al
from gough.algebra import Scalar, Vector
from gough.symbolic.trees.frames import Frames
from gough.symbolic.trees.nodes import End, Node, Tree
from gough.symbolic.trees.positions import JointPositions, Place
from gough.symbolic.trees.ties import Tie, ties

Array = NDArray[np.float64]
Fits = NDArray[np.bool_]
SX = casadi.SX
Line = tuple[SX, SX, SX]
"""(a, b, k) of a c + b s = k."""
Term = tuple[Node, Vector]
"""A vector and the class in whose axes it is."""

EQUAL = 1e-12
"""Relative difference of values of one function that is written in two ways."""
FITS = 1e-6
"""How near a root has to come to the samples to be theirs; a guess, branches are far apart."""
SEEN = 1e-10
"""Change of an equation below which it does not depend on a motion."""
ROUND = 1e-8
"""How near c² + s² has to come to 1 at samples where two equations give them."""
GUESSES = 3
"""Open configurations at which dependence is tried."""
ENOUGH = 4
"""Samples that have to be in one working mode to tell its branches; a guess."""
WEIGHTS = {casadi.OP_DIV: 6.0, casadi.OP_SQRT: 8.0}
"""What a quotient and a root count in operations, where ways are compared."""
LEAVES = (casadi.OP_CONST, casadi.OP_INPUT)
"""What is no operation."""


@dataclass(frozen=True)
class Equation:
    """left = right, or |left|² = |right|² where ``component`` is None, seen from one node."""

    left: Vector
    right: Vector
    component: int | None

    @property
    def parts(self) -> tuple[Scalar, ...]:
        """The residual of a component; both vectors, one after the other, of a distance."""
        return (*self.left, *self.right) if self.component is None else (self.residual,)

    @property
    def residual(self) -> Scalar:
        """What vanishes."""
        if self.component is None:
            return al.sub(al.dot(self.left, self.left), al.dot(self.right, self.right))
        return al.sub(self.left[self.component], self.right[self.component])


@dataclass(frozen=True)
class Way:
    """A way to solve for one variable, with its branches."""

    variable: int
    roots: tuple[Place, ...]
    effort: float
    """What it costs however many operations it takes; a guess."""
    counted: tuple[SX, ...]
    """What is counted in operations beside that."""
    divisor: SX
    """What the branches are divided by; must not change sign, since it is zero in between."""
    sides: Vector | None = None
    """For a length that is the root of a sum of squares: their roots."""


@dataclass(frozen=True)
class Rated:
    """A way with its cost, and the samples that are on each of its branches."""

    way: Way
    cost: float
    fits: Fits
    """(roots, samples)."""


@dataclass(frozen=True)
class Loop:
    """One closing point: what it says of the unsolved variables of its loop."""

    tie: Tie
    variables: frozenset[int]
    """Those that its equations depend on."""
    own: dict[int, list[Equation]]
    """Equations that depend on one of them alone."""


@dataclass
class ClosedForm:
    """Closed forms of one mechanism, each on one branch: in one working mode.

    Args:
        tree: the mechanism.
        C: all rates v = C w, (variables, kept).
        kept: the variables of w.
        given: variables whose positions are known.
        first_mode: whether samples may be in other working modes than the first of them, on which
            the branches are then; else a variable whose branches differ is left.

    Attributes:
        known: cosine and sine, or length, of each variable that is solved.
        left: variables that have no closed form here.
        in_mode: the samples for which the closed forms hold, (samples,).
    """

    tree: Tree
    C: Array
    kept: tuple[int, ...]
    given: Sequence[int]
    first_mode: bool = False
    known: dict[int, Place] = field(init=False, default_factory=dict)
    left: list[int] = field(init=False)
    in_mode: Fits = field(init=False)

    def __post_init__(self) -> None:
        self._nodes = {node.variables[0]: node for node in self.tree.nodes if node.variables}
        self.left = [v for v in self.kept if v not in set(self.given)]
        self.in_mode = np.ones(len(self.tree.samples.q), dtype=bool)
        if not all(map(self._single, self.left)) or self._balls():
            return
        self._open = [*self.left, *self._others()]
        self._symbols = {v: self._symbol(v) for v in self._open}
        self._flat = casadi.vertcat(*[x for p in self._symbols.values() for x in _parts(p)])
        self._sides: list[tuple[Scalar, Vector]] = []
        self._guesses = self._guess(np.random.default_rng(5))
        self._frames = self._placed()
        loops = [self._loop(tie) for tie in ties(self.tree) if tie.word == "point"]
        for group in _hanging_together(loops):
            self._solve(group)
        self.left = [v for v in self.left if v not in self.known]

    def _single(self, variable: int) -> bool:
        return variable in self._nodes and self._nodes[variable].kind in ("turn", "slide")

    def _balls(self) -> bool:
        """Whether a rotation of the tree is neither given nor constant."""
        given = set(self.given)
        return any(
            not {self.kept[k] for v in node.variables for k in np.flatnonzero(self.C[v])} <= given
            for node in self.tree.nodes
            if node.kind == "ball" and node.frame is node
        )

    def _symbol(self, variable: int) -> Place:
        if self._nodes[variable].kind == "turn":
            return SX.sym(f"c{variable}"), SX.sym(f"s{variable}")
        return SX.sym(f"d{variable}")

    def _others(self) -> list[int]:
        """Turns that are not kept, and no sums of those that are."""
        positions = JointPositions(self.tree, self.C, self.kept)
        return [
            v
            for v, node in self._nodes.items()
            if node.kind == "turn" and node.frame is node and v not in self.kept
            if positions.sum_of(v) is None
        ]

    def _placed(self) -> Frames:
        known = {**self._symbols, **self.known}
        return Frames(self.tree, JointPositions(self.tree, self.C, self.kept, known))

    # loops

    def _solve(self, loops: list[Loop]) -> None:
        """Solve for the variables of loops that share some, one after the other."""
        ways: dict[int, list[Rated]] = {}
        fresh = frozenset[int]().union(*(loop.variables for loop in loops))
        while True:
            ways |= {v: self._rated_ways(v, loops) for v in fresh}
            found = self._chosen([rated for each in ways.values() for rated in each])
            if found is None:
                return
            way, root = found
            self._learn(way, root)
            del ways[way.variable]
            near = [loop for loop in loops if way.variable in loop.variables]
            fresh = frozenset[int]().union(*(loop.variables for loop in near)) - {way.variable}
            loops = [self._loop(loop.tie) if loop in near else loop for loop in loops]

    def _learn(self, way: Way, root: Place) -> None:
        self.known[way.variable] = root
        self._open.remove(way.variable)
        if way.sides is not None:
            self._sides.append((root, way.sides))
        self._frames = self._placed()

    def _chosen(self, ways: Sequence[Rated]) -> tuple[Way, Place] | None:
        """The cheapest way with the branch of the samples, or else of the first of them."""
        ways = sorted(ways, key=lambda rated: rated.cost)
        for rated in ways:
            for root, fits in zip(rated.way.roots, rated.fits, strict=True):
                if fits[self.in_mode].all():
                    return rated.way, root
        for rated in ways if self.first_mode else ():
            for root, fits in zip(rated.way.roots, rated.fits, strict=True):
                on_some = rated.fits[:, self.in_mode].any(axis=0)
                if fits[0] and on_some.all() and (self.in_mode & fits).sum() >= ENOUGH:
                    self.in_mode = self.in_mode & fits
                    return rated.way, root
        return None

    def _loop(self, tie: Tie) -> Loop:
        """A loop in what is known by now."""
        equations = [e for e in self._equations(tie) if not al.is_number(e.residual)]
        asks = self._dependence([e.residual for e in equations])
        own: dict[int, list[Equation]] = {}
        for e, row in zip(equations, asks, strict=True):
            if row.sum() == 1:
                own.setdefault(self._open[int(row.argmax())], []).append(e)
        variables = frozenset(self._open[n] for n in np.flatnonzero(asks.any(axis=0)))
        return Loop(tie, variables, own)

    def _equations(self, tie: Tie) -> Iterator[Equation]:
        """Components and distances of a closing point from every node of its loop."""
        for own, other in ((tie.a, tie.b), (tie.b, tie.a)):
            yield from self._seen(tie, own, other)

    def _seen(self, tie: Tie, own: End, other: End) -> Iterator[Equation]:
        """The closing point from the nodes between the common one and one end."""
        frames, line = self._frames, _line_up(own.node, tie.common)
        terms = _terms(frames, other, tie.common)
        across = _gathered(frames, terms, tie.common.frame)
        for k, node in reversed(list(enumerate(line))):
            if node is not tie.common:
                across = self._carried(node, line[k + 1 :], across, terms)
            along = _gathered(frames, _terms(frames, own, node), node.frame)
            for component in (0, 1, 2, None):
                yield Equation(along, across, component)

    def _carried(
        self, node: Node, line: Sequence[Node], across: Vector, terms: list[Term]
    ) -> Vector:
        """The way round seen from the next node: anew where its class was left before."""
        frames, above = self._frames, line[0].frame
        terms.append((above, al.scale(-1.0, frames.arm(node))))
        if node.frame is not above and node.frame in [n.frame for n in line]:
            return _gathered(frames, terms, node.frame)
        return frames.turn(al.minus(across, frames.arm(node)), above, node.frame)

    # what depends on what

    def _guess(self, rng: np.random.Generator) -> Array:
        """Values of unsolved variables at open configurations, (guesses, variables)."""
        turns = [isinstance(place, tuple) for place in self._symbols.values()]
        lows, highs = np.where(turns, -2, 0.3), np.where(turns, 2, 0.8)
        return rng.uniform(lows, highs, (min(GUESSES, len(self.in_mode)), len(turns)))

    def _numbers(self, guesses: Array) -> Array:
        """Values of the symbols, (symbols, guesses)."""
        rows: list[Array] = []
        for place, x in zip(self._symbols.values(), guesses.T, strict=True):
            rows += [np.cos(x), np.sin(x)] if isinstance(place, tuple) else [x]
        return np.array(rows)

    def _dependence(self, residuals: Sequence[Scalar]) -> Fits:
        """Which unsolved variables each residual depends on, tried at open configurations."""
        closure, samples = self.tree.closure, self.tree.samples
        column = casadi.densify(casadi.vertcat(*[SX(x) for x in residuals], SX(0, 1)))
        function = casadi.Function("residuals", [closure.q, closure.p, self._flat], [column])
        order = [list(self._symbols).index(v) for v in self._open]
        found = np.zeros((len(residuals), len(order)), dtype=bool)
        for guess, q, p in zip(self._guesses, samples.q, samples.p, strict=False):
            tries = np.repeat(guess[None], len(order) + 1, axis=0)
            tries[range(len(order)), order] += 1.1
            at = (np.repeat(x[:, None], len(tries), axis=1) for x in (q, p))
            values = _mapped(function, *at, self._numbers(tries))
            found |= ~np.isclose(values[:, :-1], values[:, -1:], 0, SEEN)
        return found

    def _plain(self, column: SX, variable: int) -> SX:
        """Expressions with the unsolved variables that they do not depend on left out."""
        others = [self._symbols[v] for v in self._open if v != variable]
        symbols = casadi.vertcat(*[x for place in others for x in _parts(place)], SX(0, 1))
        values = [
            x for place in others for x in ((1.0, 0.0) if isinstance(place, tuple) else (1.0,))
        ]
        return casadi.substitute(column, symbols, casadi.DM(values))

    # ways

    def _rated_ways(self, variable: int, loops: Sequence[Loop]) -> list[Rated]:
        own = [e for loop in loops for e in loop.own.get(variable, ())]
        return self._rated(list(self._ways(variable, own))) if own else []

    def _ways(self, variable: int, equations: Sequence[Equation]) -> Iterator[Way]:
        place = self._symbols[variable]
        column = casadi.vertcat(*[SX(x) for e in equations for x in e.parts])
        form = Form(self._plain(column, variable), casadi.vertcat(*_parts(place)))
        first, sides = 0, []
        for e in equations:
            sides.append([form.rows(first, first + 1)])
            if e.component is None:
                sides[-1] = [form.rows(first, first + 3), form.rows(first + 3, first + 6)]
            first += len(e.parts)
        if isinstance(place, tuple):
            yield from self._turns(variable, [x for each in sides for x in _line(each)])
        else:
            yield from (way for each in sides for way in _slide(variable, each))

    def _turns(self, variable: int, lines: Sequence[Line]) -> Iterator[Way]:
        lines = self._different(lines)
        for n, line in enumerate(lines):
            for other in lines[:n]:
                if (crossing := _crossing(line, other)) is not None:
                    point, determinant = crossing
                    yield Way(variable, (point,), 0.5, point, determinant)
            roots, (a, b, _) = self._on_line(line), line
            divisor = b if a.is_zero() else a if b.is_zero() else SX(1)
            yield Way(variable, roots, 4, roots[0], divisor)

    def _different(self, lines: Sequence[Line]) -> list[Line]:
        """The cheapest of lines that are the same."""
        values = self._at_samples([x for line in lines for x in line])
        values = values.reshape(len(lines), 3 * values.shape[1])
        costs = self._costs(lines)
        found: list[int] = []
        for n in sorted(range(len(lines)), key=lambda n: costs[n]):
            if not any(np.allclose(values[n], values[k], 0, SEEN) for k in found):
                found.append(n)
        return [lines[n] for n in sorted(found)]

    def _on_line(self, line: Line) -> tuple[Place, Place]:
        """The points of a line on the unit circle."""
        a, b, k = line
        if a.is_zero():
            s = k / b
            c = self._other_side(b, k, s)
            return (c, s), (-c, s)
        if b.is_zero():
            c = k / a
            s = self._other_side(a, k, c)
            return (c, s), (c, -s)
        square = a * a + b * b
        if k.is_zero():
            size = 1 / casadi.sqrt(square)
            return (b * size, -a * size), (-b * size, a * size)
        root, inverse = casadi.sqrt(square - k * k), 1 / square
        ends = ((a * k - b * root) * inverse, (b * k + a * root) * inverse)
        return ends, ((a * k + b * root) * inverse, (b * k - a * root) * inverse)

    def _other_side(self, b: SX, k: SX, s: SX) -> SX:
        """√(1 - s²) with s = k / b; from the other sides where k is one of a length b."""
        for root, sides in self._sides:
            if _same(b, root):
                for n, side in enumerate(sides):
                    if _same(side, k):
                        rest = [x for i, x in enumerate(sides) if i != n]
                        return casadi.sqrt(al.dot(rest, rest)) / b
        return casadi.sqrt(1 - s * s)

    # choosing

    def _rated(self, ways: Sequence[Way]) -> list[Rated]:
        """Ways with a branch on which samples are, and what they cost."""
        fits = self._fits(ways)
        asked = slice(0, 1) if self.first_mode else self.in_mode
        pairs = [(w, f) for w, f in zip(ways, fits, strict=True) if f[:, asked].all(axis=1).any()]
        costs = self._costs([way.counted for way, _ in pairs])
        return [Rated(w, w.effort + 0.01 * c, f) for (w, f), c in zip(pairs, costs, strict=True)]

    def _costs(self, values: Sequence[Sequence[SX]]) -> list[float]:
        """Operations that values take beyond what is known already."""
        return _costs([x for place in self.known.values() for x in _parts(place)], values)

    def _fits(self, ways: Sequence[Way]) -> list[Fits]:
        """For each way, which samples are on which root, (roots, samples)."""
        scalars = [x for way in ways for root in way.roots for x in _parts(root)]
        values = self._at_samples([*(way.divisor for way in ways), *scalars])
        divisors, left = values[: len(ways)], iter(values[len(ways) :])
        steady: Fits = np.all(divisors > 0, axis=1) | np.all(divisors < 0, axis=1)
        fits = [np.array([self._on_root(way, root, left) for root in way.roots]) for way in ways]
        return [on if sure else np.zeros_like(on) for on, sure in zip(fits, steady, strict=True)]

    def _on_root(self, way: Way, root: Place, values: Iterator[Array]) -> Fits:
        q = self.tree.samples.q[:, self._nodes[way.variable].place.start]
        if not isinstance(root, tuple):
            return np.abs(next(values) - q) < FITS
        c, s = next(values), next(values)
        near = np.maximum(np.abs(c - np.cos(q)), np.abs(s - np.sin(q))) < FITS
        return near & (np.abs(c * c + s * s - 1) < ROUND)

    def _at_samples(self, scalars: Sequence[SX]) -> Array:
        """Scalars of (q, p), (scalars, samples)."""
        closure, samples = self.tree.closure, self.tree.samples
        column = casadi.densify(casadi.vertcat(*scalars, SX(0, 1)))
        function = casadi.Function("places", [closure.q, closure.p], [column])
        return _mapped(function, samples.q.T, samples.p.T)


class Form:
    """Expressions as sums x = at + slope · symbols, where they are.

    Args:
        column: the expressions.
        symbols: cosine and sine, or a length.
    """

    def __init__(self, column: SX, symbols: SX) -> None:
        self.slope = casadi.jacobian(column, symbols)
        self.at = casadi.substitute(column, symbols, SX.zeros(symbols.numel()))
        self.bent = casadi.which_depends(column, symbols, 2, True)

    def rows(self, first: int, end: int) -> Side:
        """Some of them."""
        return Side(self.at[first:end], self.slope[first:end, :], any(self.bent[first:end]))


@dataclass(frozen=True)
class Side:
    """One number or vector x = at + slope · symbols."""

    at: SX
    slope: SX
    bent: bool
    """Whether it is not of this form."""

    @property
    def moves(self) -> bool:
        """Whether it depends on the symbols."""
        return self.bent or self.slope.nnz() > 0


def _moving(sides: Sequence[Side]) -> tuple[Side, Side] | None:
    """The side of |left|² = |right|² that moves, and the one that does not."""
    left, right = sides
    for one, other in ((left, right), (right, left)):
        if not other.moves and not one.bent:
            return one, other
    return None


def _slide(variable: int, sides: Sequence[Side]) -> Iterator[Way]:
    """Ways to a length by one equation."""
    if len(sides) == 1:
        if not sides[0].bent:
            a, b = sides[0].slope, sides[0].at
            yield Way(variable, (-b / a,), 1, (a, b), a)
    elif (pair := _moving(sides)) is not None:
        yield _distance(variable, pair[0].slope, pair[0].at, pair[1].at)


def _distance(variable: int, along: SX, at: SX, fixed: SX) -> Way:
    """|at + d along|² = |fixed|²."""
    a, b = casadi.dot(along, along), casadi.dot(at, along)
    k = casadi.dot(at, at) - casadi.dot(fixed, fixed)
    if b.is_zero():
        root = casadi.sqrt(-k / a)
        plain = a.is_one() and casadi.dot(at, at).is_zero()
        sides = (fixed[0], fixed[1], fixed[2]) if plain else None
        return Way(variable, (root, -root), 2, (k,), a, sides)
    unit = [i for i in range(3) if along[i].is_one()]
    if len(unit) == 1 and a.is_one():  # along an axis: what lies across it does not change
        across = [at[i] for i in range(3) if i != unit[0]]
        k = casadi.dot(fixed, fixed) - casadi.sumsqr(casadi.vertcat(*across))
        root = casadi.sqrt(k)
    else:
        root = casadi.sqrt(b * b - a * k)
    return Way(variable, ((root - b) / a, (-root - b) / a), 3, (k, b), a)


def _line(sides: Sequence[Side]) -> Iterator[Line]:
    """(a, b, k) with a c + b s = k, if one equation says so."""
    if len(sides) == 1:
        if not sides[0].bent:
            yield _reduced(sides[0].slope[0]), _reduced(sides[0].slope[1]), -sides[0].at
    elif (pair := _moving(sides)) is not None:
        at, x, y, fixed = pair[0].at, pair[0].slope[:, 0], pair[0].slope[:, 1], pair[1].at
        # |x| = |y| and x·y = 0, since a turn carries a circle
        rest = casadi.dot(fixed, fixed) - casadi.dot(at, at) - casadi.dot(x, x)
        yield 2 * casadi.dot(at, x), 2 * casadi.dot(at, y), rest


def _line_up(node: Node, top: Node) -> list[Node]:
    """A node and its ancestors up to one of them."""
    line = [node]
    while line[-1] is not top:
        assert line[-1].parent is not None
        line.append(line[-1].parent)
    return line


def _terms(frames: Frames, end: End, top: Node) -> list[Term]:
    """Arms from a node to the point of an end, each with the class in whose axes it is."""
    arms = [
        (node.parent.frame, frames.arm(node))
        for node in _line_up(end.node, top)[:-1]
        if node.parent is not None
    ]
    return [(end.node.frame, end.point), *arms]


def _gathered(frames: Frames, terms: Sequence[Term], axes: Node) -> Vector:
    """The sum of vectors in axes of a class, those of one class added before they are turned."""
    sums: dict[Node, Vector] = {}
    for frame, x in terms:
        sums[frame] = al.plus(sums.get(frame, al.ZERO), x)
    line = _classes(frames, axes)
    while others := [frame for frame in sums if frame not in line]:
        frame = max(others, key=lambda frame: len(_classes(frames, frame)))
        above = frames.above(frame)
        x = frames.turn(sums.pop(frame), frame, above)
        sums[above] = al.plus(sums.get(above, al.ZERO), x)
    found, at = al.ZERO, line[-1]
    for frame in reversed(line):
        found = al.plus(frames.turn(found, at, frame), sums.get(frame, al.ZERO))
        at = frame
    return found


def _classes(frames: Frames, frame: Node) -> list[Node]:
    """A class and those that carry it, down to that of the root."""
    line = [frame]
    while line[-1].parent is not None:
        line.append(frames.above(line[-1]))
    return line


def _parts(place: Place) -> list[SX]:
    return [SX(x) for x in place] if isinstance(place, tuple) else [SX(place)]


def _crossing(one: Line, two: Line) -> tuple[tuple[SX, SX], SX] | None:
    """Where two lines cross, and their determinant."""
    (a, b, k), (c, d, m) = one, two
    if b.is_zero() and c.is_zero():
        return (k / a, m / d), a * d
    if a.is_zero() and d.is_zero():
        return (m / c, k / b), b * c
    determinant = a * d - c * b
    if determinant.is_zero():
        return None
    return ((k * d - m * b) / determinant, (a * m - c * k) / determinant), determinant


def _same(a: SX, b: SX) -> bool:
    """Whether two expressions are the same function, or opposed ones: at two random points."""
    symbols = casadi.symvar(casadi.vertcat(a, b))
    if not symbols:
        return bool(abs(float(a)) == abs(float(b)))
    function = casadi.Function("both", [casadi.vertcat(*symbols)], [a, b])
    rng = np.random.default_rng(8)
    for _ in range(2):
        x, y = (float(v) for v in function(rng.uniform(0.3, 1.3, len(symbols))))
        if not abs(abs(x) - abs(y)) <= EQUAL * max(abs(x), 1.0):
            return False
    return True


def _reduced(x: SX) -> SX:
    """(a / b) b as a."""
    if x.op() == casadi.OP_MUL:
        for quotient, factor in ((x.dep(0), x.dep(1)), (x.dep(1), x.dep(0))):
            if quotient.op() == casadi.OP_DIV and casadi.is_equal(quotient.dep(1), factor, 99):
                return quotient.dep(0)
    return x


def _hanging_together(loops: Sequence[Loop]) -> list[list[Loop]]:
    """Loops in groups, those that share an unsolved variable in one."""
    groups: list[list[Loop]] = []
    for loop in loops:
        near = [g for g in groups if any(loop.variables & other.variables for other in g)]
        groups = [g for g in groups if g not in near]
        groups.append([*(other for g in near for other in g), loop])
    return groups


def _mapped(function: casadi.Function, *columns: Array) -> Array:
    """A function at every column of its arguments, (values, columns)."""
    return np.array(function.map(columns[0].shape[1])(*columns))


def _costs(have: Sequence[SX], ways: Sequence[Sequence[SX]]) -> list[float]:
    """Operations of each way beyond those of what is at hand, like ones counted once."""
    if not ways:
        return []
    column = casadi.vertcat(*have, *(x for way in ways for x in way))
    values, kinds = _below(casadi.densify(column))
    known = _union(values[: len(have)])
    first, found = len(have), []
    for way in ways:
        more = _union(values[first : first + len(way)]) & ~known
        found.append(sum(weight * (more & kind).bit_count() for weight, kind in kinds.items()))
        first += len(way)
    return found


def _below(column: SX) -> tuple[list[int], dict[float, int]]:
    """Operations that each entry takes, and those of each weight, as bits: like ones are one."""
    function = casadi.Function("count", casadi.symvar(column), [column])
    number: dict[tuple[object, ...], int] = {}
    masks: list[int] = []
    kinds: dict[float, int] = {}
    work: dict[int, int] = {}
    found = [0] * column.numel()
    for k in range(function.n_instructions()):
        code, into = function.instruction_id(k), function.instruction_output(k)
        if code == casadi.OP_OUTPUT:
            found[into[1]] = masks[work[function.instruction_input(k)[0]]]
            continue
        slots: list[int] = function.instruction_input(k)
        operands = [] if code in LEAVES else [work[slot] for slot in slots]
        key: tuple[object, ...] = (code, *(operands or slots))
        if code == casadi.OP_CONST:
            key = code, function.instruction_constant(k)
        if key not in number:
            n, below = len(masks), _union([masks[n] for n in operands])
            number[key] = n
            if code not in LEAVES:
                weight = WEIGHTS.get(code, 1.0)
                kinds[weight] = kinds.get(weight, 0) | 1 << n
                below |= 1 << n
            masks.append(below)
        work[into[0]] = number[key]
    return found, kinds


def _union(masks: Iterable[int]) -> int:
    return functools.reduce(operator.or_, masks, 0)
