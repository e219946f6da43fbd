"""What a user holds to identify a mechanism: parameters, base, trajectories, estimates."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gough.description import Mechanism
from gough.dynamics.dynamics import Dynamics
from gough.dynamics.identification.base import BaseParameters, base_parameters
from gough.dynamics.identification.estimation import Estimate, estimate
from gough.dynamics.identification.limits import Range
from gough.dynamics.identification.mechanism import (
    full_parameters,
    possible_parameters,
    with_parameters,
)
from gough.dynamics.identification.parameters import Parameters
from gough.dynamics.identification.regressor import Regressor, States
from gough.dynamics.identification.trajectories import (
    ExcitingTrajectory,
    condition_of,
    exciting_trajectory,
)
from gough.dynamics.model import Space
from gough.errors import ConfigurationError

Array = NDArray[np.float64]


class Identification:
    """Identification of the dynamic parameters of one mechanism.

    Args:
        dynamics: the mechanism.
        space: in which motions are given: *platform* (operational coordinates, the default where
            there are any) or *joint* (configurations, rates of `dynamics.independent("joint")`).
        friction: whether motors have viscous and Coulomb friction.
        seed: of the random states that base parameters are told from.

    Raises:
        ConfigurationError: the mechanism has no motors, or no outputs for platform space.
    """

    def __init__(
        self,
        dynamics: Dynamics,
        space: Space | None = None,
        friction: bool = True,
        seed: int = 0,
    ) -> None:
        self.dynamics, self.seed = dynamics, seed
        self.parameters = Parameters(dynamics.structure, dynamics.assembler, friction)
        self.regressor = Regressor(dynamics, self.parameters, space)

    @cached_property
    def base(self) -> BaseParameters:
        """The fewest parameters that the model depends on, and the regrouping of all others."""
        return base_parameters(self.regressor, self.seed)

    def states(self, at: ArrayLike, rates: ArrayLike, accelerations: ArrayLike) -> States:
        """Rows of a measured motion; see `Regressor.states`."""
        return self.regressor.states(at, rates, accelerations)

    def matrix(self, states: States) -> Array:
        """Y with efforts = Y · parameters, (rows, channels, parameters); see `Regressor`."""
        return self.regressor.matrix(states)

    def condition(self, states: States) -> float:
        """Condition number of the base regressor over a motion, columns of norm 1."""
        return condition_of(self.regressor, self.base, states)

    def efforts(self, states: States, values: ArrayLike | Estimate | None = None) -> Array:
        """Efforts of the motors with friction, (rows, motors); of redundant motors the smallest.

        Args:
            states: the motion.
            values: of all parameters, (parameters,), or an estimate; as described by default.
        """
        if isinstance(values, Estimate):
            values = self.full(values)
        found = self.parameters.values if values is None else np.asarray(values, dtype=float)
        return self.regressor.efforts(states, found)

    def exciting_trajectory(
        self,
        frequency: float = 0.1,
        harmonics: int = 5,
        centre: ArrayLike | None = None,
        ranges: Mapping[str, Range] | None = None,
        speeds: Mapping[str, float] | None = None,
        efforts: Mapping[str, float] | None = None,
        samples: int = 200,
        evaluations: int = 600,
        seed: int = 0,
    ) -> ExcitingTrajectory:
        """A periodic motion that tells the base parameters; see `trajectories`."""
        return exciting_trajectory(
            self.regressor,
            self.base,
            frequency,
            harmonics,
            centre,
            ranges,
            speeds,
            efforts,
            samples,
            evaluations,
            seed,
        )

    def estimate(
        self,
        states: States,
        efforts: ArrayLike,
        noise: ArrayLike | None = None,
        weights: ArrayLike | None = None,
    ) -> Estimate:
        """Base parameters from measured efforts, by weighted least squares; see `estimation`.

        Raises:
            ConfigurationError: ``states`` are none, or a shape is wrong.
        """
        if not isinstance(states, States):
            raise ConfigurationError(
                f"states are {states!r}; make them with identification.states(…)"
            )
        return estimate(self.regressor, self.base, states, efforts, noise, weights)

    def full(self, values: ArrayLike | Estimate) -> Array:
        """All parameters with given base parameters, nearest to the description, (parameters,)."""
        return full_parameters(self.parameters, self.base, _values(values))

    def mechanism(self, values: ArrayLike | Estimate) -> Mechanism:
        """A description whose models move as base parameters say, its legs written out.

        Friction is no part of it.

        Raises:
            ImpossibleParameters: no distribution of mass has these base parameters.
        """
        found = possible_parameters(self.parameters, self.base, _values(values))
        return with_parameters(self.parameters, found)


def _values(values: ArrayLike | Estimate) -> Array:
    return values.values if isinstance(values, Estimate) else np.asarray(values, dtype=float)
