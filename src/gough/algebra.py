"""Vectors and rotations over any scalars, numbers or symbols, as plain nested tuples.

A scalar is a float or anything with arithmetic and the methods ``cos``, ``sin``, ``sqrt`` …
(a CasADi SX). Exact zeros and ones are propagated, so that what is constant or absent costs
nothing in an expression built from these functions. ``R`` below is a 3×3 rotation by rows;
``T = (R, p)`` maps coordinates of a frame b to coordinates of a frame a: x_a = R x_b + p.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

Scalar = Any
Vector = tuple[Scalar, Scalar, Scalar]
Matrix = tuple[Vector, Vector, Vector]
Transform = tuple[Matrix, Vector]

ZERO: Vector = (0.0, 0.0, 0.0)
X: Vector = (1.0, 0.0, 0.0)
Y: Vector = (0.0, 1.0, 0.0)
Z: Vector = (0.0, 0.0, 1.0)
AXES = {"x": X, "y": Y, "z": Z}
IDENTITY: Matrix = (X, Y, Z)
HERE: Transform = (IDENTITY, ZERO)

ROUNDING = 1e-15
"""Entries of rotations nearer to 0, 1 or -1 than this are that number: cos(pi/2) is 0."""


def is_number(x: Scalar) -> bool:
    """Whether a scalar is a plain number and not a symbol."""
    return isinstance(x, int | float)


def apply(function: str, x: Scalar) -> Scalar:
    """A function of one variable that `math` knows, of a number or a symbol."""
    if is_number(x):
        try:
            return getattr(math, function)(x)
        except ValueError:
            raise ValueError(f"{function}({x:.6g}) is not defined") from None
    return getattr(x, {"asin": "arcsin", "acos": "arccos"}.get(function, function))()


def atan2(y: Scalar, x: Scalar) -> Scalar:
    """Angle of the vector (x, y) from the x axis, in rad."""
    if is_number(y) and is_number(x):
        return math.atan2(y, x)
    return x.__rarctan2__(y) if is_number(y) else y.__arctan2__(x)


def cos(x: Scalar) -> Scalar:
    """Cosine of an angle in rad."""
    return apply("cos", x)


def sin(x: Scalar) -> Scalar:
    """Sine of an angle in rad."""
    return apply("sin", x)


def sqrt(x: Scalar) -> Scalar:
    """Square root."""
    return apply("sqrt", x)


def exp(x: Scalar) -> Scalar:
    """e to the power x."""
    return apply("exp", x)


def tanh(x: Scalar) -> Scalar:
    """Hyperbolic tangent."""
    return apply("tanh", x)


def erf(x: Scalar) -> Scalar:
    """Error function."""
    return apply("erf", x)


def absolute(x: Scalar) -> Scalar:
    """|x|."""
    return apply("fabs", x)


def maximum(a: Scalar, b: Scalar) -> Scalar:
    """The larger of two."""
    if is_number(a) and is_number(b):
        return max(a, b)
    return b.fmax(a) if is_number(a) else a.fmax(b)


def minimum(a: Scalar, b: Scalar) -> Scalar:
    """The smaller of two."""
    if is_number(a) and is_number(b):
        return min(a, b)
    return b.fmin(a) if is_number(a) else a.fmin(b)


def mul(a: Scalar, b: Scalar) -> Scalar:
    """a b."""
    if is_number(a):
        a, b = b, a
    if is_number(b):
        if b == 0:
            return 0.0
        if b == 1:
            return a
        if b == -1:
            return -a
    return a * b


def add(a: Scalar, b: Scalar) -> Scalar:
    """a + b."""
    if is_number(a) and a == 0:
        return b
    if is_number(b) and b == 0:
        return a
    return a + b


def sub(a: Scalar, b: Scalar) -> Scalar:
    """a - b."""
    if is_number(b) and b == 0:
        return a
    return -b if is_number(a) and a == 0 else a - b


def total(terms: Sequence[Scalar]) -> Scalar:
    """Sum of the terms."""
    result: Scalar = 0.0
    for term in terms:
        result = add(result, term)
    return result


def scale(k: Scalar, v: Vector) -> Vector:
    """k v."""
    return (mul(k, v[0]), mul(k, v[1]), mul(k, v[2]))


def plus(a: Vector, b: Vector) -> Vector:
    """a + b."""
    return (add(a[0], b[0]), add(a[1], b[1]), add(a[2], b[2]))


def minus(a: Vector, b: Vector) -> Vector:
    """a - b."""
    return (sub(a[0], b[0]), sub(a[1], b[1]), sub(a[2], b[2]))


def dot(a: Sequence[Scalar], b: Sequence[Scalar]) -> Scalar:
    """a·b."""
    return total([mul(x, y) for x, y in zip(a, b, strict=True)])


def cross(a: Vector, b: Vector) -> Vector:
    """a × b."""
    return (
        sub(mul(a[1], b[2]), mul(a[2], b[1])),
        sub(mul(a[2], b[0]), mul(a[0], b[2])),
        sub(mul(a[0], b[1]), mul(a[1], b[0])),
    )


def norm(v: Vector) -> Scalar:
    """|v|."""
    return sqrt(dot(v, v))


def unit(v: Vector) -> Vector:
    """v / |v|."""
    return scale(1.0 / norm(v), v)


def transpose(R: Matrix) -> Matrix:
    """Rᵀ."""
    return ((R[0][0], R[1][0], R[2][0]), (R[0][1], R[1][1], R[2][1]), (R[0][2], R[1][2], R[2][2]))


def column(R: Matrix, k: int) -> Vector:
    """Column k of R: the image of axis k."""
    return (R[0][k], R[1][k], R[2][k])


def turn(R: Matrix, v: Vector) -> Vector:
    """R v."""
    return (dot(R[0], v), dot(R[1], v), dot(R[2], v))


def matmul(A: Matrix, B: Matrix) -> Matrix:
    """A B."""
    columns = transpose(B)
    return tuple(tuple(dot(row, col) for col in columns) for row in A)  # type: ignore[return-value]


def snap(x: Scalar) -> Scalar:
    """x, or 0, 1 or -1 where x is that number but for rounding."""
    if is_number(x):
        for exact in (0.0, 1.0, -1.0):
            if abs(x - exact) < ROUNDING:
                return exact
    return x


def rotation_about(axis: str, angle: Scalar) -> Matrix:
    """Rotation by an angle (rad) about the axis x, y or z."""
    c, s = snap(cos(angle)), snap(sin(angle))
    if axis == "x":
        return (X, (0.0, c, -s), (0.0, s, c))
    if axis == "y":
        return ((c, 0.0, s), Y, (-s, 0.0, c))
    return ((c, -s, 0.0), (s, c, 0.0), Z)


def rotation_from_quaternion_wxyz(q: Sequence[Scalar]) -> Matrix:
    """Rotation of the unit quaternion (w, x, y, z)."""
    w, x, y, z = q
    two = 2.0
    return (
        (1.0 - two * (y * y + z * z), two * (x * y - w * z), two * (x * z + w * y)),
        (two * (x * y + w * z), 1.0 - two * (x * x + z * z), two * (y * z - w * x)),
        (two * (x * z - w * y), two * (y * z + w * x), 1.0 - two * (x * x + y * y)),
    )


def from_columns(x: Vector, y: Vector, z: Vector) -> Matrix:
    """The matrix with the columns x, y, z."""
    return transpose((x, y, z))


def compose(first: Transform, second: Transform) -> Transform:
    """T_a_c from T_a_b and T_b_c."""
    (R, p), (S, q) = first, second
    return matmul(R, S), plus(p, turn(R, q))


def inverse(T: Transform) -> Transform:
    """T_b_a from T_a_b."""
    R, p = T
    back = transpose(R)
    return back, scale(-1.0, turn(back, p))


def point(T: Transform, x: Vector) -> Vector:
    """Coordinates in a of the point x given in b."""
    return plus(T[1], turn(T[0], x))
