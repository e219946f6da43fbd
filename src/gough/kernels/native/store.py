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

from gough.cache import Cache, digest, from_environment
from gough.kernels.native import routines
from gough.kernels.native.lanes import routine_name
from gough.kernels.native.machine import Loaded, host

ROUTINES_LEVEL = 0
"""The routines run rarely."""
_in_memory: WeakValueDictionary[bytes, Loaded] = WeakValueDictionary()


def compiled(text: str, level: int) -> Loaded:
    """Code of an LLVM module, generated at a level and loaded."""
    key = _key(text, level)
    loaded = _in_memory.get(key)
    if loaded is None:
        loaded = _in_memory[key] = load(_object_code(text, level))
    return loaded


def load(code: bytes) -> Loaded:
    """Machine code in memory, with the routines that it calls."""
    for width in routines.wanted(code):
        _routines(width)
    return Loaded(code)


@cache
def _routines(width: int) -> Loaded:
    """The routines for a number of lanes, published and held for ever."""
    code = _object_code(routines.text(width), ROUTINES_LEVEL)
    loaded = Loaded(code)
    symbols = [routine_name(name, width) for name in ("sin", "cos")]
    routines.publish(width, {symbol: loaded.address(symbol) for symbol in symbols})
    return loaded


def compiled_from(origin: bytes, make: Callable[[], tuple[str, int]]) -> Loaded:
    """Code of a module that need not be written if it has been before.

    Args:
        origin: a digest of all that the text depends on besides our sources and the processor.
        make: gives the text and the level.
    """
    shortcut = digest(origin, SOURCES, host().key())
    key = _disk().get(shortcut)
    known = None if key is None else _known(key)
    if known is not None:
        return known
    text, level = make()
    loaded = compiled(text, level)
    _disk().put(shortcut, _key(text, level))
    return loaded


def _object_code(text: str, level: int) -> bytes:
    """Code from the disk, or made and put there."""
    key = _key(text, level)
    code = _disk().get(key)
    if code is None:
        code = host().object_code(text, level)
        _disk().put(key, code)
    return code


def _key(text: str, level: int) -> bytes:
    return digest(host().key(), str(level), text)


def _known(key: bytes) -> Loaded | None:
    loaded = _in_memory.get(key)
    if loaded is None:
        code = _disk().get(key)
        if code is not None:
            loaded = _in_memory[key] = load(code)
    return loaded


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


SOURCES = sources()
"""The state at import: code that is made later is made by what was imported."""
