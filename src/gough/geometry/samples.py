"""Closed configurations from which the structure of the closure equations is read."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gough.assembly import Assembler
from gough.numerics.newton import Ending
from gough.symbolic.closing_rates import Samples
from gough.symbolic.plans import generic_rank

Array = NDArray[np.float64]

COUNT, ENOUGH, SPARE = 10, 4, 6
"""Configurations that are looked for at least, how many suffice to tell what never changes, and
how many motions there should be beyond the number of variables."""
REACH = (0.1, 0.6)
"""Range of the length of the walks to them; see `Assembler.wander`."""
SHARP = 1e-6
"""Singular values kept must be above this times the largest, or a rank there is not clear."""
AWAY = 0.01
"""Least distance between samples, rad or characteristic lengths; a guess."""
VARIED = 0.02
"""Relative change of live parameters, so that what holds does not hang on their values."""


@dataclass(frozen=True)
class Sampled:
    """Samples with the closure Jacobians there."""

    samples: Samples
    E: Array
    """Scaled, (samples, rows, variables)."""
    E_open: Array | None
    """The same at open configurations, if the closed ones are too few to tell what is zero."""

    def rank(self, columns: Sequence[int]) -> int:
        """Generic rank of some columns."""
        return generic_rank(self.E, columns)


def sample(assembler: Assembler, home: Array, seed: int) -> Sampled:
    """Closed configurations near home, found in small steps, home among them if it is regular.

    Live parameters differ in half of them.
    """
    rng = np.random.default_rng(seed)
    found = [(home, assembler.p)]
    for k in range(_tries(assembler, home)):
        q = assembler.wander(home, rng, rng.uniform(*REACH))
        if q is None or min(assembler.distance(q, other) for other, _ in found) < AWAY:
            continue
        if not assembler.p.size or k % 2 == 0:
            found.append((q, assembler.p))
        elif (other := _with_other_parameters(assembler, q, rng)) is not None:
            found.append(other)
    varied = sum(p is not assembler.p for _, p in found)
    E = np.array([_scaled(assembler, q, p) for q, p in found])
    sharp = [k for k, e in enumerate(E) if _is_sharp(e, E)] or [0]
    telling = len(sharp) >= ENOUGH and (varied > 0 or not assembler.p.size)
    samples = Samples(
        np.array([found[k][0] for k in sharp]),
        np.array([found[k][1] for k in sharp]),
        assembler.row_scale,
        assembler.rate_scale,
        assembler.length,
        telling,
    )
    return Sampled(samples, E[sharp], None if telling else _open(assembler, home, rng))


def with_more(sampled: Sampled, assembler: Assembler, q: Sequence[Array]) -> Sampled:
    """The same with further closed configurations, where these are as regular as the others."""
    old = sampled.samples
    E = np.concatenate([sampled.E, [_scaled(assembler, at, assembler.p) for at in q]])
    sharp = [k for k, e in enumerate(E) if _is_sharp(e, E)]
    every = [*zip(old.q, old.p, strict=True), *((at, assembler.p) for at in q)]
    if not sharp:  # an isolated or singular assembly: nothing is regular
        return sampled
    kept = [every[k] for k in sharp]
    samples = replace(old, q=np.array([at for at, _ in kept]), p=np.array([p for _, p in kept]))
    return Sampled(samples, E[sharp], sampled.E_open)


def _tries(assembler: Assembler, home: Array) -> int:
    """How many walks give enough motions, about: each configuration has as many as freedoms."""
    E = _scaled(assembler, home, assembler.p)
    variables = len(assembler.rate_scale)
    freedoms = variables - generic_rank(E[None], range(variables))
    return max(COUNT, 2 * (variables + SPARE) // max(freedoms, 1))


def _with_other_parameters(
    assembler: Assembler, q: Array, rng: np.random.Generator
) -> tuple[Array, Array] | None:
    """A closed configuration next to q where live parameters differ a little."""
    p = assembler.p * (1 + VARIED * rng.uniform(-1, 1, assembler.p.shape))
    solution = Assembler(assembler.models, p).close(q)
    return (solution.q, p) if solution.ending is Ending.closed else None


def _open(assembler: Assembler, home: Array, rng: np.random.Generator) -> Array:
    steps = rng.normal(size=(3, len(assembler.rate_scale))) * 0.3 * assembler.rate_scale
    configurations = [assembler.models.retract(home, step) for step in steps]
    return np.array([_scaled(assembler, q, assembler.p) for q in configurations])


def _scaled(assembler: Assembler, q: Array, p: Array) -> Array:
    E = assembler.models.jacobian(q, p)
    return np.asarray(assembler.row_scale[:, None] * E * assembler.rate_scale)


def _is_sharp(e: Array, E: Array) -> bool:
    """Whether the rank is the generic one and clear."""
    if not e.size:
        return True
    rank = generic_rank(E, range(E.shape[2]))
    s = np.linalg.svd(e, compute_uv=False)
    return bool(rank == 0 or s[rank - 1] > SHARP * s[0])
