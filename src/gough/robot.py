"""What a user holds: one mechanism with its models, made on demand."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gough import catalogue
from gough.analysis.analysis import Analysis, analyse
from gough.analysis.elimination import VelocityMap, direct_map, inverse_map, passive_map
from gough.analysis.ranks import Linearisation, linearise
from gough.assembly import Assembler, Assembly
from gough.description import Mechanism
from gough.errors import ConfigurationError, DescriptionError, Problem
from gough.formats.native import Source
from gough.models import CLOSURE_MODELS, Models
from gough.topology import Modelling, Role, Structure

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Home:
    """The closed start configuration."""

    q: Array
    """Positions of the joints of the tree."""
    q_actuated: Array
    """Positions of the actuated joints, rad and m."""
    x: Array
    """A pose (x, y, z, then the quaternion w, x, y, z) where all six freedoms of the platform are
    operational, else the operational coordinates, rad and m; rx, ry and rz of a platform that turns
    freely are then entries of its rotation vector, while their rates are its angular velocity."""
    assembly: Assembly


@dataclass(frozen=True)
class Origin:
    """What a robot was loaded from."""

    robot: str
    """Path, or name in the catalogue."""
    parameters: dict[str, Any]
    """Values that replaced those of the description."""
    modelling: Modelling | None


class Robot:
    """One mechanism and its models.

    Args:
        mechanism: the description.
        modelling: one of the two ways to model the platform; the description's own by default.
        live: values of live parameters by name; those of the description by default.

    Attributes:
        origin: what it was loaded from, None if the mechanism was described in Python.

    Raises:
        DescriptionError: a loop has no passive joint to cut.
    """

    def __init__(
        self,
        mechanism: Mechanism,
        modelling: Modelling | None = None,
        live: Mapping[str, Any] | None = None,
    ) -> None:
        self.mechanism = mechanism
        self.structure = Structure(mechanism, modelling)
        self._live = dict(live or {})
        self.origin: Origin | None = None

    @property
    def name(self) -> str:
        """The mechanism's name."""
        return self.mechanism.name

    @cached_property
    def models(self) -> Models:
        """Expressions and kernels."""
        return Models(self.structure)

    @cached_property
    def assembler(self) -> Assembler:
        """What closes the loops."""
        return Assembler(self.models, self.models.parameters(self._live))

    @cached_property
    def home(self) -> Home:
        """The closed start configuration.

        Raises:
            ClosureError: the loops do not close.
        """
        assembly = self.assembler.home().require()
        q = assembly.q
        return Home(q, self._positions(q, "actuated"), self._positions(q, "operational"), assembly)

    def analyse(self, seed: int = 0) -> Analysis:
        """Mobility, redundancy and singularity at the home configuration.

        Args:
            seed: of the random configurations that generic values are taken from.

        Raises:
            ClosureError: the loops do not close.
            ConfigurationError: the seed is negative.
        """
        if seed < 0:
            raise ConfigurationError(f"the seed is {seed}; it must be 0 or more")
        return analyse(self.assembler, self.home.assembly, seed)

    # programs

    def operations(self) -> dict[str, dict[str, int]]:
        """How many operations each model takes, by kind: mul, add, div, sqrt, trig, select …"""
        return {name: kernel.tape.counts() for name, kernel in self.models.kernels().items()}

    def export_c(self, folder: str | Path) -> list[Path]:
        """Write every model as C99 into a folder; the files written.

        Each is a function of positions ``q`` and, if there are any, live parameters ``p``, and the
        same over many rows. Compiled without contraction it gives the bits of this library.

        Raises:
            ConfigurationError: the folder can not be written.
        """
        return self._export("c", folder)

    def export_cuda(self, folder: str | Path) -> list[Path]:
        """Write every model as CUDA C into a folder, as `export_c`."""
        return self._export("cuda", folder)

    def _export(self, language: str, folder: str | Path) -> list[Path]:
        prefix = re.sub(r"\W", "_", self.name, flags=re.ASCII)
        prefix = prefix if prefix[:1].isalpha() else f"robot_{prefix}"
        texts: dict[str, str] = {}
        for name, kernel in self.models.kernels().items():
            about = f"{self.name}: {CLOSURE_MODELS[name]}"
            texts |= kernel.files(language, f"{prefix}_{name}", about)
        return [_written(Path(folder) / name, text) for name, text in texts.items()]

    # rates at the home configuration

    @cached_property
    def rates(self) -> Linearisation:
        """M, N and K at home, lengths divided by the characteristic length."""
        return linearise(self.assembler, self.home.q)

    def inverse_velocity(self) -> VelocityMap:
        """Motor rates from output rates at home: q̇_a = J⁻¹ ẋ, (actuated, operational).

        With all six freedoms of the platform ẋ is its twist (linear, angular) in base axes.
        ``valid`` says whether every output rate is possible, ``unique`` whether it fixes the
        motors' rates. SI units and rad; rates of rx, ry, rz are angular velocities.
        """
        return self._in_si(inverse_map(self.rates), "actuated", "operational")

    def direct_velocity(self) -> VelocityMap:
        """Output rates from motor rates at home: ẋ = J q̇_a, (operational, actuated)."""
        return self._in_si(direct_map(self.rates), "operational", "actuated")

    def passive_velocity(self) -> VelocityMap:
        """Passive rates from output rates at home, (passive, operational)."""
        return self._in_si(passive_map(self.rates), "passive", "operational")

    def _in_si(self, found: VelocityMap, output: Role, input_: Role) -> VelocityMap:
        scale, columns = self.assembler.rate_scale, self.structure.columns
        return found.in_units(scale[columns(output)], scale[columns(input_)])

    def _positions(self, q: Array, role: Role) -> Array:
        """Position numbers of the freedoms with a role, in the order of the variables."""
        picked: list[float] = []
        for k in range(len(self.structure.edges)):
            roles = [v.role for v in self.structure.variables if v.edge == k]
            position = q[self.models.closure.slices[k]]
            if roles and all(r == role for r in roles):
                picked.extend(position)
            elif role in roles:
                if len(position) != len(roles):
                    position = _rotation_vector_last(position)
                picked.extend(x for x, r in zip(position, roles, strict=True) if r == role)
        return np.array(picked)


def _written(path: Path, text: str) -> Path:
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, "utf-8")
    except OSError as error:
        raise ConfigurationError(f"{path} can not be written: {error.strerror}") from None
    return path


def _rotation_vector_last(position: Array) -> Array:
    """Translations, then the rotation vector of the trailing quaternion (w, x, y, z)."""
    w, v = position[-4], position[-3:]
    size = float(np.linalg.norm(v))
    angle = 2 * np.arctan2(size, abs(w)) * (1 if w >= 0 else -1)
    vector = v * (angle / size) if size > 0 else 2 * v
    return np.concatenate([position[:-4], vector])


def load(
    robot: str | Path,
    modelling: Modelling | None = None,
    **parameters: Any,
) -> Robot:
    """The robot of a description file, or of a name in the catalogue.

    Args:
        robot: a path, or the name of a robot of the catalogue.
        modelling: see ``Mechanism.modelling``.
        parameters: values that replace those of the description's parameters.

    Raises:
        DescriptionError: the file is missing or something in it is wrong.
        UnknownName: there is no such robot, or no such parameter.
    """
    source = open_source(robot)
    mechanism = source.mechanism(parameters)
    loaded = source.locating(lambda: Robot(mechanism, modelling))
    loaded.origin = Origin(str(robot), parameters, modelling)
    return loaded


def open_source(robot: str | Path) -> Source:
    """The description file of a path or of a name in the catalogue.

    Raises:
        DescriptionError: the file is missing or no YAML.
        UnknownName: there is no such robot.
    """
    path = Path(robot)
    looks_like_path = path.suffix in (".yaml", ".yml") or len(path.parts) > 1 or path.exists()
    if isinstance(robot, Path) or looks_like_path:
        return Source.open(path)
    near = path.with_suffix(".yaml")
    if str(robot) not in catalogue.names() and near.exists():
        problem = Problem(f"is no name of the catalogue; the file beside you is called {near}")
        raise DescriptionError([problem], str(robot))
    return Source(catalogue.file(str(robot)).read_bytes(), f"{robot}.yaml")
