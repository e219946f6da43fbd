"""Kernels called by their addresses, and where compiled loops are kept."""

import subprocess
import sys

import numba
import numpy as np
import pytest
from numba import types

from gough.numerics import calling

KERNEL = types.void(types.CPointer(types.int64), types.CPointer(types.int64), types.int64)


@numba.extending.intrinsic
def double_at(context, address):
    def generate(target, builder, signature, given):
        kind = target.get_value_type(types.CPointer(types.float64))
        return builder.load(builder.inttoptr(given[0], kind))

    return types.float64(types.int64), generate


@numba.extending.intrinsic
def put_double(context, address, value):
    def generate(target, builder, signature, given):
        kind = target.get_value_type(types.CPointer(types.float64))
        builder.store(given[1], builder.inttoptr(given[0], kind))
        return target.get_dummy_value()

    return types.void(types.int64, types.float64), generate


@numba.cfunc(KERNEL)
def difference(pointers, steps, rows):
    """Two numbers minus two numbers, one number each row."""
    for row in range(rows):
        a, b = pointers[0] + row * steps[0], pointers[1] + row * steps[1]
        first = double_at(a) - double_at(b)
        second = double_at(a + 8) - double_at(b + 8)
        put_double(pointers[2] + row * steps[2], first + 10 * second)


@numba.njit
def run(kernel, a, b, out, steps, rows):
    pointers = np.array([0, 0, 0])
    for k, array in enumerate((a, b, out)):
        pointers[k] = calling.address_of(calling.pointer_to(array, 0))
    calling.call_kernel(kernel, calling.pointer_to(pointers, 0), calling.pointer_to(steps, 0), rows)
    return pointers.sum()


def test_a_kernel_takes_rows_as_far_apart_as_told_and_repeats_one():
    a, b, out = np.arange(12.0), np.array([1.0, 2.0]), np.zeros(6)
    run(difference.address, a, b, out, np.array([32, 0, 16]), 3)
    np.testing.assert_array_equal(out[::2], [-11, 33, 77])
    np.testing.assert_array_equal(out[1::2], 0)


def test_a_pointer_counts_from_its_place():
    @numba.njit
    def third(array):
        return calling.pointer_to(calling.pointer_to(array, 1), 2)[0]

    assert third(np.arange(5.0)) == 3
    assert third(np.arange(5)) == 3


def test_loops_compile_where_nothing_can_be_kept(monkeypatch):
    real = numba.njit

    def njit(*given, cache=False, **options):
        if cache:
            raise RuntimeError("cannot cache function: no locator available")
        return real(*given, **options)

    monkeypatch.setattr(numba, "njit", njit)
    assert calling.compiled(lambda x: x + 1)(2) == 3


@pytest.mark.parametrize("module", ["gough", "gough.numerics", "gough.numerics.batch_newton"])
def test_numba_is_loaded_by_loops_alone(module):
    code = f"import sys, {module}; print('numba' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"
