"""Statistics of ensembles of simulations: distributions, designs, indices, reliability.

Knows nothing of robots: rows of numbers go out, rows of numbers come back. scipy is loaded where it
is first needed, not on import.
"""

from gough.uncertainty.correlation import Correlations, correlations
from gough.uncertainty.designs import Design, SaltelliDesign
from gough.uncertainty.distributions import Distribution, values_of
from gough.uncertainty.errors import DesignError, DistributionError, EnsembleError
from gough.uncertainty.indices import SobolIndices, sobol_indices
from gough.uncertainty.one_at_a_time import OneAtATime, Tornado
from gough.uncertainty.reliability import (
    Criterion,
    FailureProbability,
    Quantiles,
    Reliability,
    failure_probability,
    quantiles,
    reliability,
)

__all__ = [
    "Correlations",
    "Criterion",
    "Design",
    "DesignError",
    "Distribution",
    "DistributionError",
    "EnsembleError",
    "FailureProbability",
    "OneAtATime",
    "Quantiles",
    "Reliability",
    "SaltelliDesign",
    "SobolIndices",
    "Tornado",
    "correlations",
    "failure_probability",
    "quantiles",
    "reliability",
    "sobol_indices",
    "values_of",
]
