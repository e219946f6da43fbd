"""Names that kernels and their inputs can have in C, C++ and CUDA C."""

from __future__ import annotations

import re
from collections.abc import Collection

from gough.errors import ConfigurationError

_KEYWORDS = """
    alignas alignof and and_eq asm auto bitand bitor bool break case catch char class compl concept
    const const_cast consteval constexpr constinit continue co_await co_return co_yield decltype
    default delete do double dynamic_cast else enum explicit export extern false float for friend
    goto if inline int long mutable namespace new noexcept not not_eq nullptr operator or or_eq
    private protected public register reinterpret_cast requires restrict return short signed sizeof
    static static_assert static_cast struct switch template this thread_local throw true try typedef
    typeid typename union unsigned using virtual void volatile wchar_t while xor xor_eq
"""
_USED = """
    INFINITY NAN UINT64_C blockDim blockIdx fabs floor fma gridDim kept main memcpy out row rows
    size_t sqrt threadIdx uint64_t
"""
_LIBRARY = """
    acos acosh asin asinh atan atan2 atanh cbrt ceil copysign cos cosh erf erfc exp exp2 expm1 fdim
    fmax fmin fmod frexp hypot ilogb ldexp lgamma llrint llround log log10 log1p log2 logb lrint
    lround modf nan nearbyint nextafter pow remainder remquo rint round sin sinh tan tanh tgamma
    trunc
"""
_TAKEN = frozenset(f"{_KEYWORDS} {_USED}".split())
"""Words of C and C++, and names that stand in the files we write."""
_TAKEN_BY_FUNCTIONS = _TAKEN | frozenset(_LIBRARY.split())


def check_names(kernel: str, inputs: Collection[str]) -> None:
    """Refuse names that a compiler would not take, or would take for something else.

    Raises:
        ConfigurationError: the kernel or an input has such a name.
    """
    _check("kernel", kernel, _TAKEN_BY_FUNCTIONS)
    ours = {label for label in inputs if label == kernel or label.startswith(f"{kernel}_")}
    for label in inputs:
        _check("input", label, _TAKEN | ours)


def _check(what: str, word: str, taken: Collection[str]) -> None:
    if not re.fullmatch("[A-Za-z][A-Za-z0-9_]*", word):
        problem = "is no name in C: begin with a letter, go on with letters, digits and _"
    elif word in taken:
        problem = "means something else in C or in the file"
    elif re.fullmatch(r"v\d+", word):
        problem = "is how the file names its values"
    else:
        return
    other = re.sub(r"\W", "_", f"{what}_{word}", flags=re.ASCII)
    raise ConfigurationError(f"{what} {word!r} {problem}; call it {other!r}, say")
