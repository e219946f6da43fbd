"""What can go wrong with a long run: with its store, its task or its cluster."""

from __future__ import annotations

from collections.abc import Sequence

from gough.errors import GoughError


class StoreError(GoughError, OSError):
    """A store can not be made, opened, read or written."""


class OtherRun(StoreError):
    """The folder holds the store of a run that gives other numbers."""

    def __init__(self, message: str, differences: Sequence[str]) -> None:
        self.differences = tuple(differences)
        super().__init__(message)


class StoreBusy(StoreError):
    """Another process, or another object of this one, writes the store."""


class StoreDamaged(StoreError):
    """Files of a store are missing or can not be read."""

    def __init__(self, message: str, chunks: Sequence[int] = ()) -> None:
        self.chunks = tuple(chunks)
        super().__init__(message)


class DiskFull(StoreError):
    """There is no room left for a chunk; those before it are kept."""


class TaskFailed(GoughError, RuntimeError):
    """The task raised an error for a chunk; the error is the cause of this one."""

    def __init__(self, chunk: int, rows: tuple[int, int], error: BaseException, kept: str) -> None:
        self.chunk, self.rows = chunk, rows
        start, stop = rows
        super().__init__(
            f"chunk {chunk} (rows {start} to {stop - 1}) failed: "
            f"{type(error).__name__}: {error}\n{kept}"
        )


class ClusterError(GoughError, RuntimeError):
    """A cluster does not answer, has no workers, or loses them again and again."""


class Interrupted(KeyboardInterrupt):
    """A run was stopped by the user; what was computed is kept, the text says how to go on."""
