"""A vector expression as a numpy function over batches, and what can be made of it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cached_property
from math import prod

import casadi

from gough.cache import digest
from gough.errors import ConfigurationError
from gough.kernels import languages
from gough.kernels.complex_lanes import complex_tape
from gough.kernels.evaluator import Evaluator
from gough.kernels.expansion import expanded
from gough.kernels.fusing import fused
from gough.kernels.intervals import interval_tape
from gough.kernels.reading import read
from gough.kernels.tape import Tape


class Kernel(Evaluator):
    """A numpy function of named vectors: ``(*batch, n), … -> (*batch, *shape)``.

    Args:
        name: a name for messages.
        inputs: a column of symbols for each input, in calling order.
        output: the expression, a matrix in these symbols.
        shape: shape of one result; the shape of the output by default. Rows vary slowest.
        fuse: whether products and sums are joined in one rounding where the tape allows it.
            Without, results are bit-equal to `reference.run`.

    Raises:
        ConfigurationError: the shape does not hold the output, or an input is sparse.
    """

    def __init__(
        self,
        name: str,
        inputs: Mapping[str, casadi.SX],
        output: casadi.SX,
        shape: tuple[int, ...] | None = None,
        fuse: bool = True,
    ) -> None:
        self.fuse = fuse
        shape = tuple(output.shape) if shape is None else tuple(shape)
        if min(shape, default=0) < 0 or prod(shape) != output.numel():
            raise ConfigurationError(
                f"{name}: shape {shape} does not hold the {output.numel()} numbers of the output"
            )
        for label, symbols in inputs.items():
            if not symbols.is_dense():
                raise ConfigurationError(
                    f"{name}: input {label} is sparse; give all its numbers as one dense column"
                )
        # CasADi stores by columns; the transposed output read by columns is rows first.
        flat = casadi.densify(casadi.vec(output.T))
        self.expression = casadi.Function("kernel", list(inputs.values()), [flat])
        super().__init__(
            name,
            {label: symbols.numel() for label, symbols in inputs.items()},
            shape,
            lambda: self.program,
            lambda: self.origin,
            self.expression.n_instructions(),
        )

    @cached_property
    def origin(self) -> bytes:
        """A digest of the expression."""
        text = self.expression.serialize()
        return digest(text, casadi.CasadiMeta.version(), str(self.fuse))

    @cached_property
    def tape(self) -> Tape:
        """The program with its functions by name."""
        return read(self.expression)

    @cached_property
    def program(self) -> Tape:
        """The program that back ends run: functions written out, sums and products fused."""
        return self._written_out(self.tape)

    def _written_out(self, tape: Tape) -> Tape:
        primitives = expanded(tape)
        return fused(primitives) if self.fuse else primitives

    @cached_property
    def complex_lanes(self) -> Evaluator:
        """The same of complex numbers: ``(*batch, 2 n), … -> (*batch, *shape, 2)``.

        Real and imaginary part stand side by side, as in ``z.view(float)`` of complex numbers z.
        What continues the functions is told in `gough.kernels.complex_lanes`.
        """
        return self._of_pairs("complex", lambda: complex_tape(self.tape))

    @cached_property
    def intervals(self) -> Evaluator:
        """The same of intervals: ``(*batch, 2 n), … -> (*batch, *shape, 2)``, outward-rounded.

        Lower and upper bound stand side by side. What is promised is told in
        `gough.kernels.intervals`.
        """
        return self._of_pairs("intervals", lambda: interval_tape(self.tape))

    def _of_pairs(self, kind: str, tape: Callable[[], Tape]) -> Evaluator:
        return Evaluator(
            f"{self.name} of {kind}",
            {label: 2 * size for label, size in self.inputs.items()},
            (*self.shape, 2),
            lambda: self._written_out(tape()),
            lambda: digest(self.origin, kind),
            4 * self.size,
        )

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
