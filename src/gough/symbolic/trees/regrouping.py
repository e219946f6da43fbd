"""The sparsest inertia that moves alike: fewest and cheapest numbers, by linear programmes."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linprog

from gough import algebra as al
from gough.algebra import Vector
from gough.symbolic.closing_rates import evaluated
from gough.symbolic.trees.frames import Frames
from gough.symbolic.trees.nodes import Inertia, Node, Tree, outermost
from gough.symbolic.trees.ties import ties
from gough.symbolic.trees.transfers import (
    NUMBERS,
    Transfers,
    as_vector,
    each_node,
    from_vector,
    mass_at,
)

Array = NDArray[np.float64]

COST = np.array([5.0, 8.0, 8.0, 8.0, 3.0, 3.0, 3.0, 5.0, 5.0, 5.0])
"""What a mass, a moment and entries of a tensor cost in a recursion, about; only ratios count."""
GIVEN, UNNAMED, DEEPER = 0.25, 1.5, 0.15
"""Factors of the cost for bodies whose motion is given, for nodes without a body, and for each
joint between a node and the root."""
TRIES, SPREAD = 24, 0.7
"""Linear programmes with other weights, and how much these differ (logarithm)."""
SMALL, NOTHING = 1e-7, 1e-10
"""Numbers below this in the programme's result are made zero, and below the second are."""
RIDGE, REFINED = 1e-12, 3
"""Regularisation of the normal equations, for transfers that no small number tells of; steps."""
SAME = 1e-9
"""Points that stay together to this, in characteristic lengths, are one."""


@dataclass(frozen=True)
class Pair:
    """A body as the motion of two points: f_a = k a_b and f_b = k a_a besides masses at points."""

    a: Node
    p_a: Vector
    b: Node
    p_b: Vector
    k: float


@dataclass(frozen=True)
class Regrouped:
    """Equivalent inertia of a tree."""

    inertia: dict[int, Inertia]
    """By node."""
    pairs: tuple[Pair, ...] = ()


def regroupings(tree: Tree, frames: Frames, given: set[int], most: int) -> list[Regrouped]:
    """Sparse equivalent inertias, the sparsest first; none where inertia hangs on live parameters.

    Args:
        tree: the mechanism.
        frames: its placing by joint positions.
        given: variables whose motion is given.
        most: how many are wanted.
    """
    transfers = Transfers(tree)
    try:
        p = np.concatenate([as_vector(node.inertia) for node in transfers.nodes])
    except TypeError:
        return []
    found = [p]
    if transfers.basis.size and p.any():
        kinds = [_kind(node) for node in transfers.nodes]
        found = _sparsest(p, transfers.basis, _scale(p), _costs(transfers.nodes, given), kinds)
    points = _Points(tree, frames)
    return [_with_pairs(points, _inertias(transfers.nodes, x), given) for x in found[:most]]


def _inertias(nodes: list[Node], p: Array) -> dict[int, Inertia]:
    return {node.index: from_vector(x) for node, x in zip(nodes, each_node(p), strict=True)}


def _kind(node: Node) -> str:
    """What nodes of like legs have in common: the name without its leg."""
    return f"{node.name.rpartition('.')[2]} {node.kind} {node.axis}"


def _scale(p: Array) -> Array:
    """Typical sizes of the ten numbers, for each node."""
    rows = p.reshape(-1, NUMBERS)
    mass = np.abs(rows[:, 0]).max() or 1.0
    length = np.sqrt(np.abs(rows[:, 4:7]).max() / mass) or 1.0
    own = np.r_[mass, [mass * length] * 3, [mass * length**2] * 6]
    return np.tile(own, len(rows))


def _costs(nodes: list[Node], given: set[int]) -> Array:
    costs = []
    for node in nodes:
        factor = 1 + DEEPER * len(list(node.ancestors()))
        if node.variables and set(node.variables) <= given:
            factor = GIVEN
        elif not node.bodies:
            factor *= UNNAMED
        costs.append(factor * COST)
    return np.concatenate(costs)


def _sparsest(
    p: Array, basis: Array, scale: Array, cost: Array, kinds: Sequence[str]
) -> list[Array]:
    """p + basis z with small weighted sums of sizes, for several weightings, the cheapest first.

    Like legs get like weights, so that they come out alike.
    """
    U, s, _ = np.linalg.svd(basis / scale[:, None], full_matrices=False)
    N = U[:, s > SAME * s[0]]
    start = p / scale
    rng = np.random.default_rng(3)
    found, weight = {(start != 0).tobytes(): start}, cost
    for _ in range(TRIES):
        z = _programme(start, N, weight)
        if z is not None:
            x = _cleaned(start + N @ z, start, N)
            found[(x != 0).tobytes()] = x
        factors = {kind: np.exp(SPREAD * rng.normal(size=NUMBERS)) for kind in dict.fromkeys(kinds)}
        weight = cost * np.concatenate([factors[kind] for kind in kinds])
    ordered = sorted(found.values(), key=lambda x: float(cost[x != 0].sum()))
    return [np.asarray(x * scale) for x in ordered]


def _programme(start: Array, N: Array, weight: Array) -> Array | None:
    """min Σ weight |start + N z| as a linear programme."""
    n, k = N.shape
    weighted = N * weight[:, None]
    A = np.block([[weighted, -np.eye(n)], [-weighted, -np.eye(n)]])
    b = np.r_[-start * weight, start * weight]
    bounds = [(None, None)] * k + [(0, None)] * n
    found = linprog(np.r_[np.zeros(k), np.ones(n)], A_ub=A, b_ub=b, bounds=bounds, method="highs")
    return None if found.x is None else np.asarray(found.x[:k])


def _cleaned(x: Array, start: Array, N: Array) -> Array:
    """Numbers that are nearly zero made zero exactly, as far as the transfers can.

    By normal equations, which are well conditioned since N is orthonormal, refined.
    """
    small = np.abs(x) < SMALL
    A = N[small]
    square = A.T @ A + RIDGE * np.eye(A.shape[1])
    z = N.T @ (x - start)
    for _ in range(REFINED):
        z -= np.linalg.solve(square, A.T @ (start[small] + A @ z))
    exact = start + N @ z
    return np.where(np.abs(exact) < NOTHING, 0.0, exact)


# bodies as two points


class _Points:
    """Points of a tree over the samples, each evaluated once."""

    def __init__(self, tree: Tree, frames: Frames) -> None:
        self.tree, self.frames = tree, frames
        self.ties = [tie for tie in ties(tree) if tie.word == "point"]
        self._tracks: dict[tuple[int, bytes], Array] = {}
        self._axes: dict[int, Array] = {}

    def track(self, node: Node, p: Vector) -> Array:
        """A point in root axes, (samples, 3)."""
        key = node.index, repr(p).encode()
        if key not in self._tracks:
            at = self.frames.root_position(node, p)
            self._tracks[key] = evaluated(self.tree.closure, self.tree.samples, at)
        return self._tracks[key]

    def in_axes(self, node: Node, x: Array) -> Array:
        """Vectors in root axes, in axes of a node's class."""
        frame = node.frame
        if frame.index not in self._axes:
            flat = [entry for row in self.frames.from_root(frame) for entry in row]
            values = evaluated(self.tree.closure, self.tree.samples, flat)
            self._axes[frame.index] = values.reshape(-1, 3, 3)
        return np.asarray(np.einsum("sij,si->sj", self._axes[frame.index], x))


def _with_pairs(points: _Points, inertia: dict[int, Inertia], given: set[int]) -> Regrouped:
    """Bodies without a tensor, their moment along the way to where they close, as two points."""
    pairs: list[Pair] = []
    for node in points.tree.nodes[1:]:
        body = inertia[node.index]
        if body.turns or not body.leans or (node.variables and set(node.variables) <= given):
            continue
        pair = next(_pairs_of(points, node, body), None)
        if pair is None:
            continue
        pairs.append(pair)
        mass = as_vector(body)[0] - 2 * pair.k
        point = from_vector(mass * as_vector(mass_at(pair.p_a)))
        inertia[node.index] = Inertia()
        if pair.a.index in inertia:
            total = as_vector(inertia[pair.a.index]) + as_vector(point)
            inertia[pair.a.index] = from_vector(total)
    return Regrouped(inertia, tuple(pairs))


def _pairs_of(points: _Points, node: Node, body: Inertia) -> Iterator[Pair]:
    """Ways to see a body as its origin, on the outermost node that has it, and a closing point."""
    start, p = outermost(node, al.ZERO)
    small = SAME * points.tree.samples.length
    origin, moment = points.track(start, p), np.array(body.moment, dtype=float)
    for tie in points.ties:
        for end in (tie.a, tie.b):
            if node in end.node.ancestors():
                continue
            own = points.in_axes(node, points.track(end.node, end.point) - origin)
            r = own[0]
            if np.linalg.norm(r) < small or np.abs(own - r).max() > small:
                continue
            if np.linalg.norm(np.cross(r, moment)) < SAME * np.linalg.norm(r) * np.linalg.norm(
                moment
            ):
                yield Pair(start, p, end.node, end.point, float(moment @ r / (r @ r)))
