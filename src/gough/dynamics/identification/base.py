"""Base parameters: the fewest numbers that a dynamic model depends on, and how the rest joins them.

The columns of the regressor are dependent for every motion: some parameters have no effect, others
only act together (Gautier 1991; Khalil and Dombre 2002, ch. 9 and 12). At random closed states the
singular values tell how many; transfers of inertia at the joints give most relations exactly.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import svd

from gough.dynamics.identification.exact import exact_changes
from gough.dynamics.identification.parameters import MOMENTS, MOTOR, Parameters
from gough.dynamics.identification.regressor import Regressor, States
from gough.errors import ConfigurationError

Array = NDArray[np.float64]

THRESHOLD = 1e-9
"""Singular values below this part of the largest count as zero, in scaled units."""
PIVOT = 1e-3
"""A parameter is dropped where its share in what is without effect is above this; smaller shares
would make large factors."""
REACH = (0.1, 0.8)
"""Range of the length of the walks to random states; see `Assembler.wander`."""
LONG = 12
"""Walks before the next one sets out from home again."""
OBEYED, FAST = 1e-9, 1e4
"""Part of the rates that may break a closure, and rates for those of y of size 1 beyond which a
configuration is too near to a singularity; guesses."""
CLEAR = 1e4
"""A smaller gap makes the number of base parameters a matter of opinion."""
SPARE = 3
"""Rows of the sampled regressor for each parameter."""
NOTHING, EXACT = 1e-9, 1e-9
"""Factors below the first are zero; those nearer than the second to a short decimal are that."""
DIGITS = 6
"""Most decimals of a short decimal."""


@dataclass(frozen=True)
class BaseParameters:
    """Independent parameters of a model and the regrouping of all others.

    Which parameters stay is a choice. Here friction stays, then all of the platform, then inertia
    and moments of the other bodies as they are described, those described as 0 after the others.
    First to be taken over by others are rotors' inertia, then what the rules of Khalil and Dombre
    regroup: masses of bodies on pins and balls, inertia of bodies on slides.
    """

    names: tuple[str, ...]
    """A name for each; a star behind it where others joined it."""
    all_names: tuple[str, ...]
    """Of all parameters."""
    kept: tuple[int, ...]
    """Places of the base parameters among all: these columns of a regressor are its base."""
    matrix: Array
    """Base parameters of all parameters, (base, all)."""
    values: Array
    """As described, (base,)."""
    units: tuple[str, ...]
    rank: int
    gap: float
    """Smallest kept over largest dropped singular value; inf where none is dropped."""
    states: int
    """Random closed states that were looked at."""
    inertial: int
    """How many parameters are of bodies."""
    sampled: int
    """Independent changes of bodies' inertia without effect, by sampling."""
    transferred: int | None
    """The same by exact transfers at joints; None where frames hang on live parameters. Fewer than
    `sampled` where no single joint but the motion of the whole makes a change disappear: parallel
    axes, gravity that always points the same way."""
    transfer_residual: float
    """Largest effect of an exact transfer at the states, relative: 0 but for rounding."""

    def __len__(self) -> int:
        return self.rank

    @property
    def without_effect(self) -> tuple[str, ...]:
        """Parameters that no base parameter contains."""
        used = np.any(self.matrix != 0, axis=0)
        return tuple(n for n, k in zip(self.all_names, used, strict=True) if not k)

    @property
    def formulas(self) -> tuple[str, ...]:
        """Each base parameter as a sum of all, in words."""
        return tuple(
            f"{name} = {_sum(row, self.all_names, kept)}"
            for name, row, kept in zip(self.names, self.matrix, self.kept, strict=True)
        )

    def of(self, values: Array) -> Array:
        """Base parameters of values of all, (..., base)."""
        return np.asarray(values @ self.matrix.T)

    def columns(self, Y: Array) -> Array:
        """The columns of a regressor that base parameters are multiplied by."""
        return np.asarray(Y[..., list(self.kept)])

    def __str__(self) -> str:
        lines = [
            f"{self.rank} base parameters of {len(self.all_names)} "
            f"(gap {self.gap:.1e} at {self.states} states)",
            _counts(self),
        ]
        if self.gap < CLEAR:
            lines.append("the gap is small: how many there are is a matter of opinion")
        width = max((len(f"{x:.6g}") for x in self.values), default=0)
        for value, unit, text in zip(self.values, self.units, self.formulas, strict=True):
            lines.append(f"  {value:>{width}.6g} {unit:6}  {text}")
        if self.without_effect:
            lines.append(f"without effect: {', '.join(self.without_effect)}")
        return "\n".join(lines)

    def as_dict(self) -> dict[str, Any]:
        """The content as plain data."""
        return {
            "names": list(self.names),
            "values": self.values.tolist(),
            "units": list(self.units),
            "formulas": list(self.formulas),
            "parameters": list(self.all_names),
            "matrix": self.matrix.tolist(),
            "rank": self.rank,
            "gap": self.gap if np.isfinite(self.gap) else None,
            "states": self.states,
            "changes_without_effect": {"sampled": self.sampled, "transferred": self.transferred},
            "without_effect": list(self.without_effect),
        }


def _counts(base: BaseParameters) -> str:
    if base.transferred is None:
        return f"{base.sampled} changes of inertia have no effect"
    text = f"{base.sampled} changes of inertia have no effect, {base.transferred} of them by joints"
    more = base.sampled - base.transferred
    if not more:
        return text
    return f"{text}; {more} more by the motion of the whole"


def base_parameters(regressor: Regressor, seed: int = 0) -> BaseParameters:
    """Base parameters of a mechanism, from random closed states and exact transfers.

    Args:
        regressor: of the mechanism.
        seed: of the random states.

    Raises:
        ConfigurationError: too few closed states were found.
    """
    parameters = regressor.parameters
    states = random_states(regressor, seed)
    Y = _scaled_rows(regressor, states)
    null, gap = _null_space(Y)
    inertial = parameters.inertial
    sampled = _null_space(Y[:, :inertial])[0].shape[1] if inertial else 0
    exact = exact_changes(regressor)
    if exact is not None:
        exact = np.linalg.qr(exact / parameters.scale[:inertial, None])[0]
        null = _sharpened(null, exact)
    residual = 0.0
    if exact is not None and exact.size:
        residual = float(np.abs(Y[:, :inertial] @ exact).max() / np.abs(Y).max())
    dropped, factors = _eliminated(null, keeping_order(regressor))
    kept, matrix = _matrix(parameters, dropped, factors)
    joined = (matrix != 0).sum(axis=1) > 1
    names = [parameters.names[k] + ("*" if j else "") for k, j in zip(kept, joined, strict=True)]
    return BaseParameters(
        tuple(names),
        parameters.names,
        kept,
        matrix,
        matrix @ parameters.values,
        tuple(parameters.units[k] for k in kept),
        len(kept),
        gap,
        len(states),
        inertial,
        sampled,
        None if exact is None else exact.shape[1],
        residual,
    )


def random_states(regressor: Regressor, seed: int, count: int | None = None) -> States:
    """Random closed states of the assembly of home, with rates and accelerations of any size.

    Raises:
        ConfigurationError: the walks from home do not lead to any.
    """
    rng, model, dynamics = np.random.default_rng(seed), regressor.model, regressor.dynamics
    assembler, y = dynamics.assembler, list(model.independent)
    wanted = count or (SPARE * len(regressor.parameters)) // max(len(y), 1) + 10
    found = _walked(regressor, rng, wanted)
    if not len(found):
        name = dynamics.structure.mechanism.name
        raise ConfigurationError(f"{name} does not move from its home, so that no motion tells")
    time = np.sqrt(assembler.length / 9.81)
    scale, shape = assembler.rate_scale[y], (len(found), len(y))
    rates, changes = rng.normal(size=shape), rng.normal(size=shape)
    return States(found, rates * scale / time, changes * scale / time**2)


def _walked(regressor: Regressor, rng: np.random.Generator, wanted: int) -> Array:
    """Closed configurations on walks that set out from home, each on from the one before.

    Those where the model's rates break the closures are left out: what it takes for constant does
    not hold beyond a singularity.
    """
    assembler, home = regressor.dynamics.assembler, regressor.dynamics.home
    found, q = [], home
    for k in range(2 * wanted):
        start = home if k % LONG == 0 else q
        other = assembler.wander(start, rng, rng.uniform(*REACH))
        q = home if other is None else other
        if other is not None:
            found.append(other)
    walked = np.array(found).reshape(-1, len(home))
    return walked[_obeys(regressor, walked, rng)][:wanted] if len(walked) else walked


def _obeys(regressor: Regressor, q: Array, rng: np.random.Generator) -> NDArray[np.bool_]:
    """Where rates by the model are rates of the closures, and no singularity is near."""
    model, assembler = regressor.model, regressor.dynamics.assembler
    take = (q, assembler.p) if assembler.p.size else (q,)
    y = list(model.independent)
    rates = rng.normal(size=(len(q), len(y))) * assembler.rate_scale[y]
    v = model.kernel("rates", "q")(*take, rates)
    E = model.models.jacobian(q, assembler.p) * assembler.row_scale[:, None]
    broken = np.abs(np.einsum("rij,rj->ri", E, v)).max(axis=1, initial=0.0)
    size = np.abs(v / assembler.rate_scale).max(axis=1, initial=0.0)
    with np.errstate(invalid="ignore"):
        return np.asarray((broken < OBEYED * size) & (size < FAST))


def _scaled_rows(regressor: Regressor, states: States) -> Array:
    """Forces along y of parameters of their typical sizes, each row of the same size at most."""
    W = regressor.along_rates(states) * regressor.parameters.scale
    finite = np.isfinite(W).all(axis=(1, 2))
    W = W[finite]
    rates = regressor.dynamics.assembler.rate_scale[list(regressor.model.independent)]
    rows = (W * rates[:, None]).reshape(-1, W.shape[2])
    size = np.linalg.norm(rows, axis=1, keepdims=True)
    typical = float(np.median(size)) or 1.0
    return np.asarray(rows / np.maximum(size, typical))


def _null_space(Y: Array) -> tuple[Array, float]:
    """Orthonormal changes without effect, (parameters, changes), and how clear their number is."""
    count = Y.shape[1]
    Y = np.vstack([Y, np.zeros((max(count - len(Y), 0), count))])
    # numpy's divide and conquer does not converge for some of these
    _, s, Vt = svd(np.linalg.qr(Y, mode="r"), lapack_driver="gesvd")
    rank = int(np.sum(s > THRESHOLD * s[0])) if s.size and s[0] > 0 else 0
    gap = np.inf
    if 0 < rank < count and s[rank] > 0:
        gap = float(s[rank - 1] / s[rank])
    return Vt[rank:].T, gap


def _sharpened(null: Array, exact: Array) -> Array:
    """The null space as what is exact, and what of the sampled one is orthogonal to that."""
    whole = np.zeros((len(null), exact.shape[1]))
    whole[: len(exact)] = exact
    more = null.shape[1] - whole.shape[1]
    if more <= 0:
        return whole if more == 0 else null
    U, _, _ = np.linalg.svd(null - whole @ (whole.T @ null), full_matrices=False)
    return np.hstack([whole, U[:, :more]])


def keeping_order(regressor: Regressor) -> list[int]:
    """Places of all parameters, those that are kept by preference first; see `BaseParameters`."""
    parameters, tree = regressor.parameters, regressor.model.tree
    platform, values = parameters.structure.mechanism.platform, parameters.values
    slides = {body for body in parameters.bodies if tree.of_body[body][0].kind == "slide"}

    def rank(k: int) -> int:
        kind = parameters.kinds[k]
        if kind in MOTOR:
            return 5 if kind == "Ia" else 0
        if parameters.owners[k] == platform:
            return 1
        if (kind == "m") != (parameters.owners[k] in slides) and kind not in MOMENTS:
            return 4
        return 2 if values[k] else 3

    return sorted(range(len(parameters)), key=lambda k: (rank(k), k))


def _eliminated(null: Array, order: Sequence[int]) -> tuple[list[int], Array]:
    """Parameters that others take over, and changes that set one of them each, (changes, all).

    Gauss-Jordan elimination of the changes without effect, the columns in the order of dropping.
    """
    rows = null.T.copy()
    dropped: list[int] = []
    for k in reversed(order):
        n = len(dropped)
        if n == len(rows):
            break
        pivot = n + int(np.argmax(np.abs(rows[n:, k])))
        if abs(rows[pivot, k]) < PIVOT:
            continue
        rows[[n, pivot]] = rows[[pivot, n]]
        rows[n] /= rows[n, k]
        others = np.arange(len(rows)) != n
        rows[others] -= np.outer(rows[others, k], rows[n])
        rows[n + 1 :] = _orthonormal(rows[n + 1 :])
        dropped.append(k)
    return dropped, rows


def _orthonormal(rows: Array) -> Array:
    """A well-conditioned basis of the same rows."""
    return np.linalg.qr(rows.T)[0].T if len(rows) else rows


def _matrix(
    parameters: Parameters, dropped: Sequence[int], factors: Array
) -> tuple[tuple[int, ...], Array]:
    """Places of base parameters, and how they are made of all, (base, all)."""
    count = len(parameters)
    kept = tuple(k for k in range(count) if k not in set(dropped))
    matrix = np.zeros((len(kept), count))
    matrix[range(len(kept)), kept] = 1.0
    scale = parameters.scale
    for k, change in zip(dropped, factors, strict=True):
        small = np.abs(change) < NOTHING
        column = np.where(small, 0.0, -change * scale / scale[k])[list(kept)]
        matrix[:, k] = [_cleaned(x) for x in column.tolist()]
    return kept, matrix


def _cleaned(x: float) -> float:
    """A short decimal where that is the number but for rounding."""
    for digits in range(DIGITS + 1):
        near = round(x, digits)
        if abs(x - near) <= EXACT * max(1.0, abs(x)) and near != 0:
            return near
    return x


# words


def _sum(row: Array, names: Sequence[str], first: int) -> str:
    """a + 0.25 b - c, the kept one first."""
    order = [first, *(k for k in np.flatnonzero(row).tolist() if k != first)]
    text = names[first]
    for k in order[1:]:
        size = abs(float(row[k]))
        factor = "" if size == 1 else f"{size:.10g} "
        text += f" {'-' if row[k] < 0 else '+'} {factor}{names[k]}"
    return text
