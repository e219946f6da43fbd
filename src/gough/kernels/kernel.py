"""A vector expression as a numpy function over batches."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property
from math import prod
from typing import Any

import casadi
import numpy as np
from numpy.typing import ArrayLike, NDArray

from gough.kernels import arguments, languages, threading
from gough.kernels.expansion import expanded
from gough.kernels.fusing import fused
from gough.kernels.native.cache import digest
from gough.kernels.native.compilation import Compilation
from gough.kernels.reading import read
from gough.kernels.tape import Tape

Array = NDArray[np.float64]


class Kernel:
    """A numpy function of named vectors: ``(*batch, n), … -> (*batch, *shape)``.

    Every path through it gives the same bits: one row or many, any number of threads.

    Args:
        name: a name for messages.
        inputs: a column of symbols for each input, in calling order.
        output: the expression, a matrix in these symbols.
        shape: shape of one result; the shape of the output by default. Rows vary slowest.
        fuse: whether products and sums are joined in one rounding where the tape allows it.
            Without, results are bit-equal to `reference.run`.
    """

    def __init__(
        self,
        name: str,
        inputs: Mapping[str, casadi.SX],
        output: casadi.SX,
        shape: tuple[int, ...] | None = None,
        fuse: bool = True,
    ) -> None:
        self.name = name
        self.inputs = {label: symbols.numel() for label, symbols in inputs.items()}
        self.shape = tuple(output.shape) if shape is None else tuple(shape)
        self.fuse = fuse
        # CasADi stores by columns; the transposed output read by columns is rows first.
        flat = casadi.densify(casadi.vec(output.T))
        self.expression = casadi.Function("kernel", list(inputs.values()), [flat])
        self._simple = all(self.inputs.values()) and bool(self.inputs) and prod(self.shape) > 0
        self._single: Any = None

    # what it computes

    @cached_property
    def tape(self) -> Tape:
        """The program with its functions by name."""
        return read(self.expression)

    @cached_property
    def program(self) -> Tape:
        """The program that back ends run: functions written out, sums and products fused."""
        tape = expanded(self.tape)
        return fused(tape) if self.fuse else tape

    @cached_property
    def compilation(self) -> Compilation:
        """The program's machine code; its inputs are those that are not empty."""
        sizes = [size for size in self.inputs.values() if size] or [1]
        origin = digest(self.expression.serialize(), casadi.CasadiMeta.version(), str(self.fuse))
        return Compilation(self.name, lambda: self.program, origin, sizes, self.shape)

    def files(self, language: str, name: str, about: str = "") -> dict[str, str]:
        """The program in another language, as texts by file name; the same bits as here.

        Args:
            language: one of `languages.LANGUAGES`.
            name: of the function and of the files.
            about: what it computes, for the comment on top.

        Raises:
            UnknownName: there is no such language.
            ConfigurationError: the name is none in the language.
        """
        return languages.files(language, name, self.program, self.inputs, about, self.shape)

    # calling

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
        parts = threading.parts(rows * self.expression.n_instructions(), threads)
        threading.run(function, used, result, batch, parts)
        return result
