"""A kernel for loops that are compiled themselves: over tiles, what is held done beforehand."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

from gough.cache import digest
from gough.kernels.evaluator import Evaluator
from gough.kernels.expansion import expanded
from gough.kernels.fusing import fused
from gough.kernels.hoisting import Hoisted, hoisted
from gough.kernels.kernel import Kernel
from gough.kernels.native.compilation import COMPILING, LONGEST
from gough.kernels.native.machine import Loaded, host, level_for
from gough.kernels.native.store import compiled_from
from gough.kernels.native.tiles import ENTRY, SkippingTileText, TileText
from gough.kernels.skipping import Skipping, skipping
from gough.kernels.tape import Tape


class TiledKernel:
    """The machine code of a kernel over tiles; `native.tiles` tells its form.

    A lane's numbers are the inputs that are not held, in their order, and then the prepared ones.

    Args:
        kernel: the expression.
        held: inputs that stay the same through many evaluations, in any order; the attribute
            ``held`` has them in the kernel's.
    """

    def __init__(self, kernel: Kernel, held: Sequence[str] = ()) -> None:
        assert set(held) <= set(kernel.inputs)
        self.kernel, self.held = kernel, tuple(k for k in kernel.inputs if k in held)
        self.inputs = {k: n for k, n in kernel.inputs.items() if k not in self.held}
        """Sizes of the inputs that are not held."""
        self._loaded: dict[int, Loaded] = {}

    @cached_property
    def _parts(self) -> Hoisted:
        slots: list[int] = []
        start = 0
        for name, size in self.kernel.inputs.items():
            if name in self.held:
                slots += range(start, start + size)
            start += size
        return hoisted(self.kernel.tape, slots)

    @cached_property
    def program(self) -> Tape:
        """What a tile goes through, in primitives."""
        return self._written_out(self._parts.rest)

    def _written_out(self, tape: Tape) -> Tape:
        primitives = expanded(tape)
        return fused(primitives) if self.kernel.fuse else primitives

    @cached_property
    def prepare(self) -> Evaluator:
        """Prepared numbers of the held inputs: ``(*batch, n), … -> (*batch, prepared)``."""
        tape = self._parts.prepared
        return Evaluator(
            f"{self.kernel.name} prepared",
            {name: self.kernel.inputs[name] for name in self.held},
            (len(tape.outputs),),
            lambda: self._written_out(tape),
            lambda: digest(self.kernel.origin, "prepared", *self.held),
            tape.operations,
        )

    def address(self, width: int) -> int:
        """Of the code for a number of lanes; keep this object as long as it is in use."""
        with COMPILING:
            if width not in self._loaded:
                origin = digest(self.kernel.origin, "tile", str(width), *self.held)
                self._loaded[width] = compiled_from(origin, lambda: self._text(width))
            return self._loaded[width].address(ENTRY)

    def _text(self, width: int) -> tuple[str, int]:
        level = level_for(self.program.operations)
        three = skipping(self._parts.rest)
        if three is None or self.program.operations > LONGEST:
            return str(TileText(self.program, width, LONGEST)), level
        return str(SkippingTileText(Skipping(*map(self._written_out, three)), width)), level


def widest() -> int:
    """Lanes of this computer's widest registers."""
    return host().width
