"""Eight complex numbers at a time in loops compiled by numba.

In memory eight real parts stand before eight imaginary parts. Number k of a list begins at
2 · 8 · k.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from gough.numerics.calling import part
from gough.numerics.lanes import (
    EIGHT,
    fma,
    load_eight,
    negative,
    splat_eight,
    store,
    where_equal,
    where_more,
)

Pointer = Any
STRIDE = 2 * EIGHT
"""float64 numbers to eight complex ones."""


class Eight(NamedTuple):
    """Eight complex numbers."""

    r: Any
    """Real parts."""
    i: Any
    """Imaginary parts."""


@part
def fetch(numbers: Pointer, k: int) -> Eight:
    """Number k of a list."""
    return Eight(load_eight(numbers, STRIDE * k), load_eight(numbers, STRIDE * k + EIGHT))


@part
def put(numbers: Pointer, k: int, z: Eight) -> None:
    """Write number k of a list."""
    store(numbers, STRIDE * k, z.r)
    store(numbers, STRIDE * k + EIGHT, z.i)


@part
def nought() -> Eight:
    """Zero in every lane."""
    return Eight(splat_eight(0.0), splat_eight(0.0))


@part
def plus(a: Eight, b: Eight) -> Eight:
    """a + b."""
    return Eight(a.r + b.r, a.i + b.i)


@part
def scaled(a: Eight, factor: Any) -> Eight:
    """A times eight real factors."""
    return Eight(a.r * factor, a.i * factor)


@part
def plus_scaled(c: Eight, a: Eight, factor: Any) -> Eight:
    """c + a times eight real factors."""
    return Eight(fma(a.r, factor, c.r), fma(a.i, factor, c.i))


@part
def product(a: Eight, b: Eight) -> Eight:
    """A b."""
    return Eight(fma(a.r, b.r, negative(a.i * b.i)), fma(a.r, b.i, a.i * b.r))


@part
def plus_product(c: Eight, a: Eight, b: Eight) -> Eight:
    """c + a b."""
    return Eight(fma(negative(a.i), b.i, fma(a.r, b.r, c.r)), fma(a.i, b.r, fma(a.r, b.i, c.i)))


@part
def minus_product(c: Eight, a: Eight, b: Eight) -> Eight:
    """C - a b."""
    return Eight(
        fma(a.i, b.i, fma(negative(a.r), b.r, c.r)),
        fma(negative(a.i), b.r, fma(negative(a.r), b.i, c.i)),
    )


@part
def square(a: Eight) -> Any:
    """|a|²."""
    return fma(a.r, a.r, a.i * a.i)


@part
def where_same(a: Any, b: Any, then: Eight, other: Eight) -> Eight:
    """Numbers of ``then`` where the reals a and b are equal, else those of ``other``."""
    return Eight(where_equal(a, b, then.r, other.r), where_equal(a, b, then.i, other.i))


@part
def where_above(a: Any, b: Any, then: Eight, other: Eight) -> Eight:
    """Numbers of ``then`` where the real a is more than b, else those of ``other``."""
    return Eight(where_more(a, b, then.r, other.r), where_more(a, b, then.i, other.i))
