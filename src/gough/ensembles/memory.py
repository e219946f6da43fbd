"""Results in memory, for runs that need no store on disk."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from gough.ensembles.plan import Plan
from gough.ensembles.results import Arrays, Results
from gough.errors import ConfigurationError

if TYPE_CHECKING:
    import xarray


class Memory(Results):
    """Arrays of all rows, made at once.

    Raises:
        ConfigurationError: they do not fit in memory.
    """

    def __init__(self, plan: Plan) -> None:
        super().__init__(plan)
        try:
            self._arrays: dict[str, NDArray[Any]] = {
                name: np.full((plan.rows, *column.shape), column.fill, column.type)
                for name, column in plan.columns.items()
            }
        except MemoryError:
            size = plan.rows * plan.row_bytes / 1e9
            raise ConfigurationError(
                f"{plan.rows} rows take {size:.1f} GB, more than the memory holds; "
                "name a folder for a store"
            ) from None

    @property
    def kept(self) -> str:
        """A sentence that says how much is kept where, and how to go on."""
        return (
            f"{self.chunks_done} of {self.plan.chunks} chunks are in memory only; "
            "with a folder for a store a run can go on later"
        )

    def dataset(self) -> xarray.Dataset:
        """All columns and coordinates, without copies."""
        import xarray

        plan = self.plan
        data = {
            name: (plan.dims(name), self._arrays[name], attributes(column.unit, column.about))
            for name, column in plan.columns.items()
        }
        return xarray.Dataset(
            data, coordinates(plan), {"rows_done": self.rows_done, "digest": plan.digest}
        )

    def _put(self, chunk: int, arrays: Arrays) -> None:
        start, stop = self.plan.bounds(chunk)
        for name, values in arrays.items():
            self._arrays[name][start:stop] = values

    def _get(self, chunk: int) -> dict[str, NDArray[Any]]:
        start, stop = self.plan.bounds(chunk)
        return {name: values[start:stop].copy() for name, values in self._arrays.items()}


def coordinates(plan: Plan) -> dict[str, Any]:
    """The coordinates of a plan as xarray takes them."""
    return {
        name: (plan.dims(name), c.array, attributes(c.unit, c.about))
        for name, c in plan.coords.items()
    }


def attributes(unit: str, about: str) -> dict[str, str]:
    """Unit and meaning as xarray's users expect them."""
    named = {"units": unit, "long_name": about}
    return {key: text for key, text in named.items() if text}
