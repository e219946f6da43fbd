"""Machine code from this process, from the disk, or made anew.

Code is kept under a digest of its LLVM text, the version of LLVM and the processor. Writing the
text of a large model takes longer than reading its code, so a second key, of what the text is made
from and of the sources that make it, leads to the first without the text.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from functools import cache
from pathlib import Path
from weakref import WeakValueDictionary

from gough.kernels.native.cache import Cache, digest, from_environment
from gough.kernels.native.machine import Loaded, host

_in_memory: WeakValueDictionary[bytes, Loaded] = WeakValueDictionary()


def compiled(text: str, level: int) -> Loaded:
    """Code of an LLVM module, generated at a level and loaded."""
    key = _key(text, level)
    known = _known(key)
    if known is not None:
        return known
    code = host().object_code(text, level)
    _disk().put(key, code)
    loaded = _in_memory[key] = Loaded(code)
    return loaded


def compiled_from(origin: bytes, make: Callable[[], tuple[str, int]]) -> Loaded:
    """Code of a module that need not be written if it has been before.

    Args:
        origin: a digest of all that the text depends on besides our sources and the processor.
        make: gives the text and the level.
    """
    shortcut = digest(origin, sources(), host().key())
    key = _disk().get(shortcut)
    known = None if key is None else _known(key)
    if known is not None:
        return known
    text, level = make()
    loaded = compiled(text, level)
    _disk().put(shortcut, _key(text, level))
    return loaded


def _key(text: str, level: int) -> bytes:
    return digest(host().key(), str(level), text)


def _known(key: bytes) -> Loaded | None:
    loaded = _in_memory.get(key)
    if loaded is None:
        code = _disk().get(key)
        if code is not None:
            loaded = _in_memory[key] = Loaded(code)
    return loaded


@cache
def sources() -> bytes:
    """A digest of the state of the files that turn expressions into text.

    A file whose content changes changes its status; looking at that is quicker than reading all.
    """
    states = []
    for folder, _, names in sorted(os.walk(Path(__file__).parents[1])):
        for name in sorted(names):
            if name.endswith((".py", ".ll")):
                status = os.stat(os.path.join(folder, name))
                states.append(f"{name} {status.st_size} {status.st_mtime_ns} {status.st_ctime_ns}")
    return digest(*states)


@cache
def _disk() -> Cache:
    return from_environment()
