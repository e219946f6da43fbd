"""A vector expression as a numpy function over batches."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import casadi
import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


class Kernel:
    """A numpy function of named vectors: ``(*batch, n), … -> (*batch, *shape)``.

    Args:
        name: a name for messages.
        inputs: a column of symbols for each input, in calling order.
        output: the expression, a matrix in these symbols.
        shape: shape of one result; the size of the output by default. Rows vary slowest.
    """

    def __init__(
        self,
        name: str,
        inputs: Mapping[str, casadi.SX],
        output: casadi.SX,
        shape: tuple[int, ...] | None = None,
    ) -> None:
        self.name = name
        self.inputs = {label: symbols.numel() for label, symbols in inputs.items()}
        self.shape = tuple(output.shape) if shape is None else shape
        # CasADi stores by columns; the transposed output read by columns is rows first.
        flat = casadi.densify(casadi.vec(output.T))
        self._function = casadi.Function(name, list(inputs.values()), [flat])

    def __call__(self, *arrays: ArrayLike) -> Array:
        """The expression's value, with the leading axes of the inputs broadcast.

        Raises:
            ValueError: the number or the shape of the inputs is wrong; the message names which.
        """
        if len(arrays) != len(self.inputs):
            known = ", ".join(self.inputs)
            raise ValueError(f"{self.name} takes {known}; got {len(arrays)} arrays")
        checked = [
            self._checked(label, size, array)
            for (label, size), array in zip(self.inputs.items(), arrays, strict=True)
        ]
        batch = np.broadcast_shapes(*(array.shape[:-1] for array in checked))
        rows = int(np.prod(batch, dtype=int))
        if rows == 0:
            return np.zeros((*batch, *self.shape))
        columns = [self._columns(array, batch) for array in checked]
        result: Any = self._function(*columns)
        return np.array(result, dtype=float).T.reshape(*batch, *self.shape)

    def _checked(self, label: str, size: int, array: ArrayLike) -> Array:
        values = np.asarray(array, dtype=float)
        if values.ndim == 0 or values.shape[-1] != size:
            raise ValueError(
                f"{self.name}: {label} has shape {values.shape}, expected (*batch, {size})"
            )
        return values

    @staticmethod
    def _columns(array: Array, batch: tuple[int, ...]) -> casadi.DM:
        spread = np.broadcast_to(array, (*batch, array.shape[-1]))
        return casadi.DM(spread.reshape(int(np.prod(batch, dtype=int)), array.shape[-1]).T)
