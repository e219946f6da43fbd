"""Closure equations in natural coordinates: points and vectors of the bodies, at most quadratic.

Bodies that known joints tie together form clusters; clusters that can not turn against each other
form classes of orientation. Unknown are the position of a reference point of each cluster and, for
each class, just the vectors that its joints take hold of (García de Jalón and Bayo 1994, ch. 2):

- a class at rest has none;
- a class that turns about a known axis has the cosine and sine of its angle, c² + s² = 1;
- any other has one, two or three vectors with known products u·v. Three are an orthonormal basis
  u, v, w = u × v, so that mirror images are left out.

A joint then says that points coincide, that directions agree, or that directions are normal to each
other. All of this is linear in the unknowns but for products of vectors. What a passive joint's
spin about the only vector of a body can always satisfy is left out: it changes no pose of others,
and would only double every solution.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from gough import algebra as al
from gough.algebra import Matrix, Scalar, Transform
from gough.description.values import Values
from gough.joints.free import TRANSLATIONS
from gough.symbolic import polynomials as po
from gough.symbolic.natural.elimination import Elimination
from gough.symbolic.natural.gathering import Gathering
from gough.symbolic.natural.needs import Needs
from gough.symbolic.natural.parts import (
    Cluster,
    Condition,
    Family,
    Kind,
    Link,
    Probe,
    Probing,
    Unknown,
)
from gough.symbolic.polynomials import Polynomial, Vector
from gough.topology import Structure


class NaturalClosure:
    """Unknowns and equations of one mechanism with some joints, or the platform, known.

    Args:
        structure: the mechanism.
        values: its parameters, numbers or symbols.
        nominal: the same as numbers.
        known: positions of joints by name; actuated ones for the direct problem.
        pose: T_base_platform where that is known, for the inverse problem.
        turn: R_base_platform where only that is known, of a platform that keeps its orientation.
        probe: numbers of scalars at a few states.
        length: the characteristic length, m.

    Attributes:
        unknowns: every unknown, eliminated ones too.
        solved: the unknowns that linear equations gave, in terms of those left.
        conditions: the equations left.
        sizes: what each unknown is a multiple of.
        checks: equations without unknowns left: conditions on what is known.
        flips: classes whose angle only one homogeneous equation asks for, with that equation.
        stretched: slides whose length makes up for any distance of their ends, by their class.

    Raises:
        ConfigurationError: a joint or a coupling is not algebraic.
    """

    def __init__(
        self,
        structure: Structure,
        values: Values,
        nominal: Values,
        known: Mapping[str, Sequence[Scalar]],
        probe: Probe,
        length: float,
        pose: Transform | None = None,
        turn: Matrix | None = None,
    ) -> None:
        self.structure, self.probing = structure, Probing(probe, length)
        self.gathering = Gathering(structure, values, nominal, known, self.probing, pose, turn)
        self.needs = Needs(self.gathering)
        self.clusters, self.families = self.gathering.clusters, self.gathering.families
        self.links, self.planar = self.gathering.links, self.gathering.planar
        self.stretched = self.needs.stretched
        self.unknowns: list[Unknown] = []
        self.slides: dict[Link, int] = {}
        self._written: list[Condition] = []
        self._implied: list[Condition] = []
        self._introduce()
        self._write()
        self.sizes = self._sizes()
        left = Elimination(
            self._written, self._implied, self.unknowns, self.sizes, self.families, self.probing
        )
        self.solved, self.conditions, self.checks = left.solved, left.conditions, left.checks
        self.flips, self.keeps_shape = left.flips, left.keeps_shape

    def cluster(self, link: Link, end: int) -> Cluster:
        """The cluster at an end of a link."""
        return self.gathering.cluster(link, end)

    def direction(self, link: Link, end: int, k: int) -> al.Vector:
        """Axis k of a link's frame, in class axes."""
        return self.needs.direction(link, end, k)

    @property
    def of_body(self) -> dict[str, Cluster]:
        """The cluster of each body."""
        return self.gathering.of_body

    # unknowns

    def _new(self, owner: str, name: str, kind: Kind, size: Scalar = None) -> int:
        self.unknowns.append(Unknown(owner, f"{owner}.{name}", kind, size))
        return len(self.unknowns) - 1

    def _introduce(self) -> None:
        for k, family in enumerate(self.families):
            if not family.rests and k not in self.stretched:
                self._give_vectors(family)
        for cluster in self.clusters:
            cluster.position = self._position_of(cluster)

    def _give_vectors(self, family: Family) -> None:
        """Unknown angle or vectors of a class, as many as its wanted vectors need."""
        rank = self.probing.rank(family.wanted)
        if rank == 0 and family.axis is None:
            return
        kind: Kind = "platform" if self._holds_platform(family) else "vector"
        if self.planar and rank == 0:
            return
        if family.axis is not None and not (self.planar and rank == 1):
            axial = al.column(family.axis[1], 2)
            if all(self.probing.parallel(v, axial) for v in family.wanted):
                return
            family.pair = (
                self._new(family.name, "cos", "angle"), self._new(family.name, "sin", "angle")
            )  # fmt: skip
            return
        family.basis = self._basis(family.wanted, rank)
        for n, _ in enumerate(family.basis):
            axes = "xy" if self.planar else "xyz"
            size = al.norm(family.basis[n])
            parts = [
                Polynomial.unknown(self._new(family.name, "uvw"[n] + axis, kind, size))
                for axis in axes
            ]
            family.images.append(tuple(parts) + ((po.ZERO,) if self.planar else ()))

    def _holds_platform(self, family: Family) -> bool:
        platform = self.structure.mechanism.platform
        return platform in self.of_body and self.gathering.family(self.of_body[platform]) is family

    def _basis(self, wanted: Sequence[al.Vector], rank: int) -> list[al.Vector]:
        """The first independent wanted vectors; the axes of the class where they are three."""
        if rank == 3:
            return list(al.IDENTITY)
        basis: list[al.Vector] = []
        for v in wanted:
            if len(basis) < rank and self.probing.rank([*basis, v]) > len(basis):
                basis.append(v)
        return basis

    def _position_of(self, cluster: Cluster) -> Vector:
        if cluster is self.clusters[0]:
            return (po.ZERO,) * 3
        moves = set(TRANSLATIONS)
        kind: Kind = "position"
        for body, free in self.gathering.free_moves().items():
            if self.of_body[body] is cluster:
                moves = set(free)
        if self.structure.mechanism.platform in cluster.places:
            kind = "pose"
        if self.planar:
            moves -= {"z"}
        return tuple(
            Polynomial.unknown(self._new(cluster.name, axis, kind)) if axis in moves
            else po.ZERO
            for axis in TRANSLATIONS
        )  # fmt: skip

    def image(self, family: Family, v: al.Vector) -> Vector:
        """A vector of a class in base axes, linear in the unknowns."""
        if family.rests:
            return tuple(Polynomial.constant(x) for x in v)
        if family.axis is not None and not family.basis:
            return self._turned_image(family, v)
        weights = self._weights(family.basis, v)
        return po.plus((po.ZERO,) * 3, *map(po.scaled, weights, family.images))

    def _turned_image(self, family: Family, v: al.Vector) -> Vector:
        assert family.axis is not None
        x, y, z = al.turn(al.transpose(family.axis[1]), v)
        if family.pair is None:
            turned: Vector = (po.ZERO, po.ZERO, Polynomial.constant(z))
        else:
            c, s = map(Polynomial.unknown, family.pair)
            turned = (
                c.scaled(x) - s.scaled(y), s.scaled(x) + c.scaled(y), Polynomial.constant(z),
            )  # fmt: skip
        R = family.axis[0]
        return tuple(
            po.total(part.scaled(entry) for entry, part in zip(row, turned, strict=True))
            for row in R
        )

    def _weights(self, basis: Sequence[al.Vector], v: al.Vector) -> list[Scalar]:
        """Coordinates of a vector in a basis that spans it; numbers where no state changes them."""
        if len(basis) == 3:
            return list(v)
        if not basis:
            return []
        if len(basis) == 1:
            (g,) = basis
            return self.probing.plain([_quotient(al.dot(v, g), al.dot(g, g))])
        a, b = basis
        aa, ab, bb = al.dot(a, a), al.dot(a, b), al.dot(b, b)
        va, vb = al.dot(v, a), al.dot(v, b)
        det = al.sub(al.mul(aa, bb), al.mul(ab, ab))
        first = al.sub(al.mul(bb, va), al.mul(ab, vb))
        second = al.sub(al.mul(aa, vb), al.mul(ab, va))
        return self.probing.plain([_quotient(first, det), _quotient(second, det)])

    def _sizes(self) -> list[float]:
        """What each unknown is a multiple of: 1 for an angle, else a length."""
        length = self.probing.length
        given = [0.0 if u.size is None else u.size for u in self.unknowns]
        found = self.probing.probe(given)[0] if given else []
        return [
            1.0 if u.kind == "angle" else (length if u.size is None else float(size))
            for u, size in zip(self.unknowns, found, strict=True)
        ]

    # equations

    def _write(self) -> None:
        for family in self.families:
            self._write_shape(family)
        for link in self.links:
            self._write_link(link)

    def _write_shape(self, family: Family) -> None:
        """Products of the vectors of a class."""
        shape: list[tuple[Polynomial, Scalar]] = []
        if family.pair is not None:
            c, s = map(Polynomial.unknown, family.pair)
            shape.append((c * c + s * s - Polynomial.constant(1.0), None))
        if len(family.basis) == 3:
            u, v, w = family.images
            one = Polynomial.constant(1.0)
            shape += [(u_v, None) for u_v in (po.dot(u, u) - one, po.dot(v, v) - one, po.dot(u, v))]
            shape += [(entry, None) for entry in po.minus(w, po.cross(u, v))]
            implied = (po.dot(w, w) - one, po.dot(u, w), po.dot(v, w))
            self._implied += [Condition(entry, family.name, "shape") for entry in implied]
        else:
            for i, a in enumerate(family.basis):
                for k in range(i + 1):
                    product = al.dot(a, family.basis[k])
                    known = Polynomial.constant(product)
                    length = al.sqrt(product) if k == i else None
                    shape.append((po.dot(family.images[i], family.images[k]) - known, length))
        for polynomial, length in shape:
            self._written.append(Condition(polynomial, family.name, "shape", length))

    def _write_link(self, link: Link) -> None:
        if self._stretches(link):
            family = self.gathering.family(self.cluster(link, 0))
            if not self.planar and family.axis is not None:
                self._write_in_plane(link)
            return
        offset = po.minus(self._point(link, 1), self._point(link, 0))
        length = self.probing.length
        for hold in self.gathering.holds(link):
            match hold:
                case "point":
                    self._equate(link, offset, length)
                case "axis":
                    self._equate(link, po.minus(self._axis(link, 1, 2), self._axis(link, 0, 2)), 1)
                case "line":
                    self.slides[link] = self._new(link.name, "length", "slide")
                    slide = Polynomial.unknown(self.slides[link])
                    along = tuple(slide * x for x in self._axis(link, 0, 2))
                    self._equate(link, po.minus(offset, along), length)
                case "level":
                    self._equate(link, (po.dot(self._axis(link, 0, 2), offset),), length)
                case "circle":
                    self._equate(link, (po.dot(self._axis(link, 0, 2), offset),), length)
                    radius = link.dimensions["length"]
                    square = po.dot(offset, offset) - Polynomial.constant(radius * radius)
                    self._written.append(Condition(square, link.name, "joint", radius, length**2))
                case "crossed" if link.name not in self.needs.dropped:
                    x, y = self._axis(link, 0, 0), self._axis(link, 1, 1)
                    self._equate(link, (po.dot(x, y),), 1)

    def _stretches(self, link: Link) -> bool:
        return any(link is slide for slide in self.stretched.values())

    def _write_in_plane(self, link: Link) -> None:
        """The ends of a slide that turns about a known axis stay in a plane normal to it."""
        family = self.gathering.family(self.cluster(link, 0))
        assert family.axis is not None
        normal = tuple(Polynomial.constant(x) for x in al.column(family.axis[0], 2))
        axis = al.column(family.axis[1], 2)
        ends = [
            po.dot(normal, self.cluster(link, end).position)
            + Polynomial.constant(al.dot(axis, self.needs.arm(link, end)))
            for end in (0, 1)
        ]
        self._equate(link, (ends[1] - ends[0],), self.probing.length)

    def _point(self, link: Link, end: int) -> Vector:
        cluster = self.cluster(link, end)
        return po.plus(
            cluster.position, self.image(self.gathering.family(cluster), self.needs.arm(link, end))
        )

    def _axis(self, link: Link, end: int, k: int) -> Vector:
        return self.image(
            self.gathering.family(self.cluster(link, end)), self.direction(link, end, k)
        )

    def _equate(self, link: Link, zeros: Vector, scale: float) -> None:
        """Keep equations; ``scale`` is the size of what they say is zero."""
        kept = zeros[:2] if self.planar and len(zeros) == 3 else zeros
        self._written += [Condition(p, link.name, "joint", scale=scale) for p in kept]

    # values

    def measured(self, poses: Mapping[str, Transform]) -> list[Scalar]:
        """The value of every unknown for given T_base_body of the bodies."""
        values: dict[int, Scalar] = {}
        for cluster in self.clusters[1:]:
            assert cluster.reference is not None
            self._note(values, cluster.position, al.point(poses[cluster.name], cluster.reference))
        for family in self.families[1:]:
            R = poses[family.name][0]
            for vector, image in zip(family.basis, family.images, strict=True):
                self._note(values, image, al.turn(R, vector))
            if family.pair is not None:
                assert family.axis is not None
                near, far = family.axis
                turned = al.matmul(al.matmul(al.transpose(near), R), far)
                values |= dict(zip(family.pair, (turned[0][0], turned[1][0]), strict=True))
        for link, slide in self.slides.items():
            a, b = (
                al.compose(poses[self.cluster(link, end).name], self.gathering.frame(link, end))
                for end in (0, 1)
            )
            values[slide] = al.dot(al.column(a[0], 2), al.minus(b[1], a[1]))
        return [values[k] for k in range(len(self.unknowns))]

    @staticmethod
    def _note(values: dict[int, Scalar], unknowns: Vector, found: al.Vector) -> None:
        """Keep the values of unknowns that are coordinates of a vector."""
        for unknown, value in zip(unknowns, found, strict=True):
            for index in unknown.unknowns:
                values[index] = value


def _quotient(a: Scalar, b: Scalar) -> Scalar:
    return 0.0 if al.is_number(a) and a == 0 else a / b
