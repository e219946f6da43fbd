"""How inverse and direct dynamics end, row by row."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Codes = NDArray[np.int8]
Mask = NDArray[np.bool_]


class Ending(Enum):
    """How one row ended; the text is what the user reads."""

    solved = "solved"
    singular = "the mechanism is singular there, or too near to it for the numbers to mean anything"
    out_of_reach = "a leg does not reach the pose"
    not_finite = "an input is not finite"
    no_motion = "no motion has these rates"


ENDINGS = tuple(Ending)


@dataclass(frozen=True)
class _Solution:
    ending: Codes
    """The place in `ENDINGS` of each row's, (*batch,)."""
    regularity: Array
    """The smallest determinant that was divided by over its typical size near home, (*batch,): 0 at
    a singularity that the model meets, about 1 far from all; -1 or NaN where there is none."""
    reasons: tuple[str, ...]
    """What is wrong with each row of the flattened batch, "" where nothing is."""

    @property
    def solved(self) -> Mask:
        """Which rows have an answer, (*batch,)."""
        return np.asarray(self.ending == 0)


@dataclass(frozen=True)
class InverseDynamics(_Solution):
    """Efforts of motors for given motions."""

    efforts: Array
    """(*batch, motors), N and N m; NaN where there is no answer."""
    residual: Array
    """Forces that the motors can not give, along the independent rates, (*batch, independent)."""
    null_space: Array
    """Efforts that only tighten the mechanism, orthonormal, (*batch, motors, redundancy)."""
    motors: tuple[str, ...]
    independent: tuple[str, ...]

    def as_dict(self) -> dict[str, Any]:
        """The content as plain data."""
        return {
            "motors": list(self.motors),
            "efforts": _plain(self.efforts),
            "residual": _plain(self.residual),
            "ending": [ENDINGS[code].name for code in self.ending.ravel()],
            "regularity": _plain(self.regularity),
        }


@dataclass(frozen=True)
class DirectDynamics(_Solution):
    """Accelerations for given efforts."""

    accelerations: Array
    """(*batch, n), m/s² and rad/s²; NaN where there is no answer."""
    names: tuple[str, ...]

    def as_dict(self) -> dict[str, Any]:
        """The content as plain data."""
        return {
            "names": list(self.names),
            "accelerations": _plain(self.accelerations),
            "ending": [ENDINGS[code].name for code in self.ending.ravel()],
            "regularity": _plain(self.regularity),
        }


def _plain(values: Array) -> Any:
    """Nested lists with None for what is no number."""
    if values.ndim:
        return [_plain(value) for value in values]
    return float(values) if np.isfinite(values) else None
