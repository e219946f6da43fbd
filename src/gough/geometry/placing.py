"""Configurations q from values of natural coordinates: every body placed, every joint measured.

What the equations left out, since it changes nothing else, is chosen nearest to a reference: the
spin of a body about the only vector it is held by, and half turns of passive joints.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from functools import cached_property
from typing import Any

import casadi
import numpy as np
from numpy.typing import NDArray

from gough import algebra as al
from gough.algebra import Scalar
from gough.description.frames import transform
from gough.description.values import scalar
from gough.geometry.problem import Problem
from gough.joints import TYPES
from gough.kernels import Kernel
from gough.symbolic import polynomials as po
from gough.symbolic.natural.parts import Family, Link
from gough.topology import Edge

Array = NDArray[np.float64]


class Placing:
    """Places the bodies of one mechanism.

    Args:
        problem: what is known of it.
    """

    def __init__(self, problem: Problem) -> None:
        self.problem, self.natural = problem, problem.natural
        self.models, self.assembler = problem.models, problem.assembler
        self.structure = problem.models.structure

    def configurations(self, q: Array, unknowns: Array, near: Array) -> Array:
        """Closed configurations.

        Args:
            q: configurations with the known positions in their places, (rows, positions).
            unknowns: values of the unknowns that the problem leaves, (rows, left).
            near: what choices are made nearest to, (positions,) or (rows, positions).

        Returns:
            Configurations, angles within half a turn of those of ``near``, (rows, positions).
        """
        near = np.broadcast_to(near, q.shape)
        reference = self._base_poses(near)
        # rows whose vectors have no direction come out as not finite
        with np.errstate(all="ignore"):
            data = self._data(q, unknowns, self._signs(q, unknowns, reference))
            turns = self._turns(data, reference)
            poses = self._poses(data, turns)
            return self._positions(q, poses, near)

    # what the equations say

    def _signs(self, q: Array, unknowns: Array, reference: Mapping[str, Array]) -> Array:
        """1 or -1 for each angle that may be half a turn further, whichever is nearer."""
        families = [family for family, _ in self.natural.flips]
        ones = np.ones((len(q), len(families)))
        if not families:
            return ones
        data = self._data(q, unknowns, ones)
        for n, family in enumerate(families):
            R = data["turned", self.natural.families.index(family)]
            axis = data["near", self.natural.families.index(family)][..., 2]
            # half a turn about the axis leaves nothing of R but what is along the axis
            along = np.einsum("...i,...ik->...k", axis, R)
            closeness = np.einsum("...ik,...ik->...", R, reference[family.name][..., :3, :3])
            common = np.einsum(
                "...k,...i,...ik->...", along, axis, reference[family.name][..., :3, :3]
            )
            ones[:, n] = np.where(closeness >= common, 1.0, -1.0)
        return ones

    def _data(self, q: Array, unknowns: Array, signs: Array) -> dict[Any, Array]:
        """Vectors and rotations as numbers, by what they are of."""
        kernel, layout = self._bundle
        flat = kernel(q, self.assembler.p, unknowns, signs)
        return {
            key: flat[:, start : start + np.prod(shape, dtype=int)].reshape(len(q), *shape)
            for key, (start, shape) in layout.items()
        }

    @cached_property
    def _bundle(self) -> tuple[Kernel, dict[Any, tuple[int, tuple[int, ...]]]]:
        """One kernel for all of it, and where each part stands in its result."""
        closure = self.models.closure
        layout: dict[Any, tuple[int, tuple[int, ...]]] = {}
        left = casadi.SX.sym("unknowns", len(self.problem.left))
        signs = casadi.SX.sym("signs", len(self.natural.flips))
        self._values = self._symbols(left, signs)
        scalars: list[Scalar] = []
        for key, value in self._parts():
            numbers = list(_flattened(value))
            shape = (3, 3) if len(numbers) == 9 else (len(numbers),)
            layout[key] = (len(scalars), shape)
            scalars += numbers
        column = casadi.vertcat(*(casadi.SX(x) for x in scalars))
        inputs = {"q": closure.q, "p": closure.p, "unknowns": left, "signs": signs}
        return Kernel("placing", inputs, column, (len(scalars),)), layout

    def _symbols(self, left: casadi.SX, signs: casadi.SX) -> dict[int, Scalar]:
        """Every unknown in terms of those left."""
        values: dict[int, Scalar] = {u: left[k] for k, u in enumerate(self.problem.left)}
        for n, (family, condition) in enumerate(self.natural.flips):
            a, b = self._homogeneous(family, condition.polynomial, values)
            size = signs[n] / al.sqrt(al.add(al.mul(a, a), al.mul(b, b)))
            assert family.pair is not None
            values[family.pair[0]] = al.mul(-b, size)
            values[family.pair[1]] = al.mul(a, size)
        for u, polynomial in self.natural.solved.items():
            if polynomial.unknowns <= values.keys():
                values[u] = polynomial.value(values)
        return values

    def _number(self, vector: po.Vector) -> al.Vector:
        x, y, z = (part.value(self._values) for part in vector)
        return x, y, z

    def _parts(self) -> Iterator[tuple[Any, Any]]:
        for k, family in enumerate(self.natural.families):
            yield from self._family_parts(k, family)
        for cluster in self.natural.clusters:
            yield ("position", cluster.name), self._number(cluster.position)
            yield ("reference", cluster.name), cluster.reference
            yield ("turn", cluster.name), cluster.turn
            for body, (R, p) in cluster.places.items():
                yield ("R", body), R
                yield ("p", body), p

    def _family_parts(self, k: int, family: Family) -> Iterator[tuple[Any, Any]]:
        image = self.natural.image
        if family.axis is not None:
            yield ("near", k), family.axis[0]
            yield ("far", k), family.axis[1]
        if family.pair is not None and set(family.pair) <= self._values.keys():
            columns = [self._number(image(family, axis)) for axis in al.IDENTITY]
            yield ("turned", k), al.from_columns(*columns)
        elif len(family.basis) >= 2:
            images = [self._number(v) for v in family.images[:2]]
            own, there = _triad(*family.basis[:2]), _triad(*images)
            yield ("turned", k), al.matmul(there, al.transpose(own))
        elif family.basis:
            yield ("own", k), family.basis[0]
            yield ("there", k), self._number(family.images[0])
        if k in self.natural.stretched:
            yield ("own", k), self.natural.direction(self.natural.stretched[k], 0, 2)
        if (found := self._spin_link(k)) is not None:
            link, end = found
            yield ("across", k), self.natural.direction(link, end, end)
            yield ("crossed", k), self.natural.direction(link, 1 - end, 1 - end)

    @staticmethod
    def _homogeneous(
        family: Family, polynomial: po.Polynomial, values: Mapping[int, Scalar]
    ) -> tuple[Scalar, Scalar]:
        """a and b of the equation a c + b s = 0 of an angle."""
        assert family.pair is not None
        c, s = family.pair
        a, b = (polynomial.value({**values, c: x, s: 1.0 - x}) for x in (1.0, 0.0))
        return a, b

    # orientations

    def _turns(self, data: Mapping[Any, Array], reference: Mapping[str, Array]) -> list[Array]:
        """R_base_class of every class of orientation."""
        rows = len(next(iter(data.values())))
        turns: dict[int, Array] = {0: np.broadcast_to(np.eye(3), (rows, 3, 3))}
        waiting = []
        for k, family in enumerate(self.natural.families[1:], start=1):
            before = reference[family.name][..., :3, :3]
            if ("turned", k) in data:
                turns[k] = data["turned", k]
            elif ("own", k) in data and family.axis is not None:
                turns[k] = self._aimed_about_axis(data, k)
            elif k in self.natural.stretched or ("own", k) in data:
                waiting.append(k)
            else:
                turns[k] = before
        while waiting:
            ready = [k for k in waiting if self._spin_partner(k) in (*turns, None)]
            # of spins that depend on each other the first is free; if wrong, loops stay open
            for k in ready or waiting[:1]:
                turns[k] = self._spun(data, k, turns, reference)
                waiting.remove(k)
        return [turns[k] for k in range(len(self.natural.families))]

    def _about(self, data: Mapping[Any, Array], k: int, angle: Array) -> Array:
        """R_base_class of a class turned about its axis."""
        c, s, o, i = np.cos(angle), np.sin(angle), np.zeros_like(angle), np.ones_like(angle)
        turn = np.stack([c, -s, o, s, c, o, o, o, i], axis=-1).reshape(*angle.shape, 3, 3)
        return np.asarray(data["near", k] @ turn @ _transposed(data["far", k]))

    def _stretch(self, data: Mapping[Any, Array], k: int) -> tuple[Array, Array]:
        """Direction of a slide in class axes, and in base axes from the points it holds apart."""
        link = self.natural.stretched[k]
        ends = [data["position", self.natural.cluster(link, end).name] for end in (0, 1)]
        return data["own", k], _unit(ends[1] - ends[0]) * self._stretch_signs[k]

    @cached_property
    def _stretch_signs(self) -> dict[int, float]:
        """1 where a slide holds its ends apart along its axis at home, -1 where against it."""
        home = self.problem.home[None]
        poses = self._base_poses(home)
        left, flips = len(self.problem.left), len(self.natural.flips)
        data = self._data(home, np.zeros((1, left)), np.ones((1, flips)))
        signs = {}
        for k, link in self.natural.stretched.items():
            a, b = (self.natural.cluster(link, end) for end in (0, 1))
            ends = [poses[c.name][0] @ np.append(data["reference", c.name][0], 1.0) for c in (a, b)]
            R = poses[a.name][0, :3, :3] @ data["turn", a.name][0].T
            along = (ends[1] - ends[0])[:3] @ (R @ data["own", k][0])
            signs[k] = 1.0 if along >= 0 else -1.0
        return signs

    def _aimed_about_axis(self, data: Mapping[Any, Array], k: int) -> Array:
        """Orientation of a class that turns about a known axis, from its only vector."""
        own, there = self._vector(data, k)
        x0, y0, _ = np.moveaxis(_applied(_transposed(data["far", k]), own), -1, 0)
        x1, y1, _ = np.moveaxis(_applied(_transposed(data["near", k]), there), -1, 0)
        return self._about(data, k, np.arctan2(y1, x1) - np.arctan2(y0, x0))

    def _vector(self, data: Mapping[Any, Array], k: int) -> tuple[Array, Array]:
        """The only vector of a class, in class and in base axes, of length 1."""
        if k in self.natural.stretched:
            return self._stretch(data, k)
        return _unit(data["own", k]), _unit(data["there", k])

    def _spin_link(self, k: int) -> tuple[Link, int] | None:
        """The universal joint that tells the spin of a class, and the end of the class."""
        name = self.natural.families[k].spin
        for link in self.natural.links:
            if link.name == name:
                return link, 0 if self.natural.cluster(link, 0).family == k else 1
        return None

    def _spin_partner(self, k: int) -> int | None:
        found = self._spin_link(k)
        return None if found is None else self.natural.cluster(found[0], 1 - found[1]).family

    def _spun(
        self,
        data: Mapping[Any, Array],
        k: int,
        turns: Mapping[int, Array],
        reference: Mapping[str, Array],
    ) -> Array:
        """Orientation of a class from its only vector and the joint that tells its spin."""
        before = reference[self.natural.families[k].name][..., :3, :3]
        own, there = self._vector(data, k)
        found = self._spin_link(k)
        if found is None or self._spin_partner(k) not in turns:
            return np.asarray(_shortest(_applied(before, own), there) @ before)
        link, end = found
        partner = self.natural.cluster(link, 1 - end).family
        other, across = _applied(turns[partner], data["crossed", k]), data["across", k]
        own_frame = _triads(own, across)
        # where the joint is straight any spin does, and the reference's is taken
        normal = np.cross(there, other)
        straight = np.linalg.norm(normal, axis=-1, keepdims=True) < 1e-12
        normal = np.where(straight, _applied(before, across), normal)
        ways = [_triads(there, sign * normal) @ _transposed(own_frame) for sign in (1.0, -1.0)]
        return _nearer(ways[0], ways[1], before)

    # poses and positions

    def _poses(self, data: Mapping[Any, Array], turns: Sequence[Array]) -> dict[str, Array]:
        """T_base_body of every body of a cluster, (rows, 4, 4)."""
        poses: dict[str, Array] = {}
        for cluster in self.natural.clusters:
            R = turns[cluster.family] @ data["turn", cluster.name]
            p = data["position", cluster.name] - _applied(R, data["reference", cluster.name])
            for body in cluster.places:
                turned = R @ data["R", body]
                poses[body] = _stacked(turned, p + _applied(R, data["p", body]))
        return poses

    def _base_poses(self, q: Array) -> dict[str, Array]:
        """T_base_body of every body of the tree at configurations."""
        bodies, base = self.structure.bodies, self.structure.mechanism.base
        found = dict(
            zip(bodies, np.moveaxis(self.models.poses(q, self.assembler.p), 1, 0), strict=True)
        )
        if base in found:
            back = _inverse(found[base])
            found = {body: back @ T for body, T in found.items()}
        found[base] = np.broadcast_to(np.eye(4), (len(q), 4, 4))
        return found

    def _positions(self, given: Array, poses: Mapping[str, Array], near: Array) -> Array:
        """Positions of the joints of the tree: known ones as given, others nearest to near's."""
        q = np.array(near)
        for k, edge in enumerate(self.structure.edges):
            part = self.models.closure.slices[k]
            if edge.name in self.problem.known:
                q[:, part] = given[:, part]
            elif edge.name != self.structure.mechanism.base:
                q[:, part] = _near(edge, self._position(edge, poses), near[:, part])
        return q

    def _position(self, edge: Edge, poses: Mapping[str, Array]) -> Array:
        values, flat = self.assembler.values, self.structure.flat
        name = edge.name if edge.name in flat.expanded else edge.name.rpartition(".")[0]
        if name in flat.expanded:
            joint = flat.expanded[name]
            numbers = {key: scalar(value, values) for key, value in joint.dimensions.items()}
            angle = TYPES[joint.type].measured(self._across(joint, poses), numbers)
            return -angle if edge.name == f"{name}.far1" else angle
        numbers = {key: scalar(value, values) for key, value in edge.dimensions.items()}
        return edge.type.measured(self._across(edge, poses), numbers)

    def _across(self, joint: Any, poses: Mapping[str, Array]) -> Array:
        """T_a_b of the frames of a joint."""
        frames = [
            poses[body.partition("@")[0]] @ _homogeneous(transform(frame, self.assembler.values))
            for body, frame in zip(joint.bodies, joint.frames, strict=True)
        ]
        return np.asarray(_inverse(frames[0]) @ frames[1])


def _near(edge: Edge, q: Array, near: Array) -> Array:
    """Angles within half a turn of others; the sign of a quaternion nearest to another."""
    angles = [k for k, unit in enumerate(edge.type.rates) if unit == "rad"]
    if edge.type.coordinates > edge.type.freedoms:
        opposed = np.sum(q[:, -4:] * near[:, -4:], axis=1, keepdims=True) < 0
        q[:, -4:] = np.where(opposed, -q[:, -4:], q[:, -4:])
        return q
    if not edge.type.algebraic:
        return q  # its turns are told by its length
    q[:, angles] += 2 * np.pi * np.round((near[:, angles] - q[:, angles]) / (2 * np.pi))
    return q


def _flattened(value: Any) -> Iterator[Scalar]:
    if isinstance(value, tuple):
        for item in value:
            yield from _flattened(item)
    else:
        yield value


def _triad(a: al.Vector, b: al.Vector) -> al.Matrix:
    """Orthonormal axes: along a, and b's part normal to a."""
    x = al.unit(a)
    z = al.unit(al.cross(x, b))
    return al.from_columns(x, al.cross(z, x), z)


def _triads(a: Array, b: Array) -> Array:
    """The same for arrays of vectors, (..., 3, 3)."""
    x = _unit(a)
    z = _unit(np.cross(x, b))
    return np.stack([x, np.cross(z, x), z], axis=-1)


def _unit(v: Array) -> Array:
    return np.asarray(v / np.linalg.norm(v, axis=-1, keepdims=True))


def _applied(R: Array, v: Array) -> Array:
    return np.asarray((R @ v[..., None])[..., 0])


def _transposed(R: Array) -> Array:
    return np.swapaxes(R, -1, -2)


def _nearer(one: Array, other: Array, before: Array) -> Array:
    """Of two rotations the one with the smaller angle to a third."""
    closeness = [np.einsum("...ik,...ik->...", R, before) for R in (one, other)]
    return np.where((closeness[0] >= closeness[1])[..., None, None], one, other)


def _shortest(a: Array, b: Array) -> Array:
    """The rotation by the smallest angle that takes unit vectors a to b.

    Two half turns: about a, then about the middle of a and b; where these are opposed, one half
    turn about any normal.
    """
    middle = a + b
    size = np.linalg.norm(middle, axis=-1, keepdims=True)
    opposed = size < 1e-8
    least = np.eye(3)[np.argmin(np.abs(a), axis=-1)]
    normal = np.cross(a, least)
    normal = normal / np.linalg.norm(normal, axis=-1, keepdims=True)
    middle = np.where(opposed, normal, middle / np.where(opposed, 1.0, size))
    second = np.where(opposed[..., None], np.eye(3), _half_turn(a))
    return np.asarray(_half_turn(middle) @ second)


def _half_turn(axis: Array) -> Array:
    return np.asarray(2 * axis[..., :, None] * axis[..., None, :] - np.eye(3))


def _inverse(T: Array) -> Array:
    """T_b_a from T_a_b, (..., 4, 4)."""
    R = _transposed(T[..., :3, :3])
    return _stacked(R, -_applied(R, T[..., :3, 3]))


def _homogeneous(T: al.Transform) -> Array:
    R, p = T
    return _stacked(np.array(R, dtype=float), np.array(p, dtype=float))


def _stacked(R: Array, p: Array) -> Array:
    """(..., 4, 4) from rotations and points."""
    T = np.zeros((*R.shape[:-2], 4, 4))
    T[..., :3, :3], T[..., :3, 3], T[..., 3, 3] = R, p, 1.0
    return T
