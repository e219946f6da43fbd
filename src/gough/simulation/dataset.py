"""Results of simulations as xarray datasets with units."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from gough.actuators.base import unit_of
from gough.dynamics.dynamics import Dynamics
from gough.geometry.coordinates import Coordinates, position_names
from gough.simulation.forces import Placed
from gough.simulation.run import Trace

if TYPE_CHECKING:
    import xarray

Array = NDArray[np.float64]

ENERGIES = {
    "kinetic": "kinetic energy",
    "potential": "potential energy, from the origin of the base",
    "stored": "energy stored in springs and stops",
    "delivered": "energy that actuators have delivered",
    "dissipated": "energy that was lost",
}
FULL = 7
"""Numbers of a pose."""


def of_trace(
    dynamics: Dynamics, laws: tuple[Placed, ...], trace: Trace, about: Mapping[str, Any]
) -> xarray.Dataset:
    """One run as a dataset."""
    import xarray

    outputs = Coordinates(dynamics.models, "operational")
    variables: dict[str, Any] = {}
    coords: dict[str, Any] = {"time": ("time", trace.times, {"units": "s"})}
    _add_outputs(variables, coords, dynamics, outputs, trace)
    _add_joints(variables, coords, dynamics, trace)
    _add_laws(variables, coords, laws, trace)
    for k, (name, text) in enumerate(ENERGIES.items()):
        attributes = {"units": "J", "long_name": text}
        variables[f"energy_{name}"] = ("time", trace.energies[:, k], attributes)
    variables["energy_balance_error"] = (
        "time",
        trace.balance,
        {"units": "J", "long_name": "what the energies miss of being in balance"},
    )
    times = [t for t, _ in trace.events]
    variables["event_time"] = ("event", np.array(times), {"units": "s"})
    coords["event"] = ("event", np.array([name for _, name in trace.events], dtype=str))
    variables["ending"] = ((), trace.ending.name, {"long_name": trace.ending.value})
    used = [
        {"from": t, "coordinates": place, "independent": list(names)}
        for t, place, names in trace.formulations
    ]
    told: dict[str, Any] = {
        **about,
        "end": trace.end,
        **trace.counts,
        "formulations": json.dumps(used),
    }
    return xarray.Dataset(variables, coords, told)


def _add_outputs(
    variables: dict[str, Any],
    coords: dict[str, Any],
    dynamics: Dynamics,
    outputs: Coordinates,
    trace: Trace,
) -> None:
    """Pose and twist, or operational coordinates and their rates."""
    if not len(outputs):
        return
    structure = dynamics.structure
    columns = structure.columns("operational")
    full = len(outputs) == FULL and len(columns) == FULL - 1
    x, xd = ("pose", "twist") if full else ("x", "xd")
    coords[f"{x}_part"] = (f"{x}_part", np.array(outputs.names, dtype=str))
    coords[f"{xd}_part"] = (
        f"{xd}_part",
        np.array([structure.variables[k].name for k in columns], dtype=str),
    )
    told = "origin of the platform in base axes, then its orientation as a quaternion w, x, y, z"
    variables[x] = (
        ("time", f"{x}_part"),
        trace.x,
        {"units": _one(outputs.units), "long_name": told if full else "operational coordinates"},
    )
    units = [f"{structure.variables[k].unit}/s" for k in columns]
    told = "velocity of the platform's origin, then its angular velocity, in base axes"
    variables[xd] = (
        ("time", f"{xd}_part"),
        trace.xd,
        {"units": _one(units), "long_name": told if full else "rates of the outputs"},
    )


def _add_joints(
    variables: dict[str, Any], coords: dict[str, Any], dynamics: Dynamics, trace: Trace
) -> None:
    structure = dynamics.structure
    names = [variable.name for variable in structure.variables]
    coords["coordinate"] = ("coordinate", np.array(position_names(dynamics.models), dtype=str))
    coords["variable"] = ("variable", np.array(names, dtype=str))
    variables["q"] = (
        ("time", "coordinate"),
        trace.q,
        {"units": "m, rad, 1", "long_name": "positions of the joints of the tree"},
    )
    variables["v"] = (
        ("time", "variable"),
        trace.v,
        {"units": "m/s, rad/s", "long_name": "rates of the joints of the tree"},
    )


def _add_laws(
    variables: dict[str, Any], coords: dict[str, Any], laws: tuple[Placed, ...], trace: Trace
) -> None:
    """Forces, positions, rates and memories of the actuators."""
    coords["actuator"] = ("actuator", np.array([law.name for law in laws], dtype=str))
    kinds = {"force": "force", "position": "position", "rate": "rate"}
    values = {"force": trace.forces, "position": trace.law_positions, "rate": trace.law_rates}
    texts = {
        "force": "force on the joint, positive where it pushes the position up",
        "position": "position of the joint less the actuator's reference",
        "rate": "rate of the joint",
    }
    for name, kind in kinds.items():
        units = [unit_of(kind, law.unit) for law in laws]
        attributes = {"units": _one(units), "long_name": texts[name]}
        variables[f"actuator_{name}"] = (("time", "actuator"), values[name], attributes)
    memories = [name for law in laws for name in law.memory]
    units = [unit_of(k, law.unit) for law in laws for k in law.law.memory_units]
    coords["memory"] = ("memory", np.array(memories, dtype=str))
    attributes = {"units": _one(units), "long_name": "states of the actuators"}
    variables["actuator_memory"] = (("time", "memory"), trace.memory, attributes)


def _one(units: list[str]) -> str:
    """One text for the units of several numbers."""
    return ", ".join(dict.fromkeys(units))
