"""Polynomials of degree two at most in a mechanism's unknowns, with scalars as coefficients.

Coefficients are floats or CasADi SX: numbers for one state, symbols for a model. Exact zeros are
left out, as in `algebra`.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

from gough import algebra as al
from gough.algebra import Scalar

Monomial = tuple[int, ...]
"""Indices of the unknowns in a product, ascending; () is 1."""


class Polynomial:
    """Sum of coefficient × product of unknowns; immutable.

    Attributes:
        terms: the coefficient of each monomial.
    """

    __slots__ = ("terms",)

    def __init__(self, terms: Mapping[Monomial, Scalar]) -> None:
        self.terms = {key: value for key, value in terms.items() if not _is_zero(value)}

    @classmethod
    def constant(cls, value: Scalar) -> Polynomial:
        """A polynomial of degree zero."""
        return cls({(): value})

    @classmethod
    def unknown(cls, index: int) -> Polynomial:
        """An unknown itself."""
        return cls({(index,): 1.0})

    @property
    def degree(self) -> int:
        """The most unknowns in one product."""
        return max(map(len, self.terms), default=0)

    @property
    def unknowns(self) -> set[int]:
        """Every unknown that occurs."""
        return {index for key in self.terms for index in key}

    def coefficient(self, *key: int) -> Scalar:
        """The coefficient of a monomial, 0 where it does not occur."""
        return self.terms.get(key, 0.0)

    def __add__(self, other: Polynomial) -> Polynomial:
        terms = dict(self.terms)
        for key, value in other.terms.items():
            terms[key] = al.add(terms.get(key, 0.0), value)
        return Polynomial(terms)

    def __sub__(self, other: Polynomial) -> Polynomial:
        return self + other.scaled(-1.0)

    def __mul__(self, other: Polynomial) -> Polynomial:
        terms: dict[Monomial, Scalar] = {}
        for a, x in self.terms.items():
            for b, y in other.terms.items():
                key = tuple(sorted(a + b))
                terms[key] = al.add(terms.get(key, 0.0), al.mul(x, y))
        product = Polynomial(terms)
        if product.degree > 2:
            raise DegreeError("a product of unknowns has more than two factors")
        return product

    def scaled(self, factor: Scalar) -> Polynomial:
        """The polynomial times a scalar."""
        return Polynomial({key: al.mul(factor, value) for key, value in self.terms.items()})

    def substituted(self, values: Mapping[int, Polynomial]) -> Polynomial:
        """The polynomial with unknowns replaced by polynomials."""
        if not self.unknowns & values.keys():
            return self
        result = Polynomial({})
        for key, value in self.terms.items():
            product = Polynomial.constant(value)
            for index in key:
                product = product * values.get(index, Polynomial.unknown(index))
            result = result + product
        return result

    def value(self, numbers: Sequence[Scalar] | Mapping[int, Scalar]) -> Scalar:
        """The scalar it comes to for given unknowns."""
        return al.total([_product(c, [numbers[k] for k in key]) for key, c in self.terms.items()])


class DegreeError(ValueError):
    """A polynomial of degree three or more came up."""


Vector = tuple[Polynomial, ...]
ZERO = Polynomial({})


def dot(a: Vector, b: Vector) -> Polynomial:
    """a·b."""
    return total(x * y for x, y in zip(a, b, strict=True))


def plus(*vectors: Vector) -> Vector:
    """Sum of vectors."""
    return tuple(total(parts) for parts in zip(*vectors, strict=True))


def minus(a: Vector, b: Vector) -> Vector:
    """a - b."""
    return tuple(x - y for x, y in zip(a, b, strict=True))


def scaled(factor: Scalar, v: Vector) -> Vector:
    """A scalar times a vector."""
    return tuple(x.scaled(factor) for x in v)


def cross(a: Vector, b: Vector) -> Vector:
    """a × b in space."""
    pairs = ((1, 2), (2, 0), (0, 1))
    return tuple(a[i] * b[k] - a[k] * b[i] for i, k in pairs)


def total(terms: Iterable[Polynomial]) -> Polynomial:
    """Sum of polynomials."""
    result = ZERO
    for term in terms:
        result = result + term
    return result


def _product(c: Scalar, factors: Sequence[Scalar]) -> Scalar:
    for factor in factors:
        c = al.mul(c, factor)
    return c


def _is_zero(x: Scalar) -> bool:
    return al.is_number(x) and x == 0
