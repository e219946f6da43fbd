"""What is exported of a robot: its kernels, with a name and a unit for every number."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import prod

import numpy as np

from gough.dynamics.dynamics import Dynamics
from gough.dynamics.model import Model, Space
from gough.dynamics.writing import Place
from gough.errors import ConfigurationError
from gough.geometry.coordinates import position_names
from gough.kernels import Kernel
from gough.models import CLOSURE_MODELS
from gough.topology import Variable

Number = tuple[str, str]
"""Name and unit."""

DYNAMICS = {
    "inverse_dynamics": "inverse",
    "direct_dynamics": "direct",
    "forces": "forces",
    "mass_matrix": "mass_matrix",
    "bias": "bias",
    "gravity_load": "gravity_load",
    "energy": "energy",
    "rates": "rates",
    "accelerations": "accelerations",
    "motor_jacobian": "motor_jacobian",
}
"""Names of exported models, and those in `gough.dynamics.writing.MODELS`."""
ABOUT = CLOSURE_MODELS | {
    "inverse_dynamics": "efforts of the motors for rates y and accelerations yd, then the "
    "regularity",
    "direct_dynamics": "accelerations yd for rates y and efforts tau of the motors, then the "
    "regularity",
    "forces": "forces along y that a motion with rates y and accelerations yd takes",
    "mass_matrix": "A with forces = A yd + bias, symmetric positive definite",
    "bias": "forces along y at yd = 0: Coriolis and centrifugal forces and gravity",
    "gravity_load": "forces along y that hold the robot at rest",
    "energy": "kinetic energy, and potential energy from the origin of the base",
    "rates": "rates of all variables for y",
    "accelerations": "accelerations of all variables for y and yd",
    "motor_jacobian": "J with rates of the motors = J y; efforts tau give the forces Jᵀ tau",
}
REGULARITY = ("regularity", "1")
WITH_REGULARITY = ("inverse_dynamics", "direct_dynamics")


@dataclass(frozen=True)
class Exported:
    """One model as it is exported."""

    name: str
    kernel: Kernel
    inputs: Mapping[str, Sequence[Number]]
    """The numbers of each input that has any, in calling order."""
    axes: Sequence[Sequence[Number]]
    """What stands along each axis of a result."""

    @property
    def about(self) -> str:
        """What it computes, in a sentence."""
        return ABOUT[self.name]

    @property
    def width(self) -> int:
        """How many numbers a result has."""
        return prod(self.kernel.shape)


def exported_models(dynamics: Dynamics) -> list[Exported]:
    """Every model of a robot that has results: closure, then dynamics.

    Dynamics are those of platform space where there are outputs, else of joint space. They take
    operational coordinates ``x`` where these place the mechanism in closed form, else a closed
    configuration ``q``.

    Raises:
        ClosureError: the loops do not close.
    """
    return _closure(dynamics) + _dynamics(dynamics)


def c_name(robot: str) -> str:
    """The name of a robot as names in C begin."""
    name = re.sub(r"\W", "_", robot, flags=re.ASCII)
    return name if name[:1].isalpha() else f"robot_{name}"


def space_of(dynamics: Dynamics) -> Space:
    """Whose rates exported dynamics take."""
    return "platform" if dynamics.structure.columns("operational") else "joint"


def place_of(dynamics: Dynamics) -> Place:
    """What places the mechanism for exported dynamics."""
    space = space_of(dynamics)
    return "x" if space == "platform" and "x" in dynamics.model(space).places else "q"


def parameters(dynamics: Dynamics) -> list[tuple[str, float]]:
    """Live parameters with their present values, in the order of the input ``p``."""
    names: list[str] = []
    for name, value in dynamics.models.closure.live.items():
        places = np.ndindex(np.asarray(value, dtype=float).shape)
        names += ["".join([name, *(f"[{k}]" for k in place)]) for place in places]
    return list(zip(names, dynamics.assembler.p.tolist(), strict=True))


def _closure(dynamics: Dynamics) -> list[Exported]:
    models, structure = dynamics.models, dynamics.structure
    rows = [(f"equation {k}", row.unit) for k, row in enumerate(models.closure.rows)]
    axes: dict[str, list[Sequence[Number]]] = {
        "residual": [rows],
        "jacobian": [rows, _rates(structure.variables)],
        "poses": [[(body, "") for body in structure.bodies], *[[("", "")] * 4] * 2],
    }
    given = {"q": configuration(dynamics), "p": _parameters(dynamics)}
    return [
        Exported(name, kernel, _taken(kernel, given), axes[name])
        for name, kernel in models.kernels().items()
    ]


def _dynamics(dynamics: Dynamics) -> list[Exported]:
    model, place = dynamics.model(space_of(dynamics)), place_of(dynamics)
    own = model if place == "q" else model.posed
    assert own is not None
    given, axes = _given(dynamics, own), _axes(own)
    found = []
    for name, inner in DYNAMICS.items():
        if name == "inverse_dynamics" and not model.actuated:
            continue
        try:
            kernel = model.kernel(inner, place)
        except (ConfigurationError, ZeroDivisionError):  # too few motors for it, or no mass
            continue
        if prod(kernel.shape) > (name in WITH_REGULARITY):
            found.append(Exported(name, kernel, _taken(kernel, given), axes[name]))
    return found


def _given(dynamics: Dynamics, model: Model) -> dict[str, Sequence[Number]]:
    variables = model.structure.variables
    y = [variables[k] for k in model.independent]
    x = model.outputs
    return {
        "x": list(zip(x.names, x.units, strict=True)),
        "q": configuration(dynamics),
        "p": _parameters(dynamics),
        "y": _rates(y),
        "yd": _rates(y, "s²"),
        "tau": _efforts([variables[k] for k in model.actuated]),
    }


def _axes(model: Model) -> dict[str, list[Sequence[Number]]]:
    variables = model.structure.variables
    y = [variables[k] for k in model.independent]
    motors = [variables[k] for k in model.actuated]
    plain = [(v.name, v.unit) for v in y]
    return {
        "inverse_dynamics": [[*_efforts(motors), REGULARITY]],
        "direct_dynamics": [[*_rates(y, "s²"), REGULARITY]],
        "forces": [_efforts(y)],
        "mass_matrix": [plain, plain],
        "bias": [_efforts(y)],
        "gravity_load": [_efforts(y)],
        "energy": [[("kinetic", "J"), ("potential", "J")]],
        "rates": [_rates(variables)],
        "accelerations": [_rates(variables, "s²")],
        "motor_jacobian": [_rates(motors), _rates(y)],
    }


def _taken(kernel: Kernel, given: Mapping[str, Sequence[Number]]) -> dict[str, Sequence[Number]]:
    return {label: given[label] for label, size in kernel.inputs.items() if size}


def configuration(dynamics: Dynamics) -> list[Number]:
    """Names and units of the numbers of a configuration."""
    models = dynamics.models
    quaternion = {"qw", "qx", "qy", "qz"}
    return [
        (name, "m" if length else "1" if name.rpartition(".")[2] in quaternion else "rad")
        for name, length in zip(position_names(models), models.position_is_length, strict=True)
    ]


def _parameters(dynamics: Dynamics) -> list[Number]:
    return [(name, "") for name, _ in parameters(dynamics)]


def _rates(variables: Sequence[Variable], per: str = "s") -> list[Number]:
    return [(v.name, f"{v.unit}/{per}") for v in variables]


def _efforts(variables: Sequence[Variable]) -> list[Number]:
    return [(v.name, "N" if v.unit == "m" else "N m") for v in variables]
