"""Solutions in closed form of natural closure equations, one unknown or angle after another.

What is solved is recognised from the equations, whatever the joints are called:

- a x + b = 0, and a x² + b x + c = 0 for a slide: two branches;
- a x + b y + c = 0 on a circle x² + y² = r², for an angle or a vector in the plane: two branches;
- two such lines: their crossing;
- three equations linear in two angles: one without the second angle, then the two above.

A bar between two points, one of them moved by a slide or an arm, comes to one of these (the
intersection of a line with a sphere, of a circle with a sphere), so that legs like RUS, PUS, RRR,
PRR, P-R-Pa-R or the links of spherical wrists are solved. Each branch has a sign, 1 or -1.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import casadi

from gough import algebra as al
from gough.algebra import Scalar
from gough.symbolic.natural import NaturalClosure
from gough.symbolic.natural.parts import Condition
from gough.symbolic.polynomials import Polynomial, total


@dataclass(frozen=True)
class Branch:
    """A place where a solution splits in two."""

    source: str
    """The joint or body whose equation it is."""
    unknowns: tuple[int, ...]
    """The unknown, or the two coordinates, that it gives."""
    side: Scalar
    """Positive on the branch of sign 1, negative on the other, at a solution."""
    margin: Scalar
    """What is under the root: the branches exist where it is not negative, and meet at 0."""
    short: Scalar = None
    """How much the body is too short to reach, m, negative where it is not; None if no length."""
    long: Scalar = None
    """How much it is too long to fold up, m."""


class Branches:
    """Closed forms of the unknowns of a problem.

    Args:
        natural: the equations.
        measured: every unknown in a configuration, to tell branches apart.
        signs: a symbol for the sign of each branch, made as they come up.

    Attributes:
        values: the unknowns solved, in what is known and the signs.
        branches: where solutions split.
        left: the equations that are not solved; there are none where all is closed form.
        checks: equations that the values have to satisfy besides.
    """

    def __init__(
        self, natural: NaturalClosure, measured: Sequence[Scalar], signs: Iterator[Scalar]
    ) -> None:
        self.natural, self._measured, self._signs = natural, measured, signs
        self._used: list[Scalar] = []
        self.values: dict[int, Scalar] = {}
        self.branches: list[Branch] = []
        self.checks: list[Condition] = []
        self.left = list(natural.conditions)
        while self.left and self._step():
            self._settle()

    def _sign(self) -> Scalar:
        self._used.append(next(self._signs))
        return self._used[-1]

    def _settle(self) -> None:
        """Put what is solved into what is left."""
        values = {u: Polynomial.constant(x) for u, x in self.values.items()}
        rest = [
            Condition(c.polynomial.substituted(values), c.source, c.kind, c.length)
            for c in self.left
        ]
        self.checks += [c for c in rest if c.polynomial.degree == 0]
        self.left = [c for c in rest if c.polynomial.degree > 0]

    def _step(self) -> bool:
        """Solve for one more unknown or angle, the surest first."""
        on_circles = {u for circle in self._circles() for u in circle.polynomial.unknowns}
        for degree in (1, 2):
            for condition in self.left:
                p = condition.polynomial
                if len(p.unknowns) != 1 or p.degree != degree:
                    continue
                if degree == 1 and p.unknowns <= on_circles:
                    continue  # a line on a circle: there the length that misses is the line's own
                self._solve_alone(condition)
                return True
        for circle in self._circles():
            lines = [c for c in self.left if c is not circle and self._is_line(c, circle)]
            if lines and (second := self._crossing(lines)) is not None:
                self._solve_crossing(lines[0], second)
                return True
            if lines:
                self._solve_on_circle(circle, lines[0])
                return True
        for circle in self._circles():
            if (line := self._without_other_angle(circle)) is not None:
                self._solve_on_circle(circle, line)
                return True
        return False

    # one unknown

    def _solve_alone(self, condition: Condition) -> None:
        (u,) = condition.polynomial.unknowns
        a, b, c = (condition.polynomial.coefficient(*key) for key in ((u, u), (u,), ()))
        self.left.remove(condition)
        if condition.polynomial.degree == 1:
            self.values[u] = al.mul(-1.0, c) / b
            return
        sign = self._sign()
        margin = al.sub(al.mul(b, b), al.mul(4.0, al.mul(a, c)))
        root = al.sqrt(_not_negative(margin))
        self.values[u] = al.sub(al.mul(sign, root), b) / al.mul(2.0, a)
        at = self._measured[u]
        side = al.add(al.mul(al.mul(2.0, a), at), b)
        short = long = None
        if condition.length is not None:
            lowest = al.mul(-0.25, margin) / a
            short = _beyond(condition.length, lowest)
        self.branches.append(Branch(condition.source, (u,), side, margin, short, long))

    # circles

    def _circles(self) -> Iterator[Condition]:
        """Equations x² + y² = r² of two unknowns alone."""
        for c in self.left:
            p = c.polynomial
            if len(p.unknowns) == 2 and self.natural.keeps_shape(c):
                x, y = sorted(p.unknowns)
                if (
                    p.terms.keys() == {(x, x), (y, y), ()}
                    and _one(p.coefficient(x, x))
                    and _one(p.coefficient(y, y))
                ):
                    yield c

    @staticmethod
    def _is_line(condition: Condition, circle: Condition) -> bool:
        p = condition.polynomial
        return p.degree == 1 and p.unknowns <= circle.polynomial.unknowns

    def _solve_on_circle(self, circle: Condition, line: Condition) -> None:
        """The points of a line on a circle.

        The foot of the centre on the line is at -c (a, b) / (a² + b²), the points are away from it
        by √(r² (a² + b²) - c²) / (a² + b²) along (-b, a).
        """
        x, y = sorted(circle.polynomial.unknowns)
        square = al.mul(-1.0, circle.polynomial.coefficient())
        a, b, c = (line.polynomial.coefficient(*key) for key in ((x,), (y,), ()))
        size = al.add(al.mul(a, a), al.mul(b, b))
        margin = al.sub(al.mul(square, size), al.mul(c, c))
        sign = self._sign()
        root = al.mul(sign, al.sqrt(_not_negative(margin)))
        self.values[x] = al.mul(-1.0, al.add(al.mul(a, c), al.mul(b, root))) / size
        self.values[y] = al.sub(al.mul(a, root), al.mul(b, c)) / size
        self.left = [c for c in self.left if c is not circle and c is not line]
        side = al.sub(al.mul(a, self._measured[y]), al.mul(b, self._measured[x]))
        short = long = None
        if line.length is not None:
            swing = al.sqrt(al.mul(square, size))
            short = _beyond(line.length, al.sub(c, swing))
            long = al.mul(-1.0, _beyond(line.length, al.add(c, swing)))
        self.branches.append(Branch(line.source, (x, y), side, margin, short, long))

    def _without_other_angle(self, circle: Condition) -> Condition | None:
        """A line on a circle from three equations with one other angle, by Cramer's rule."""
        own = circle.polynomial.unknowns
        for other in self._circles():
            pair = sorted(other.polynomial.unknowns)
            three = [
                c
                for c in self.left
                if c.polynomial.degree == 1
                and c.polynomial.unknowns & own
                and c.polynomial.unknowns <= own | set(pair)
            ]
            if other is circle or len(three) != 3 or len({c.source for c in three}) > 1:
                continue
            u, v = (tuple(c.polynomial.coefficient(k) for c in three) for k in pair)
            normal = al.cross(u, v)
            terms = [c.polynomial.scaled(x) for c, x in zip(three, normal, strict=True)]
            kept = {
                key: value for key, value in total(terms).terms.items() if not set(key) & set(pair)
            }
            if kept.keys() - {()}:
                return Condition(Polynomial(kept), three[0].source, "joint")
        return None

    def _crossing(self, lines: list[Condition]) -> Condition | None:
        """A line that crosses the first at every probed state, on either branch of others."""
        for second in lines[1:]:
            x, y = sorted(lines[0].polynomial.unknowns | second.polynomial.unknowns)
            one, other = (
                [line.polynomial.coefficient(u) for u in (x, y)] for line in (lines[0], second)
            )
            if not any(self._parallel(one, other, sign) for sign in (1.0, -1.0)):
                return second
        return None

    def _parallel(self, a: list[Scalar], b: list[Scalar], sign: float) -> bool:
        """Whether two lines are parallel, with all branches so far of one sign."""
        one, other = ((self._on(x, sign), self._on(y, sign), 0.0) for x, y in (a, b))
        return self.natural.probing.parallel(one, other)

    def _on(self, x: Scalar, sign: float) -> Scalar:
        """A scalar with the signs of all branches given."""
        if al.is_number(x) or not self._used:
            return x
        return casadi.substitute(
            x, casadi.vertcat(*self._used), sign * casadi.SX.ones(len(self._used))
        )

    @staticmethod
    def _determinant(first: Condition, second: Condition) -> Scalar:
        x, y = sorted(first.polynomial.unknowns | second.polynomial.unknowns)
        (a, b), (c, d) = (
            [line.polynomial.coefficient(u) for u in (x, y)] for line in (first, second)
        )
        return al.sub(al.mul(a, d), al.mul(b, c))

    def _solve_crossing(self, first: Condition, second: Condition) -> None:
        x, y = sorted(first.polynomial.unknowns | second.polynomial.unknowns)
        (a, b, e), (c, d, f) = (
            [line.polynomial.coefficient(*key) for key in ((x,), (y,), ())]
            for line in (first, second)
        )
        det = self._determinant(first, second)
        self.values[x] = al.sub(al.mul(b, f), al.mul(d, e)) / det
        self.values[y] = al.sub(al.mul(c, e), al.mul(a, f)) / det
        self.left.remove(first)
        self.left.remove(second)


def _beyond(length: Scalar, change: Scalar) -> Scalar:
    """How much longer than its length a bar would be if its square changed so."""
    square = al.add(al.mul(length, length), change)
    return al.sub(al.sqrt(_not_negative(square)), length)


def _not_negative(x: Scalar) -> Scalar:
    return max(x, 0.0) if al.is_number(x) else x.fmax(0.0)


def _one(x: Scalar) -> bool:
    return al.is_number(x) and x == 1
