"""Bodies that hang together: clusters tied by known joints, classes that can not turn apart."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

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
from gough.joints.free import ROTATIONS, Free
from gough.symbolic.natural.parts import Cluster, Family, Link, Probing
from gough.topology import Structure


class Gathering:
    """Clusters, links and classes of orientation of a mechanism; see `NaturalClosure`.

    Attributes:
        clusters: that of the base first.
        of_body: the cluster of each body.
        links: joints and constraints between different clusters.
        families: classes of orientation, that of the base first.
    """

    def __init__(
        self,
        structure: Structure,
        values: Values,
        nominal: Values,
        known: Mapping[str, Sequence[Scalar]],
        probing: Probing,
        pose: Transform | None,
        turn: Matrix | None,
    ) -> None:
        self.structure, self.values, self.nominal = structure, values, nominal
        self.known, self.probing, self.pose, self.turn = known, probing, pose, turn
        self.planar = structure.mechanism.motion == "planar"
        self.clusters = self._clusters()
        self.of_body = {body: c for c in self.clusters for body in c.places}
        self.links = [k for k in self._links() if self.cluster(k, 0) is not self.cluster(k, 1)]
        self.families = self._families()
        self._find_axes()

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
        """The cluster at an end of a link."""
        return self.of_body[link.bodies[end]]

    def frame(self, link: Link, end: int) -> Transform:
        """T_cluster_frame of a link's frame."""
        place = self.cluster(link, end).places[link.bodies[end]]
        return al.compose(place, link.frames[end])

    def holds(self, link: Link) -> tuple[str, ...]:
        """What a link says of its frames; axes always agree in planar motion."""
        holds = CONSTRAINTS[link.type].holds if link.type in CONSTRAINTS else TYPES[link.type].holds
        if self.planar and link.type != "directions-parallel":
            return tuple(hold for hold in holds if hold != "axis")
        return holds

    def _families(self) -> list[Family]:
        """Clusters that links keep from turning against each other, with R_class_cluster."""
        ties: dict[str, list[tuple[str, Transform]]] = {c.name: [] for c in self.clusters}
        for link in self.links:
            if "orientation" in self.holds(link):
                a, b = (self.cluster(link, end).name for end in (0, 1))
                Ra, Rb = (self.frame(link, end)[0] for end in (0, 1))
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
        for body, moves in self.free_moves().items():
            cluster, turn = self.of_body[body], None
            if not set(moves) & set(ROTATIONS) and self.of_body[body] is not self.clusters[0]:
                turn = al.IDENTITY
            if body == platform and self.turn is not None:
                turn = self.turn
            if turn is not None and cluster is not self.clusters[0]:
                R = al.matmul(turn, al.transpose(cluster.places[body][0]))
                ties[base].append((cluster.name, (R, al.ZERO)))
                ties[cluster.name].append((base, (al.transpose(R), al.ZERO)))

    def free_moves(self) -> dict[str, tuple[str, ...]]:
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
        for body, moves in self.free_moves().items():
            turns = [move[1] for move in moves if move in ROTATIONS]
            family = self.family(self.of_body[body])
            if len(turns) == 1 and not family.rests and family.axis is None:
                R = _axis_to_z(turns[0])
                cluster = self.of_body[body]
                own = al.matmul(al.matmul(cluster.turn, cluster.places[body][0]), R)
                family.axis = (R, own)
        while any(self._axis_from(link) for link in self.links):
            pass

    def _axis_from(self, link: Link) -> bool:
        """Give a class its axis where a link ties it to one whose axis is known."""
        if "axis" not in self.holds(link):
            return False
        for near, far in ((0, 1), (1, 0)):
            known, free = (self.family(self.cluster(link, end)) for end in (near, far))
            if free.rests or free.axis is not None or not (known.rests or known.axis):
                continue
            R = self.turned(link, near)
            if not known.rests:
                assert known.axis is not None
                if not self.probing.parallel(al.column(known.axis[1], 2), al.column(R, 2)):
                    continue
                # the axis stays where it is while the known class turns
                R = al.matmul(known.axis[0], al.matmul(al.transpose(known.axis[1]), R))
            free.axis = (R, self.turned(link, far))
            return True
        return False

    def turned(self, link: Link, end: int) -> Matrix:
        """R_class_frame of a link's frame."""
        return al.matmul(self.cluster(link, end).turn, self.frame(link, end)[0])

    def family(self, cluster: Cluster) -> Family:
        """The class of orientation of a cluster."""
        return self.families[cluster.family]


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
