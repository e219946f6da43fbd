"""Where results are kept: what the store on disk and the one in memory have in common."""

from __future__ import annotations

import threading
from abc import ABC, abstractmethod
from collections.abc import Mapping
from types import TracebackType
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import NDArray

from gough.ensembles.errors import StoreError
from gough.ensembles.plan import Plan
from gough.errors import ConfigurationError

if TYPE_CHECKING:
    import xarray

Arrays = Mapping[str, NDArray[Any]]


class Results(ABC):
    """Chunks of a plan, each absent or complete. Threads may write different chunks at once."""

    def __init__(self, plan: Plan) -> None:
        self.plan = plan
        self._marks: NDArray[np.bool_] = np.zeros(plan.chunks, dtype=bool)
        self._writing: set[int] = set()
        self._guard = threading.Lock()
        self._open = True

    def pending(self) -> list[int]:
        """Chunks not yet there, in order."""
        return [int(k) for k in np.flatnonzero(~self._marks)]

    @property
    def chunks_done(self) -> int:
        """Chunks that are there."""
        return int(self._marks.sum())

    @property
    def rows_done(self) -> int:
        """Rows of the chunks that are there."""
        last = self.plan.chunks - 1
        start, stop = self.plan.bounds(last)
        missing = self.plan.chunk - (stop - start) if self._marks[last] else 0
        return self.chunks_done * self.plan.chunk - missing

    def write(self, chunk: int, arrays: Arrays) -> None:
        """Keep a chunk.

        Args:
            chunk: one that is pending.
            arrays: all columns, each (rows of the chunk, *shape).

        Raises:
            ConfigurationError: a column is missing, unknown or has another shape or type.
            StoreError: the chunk can not be written, or is there already.
        """
        checked = self._checked(chunk, arrays)
        with self._guard:
            if not self._open:
                raise StoreError(f"chunk {chunk} is not kept: the store is closed")
            if self._marks[chunk] or chunk in self._writing:
                raise StoreError(f"chunk {chunk} is written already")
            self._writing.add(chunk)
        try:
            self._put(chunk, checked)
            self._marks[chunk] = True
        finally:
            with self._guard:
                self._writing.discard(chunk)

    def read(self, chunk: int) -> dict[str, NDArray[Any]]:
        """All columns of a chunk that is there.

        Raises:
            StoreError: the chunk is pending or damaged.
        """
        self.plan.bounds(chunk)
        if not self._marks[chunk]:
            raise StoreError(f"chunk {chunk} is not computed yet")
        return self._get(chunk)

    @abstractmethod
    def dataset(self) -> xarray.Dataset:
        """All columns and coordinates; rows not computed are NaN, or 0 where there is no NaN.

        The attribute `rows_done` tells how many rows there are.
        """

    @property
    @abstractmethod
    def kept(self) -> str:
        """A sentence that says how much is kept where, and how to go on."""

    def close(self) -> None:
        """End writing."""
        with self._guard:
            self._open = False

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    @abstractmethod
    def _put(self, chunk: int, arrays: Arrays) -> None: ...

    @abstractmethod
    def _get(self, chunk: int) -> dict[str, NDArray[Any]]: ...

    def _checked(self, chunk: int, arrays: Arrays) -> dict[str, NDArray[Any]]:
        start, stop = self.plan.bounds(chunk)
        columns = self.plan.columns
        if arrays.keys() != columns.keys():
            missing = sorted(columns.keys() - arrays.keys())
            unknown = sorted(arrays.keys() - columns.keys())
            raise ConfigurationError(
                f"chunk {chunk} has not the columns of the plan: missing {missing}, "
                f"unknown {unknown}"
            )
        checked = {}
        for name, column in columns.items():
            values, shape = np.asarray(arrays[name]), (stop - start, *column.shape)
            if values.shape != shape:
                raise ConfigurationError(
                    f"column {name!r} of chunk {chunk} has the shape {values.shape}, expected "
                    f"{shape}"
                )
            # a column may be kept in fewer digits, but integers must not overflow
            rule: Any = "same_kind" if column.type.kind in "fc" else "safe"
            if not np.can_cast(values.dtype, column.type, rule):
                raise ConfigurationError(
                    f"column {name!r} of chunk {chunk} is {values.dtype}, expected {column.type}"
                )
            checked[name] = values.astype(column.type, copy=False)
        return checked
