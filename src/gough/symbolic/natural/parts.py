"""What natural coordinates are of: clusters, classes of orientation, links, conditions."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from gough import algebra as al
from gough.algebra import Matrix, Scalar, Transform
from gough.joints.base import Dimensions
from gough.symbolic.polynomials import Polynomial, Vector

Array = NDArray[np.float64]
Probe = Callable[[Sequence[Scalar]], Array]
"""Numbers of some scalars at a few states, (states, scalars): what is zero there is zero."""

ZERO = 1e-11
"""Size of a term, relative to its equation's, that is zero but for rounding."""
PIVOT = 1e-6
"""Least size of a term, relative to its equation's, that an equation is solved for."""
SMALL = 1e-9
"""Sines and cosines below this are zero, and lengths over the characteristic length."""

Kind = Literal["position", "displacement", "slide", "angle", "vector", "platform", "pose"]
ORDER: tuple[Kind, ...] = (
    "position", "displacement", "vector", "slide", "angle", "platform", "pose",
)  # fmt: skip
"""Which unknowns linear equations are solved for first; the platform's stay longest."""


@dataclass(frozen=True)
class Unknown:
    """One scalar unknown."""

    owner: str
    """The cluster, class or joint it belongs to."""
    name: str
    kind: Kind
    size: Scalar = None
    """The length of its vector; None where the characteristic length, or 1 for an angle, tells."""


@dataclass
class Cluster:
    """Bodies that known joints tie together."""

    name: str
    places: dict[str, Transform]
    """T_cluster_body of each body."""
    turn: Matrix = al.IDENTITY
    """R_class_cluster."""
    family: int = 0
    """Its class of orientation."""
    reference: al.Vector | None = None
    """The point of its position, in cluster axes."""
    position: Vector = ()
    """Coordinates of the reference point in base axes."""


@dataclass
class Family:
    """A class of orientation.

    Attributes:
        axis: for a class that turns about a known axis, (R_base_joint, R_class_joint) with that
            axis as z; None otherwise.
        wanted: vectors in class axes that equations need.
        basis: those that are unknowns, in class axes.
        images: the same in base axes.
        free_length: whether the only vector has an unknown length, which a slide gives it.
    """

    name: str
    rests: bool = False
    axis: tuple[Matrix, Matrix] | None = None
    wanted: list[al.Vector] = field(default_factory=list)
    basis: list[al.Vector] = field(default_factory=list)
    images: list[Vector] = field(default_factory=list)
    pair: tuple[int, int] | None = None
    """Unknowns c and s."""
    free_length: bool = False
    spin: str = ""
    """The universal joint that the spin about the only vector satisfies."""


@dataclass(frozen=True, eq=False)
class Link:
    """A joint or constraint with unknown position, between frames of two clusters."""

    name: str
    type: str
    bodies: tuple[str, str]
    frames: tuple[Transform, Transform]
    dimensions: Dimensions


@dataclass(frozen=True)
class Condition:
    """One equation of the unknowns, zero where the mechanism is closed."""

    polynomial: Polynomial
    source: str
    """The joint, or the body whose shape it keeps."""
    kind: Literal["joint", "shape"]
    length: Scalar = None
    """For the squared length of a vector: the length it keeps, m."""
    scale: float = 0.0
    """Size of what it says is zero: of its largest term, or of a length or a direction where its
    terms are but rounding."""


class Probing:
    """What scalars and vectors are at a few states: zero, constant, independent.

    Args:
        probe: numbers of scalars at the states.
        length: the characteristic length, m.
    """

    def __init__(self, probe: Probe, length: float) -> None:
        self.probe, self.length = probe, length

    def directions(self, vectors: Sequence[al.Vector]) -> Array:
        """Vectors by their own size, (states, vectors, 3); 0 where they are nothing."""
        if not vectors:
            return np.zeros((1, 0, 3))
        found = self.probe([x for v in vectors for x in v]).reshape(-1, len(vectors), 3)
        size = np.linalg.norm(found, axis=2, keepdims=True)
        nothing = size <= SMALL * min(self.length, 1.0)
        return np.where(nothing, 0.0, found / np.where(nothing, 1.0, size))

    def normal(self, a: al.Vector, b: al.Vector) -> bool:
        """Whether two vectors are normal to each other at every state, or one is nothing."""
        one, other = np.moveaxis(self.directions([a, b]), 1, 0)
        return bool(np.max(np.abs(np.sum(one * other, axis=1))) <= SMALL)

    def parallel(self, a: al.Vector, b: al.Vector) -> bool:
        """Whether two vectors are parallel at every state, or one is nothing."""
        one, other = np.moveaxis(self.directions([a, b]), 1, 0)
        return bool(np.max(np.abs(np.cross(one, other))) <= SMALL)

    def rank(self, vectors: Sequence[al.Vector]) -> int:
        """The most independent vectors at any state."""
        stacks = self.directions(vectors)
        if not stacks.size:
            return 0
        return max(int(np.linalg.matrix_rank(stack, tol=SMALL)) for stack in stacks)

    def plain(self, scalars: Sequence[Scalar]) -> list[Scalar]:
        """The scalars, as numbers where they are the same at every state."""
        found = self.probe(scalars)
        constant = np.ptp(found, axis=0) <= 1e-13 * (1.0 + np.abs(found[0]))
        means = [_rounded(float(x)) for x in found[0]]
        return [m if same else x for m, same, x in zip(means, constant, scalars, strict=True)]


def _rounded(x: float) -> float:
    """x, or the whole number it is but for rounding."""
    return float(round(x)) if abs(x - round(x)) < 1e-13 else x
