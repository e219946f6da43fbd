"""Intervals on a real tape: every value becomes a lower and an upper bound.

The result is an ordinary tape with twice the inputs and outputs, which every back end runs. No
rounding mode is switched: bounds are rounded to nearest, then moved outwards (Rump, Zimmermann,
Boldo and Melquiond 2009).

What is promised: for numbers inside the given intervals, every exact value and every value that the
real tape computes, fused or not, lies in the computed interval, as long as no comparison meets a
NaN. Nothing is promised of values that are NaN. A function is evaluated on the part of its interval
where it has values: √[-1, 4] is [0, 2], and an interval without any becomes one that is unbounded.
A bound that is NaN, at an input or on the way, means that nothing is known on that side; outputs
show it as -∞ or ∞. So do lower bounds that overflow, quotients by an interval with zero in it,
and products and powers of unbounded intervals.

Comparisons may be undecided; a selection then is the hull of both branches, except where it
selects the smaller or the larger of what was compared.
"""

from __future__ import annotations

import math
from typing import NamedTuple, NoReturn

from gough.errors import ConfigurationError
from gough.kernels import functions
from gough.kernels.builder import Builder
from gough.kernels.tape import Tape, evaluate
from gough.kernels.value import Value, floor, sqrt, where

ULP = 2.0**-52
TINY = 2.0**-1074
LARGEST = float.fromhex("0x1.fffffffffffffp+1023")
STEP = 2.0**-53 * (1 + 2.0**-52)
"""The distance to the next number as a fraction of a number, and a little more; see `_below`."""


class Interval(NamedTuple):
    """Bounds of a real number of a tape that is being written; NaN bounds nothing."""

    lo: Value
    hi: Value


class Truth(NamedTuple):
    """What is known of a truth value of a tape that is being written."""

    sure: Value
    possible: Value
    compared: tuple[Interval, Interval] | None = None
    """For a < b and a ≤ b: a and b."""


def interval_tape(tape: Tape) -> Tape:
    """The tape for intervals: lower and upper bound of input 0, of input 1 …; outputs likewise.

    Args:
        tape: real operations and functions, neither fused nor written out.

    Raises:
        ConfigurationError: the tape has an operation without a meaning here: those on bits, and
            fused ones.
    """
    builder = Builder(2 * tape.inputs)
    slots = [Value.input(builder, k) for k in range(2 * tape.inputs)]
    inputs = [Interval(lo, hi) for lo, hi in zip(slots[::2], slots[1::2], strict=True)]
    outputs: list[Interval] = evaluate(tape, _Intervals(builder), inputs)
    return builder.tape([bound.number for x in outputs for bound in _shown(x)])


def _shown(x: Interval) -> tuple[Value, Value]:
    """Bounds without NaN; a lower bound of ∞ has overflowed and tells nothing."""
    lo, hi = x
    return where(lo <= LARGEST, lo, -math.inf), where(hi >= -LARGEST, hi, math.inf)


class _Intervals:
    """The arithmetic of intervals and of truth values that may be undecided."""

    def __init__(self, builder: Builder) -> None:
        self.builder = builder

    def __getattr__(self, op: str) -> NoReturn:
        raise ConfigurationError(
            f"the operation {op!r} has no meaning for intervals; leave it out of the tape"
        )

    def constant(self, value: float) -> Interval:
        number = Value(self.builder, self.builder.constant(value))
        return Interval(number, number)

    def add(self, a: Interval, b: Interval) -> Interval:
        if a is b:
            return _scaled(a, 2.0)
        if _constant(a) == 0.0:
            return b
        return a if _constant(b) == 0.0 else _rounded(a.lo + b.lo, a.hi + b.hi)

    def sub(self, a: Interval, b: Interval) -> Interval:
        if a is b:
            return self.constant(0.0)
        return self.add(a, self.neg(b))

    def mul(self, a: Interval, b: Interval) -> Interval:
        """Bounds are the smallest and largest product of bounds.

        A NaN among them is ignored if it is 0 ∞, as that product counts as the zero that is there
        as well. Other ones must come through. A NaN in either lower bound does in the first
        product; any NaN or ∞ in an upper bound is in the last product, and goes into the step.
        """
        factor, other = (_constant(a), b) if _constant(b) is None else (_constant(b), a)
        if a is b:
            return _squared(a)
        if factor is not None:
            return _scaled(other, factor)
        first, last = a.lo * b.lo, a.hi * b.hi
        crossed, across = a.lo * b.hi, a.hi * b.lo
        lo = _least(_least(first, crossed), _least(last, across))
        hi = _greatest(_greatest(first, crossed), _greatest(last, across))
        return _rounded(lo, hi, last * 0.0 + TINY)

    def div(self, a: Interval, b: Interval) -> Interval:
        """Quotients of bounds; the step is ∞ if zero is in the divisor."""
        divisor, dividend = _constant(b), _constant(a)
        if divisor is not None:
            return _divided(a, divisor)
        if dividend is not None:
            ends = (b.hi, b.lo) if dividend > 0.0 else (b.lo, b.hi)
            nonzero = (b.lo > 0.0) | (b.hi < 0.0)
            return _rounded(dividend / ends[0], dividend / ends[1], where(nonzero, TINY, math.inf))
        negative = b.hi < 0.0
        lo, hi = where(negative, -a.hi, a.lo), where(negative, -a.lo, a.hi)
        near, far = where(negative, -b.hi, b.lo), where(negative, -b.lo, b.hi)
        least = lo / where(lo < 0.0, near, far)
        greatest = hi / where(hi < 0.0, far, near)
        return _rounded(least, greatest, where(near > 0.0, TINY, math.inf))

    # exact operations, and the square root

    def neg(self, a: Interval) -> Interval:
        return Interval(-a.hi, -a.lo)

    def abs(self, a: Interval) -> Interval:
        return Interval(*_sizes(a))

    def floor(self, a: Interval) -> Interval:
        return Interval(floor(a.lo), floor(a.hi))

    def sqrt(self, a: Interval) -> Interval:
        return _within(_rounded(sqrt(a.lo), sqrt(a.hi)), lowest=0.0)

    # truth values

    def flag(self, value: bool) -> Truth:
        known = Value(self.builder, self.builder.flag(value))
        return Truth(known, known)

    def less(self, a: Interval, b: Interval) -> Truth:
        return Truth(a.hi < b.lo, ~_at_most(b.hi, a.lo), (a, b))

    def less_equal(self, a: Interval, b: Interval) -> Truth:
        return Truth(_at_most(a.hi, b.lo), ~(b.hi < a.lo), (a, b))

    def equal(self, a: Interval, b: Interval) -> Truth:
        sure = _at_most(a.hi, b.lo) & _at_most(b.hi, a.lo)
        return Truth(sure, ~((a.hi < b.lo) | (b.hi < a.lo)))

    def not_(self, a: Truth) -> Truth:
        return Truth(~a.possible, ~a.sure)

    def and_(self, a: Truth, b: Truth) -> Truth:
        return Truth(a.sure & b.sure, a.possible & b.possible)

    def or_(self, a: Truth, b: Truth) -> Truth:
        return Truth(a.sure | b.sure, a.possible | b.possible)

    def select(self, condition: Truth, a: Interval, b: Interval) -> Interval:
        """Smaller, larger, either branch or their hull."""
        x, y = condition.compared or (None, None)
        if a is x and b is y:
            return Interval(_unless_unknown(_least(a.lo, b.lo), b.lo), _least(a.hi, b.hi))
        if a is y and b is x:
            return Interval(_greatest(a.lo, b.lo), _unless_unknown(_greatest(a.hi, b.hi), b.hi))
        sure, possible, _ = condition
        lo = _unless_unknown(_least(a.lo, b.lo), b.lo)
        hi = _unless_unknown(_greatest(a.hi, b.hi), b.hi)
        return Interval(
            where(sure, a.lo, where(possible, lo, b.lo)),
            where(sure, a.hi, where(possible, hi, b.hi)),
        )

    # functions that rise or fall

    def exp(self, a: Interval) -> Interval:
        return _within(_ends("exp", a), lowest=0.0)

    def expm1(self, a: Interval) -> Interval:
        return _within(_ends("expm1", a), lowest=-_limit("expm1", 1.0))

    def log(self, a: Interval) -> Interval:
        return _ends("log", a)

    def log1p(self, a: Interval) -> Interval:
        return _ends("log1p", a)

    def sinh(self, a: Interval) -> Interval:
        return _ends("sinh", a)

    def tanh(self, a: Interval) -> Interval:
        return _symmetric(_ends("tanh", a), _limit("tanh", 1.0))

    def erf(self, a: Interval) -> Interval:
        return _symmetric(_ends("erf", a), _limit("erf", 1.0))

    def atan(self, a: Interval) -> Interval:
        return _symmetric(_ends("atan", a), _limit("atan", math.pi / 2))

    def asin(self, a: Interval) -> Interval:
        inside = _symmetric(a, 1.0)
        return _symmetric(_ends("asin", inside), _limit("asin", math.pi / 2))

    def acos(self, a: Interval) -> Interval:
        inside = _symmetric(a, 1.0)
        falling = _ends("acos", Interval(inside.hi, inside.lo))
        return _within(falling, 0.0, _limit("acos", math.pi))

    # functions that do either

    def cosh(self, a: Interval) -> Interval:
        lowest = 1.0 - math.ceil(functions.BOUNDS["cosh"]) * ULP
        return _within(_ends("cosh", Interval(*_sizes(a))), lowest)

    def sin(self, a: Interval) -> Interval:
        return _wave("sin", a, 0.25)

    def cos(self, a: Interval) -> Interval:
        return _wave("cos", a, 0.0)

    def tan(self, a: Interval) -> Interval:
        """Rising between neighbouring poles; with a pole inside the step is ∞."""
        together = _same_period(a, 1 / math.pi, 0.5)
        return _ends("tan", a, where(together, _tiny("tan"), math.inf))

    def atan2(self, a: Interval, b: Interval) -> Interval:
        """Angles of a rectangle without a point of the cut are between those of two corners.

        Its sides are y = a.lo, a.hi and x = b.lo, b.hi. The least angle is on the right side if
        all is above the axis, else on the left; in that corner that is turned backwards.
        """
        above, below = a.lo > 0.0, a.hi < 0.0
        x, opposite = where(above, b.hi, b.lo), where(below, b.hi, b.lo)
        least = where(x >= 0.0, a.lo, a.hi).emit("atan2", x)
        greatest = where(opposite >= 0.0, a.hi, a.lo).emit("atan2", opposite)
        uncut = above | below | (b.lo > 0.0)
        step = where(uncut, _tiny("atan2"), math.inf)
        return _symmetric(_moved("atan2", least, greatest, step), _limit("atan2", math.pi))

    def pow(self, a: Interval, b: Interval) -> Interval:
        exponent = _constant(b)
        if exponent is not None and math.isfinite(exponent):
            return _power(a, b.lo, exponent)
        corners = [x.emit("pow", y) for x in a for y in b]
        lo, hi = corners[0], corners[0]
        for corner in corners[1:]:
            lo, hi = _least(lo, corner), _greatest(hi, corner)
        unknown = ((a.lo + a.hi) + (b.lo + b.hi)) * 0.0
        step = unknown + where(a.lo > 0.0, _tiny("pow"), math.inf)
        return _moved("pow", lo, hi, step)


def _constant(a: Interval) -> float | None:
    """The number that an interval is known to be, or None."""
    return a.lo.builder.constant_of(a.lo.number) if a.lo.number == a.hi.number else None


# Smaller and larger of two bounds. A NaN in the first one comes through, one in the second one
# does not, unless it is added.


def _least(a: Value, b: Value | float) -> Value:
    return where(a > b, b, a)


def _greatest(a: Value, b: Value | float) -> Value:
    return where(a < b, b, a)


def _unless_unknown(bound: Value, other: Value) -> Value:
    """The bound, or NaN if the other one is infinite or NaN."""
    known = other.builder.constant_of(other.number)
    if known is not None and math.isfinite(known):
        return bound
    return other * 0.0 + bound


def _at_most(a: Value, b: Value) -> Value:
    """Whether a ≤ b holds for all that two bounds stand for: not for equal infinities."""
    return a - b <= 0.0


def _sizes(a: Interval) -> tuple[Value, Value]:
    """The least and the greatest |x|."""
    minus_lo, minus_hi = -a.lo, -a.hi
    least = where(a.lo > 0.0, a.lo, where(a.hi < 0.0, minus_hi, 0.0))
    return least, _unless_unknown(_greatest(minus_lo, a.hi), a.hi)


def _within(a: Interval, lowest: float | None = None, highest: float | None = None) -> Interval:
    """The part of an interval between two limits; unknown bounds become the limits."""
    lo = a.lo if lowest is None else where(a.lo >= lowest, a.lo, lowest)
    hi = a.hi if highest is None else where(a.hi <= highest, a.hi, highest)
    return Interval(lo, hi)


def _symmetric(a: Interval, limit: float) -> Interval:
    return _within(a, -limit, limit)


# Moving bounds outwards. Let c be rounded to nearest, 2ᵏ ≤ |c| < 2ᵏ⁺¹, u = 2⁻⁵³ and η = 2⁻¹⁰⁷⁴.
# The neighbours of c are at most 2u 2ᵏ away, so that c - e, rounded, is at most the lower one if
# e > u 2ᵏ; likewise above. All exact values that round to c lie between the neighbours, and all
# roundings of exact values on one side of a bound stay on that side. Let φ = u (1 + 2u):
#   k ≥ -969: φ |c| ≥ u 2ᵏ (1 + 2u), a normal number, so its rounding is no less, and e neither;
#   -1021 ≤ k < -969: φ |c| + η > u 2ᵏ + η, which is a number, so its roundings are no less;
#   k < -1021: the neighbours are η away, and e ≥ η.
# Nothing here depends on whether φ |c| is rounded before η is added: a fused tape holds as well.
# Products c themselves are never fused into c - e, as they are used in e, too.
# If c is infinite, e is as well: a lower bound of ∞ or an upper one of -∞ becomes NaN, unknown.


def _below(c: Value, step: Value | float, share: float) -> Value:
    return c - (abs(c) * share + step)


def _above(c: Value, step: Value | float, share: float) -> Value:
    return abs(c) * share + step + c


def _rounded(lo: Value, hi: Value, step: Value | float = TINY) -> Interval:
    """Bounds that hold for all numbers that round to the given ones."""
    return Interval(_below(lo, step, STEP), _above(hi, step, STEP))


# A function that is computed to B units in the last place has a relative error of b = B 2⁻⁵² at
# most, or an absolute one of B η. If f rises, its values f̂(x) computed above a bound x₀ are no less
# than f(x₀) - b |f(x₀)|, which is no less than f̂(x₀) - (2 b + 3 b²) |f̂(x₀)|. Steps of 2 B + 1 units
# contain them and the rounding of the step.


def _tiny(op: str) -> float:
    return math.ceil(2 * functions.BOUNDS[op] + 1) * TINY


def _moved(op: str, lo: Value, hi: Value, step: Value | float) -> Interval:
    share = (2 * functions.BOUNDS[op] + 1) * ULP
    return Interval(_below(lo, step, share), _above(hi, step, share))


def _ends(op: str, a: Interval, step: Value | float | None = None) -> Interval:
    """Values of a function that rises, from those at the ends."""
    return _moved(op, a.lo.emit(op), a.hi.emit(op), _tiny(op) if step is None else step)


def _limit(op: str, limit: float) -> float:
    """What a computed function never exceeds if the function itself never exceeds the limit.

    Numbers below 1 are half as far apart as those above: fewer than 2 units of the former do not
    lead beyond 1.
    """
    bound = functions.BOUNDS[op]
    return 1.0 if limit == 1.0 and bound < 2 else limit * (1 + math.ceil(bound + 2) * ULP)


def _squared(a: Interval) -> Interval:
    left, right = a.lo * a.lo, a.hi * a.hi
    least = where(a.lo > 0.0, left, where(a.hi < 0.0, right, 0.0))
    squares = _rounded(least, _greatest(left, right), _unless_unknown(a.hi.like(TINY), a.hi))
    return _within(squares, lowest=0.0)


def _scaled(a: Interval, factor: float) -> Interval:
    """Exact for powers of two from 1 up, except that bounds may overflow the wrong way."""
    if factor == 0.0:
        zero = a.lo.like(0.0)
        return Interval(zero, zero)
    lo, hi = a if factor > 0.0 else (a.hi, a.lo)
    lo, hi = lo * factor, hi * factor
    if abs(factor) == 1.0:
        return Interval(lo, hi)
    if _doubles(factor):
        return Interval(_least(lo, LARGEST), _greatest(hi, -LARGEST))
    return _rounded(lo, hi)


def _divided(a: Interval, divisor: float) -> Interval:
    if divisor != 0.0 and _doubles(1.0 / divisor):
        return _scaled(a, 1.0 / divisor)
    lo, hi = a if divisor > 0.0 else (a.hi, a.lo)
    return _rounded(lo / divisor, hi / divisor)


def _doubles(factor: float) -> bool:
    """Whether a factor is ±1, ±2, ±4 …"""
    return 1.0 <= abs(factor) < math.inf and abs(math.frexp(factor)[0]) == 0.5


def _same_period(a: Interval, frequency: float, shift: float) -> Value:
    """Whether no x frequency + shift is a whole number, for certain.

    Roundings, that of the frequency among them, are less than 4u (|t| + 1). NaN gives no.
    """
    first, last = (x * frequency + shift for x in a)
    start = floor(_below(first, 2.0**-50, 2.0**-50))
    end = floor(_above(last, 2.0**-50, 2.0**-50))
    return start.equals(end)


def _wave(op: str, a: Interval, top: float) -> Interval:
    """sin or cos, whose largest values are ``top`` turns, and whole turns, from zero."""
    first, last = a.lo.emit(op), a.hi.emit(op)
    lo, hi = _moved(op, _least(first, last), _greatest(first, last), _tiny(op))
    bottomless = _same_period(a, 0.5 / math.pi, 0.5 - top)
    topless = _same_period(a, 0.5 / math.pi, -top)
    limit = _limit(op, 1.0)
    between = Interval(where(bottomless, lo, -limit), where(topless, hi, limit))
    return _symmetric(between, limit)


def _power(a: Interval, exponent: Value, known: float) -> Interval:
    """pow with a constant exponent; bases that give no real number do not count."""
    if known == 0.0:
        one = exponent.like(1.0)
        return Interval(one, one)
    odd = known % 2 == 1
    if known % 2 == 0:
        a = Interval(*_sizes(a))
    elif not odd:  # the computed power of -∞ is that of ∞
        a = _within(Interval(a.lo, _unless_unknown(a.hi, a.lo)), lowest=0.0)
    lo, hi = a if known > 0.0 else (a.hi, a.lo)
    step: Value | float = _tiny("pow")
    if odd and known < 0.0:
        step = where((a.lo > 0.0) | (a.hi < 0.0), step, math.inf)
    powers = _moved("pow", lo.emit("pow", exponent), hi.emit("pow", exponent), step)
    return powers if odd else _within(powers, lowest=0.0)
