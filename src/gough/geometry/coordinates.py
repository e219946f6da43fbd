"""Actuated and operational coordinates of configurations, in batches."""

from __future__ import annotations

import casadi
import numpy as np
from numpy.typing import ArrayLike, NDArray

from gough.algebra import Matrix
from gough.assembly import Assembler
from gough.errors import ConfigurationError
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

    def of(self, q: Array) -> Array:
        """The coordinates of configurations, (*batch, n)."""
        x = np.array(q[..., self.whole])
        for place, quaternion, axis in self.turned:
            x[..., place] = _rotation_vectors(q[..., quaternion])[..., axis]
        return x

    def expression(self, q: casadi.SX) -> casadi.SX:
        """The coordinates of a configuration as an expression, a column."""
        values = [q[k] for k in self.whole]
        for place, quaternion, axis in self.turned:
            values[place] = _rotation_vector(q[quaternion])[axis]
        return casadi.vertcat(*values) if values else casadi.SX(0, 1)

    def numbers(self, name: str, given: ArrayLike, length: float, *, batch: bool = True) -> Array:
        """Coordinates that a person gives as an array, (*batch, n) or (n,).

        Args:
            name: of the argument, for messages.
            given: the coordinates.
            length: the characteristic length, m.
            batch: whether there may be more than one set.

        Raises:
            ConfigurationError: the shape is wrong, or a value is no number, not finite, or a length
                far beyond the mechanism.
        """
        names = ", ".join(self.names)
        try:
            values = np.array(given, dtype=float)
        except (TypeError, ValueError):
            raise ConfigurationError(f"{name} is {given!r}, expected numbers: {names}") from None
        n = len(self)
        if values.ndim == 0 or values.shape[-1] != n or (values.ndim > 1 and not batch):
            shape = f"(..., {n})" if batch else f"({n},)"
            raise ConfigurationError(f"{name} has shape {values.shape}, expected {shape}: {names}")
        if not np.all(np.isfinite(values)):
            raise ConfigurationError(f"{name} has entries that are not finite")
        lengths = [k for k, unit in enumerate(self.units) if unit == "m"]
        most = np.abs(values[..., lengths]).max(initial=0.0)
        if most > FARTHEST * length:
            raise ConfigurationError(
                f"{name} has a length of {most:.3g} m, more than {FARTHEST:g} times the size of "
                f"the mechanism, {length:.3g} m"
            )
        return values

    def put(self, q: Array, x: Array) -> Array:
        """Configurations with these coordinates and all else as in q, (*batch, positions).

        Entries of a rotation vector replace those of q's, the others of it stay.
        """
        batch = np.broadcast_shapes(q.shape[:-1], x.shape[:-1])
        placed = np.array(np.broadcast_to(q, (*batch, q.shape[-1])))
        plain = [k for k in range(len(self)) if k not in {place for place, *_ in self.turned}]
        placed[..., [self.whole[k] for k in plain]] = x[..., plain]
        if self.turned:
            quaternion = self.turned[0][1]
            vector = _rotation_vectors(placed[..., quaternion])
            for place, _, axis in self.turned:
                vector[..., axis] = x[..., place]
            placed[..., quaternion] = _quaternions(vector)
        return placed

    def fix_platform(self, q: Array) -> bool:
        """Whether what they leave of the platform's pose is constant over configurations.

        Args:
            q: closed configurations on one motion, (rows, positions).
        """
        structure = self.models.structure
        edge = structure.edge_to[str(structure.mechanism.platform)]
        part, roles = self.models.closure.slices[edge], []
        for variable in structure.variables:
            if variable.edge == edge:
                roles.append((variable.unit, variable.role == self.role))
        position = q[:, part]
        if position.shape[1] > len(roles):
            position = np.concatenate([position[:, :-4], _rotation_vectors(position[:, -4:])], 1)
        left = position[:, [k for k, (_, given) in enumerate(roles) if not given]]
        return bool(np.all(np.ptp(left, axis=0) < CONSTANT)) if len(q) > 1 else left.shape[1] == 0


def position_names(models: Models) -> tuple[str, ...]:
    """A name for each number of a configuration."""
    names: list[str] = []
    for edge in models.structure.edges:
        labels = list(edge.type.labels)
        if edge.type.coordinates > edge.type.freedoms:
            labels[-3:] = ["qw", "qx", "qy", "qz"]
        names += [f"{edge.name}.{label}" if label else edge.name for label in labels]
    return tuple(names)


FARTHEST = 1e6
"""Lengths of more characteristic lengths are refused: their squares would swamp all others."""
CONSTANT = 1e-9
"""How much a coordinate may change on a motion that leaves it constant, m or rad."""


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


def _rotation_vector(q_wxyz: casadi.SX) -> casadi.SX:
    """The same as an expression whose derivative exists at rest too."""
    w, v = q_wxyz[0], q_wxyz[1:]
    square = casadi.sumsqr(v)
    small = square < 1e-8
    size = casadi.sqrt(casadi.if_else(small, 1.0, square))
    sign = casadi.if_else(w >= 0, 1.0, -1.0)
    angle = 2 * casadi.atan2(size, casadi.fabs(w))
    # 2 asin(s) / s = 2 + s²/3 + …, with what follows below 1e-16
    return v * sign * casadi.if_else(small, 2 + square / 3, angle / size)


def _quaternions(vectors: Array) -> Array:
    """Unit quaternions (w, x, y, z) of rotation vectors, (*batch, 4)."""
    angle = np.linalg.norm(vectors, axis=-1, keepdims=True)
    half = 0.5 * np.sinc(angle / (2 * np.pi))
    return np.concatenate([np.cos(angle / 2), half * vectors], axis=-1)


def constant_turn(models: Models, assembler: Assembler, q: Array) -> Matrix | None:
    """R_base_platform where the platform keeps it over configurations, else None.

    Args:
        models: the mechanism's models.
        assembler: its parameters.
        q: closed configurations on one motion, (rows, positions).
    """
    structure = models.structure
    platform = structure.mechanism.platform
    if platform is None or len(q) < 2:
        return None
    poses = models.poses(q, assembler.p)[..., :3, :3]
    R = poses[:, structure.bodies.index(platform)]
    if structure.mechanism.floating:
        R = np.swapaxes(poses[:, structure.bodies.index(structure.mechanism.base)], 1, 2) @ R
    if structure.mechanism.motion == "planar" or np.max(np.ptp(R, axis=0)) > CONSTANT:
        return None
    rows = np.where(np.abs(R[0] - np.round(R[0])) < 1e-12, np.round(R[0]), R[0])
    return tuple(tuple(row) for row in rows.tolist())  # type: ignore[return-value]
