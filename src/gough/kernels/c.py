"""Kernels as C99: a header and a source file that need only the standard library."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from gough.kernels.c_family import OPERATIONS, Language, Program
from gough.kernels.tape import REAL, TRUTH, WORD, Tape

C99 = Language(
    types={REAL: "double", TRUTH: "int", WORD: "uint64_t"},
    operations=OPERATIONS
    | {
        "fma": "{name}_fma({0}, {1}, {2})",
        "fms": "{name}_fma({0}, {1}, -{2})",
        "fnma": "{name}_fma(-{0}, {1}, {2})",
    },
    bits="UINT64_C({:#x})",
    infinity="(double)INFINITY",
    nan="(double)NAN",
    local="static",
    part="GOUGH_PART static",
    row="void",
    batch="void",
    restrict="restrict ",
)

_NOTES = (
    "Compile with -ffp-contract=off and without -ffast-math: then the numbers have the same bits "
    "as everywhere else. -fno-math-errno makes square roots faster and changes no bits. Where fma "
    "is counted, -mfma or -march=native make it an instruction instead of a call.",
)

_GUARDS = """\
#if defined(__FAST_MATH__) || (defined(__FINITE_MATH_ONLY__) && __FINITE_MATH_ONLY__)
#error "-ffast-math changes the numbers: compile without it"
#endif
#if defined(__FLT_EVAL_METHOD__) && __FLT_EVAL_METHOD__ == 2
#error "x87 arithmetic changes the numbers: compile with -msse2 -mfpmath=sse"
#endif
#if defined(__GNUC__) && !defined(__clang__)
#pragma GCC optimize("fp-contract=off")
#else
#pragma STDC FP_CONTRACT OFF
#endif
"""

_HELPERS = {
    "GOUGH_PART": """\
#ifdef __GNUC__
#define GOUGH_PART __attribute__((noinline))
#else
#define GOUGH_PART
#endif

""",
    "{name}_fma(": """\
/* GCC takes -fma(a, b, c) for fma(-a, b, -c), which is -0 instead of +0, or +0 instead of -0, where
 * the sum is zero. An instruction of no effect hides from it where the number comes from. */
static inline double {name}_fma(double a, double b, double c)
{{
    double x = fma(a, b, c);
#if defined(__GNUC__) && !defined(__clang__) && defined(__SSE2__)
    __asm__("" : "+v"(x));
#elif defined(__GNUC__) && !defined(__clang__) && defined(__aarch64__)
    __asm__("" : "+w"(x));
#elif defined(__GNUC__) && !defined(__clang__)
    __asm__("" : "+m"(x));
#endif
    return x;
}}

""",
    "{name}_word(": """\
static inline uint64_t {name}_word(double x)
{{
    uint64_t bits;
    memcpy(&bits, &x, sizeof bits);
    return bits;
}}

""",
    "{name}_real(": """\
static inline double {name}_real(uint64_t bits)
{{
    double x;
    memcpy(&x, &bits, sizeof x);
    return x;
}}

""",
}


@dataclass(frozen=True)
class CSource:
    """Texts of the two files of a kernel."""

    header: str
    """For ``name.h``; C++ takes it too."""
    source: str
    """For ``name.c``; includes ``name.h``."""


def c_source(
    name: str,
    tape: Tape,
    inputs: Mapping[str, int],
    *,
    about: str = "",
    shape: Sequence[int] | None = None,
) -> CSource:
    """A kernel in C99, whose functions are::

        void name(const double *q, const double *p, double *out);
        void name_batch(size_t rows, const double *q, const double *p, double *out);

    There is a pointer for each input that holds numbers; empty inputs have none. The rows of a
    batch stand one after the other in each array. Outputs must not overlap inputs.

    Args:
        name: name of the function and of the files.
        tape: the program, in primitives alone (`expansion.expanded`).
        inputs: names and sizes of the inputs; the slots of the tape are theirs in this order.
        about: what the kernel computes, for the comment on top.
        shape: shape of one result, for the comment.

    Raises:
        ConfigurationError: the kernel or an input has a name that C does not take.
    """
    program = Program.checked(C99, name, tape, inputs)
    comment = program.comment(about, shape, _NOTES)
    return CSource(_header(program, comment), _source(program, comment))


def _header(program: Program, comment: str) -> str:
    guard = f"{program.name.upper()}_H"
    return f"""\
{comment}#ifndef {guard}
#define {guard}

#include <stddef.h>

#ifdef __cplusplus
extern "C" {{
#endif

/* One row. The outputs must not overlap the inputs. */
{program.row_head()};

/* Rows that stand one after the other in each array. */
{program.batch_head()};

#ifdef __cplusplus
}}
#endif

#endif
"""


def _source(program: Program, comment: str) -> str:
    function = program.function()
    helpers = [
        text for cast, text in _HELPERS.items() if cast.format(name=program.name) in function
    ]
    return f"""\
{comment}#include "{program.name}.h"

#include <math.h>
#include <stdint.h>
#include <string.h>

{_GUARDS}
{"".join(helpers).format(name=program.name)}{function}
{program.batch_head(C99.restrict)}
{{
    for (size_t row = 0; row < rows; ++row)
        {program.call()}
}}
"""
