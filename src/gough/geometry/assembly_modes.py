"""The list of assembly modes that a user holds: every solution of the direct problem."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

SHOWN = 8
"""Joints in the table of a mechanism without outputs."""


@dataclass(frozen=True, eq=False)
class AssemblyModes:
    """Every assembly mode for some actuated positions."""

    robot: str
    q_actuated: Array
    """The actuated positions, (actuated,)."""
    x: Array
    """Operational coordinates of each mode, (k, n)."""
    poses: Array
    """Poses of the platform, x y z and the quaternion w x y z, (k, 7); (0, 7) without platform."""
    certified: Mask
    """Which modes are proved to exist, real and alone near this solution, (k,)."""
    status: str
    """*certified*: the list is proved complete; *expected*: as many complex solutions were found as
    the count known, or saturated, for this mechanism; *found*: no claim."""
    complex_count: int
    """Distinct finite complex solutions, real ones among them."""
    expected: tuple[int, ...]
    """Complex solutions of general members of the mechanism's family; empty if not known."""
    endings: dict[str, int]
    """Paths by how they ended."""
    notes: tuple[str, ...] = ()
    """What a reader of the list should know."""
    names: tuple[str, ...] = ()
    """The operational coordinates."""
    position_names: tuple[str, ...] = ()
    """The numbers of a configuration."""
    _configurations: Callable[[], Array] = field(default=lambda: np.zeros((0, 0)), repr=False)

    def __len__(self) -> int:
        return len(self.certified)

    @cached_property
    def q(self) -> Array:
        """Positions of all joints in each mode, (k, positions); passive ones nearest to home."""
        return self._configurations()

    def __str__(self) -> str:
        count = f"{self.complex_count} complex solutions"
        if self.expected:
            known = " or ".join(map(str, self.expected))
            count = f"{self.complex_count} of {known} complex solutions"
        plural = "" if len(self) == 1 else "s"
        lines = [f"{len(self)} assembly mode{plural} of {self.robot}, {self.status} ({count})"]
        lines += self._table()
        endings = ", ".join(f"{n} {text}" for text, n in self.endings.items())
        if endings:
            lines.append(f"paths: {endings}")
        return "\n".join([*lines, *self.notes])

    def as_dict(self) -> dict[str, Any]:
        """The content as plain data."""
        return {
            "name": self.robot,
            "q_actuated": self.q_actuated.tolist(),
            "status": self.status,
            "complex_count": self.complex_count,
            "expected": list(self.expected),
            "coordinates": list(self.names),
            "x": self.x.tolist(),
            "poses": self.poses.tolist(),
            "certified": self.certified.tolist(),
            "endings": self.endings,
            "notes": list(self.notes),
        }

    def _table(self) -> list[str]:
        if not len(self):
            return []
        numbers, names = self._columns()
        width = max(11, *(len(name) + 2 for name in names)) if names else 11
        lines = ["   " + "".join(f"{name:>{width}}" for name in names) + "   proved"]
        for k, (row, proved) in enumerate(zip(numbers, self.certified, strict=True)):
            cells = "".join(f"{value + 0.0:+{width}.6f}" for value in row)
            lines.append(f"{k:3d}{cells}   {'yes' if proved else 'no'}")
        return lines

    def _columns(self) -> tuple[Array, tuple[str, ...]]:
        """Outputs, or without them the joints that tell the modes apart."""
        if self.names:
            return self.x, self.names
        if len(self.poses):
            return self.poses, ("x", "y", "z", "qw", "qx", "qy", "qz")
        differs = np.flatnonzero(np.ptp(self.q, axis=0) > 1e-9)[:SHOWN]
        return self.q[:, differs], tuple(self.position_names[k] for k in differs)
