"""The languages that kernels are written in, by name."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

from gough.errors import UnknownName
from gough.kernels.c import c_source
from gough.kernels.cuda import cuda_source
from gough.kernels.tape import Tape

Files = dict[str, str]
"""Texts by file name."""


def _c(name: str, tape: Tape, inputs: Mapping[str, int], about: str, shape: Sequence[int]) -> Files:
    written = c_source(name, tape, inputs, about=about, shape=shape)
    return {f"{name}.h": written.header, f"{name}.c": written.source}


def _cuda(
    name: str, tape: Tape, inputs: Mapping[str, int], about: str, shape: Sequence[int]
) -> Files:
    return {f"{name}.cu": cuda_source(name, tape, inputs, about=about, shape=shape)}


LANGUAGES: dict[str, Callable[[str, Tape, Mapping[str, int], str, Sequence[int]], Files]] = {
    "c": _c,
    "cuda": _cuda,
}
"""For each language how a tape in primitives is written in it."""


def files(
    language: str,
    name: str,
    tape: Tape,
    inputs: Mapping[str, int],
    about: str,
    shape: Sequence[int],
) -> Files:
    """A program in a language, as texts by file name.

    Raises:
        UnknownName: there is no such language.
        ConfigurationError: the name is none in the language.
    """
    if language not in LANGUAGES:
        raise UnknownName("language", language, LANGUAGES)
    return LANGUAGES[language](name, tape, inputs, about, shape)
