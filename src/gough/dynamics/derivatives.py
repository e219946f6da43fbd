"""Partial derivatives of inverse and direct dynamics by state, input and live parameters."""

from __future__ import annotations

from dataclasses import dataclass

import casadi
import numpy as np
from numpy.typing import ArrayLike, NDArray

from gough.dynamics.dynamics import Dynamics
from gough.dynamics.model import Model, Space
from gough.dynamics.writing import Place
from gough.errors import ConfigurationError
from gough.kernels import Kernel

Array = NDArray[np.float64]
SX = casadi.SX


@dataclass(frozen=True)
class Derivatives:
    """Derivatives of efforts (inverse dynamics) or accelerations (direct dynamics).

    Each is (*batch, n, m): n efforts or accelerations by m directions. A direction of the position
    is a small motion with the rates y, times a second: of a pose the twist's, (linear, angular) in
    base axes; joints follow so that the loops stay closed.
    """

    by_position: Array
    by_rates: Array
    by_input: Array
    """By accelerations of inverse dynamics, by efforts of direct dynamics."""
    by_parameters: Array
    """By the live parameters, in the order of ``parameters``."""
    parameters: tuple[str, ...]


class Differentiated:
    """Kernels for the derivatives of one mechanism's dynamics, made at first use.

    Args:
        dynamics: the mechanism.
    """

    def __init__(self, dynamics: Dynamics) -> None:
        self.dynamics = dynamics
        self._kernels: dict[tuple[str, Space, Place], Kernel] = {}

    def inverse(
        self, at: ArrayLike, rates: ArrayLike, accelerations: ArrayLike, space: Space = "platform"
    ) -> Derivatives:
        """Of the motors' efforts.

        Args:
            at: operational coordinates in platform space, a configuration in joint space.
            rates: (*batch, y), those of `Dynamics.independent`.
            accelerations: (*batch, y).
            space: whose rates y are.

        Raises:
            ConfigurationError: the motors do not determine, or are more than, the forces; or an
                argument has the wrong shape.
            SingularError: a row is out of reach or singular.
        """
        return self._at("inverse", at, rates, accelerations, space)

    def direct(
        self, at: ArrayLike, rates: ArrayLike, efforts: ArrayLike, space: Space = "platform"
    ) -> Derivatives:
        """Of the accelerations, for efforts (*batch, motors); see `inverse`."""
        return self._at("direct", at, rates, efforts, space)

    def _at(
        self, name: str, at: ArrayLike, rates: ArrayLike, given: ArrayLike, space: Space
    ) -> Derivatives:
        model = self.dynamics.model(space)
        place: Place = "x" if "x" in model.places and space == "platform" else "q"
        if name == "inverse" and model.motors_rank < len(model.actuated):
            raise ConfigurationError("the motors are not independent; use direct dynamics")
        arrays = [np.asarray(a, dtype=float) for a in (at, rates, given)]
        if space == "platform" and place == "q":
            arrays[0] = self.dynamics.reached(arrays[0])
        p = self.dynamics.assembler.p
        take = [arrays[0], *([p] if p.size else []), *arrays[1:]]
        found = self._kernel(name, space, place)(*take)
        return self._parted(found, model, arrays[2].shape[-1])

    def _parted(self, found: Array, model: Model, inputs: int) -> Derivatives:
        count = len(model.given)
        ends = np.cumsum([count, count, inputs])
        position, rates, given, parameters = np.split(found, ends, axis=-1)
        names = tuple(self._parameter_names(model))
        return Derivatives(position, rates, given, parameters, names)

    @staticmethod
    def _parameter_names(model: Model) -> list[str]:
        names: list[str] = []
        for name, value in model.closure.live.items():
            size = np.size(np.asarray(value, dtype=float))
            names += [name] if size == 1 else [f"{name}[{k}]" for k in range(size)]
        return names

    def _kernel(self, name: str, space: Space, place: Place) -> Kernel:
        key = name, space, place
        if key not in self._kernels:
            self._kernels[key] = self._written(name, space, place)
        return self._kernels[key]

    def _written(self, name: str, space: Space, place: Place) -> Kernel:
        """The Jacobian of a model by all its inputs; positions move so that loops stay closed."""
        model = self.dynamics.model(space)
        kernel = model.kernel(name, place)
        symbols = {label: SX.sym(label, size) for label, size in kernel.inputs.items()}
        results = kernel.expression(*symbols.values())[:-1]
        columns = [casadi.jacobian(results, symbols[place]) @ self._motions(model, place, symbols)]
        for label in ("y", "yd", "tau", "p"):
            if label in symbols:
                columns.append(casadi.jacobian(results, symbols[label]))
        whole = casadi.densify(casadi.horzcat(*columns))
        return Kernel(f"{name}_derivatives", symbols, whole)

    @staticmethod
    def _motions(model: Model, place: Place, symbols: dict[str, SX]) -> SX:
        """How positions change for unit rates y, (positions, y)."""
        closure = model.closure
        H = casadi.Function("H", [closure.q], [closure.position_rates])
        if place == "q":
            rates = model.kernel("rates", "q")
            y = SX.sym("y", len(model.given))
            given = [symbols[label] for label in rates.inputs if label != "y"]
            v = rates.expression(*given, y)
            return SX(H(symbols["q"]) @ casadi.jacobian(v, y))
        q = SX.zeros(closure.q.numel())
        for k, at in enumerate(model.outputs.whole):
            q[at] = symbols["x"][k]
        return SX(H(q)[model.outputs.whole, model.structure.columns("operational")])
