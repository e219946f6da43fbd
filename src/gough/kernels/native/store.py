"""Machine code of a text: from this process, from the disk, or made anew."""

from __future__ import annotations

from functools import cache
from weakref import WeakValueDictionary

from gough.kernels.native.cache import Cache, from_environment
from gough.kernels.native.machine import Loaded, host

_in_memory: WeakValueDictionary[str, Loaded] = WeakValueDictionary()


def compiled(text: str, level: int) -> Loaded:
    """Code of an LLVM module, generated at a level and loaded."""
    key = f"{host().key()}\nlevel {level}\n{text}"
    loaded = _in_memory.get(key)
    if loaded is None:
        disk = _disk()
        code = disk.get(key)
        if code is None:
            code = host().object_code(text, level)
            disk.put(key, code)
        loaded = _in_memory[key] = Loaded(code)
    return loaded


@cache
def _disk() -> Cache:
    return from_environment()
