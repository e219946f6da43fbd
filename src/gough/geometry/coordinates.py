"""Actuated and operational coordinates of configurations, in batches."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gough.joints import Free
from gough.models import Models
from gough.topology import Role

Array = NDArray[np.float64]


class Coordinates:
    """Where the numbers of a role stand in a configuration q.

    Joints whose freedoms all have the role give their whole position, a pose its 7 numbers. A
    platform with some rotations of the role, but not all freedoms, gives entries of its rotation
    vector for them.
    """

    def __init__(self, models: Models, role: Role) -> None:
        self.models, self.role = models, role
        self.whole: list[int] = []
        """Places in q, where the coordinates are positions as they stand."""
        self.names: list[str] = []
        self.units: list[str] = []
        self.turned: list[tuple[int, slice, int]] = []
        """Place among the coordinates, quaternion in q, and axis of a rotation vector's entry."""
        for k in range(len(models.structure.edges)):
            self._take(k)

    def _take(self, k: int) -> None:
        edge, part = self.models.structure.edges[k], self.models.closure.slices[k]
        variables = [v for v in self.models.structure.variables if v.edge == k]
        roles = [v.role == self.role for v in variables]
        quaternion = edge.type.coordinates > len(variables)
        if roles and all(roles):
            self.whole += range(part.start, part.stop)
            self.units += [v.unit for v in variables][: -3 if quaternion else None]
            self.units += ["1"] * (4 if quaternion else 0)
            labels = list(edge.type.labels)
            if quaternion:
                labels[-3:] = ["qw", "qx", "qy", "qz"]
            self.names += [_name(edge.name, label, edge.link) for label in labels]
            return
        for variable, chosen in zip(variables, roles, strict=True):
            if not chosen:
                continue
            place = part.start + variable.freedom
            if quaternion and variable.unit == "rad":
                axis = variable.freedom - (len(variables) - 3)
                self.turned.append((len(self.whole), slice(part.stop - 4, part.stop), axis))
            self.whole.append(place)
            self.units.append(variable.unit)
            self.names.append(_name(edge.name, edge.type.labels[variable.freedom], edge.link))

    def __len__(self) -> int:
        return len(self.whole)

    @property
    def settable(self) -> bool:
        """Whether coordinates can be written into a configuration one by one."""
        return not self.turned

    def of(self, q: Array) -> Array:
        """The coordinates of configurations, (*batch, n)."""
        x = np.array(q[..., self.whole])
        for place, quaternion, axis in self.turned:
            x[..., place] = _rotation_vectors(q[..., quaternion])[..., axis]
        return x

    def put(self, q: Array, x: Array) -> Array:
        """Configurations with these coordinates and all else as in q, (*batch, positions)."""
        assert self.settable
        batch = np.broadcast_shapes(q.shape[:-1], x.shape[:-1])
        placed = np.array(np.broadcast_to(q, (*batch, q.shape[-1])))
        placed[..., self.whole] = x
        return placed


def _name(joint: str, label: str, link: bool) -> str:
    if link:
        return label
    return f"{joint}.{label}" if label else joint


def _rotation_vectors(q_wxyz: Array) -> Array:
    """Rotation vectors of unit quaternions, of at most half a turn, (*batch, 3)."""
    w, v = q_wxyz[..., :1], q_wxyz[..., 1:]
    size = np.linalg.norm(v, axis=-1, keepdims=True)
    angle = 2 * np.arctan2(size, np.abs(w)) * np.where(w >= 0, 1.0, -1.0)
    return np.asarray(v * np.where(size > 0, angle / np.where(size > 0, size, 1.0), 2.0))


def translates(models: Models, home: Array, others: Array) -> bool:
    """Whether the platform keeps its orientation over closed configurations.

    Args:
        home: a configuration, (positions,).
        others: more of them on the same motion, (rows, positions).
    """
    structure = models.structure
    platform = structure.mechanism.platform
    if platform is None:
        return False
    edge = structure.edges[structure.edge_to[platform]]
    part = models.closure.slices[structure.edge_to[platform]]
    if not isinstance(edge.type, Free) or edge.type.coordinates == edge.type.freedoms:
        return False
    here, there = home[part][-4:], others[:, part][:, -4:]
    return bool(len(others)) and bool(np.all(np.abs(np.abs(there @ here) - 1) < 1e-12))
