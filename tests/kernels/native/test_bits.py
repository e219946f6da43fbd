"""Machine code gives the bits of the reference for every number of lanes, rows and stretches."""

import ctypes

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gough.kernels.fusing import fused
from gough.kernels.native.machine import host
from gough.kernels.native.store import load
from gough.kernels.native.text import ENTRY, KernelText
from tests.kernels.random_tapes import assert_same, exact_run, random_tape, special_rows

SIGNATURE = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_int64)
ROWS = 37
MANY = 10_000 if settings.get_current_profile_name() == "long" else 60


def native(tape, width, longest=5000, level=2, machine=None):
    """A function of rows (rows, inputs) -> (rows, outputs) in machine code."""
    sizes = [tape.inputs] if tape.inputs else [1]
    text = str(KernelText(tape, sizes, width, longest))
    loaded = load((machine or host()).object_code(text, level))
    function = SIGNATURE(loaded.address(ENTRY))

    def call(rows, out=None):
        assert loaded  # alive
        if out is None:
            out = np.full((len(rows), len(tape.outputs)), 7.0)
        pointers = np.array([rows.ctypes.data, out.ctypes.data])
        steps = np.array([rows.strides[0], out.strides[0]])
        function(pointers.ctypes.data, steps.ctypes.data, len(rows))
        return out

    return call


def rows_for(rng, tape):
    rows = special_rows(rng, tape, ROWS)
    return np.ascontiguousarray(rows) if tape.inputs else np.zeros((ROWS, 1))


@settings(max_examples=MANY)
@given(st.integers(0, 2**32))
def test_random_tapes(seed):
    rng = np.random.default_rng(seed)
    tape = random_tape(rng, int(rng.integers(1, 50)), fused=bool(seed % 2), careful=seed % 8 == 0)
    if seed % 3 == 0:
        tape = fused(tape)
    rows = rows_for(rng, tape)
    expected = exact_run(tape, rows[:, : tape.inputs])
    for width in (1, 2, 4, 8):
        longest = int(rng.choice([4, 15, 5000]))
        call = native(tape, width, longest, level=int(rng.choice([0, 2])))
        assert_same(call(rows), expected)
        count = int(rng.integers(1, ROWS))
        assert_same(call(rows[:count]), expected[:count])


@pytest.mark.parametrize("width", [1, 2, 4, 8])
@pytest.mark.parametrize("longest", [12, 5000])
def test_every_number_of_rows(width, longest):
    rng = np.random.default_rng(width)
    tape = random_tape(rng, 60, fused=True)
    rows = np.ascontiguousarray(special_rows(rng, tape, 41))
    expected = exact_run(tape, rows)
    call = native(tape, width, longest)
    for count in range(1, 41):
        assert_same(call(rows[:count]), expected[:count])


def test_a_processor_without_wide_registers():
    rng = np.random.default_rng(5)
    tape = random_tape(rng, 80, fused=True)
    rows = np.ascontiguousarray(special_rows(rng, tape, 20))
    narrow = host().without("avx512")
    assert narrow.width <= 4
    assert_same(native(tape, narrow.width, machine=narrow)(rows), exact_run(tape, rows))
