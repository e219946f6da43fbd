"""Kernels in CUDA C: the compiler takes them, and they give the bits of the reference.

Where there is no GPU the same text runs on the CPU, with CUDA's words defined in a few lines.
"""

import ctypes
import shutil
import subprocess
from dataclasses import replace

import pytest

from gough.errors import ConfigurationError
from gough.kernels import c_family
from gough.kernels.cuda import cuda_source
from tests.kernels.c_files import cases, check_all, compiled, how_many

ON_THE_CPU = """\
#include <cmath>
#include <cstddef>
#include <cstring>
#define __global__
#define __device__
#define __noinline__ __attribute__((noinline))
using std::floor; using std::fabs;
struct Place { unsigned x; };
static Place blockIdx, threadIdx, blockDim = {4}, gridDim = {3};
static inline double __dadd_rn(double a, double b) { return a + b; }
static inline double __dsub_rn(double a, double b) { return a - b; }
static inline double __dmul_rn(double a, double b) { return a * b; }
static inline double __ddiv_rn(double a, double b) { return a / b; }
static inline double __dsqrt_rn(double a) { return std::sqrt(a); }
static inline double __fma_rn(double a, double b, double c) { return std::fma(a, b, c); }
static inline long long __double_as_longlong(double x)
{ long long bits; std::memcpy(&bits, &x, sizeof bits); return bits; }
static inline double __longlong_as_double(long long bits)
{ double x; std::memcpy(&x, &bits, sizeof x); return x; }
"""

EVERY_THREAD = """
extern "C" void {name}_all(size_t rows, {parameters})
{{
    for (blockIdx.x = 0; blockIdx.x < gridDim.x; ++blockIdx.x)
        for (threadIdx.x = 0; threadIdx.x < blockDim.x; ++threadIdx.x)
            {name}_batch(rows, {arguments});
}}
"""

LAUNCH = """
extern "C" void {name}_all(size_t rows, {parameters})
{{
    double *host[] = {{{arguments}}}, *device[{count}];
    const size_t size[] = {{{sizes}}};
    for (int k = 0; k < {count}; ++k) {{
        cudaMalloc(&device[k], 8 * rows * size[k]);
        cudaMemcpy(device[k], host[k], 8 * rows * size[k], cudaMemcpyHostToDevice);
    }}
    {name}_batch<<<3, 4>>>(rows, {on_device});
    const int last = {count} - 1;
    cudaMemcpy(host[last], device[last], 8 * rows * size[last], cudaMemcpyDeviceToHost);
    for (int k = 0; k < {count}; ++k)
        cudaFree(device[k]);
}}
"""

needs_nvcc = pytest.mark.skipif(shutil.which("nvcc") is None, reason="there is no nvcc")


def has_gpu():
    try:
        driver = ctypes.CDLL("libcuda.so.1")
    except OSError:
        return False
    count = ctypes.c_int(0)
    return driver.cuInit(0) == 0 and driver.cuDeviceGetCount(ctypes.byref(count)) == 0 < count.value


def kernel_texts(checked):
    return "\n".join(cuda_source(case.name, case.tape, case.inputs) for case in checked)


def with_callers(checked, caller):
    """The kernels, and for each a function that runs it over all rows."""
    texts = []
    for case in checked:
        count = len(case.sizes)
        caller_text = caller.format(
            name=case.name,
            count=count,
            parameters=", ".join(f"double *{label}" for label in case.sizes),
            arguments=", ".join(case.sizes),
            sizes=", ".join(map(str, case.sizes.values())),
            on_device=", ".join(f"device[{k}]" for k in range(count)),
        )
        texts += [cuda_source(case.name, case.tape, case.inputs), caller_text]
    return "\n".join(texts)


@pytest.fixture(params=[5000, 25], ids=["whole", "in parts"])
def longest(request, monkeypatch):
    monkeypatch.setattr(c_family, "LONGEST", request.param)


@pytest.mark.skipif(shutil.which("g++") is None, reason="there is no g++")
@pytest.mark.parametrize("fused", [False, True], ids=["plain", "fused"])
def test_on_the_cpu_the_bits_are_those_of_the_reference(tmp_path, fused, longest):
    checked = cases(10, min(how_many(30), 1000), fused=fused) + large_angles()
    text = ON_THE_CPU + with_callers(checked, EVERY_THREAD)
    flags = [
        "-shared",
        "-fPIC",
        "-O1",
        "-std=c++17",
        "-ffp-contract=off",
        "-Wall",
        "-Wextra",
        "-Werror",
        "-pedantic",
    ]
    check_all(compiled(tmp_path / "kernels.cpp", text, "g++", *flags), checked, "{}_all")


def large_angles():
    (case,) = cases(11, 1, size=300, careful=True)
    return [replace(case, name="large")]


@needs_nvcc
@pytest.mark.parametrize("flags", [["-ptx"], ["-cubin", "-arch=sm_80", "--use_fast_math"]])
def test_nvcc_takes_the_text(tmp_path, flags, longest):
    checked = cases(12, 20, fused=True) + large_angles()
    (tmp_path / "kernels.cu").write_text(kernel_texts(checked))
    command = ["nvcc", "-Werror", "all-warnings", *flags, "kernels.cu", "-o", "kernels.out"]
    subprocess.run(command, cwd=tmp_path, check=True)


@needs_nvcc
def test_no_flag_contracts(tmp_path):
    """Without fused operations on the tape there are none in the machine code."""
    checked = cases(13, 20)
    (tmp_path / "kernels.cu").write_text(kernel_texts(checked))
    command = ["nvcc", "-ptx", "-fmad=true", "--use_fast_math", "kernels.cu", "-o", "kernels.ptx"]
    subprocess.run(command, cwd=tmp_path, check=True)
    text = (tmp_path / "kernels.ptx").read_text()
    assert "mul.rn.f64" in text
    assert "fma.rn.f64" not in text


@needs_nvcc
@pytest.mark.skipif(not has_gpu(), reason="there is no GPU")
@pytest.mark.parametrize("fused", [False, True], ids=["plain", "fused"])
def test_on_the_gpu_the_bits_are_those_of_the_reference(tmp_path, fused, longest):
    checked = cases(14, 60, fused=fused) + large_angles()
    text = with_callers(checked, LAUNCH)
    flags = ["-shared", "-Xcompiler", "-fPIC", "-arch=native", "--use_fast_math"]
    check_all(compiled(tmp_path / "kernels.cu", text, "nvcc", *flags), checked, "{}_all")


def test_names_of_cuda_are_refused():
    tape = cases(15, 1)[0].tape
    with pytest.raises(ConfigurationError, match="input 'threadIdx' means something else"):
        cuda_source("k", tape, {"threadIdx": 1, "q": tape.inputs - 1})
