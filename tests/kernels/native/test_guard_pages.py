"""No kernel reads or writes past its arrays: they end where memory ends."""

import ctypes
import mmap

import numpy as np
import pytest

from tests.kernels.native.test_bits import native
from tests.kernels.random_tapes import assert_same, exact_run, random_tape, special_rows

PAGE, NO_ACCESS = mmap.PAGESIZE, 0
libc = ctypes.CDLL(None, use_errno=True)


class Guarded:
    """An array that ends where a closed page begins, or begins where one ends."""

    def __init__(self, shape, at_end):
        count = int(np.prod(shape))
        pages = max(1, -(-8 * count // PAGE))
        self.map = mmap.mmap(-1, (pages + 2) * PAGE)
        start = ctypes.addressof(ctypes.c_char.from_buffer(self.map))
        for closed in (start, start + (pages + 1) * PAGE):
            assert libc.mprotect(ctypes.c_void_p(closed), PAGE, NO_ACCESS) == 0
        offset = (pages + 1) * PAGE - 8 * count if at_end else PAGE
        self.array = np.frombuffer(self.map, np.float64, count, offset).reshape(shape)


@pytest.mark.skipif(not hasattr(libc, "mprotect"), reason="needs mprotect")
@pytest.mark.parametrize("width", [1, 2, 4, 8])
@pytest.mark.parametrize("longest", [10, 5000])
def test_batches_of_every_length_at_the_end_of_a_page(width, longest):
    rng = np.random.default_rng(width)
    for size in (3, 19, 33):
        tape = random_tape(rng, size, fused=True)
        while not tape.inputs:
            tape = random_tape(rng, size, fused=True)
        call = native(tape, width, longest)
        for count in range(1, 41):
            for at_end in (True, False):
                rows = Guarded((count, tape.inputs), at_end).array
                rows[:] = special_rows(rng, tape, count)
                out = Guarded((count, len(tape.outputs)), at_end).array
                assert_same(call(rows, out), exact_run(tape, rows))
