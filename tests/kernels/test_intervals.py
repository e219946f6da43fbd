"""Interval tapes: enclosures of what is exact and of what is computed, and how narrow they are."""

import functools
import math
import random
from collections.abc import Callable, Sequence
from fractions import Fraction
from typing import Any

import mpmath
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gough.errors import ConfigurationError
from gough.kernels.builder import Builder
from gough.kernels.expansion import expanded
from gough.kernels.functions import BOUNDS
from gough.kernels.fusing import fused
from gough.kernels.intervals import interval_tape
from gough.kernels.reference import Array, run
from gough.kernels.tape import REAL, RESULTS, Tape, evaluate
from gough.kernels.value import Value, floor, sqrt, where
from tests.kernels.random_tapes import exact_run

mp = mpmath.MPContext()
mp.prec = 300

RING = ("add", "sub", "mul", "add", "sub", "mul", "mul", "neg", "abs", "select", "floor")
ALGEBRA = (*RING, "div", "sqrt", "div", "sqrt", "add", "mul")
TRIGONOMETRY = ("sin", "cos", "tan", "asin", "acos", "atan", "atan2")
GROWTH = ("exp", "log", "expm1", "log1p", "sinh", "cosh", "tanh", "erf", "pow")
INPUTS = 3
CONSTANTS = (0.0, 1.0, -1.0, 2.0, 0.5, -4.0, 3.0, 0.1, -2.5, 1e-3)
EXPONENTS = (2.0, 3.0, -1.0, -2.0, 0.5, 1.5, -0.5, 40.0, 35.0)

ROWS = 30
SEEDS = st.integers(0, 2**32 - 1)


def write_real(choose: Callable[[int], int], names: Sequence[str], size: int) -> Tape:
    """A tape of ``size`` operations chosen from names, whose outputs are the last three values."""
    builder = Builder(INPUTS)
    values = [Value.input(builder, k) for k in range(INPUTS)]
    for _ in range(size):
        op = names[choose(len(names))]
        a, b, c, d = (values[-1 - choose(min(len(values), 5))] for _ in range(4))
        if choose(6) == 0:
            b = a.like(CONSTANTS[choose(len(CONSTANTS))])
        if op == "select":
            test = (a < b, a <= b, ~(a < b) & (c < d), (a < b) | (d <= a), a.equals(b))[choose(5)]
            values.append(where(test, a, b) if choose(2) else where(test, c, d))
        elif op == "pow":
            values.append(a.emit(op, EXPONENTS[choose(len(EXPONENTS))] if choose(4) else b))
        else:
            values.append(a.emit(op, *[b] * (op in ("add", "sub", "mul", "div", "atan2"))))
    return builder.tape([x.number for x in values[-3:]])


def real_tapes(*names: str, most: int = 14) -> Any:
    """Strategy: tapes of operations on reals, selections among them."""

    @st.composite
    def tapes(draw: Any) -> Tape:
        size = draw(st.integers(1, most))
        return write_real(lambda n: draw(st.integers(0, n - 1)), names, size)

    return tapes()


def formula(write: Callable[..., Value | Sequence[Value]], inputs: int = 1) -> Tape:
    """The tape of a function of values."""
    builder = Builder(inputs)
    written = write(*[Value.input(builder, k) for k in range(inputs)])
    return builder.tape([x.number for x in ([written] if isinstance(written, Value) else written)])


def enclosures(tape: Tape, lo: Array, hi: Array) -> tuple[Array, Array]:
    """Lower and upper bounds of the outputs for boxes, each (rows, n)."""
    ends = run(expanded(interval_tape(tape)), _interleaved(lo, hi))
    return ends[..., ::2], ends[..., 1::2]


@functools.cache
def of_function(op: str) -> Tape:
    """The interval tape of a function, in primitives."""
    return expanded(interval_tape(formula(lambda x: x.emit(op))))


def enclosure(write: Callable[..., Any], *intervals: tuple[float, float]) -> tuple[float, float]:
    """Bounds of one function of intervals."""
    lo, hi = np.array(intervals, dtype=float).T
    below, above = enclosures(formula(write, len(intervals)), lo, hi)
    return float(below[0]), float(above[0])


def _interleaved(lo: Array, hi: Array) -> Array:
    return np.stack([lo, hi], axis=-1).reshape(*lo.shape[:-1], 2 * lo.shape[-1])


def boxes_with_points(seed: int, wild: bool = False) -> tuple[Array, Array, Array]:
    """Boxes from points to wide ones, and a point of each, often at an end: (rows, inputs)."""
    rng = np.random.default_rng(seed)
    shape = (ROWS, INPUTS)
    x = rng.normal(size=shape) * rng.choice([0.3, 1.0, 5.0], shape)
    if wild:
        x = np.where(rng.random(shape) < 0.3, x * np.exp2(rng.uniform(-1080, 1000, shape)), x)
    x = np.where(rng.random(shape) < 0.2, np.round(x), x)
    width = np.abs(x) * rng.choice([0, 0, 1e-15, 1e-9, 0.01, 1, 4], shape)
    a, b = x - width * rng.random(shape), x + width * rng.random(shape)
    lo, hi = np.minimum(a, b), np.maximum(a, b)
    inside = np.clip(lo + (hi - lo) * rng.random(shape), lo, hi)
    point = np.choose(rng.integers(0, 4, shape), [lo, hi, inside, np.clip(x, lo, hi)])
    return lo, hi, point


def with_all_values(tape: Tape) -> tuple[Tape, list[int]]:
    """The tape with every real value as an output, and the places of those that are compared."""
    reals = [k for k, (op, _) in enumerate(tape.code) if RESULTS[op] == REAL]
    compared = {
        k for op, operands in tape.code if op in ("less", "less_equal", "equal") for k in operands
    }
    return Tape(tape.inputs, tape.code, reals), [reals.index(k) for k in compared]


def outside(values: Array, lo: Array, hi: Array) -> Array:
    """Places of numbers that are not between the bounds."""
    return np.argwhere((values < lo) | (values > hi))


ANY = (*ALGEBRA, *TRIGONOMETRY, *GROWTH)
TAPES = pytest.mark.parametrize(
    "names", [RING, ALGEBRA, (*ALGEBRA, *TRIGONOMETRY), (*ALGEBRA, *GROWTH), ANY]
)


# containment of what is computed


@given(st.data(), SEEDS)
@TAPES
def test_what_the_real_tape_computes_lies_inside(names, data, seed):
    tape, compared = with_all_values(data.draw(real_tapes(*names)))
    lo, hi, point = boxes_with_points(seed, wild=True)
    values = run(expanded(tape), point)
    promised = ~np.isnan(values[:, compared]).any(axis=1)
    below, above = enclosures(tape, lo, hi)
    assert not np.isnan(below).any()
    assert not np.isnan(above).any()
    assert not len(outside(values[promised], below[promised], above[promised]))


@given(st.data(), SEEDS)
@TAPES
def test_fused_tapes_keep_the_law(names, data, seed):
    tape = data.draw(real_tapes(*names, most=8))
    lo, hi, point = (x[:8] for x in boxes_with_points(seed))
    everything, compared = with_all_values(tape)
    promised = ~np.isnan(run(expanded(everything), point)[:, compared]).any(axis=1)
    bounds = exact_run(fused(expanded(interval_tape(tape))), _interleaved(lo, hi))
    below, above = bounds[promised, ::2], bounds[promised, 1::2]
    for real in (expanded(tape), fused(expanded(tape))):
        assert not len(outside(exact_run(real, point)[promised], below, above))


# containment of what is exact


class Fractions:
    """Exact arithmetic of fractions."""

    constant, flag = Fraction, bool
    add, sub, mul = Fraction.__add__, Fraction.__sub__, Fraction.__mul__
    neg, abs, floor = Fraction.__neg__, abs, (lambda a: Fraction(math.floor(a)))
    less, less_equal, equal = Fraction.__lt__, Fraction.__le__, Fraction.__eq__
    not_, and_, or_ = (lambda a: not a), (lambda a, b: a and b), (lambda a, b: a or b)
    select = staticmethod(lambda condition, a, b: a if condition else b)


@given(st.data(), SEEDS)
def test_exact_values_of_polynomials_lie_inside(data, seed):
    tape, _ = with_all_values(data.draw(real_tapes(*RING)))
    lo, hi, point = (x[:6] for x in boxes_with_points(seed))
    below, above = enclosures(tape, lo, hi)
    for row in range(len(point)):
        values = evaluate(tape, Fractions, [Fraction(x) for x in point[row]])
        for k, value in enumerate(values):
            assert below[row, k] <= value <= above[row, k]


class NoValue(Exception):
    """A function was asked where it has no real value."""


def real(function: Callable[..., Any]) -> Callable[..., Any]:
    """The function of real numbers, which has no complex or infinite values."""

    def checked(*x: Any) -> Any:
        try:
            value = function(*x)
        except (ValueError, ZeroDivisionError, OverflowError) as error:
            raise NoValue from error
        if not isinstance(value, mp.mpf) or not mp.isfinite(value):
            raise NoValue
        return value

    return staticmethod(checked)


def precise_power(x: Any, y: Any) -> Any:
    if abs(y * mp.log(abs(x))) > 1e4:
        raise OverflowError
    return x**y


class Precise(Fractions):
    """Real numbers to 300 bits; see `mp`."""

    constant, flag = mp.mpf, bool
    add, sub, mul = (real(getattr(mp.mpf, f"__{name}__")) for name in ("add", "sub", "mul"))
    div, neg = real(lambda a, b: a / b), staticmethod(lambda a: -a)
    abs, floor = staticmethod(abs), real(lambda a: mp.floor(a))
    less, less_equal, equal = (mp.mpf.__lt__, mp.mpf.__le__, mp.mpf.__eq__)
    sqrt, log = real(mp.sqrt), real(mp.log)
    exp, sinh, cosh = (
        real(lambda x, f=f: f(x) if abs(x) < 1e4 else mp.inf) for f in (mp.exp, mp.sinh, mp.cosh)
    )
    expm1 = real(lambda x: mp.expm1(x) if abs(x) < 1e4 else mp.inf)
    sin, cos, tan = (real(lambda x, f=f: f(x)) for f in (mp.sin, mp.cos, mp.tan))
    asin, acos, atan = real(mp.asin), real(mp.acos), real(mp.atan)
    atan2, tanh, erf = real(mp.atan2), real(mp.tanh), real(mp.erf)
    log1p, pow = real(mp.log1p), real(precise_power)


@given(st.data(), SEEDS)
@pytest.mark.parametrize("names", [ALGEBRA, ANY])
def test_exact_values_lie_inside(names, data, seed):
    tape, _ = with_all_values(data.draw(real_tapes(*names, most=8)))
    lo, hi, point = (x[:4] for x in boxes_with_points(seed))
    below, above = enclosures(tape, lo, hi)
    for row in range(len(point)):
        try:
            values = evaluate(tape, Precise, [mp.mpf(x) for x in point[row]])
        except NoValue:
            continue
        for k, value in enumerate(values):
            assert below[row, k] <= value <= above[row, k]


RANGES = {
    "sin": (-40, 40),
    "cos": (-40, 40),
    "tan": (-40, 40),
    "asin": (-1, 1),
    "acos": (-1, 1),
    "atan": (-1e3, 1e3),
    "exp": (-740, 700),
    "log": (1e-300, 1e3),
    "expm1": (-50, 700),
    "log1p": (-0.999999, 1e3),
    "sinh": (-700, 700),
    "cosh": (-700, 700),
    "tanh": (-30, 30),
    "erf": (-7, 7),
}


@given(SEEDS)
@pytest.mark.parametrize("op", RANGES)
def test_functions_at_points_are_inside_and_narrow(op, seed):
    rng = np.random.default_rng(seed)
    lowest, highest = RANGES[op]
    x = rng.uniform(lowest, highest, (8, 1)) * rng.choice([1, 1e-3, 1e-12], (8, 1))
    x = np.clip(x, lowest, highest)
    below, above = np.split(run(of_function(op), np.hstack([x, x])), 2, axis=-1)
    for at, lo, hi in zip(x[:, 0], below[:, 0], above[:, 0], strict=True):
        exact = getattr(Precise, op)(mp.mpf(at))
        assert lo <= exact <= hi
        if abs(exact) > 1e-290:
            assert hi - lo <= (4 * BOUNDS[op] + 4) * 2**-52 * max(abs(lo), abs(hi))


@given(SEEDS)
@pytest.mark.parametrize("op", ["sin", "cos", "tan", "atan", "cosh", "tanh"])
def test_ranges_of_functions_are_tight(op, seed):
    """Sampled values come as near to both bounds as the samples are close."""
    rng = np.random.default_rng(seed)
    lo = rng.uniform(-8, 8, (4, 1))
    hi = lo + rng.choice([1e-6, 0.3, 2, 7]) * rng.random((4, 1))
    below, above = np.split(run(of_function(op), np.hstack([lo, hi])), 2, axis=-1)
    values = getattr(np, op)(np.linspace(lo[:, 0], hi[:, 0], 4001))
    least, greatest = values.min(axis=0), values.max(axis=0)
    bounded = np.isfinite(above[:, 0]) & np.isfinite(below[:, 0])
    if op != "tan":
        assert bounded.all()
    space = (1e-5 * (greatest - least) + 1e-14 * (1 + np.abs(values).max(axis=0)))[bounded]
    assert (below[bounded, 0] > least[bounded] - space).all()
    assert (above[bounded, 0] < greatest[bounded] + space).all()


# width


@given(SEEDS)
def test_points_grow_by_a_few_units_for_each_operation(seed):
    """Of positive numbers, where no condition number is in the way."""
    rng, steps = random.Random(seed), 20

    def write(*inputs: Value) -> list[Value]:
        values = list(inputs)
        for _ in range(steps):
            a, b = rng.choice(values), rng.choice(values)
            values.append(rng.choice([sqrt(a * b), a + b, sqrt(a), sqrt(a / b), 1.0 / a]))
        product = inputs[0]
        for k in range(steps):
            product = product * inputs[k % 3]
        return [*values, product]

    x = np.random.default_rng(seed).uniform(0.5, 2, (8, 3))
    lo, hi = enclosures(formula(write, 3), x, x)
    assert ((hi - lo) / lo).max() <= 2 * steps * 5 * 2**-53


@given(SEEDS)
def test_narrower_boxes_have_narrower_values(seed):
    """Of functions with values everywhere, and short of overflow, where bounds are given up."""
    names = (*RING, "div", "sin", "cos", "tan", "atan", "exp", "sinh", "cosh", "tanh", "erf")
    tape, _ = with_all_values(write_real(random.Random(seed).randrange, names, 8))
    lo, hi, point = boxes_with_points(seed)
    outer = enclosures(tape, lo, hi)
    inner = enclosures(tape, (lo + point) / 2, (hi + point) / 2)
    bounded = np.isfinite(inner).all(axis=(0, 2))
    below, above = (x[bounded] for x in outer)
    inner_below, inner_above = (x[bounded] for x in inner)
    assert (inner_below >= below - 1e-9 * np.abs(below)).all()
    assert (inner_above <= above + 1e-9 * np.abs(above)).all()


# exact operations


@given(SEEDS)
def test_exact_operations_do_not_widen(seed):
    def write(x: Value, y: Value) -> list[Value]:
        least, most = where(x < y, x, y), where(y <= x, x, y)
        return [-x, abs(x), floor(x), x + x, x * 4.0, x / 0.5, x + 0.0, least, most, x - x]

    point = np.random.default_rng(seed).normal(size=(5, 2))
    below, above = enclosures(formula(write, 2), point, point)
    np.testing.assert_array_equal(below, above)
    np.testing.assert_array_equal(below, run(formula(write, 2), point))


def test_selections():
    smaller, larger = (lambda x, y: where(x < y, x, y)), (lambda x, y: where(x < y, y, x))
    assert enclosure(smaller, (1, 4), (2, 3)) == (1, 3)
    assert enclosure(larger, (1, 4), (2, 3)) == (2, 4)
    assert enclosure(lambda x, y: where(x < y, x * 2.0, y), (1, 4), (2, 3)) == (2, 8)
    assert enclosure(lambda x, y: where(x < y, x * 2.0, y), (1, 2), (3, 5)) == (2, 4)
    assert enclosure(lambda x, y: where(x < y, x * 2.0, y), (5, 6), (3, 5)) == (3, 5)
    assert enclosure(lambda x: where(~(x < 0.0) & (x <= 9.0), x, 0.0 - x), (1, 2)) == (1, 2)
    assert enclosure(lambda x: where(x.equals(2.0), 1.0, 0.0), (2, 2)) == (1, 1)
    assert enclosure(lambda x: where(x.equals(2.0), 1.0, 0.0), (2, 3)) == (0, 1)
    assert enclosure(lambda x: where(x.equals(2.0), 1.0, 0.0), (3, 4)) == (0, 0)
    assert enclosure(lambda x, y: where(x <= y, 1.0, 0.0), (1, 2), (0, 1)) == (0, 1)
    assert enclosure(lambda x, y: where(x <= y, 1.0, 0.0), (0, 1), (1, 2)) == (1, 1)
    guarded = enclosure(lambda x: where(x < 0.0, 0.0, sqrt(x)), (-1, 4))
    assert guarded == (0, np.nextafter(2, 3))


# special values

INF, NAN = math.inf, math.nan
LINE = (-INF, INF)


def test_squares_are_no_products():
    assert enclosure(lambda x: x * x, (-1, 2)) == (0, np.nextafter(4, 5))
    assert enclosure(lambda x, y: x * y, (-1, 2), (-1, 2))[0] == np.nextafter(-2, -3)


@pytest.mark.parametrize(
    ("write", "intervals"),
    [
        (lambda x: 1.0 / x, [(-1, 1)]),
        (lambda x: 1.0 / x, [(0, 1)]),
        (lambda x, y: x / y, [(1, 2), (-1, 0)]),
        (lambda x: x / 0.0, [(-1, 1)]),
        (lambda x: x + 1.0, [(NAN, NAN)]),
        (lambda x, y: x * y, [(NAN, 1), (1, 2)]),
        (lambda x, y: x * y, [(1, 2), (3, NAN)]),
        (lambda x, y: x - y, [LINE, LINE]),
        (lambda x, y: x - y, [(INF, INF), (INF, INF)]),
        (lambda x, y: x * y, [(0, 0), LINE]),
        (lambda x: x.emit("tan"), [(1, 2)]),
        (lambda x: x.emit("tan"), [LINE]),
        (lambda x, y: where(x < y, x, y), [LINE, LINE]),
        (lambda x, y: x.emit("pow", y), [(-1, 2), (1, 3)]),
        (lambda x, y: x.emit("pow", y), [(2, 3), (1, NAN)]),
        (lambda x, y: where(x < 1.0, y, where(x < 2.0, x, -y)), [(0, 3), (NAN, 5)]),
        (lambda x, y: where(x < 1.0, x, where(x < 2.0, y, -y)), [(0, 3), (5, NAN)]),
        (lambda x: x.emit("pow", -3.0), [(-1, 2)]),
        (lambda x, y: x * 1e200 * 1e200 - y * 1e200 * 1e200, [(1, 2), (1, 2)]),
    ],
)
def test_nothing_is_known(write, intervals):
    assert enclosure(write, *intervals) == LINE


def test_parts_of_the_domain_count():
    assert enclosure(sqrt, (-1, 4)) == (0, np.nextafter(2, 3))
    assert enclosure(sqrt, (-2, -1)) == (0, INF)
    assert enclosure(lambda x: x.emit("log"), (-1, 1))[0] == -INF
    assert enclosure(lambda x: x.emit("asin"), (0, 2))[1] == pytest.approx(math.pi / 2, abs=1e-14)
    assert enclosure(lambda x: x.emit("acos"), (-3, 2)) == pytest.approx((0, math.pi), abs=1e-14)
    assert enclosure(lambda x: x.emit("pow", 1.5), (-1, 4)) == pytest.approx((0, 8), rel=1e-12)


def test_bounds_that_overflow_or_underflow():
    big = 1.5e308
    assert enclosure(lambda x: x + x, (big, big)) == (np.finfo(float).max, INF)
    assert enclosure(lambda x: x * 3.0, (big, big)) == LINE
    assert enclosure(lambda x: -(x + x), (big, big)) == (-INF, -np.finfo(float).max)
    lo, hi = enclosure(lambda x: 1.0 / (x + x), (big, big))
    assert -5e-324 <= lo < 1 / 3e308 < hi < 1e-307
    assert enclosure(lambda x, y: x * y, (1e-200, 1e-200), (1e-200, 1e-200))[1] == 5e-324
    assert enclosure(lambda x: x * 0.5, (5e-324, 5e-324))[1] >= 5e-324
    assert enclosure(lambda x, y: x * y, (1, 2), (0, INF)) == LINE
    assert enclosure(lambda x: x + 1.0, (0, INF)) == (np.nextafter(1, 0), INF)
    assert enclosure(abs, (-INF, -2)) == (2, INF)
    assert enclosure(lambda x: x.emit("exp"), (-INF, 0))[0] == 0
    assert enclosure(lambda x: x.emit("exp"), (800, 900)) == (0, INF)


@pytest.mark.parametrize("op", ["sin", "cos"])
@pytest.mark.parametrize("x", [(-100, 100), (1e300, 1e300 * 1.1), LINE, (NAN, 1), (0, 7)])
def test_wide_angles_have_all_values(op, x):
    assert enclosure(lambda v: v.emit(op), x) == (-1, 1)


def test_poles_are_seen_by_their_neighbours():
    poles = (np.arange(-3000, 3000) * np.round(1.01 ** np.arange(6000) % 1e6) + 0.5) * np.pi
    lo, hi = np.nextafter(poles, -INF), np.nextafter(poles, INF)
    below, above = enclosures(formula(lambda x: x.emit("tan")), lo[:, None], hi[:, None])
    assert (below == -INF).all()
    assert (above == INF).all()


def test_extremes_of_waves():
    assert enclosure(lambda x: x.emit("sin"), (1, 2))[1] == 1
    assert enclosure(lambda x: x.emit("cos"), (3, 4))[0] == -1
    lo, hi = enclosure(lambda x: x.emit("cos"), (-0.5, 1))
    assert hi == 1
    assert lo == pytest.approx(math.cos(1), rel=1e-14)
    assert lo < math.cos(1)


@pytest.mark.parametrize(
    ("y", "x", "expected"),
    [
        ((1, 2), (1, 3), (math.atan2(1, 3), math.atan2(2, 1))),
        ((1, 2), (-1, 3), (math.atan2(1, 3), math.atan2(1, -1))),
        ((1, 2), (-3, -1), (math.atan2(2, -1), math.atan2(1, -3))),
        ((-2, -1), (-3, -1), (math.atan2(-1, -3), math.atan2(-2, -1))),
        ((-2, -1), (-1, 3), (math.atan2(-1, -1), math.atan2(-1, 3))),
        ((-2, 1), (1, 3), (math.atan2(-2, 1), math.atan2(1, 1))),
        ((-2, 1), (-1, 3), (-math.pi, math.pi)),
        ((1, INF), (-INF, INF), (0, math.pi)),
        (LINE, (1, 2), (-math.pi / 2, math.pi / 2)),
    ],
)
def test_angles(y, x, expected):
    lo, hi = enclosure(lambda a, b: a.emit("atan2", b), y, x)
    assert (lo, hi) == pytest.approx(expected, rel=1e-14, abs=1e-300)
    assert lo <= expected[0]
    assert hi >= expected[1]


@pytest.mark.parametrize(
    ("exponent", "x", "expected"),
    [
        (2.0, (-1, 3), (0, 9)),
        (3.0, (-2, 3), (-8, 27)),
        (-1.0, (2, 4), (0.25, 0.5)),
        (-2.0, (-4, -2), (1 / 16, 0.25)),
        (-2.0, (-4, 2), (1 / 16, INF)),
        (-3.0, (-2, -1), (-1, -1 / 8)),
        (0.5, (-1, 4), (0, 2)),
        (-0.5, (0, 4), (0.5, INF)),
        (0.0, (-1, 1), (1, 1)),
    ],
)
def test_powers(exponent, x, expected):
    lo, hi = enclosure(lambda v: v.emit("pow", exponent), x)
    assert (lo, hi) == pytest.approx(expected, rel=1e-12, abs=1e-300)
    assert lo <= expected[0]
    assert hi >= expected[1]


# what is refused


def test_operations_on_bits_are_refused():
    with pytest.raises(ConfigurationError, match="has no meaning for intervals"):
        interval_tape(formula(lambda x: x.word().real()))
