"""Following one assembly of a mechanism while some of its variables are given values."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from gough.assembly import Assembler
from gough.numerics.newton import Ending

Array = NDArray[np.float64]

STEPS = 30
"""Newton steps of one move; a move that needs more goes too far."""
DIVISIONS = (1, 4)
"""Parts that a move is made in: first whole, then cut."""
JUMP = 1.0
"""Largest change of a position within one part, rad and characteristic lengths; a guess: more
is taken for another assembly."""
FLAT = 1e-6
"""Singular values below this times the largest give no direction and no side."""


class Follower:
    """Moves a closed configuration to other values of the held variables, in the same assembly.

    Args:
        assembler: the mechanism.
        home: a closed configuration, (positions,), which displacements are counted from.
        held: indices of the variables that are given.
        rank: generic rank of the columns of the other variables in E.
    """

    def __init__(self, assembler: Assembler, home: Array, held: Sequence[int], rank: int) -> None:
        self.assembler, self.models, self.home = assembler, assembler.models, home
        self.rank = rank
        self.held = np.zeros(len(self.models.structure.variables), dtype=bool)
        self.held[list(held)] = True
        self.whole = [k for k in range(len(self.models.structure.edges)) if self._is_held(k)]
        self.position_scale = assembler.position_scale

    def move(self, q: Array, at: Array, to: Array) -> Array | None:
        """The configuration at a displacement, or None if this assembly does not reach it.

        Args:
            q: a closed configuration, (positions,).
            at: its displacement from home: rates held for a unit of time, (variables,).
            to: the displacement to reach; both are zero but for held variables.
        """
        for parts in DIVISIONS:
            there = self._in_parts(q, at, to, parts)
            if there is not None:
                return there
        return None

    def _in_parts(self, q: Array, at: Array, to: Array, parts: int) -> Array | None:
        here: Array | None = q
        for k in range(parts):
            if here is None:
                return None
            before, after = (at + (to - at) * (k + d) / parts for d in (0, 1))
            here = self._once(here, before, after)
        return here

    def _once(self, q: Array, at: Array, to: Array) -> Array | None:
        """One tangent step and its correction by Newton.

        With U S Vᵀ of rank r of the free columns of E at q, the free part of the tangent is
        -V S⁻¹ Uᵀ E_held δ. There the determinant of Uᵀ E V is positive; where it has changed
        sign, an odd number of legs have gone over to their other working mode.
        """
        E = self.assembler.scaled_jacobian(q)
        U, s, Vt = np.linalg.svd(E[:, ~self.held], full_matrices=False)
        U, s, Vt = U[:, : self.rank], s[: self.rank], Vt[: self.rank]
        step = (to - at) / self.assembler.rate_scale
        sharp = bool(s.size) and s[-1] > FLAT * s[0]
        if sharp:
            tangent = -Vt.T @ ((U.T @ (E[:, self.held] @ step[self.held])) / s)
            step[~self.held] = tangent * min(1.0, JUMP / (float(np.abs(tangent).max()) or 1.0))
        start = self._placed(self.models.retract(q, self.assembler.rate_scale * step), to)
        found = self.assembler.close(start, self.held, STEPS)
        if found.ending is not Ending.closed:
            return None
        if np.abs((found.q - q) / self.position_scale).max(initial=0.0) > JUMP:
            return None
        if sharp:
            there = self.assembler.scaled_jacobian(found.q)[:, ~self.held]
            if np.linalg.det(U.T @ there @ Vt.T) <= 0:
                return None
        return found.q

    def _placed(self, q: Array, displacement: Array) -> Array:
        """q with the joints that are held in all their freedoms exactly where they shall be."""
        target = self.models.retract(self.home, displacement)
        for k in self.whole:
            part = self.models.closure.slices[k]
            q[part] = target[part]
        return q

    def _is_held(self, edge: int) -> bool:
        own = [
            self.held[k] for k, v in enumerate(self.models.structure.variables) if v.edge == edge
        ]
        return bool(own) and all(own)
