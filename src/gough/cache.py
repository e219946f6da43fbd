"""Results on disk, machine code above all, so that they are made once for all processes.

A file holds a digest of its content, so that a broken or foreign file is seen and replaced; files
appear by an atomic rename, so that several processes may share the folder. Switches in the
environment: ``GOUGH_CACHE_DIR`` names the folder, ``GOUGH_CACHE=off`` leaves the disk alone, and
``GOUGH_CACHE_SIZE`` bounds the folder in MB (256).
"""

from __future__ import annotations

import hashlib
import os
import sys
import tempfile
from contextlib import suppress
from pathlib import Path

from gough.errors import ConfigurationError

MAGIC = b"gough cache 1\n"
DEFAULT_SIZE = 256.0
"""Largest size of the folder in MB."""
CHECKED_EVERY = 32
"""New files between two looks at the size of the folder."""


def digest(*parts: bytes | str) -> bytes:
    """SHA-256 of some parts, each with its length."""
    total = hashlib.sha256()
    for part in parts:
        data = part.encode() if isinstance(part, str) else part
        total.update(len(data).to_bytes(8, "little") + data)
    return total.digest()


class Cache:
    """A folder of contents under keys of 32 bytes; a failing disk only means work done anew."""

    def __init__(self, folder: Path | None, size: float = DEFAULT_SIZE) -> None:
        self.folder = folder
        self.size = size
        self._written = 0

    def path(self, key: bytes) -> Path | None:
        """Where the content of a key is kept, or None if nothing is kept."""
        return None if self.folder is None else self.folder / f"{key.hex()}.o"

    def get(self, key: bytes) -> bytes | None:
        """The content of a key, if it is there and whole."""
        path = self.path(key)
        if path is None:
            return None
        try:
            file = path.read_bytes()
        except OSError:
            return None
        head = len(MAGIC)
        seal, content = file[head : head + 32], file[head + 32 :]
        if file[:head] != MAGIC or digest(key, content) != seal:
            return None
        with suppress(OSError):
            os.utime(path)  # the files not used for longest go first when the folder is full
        return content

    def put(self, key: bytes, content: bytes) -> None:
        """Keep the content of a key."""
        path = self.path(key)
        if path is None:
            return
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            handle, name = tempfile.mkstemp(dir=path.parent, suffix=".part")
        except OSError:
            return
        try:
            with os.fdopen(handle, "wb") as file:
                file.write(MAGIC + digest(key, content) + content)
            os.replace(name, path)
        except OSError:
            with suppress(OSError):
                os.unlink(name)
            return
        if self._written % CHECKED_EVERY == 0:
            self._trim()
        self._written += 1

    def _trim(self) -> None:
        """Remove the files not used for longest until four fifths of the size are left."""
        assert self.folder is not None
        files = []
        with suppress(OSError):
            for entry in os.scandir(self.folder):
                if entry.name.endswith((".o", ".part")):
                    with suppress(OSError):
                        status = entry.stat()
                        files.append((status.st_mtime, status.st_size, entry.path))
        total, limit = sum(size for _, size, _ in files), self.size * 1e6
        if total <= limit:
            return
        for _, size, path in sorted(files):
            if total <= 0.8 * limit:
                return
            with suppress(OSError):
                os.unlink(path)
                total -= size


def from_environment() -> Cache:
    """The cache that the environment asks for.

    Raises:
        ConfigurationError: GOUGH_CACHE or GOUGH_CACHE_SIZE has a value without meaning.
    """
    switch = os.environ.get("GOUGH_CACHE", "on").lower()
    if switch not in ("on", "off", "1", "0", ""):
        raise ConfigurationError(f"GOUGH_CACHE is {switch!r}, expected on or off")
    if switch in ("off", "0"):
        return Cache(None)
    text = os.environ.get("GOUGH_CACHE_SIZE", "") or str(DEFAULT_SIZE)
    try:
        size = float(text)
    except ValueError:
        size = -1.0
    if not size >= 0:
        raise ConfigurationError(f"GOUGH_CACHE_SIZE is {text!r}, expected a size in MB, as 256")
    chosen = os.environ.get("GOUGH_CACHE_DIR")
    return Cache(Path(chosen).expanduser() if chosen else _platform_folder(), size)


def _platform_folder() -> Path | None:
    """The platform's folder for caches of this user, or None if there is no home."""
    try:
        home = Path.home()
    except RuntimeError:
        return None
    if sys.platform == "win32":
        local = os.environ.get("LOCALAPPDATA")
        return (Path(local) if local else home / "AppData" / "Local") / "gough" / "cache"
    if sys.platform == "darwin":
        return home / "Library" / "Caches" / "gough"
    chosen = os.environ.get("XDG_CACHE_HOME", "")
    return (Path(chosen) if os.path.isabs(chosen) else home / ".cache") / "gough"
