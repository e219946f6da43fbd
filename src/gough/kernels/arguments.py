"""What a kernel is given: checked, so that an error names the argument and its shape."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


def checked(name: str, inputs: Mapping[str, int], arrays: Sequence[ArrayLike]) -> list[Array]:
    """The arrays as float64 with the right size along the last axis."""
    if len(arrays) != len(inputs):
        raise ValueError(f"{name} takes {', '.join(inputs)}; got {len(arrays)} arrays")
    return [
        _reals(name, label, size, array)
        for (label, size), array in zip(inputs.items(), arrays, strict=True)
    ]


def _reals(name: str, label: str, size: int, array: ArrayLike) -> Array:
    expected = f"expected (*batch, {size})"
    try:
        values = np.asarray(array)
    except ValueError:
        raise ValueError(f"{name}: {label} is ragged, {expected}") from None
    if not np.can_cast(values.dtype, np.float64, "same_kind"):
        raise TypeError(f"{name}: {label} holds {values.dtype}, expected real numbers")
    if values.ndim == 0 or values.shape[-1] != size:
        raise ValueError(f"{name}: {label} has shape {values.shape}, {expected}")
    return values.astype(np.float64, copy=False)


def batch(name: str, arrays: Mapping[str, Array]) -> tuple[int, ...]:
    """The leading axes of the arrays, broadcast."""
    try:
        return np.broadcast_shapes(*(array.shape[:-1] for array in arrays.values()))
    except ValueError:
        shapes = ", ".join(f"{label} {array.shape}" for label, array in arrays.items())
        raise ValueError(
            f"{name}: the leading axes of {shapes} do not broadcast with each other"
        ) from None


def room(name: str, out: Array | None, shape: tuple[int, ...]) -> Array:
    """``out`` if it fits, or a new array."""
    if out is None:
        return np.empty(shape)
    if not isinstance(out, np.ndarray) or out.dtype != np.float64:
        kind = out.dtype if isinstance(out, np.ndarray) else type(out).__name__
        raise TypeError(f"{name}: out holds {kind}, expected an array of float64")
    if out.shape != shape:
        raise ValueError(f"{name}: out has shape {out.shape}, expected {shape}")
    if not out.flags.writeable:
        raise ValueError(f"{name}: out is read-only")
    return out
