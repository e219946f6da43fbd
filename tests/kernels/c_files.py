"""Random kernels in one file, a compiler run over it, and the numbers that come out."""

from __future__ import annotations

import ctypes
import subprocess
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from hypothesis import settings

from gough.kernels.reference import Array
from gough.kernels.tape import Tape
from tests.kernels.random_tapes import assert_same, exact_run, listing, random_tape, special_rows

ROWS = 32
OPERATIONS = 40


@dataclass(frozen=True)
class Case:
    """A kernel to compile, and what it must give."""

    name: str
    tape: Tape
    inputs: dict[str, int]
    rows: Array
    expected: Array

    @classmethod
    def of(cls, rng: np.random.Generator, name: str, tape: Tape) -> Case:
        """A case with inputs p, q and r, of which some may be empty."""
        ends = [0, *sorted(rng.integers(0, tape.inputs + 1, 2)), tape.inputs]
        inputs = {label: int(n) for label, n in zip("pqr", np.diff(ends), strict=True)}
        rows = special_rows(rng, tape, ROWS)
        return cls(name, tape, inputs, rows, exact_run(tape, rows))

    @property
    def sizes(self) -> dict[str, int]:
        """Arrays that the functions take."""
        return {label: n for label, n in self.inputs.items() if n} | {"out": len(self.tape.outputs)}

    def check(self, library: ctypes.CDLL, function: str) -> None:
        """Compare what a function gives for all rows with what it must give."""
        out = np.full(self.expected.shape, 123.0)
        inputs = iter(np.split(self.rows, np.cumsum([*self.inputs.values()])[:-1], axis=1))
        arrays = [np.ascontiguousarray(part) for part in inputs if part.shape[1]]
        pointers = [array.ctypes.data_as(ctypes.c_void_p) for array in [*arrays, out]]
        getattr(library, function)(ctypes.c_size_t(len(out)), *pointers)
        try:
            assert_same(out, self.expected)
        except AssertionError as error:
            raise AssertionError(f"{self.name}: {error}\n{listing(self.tape)}") from None


def cases(
    seed: int, count: int, size: int = OPERATIONS, fused: bool = False, careful: bool = False
) -> list[Case]:
    """Random kernels k0, k1 …"""
    rng = np.random.default_rng(seed)
    tapes = [random_tape(rng, size, fused, careful) for _ in range(count)]
    return [Case.of(rng, f"k{n}", tape) for n, tape in enumerate(tapes)]


def how_many(usual: int) -> int:
    """So many cases, but as many as hypothesis tries where it was told to try many."""
    return max(usual, settings().max_examples)


def compiled(file: Path, text: str, *command: str) -> ctypes.CDLL:
    """The library that a compiler makes of a text."""
    file.write_text(text, encoding="utf-8")
    library = file.with_suffix(".so")
    subprocess.run([*command, file.name, "-o", library.name, "-lm"], cwd=file.parent, check=True)
    return ctypes.CDLL(str(library))


def check_all(library: ctypes.CDLL, checked: Iterable[Case], function: str) -> None:
    """Compare the results of all kernels; ``function`` is a name with a place for the kernel's."""
    for case in checked:
        case.check(library, function.format(case.name))
