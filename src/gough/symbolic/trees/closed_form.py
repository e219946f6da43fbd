"""Positions of legs in closed form, as cosines, sines and lengths: no trigonometric call.

Where a loop closes at a point, the point is seen from every node of the leg, once along the leg and
once the other way round. Components that agree, or distances from the node, that depend on a single
unsolved motion give it:

- a d + b = 0, or the root of a quadratic equation, for a slide;
- two equations a c + b s = k for a turn, or one and c² + s² = 1.

Branches are those of the samples. What is solved is put in, and the search goes on.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
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
SX = casadi.SX

FITS = 1e-6
"""How near a root has to come to the samples to be theirs; a guess, branches are far apart."""
SEEN = 1e-10
"""Change of an equation below which it does not depend on a motion."""
DIVISION, ROOT = 6, 8
"""What a quotient and a root count in operations, where ways are compared."""


@dataclass(frozen=True)
class Equation:
    """left = right, or |left|² = |right|² where ``component`` is None, seen from one node."""

    left: Vector
    right: Vector
    component: int | None

    @property
    def residual(self) -> Scalar:
        """What vanishes."""
        if self.component is None:
            return al.sub(al.dot(self.left, self.left), al.dot(self.right, self.right))
        return al.sub(self.left[self.component], self.right[self.component])


@dataclass(frozen=True)
class Way:
    """A way to solve for one variable: its cost and its branches."""

    variable: int
    roots: tuple[Place, ...]
    cost: float
    sides: Vector | None = None
    """For a length that is the root of a sum of squares: their roots."""


@dataclass
class ClosedForm:
    """Closed forms of one mechanism.

    Args:
        tree: the mechanism.
        C: all rates v = C w, (variables, kept).
        kept: the variables of w.
        given: variables whose positions are known.

    Attributes:
        known: cosine and sine, or length, of each variable that is solved.
        left: variables that have no closed form here.
    """

    tree: Tree
    C: Array
    kept: tuple[int, ...]
    given: Sequence[int]
    known: dict[int, Place] = field(init=False, default_factory=dict)
    left: list[int] = field(init=False)

    def __post_init__(self) -> None:
        self._nodes = {node.variables[0]: node for node in self.tree.nodes if node.variables}
        self.left = [v for v in self.kept if v not in set(self.given)]
        self._symbols = {v: self._symbol(v) for v in self.left if self._single(v)}
        self._points = [tie for tie in ties(self.tree) if tie.word == "point"]
        self._sides: list[tuple[Scalar, Vector]] = []
        rng = np.random.default_rng(5)
        self._guesses = [self._guess(rng) for _ in range(3)]
        if all(v in self._symbols for v in self.left) and not self._balls():
            while self.left and self._step():
                pass

    def _single(self, variable: int) -> bool:
        return variable in self._nodes and self._nodes[variable].kind in ("turn", "slide")

    def _balls(self) -> bool:
        """Whether a rotation of the tree is neither given nor constant."""
        return any(
            node.kind == "ball" and not set(node.variables) <= set(self.given) and node.frame is node
            for node in self.tree.nodes
        )

    def _symbol(self, variable: int) -> Place:
        if self._nodes[variable].kind == "turn":
            return SX.sym(f"c{variable}"), SX.sym(f"s{variable}")
        return SX.sym(f"d{variable}")

    # equations

    def _step(self) -> bool:
        """Solve for one more variable; whether there was a way."""
        known = {**self._symbols, **self.known}
        frames = Frames(self.tree, JointPositions(self.tree, self.C, self.kept, known))
        equations = [e for e in self._equations(frames) if not al.is_number(e.residual)]
        asks = self._dependence([e.residual for e in equations])
        ways: list[Way] = []
        for n, variable in enumerate(self.left):
            own = [e for e, row in zip(equations, asks, strict=True) if row[n] and row.sum() == 1]
            ways += self._ways(variable, own)
        for way in sorted(ways, key=lambda way: way.cost):
            root = self._fitting(way)
            if root is None:
                continue
            self.known[way.variable] = root
            self.left.remove(way.variable)
            if way.sides is not None:
                self._sides.append((root, way.sides))
            return True
        return False

    def _equations(self, frames: Frames) -> Iterator[Equation]:
        """Components and distances of every closing point from every node of its loop."""
        for tie in self._points:
            for own, other in ((tie.a, tie.b), (tie.b, tie.a)):
                yield from self._seen(frames, tie, own, other)

    def _seen(self, frames: Frames, tie: Tie, own: End, other: End) -> Iterator[Equation]:
        """The closing point from the nodes between the common one and one end."""
        line = []
        for node in own.node.ancestors():
            line.append(node)
            if node is tie.common:
                break
        across = _lifted(frames, other.node, other.point, tie.common)
        for node in reversed(line):
            if node is not tie.common:
                assert node.parent is not None
                across = al.minus(across, frames.arm(node))
                across = frames.turn(across, node.parent.frame, node.frame)
            along = _lifted(frames, own.node, own.point, node)
            for component in (0, 1, 2, None):
                yield Equation(along, across, component)

    # what depends on what

    def _guess(self, rng: np.random.Generator) -> dict[int, float]:
        return {
            v: rng.uniform(-2, 2) if isinstance(place, tuple) else rng.uniform(0.3, 0.8)
            for v, place in self._symbols.items()
        }

    def _flat(self) -> list[SX]:
        return [x for place in self._symbols.values() for x in _parts(place)]

    def _numbers(self, guess: dict[int, float]) -> list[float]:
        found: list[float] = []
        for v, place in self._symbols.items():
            angle = isinstance(place, tuple)
            found += [np.cos(guess[v]), np.sin(guess[v])] if angle else [guess[v]]
        return found

    def _dependence(self, residuals: Sequence[Scalar]) -> NDArray[np.bool_]:
        """Which unsolved variables each residual depends on, tried at open configurations."""
        closure = self.tree.closure
        column = casadi.vertcat(*[SX(x) for x in residuals], SX(0, 1))
        function = casadi.Function(
            "residuals", [closure.q, closure.p, casadi.vertcat(*self._flat())], [column]
        )
        found = np.zeros((len(residuals), len(self.left)), dtype=bool)
        samples = zip(self.tree.samples.q, self.tree.samples.p, strict=True)
        for guess, (q, p) in zip(self._guesses, samples, strict=False):
            before = np.array(function(q, p, self._numbers(guess))).ravel()
            for n, v in enumerate(self.left):
                moved = self._numbers({**guess, v: guess[v] + 1.1})
                change = np.array(function(q, p, moved)).ravel() - before
                found[:, n] |= ~(np.abs(change) < SEEN)
        return found

    def _plain(self, x: Scalar, variable: int) -> SX:
        """An expression with the unsolved variables that it does not depend on left out."""
        symbols, values = [SX.sym("none")], [SX(0.0)]
        for v in self.left:
            if v != variable:
                parts = _parts(self._symbols[v])
                symbols += parts
                values += [SX(1.0), SX(0.0)][: len(parts)]
        return casadi.substitute(SX(x), casadi.vertcat(*symbols), casadi.vertcat(*values))

    # ways

    def _ways(self, variable: int, equations: Sequence[Equation]) -> Iterator[Way]:
        place = self._symbols[variable]
        if isinstance(place, tuple):
            lines = [line for e in equations for line in self._line(variable, e)]
            yield from self._turns(variable, lines)
            return
        for e in equations:
            yield from self._slides(variable, e)

    def _slides(self, variable: int, e: Equation) -> Iterator[Way]:
        d = self._symbols[variable]
        if e.component is not None:
            x = self._plain(e.residual, variable)
            a, b = casadi.jacobian(x, d), casadi.substitute(x, d, 0.0)
            if not casadi.depends_on(a, d):
                yield Way(variable, (-b / a,), 1 + self._count([a, b]))
            return
        for one, other in ((e.left, e.right), (e.right, e.left)):
            moving, fixed = (self._vector(v, variable) for v in (one, other))
            if casadi.depends_on(fixed, d):
                continue
            along, at = casadi.jacobian(moving, d), casadi.substitute(moving, d, 0.0)
            if casadi.depends_on(along, d):
                continue
            yield self._distance(variable, along, at, fixed)

    def _distance(self, variable: int, along: SX, at: SX, fixed: SX) -> Way:
        """|at + d along|² = |fixed|²."""
        a, b = casadi.dot(along, along), casadi.dot(at, along)
        k = casadi.dot(at, at) - casadi.dot(fixed, fixed)
        if b.is_zero():
            root = casadi.sqrt(-k / a)
            plain = a.is_one() and casadi.dot(at, at).is_zero()
            sides = (fixed[0], fixed[1], fixed[2]) if plain else None
            return Way(variable, (root, -root), 2 + self._count([k]), sides)
        root = casadi.sqrt(b * b - a * k)
        return Way(variable, ((root - b) / a, (-root - b) / a), 3 + self._count([k, b]))

    def _vector(self, v: Vector, variable: int) -> SX:
        return self._plain(casadi.vertcat(*[SX(x) for x in v]), variable)

    def _line(self, variable: int, e: Equation) -> Iterator[tuple[SX, SX, SX]]:
        """(a, b, k) with a c + b s = k, if the equation is one."""
        both = casadi.vertcat(*_parts(self._symbols[variable]))
        if e.component is not None:
            x = self._plain(e.residual, variable)
            slope = casadi.jacobian(x, both)
            if not casadi.depends_on(slope, both):
                yield slope[0], slope[1], -casadi.substitute(x, both, casadi.SX.zeros(2))
            return
        for one, other in ((e.left, e.right), (e.right, e.left)):
            moving, fixed = (self._vector(v, variable) for v in (one, other))
            slope = casadi.jacobian(moving, both)
            if casadi.depends_on(fixed, both) or casadi.depends_on(slope, both):
                continue
            at, x, y = casadi.substitute(moving, both, casadi.SX.zeros(2)), slope[:, 0], slope[:, 1]
            # |x| = |y| and x·y = 0, since a turn carries a circle
            rest = casadi.dot(fixed, fixed) - casadi.dot(at, at) - casadi.dot(x, x)
            yield 2 * casadi.dot(at, x), 2 * casadi.dot(at, y), rest
            return

    def _turns(self, variable: int, lines: Sequence[tuple[SX, SX, SX]]) -> Iterator[Way]:
        for n, line in enumerate(lines):
            for other in lines[:n]:
                crossing = _crossing(line, other)
                if crossing is not None and self._on_circle(crossing):
                    yield Way(variable, (crossing,), 0.5 + self._count(crossing))
            roots = self._on_line(line)
            yield Way(variable, roots, 4 + self._count(roots[0]))

    def _on_line(self, line: tuple[SX, SX, SX]) -> tuple[Place, Place]:
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
        """√(1 - s²) with s = k / b; from the other sides where b is a length that k is a side of."""
        for root, sides in self._sides:
            if _same(b, root):
                for n, side in enumerate(sides):
                    if _same(side, k):
                        rest = [x for i, x in enumerate(sides) if i != n]
                        return casadi.sqrt(al.dot(rest, rest)) / b
        return casadi.sqrt(1 - s * s)

    # choosing

    def _on_circle(self, crossing: tuple[SX, SX]) -> bool:
        values = self._at_samples(crossing)
        finite = np.isfinite(values).all()
        return bool(finite and np.abs((values**2).sum(axis=1) - 1).max() < 1e-8)

    def _at_samples(self, place: Place) -> Array:
        """Values of a place over the samples, (samples, 1 or 2)."""
        closure, samples = self.tree.closure, self.tree.samples
        column = casadi.densify(casadi.vertcat(*_parts(place)))
        function = casadi.Function("place", [closure.q, closure.p], [column])
        pairs = zip(samples.q, samples.p, strict=True)
        return np.array([np.array(function(q, p)).ravel() for q, p in pairs])

    def _fitting(self, way: Way) -> Place | None:
        """The root on which all samples are."""
        q = self.tree.samples.q[:, self._nodes[way.variable].place.start]
        for root in way.roots:
            truth = np.stack([np.cos(q), np.sin(q)], 1) if isinstance(root, tuple) else q[:, None]
            found = self._at_samples(root)
            if np.isfinite(found).all() and np.abs(found - truth).max() < FITS:
                return root
        return None

    def _count(self, values: Sequence[SX]) -> float:
        """What values cost beyond what is known already, in hundredths."""
        have = [x for place in self.known.values() for x in _parts(place)]
        return 0.01 * (_operations([*have, *values]) - _operations(have))


def _lifted(frames: Frames, node: Node, p: Vector, top: Node) -> Vector:
    """A point of a node seen from one of its ancestors, in class axes."""
    while node is not top:
        assert node.parent is not None
        p = al.plus(frames.arm(node), frames.turn(p, node.frame, node.parent.frame))
        node = node.parent
    return p


def _parts(place: Place) -> list[SX]:
    return [SX(x) for x in place] if isinstance(place, tuple) else [SX(place)]


def _crossing(one: tuple[SX, SX, SX], two: tuple[SX, SX, SX]) -> tuple[SX, SX] | None:
    (a, b, k), (c, d, m) = one, two
    if b.is_zero() and c.is_zero():
        return k / a, m / d
    if a.is_zero() and d.is_zero():
        return m / c, k / b
    determinant = a * d - c * b
    if determinant.is_zero():
        return None
    return (k * d - m * b) / determinant, (a * m - c * k) / determinant


def _same(a: SX, b: SX) -> bool:
    """Whether two expressions are the same, or opposed."""
    return any(casadi.is_equal(x, y, 6) for x, y in ((a, b), (-a, b), (a, -b)))


def _operations(values: Sequence[SX]) -> float:
    column = casadi.cse(casadi.vertcat(*values, SX(0, 1)))
    function = casadi.Function("count", casadi.symvar(column), [column])
    weights = {casadi.OP_DIV: DIVISION, casadi.OP_SQRT: ROOT}
    free = {casadi.OP_INPUT, casadi.OP_OUTPUT, casadi.OP_CONST}
    codes = [function.instruction_id(k) for k in range(function.n_instructions())]
    return float(sum(weights.get(code, 1) for code in codes if code not in free))
