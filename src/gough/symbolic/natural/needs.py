"""What equations need to know of bodies: reference points, and vectors of each class."""

from __future__ import annotations

from gough import algebra as al
from gough.symbolic.natural.gathering import Gathering
from gough.symbolic.natural.parts import Family, Link


class Needs:
    """Reference points of clusters and wanted vectors of classes, noted on these.

    Attributes:
        dropped: universal joints that a spin satisfies.
        stretched: slides whose length makes up for any distance of their ends, by their class.
    """

    def __init__(self, gathering: Gathering) -> None:
        self.gathering = gathering
        self.dropped: set[str] = set()
        self.asked: list[tuple[Family, Link, al.Vector]] = []
        self._place_references()
        self._want()
        self.stretched: dict[int, Link] = self._stretched()

    def _place_references(self) -> None:
        """Choose the point of each cluster whose position is an unknown."""
        g = self.gathering
        g.clusters[0].reference = al.ZERO
        for body in (*g.free_moves(), g.structure.mechanism.platform):
            if body in g.of_body and g.of_body[body].reference is None:
                g.of_body[body].reference = g.of_body[body].places[body][1]
        for link in g.links:
            for end in (0, 1):
                if g.cluster(link, end).reference is None:
                    g.cluster(link, end).reference = g.frame(link, end)[1]
        for cluster in g.clusters:
            cluster.reference = cluster.reference or al.ZERO

    def arm(self, link: Link, end: int) -> al.Vector:
        """From the reference point to a link's frame, in class axes."""
        cluster = self.gathering.cluster(link, end)
        assert cluster.reference is not None
        arm = al.minus(self.gathering.frame(link, end)[1], cluster.reference)
        return al.turn(cluster.turn, arm)

    def direction(self, link: Link, end: int, k: int) -> al.Vector:
        """Axis k of a link's frame, in class axes."""
        return al.column(self.gathering.turned(link, end), k)

    def _want(self) -> None:
        """Collect the vectors that equations need; leave out what a spin can always satisfy."""
        links = self.gathering.links
        for link in links:
            holds = self.gathering.holds(link)
            for end in (0, 1):
                if {"point", "line", "level", "circle"} & set(holds):
                    self._ask(link, end, self.arm(link, end))
                if "axis" in holds or (end == 0 and {"level", "circle"} & set(holds)):
                    self._ask(link, end, self.direction(link, end, 2))
        for link in links:
            if "crossed" in self.gathering.holds(link) and not self._spins(link):
                self._ask_crossed(link)
        while any(self._spin_is_taken(link) for link in links if link.name in self.dropped):
            pass

    def _ask(self, link: Link, end: int, v: al.Vector) -> None:
        """Note that a link needs a vector of the class at an end."""
        family = self.gathering.family(self.gathering.cluster(link, end))
        family.wanted.append(v)
        self.asked.append((family, link, v))

    def _ask_crossed(self, link: Link) -> None:
        for end, k in ((0, 0), (1, 1)):
            self._ask(link, end, self.direction(link, end, k))

    def _spin_is_taken(self, link: Link) -> bool:
        """Ask for a universal joint's equation after all if its body has got a second vector."""
        for end in (0, 1):
            family = self.gathering.family(self.gathering.cluster(link, end))
            if family.spin == link.name and self.gathering.probing.rank(self._held(family)) > 1:
                family.spin = ""
                self.dropped.discard(link.name)
                self._ask_crossed(link)
                return True
        return False

    def _held(self, family: Family) -> list[al.Vector]:
        """The wanted vectors of a class, and the directions of its slides."""
        slides = [link for link in self.gathering.links if self._slides(link, family)]
        return [*family.wanted, *(self.direction(link, 0, 2) for link in slides)]

    def _spins(self, link: Link) -> bool:
        """Whether the spin of a body about its only vector satisfies a universal joint."""
        for end, k in ((1, 1), (0, 0)):
            family = self.gathering.family(self.gathering.cluster(link, end))
            if family.rests or family.axis is not None or family.spin:
                continue
            vectors = self._held(family)
            if self.gathering.probing.rank(vectors) > 1:
                continue
            across = self.direction(link, end, k)
            if all(self.gathering.probing.normal(across, v) for v in vectors):
                family.spin = link.name
                self.dropped.add(link.name)
                return True
        return False

    def _slides(self, link: Link, family: Family) -> bool:
        return (
            "line" in self.gathering.holds(link)
            and self.gathering.family(self.gathering.cluster(link, 0)) is family
        )

    def _stretched(self) -> dict[int, Link]:
        """Classes with a slide whose length makes up for any distance of their ends."""
        found: dict[int, Link] = {}
        for k, family in enumerate(self.gathering.families):
            slides = [link for link in self.gathering.links if self._slides(link, family)]
            if family.rests or not slides:
                continue
            z = self.direction(slides[0], 0, 2)
            if len(slides) > 1 or "orientation" not in self.gathering.holds(slides[0]):
                family.wanted += [self.direction(link, 0, 2) for link in slides]
                continue
            aside = list(family.wanted)
            if family.axis is not None:
                axis = al.column(family.axis[1], 2)
                if not self.gathering.probing.normal(axis, z):
                    family.wanted.append(z)
                    continue
                aside = [al.minus(v, al.scale(al.dot(axis, v), axis)) for v in aside]
            if self.gathering.probing.rank([z, *aside]) == 1 and self._alone(family, slides[0]):
                found[k] = slides[0]
            else:
                family.wanted.append(z)
        return found

    def _alone(self, family: Family, slide: Link) -> bool:
        """Whether other links take hold of a class on the line of its slide's ends, and no farther.

        The platform, and what is an output, is no part of it: the sign of the slide would tell.
        """
        if self._is_output(family):
            return False
        others = [v for f, link, v in self.asked if f is family and link is not slide]
        if family.axis is not None:
            axis = al.column(family.axis[1], 2)
            others = [al.minus(v, al.scale(al.dot(axis, v), axis)) for v in others]
        return self.gathering.probing.rank(others) == 0

    def _is_output(self, family: Family) -> bool:
        g, mechanism = self.gathering, self.gathering.structure.mechanism
        platform = mechanism.platform
        if platform in g.of_body and g.family(g.of_body[platform]) is family:
            return True
        return any(
            g.family(g.cluster(link, end)) is family
            for link in g.links
            if link.name in mechanism.operational
            for end in (0, 1)
        )
