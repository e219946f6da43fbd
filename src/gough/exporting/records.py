"""Inputs near home and what the models make of them, to be compared with elsewhere."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gough.dynamics.dynamics import Dynamics
from gough.exporting.models import Exported

Array = NDArray[np.float64]

STATES = 20
REACH = 0.1
"""How far from home states are at most, as for `Assembler.wander`."""
TRIES = 3
"""Walks for each state; where they find too few, home stands in."""


@dataclass(frozen=True)
class Records:
    """States and results of one robot."""

    inputs: dict[str, Array]
    """Rows of each input, by its name."""
    results: dict[str, Array]
    """Rows of each model's results, by its name."""


def recorded(
    dynamics: Dynamics, models: Sequence[Exported], states: int = STATES, seed: int = 0
) -> Records:
    """Results of models at random closed states near home.

    Args:
        dynamics: the robot's.
        models: those that run.
        states: how many.
        seed: of the states.
    """
    rng = np.random.default_rng(seed)
    inputs = _inputs(dynamics, models, _configurations(dynamics, rng, states), rng)
    results = {}
    for model in models:
        given = [inputs[label] if size else np.zeros(0) for label, size in _sizes(model)]
        results[model.name] = model.kernel(*given).reshape(states, -1)
    return Records(inputs, results)


def _sizes(model: Exported) -> list[tuple[str, int]]:
    return list(model.kernel.inputs.items())


def _configurations(dynamics: Dynamics, rng: np.random.Generator, states: int) -> Array:
    """Closed configurations near home, home first."""
    home, found = dynamics.home, [dynamics.home]
    for _ in range(TRIES * states):
        if len(found) == states:
            break
        q = dynamics.assembler.wander(home, rng, REACH * rng.uniform(0.2, 1))
        if q is not None:
            found.append(q)
    found += [home] * (states - len(found))
    return np.array(found[:states])


def _inputs(
    dynamics: Dynamics, models: Sequence[Exported], q: Array, rng: np.random.Generator
) -> dict[str, Array]:
    """Rows of every input that some model takes."""
    sizes = {label: size for model in models for label, size in _sizes(model) if size}
    found = {"q": q, "p": np.tile(dynamics.assembler.p, (len(q), 1))}
    if "x" in sizes:
        assert dynamics.inverse_geometry is not None
        found["x"] = dynamics.inverse_geometry.checked(dynamics.inverse_geometry.coordinates.of(q))
    length = dynamics.assembler.length
    by_name = {model.name: model for model in models}
    for label, model in (("y", "rates"), ("yd", "accelerations")):
        if label in sizes:
            units = [unit for _, unit in by_name[model].inputs[label]]
            scale = np.array([length if unit.startswith("m") else 1.0 for unit in units])
            found[label] = rng.normal(size=(len(q), len(units))) * scale
    if "tau" in sizes:
        found["tau"] = 10 * rng.normal(size=(len(q), sizes["tau"]))
    return {label: rows for label, rows in found.items() if label in sizes}
