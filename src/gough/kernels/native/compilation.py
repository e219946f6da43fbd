"""A program as machine code for one row and for many."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from threading import RLock
from typing import Any, NamedTuple

from gough.cache import digest
from gough.kernels.native.machine import Loaded, host, level_for
from gough.kernels.native.store import compiled_from
from gough.kernels.native.text import ENTRY, KernelText
from gough.kernels.native.ufunc import Shape, Ufunc
from gough.kernels.tape import Tape

LONGEST = 4000
"""Operations of one function; longer programs become several."""


COMPILING = RLock()
"""One thread compiles at a time: all must get one machine code, and none in use be replaced."""


class Addresses(NamedTuple):
    """Where the machine code of a kernel stands: ``void kernel(pointers, steps, rows)``."""

    scalar: int
    """Takes one row at a time."""
    wide: int
    """Takes as many rows at a time as the processor has lanes; the same bits."""


class Compilation:
    """Machine code of one program, made when it is first wanted.

    Args:
        name: a name for numpy's messages.
        program: gives a tape in primitives; called if the code is not on the disk.
        origin: a digest of what the program is made from.
        sizes: numbers in each input, none of them 0.
        shape: shape of the output, not empty.
    """

    def __init__(
        self,
        name: str,
        program: Callable[[], Tape],
        origin: bytes,
        sizes: Sequence[int],
        shape: Shape,
    ) -> None:
        self._program, self._origin, self._sizes = program, origin, sizes
        self._ufunc = Ufunc(name, [(size,) for size in sizes], shape)
        self._loaded: dict[int, Loaded] = {}

    def function_for(self, rows: int) -> Any:
        """The numpy function, ready for a number of rows.

        It works for any number; what it is ready for is quick.
        """
        layout = self._ufunc.layout
        if rows >= host().width and host().width not in self._loaded:
            layout.wide = self.address(host().width)
            layout.scalar = layout.scalar or layout.wide
        elif layout.scalar is None or (rows == 1 and 1 not in self._loaded):
            layout.scalar = self.address(1)
            layout.wide = layout.wide or layout.scalar
        return self._ufunc.function

    @property
    def addresses(self) -> Addresses:
        """Both variants, for loops that are compiled themselves."""
        return Addresses(self.address(1), self.address(host().width))

    def address(self, width: int) -> int:
        """The code with this many lanes."""
        with COMPILING:
            return self._address(width)

    def _address(self, width: int) -> int:
        if width not in self._loaded:
            origin = digest(self._origin, str(self._sizes), str(width))
            self._loaded[width] = compiled_from(origin, lambda: self._text(width))
        return self._loaded[width].address(ENTRY)

    def _text(self, width: int) -> tuple[str, int]:
        """The LLVM text and the level of code generation."""
        program = self._program()
        return str(KernelText(program, self._sizes, width, LONGEST)), level_for(program.operations)
