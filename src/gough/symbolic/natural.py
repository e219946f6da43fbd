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

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from gough import algebra as al
from gough.algebra import Matrix, Scalar, Transform
from gough.description import Joint
from gough.description.frames import transform
from gough.description.parts import Constraint
from gough.description.values import Values, scalar
from gough.errors import ConfigurationError
from gough.joints import TYPES
from gough.joints.base import Dimensions
from gough.joints.constraints import CONSTRAINTS
from gough.joints.free import ROTATIONS, TRANSLATIONS, Free
from gough.symbolic import polynomials as po
from gough.symbolic.polynomials import Polynomial, Vector
from gough.topology import Structure

Array = NDArray[np.float64]
Probe = Callable[[Sequence[Scalar]], Array]
"""Numbers of some scalars at a few states, (states, scalars): what is zero there is zero."""

ZERO = 1e-11
"""Size of a coefficient that is zero but for rounding."""
SMALL = 1e-9
"""Components of vectors relative to their size below which they are zero for a probe."""

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

    Attributes:
        unknowns: every unknown, eliminated ones too.
        solved: the unknowns that linear equations gave, in terms of those left.
        conditions: the equations left.
        checks: equations without unknowns left: conditions on what is known.

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
        pose: Transform | None = None,
        turn: Matrix | None = None,
    ) -> None:
        self.structure, self.values, self.nominal = structure, values, nominal
        self.known, self.probe, self.pose, self.turn = known, probe, pose, turn
        self.planar = structure.mechanism.motion == "planar"
        self.unknowns: list[Unknown] = []
        self.solved: dict[int, Polynomial] = {}
        self.conditions: list[Condition] = []
        self.checks: list[Condition] = []
        self.clusters = self._clusters()
        self.of_body = {body: c for c in self.clusters for body in c.places}
        self.links = [link for link in self._links() if self.cluster(link, 0) is not
                      self.cluster(link, 1)]  # fmt: skip
        self.families = self._families()
        self._find_axes()
        self._place_references()
        self.dropped: set[str] = set()
        self.slides: dict[Link, int] = {}
        self.flips: list[tuple[Family, Condition]] = []
        self._want()
        self.stretched: dict[int, Link] = self._stretched()
        self._introduce()
        self._write()
        self._eliminate()

    # clusters

    def _joints(self) -> Iterator[tuple[str, Joint | Constraint]]:
        """Joints and constraints, parallelograms with heavy bars as one joint each."""
        flat = self.structure.flat
        for name, joint in flat.joints.items():
            if name in flat.expanded:
                yield name, flat.expanded[name]
            elif name.rpartition(".")[0] not in flat.expanded:
                yield name, joint
        yield from flat.constraints.items()

    def _frames(self, part: Joint | Constraint) -> tuple[Transform, Transform]:
        a, b = part.frames
        return transform(a, self.values, self.nominal), transform(b, self.values, self.nominal)

    def _clusters(self) -> list[Cluster]:
        """Bodies tied by known joints; that of the base first, in axes of the base."""
        flat, base = self.structure.flat, self.structure.mechanism.base
        bars = {f"{name}.{bar}" for name in flat.expanded for bar in ("bar1", "bar2")}
        ties: dict[str, list[tuple[str, Transform]]] = {b: [] for b in flat.bodies if b not in bars}
        ties.setdefault(base, [])
        for name, part in self._joints():
            across = self._across(name, part)
            if across is not None:
                a, b = part.bodies
                at_a, at_b = self._frames(part)
                T = al.compose(al.compose(at_a, across), al.inverse(at_b))
                ties[a].append((b, T))
                ties[b].append((a, al.inverse(T)))
        platform = self.structure.mechanism.platform
        if self.pose is not None and platform is not None:
            ties[base].append((platform, self.pose))
            ties[platform].append((base, al.inverse(self.pose)))
        clusters: list[Cluster] = []
        placed: set[str] = set()
        for body in (base, *ties):
            if body not in placed:
                clusters.append(Cluster(body, _reach(body, ties)))
                placed |= clusters[-1].places.keys()
        return clusters

    def _across(self, name: str, part: Joint | Constraint) -> Transform | None:
        """T_a_b of a joint that is known, else None."""
        if isinstance(part, Constraint):
            return al.HERE if part.type == "frames-coincide" else None
        kind = TYPES[part.type]
        if name in self.known:
            return kind.placement(self.known[name], self._dimensions(part))
        return al.HERE if part.type == "fixed" else None

    def _dimensions(self, part: Joint) -> Dimensions:
        return {key: scalar(value, self.values) for key, value in part.dimensions.items()}

    def _links(self) -> Iterator[Link]:
        for name, part in self._joints():
            if self._across(name, part) is not None:
                continue
            if isinstance(part, Joint) and not TYPES[part.type].algebraic:
                raise ConfigurationError(
                    f"joint {name!r} is {part.type}: its angle is also a length, so its equations "
                    "have no end of solutions; they can not be counted"
                )
            a, b = self._frames(part)
            dimensions = self._dimensions(part) if isinstance(part, Joint) else {}
            yield Link(name, part.type, part.bodies, (a, b), dimensions)
        flat = self.structure.flat
        for name in flat.couplings:
            if name.rpartition(".")[0] not in flat.expanded:
                raise ConfigurationError(
                    f"coupling {name!r} ties angles or lengths of joints; its equations are not "
                    "written as polynomials"
                )

    def cluster(self, link: Link, end: int) -> Cluster:
        return self.of_body[link.bodies[end]]

    def _frame(self, link: Link, end: int) -> Transform:
        """T_cluster_frame of a link's frame."""
        place = self.cluster(link, end).places[link.bodies[end]]
        return al.compose(place, link.frames[end])

    def _holds(self, link: Link) -> tuple[str, ...]:
        holds = CONSTRAINTS[link.type].holds if link.type in CONSTRAINTS else TYPES[link.type].holds
        if self.planar and link.type != "directions-parallel":
            return tuple(hold for hold in holds if hold != "axis")
        return holds

    # classes of orientation

    def _families(self) -> list[Family]:
        """Clusters that links keep from turning against each other, with R_class_cluster."""
        ties: dict[str, list[tuple[str, Transform]]] = {c.name: [] for c in self.clusters}
        for link in self.links:
            if "orientation" in self._holds(link):
                a, b = (self.cluster(link, end).name for end in (0, 1))
                Ra, Rb = (self._frame(link, end)[0] for end in (0, 1))
                R = al.matmul(Ra, al.transpose(Rb))
                ties[a].append((b, (R, al.ZERO)))
                ties[b].append((a, (al.transpose(R), al.ZERO)))
        self._tie_free(ties)
        families: list[Family] = []
        by_name = {c.name: c for c in self.clusters}
        placed: set[str] = set()
        for cluster in self.clusters:
            if cluster.name in placed:
                continue
            members = _reach(cluster.name, ties)
            for name, (R, _) in members.items():
                by_name[name].turn, by_name[name].family = R, len(families)
            placed |= members.keys()
            families.append(Family(cluster.name, rests=not families))
        return families

    def _tie_free(self, ties: dict[str, list[tuple[str, Transform]]]) -> None:
        """Tie free links that only translate, and a platform of known orientation, to the base."""
        base, platform = self.clusters[0].name, self.structure.mechanism.platform
        for body, moves in self._free_moves().items():
            cluster, turn = self.of_body[body], None
            if not set(moves) & set(ROTATIONS) and self.of_body[body] is not self.clusters[0]:
                turn = al.IDENTITY
            if body == platform and self.turn is not None:
                turn = self.turn
            if turn is not None and cluster is not self.clusters[0]:
                R = al.matmul(turn, al.transpose(cluster.places[body][0]))
                ties[base].append((cluster.name, (R, al.ZERO)))
                ties[cluster.name].append((base, (al.transpose(R), al.ZERO)))

    def _free_moves(self) -> dict[str, tuple[str, ...]]:
        """Free links and the coordinates they have."""
        return {
            edge.name: edge.type.moves
            for edge in self.structure.edges
            if edge.link and isinstance(edge.type, Free) and edge.name in self.of_body
        }

    def _find_axes(self) -> None:
        """Find classes that turn about an axis fixed in the base."""
        for family in self.families[1:]:
            if self.planar:
                family.axis = (al.IDENTITY, al.IDENTITY)
        for body, moves in self._free_moves().items():
            turns = [move[1] for move in moves if move in ROTATIONS]
            family = self._family(self.of_body[body])
            if len(turns) == 1 and not family.rests and family.axis is None:
                R = _axis_to_z(turns[0])
                cluster = self.of_body[body]
                own = al.matmul(al.matmul(cluster.turn, cluster.places[body][0]), R)
                family.axis = (R, own)
        while any(self._axis_from(link) for link in self.links):
            pass

    def _axis_from(self, link: Link) -> bool:
        """Give a class its axis where a link ties it to one whose axis is known."""
        if "axis" not in self._holds(link):
            return False
        for near, far in ((0, 1), (1, 0)):
            known, free = (self._family(self.cluster(link, end)) for end in (near, far))
            if free.rests or free.axis is not None or not (known.rests or known.axis):
                continue
            R = self._turned(link, near)
            if not known.rests:
                assert known.axis is not None
                z = al.turn(al.transpose(known.axis[1]), al.column(R, 2))
                if np.max(np.abs(self.probe(z[:2]))) > SMALL:
                    continue
                # the axis stays where it is while the known class turns
                R = al.matmul(known.axis[0], al.matmul(al.transpose(known.axis[1]), R))
            free.axis = (R, self._turned(link, far))
            return True
        return False

    def _turned(self, link: Link, end: int) -> Matrix:
        """R_class_frame of a link's frame."""
        return al.matmul(self.cluster(link, end).turn, self._frame(link, end)[0])

    def _family(self, cluster: Cluster) -> Family:
        return self.families[cluster.family]

    # what equations need

    def _place_references(self) -> None:
        """Choose the point of each cluster whose position is an unknown."""
        self.clusters[0].reference = al.ZERO
        for body in (*self._free_moves(), self.structure.mechanism.platform):
            if body in self.of_body and self.of_body[body].reference is None:
                self.of_body[body].reference = self.of_body[body].places[body][1]
        for link in self.links:
            for end in (0, 1):
                if self.cluster(link, end).reference is None:
                    self.cluster(link, end).reference = self._frame(link, end)[1]
        for cluster in self.clusters:
            cluster.reference = cluster.reference or al.ZERO

    def _arm(self, link: Link, end: int) -> al.Vector:
        """From the reference point to a link's frame, in class axes."""
        cluster = self.cluster(link, end)
        assert cluster.reference is not None
        arm = al.minus(self._frame(link, end)[1], cluster.reference)
        return al.turn(cluster.turn, arm)

    def direction(self, link: Link, end: int, k: int) -> al.Vector:
        """Axis k of a link's frame, in class axes."""
        return al.column(self._turned(link, end), k)

    def _want(self) -> None:
        """Collect the vectors that equations need; leave out what a spin can always satisfy."""
        for link in self.links:
            holds = self._holds(link)
            for end in (0, 1):
                family = self._family(self.cluster(link, end))
                if {"point", "line", "level", "circle"} & set(holds):
                    family.wanted.append(self._arm(link, end))
                if "axis" in holds or (end == 0 and {"level", "circle"} & set(holds)):
                    family.wanted.append(self.direction(link, end, 2))
        for link in self.links:
            if "crossed" in self._holds(link) and not self._spins(link):
                for end, k in ((0, 0), (1, 1)):
                    family = self._family(self.cluster(link, end))
                    family.wanted.append(self.direction(link, end, k))

    def _spins(self, link: Link) -> bool:
        """Whether the spin of a body about its only vector satisfies a universal joint."""
        for end, k in ((1, 1), (0, 0)):
            family = self._family(self.cluster(link, end))
            if family.rests or family.axis is not None or family.spin:
                continue
            lengthwise = [self.direction(e, 0, 2) for e in self.links if self._slides(e, family)]
            vectors = [*family.wanted, *lengthwise]
            if self._rank(vectors) > 1:
                continue
            across = self.direction(link, end, k)
            if all(self.zero(al.dot(across, v)) for v in vectors):
                family.spin = link.name
                self.dropped.add(link.name)
                return True
        return False

    def _slides(self, link: Link, family: Family) -> bool:
        return "line" in self._holds(link) and self._family(self.cluster(link, 0)) is family

    def _stretched(self) -> dict[int, Link]:
        """Classes with a slide whose length makes up for any distance of their ends."""
        found: dict[int, Link] = {}
        for k, family in enumerate(self.families):
            slides = [link for link in self.links if self._slides(link, family)]
            if family.rests or not slides:
                continue
            z = self.direction(slides[0], 0, 2)
            if len(slides) > 1 or "orientation" not in self._holds(slides[0]):
                family.wanted += [self.direction(link, 0, 2) for link in slides]
                continue
            aside = list(family.wanted)
            if family.axis is not None:
                axis = al.column(family.axis[1], 2)
                if not self.zero(al.dot(axis, z)):
                    family.wanted.append(z)
                    continue
                aside = [al.minus(v, al.scale(al.dot(axis, v), axis)) for v in aside]
            if self._rank([z, *aside]) == 1:
                found[k] = slides[0]
            else:
                family.wanted.append(z)
        return found

    def _rank(self, vectors: Sequence[al.Vector]) -> int:
        """The most independent vectors at any probed state."""
        if not vectors:
            return 0
        flat = self.probe([x for v in vectors for x in v])
        stacks = flat.reshape(len(flat), len(vectors), 3)
        return max(int(np.linalg.matrix_rank(stack, tol=SMALL)) for stack in stacks)

    def zero(self, x: Scalar) -> bool:
        return bool(np.max(np.abs(self.probe([x]))) < SMALL)

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
        rank = self._rank(family.wanted)
        if rank == 0 and family.axis is None:
            return
        kind: Kind = "platform" if self._holds_platform(family) else "vector"
        if self.planar and rank == 0:
            return
        if family.axis is not None and not (self.planar and rank == 1):
            axial = al.column(family.axis[1], 2)
            if all(self._parallel(v, axial) for v in family.wanted):
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

    def _parallel(self, v: al.Vector, axis: al.Vector) -> bool:
        return all(self.zero(x) for x in al.cross(v, axis))

    def _holds_platform(self, family: Family) -> bool:
        platform = self.structure.mechanism.platform
        return platform in self.of_body and self._family(self.of_body[platform]) is family

    def _basis(self, wanted: Sequence[al.Vector], rank: int) -> list[al.Vector]:
        """The first wanted vectors that are independent; the axes themselves where all three are."""
        if rank == 3:
            return list(al.IDENTITY)
        basis: list[al.Vector] = []
        for v in wanted:
            if len(basis) < rank and self._rank([*basis, v]) > len(basis):
                basis.append(v)
        return basis

    def _position_of(self, cluster: Cluster) -> Vector:
        if cluster is self.clusters[0]:
            return (po.ZERO,) * 3
        moves = set(TRANSLATIONS)
        kind: Kind = "position"
        for body, free in self._free_moves().items():
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
            return self._plain([_quotient(al.dot(v, g), al.dot(g, g))])
        a, b = basis
        aa, ab, bb = al.dot(a, a), al.dot(a, b), al.dot(b, b)
        va, vb = al.dot(v, a), al.dot(v, b)
        det = al.sub(al.mul(aa, bb), al.mul(ab, ab))
        first = al.sub(al.mul(bb, va), al.mul(ab, vb))
        second = al.sub(al.mul(aa, vb), al.mul(ab, va))
        return self._plain([_quotient(first, det), _quotient(second, det)])

    def _plain(self, scalars: Sequence[Scalar]) -> list[Scalar]:
        """The scalars, as numbers where they are the same at every probed state."""
        found = self.probe(scalars)
        constant = np.ptp(found, axis=0) <= 1e-13 * (1.0 + np.abs(found[0]))
        means = [_rounded(float(x)) for x in found[0]]
        return [m if same else x for m, same, x in zip(means, constant, scalars, strict=True)]

    # equations

    def _write(self) -> None:
        for k, family in enumerate(self.families):
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
        else:
            for i, a in enumerate(family.basis):
                for k in range(i + 1):
                    product = al.dot(a, family.basis[k])
                    known = Polynomial.constant(product)
                    length = al.sqrt(product) if k == i else None
                    shape.append((po.dot(family.images[i], family.images[k]) - known, length))
        for polynomial, length in shape:
            self.conditions.append(Condition(polynomial, family.name, "shape", length))

    def _write_link(self, link: Link) -> None:
        a, b = (self.cluster(link, end) for end in (0, 1))
        if self._stretches(link):
            if not self.planar and self._family(a).axis is not None:
                self._write_in_plane(link)
            return
        offset = po.minus(self._point(link, 1), self._point(link, 0))
        for hold in self._holds(link):
            match hold:
                case "point":
                    self._equate(link, offset)
                case "axis":
                    self._equate(link, po.minus(self._axis(link, 1, 2), self._axis(link, 0, 2)))
                case "line":
                    self.slides[link] = self._new(link.name, "length", "slide")
                    slide = Polynomial.unknown(self.slides[link])
                    along = tuple(slide * x for x in self._axis(link, 0, 2))
                    self._equate(link, po.minus(offset, along))
                case "level":
                    self._equate(link, (po.dot(self._axis(link, 0, 2), offset),))
                case "circle":
                    length = link.dimensions["length"]
                    square = po.dot(offset, offset) - Polynomial.constant(length * length)
                    self._equate(link, (po.dot(self._axis(link, 0, 2), offset),))
                    self.conditions.append(Condition(square, link.name, "joint", length))
                case "crossed" if link.name not in self.dropped:
                    x, y = self._axis(link, 0, 0), self._axis(link, 1, 1)
                    self._equate(link, (po.dot(x, y),))

    def _stretches(self, link: Link) -> bool:
        return any(link is slide for slide in self.stretched.values())

    def _write_in_plane(self, link: Link) -> None:
        """The ends of a slide that turns about a known axis stay in a plane normal to it."""
        family = self._family(self.cluster(link, 0))
        assert family.axis is not None
        normal = tuple(Polynomial.constant(x) for x in al.column(family.axis[0], 2))
        axis = al.column(family.axis[1], 2)
        ends = [
            po.dot(normal, self.cluster(link, end).position)
            + Polynomial.constant(al.dot(axis, self._arm(link, end)))
            for end in (0, 1)
        ]
        self._equate(link, (ends[1] - ends[0],))

    def _point(self, link: Link, end: int) -> Vector:
        cluster = self.cluster(link, end)
        return po.plus(cluster.position, self.image(self._family(cluster), self._arm(link, end)))

    def _axis(self, link: Link, end: int, k: int) -> Vector:
        return self.image(self._family(self.cluster(link, end)), self.direction(link, end, k))

    def _equate(self, link: Link, zeros: Vector) -> None:
        kept = zeros[:2] if self.planar and len(zeros) == 3 else zeros
        self.conditions += [Condition(p, link.name, "joint") for p in kept]

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
                al.compose(poses[self.cluster(link, end).name], self._frame(link, end))
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

    # elimination

    def _eliminate(self) -> None:
        """Solve linear equations whose pivot is a number, the platform's unknowns last."""
        rank = {k: ORDER.index(u.kind) for k, u in enumerate(self.unknowns)}
        while True:
            choice = self._pivot(rank)
            if choice is None:
                break
            condition, index = choice
            pivot = condition.polynomial.coefficient(index)
            rest = condition.polynomial - Polynomial({(index,): pivot})
            value = {index: rest.scaled(-1.0 / pivot)}
            self.conditions.remove(condition)
            self.conditions = [
                replace(c, polynomial=c.polynomial.substituted(value)) for c in self.conditions
            ]
            self.solved = {k: p.substituted(value) for k, p in self.solved.items()} | value
            self._tidy()
        self._tidy()
        for shape in [c for c in self.conditions if self.keeps_shape(c)]:
            self._reduce(shape)
        self._tidy()
        self._drop_repeats()
        self._drop_flips()

    def _reduce(self, shape: Condition) -> None:
        """Take squares and products that the shape of a class knows out of other equations."""
        plain = {k: x for k, x in shape.polynomial.terms.items() if len(k) == 2 and al.is_number(x)}
        if not plain:
            return
        lead, value = next(iter(plain.items()))
        reduced = {
            n: condition.polynomial - shape.polynomial.scaled(x / value)
            for n, condition in enumerate(self.conditions)
            if condition is not shape and (x := condition.polynomial.terms.get(lead)) is not None
        }
        for n, polynomial in self._without_zeros(reduced).items():
            before = self.conditions[n]
            if len(polynomial.terms) < len(before.polynomial.terms):
                self.conditions[n] = replace(before, polynomial=polynomial)

    def _without_zeros(self, polynomials: Mapping[int, Polynomial]) -> dict[int, Polynomial]:
        """Polynomials without the coefficients that are zero at every probed state."""
        scalars = [x for polynomial in polynomials.values() for x in polynomial.terms.values()]
        if not scalars:
            return dict(polynomials)
        sizes = iter(np.max(np.abs(self.probe(scalars)), axis=0))
        return {
            n: Polynomial({key: x for key, x in polynomial.terms.items() if next(sizes) > ZERO})
            for n, polynomial in polynomials.items()
        }

    def _drop_repeats(self) -> None:
        """Leave out equations that are a multiple of an earlier one at every probed state."""
        kept: list[Condition] = []
        for condition in self.conditions:
            same = [
                c for c in kept if c.polynomial.terms.keys() == condition.polynomial.terms.keys()
            ]
            if not any(self._proportional(c.polynomial, condition.polynomial) for c in same):
                kept.append(condition)
        self.conditions = kept

    def _proportional(self, a: Polynomial, b: Polynomial) -> bool:
        found = self.probe([p.terms[key] for p in (a, b) for key in a.terms])
        for first, second in found.reshape(len(found), 2, -1):
            k = int(np.argmax(np.abs(first)))
            if (
                np.max(np.abs(second - first * (second[k] / first[k])))
                > 1e-11 * np.abs(second).max()
            ):
                return False
        return True

    def _drop_flips(self) -> None:
        """Leave out an angle that only one homogeneous equation a c + b s = 0 asks for.

        It has two solutions half a turn apart, whatever the rest is, and moves nothing else.
        """
        for family in self.families:
            if family.pair is None or not set(family.pair) <= self._left():
                continue
            pair = set(family.pair)
            asking = [c for c in self.conditions if pair & c.polynomial.unknowns]
            own = [c for c in asking if c.polynomial.unknowns == pair and c.kind == "shape"]
            others = [c for c in asking if c not in own]
            if (
                len(others) == 1
                and len(own) == 1
                and all(len(pair & set(key)) == 1 for key in others[0].polynomial.terms)
            ):
                self.conditions = [c for c in self.conditions if c not in asking]
                self.flips.append((family, others[0]))

    def keeps_shape(self, condition: Condition) -> bool:
        """Whether an equation only says what the vectors of one class are by themselves."""
        owners = {self.unknowns[u].owner for u in condition.polynomial.unknowns}
        return condition.kind == "shape" and owners == {condition.source}

    def _left(self) -> set[int]:
        return {u for c in self.conditions for u in c.polynomial.unknowns}

    def _pivot(self, rank: Mapping[int, int]) -> tuple[Condition, int] | None:
        best: tuple[tuple[int, float], Condition, int] | None = None
        for condition in self.conditions:
            if condition.polynomial.degree != 1:
                continue
            for index in condition.polynomial.unknowns:
                value = condition.polynomial.coefficient(index)
                if al.is_number(value) and abs(value) > 1e-6:
                    key = (rank[index], -abs(value))
                    if best is None or key < best[0]:
                        best = (key, condition, index)
        return None if best is None else (best[1], best[2])

    def _tidy(self) -> None:
        """Drop coefficients that are zero at every probed state, and equations that say nothing."""
        found = self._without_zeros({n: c.polynomial for n, c in enumerate(self.conditions)})
        tidy = [replace(c, polynomial=found[n]) for n, c in enumerate(self.conditions)]
        self.conditions = [c for c in tidy if c.polynomial.degree > 0]
        self.checks += [c for c in tidy if c.polynomial.degree == 0 and c.polynomial.terms]


def _reach(start: str, ties: Mapping[str, Sequence[tuple[str, Transform]]]) -> dict[str, Transform]:
    """Every name that hangs together with one, and T_start_name along the way."""
    found, todo = {start: al.HERE}, [start]
    while todo:
        name = todo.pop()
        for other, T in ties[name]:
            if other not in found:
                found[other] = al.compose(found[name], T)
                todo.append(other)
    return found


def _axis_to_z(axis: str) -> Matrix:
    """A rotation whose z column is an axis."""
    return {"x": (al.Z, al.X, al.Y), "y": (al.Y, al.Z, al.X), "z": al.IDENTITY}[axis]


def _quotient(a: Scalar, b: Scalar) -> Scalar:
    return 0.0 if al.is_number(a) and a == 0 else a / b


def _rounded(x: float) -> float:
    """x, or the whole number it is but for rounding."""
    return float(round(x)) if abs(x - round(x)) < 1e-13 else x
