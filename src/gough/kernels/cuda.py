"""Kernels as CUDA C: a device function of one row and a kernel over rows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from gough.kernels.c_family import OPERATIONS, Language, Program
from gough.kernels.tape import REAL, TRUTH, WORD, Tape

CUDA = Language(
    types={REAL: "double", TRUTH: "int", WORD: "unsigned long long"},
    operations=OPERATIONS
    | {
        # with these no flag of the compiler contracts or weakens anything
        "add": "__dadd_rn({0}, {1})",
        "sub": "__dsub_rn({0}, {1})",
        "mul": "__dmul_rn({0}, {1})",
        "div": "__ddiv_rn({0}, {1})",
        "sqrt": "__dsqrt_rn({0})",
        "fma": "__fma_rn({0}, {1}, {2})",
        "fms": "__fma_rn({0}, {1}, -{2})",
        "fnma": "__fma_rn(-{0}, {1}, {2})",
        "to_word": "(unsigned long long)__double_as_longlong({0})",
        "to_real": "__longlong_as_double((long long){0})",
    },
    bits="{:#x}ULL",
    infinity="__longlong_as_double(0x7ff0000000000000LL)",
    nan="__longlong_as_double(0x7ff8000000000000LL)",
    local="static __device__",
    part="static __device__ __noinline__",
    row="__device__ void",
    batch='extern "C" __global__ void',
    restrict="__restrict__ ",
)

_NOTES = (
    "All arrays are in device memory, rows one after the other. The numbers have the same bits as "
    "on the CPU under all flags of the compiler. Needs no header, so that NVRTC takes it as it is.",
)


def cuda_source(
    name: str,
    tape: Tape,
    inputs: Mapping[str, int],
    *,
    about: str = "",
    shape: Sequence[int] | None = None,
) -> str:
    """A kernel in CUDA C, whose functions are::

        __device__ void name(const double *q, const double *p, double *out);
        __global__ void name_batch(size_t rows, const double *q, const double *p, double *out);

    The second takes all rows with any number of blocks and threads. Arguments are as for
    `c.c_source`; empty inputs have no pointer.

    Raises:
        ConfigurationError: the kernel or an input has a name that C++ does not take.
    """
    program = Program.checked(CUDA, name, tape, inputs)
    return f"""\
{program.comment(about, shape, _NOTES)}
{program.function()}
{program.batch_head(CUDA.restrict)}
{{
    const size_t stride = (size_t)gridDim.x * blockDim.x;
    for (size_t row = (size_t)blockIdx.x * blockDim.x + threadIdx.x; row < rows; row += stride)
        {program.call()}
}}
"""
