"""Which joints a model cuts: the same mechanism as other trees, and the cheapest of them.

What hangs on the platform moves as it is told, and its inertia needs no reflecting; so it pays to
cut legs where little is left on their own side. The number of operations decides.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gough.assembly import Assembler
from gough.cache import Cache, digest
from gough.description import Mechanism
from gough.description.frames import transform
from gough.models import Models
from gough.numerics.newton import Ending
from gough.topology import WORLD, Modelling, Structure

Array = NDArray[np.float64]

MOST = 12
"""Plans that are tried at most."""


@dataclass(frozen=True)
class Plan:
    """A way to cut the loops."""

    modelling: Modelling
    cut: tuple[str, ...]


def plans(structure: Structure) -> Iterator[Plan]:
    """Other trees of a mechanism: without pieces of the platform, and cut at other passive pins.

    Legs with a ball joint are cut there as it is; only loops that close with pins have a choice.
    """
    if not _has_choice(structure):
        return
    if structure.modelling == "cut-platform":
        yield Plan("cut-joints", ())
    bound = {name for coupling in structure.flat.couplings.values() for name in coupling.terms}
    bound |= set(structure.mechanism.operational)
    by_kind: dict[str, list[str]] = {}
    for leg in structure.legs:
        for name in leg.joints:
            joint = structure.flat.joints[name]
            stays = joint.actuated or joint.actuators or name in bound
            if joint.type == "revolute" and not stays:
                by_kind.setdefault(name.rpartition(".")[2], []).append(name)
    for names in by_kind.values():
        yield Plan("cut-joints", tuple(names))


def _has_choice(structure: Structure) -> bool:
    """Whether a loop through the platform closes with a pin, or by a piece of the platform."""
    return any(c.type in ("revolute", "frames-coincide") for c in structure.closings)


@dataclass(frozen=True)
class Planned:
    """A mechanism as another tree."""

    models: Models
    assembler: Assembler
    home: Array


def planned(plan: Plan, models: Models, assembler: Assembler, home: Array) -> Planned | None:
    """The mechanism as the tree of a plan, closed as at home; None if the plan is none for it."""
    mechanism = models.structure.mechanism
    content = mechanism.model_dump(exclude_unset=True) | {"cut": plan.cut}
    try:
        other = Models(Structure(Mechanism.model_validate(content), plan.modelling))
    except ValueError:  # a joint that this tree would need, or that can not be cut
        return None
    found = Assembler(other, assembler.p)
    closed = found.close(converted(models, assembler, home, other))
    if closed.ending is not Ending.closed:
        return None
    return Planned(other, found, closed.q)


def converted(models: Models, assembler: Assembler, q: Array, other: Models) -> Array:
    """A configuration of one tree as one of another."""
    structure = models.structure
    own = {edge.name: k for k, edge in enumerate(structure.edges)}
    poses = dict(zip(structure.bodies, models.poses(q, assembler.p), strict=True))
    poses.setdefault(structure.mechanism.base, np.eye(4))
    poses.setdefault(WORLD, np.eye(4))
    found = np.zeros(other.positions)
    values = assembler.values
    for edge, part in zip(other.structure.edges, other.closure.slices, strict=True):
        if edge.name in own:
            found[part] = q[models.closure.slices[own[edge.name]]]
            continue
        ends = []
        for body, frame in zip(edge.bodies, edge.frames, strict=True):
            R, p = transform(frame, values)
            T = np.eye(4)
            T[:3, :3], T[:3, 3] = np.array(R, dtype=float), np.array(p, dtype=float)
            ends.append(poses[body.partition("@")[0]] @ T)
        dimensions = {k: float(x) for k, x in other.closure.dimensions(edge).items()}
        found[part] = edge.type.measured(np.linalg.solve(ends[0], ends[1]), dimensions)
    return found


# kept on disk


def key_of(models: Models, *more: str) -> bytes:
    """Under which the plan of a mechanism is kept."""
    content = models.structure.mechanism.model_dump_json(exclude_unset=True)
    return digest("plan 1", content, models.structure.modelling, *more)


def kept(cache: Cache, key: bytes) -> Plan | bool | None:
    """The plan kept under a key; None stands for the mechanism's own tree, False for nothing."""
    content = cache.get(key)
    if content is None:
        return False
    found: dict[str, Any] | None = json.loads(content)
    return None if found is None else Plan(found["modelling"], tuple(found["cut"]))


def keep(cache: Cache, key: bytes, plan: Plan | None) -> None:
    """Keep a plan."""
    content = None if plan is None else {"modelling": plan.modelling, "cut": list(plan.cut)}
    cache.put(key, json.dumps(content).encode())
