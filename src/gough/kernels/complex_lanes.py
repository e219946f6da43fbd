"""Complex numbers on a real tape: every value becomes a real and an imaginary part.

The result is an ordinary tape with twice the inputs and outputs, which every back end runs.

Functions are continued holomorphically, with principal branches. A point on a branch cut counts as
just above it (for atan, to the right), whatever the sign of its zero. Three operations are not
holomorphic and have the meaning that derivatives by a complex step need (Squire and Trapp 1998;
Martins, Sturdza and Alonso 2003): comparisons see real parts alone, |z| is -z where the real part
is negative, and floor forgets the imaginary part.

With u = 2⁻⁵³, absolute errors of one operation as a fraction of the absolute value of its result:

    addition u, product √5 u (Brent, Percival and Zimmermann 2007), quotient 6 u,
    functions 16 u (7 u was the most in 20 000 numbers), and aᵇ (1 + |b log a|) times as much

A quotient scales by the larger part of its divisor (Smith 1962), so it is in range where its result
is, up to a factor of two. A part far smaller than the other has no small error of its own, except
where the imaginary part is so small that its square does not count: then it is the derivative times
the step, with a relative error of a few u.

With zero imaginary parts the sums, products, quotients, square roots and those of the functions
that are not listed here agree with the real tape bit for bit, but for the sign of zero; asin, acos
and atan agree to 4 units in the last place. Infinite parts make NaN sooner than the real tape does.
"""

from __future__ import annotations

import math
from typing import NamedTuple, NoReturn

from gough.errors import ConfigurationError
from gough.kernels.builder import Builder
from gough.kernels.tape import Tape, evaluate
from gough.kernels.value import Value, sqrt, where


class Complex(NamedTuple):
    """A complex number of a tape that is being written."""

    re: Value
    im: Value | None
    """None where it is known to be zero."""


def complex_tape(tape: Tape) -> Tape:
    """The tape for complex numbers: re and im of input 0, of input 1 …; outputs likewise.

    Args:
        tape: real operations and functions, neither fused nor written out.

    Raises:
        ConfigurationError: the tape has an operation without a meaning here: those on bits, fused
            ones, and erf.
    """
    builder = Builder(2 * tape.inputs)
    slots = [Value.input(builder, k) for k in range(2 * tape.inputs)]
    inputs = [Complex(re, im) for re, im in zip(slots[::2], slots[1::2], strict=True)]
    outputs: list[Complex] = evaluate(tape, _Lanes(builder), inputs)
    return builder.tape([part.number for z in outputs for part in (z.re, _imaginary(z))])


class _Lanes:
    """The arithmetic of complex values; truth values are those of a real tape."""

    def __init__(self, builder: Builder) -> None:
        self.builder = builder

    def __getattr__(self, op: str) -> NoReturn:
        raise ConfigurationError(
            f"the operation {op!r} has no meaning for complex numbers; leave it out of the tape"
        )

    def constant(self, value: float) -> Complex:
        return Complex(Value(self.builder, self.builder.constant(value)), None)

    def flag(self, value: bool) -> Value:
        return Value(self.builder, self.builder.flag(value))

    def add(self, a: Complex, b: Complex) -> Complex:
        return Complex(a.re + b.re, _plus(a.im, b.im))

    def sub(self, a: Complex, b: Complex) -> Complex:
        return Complex(a.re - b.re, _plus(a.im, None if b.im is None else -b.im))

    def mul(self, a: Complex, b: Complex) -> Complex:
        re, im = a.re * b.re, _plus(_times(a.re, b.im), _times(a.im, b.re))
        return Complex(re if a.im is None or b.im is None else re - a.im * b.im, im)

    def div(self, a: Complex, b: Complex) -> Complex:
        """Smith 1962: with |d| ≤ |c| and r = d/c the divisor c + i d is (c + d r) / (1 - i r).

        Where |c| < |d| both numbers are turned by -i first.
        """
        if b.im is None:
            return Complex(a.re / b.re, None if a.im is None else a.im / b.re)
        x, y = a.re, _imaginary(a)
        turned = abs(b.re) < abs(b.im)
        x, y = where(turned, y, x), where(turned, -x, y)
        c, d = where(turned, b.im, b.re), where(turned, -b.re, b.im)
        r = d / c
        divisor = d * r + c
        return Complex((y * r + x) / divisor, (y - x * r) / divisor)

    def neg(self, a: Complex) -> Complex:
        return Complex(-a.re, None if a.im is None else -a.im)

    def abs(self, a: Complex) -> Complex:
        return Complex(abs(a.re), None if a.im is None else where(a.re < 0.0, -a.im, a.im))

    def floor(self, a: Complex) -> Complex:
        return Complex(a.re.emit("floor"), None)

    def sqrt(self, a: Complex) -> Complex:
        if _stays_real(a, 0.0, math.inf):
            return Complex(sqrt(a.re), None)
        return Complex(*_root(a.re, _imaginary(a)))

    # truth values

    def less(self, a: Complex, b: Complex) -> Value:
        return a.re < b.re

    def less_equal(self, a: Complex, b: Complex) -> Value:
        return a.re <= b.re

    def equal(self, a: Complex, b: Complex) -> Value:
        return a.re.equals(b.re)

    def not_(self, a: Value) -> Value:
        return ~a

    def and_(self, a: Value, b: Value) -> Value:
        return a & b

    def or_(self, a: Value, b: Value) -> Value:
        return a | b

    def select(self, condition: Value, a: Complex, b: Complex) -> Complex:
        re = where(condition, a.re, b.re)
        if a.im is None and b.im is None:
            return Complex(re, None)
        return Complex(re, where(condition, _imaginary(a), _imaginary(b)))

    # exponentials

    def exp(self, a: Complex) -> Complex:
        size = a.re.emit("exp")
        if a.im is None:
            return Complex(size, None)
        return Complex(size * a.im.emit("cos"), size * a.im.emit("sin"))

    def expm1(self, a: Complex) -> Complex:
        """(exp x - 1) cos y - 2 sin² y/2 + i exp x sin y."""
        grown = a.re.emit("expm1")
        if a.im is None:
            return Complex(grown, None)
        half = (a.im * 0.5).emit("sin")
        re = grown * a.im.emit("cos") - half * (half + half)
        return Complex(re, a.re.emit("exp") * a.im.emit("sin"))

    def log(self, a: Complex) -> Complex:
        if _stays_real(a, 0.0, math.inf):
            return Complex(a.re.emit("log"), None)
        larger, ratio = _by_size(a.re, _imaginary(a))
        rest = (ratio * ratio).emit("log1p") * 0.5
        return Complex(larger.emit("log") + rest, _angle(a.re, _imaginary(a)))

    def log1p(self, a: Complex) -> Complex:
        """As the logarithm, but with log1p x for the real part alone where that is the larger."""
        if _stays_real(a, -1.0, math.inf):
            return Complex(a.re.emit("log1p"), None)
        x, y = a.re + 1.0, _imaginary(a)
        larger, ratio = _by_size(x, y)
        rest = (ratio * ratio).emit("log1p") * 0.5
        most = where(abs(y) <= x, a.re.emit("log1p"), larger.emit("log"))
        return Complex(most + rest, _angle(x, y))

    def pow(self, a: Complex, b: Complex) -> Complex:
        """exp(b log a), with the size of a to the real part of b as a real power."""
        size, angle = a.re, None
        if not _stays_real(a, 0.0, math.inf):
            size, angle = _size(a.re, _imaginary(a)), _angle(a.re, _imaginary(a))
        power, turn = size.emit("pow", b.re), _times(b.re, angle)
        if b.im is not None:
            turn = _plus(turn, b.im * where(size.equals(0.0), 1.0, size).emit("log"))
        if b.im is not None and angle is not None:
            power = power * (-(b.im * angle)).emit("exp")
        if turn is None:
            return Complex(power, None)
        return Complex(power * turn.emit("cos"), power * turn.emit("sin"))

    # circular and hyperbolic functions

    def sin(self, a: Complex) -> Complex:
        if a.im is None:
            return Complex(a.re.emit("sin"), None)
        re = a.re.emit("sin") * a.im.emit("cosh")
        return Complex(re, a.re.emit("cos") * a.im.emit("sinh"))

    def cos(self, a: Complex) -> Complex:
        if a.im is None:
            return Complex(a.re.emit("cos"), None)
        re = a.re.emit("cos") * a.im.emit("cosh")
        return Complex(re, -(a.re.emit("sin") * a.im.emit("sinh")))

    def tan(self, a: Complex) -> Complex:
        if a.im is None:
            return Complex(a.re.emit("tan"), None)
        return Complex(*_tangent(a.re, a.im))

    def sinh(self, a: Complex) -> Complex:
        if a.im is None:
            return Complex(a.re.emit("sinh"), None)
        re = a.re.emit("sinh") * a.im.emit("cos")
        return Complex(re, a.re.emit("cosh") * a.im.emit("sin"))

    def cosh(self, a: Complex) -> Complex:
        if a.im is None:
            return Complex(a.re.emit("cosh"), None)
        re = a.re.emit("cosh") * a.im.emit("cos")
        return Complex(re, a.re.emit("sinh") * a.im.emit("sin"))

    def tanh(self, a: Complex) -> Complex:
        """-i tan(i z): the two parts trade places."""
        if a.im is None:
            return Complex(a.re.emit("tanh"), None)
        im, re = _tangent(a.im, a.re)
        return Complex(re, im)

    # inverse functions: Kahan 1987, with the conjugate of √(1 - z)

    def asin(self, a: Complex) -> Complex:
        if _stays_real(a, -1.0, 1.0):
            return Complex(a.re.emit("asin"), None)
        (p, q), (r, s) = _roots_about_one(a)
        return Complex((a.re / (p * r + q * s)).emit("atan"), _asinh(p * s + q * r))

    def acos(self, a: Complex) -> Complex:
        if _stays_real(a, -1.0, 1.0):
            return Complex(a.re.emit("acos"), None)
        (p, q), (r, s) = _roots_about_one(a)
        half = (p / r).emit("atan")
        return Complex(half + half, -_asinh(p * s + q * r))

    def atan(self, a: Complex) -> Complex:
        """(log(1 + i z) - log(1 - i z)) / 2 i, whose terms have equal signs in either part."""
        if a.im is None:
            return Complex(a.re.emit("atan"), None)
        x, y, size = a.re, a.im, abs(a.im)
        re = (_angle(1.0 - y, x) + _angle(y + 1.0, x)) * 0.5
        gap = 1.0 - size
        im = (4.0 * size / (x * x + gap * gap)).emit("log1p") * 0.25
        return Complex(re, where(y < 0.0, -im, im))

    def atan2(self, a: Complex, b: Complex) -> Complex:
        """The angle of the real parts, then atan of what is left after a turn by that angle.

        With a = y + i η, b = x + i ξ, the larger of |x|, |y| called m, and c = x/m, s = y/m,
        what is left is i (η c - ξ s) / (m (c² + s²) + i (ξ c + η s)). Where an imaginary part is
        larger than m, digits cancel, and the branch is not the principal one everywhere.
        """
        angle = Complex(a.re.emit("atan2", b.re), None)
        if a.im is None and b.im is None:
            return angle
        y, x, larger = _imaginary(a), _imaginary(b), _larger(abs(a.re), abs(b.re))
        nowhere = larger.equals(0.0)
        m = where(nowhere, 1.0, larger)
        c, s = b.re / m, a.re / m
        length = where(nowhere, 1.0, m * (c * c + s * s))
        across = Complex(a.re.like(0.0), y * c - x * s)
        return self.add(angle, self.atan(self.div(across, Complex(length, x * c + y * s))))


def _imaginary(z: Complex) -> Value:
    return z.re.like(0.0) if z.im is None else z.im


def _plus(a: Value | None, b: Value | None) -> Value | None:
    if a is None or b is None:
        return a if b is None else b
    return a + b


def _times(a: Value | None, b: Value | None) -> Value | None:
    return None if a is None or b is None else a * b


def _stays_real(z: Complex, lowest: float, highest: float) -> bool:
    """Whether z is a real constant of a range in which a function has real values."""
    value = z.re.builder.constant_of(z.re.number)
    return z.im is None and value is not None and lowest <= value <= highest


def _larger(a: Value, b: Value) -> Value:
    return where(a < b, b, a)


def _by_size(x: Value, y: Value) -> tuple[Value, Value]:
    """The larger of |x|, |y|, and the smaller divided by it; zero for the quotient of zeros."""
    x, y = abs(x), abs(y)
    larger, smaller = _larger(x, y), where(x < y, x, y)
    return larger, smaller / where(larger.equals(0.0), 1.0, larger)


def _size(x: Value, y: Value) -> Value:
    """|x + i y|."""
    larger, ratio = _by_size(x, y)
    return larger * sqrt(ratio * ratio + 1.0)


def _angle(x: Value, y: Value) -> Value:
    """The angle of x + i y from -π, exclusive: -0 becomes 0."""
    return (y + 0.0).emit("atan2", x)


def _root(x: Value, y: Value) -> tuple[Value, Value]:
    """√(x + i y): t = √((|x| + |z|) / 2) is the larger part, and |y| / 2 t the other one."""
    larger, ratio = _by_size(x, y)
    share = where(abs(x) < abs(y), ratio, 1.0)  # |x| over the larger part; next |z| over it
    t = sqrt(larger * (share * 0.5 + sqrt(ratio * ratio + 1.0) * 0.5))
    other = y / where(t.equals(0.0), 1.0, t + t)
    left = x < 0.0
    return where(left, abs(other), t), where(left, where(y < 0.0, -t, t), other)


def _roots_about_one(z: Complex) -> tuple[tuple[Value, Value], tuple[Value, Value]]:
    """Parts of the conjugate of √(1 - z) and of √(1 + z): imaginary parts of equal signs."""
    y = _imaginary(z)
    return _root(1.0 - z.re, y), _root(z.re + 1.0, y)


def _tangent(x: Value, y: Value) -> tuple[Value, Value]:
    """tan(x + i y) from t = tan x and T = tanh y: (t / cosh² y + i T (1 + t²)) / (1 + t² T²)."""
    t, T, narrow = x.emit("tan"), y.emit("tanh"), 1.0 / y.emit("cosh")
    square, both = t * t, t * T
    divisor = both * both + 1.0
    return t * narrow * narrow / divisor, T * (square + 1.0) / divisor


def _asinh(s: Value) -> Value:
    """log(|s| + √(s² + 1)) with the sign of s; √ gives way to |s| where s² has no room."""
    size = abs(s)
    share = where(size < 1e100, size / (sqrt(size * size + 1.0) + 1.0), 1.0)
    result = (size * share + size).emit("log1p")
    return where(s < 0.0, -result, result)
