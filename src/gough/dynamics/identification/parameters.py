"""The parameters that a dynamic model is linear in: ten of each body, three of each motor."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from gough.assembly import Assembler
from gough.description.values import scalar, vector
from gough.dynamics.rotors import rotors_of
from gough.errors import UnknownName
from gough.topology import Structure

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

INERTIAL = ("m", "mx", "my", "mz", "xx", "yy", "zz", "xy", "xz", "yz")
"""Mass, first moment and inertia about the origin of the body, in the body's own axes."""
MOMENTS = INERTIAL[1:4]
MOTOR = ("Ia", "fv", "fc")
"""Inertia of the rotor as the joint feels it, viscous and Coulomb friction."""
ENTRIES = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
"""Places of xx, yy, zz, xy, xz, yz in a tensor; off-diagonal numbers are entries of the matrix."""


@dataclass(frozen=True)
class Motor:
    """One motor, by the name of its effort."""

    name: str
    variable: int
    linear: bool
    """Whether its joint slides."""


class Parameters:
    """Names, described values and sizes of all parameters of a mechanism.

    Names are those of bodies and motors with the symbol behind: ``leg1.cylinder.mz``,
    ``leg1.slide.fv``. First moments are in kg m, inertia about the origin of the body's frame in
    kg m², all in axes of the body as it is described; ``Ia`` is ratio² · inertia of the rotor, in
    kg m² or kg; ``fv`` in N m s or N s/m, ``fc`` in N m or N. No friction is described, so it is 0.

    Args:
        structure: the mechanism.
        assembler: its live parameters and its characteristic length.
        friction: whether friction of the motors is among them.
    """

    def __init__(self, structure: Structure, assembler: Assembler, friction: bool = True) -> None:
        self.structure, self.assembler, self.friction = structure, assembler, friction
        flat = structure.flat
        self.bodies = tuple(b for b in flat.bodies if b != structure.root and self._moves(b))
        self.motors = tuple(self._motors())

    def _moves(self, body: str) -> bool:
        """Whether a body is not at rest by description."""
        return body != self.structure.mechanism.base or self.structure.mechanism.floating

    def _motors(self) -> Iterator[Motor]:
        for k in self.structure.columns("actuated"):
            variable = self.structure.variables[k]
            yield Motor(variable.name, k, variable.unit == "m")

    def __len__(self) -> int:
        return len(self.names)

    @property
    def inertial(self) -> int:
        """How many there are of bodies; those of motors follow."""
        return len(INERTIAL) * len(self.bodies)

    @property
    def symbols(self) -> tuple[str, ...]:
        """What is told of each motor."""
        return MOTOR if self.friction else MOTOR[:1]

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Of all, in order."""
        bodies = [f"{body}.{symbol}" for body in self.bodies for symbol in INERTIAL]
        motors = [f"{motor.name}.{symbol}" for symbol in self.symbols for motor in self.motors]
        return (*bodies, *motors)

    @cached_property
    def kinds(self) -> tuple[str, ...]:
        """The symbol of each."""
        return tuple(name.rpartition(".")[2] for name in self.names)

    @cached_property
    def owners(self) -> tuple[str, ...]:
        """The body or motor of each."""
        return tuple(name.rpartition(".")[0] for name in self.names)

    @cached_property
    def units(self) -> tuple[str, ...]:
        """The unit of each."""
        linear = {motor.name: motor.linear for motor in self.motors}
        turning = {"Ia": "kg m²", "fv": "N m s", "fc": "N m"}
        sliding = {"Ia": "kg", "fv": "N s/m", "fc": "N"}
        own = {"m": "kg", "mx": "kg m", "my": "kg m", "mz": "kg m"}
        found = []
        for owner, kind in zip(self.owners, self.kinds, strict=True):
            if kind in MOTOR:
                found.append((sliding if linear[owner] else turning)[kind])
            else:
                found.append(own.get(kind, "kg m²"))
        return tuple(found)

    @cached_property
    def values(self) -> Array:
        """As described, (parameters,)."""
        found = [x for body in self.bodies for x in self._of_body(body)]
        found += [self._rotor(motor.name) for motor in self.motors]
        return np.array(found + [0.0] * (len(self) - len(found)))

    def _of_body(self, name: str) -> Array:
        body, values = self.structure.flat.bodies[name], self.assembler.values
        com = np.array([float(x) for x in (*vector(body.com, values, 2, 3), 0.0)[:3]])
        entries = (*vector(body.inertia, values, 3, 6), 0.0, 0.0, 0.0)[:6]
        central = np.zeros((3, 3))
        for (i, k), x in zip(ENTRIES, entries, strict=True):
            central[i, k] = central[k, i] = float(x)
        return ten_numbers(float(scalar(body.mass, values)), com, central)

    def _rotor(self, name: str) -> float:
        joint = self.structure.flat.joints.get(name)
        felt = {} if joint is None else rotors_of(joint, self.assembler.values)
        return float(felt.get(0, 0.0))

    @cached_property
    def scale(self) -> Array:
        """A typical size of each, (parameters,): of a body's mass at the characteristic length.

        Time is measured in √(length / g), so that weight and inertia compare.
        """
        length = self.assembler.length
        masses = self.values[: self.inertial : len(INERTIAL)]
        mass = float(np.abs(masses).max(initial=0.0)) or 1.0
        time = np.sqrt(length / 9.81)
        powers = {"m": 0, "mx": 1, "my": 1, "mz": 1}
        linear = {motor.name: motor.linear for motor in self.motors}
        found = []
        for owner, kind in zip(self.owners, self.kinds, strict=True):
            if kind in MOTOR:
                size = mass if linear[owner] else mass * length**2
                speed = (length if linear[owner] else 1.0) / time
                found.append(size * {"Ia": 1.0, "fv": 1 / time, "fc": speed / time}[kind])
            else:
                found.append(mass * length ** powers.get(kind, 2))
        return np.array(found)

    def index(self, name: str) -> int:
        """The place of a parameter.

        Raises:
            UnknownName: there is none of this name.
        """
        if name not in self.names:
            raise UnknownName("parameter", name, self.names)
        return self.names.index(name)

    def as_dict(self) -> dict[str, float]:
        """Described values by name."""
        return dict(zip(self.names, self.values.tolist(), strict=True))


def ten_numbers(mass: float, com: Array, central: Array) -> Array:
    """Mass, first moment, and inertia about the origin from that at the centre of mass, (10,)."""
    tensor = central + mass * (com @ com * np.eye(3) - np.outer(com, com))
    return np.array([mass, *(mass * com), *(tensor[i, k] for i, k in ENTRIES)])


def tensor_of(ten: Array) -> Array:
    """The inertia about the origin as a matrix, (*batch, 3, 3)."""
    tensor = np.zeros((*ten.shape[:-1], 3, 3))
    for n, (i, k) in enumerate(ENTRIES):
        tensor[..., i, k] = tensor[..., k, i] = ten[..., 4 + n]
    return tensor
