"""Calls of native kernels from loops compiled by numba.

A kernel is the address of a C function

    void kernel(const int64_t *pointers, const int64_t *steps, int64_t rows)

``pointers`` holds the addresses of the first row of each input that is not empty and of the output,
``steps`` the distances in bytes from one row to the next, 0 to repeat a row. Rows are contiguous
float64; the output overlaps no input.

numba keeps compiled loops on the disk. By itself it sees changes only of the file that a loop is
written in, so loops have a `digest` of all files here in their key.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from functools import cache, partial
from pathlib import Path
from typing import Any, TypeVar, cast

import numba
from llvmlite import ir
from numba.core import types
from numba.extending import intrinsic

Function = TypeVar("Function", bound=Callable[..., Any])
Lowering = tuple[Any, Callable[..., Any]]
INNER = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}
"""For functions that only compiled ones call: half of the time that compiling them takes."""


@cache
def digest() -> str:
    """A digest of the sources of this folder."""
    files = sorted(Path(__file__).parent.glob("*.py"))
    return hashlib.sha256(b"\0".join(file.read_bytes() for file in files)).hexdigest()


def compiled(function: Function) -> Function:
    """A function compiled at its first call, without the interpreter's lock, kept on the disk.

    numba keeps code beside the source, else in the user's folder for caches, or where
    NUMBA_CACHE_DIR says; if it may write nowhere, code is made anew in each process.
    """
    njit: Any = partial(numba.njit, nogil=True, error_model="numpy")
    try:
        return cast(Function, njit(cache=True)(function))
    except RuntimeError:  # no place to write
        return cast(Function, njit()(function))


def part(function: Function) -> Function:
    """A function that becomes part of the compiled ones that call it."""
    njit: Any = numba.njit
    return cast(Function, njit(error_model="numpy", forceinline=True, **INNER)(function))


def routine(function: Function) -> Function:
    """A function that the compiled ones call; for what is long or rare."""
    njit: Any = numba.njit
    return cast(Function, njit(nogil=True, error_model="numpy", **INNER)(function))


def _call_kernel(context: Any, address: Any, pointers: Any, steps: Any, rows: Any) -> Lowering:
    """Run a kernel.

    Args:
        context: numba's typing context; callers leave it out.
        address: of the kernel, int64.
        pointers: to the addresses of the first rows of inputs and output, int64.
        steps: to the bytes between rows, int64.
        rows: how many, from 1 up.
    """

    def generate(target: Any, builder: Any, signature: Any, given: Any) -> Any:
        number = ir.IntType(64)
        kind = ir.FunctionType(ir.VoidType(), [given[1].type, given[2].type, number])
        builder.call(builder.inttoptr(given[0], kind.as_pointer()), given[1:])
        return target.get_dummy_value()

    return types.void(types.int64, pointers, steps, types.int64), generate


def _call_tile(context: Any, address: Any, inputs: Any, outputs: Any) -> Lowering:
    """Run a kernel over a tile, see `gough.kernels.native.tiles`.

    Args:
        context: numba's typing context; callers leave it out.
        address: of the kernel, int64.
        inputs: pointer to the numbers that go in.
        outputs: pointer to where results go; they overlap nothing.
    """

    def generate(target: Any, builder: Any, signature: Any, given: Any) -> Any:
        kind = ir.FunctionType(ir.VoidType(), [given[1].type, given[2].type])
        builder.call(builder.inttoptr(given[0], kind.as_pointer()), given[1:])
        return target.get_dummy_value()

    return types.void(types.int64, inputs, outputs), generate


def _pointer_to(context: Any, array: Any, index: Any) -> Lowering:
    """Pointer to a number of a contiguous array or behind a pointer, indexed like an array.

    It costs nothing to hand around, and does not keep the array alive: numba lets go of an array
    after its last use, so hold one that you were given.
    """

    def generate(target: Any, builder: Any, signature: Any, given: Any) -> Any:
        start = given[0]
        if isinstance(array, types.Array):
            start = target.make_array(array)(target, builder, start).data
        return builder.gep(start, [given[1]])

    pointer: Any = types.CPointer
    return pointer(array.dtype)(array, types.int64), generate


def _address_of(context: Any, pointer: Any) -> Lowering:
    """The address in a pointer, int64."""

    def generate(target: Any, builder: Any, signature: Any, given: Any) -> Any:
        return builder.ptrtoint(given[0], ir.IntType(64))

    return types.int64(pointer), generate


call_kernel: Any = intrinsic(_call_kernel)
call_tile: Any = intrinsic(_call_tile)
pointer_to: Any = intrinsic(_pointer_to)
address_of: Any = intrinsic(_address_of)
