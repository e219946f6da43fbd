"""A program as a numpy function over batches of rows."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from math import prod
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gough.kernels import arguments, threading
from gough.kernels.native.compilation import COMPILING, Addresses, Compilation
from gough.kernels.tape import Tape

Array = NDArray[np.float64]

BUFFERED = 2000
"""Numbers in a row, of inputs and output together, that `inner_loop.ll` may buffer on the stack."""


class Evaluator:
    """A numpy function of named vectors: ``(*batch, n), … -> (*batch, *shape)``.

    Every path through it gives the same bits: one row or many, any number of threads.

    Args:
        name: a name for messages.
        inputs: names and sizes of the inputs, in calling order.
        shape: shape of one result; rows vary slowest.
        program: gives a tape in primitives whose slots are those of the inputs one after the other.
        origin: a digest of what the program is made from; machine code is kept under it.
        size: about how many operations the program has.
    """

    def __init__(
        self,
        name: str,
        inputs: Mapping[str, int],
        shape: tuple[int, ...],
        program: Callable[[], Tape],
        origin: Callable[[], bytes],
        size: int,
    ) -> None:
        self.name, self.inputs, self.shape, self.size = name, dict(inputs), shape, size
        self._program, self._origin = program, origin
        self._long = sum(self.inputs.values()) + prod(shape) > BUFFERED
        full = all(self.inputs.values()) and bool(self.inputs) and prod(shape) > 0
        self._simple = full and not self._long
        self._single: Any = None
        self._compilation: Compilation | None = None

    @property
    def compilation(self) -> Compilation:
        """The program's machine code; its inputs are those that are not empty."""
        with COMPILING:
            if self._compilation is None:
                sizes = [size for size in self.inputs.values() if size] or [1]
                origin = self._origin()
                self._compilation = Compilation(self.name, self._program, origin, sizes, self.shape)
        return self._compilation

    @property
    def addresses(self) -> Addresses:
        """Machine code for loops that are compiled themselves; see `native.text` for its form.

        Bare numbers: keep this object as long as they are in use.
        """
        return self.compilation.addresses

    @property
    def single(self) -> Any:
        """The numpy ufunc for one row once one row was asked for, else None.

        It checks no types and uses one thread: for callers that know their arrays.
        """
        return self._single

    def __call__(
        self, *arrays: ArrayLike, out: Array | None = None, threads: int | None = None
    ) -> Array:
        """The expression's value, with the leading axes of the inputs broadcast.

        Args:
            arrays: one for each input, (*batch, n) each.
            out: where results go, (*batch, *shape).
            threads: how many work on it; all cores for large batches by default.

        Raises:
            ValueError: the number or the shape of the inputs is wrong; the message names which.
            TypeError: an input or ``out`` does not hold real numbers.
        """
        if out is None and self._single is not None and len(arrays) == len(self.inputs):
            for array in arrays:
                if type(array) is not np.ndarray or array.ndim != 1:
                    break
            else:  # the quick way for one row
                try:
                    return self._single(*arrays)  # type: ignore[no-any-return]
                except (TypeError, ValueError):
                    pass  # told with names below
        return self._general(arrays, out, threads)

    def _general(
        self, arrays: Sequence[ArrayLike], out: Array | None, threads: int | None
    ) -> Array:
        checked = arguments.checked(self.name, self.inputs, arrays)
        batch = arguments.batch(self.name, dict(zip(self.inputs, checked, strict=True)))
        result = arguments.room(self.name, out, (*batch, *self.shape))
        if not result.size:
            return result
        rows = prod(batch)
        function = self.compilation.function_for(rows)
        if rows == 1 and self._simple:
            self._single = function
        used = [array for array in checked if array.shape[-1]] or [np.zeros((*batch, 1))]
        if out is not None:  # rows are computed in blocks, some of them twice
            used = [array.copy() if np.may_share_memory(array, out) else array for array in used]
        target = result
        if self._long:  # rows that are not contiguous would be buffered on the stack
            used = [np.ascontiguousarray(array) for array in used]
            target = result if result.flags.c_contiguous else np.empty(result.shape)
        parts = threading.parts(rows * self.size, threads)
        threading.run(function, used, target, batch, parts)
        if target is not result:
            result[...] = target
        return result if result.ndim or out is not None else result[()]
