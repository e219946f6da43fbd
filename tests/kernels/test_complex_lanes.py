"""Complex tapes: agreement with real tapes and with many digits, branches, derivatives."""

import cmath
import functools
import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gough.errors import ConfigurationError
from gough.kernels.complex_lanes import complex_tape
from gough.kernels.expansion import expanded
from gough.kernels.fusing import fused
from gough.kernels.intervals import interval_tape
from gough.kernels.reference import Array, run
from gough.kernels.tape import Tape, evaluate
from gough.kernels.value import Value, floor, where
from tests.kernels.random_tapes import exact_run
from tests.kernels.test_intervals import (
    ALGEBRA,
    INPUTS,
    RING,
    SEEDS,
    Fractions,
    NoValue,
    formula,
    mp,
    real_tapes,
    with_all_values,
)

U = 2.0**-53
CIRCULAR = ("sin", "cos", "tan", "sinh", "cosh", "tanh", "exp", "expm1")
INVERSE = ("asin", "acos", "atan", "log", "log1p", "sqrt")
SMOOTH = (*CIRCULAR, *INVERSE)
ANY = (*ALGEBRA, *SMOOTH, "pow", "atan2")


def values(tape: Tape, z: Any) -> Any:
    """Complex outputs of a tape: (rows, inputs) -> (rows, outputs)."""
    return joined(run(expanded(complex_tape(tape)), parts(z)))


def parts(z: Any) -> Array:
    return np.stack([np.real(z), np.imag(z)], axis=-1).reshape(*z.shape[:-1], -1)


def joined(rows: Array) -> Any:
    result = np.empty((*rows.shape[:-1], rows.shape[-1] // 2), complex)
    result.real, result.imag = rows[..., ::2], rows[..., 1::2]
    return result


@functools.cache
def lowered(op: str, operands: int) -> Tape:
    """One operation, in primitives."""
    tape = formula(lambda x, *others: x.emit(op, *others), operands)
    return expanded(complex_tape(tape))


def values_of(op: str, *z: Any) -> Any:
    """One operation of arrays."""
    return joined(run(lowered(op, len(z)), parts(np.stack(z, axis=-1))))[..., 0]


def value(op: str, *z: complex) -> complex:
    """One operation of numbers."""
    return complex(values_of(op, *[np.array(x, complex) for x in z]))


# zero imaginary parts


@given(st.data(), SEEDS)
@pytest.mark.parametrize("names", [RING, ALGEBRA, (*ALGEBRA, *CIRCULAR, "log", "log1p", "sqrt")])
def test_real_inputs_give_the_numbers_of_the_real_tape(names, data, seed):
    tape, _ = with_all_values(data.draw(real_tapes(*names)))
    rng = np.random.default_rng(seed)
    x = rng.normal(size=(20, INPUTS)) * rng.choice([0.1, 1, 30], (20, INPUTS))
    expected = run(expanded(tape), x)
    found = values(tape, x + 0j)
    finite = (np.abs(expected) < 1e150).all(axis=1)
    np.testing.assert_array_equal(found[finite].real, expected[finite])
    np.testing.assert_array_equal(found[finite].imag, 0)


@given(st.data(), SEEDS)
def test_fused_complex_tapes_agree_with_the_unfused_real_tape(data, seed):
    tape = data.draw(real_tapes("add", "sub", "mul", "div", most=8))
    x = np.random.default_rng(seed).normal(size=(8, INPUTS))
    expected = run(tape, x)
    found = joined(exact_run(fused(complex_tape(tape)), parts(x + 0j)))
    finite = (np.abs(run(with_all_values(tape)[0], x)) < 1e150).all(axis=1)
    np.testing.assert_allclose(found[finite].real, expected[finite], rtol=1e-9)
    np.testing.assert_array_equal(found[finite].imag, 0)


@given(SEEDS)
@pytest.mark.parametrize("op", ["asin", "acos", "atan"])
def test_inverse_functions_agree_nearly(op, seed):
    x = np.random.default_rng(seed).uniform(-1, 1, (20, 1))
    tape = formula(lambda v: v.emit(op))
    expected, found = run(expanded(tape), x), values(tape, x + 0j)
    np.testing.assert_array_equal(found.imag, 0)
    assert (np.abs(found.real - expected) <= 4 * np.spacing(np.abs(expected))).all()


def test_two_real_numbers_have_their_angle_and_power():
    x = np.random.default_rng(1).normal(size=(40, 2))
    x[:3] = [[0, 0], [0, -1], [1, 0]]
    angle = formula(lambda a, b: a.emit("atan2", b), 2)
    np.testing.assert_array_equal(values(angle, x + 0j), run(expanded(angle), x))
    power = formula(lambda a, b: a.emit("pow", b), 2)
    positive = np.abs(x)
    positive[:, 1] += 0.1
    np.testing.assert_array_equal(values(power, positive + 0j), run(expanded(power), positive))


def test_known_reals_cost_nothing():
    tape = formula(lambda x: [x * 3.0 + 1.0, floor(x) * floor(x), x * 0.7])
    assert complex_tape(tape).counts() == {"mul": 5, "add": 1, "sign": 1, "total": 7}


# many digits


def points(rng: np.random.Generator, n: int) -> Any:
    """Complex numbers of many sizes, some of them near an axis or near 1."""
    z = (rng.normal(size=n) + 1j * rng.normal(size=n)) * rng.choice([1e-8, 0.1, 1, 1, 10], n)
    z.real *= rng.choice([1, 1, 1, 1e-9, 1e-17], n)
    z.imag *= rng.choice([1, 1, 1, 1e-9, 1e-17], n)
    return z + rng.choice([0, 0, 0, 1, -1, 1j, -1j], n)


def exactly(op: str, *z: complex) -> Any:
    return getattr(PreciseComplex, op)(*[mp.mpc(x) for x in z])


def largest_error(op: str, *z: Any, sizes: Any = 1.0) -> float:
    """The largest distance from an exact result as a fraction of it, in u, and of the sizes."""
    exact = [exactly(op, *numbers) for numbers in zip(*z, strict=True)]
    found = values_of(op, *z)
    errors = [float(abs(mp.mpc(f) - e) / abs(e)) for f, e in zip(found, exact, strict=True)]
    return float(np.max(np.array(errors) / sizes)) / U


@given(SEEDS)
@pytest.mark.parametrize(
    ("op", "bound"), [("add", 1), ("sub", 1), ("mul", math.sqrt(5)), ("div", 6)]
)
def test_rational_operations_keep_their_bounds(op, bound, seed):
    a, b = points(np.random.default_rng(seed), 20).reshape(2, 10)
    assert largest_error(op, a, b) <= bound


@given(SEEDS)
@pytest.mark.parametrize("op", SMOOTH)
def test_functions_have_small_errors(op, seed):
    assert largest_error(op, points(np.random.default_rng(seed), 8)) <= 16


@given(SEEDS)
def test_powers_and_angles(seed):
    a, b = points(np.random.default_rng(seed), 12).reshape(2, 6)
    b /= np.maximum(1, np.abs(b) * (np.abs(np.log(a)) + 1) / 50)
    sizes = 1 + np.abs(b) * (np.abs(np.log(a)) + 1)
    assert largest_error("pow", a, b, sizes=sizes) <= 16
    room = 0.3 * np.maximum(np.abs(a.real), np.abs(b.real))
    for z in (a, b):
        z.imag = np.clip(z.imag, -room, room)
    assert largest_error("atan2", a, b) <= 16


@pytest.mark.parametrize("z", [3e200 + 1e200j, 1e-200 - 3e-200j, 1e150 + 1e-150j, 1e-290j])
def test_sizes_near_the_ends_of_the_range(z):
    for op in ("sqrt", "log", "atan", "asin", "acos"):
        assert value(op, z) == pytest.approx(getattr(cmath, op)(z), rel=1e-15, abs=0)
    assert value("div", z, z * 3) == pytest.approx(1 / 3, rel=1e-15)
    assert value("div", 1.0, z * 1e30) * z * 1e30 == pytest.approx(1, rel=1e-15)


def test_tangents_of_large_imaginary_parts():
    assert value("tan", 1 + 800j) == pytest.approx(1j)
    assert value("tanh", 800 + 1j) == pytest.approx(1)


def _checked(z: Any) -> Any:
    if not mp.isfinite(z) or abs(z) > 1e100:
        raise NoValue
    return mp.mpc(z)


def known(function: Any) -> Any:
    """The function where it has a value of moderate size."""

    def checked(*z: Any) -> Any:
        if any(abs(x) > 500 for x in z):
            raise NoValue
        try:
            return _checked(function(*z))
        except (ValueError, ZeroDivisionError, OverflowError) as error:
            raise NoValue from error

    return staticmethod(checked)


def uncut(function: Any) -> Any:
    """The function, but on its cuts, real numbers beyond ±1."""

    def checked(z: Any) -> Any:
        if z.imag == 0 and abs(z.real) > 1:
            raise NoValue
        return function(z)

    return known(checked)


def angle(y: Any, x: Any) -> Any:
    """The angle of the real parts, continued."""
    start = mp.atan2(y.real, x.real)
    return start + mp.atan((y * x.real - x * y.real) / (x * x.real + y * y.real))


class PreciseComplex(Fractions):
    """Complex numbers to 300 bits; comparisons, absolute values and floor as in the module."""

    constant, flag = mp.mpc, bool
    add, sub, mul = known(lambda a, b: a + b), known(lambda a, b: a - b), known(lambda a, b: a * b)
    div, neg = known(lambda a, b: a / b), staticmethod(lambda a: -a)
    abs = staticmethod(lambda a: -a if a.real < 0 else a)
    floor = staticmethod(lambda a: mp.mpc(mp.floor(a.real)))
    less = staticmethod(lambda a, b: a.real < b.real)
    less_equal = staticmethod(lambda a, b: a.real <= b.real)
    equal = staticmethod(lambda a, b: a.real == b.real)
    sqrt, log, log1p = known(mp.sqrt), known(mp.log), known(lambda z: mp.log(1 + z))
    exp, expm1, sin, cos, tan = (known(f) for f in (mp.exp, mp.expm1, mp.sin, mp.cos, mp.tan))
    sinh, cosh, tanh = known(mp.sinh), known(mp.cosh), known(mp.tanh)
    asin, acos, atan = uncut(mp.asin), uncut(mp.acos), known(mp.atan)
    pow, atan2 = known(lambda a, b: mp.exp(b * mp.log(a))), known(angle)


@given(st.data(), SEEDS)
@pytest.mark.parametrize("names", [ALGEBRA, (*ALGEBRA, *SMOOTH), ANY])
@pytest.mark.parametrize("imaginary", [1.0, 1e-30])
def test_exact_values_lie_in_the_intervals_of_the_complex_tape(names, imaginary, data, seed):
    """The two lowerings after one another; with small imaginary parts these are derivatives."""
    tape, _ = with_all_values(data.draw(real_tapes(*names, most=6)))
    rng = np.random.default_rng(seed)
    z = rng.normal(size=(3, INPUTS)) + 1j * imaginary * rng.normal(size=(3, INPUTS))
    doubled = complex_tape(tape)
    bounds = run(expanded(interval_tape(doubled)), np.repeat(parts(z), 2, axis=-1))
    found = run(expanded(doubled), parts(z))
    for row in range(len(z)):
        try:
            exact = evaluate(tape, PreciseComplex, [mp.mpc(x) for x in z[row]])
        except NoValue:
            continue
        both = [part for w in exact for part in (w.real, w.imag)]
        for k, part in enumerate(both):
            lo, hi = bounds[row, 2 * k], bounds[row, 2 * k + 1]
            assert lo <= part <= hi
            assert lo <= found[row, k] <= hi or math.isnan(found[row, k])


# derivatives

DERIVATIVES = {
    "sin": math.cos,
    "cos": lambda x: -math.sin(x),
    "tan": lambda x: 1 / math.cos(x) ** 2,
    "asin": lambda x: 1 / math.sqrt((1 - x) * (1 + x)),
    "acos": lambda x: -1 / math.sqrt((1 - x) * (1 + x)),
    "atan": lambda x: 1 / (1 + x * x),
    "exp": math.exp,
    "expm1": math.exp,
    "log": lambda x: 1 / x,
    "log1p": lambda x: 1 / (1 + x),
    "sinh": math.cosh,
    "cosh": math.sinh,
    "tanh": lambda x: 1 / math.cosh(x) ** 2,
    "sqrt": lambda x: 0.5 / math.sqrt(x),
    "abs": lambda x: 1.0,
    "floor": lambda x: 0.0,
}


@given(st.floats(1e-6, 0.999))
@pytest.mark.parametrize("op", DERIVATIVES)
def test_small_imaginary_steps_give_derivatives(op, x):
    step = 1e-200
    found = value(op, complex(x, step)).imag / step
    assert found == pytest.approx(DERIVATIVES[op](x), rel=1e-14)


@given(st.floats(-3, 3), st.floats(0.1, 3))
def test_steps_of_angles_and_powers(y, x):
    step = 1e-200
    square = x * x + y * y
    assert value("atan2", complex(y, step), x).imag / step == pytest.approx(x / square, rel=1e-14)
    assert value("atan2", y, complex(x, step)).imag / step == pytest.approx(-y / square, rel=1e-14)
    found = value("pow", complex(x, step), y).imag / step
    assert found == pytest.approx(y * x ** (y - 1), rel=1e-14)
    found = value("pow", x, complex(y, step)).imag / step
    assert found == pytest.approx(x**y * math.log(x), rel=1e-14, abs=1e-300)


def test_steps_through_selections():
    tape = formula(lambda x: [abs(x), where(x < 1.0, x * x, 3.0), where(x < 1.0, 2.0, x)])
    x = np.array([[-2.0], [0.5], [4.0]])
    derivatives = values(tape, x + 1e-200j).imag / 1e-200
    np.testing.assert_allclose(derivatives, [[-1, -4, 0], [1, 1, 0], [1, 0, 1]])


# branches


@pytest.mark.parametrize("zero", [0.0, -0.0])
@pytest.mark.parametrize("op", ["sqrt", "log", "asin", "acos", "log1p"])
@pytest.mark.parametrize("x", [-2.5, 2.5, -1.0, 1.0])
def test_cuts_belong_to_what_is_above(op, x, zero):
    if op == "log1p" and x == -1.0:
        return
    expected = cmath.log(1 + complex(x, 0)) if op == "log1p" else getattr(cmath, op)(complex(x, 0))
    assert value(op, complex(x, zero)) == pytest.approx(expected, rel=1e-15, abs=1e-300)


@pytest.mark.parametrize("zero", [0.0, -0.0])
def test_the_cuts_of_the_arctangent_belong_to_the_right(zero):
    for y in (2.5, -2.5):
        assert value("atan", complex(zero, y)) == pytest.approx(cmath.atan(complex(0, y)))


def test_zeros_have_values():
    assert value("sqrt", 0) == value("asin", 0) == value("atan", 0) == value("expm1", 0) == 0
    assert value("log1p", 0) == value("atan2", 0, 0) == 0
    assert value("pow", 0, 2) == 0
    assert value("pow", 0, 2 + 1j) == 0


# what is refused


@pytest.mark.parametrize("op", ["erf", "to_word"])
def test_operations_without_a_meaning_are_refused(op):
    def write(x: Value) -> Value:
        return x.word().real() if op == "to_word" else x.emit(op)

    with pytest.raises(ConfigurationError, match="has no meaning for complex numbers"):
        complex_tape(formula(write))
