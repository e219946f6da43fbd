"""What can be wrong with distributions, designs and ensembles."""

from __future__ import annotations

from gough.errors import GoughError


class DistributionError(GoughError, ValueError):
    """A distribution that can not be, or a text that does not say one."""


class DesignError(GoughError, ValueError):
    """A design that can not be made, or rows that it does not have."""


class EnsembleError(GoughError, ValueError):
    """Outputs of an ensemble that do not allow the answer."""
