"""The graph of a mechanism as a spanning tree, joints that close loops, variables and legs."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Literal, get_args

from gough.description import Body, Frame, Mechanism
from gough.description.check import PLANAR_MOVES
from gough.description.flat import Flat, flatten
from gough.errors import DescriptionError, Problem, UnknownName
from gough.joints import TYPES, Free, JointType
from gough.joints.base import Unit
from gough.joints.free import POSE

WORLD = "(world)"
"""Root of the tree of a floating base."""

Role = Literal["actuated", "passive", "operational"]
Modelling = Literal["cut-joints", "cut-platform"]


@dataclass(frozen=True)
class Edge:
    """A joint between two bodies of the tree or, cut, between two bodies it closes a loop of."""

    name: str
    type: JointType
    bodies: tuple[str, str]
    frames: tuple[Frame, Frame]
    dimensions: Mapping[str, Any]
    actuated: bool = False
    home: Any = None
    """Written position, or the frame of a free link; None if the description gives none."""
    link: bool = False
    """Whether it is no joint of the description but the placing of a free link, named by it."""
    parent: str = ""
    """The body nearer to the root, for a joint of the tree."""

    @property
    def child(self) -> str:
        """The body that a joint of the tree places."""
        a, b = self.bodies
        return b if self.parent == a else a

    @property
    def reversed(self) -> bool:
        """Whether the tree passes the joint from its second body to its first."""
        return self.parent == self.bodies[1]


@dataclass(frozen=True)
class Closing:
    """A source of closure equations: a cut joint, a constraint, or a coincidence of platforms."""

    name: str
    kind: Literal["joint", "constraint", "coincidence"]
    type: str
    bodies: tuple[str, str]
    frames: tuple[Frame, Frame]
    dimensions: Mapping[str, Any]


@dataclass(frozen=True)
class Variable:
    """One rate of the tree: a freedom of one of its joints."""

    name: str
    edge: int
    freedom: int
    unit: Unit
    role: Role


@dataclass(frozen=True)
class Chain:
    """A leg: bodies and joints between base and platform."""

    name: str
    bodies: tuple[str, ...]
    joints: tuple[str, ...]
    letters: str
    """Joint letters from base to platform, actuated ones in brackets: U[P]S."""


class Structure:
    """Spanning tree, closings, variables and legs of one mechanism.

    Attributes:
        mechanism: the description.
        flat: its parts written out.
        modelling: which of the two methods of modelling was used.
        edges: joints of the tree, each after the joint that places its parent.
        closings: where the closure equations come from, in order.
        variables: one for each column of the closure Jacobian.

    Raises:
        DescriptionError: a loop has no passive joint to cut, or a chosen cut is impossible.
    """

    def __init__(self, mechanism: Mechanism, modelling: Modelling | None = None) -> None:
        self.mechanism = mechanism
        self.modelling: Modelling = modelling or mechanism.modelling
        if self.modelling not in get_args(Modelling):
            raise UnknownName("way of modelling", self.modelling, get_args(Modelling))
        self.flat: Flat = flatten(mechanism)
        builder = _Builder(mechanism, self.flat, self.modelling)
        self.edges, self.closings = builder.build()
        self.root = WORLD if mechanism.floating else mechanism.base
        self.variables: tuple[Variable, ...] = tuple(_variables(self.edges, mechanism))

    @cached_property
    def edge_to(self) -> dict[str, int]:
        """Index of the edge that places each body of the tree."""
        return {edge.child: k for k, edge in enumerate(self.edges)}

    @cached_property
    def bodies(self) -> tuple[str, ...]:
        """Every body of the tree but its root, in the order of the edges."""
        return tuple(edge.child for edge in self.edges)

    def path(self, body: str) -> list[int]:
        """Indices of the edges from the root to a body."""
        indices: list[int] = []
        while body != self.root:
            indices.append(self.edge_to[body])
            body = self.edges[indices[-1]].parent
        return indices[::-1]

    def loop(self, a: str, b: str) -> tuple[list[int], list[int]]:
        """Edges from the nearest common body to a, and to b."""
        to_a, to_b = self.path(a), self.path(b)
        while to_a and to_b and to_a[0] == to_b[0]:
            to_a, to_b = to_a[1:], to_b[1:]
        return to_a, to_b

    def loop_joints(self, closing: Closing) -> tuple[str, ...]:
        """Names of the joints around the loop of a closing, free links left out."""
        to_a, to_b = self.loop(*closing.bodies)
        edges = [self.edges[k] for k in (*to_a[::-1], *to_b)]
        names = [edge.name for edge in edges if not edge.link]
        return (*names, closing.name)

    def columns(self, role: Role) -> list[int]:
        """Indices of the variables with a role."""
        return [k for k, variable in enumerate(self.variables) if variable.role == role]

    @property
    def platform_is_output(self) -> bool:
        """Whether the outputs are coordinates of the platform and not joints."""
        return any(name in POSE for name in self.mechanism.operational)

    @property
    def loops(self) -> int:
        """Number of independent loops of the graph of bodies, joints and constraints."""
        return len(self.flat.joints) + len(self.flat.constraints) - self.moving_bodies

    @property
    def moving_bodies(self) -> int:
        """Number of bodies without the base."""
        return len(self.flat.bodies.keys() - {self.mechanism.base})

    @cached_property
    def legs(self) -> tuple[Chain, ...]:
        """Chains between base and platform, in the order their joints are described."""
        return tuple(_legs(self.flat, self.mechanism)) if self.mechanism.platform else ()

    @cached_property
    def architecture(self) -> str:
        """Short name by joint letters, actuated joints in brackets: 6-U[P]S, or 4R for a loop."""
        if self.legs:
            counts = Counter(leg.letters for leg in self.legs)
            return " + ".join(f"{n}-{text}" if n > 1 else text for text, n in counts.items())
        letters = Counter(_letter(self.flat, name) for name in self.flat.joints)
        return " ".join(f"{n}{text}" for text, n in letters.items() if text)


def _variables(edges: Iterable[Edge], mechanism: Mechanism) -> Iterator[Variable]:
    for k, edge in enumerate(edges):
        for freedom, (unit, label) in enumerate(
            zip(edge.type.rates, edge.type.labels, strict=True)
        ):
            name = f"{edge.name}.{label}" if label else edge.name
            yield Variable(name, k, freedom, unit, _role(edge, label, mechanism))


def _role(edge: Edge, label: str, mechanism: Mechanism) -> Role:
    if edge.actuated:
        return "actuated"
    if edge.link:
        output = edge.name == mechanism.platform and label in mechanism.operational
    else:
        output = edge.name in mechanism.operational
    return "operational" if output else "passive"


class _Builder:
    """Chooses the spanning tree."""

    def __init__(self, mechanism: Mechanism, flat: Flat, modelling: Modelling) -> None:
        self.mechanism, self.flat, self.modelling = mechanism, flat, modelling
        self.free = {
            name: self._free_type(name, body)
            for name, body in flat.bodies.items()
            if body.free is not None or name == mechanism.platform
        }
        self.joints = {
            name: Edge(
                name,
                TYPES[joint.type],
                joint.bodies,
                joint.frames,
                joint.dimensions,
                joint.actuated,
                joint.home,
            )
            for name, joint in flat.joints.items()
        }
        self.bound = _bound_joints(mechanism, flat)
        self.pieces = set(self._holding()) if modelling == "cut-platform" else set()

    def build(self) -> tuple[tuple[Edge, ...], tuple[Closing, ...]]:
        if self.modelling == "cut-platform" and self.mechanism.platform is None:
            problem = Problem("cut-platform needs a platform, and none is named", ("modelling",))
            raise DescriptionError([problem], source=self.mechanism.name)
        tree, cut = self._span()
        if not self.pieces and any(not self._cuttable(edge) for edge in cut):
            self.pieces = {name for name in self._holding() if self._must_stay(name)}
            tree, cut = self._span()
        self._refuse(cut)
        return self._rooted(tree), (*self._closings(cut), *self._coincidences())

    # what the joints are

    def _free_type(self, name: str, body: Body) -> Free:
        every = PLANAR_MOVES if self.mechanism.motion == "planar" else POSE
        return Free(body.free or every)

    def _holding(self) -> list[str]:
        """Names of the joints that hold the platform, and not what only hangs on it."""
        platform, placed = self.mechanism.platform, self._depths().keys() | self.free.keys()
        return [
            name
            for name, edge in self.joints.items()
            if platform in edge.bodies and placed & (set(edge.bodies) - {platform})
        ]

    def _must_stay(self, name: str) -> bool:
        return not self._cuttable(self.joints[name])

    def _cuttable(self, edge: Edge) -> bool:
        return not edge.actuated and edge.name not in self.bound

    def _placed(self, edge: Edge) -> Edge:
        """The joint, holding its own piece of the platform where that is cut."""
        if edge.name not in self.pieces:
            return edge
        a, b = (
            _piece(body, edge.name) if body == self.mechanism.platform else body
            for body in edge.bodies
        )
        return replace(edge, bodies=(a, b))

    # which joints close loops

    def _span(self) -> tuple[list[Edge], list[Edge]]:
        """Tree and cut joints: motors first, then few freedoms, then near to the base.

        Base and free links count as one body, since the variables of a free link place it.
        """
        depth = self._depths()
        parent: dict[str, str] = {body: self.mechanism.base for body in self.free}

        def find(body: str) -> str:
            while body in parent:
                body = parent[body]
            return body

        def weight(edge: Edge) -> tuple[bool, bool, int, int]:
            near = min(depth.get(body, len(depth)) for body in edge.bodies)
            chosen = edge.name in self.mechanism.cut
            return chosen, self._cuttable(edge), edge.type.freedoms, near

        tree, cut = [], []
        for edge in sorted(map(self._placed, self.joints.values()), key=weight):
            a, b = (find(body) for body in edge.bodies)
            if a == b:
                cut.append(edge)
                continue
            parent[a if b == self.mechanism.base else b] = b if b == self.mechanism.base else a
            tree.append(edge)
        return tree, cut

    def _depths(self) -> dict[str, int]:
        """Joints between the base and each body, on ways that pass no free link."""
        neighbours: dict[str, list[str]] = {}
        for edge in self.joints.values():
            a, b = edge.bodies
            neighbours.setdefault(a, []).append(b)
            neighbours.setdefault(b, []).append(a)
        depth, todo = {self.mechanism.base: 0}, deque([self.mechanism.base])
        while todo:
            body = todo.popleft()
            for other in neighbours.get(body, ()):
                if other not in depth and other not in self.free:
                    depth[other] = depth[body] + 1
                    todo.append(other)
        return depth

    def _refuse(self, cut: list[Edge]) -> None:
        problems = []
        for edge in cut:
            if not self._cuttable(edge):
                why = self._why_kept(edge)
                problems.append(
                    Problem(
                        f"joint {edge.name!r} {why} and can not be cut, and no other joint of its "
                        "loop can: a loop needs a passive joint without actuators, and a motor a "
                        "body that only joints place",
                        self.flat.paths["joints", edge.name],
                        on_key=True,
                    )
                )
        closing = {edge.name for edge in cut} | self.pieces
        for k, name in enumerate(self.mechanism.cut):
            if name not in closing:
                text = f"cutting {name!r} would leave a body without a place; cut another joint"
                problems.append(Problem(text, ("cut", k)))
        if problems:
            raise DescriptionError(problems, source=self.mechanism.name)

    def _why_kept(self, edge: Edge) -> str:
        if edge.actuated:
            return "is actuated"
        has_law = edge.name in self.flat.joints and self.flat.joints[edge.name].actuators
        return "has actuators" if has_law else "is in a coupling or an output"

    def _rooted(self, tree: list[Edge]) -> tuple[Edge, ...]:
        """The joints of the tree with their parents, free links first, parents before children."""
        base = self.mechanism.base
        links = [self._free_edge(body, kind) for body, kind in self.free.items()]
        edges = [replace(edge, parent=base) for edge in links]
        if self.mechanism.floating:
            kind = Free(PLANAR_MOVES if self.mechanism.motion == "planar" else POSE)
            here = (Frame(), Frame())
            edges.insert(0, Edge(base, kind, (WORLD, base), here, {}, link=True, parent=WORLD))
        placed, todo = {base, *self.free}, list(tree)
        while todo:
            ready = [edge for edge in todo if placed & set(edge.bodies)]
            assert ready, "the check of the graph lets no island pass"
            for edge in ready:
                a, b = edge.bodies
                edges.append(replace(edge, parent=a if a in placed else b))
                placed |= {a, b}
            todo = [edge for edge in todo if edge not in ready]
        return tuple(edges)

    def _free_edge(self, body: str, kind: Free) -> Edge:
        home = self.flat.bodies[body].home
        here, bodies = (Frame(), Frame()), (self.mechanism.base, body)
        return Edge(body, kind, bodies, here, {}, home=home, link=True)

    # what the closure equations are

    def _closings(self, cut: list[Edge]) -> Iterator[Closing]:
        chosen = {edge.name for edge in cut}
        for edge in self.joints.values():
            if edge.name in chosen:
                yield Closing(
                    edge.name, "joint", edge.type.name, edge.bodies, edge.frames, edge.dimensions
                )
        for name, part in self.flat.constraints.items():
            yield Closing(name, "constraint", part.type, part.bodies, part.frames, {})

    def _coincidences(self) -> Iterator[Closing]:
        """One for each piece of the platform, at the joint that holds it."""
        platform = self.mechanism.platform
        for name in self._holding():
            if name in self.pieces:
                assert platform is not None
                edge = self.joints[name]
                frame = edge.frames[edge.bodies.index(platform)]
                bodies = (_piece(platform, name), platform)
                yield Closing(name, "coincidence", "frames-coincide", bodies, (frame, frame), {})


def _piece(platform: str, joint: str) -> str:
    return f"{platform}@{joint}"


def _bound_joints(mechanism: Mechanism, flat: Flat) -> set[str]:
    """Joints whose variables have to exist: of couplings, of outputs, and with actuators."""
    coupled = {joint for coupling in flat.couplings.values() for joint in coupling.terms}
    acted_on = {name for name, joint in flat.joints.items() if joint.actuators}
    return coupled | acted_on | (set(mechanism.operational) & flat.joints.keys())


# legs


def _letter(flat: Flat, name: str) -> str:
    """The letter of a joint; pins of a parallelogram give its letter once."""
    joint = flat.joints[name]
    if name in flat.expanded:
        letter = TYPES[flat.expanded[name].type].letter
    else:
        letter = "" if name.rpartition(".")[0] in flat.expanded else TYPES[joint.type].letter
    return f"[{letter}]" if joint.actuated and letter else letter


def _legs(flat: Flat, mechanism: Mechanism) -> Iterator[Chain]:
    ends = {mechanism.base, mechanism.platform}
    links = [(name, joint.bodies) for name, joint in flat.joints.items()]
    links += [(name, part.bodies) for name, part in flat.constraints.items()]
    left = dict(links)
    number = 0
    for name, bodies in links:
        if name not in left:
            continue
        inner = _grown(set(bodies) - ends, left, ends)
        group = [other for other, pair in left.items() if other == name or inner & set(pair)]
        for other in group:
            del left[other]
        joints = tuple(other for other in group if other in flat.joints)
        feet = [joint for joint in joints if mechanism.base in flat.joints[joint].bodies]
        for foot in feet:
            route = _route(flat, foot, joints, mechanism)
            if not route:
                continue
            number += 1
            kept = joints if len(feet) == 1 else tuple(route)
            held = inner & {body for joint in kept for body in flat.joints[joint].bodies}
            letters = "".join(_letter(flat, joint) for joint in route)
            bodies_of = tuple(body for body in flat.bodies if body in held)
            yield Chain(_leg_name(kept, number), bodies_of, kept, letters)


def _grown(seed: set[str], links: Mapping[str, tuple[str, str]], ends: set[Any]) -> set[str]:
    """The seed bodies and all that hang together with them without passing base or platform."""
    grown = set(seed)
    while True:
        more = {b for pair in links.values() if grown & set(pair) for b in pair} - ends - grown
        if not more:
            return grown
        grown |= more


def _route(flat: Flat, foot: str, joints: tuple[str, ...], mechanism: Mechanism) -> list[str]:
    """Joints on the shortest way from base to platform that begins with a joint of the base."""
    a, b = flat.joints[foot].bodies
    start = b if a == mechanism.base else a
    before: dict[str, str | None] = {mechanism.base: None, start: foot}
    todo = deque([start])
    while todo and mechanism.platform not in before:
        body = todo.popleft()
        for name in joints:
            pair = flat.joints[name].bodies
            other = pair[1] if pair[0] == body else pair[0]
            if body in pair and other not in before:
                before[other] = name
                todo.append(other)
    route: list[str] = []
    at = mechanism.platform
    while at is not None and (step := before.get(at)) is not None:
        route.append(step)
        pair = flat.joints[step].bodies
        at = pair[0] if pair[1] == at else pair[1]
    return route[::-1]


def _leg_name(joints: tuple[str, ...], number: int) -> str:
    """The common first word of the joint names, else a number."""
    words = {name.split(".")[0] for name in joints}
    return words.pop() if len(words) == 1 and "." in joints[0] else f"leg {number}"
