"""A lock file: one writer at a time, and none that a dead process holds."""

from __future__ import annotations

import errno
import os
import socket
import sys
import weakref
from contextlib import suppress
from pathlib import Path

from gough.ensembles.errors import StoreBusy

BEHIND = 1 << 30
"""Windows locks bytes; this one lies behind the text, so that others can read that."""


class Lock:
    """Held from construction to `release`.

    The system's lock on the open file is what counts; it ends with the process, however that
    ends. The text in the file, process and machine, is for messages. On file systems without
    locks the text counts: a process of this machine that is gone holds nothing.

    Raises:
        StoreBusy: someone else holds it.
        OSError: the file can not be opened for writing.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._descriptor = os.open(path, os.O_RDWR | os.O_CREAT, 0o666)
        # a lock that nobody holds a reference to any more is given back
        self._closing = weakref.finalize(self, os.close, self._descriptor)
        try:
            supported = _system_lock(self._descriptor)
        except BlockingIOError:
            supported, busy = True, True
        else:
            busy = not supported and _alive(self._holder())
        if busy:
            holder = self._holder()
            self._closing()
            raise StoreBusy(_message(path, holder))
        os.ftruncate(self._descriptor, 0)
        os.lseek(self._descriptor, 0, os.SEEK_SET)
        os.write(self._descriptor, f"{os.getpid()} {socket.gethostname()}\n".encode())

    def release(self) -> None:
        """Give the lock back; the empty file stays."""
        if self._closing.alive:
            with suppress(OSError):
                os.ftruncate(self._descriptor, 0)
            self._closing()

    def _holder(self) -> tuple[int, str] | None:
        """Process and machine in the file, if it names them."""
        os.lseek(self._descriptor, 0, os.SEEK_SET)
        words = os.read(self._descriptor, 400).decode("utf-8", "replace").split()
        return (int(words[0]), words[1]) if len(words) == 2 and words[0].isdecimal() else None


def _message(path: Path, holder: tuple[int, str] | None) -> str:
    folder = path.parent.parent
    if holder == (os.getpid(), socket.gethostname()):
        return f"{folder} is open in this process already; close that store first"
    who = f"process {holder[0]} on {holder[1]}" if holder else "another process"
    return (
        f"{folder} is being written by {who}; wait until it ends or name another folder "
        f"(if that process is gone, delete {path})"
    )


def _system_lock(descriptor: int) -> bool:
    """Lock the open file; False if the file system knows no locks.

    Raises:
        BlockingIOError: someone else holds it.
    """
    try:
        if sys.platform == "win32":
            import msvcrt

            os.lseek(descriptor, BEHIND, os.SEEK_SET)
            msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)
        else:
            import fcntl

            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        if error.errno in (errno.EACCES, errno.EAGAIN, errno.EDEADLK):
            raise BlockingIOError(error.errno, "locked") from None
        return False
    return True


def _alive(holder: tuple[int, str] | None) -> bool:
    """Whether a process may still run: those of other machines may."""
    if holder is None:
        return False
    process, machine = holder
    if machine != socket.gethostname():
        return True
    if sys.platform == "win32":
        return True  # there a signal to look would end the process
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        return True
    return True
