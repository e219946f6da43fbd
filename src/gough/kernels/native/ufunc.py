"""numpy functions made of machine code, by numpy's own C interface.

A generalised ufunc broadcasts leading axes, casts, copes with overlapping and unaligned arrays and
releases the interpreter; only its inner loop is ours (`inner_loop.ll`).
"""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from functools import cache
from math import prod
from pathlib import Path
from typing import Any

import numpy as np

from gough.errors import ConfigurationError
from gough.kernels.native.machine import Loaded, host
from gough.kernels.native.store import compiled

NPY_DOUBLE = 12
FROM_FUNC_AND_DATA_AND_SIGNATURE = 31
"""Place of PyUFunc_FromFuncAndDataAndSignature in numpy's table of functions for ufuncs."""

Shape = tuple[int, ...]


class Layout(ctypes.Structure):
    """What the inner loop has to know of a kernel; the fields are told in `inner_loop.ll`."""

    _fields_ = (
        ("scalar", ctypes.c_void_p),
        ("wide", ctypes.c_void_p),
        *((name, ctypes.c_int64) for name in ("operands", "axes", "numbers")),
        *((name, ctypes.c_void_p) for name in ("axes_of", "extents", "expected", "sizes")),
    )


class Ufunc:
    """A numpy function of rows of the given shapes; the memory it stands on lives with it."""

    def __init__(self, name: str, inputs: Sequence[Shape], output: Shape) -> None:
        shapes = [*inputs, output]
        strides = [[8 * prod(shape[k + 1 :]) for k in range(len(shape))] for shape in shapes]
        self._numbers = [
            np.array(values, dtype=np.int64)
            for values in (
                [len(shape) for shape in shapes],
                [extent for shape in shapes for extent in shape],
                [stride for own in strides for stride in own],
                [prod(shape) for shape in shapes],
            )
        ]
        axes_of, extents, expected, sizes = (array.ctypes.data for array in self._numbers)
        total = int(self._numbers[3].sum())
        self.layout = Layout(
            None, None, len(shapes), len(self._numbers[1]), total, axes_of, extents, expected, sizes
        )
        self._name = name.encode()
        self._signature = _signature(inputs, output).encode()
        self._loops = (ctypes.c_void_p * 1)(_inner_loop().address("inner_loop"))
        self._data = (ctypes.c_void_p * 1)(ctypes.addressof(self.layout))
        self._types = (ctypes.c_char * len(shapes))(*[bytes([NPY_DOUBLE])] * len(shapes))
        self.function: Any = self._made(len(inputs))

    def _made(self, inputs: int) -> Any:
        numbers, pointer, text = ctypes.c_int, ctypes.c_void_p, ctypes.c_char_p
        make = ctypes.PYFUNCTYPE(
            ctypes.py_object,
            *(pointer, pointer, pointer, numbers, numbers, numbers, numbers),
            *(text, text, numbers, text),
        )(_numpy_function(FROM_FUNC_AND_DATA_AND_SIGNATURE))
        arrays = [ctypes.addressof(a) for a in (self._loops, self._data, self._types)]
        no_identity = -1
        return make(*arrays, 1, inputs, 1, no_identity, self._name, b"", 0, self._signature)


def _signature(inputs: Sequence[Shape], output: Shape) -> str:
    """Fixed sizes, as "(19),(3)->(6,12)"."""
    texts = [f"({','.join(map(str, shape))})" for shape in (*inputs, output)]
    return f"{','.join(texts[:-1])}->{texts[-1]}"


@cache
def _inner_loop() -> Loaded:
    """The loop that all kernels share; held for ever.

    Raises:
        ConfigurationError: the processor is of a kind that kernels do not know.
    """
    kind = host().triple.split("-")[0]
    kind = {"arm64": "aarch64", "amd64": "x86_64"}.get(kind, kind)
    folder = Path(__file__).parent
    status = folder / f"status_{kind}.ll"
    if not status.is_file():
        raise ConfigurationError(f"kernels run on x86_64 and aarch64 processors, not on {kind}")
    texts = [(folder / "inner_loop.ll").read_text("utf-8"), status.read_text("utf-8")]
    return compiled("\n".join(texts), level=2)


def _numpy_function(index: int) -> int:
    """Address of a function of numpy's interface for ufuncs."""
    from numpy._core import _multiarray_umath  # type: ignore[attr-defined]

    get = ctypes.pythonapi.PyCapsule_GetPointer
    get.restype, get.argtypes = ctypes.c_void_p, [ctypes.py_object, ctypes.c_char_p]
    table = get(_multiarray_umath._UFUNC_API, None)
    assert isinstance(table, int)
    address = ctypes.c_void_p.from_address(table + index * ctypes.sizeof(ctypes.c_void_p)).value
    assert address is not None
    return address
