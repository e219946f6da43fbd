"""What a run computes: rows in chunks, columns with shapes and units, the numbers' origin."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

from gough.cache import digest
from gough.errors import ConfigurationError

ROW, CHUNK = "row", "chunk"
"""Names of dimensions: of the rows in every column, of the done marks."""
DONE = "done"
"""Name of the array of done marks."""
NAME = re.compile(r"[^\W\d]\w*(?:[.\-]\w+)*")
NUMBERS = ["b1", "i1", "i2", "i4", "i8", "u1", "u2", "u4", "u8", "f2", "f4", "f8", "c8", "c16"]


@dataclass(frozen=True)
class Column:
    """Values of one kind, the same number of them for each row."""

    shape: tuple[int, ...] = ()
    """Of the values of one row."""
    dtype: DTypeLike = "f8"
    unit: str = ""
    about: str = ""
    dims: tuple[str, ...] = ()
    """Names of the dimensions of `shape`; without them the name of the column with a number."""

    def __post_init__(self) -> None:
        shape = tuple(int(size) for size in self.shape)
        dtype = np.dtype(self.dtype).newbyteorder("=")
        if dtype.str[1:] not in NUMBERS:
            raise ConfigurationError(f"a column can not hold {dtype}, only {', '.join(NUMBERS)}")
        if any(size < 1 for size in shape):
            raise ConfigurationError(f"a column has the shape {shape}, expected sizes from 1 on")
        if self.dims and len(self.dims) != len(shape):
            raise ConfigurationError(f"dimensions {self.dims} do not fit the shape {shape}")
        object.__setattr__(self, "shape", shape)
        object.__setattr__(self, "dtype", dtype)
        object.__setattr__(self, "dims", tuple(self.dims))

    @property
    def type(self) -> np.dtype[Any]:
        """The dtype as numpy's object."""
        return np.dtype(self.dtype)

    @property
    def fill(self) -> Any:
        """What stands in rows not yet computed: NaN, or 0 where there is no NaN."""
        return self.type.type(math.nan if self.type.kind in "fc" else 0)


@dataclass(frozen=True, eq=False)
class Coordinate:
    """Values along dimensions of columns: times, names of legs, what was varied in each row."""

    values: ArrayLike
    dims: tuple[str, ...] = ()
    """Without them one dimension, named as the coordinate."""
    unit: str = ""
    about: str = ""

    def __post_init__(self) -> None:
        values = np.array(self.values)
        if values.dtype.kind != "U" and values.dtype.str[1:] not in NUMBERS:
            raise ConfigurationError(f"a coordinate can not hold {values.dtype}")
        values.flags.writeable = False
        object.__setattr__(self, "values", values)
        object.__setattr__(self, "dims", tuple(self.dims))

    @property
    def array(self) -> NDArray[Any]:
        """The values, read-only."""
        return np.asarray(self.values)


@dataclass(frozen=True, eq=False)
class Plan:
    """All rows of a run, computed in chunks of consecutive rows.

    Two plans with the same digest give the same numbers, so that a run may go on with a store
    made under the other.
    """

    rows: int
    chunk: int
    """Rows of a chunk; the last one may have fewer."""
    columns: Mapping[str, Column]
    coords: Mapping[str, Coordinate] = field(default_factory=dict)
    origin: Mapping[str, Any] = field(default_factory=dict)
    """All that decides the numbers, in JSON's types: the model, seeds, tolerances, versions."""

    def __post_init__(self) -> None:
        if self.rows < 1 or self.chunk < 1:
            raise ConfigurationError(
                f"a plan has {self.rows} rows in chunks of {self.chunk}, expected at least 1"
            )
        if not self.columns:
            raise ConfigurationError("a plan has no columns")
        origin = json.loads(json.dumps(_plain(self.origin, "origin")))
        for name, value in [
            ("rows", int(self.rows)),
            ("chunk", int(min(self.chunk, self.rows))),
            ("columns", MappingProxyType(dict(self.columns))),
            ("coords", MappingProxyType(dict(self.coords))),
            ("origin", MappingProxyType(origin)),
        ]:
            object.__setattr__(self, name, value)
        self._check_names()
        sizes = self.sizes
        for name, coordinate in self.coords.items():
            dims, shape = self.dims(name), coordinate.array.shape
            expected = tuple(sizes.get(dim, 0) for dim in dims)
            if shape != expected:
                raise ConfigurationError(
                    f"coordinate {name!r} has the shape {shape}, its dimensions {dims} have "
                    f"{expected} (0: no column has it)"
                )

    def _check_names(self) -> None:
        twice = set(self.columns) & set(self.coords)
        if twice:
            raise ConfigurationError(f"{min(twice)!r} is both a column and a coordinate")
        for name in [*self.columns, *self.coords]:
            if not NAME.fullmatch(name) or name == DONE:
                raise ConfigurationError(
                    f"{name!r} can not name a column or a coordinate: expected letters, digits and "
                    f"underscores, with single dots or dashes between them, and not {DONE!r}"
                )

    @cached_property
    def sizes(self) -> Mapping[str, int]:
        """Length of each dimension of the columns."""
        sizes = {ROW: self.rows}
        for name, column in self.columns.items():
            for dim, size in zip(self.dims(name)[1:], column.shape, strict=True):
                if dim in (ROW, CHUNK):
                    raise ConfigurationError(f"column {name!r} can not have a dimension {dim!r}")
                if sizes.setdefault(dim, size) != size:
                    raise ConfigurationError(
                        f"dimension {dim!r} of column {name!r} has {size} entries, elsewhere "
                        f"{sizes[dim]}"
                    )
        return sizes

    def dims(self, name: str) -> tuple[str, ...]:
        """Names of the dimensions of a column, rows first, or of a coordinate."""
        if name in self.coords:
            return self.coords[name].dims or (name,)
        column = self.columns[name]
        own = column.dims or tuple(f"{name}_{k}" for k in range(len(column.shape)))
        return (ROW, *own)

    @property
    def chunks(self) -> int:
        """Number of chunks."""
        return -(-self.rows // self.chunk)

    def bounds(self, chunk: int) -> tuple[int, int]:
        """First row of a chunk and the one behind its last."""
        if not 0 <= chunk < self.chunks:
            raise ConfigurationError(f"there is no chunk {chunk}; there are {self.chunks}")
        return chunk * self.chunk, min(self.rows, (chunk + 1) * self.chunk)

    @property
    def row_bytes(self) -> int:
        """Size of one row in memory."""
        return sum(c.type.itemsize * math.prod(c.shape) for c in self.columns.values())

    @cached_property
    def identity(self) -> dict[str, Any]:
        """All that decides the numbers, in JSON's types; texts about columns do not."""
        columns = {
            name: [c.type.str[1:], list(c.shape), list(self.dims(name)), c.unit]
            for name, c in self.columns.items()
        }
        coords = {
            name: [c.array.dtype.str[1:], list(self.dims(name)), c.unit, _fingerprint(c.array)]
            for name, c in self.coords.items()
        }
        return {
            "rows": self.rows,
            "chunk": self.chunk,
            "columns": columns,
            "coords": coords,
            "origin": dict(self.origin),
        }

    @cached_property
    def digest(self) -> str:
        """Of `identity`; 64 hexadecimal digits."""
        return digest(json.dumps(self.identity, sort_keys=True, separators=(",", ":"))).hex()


def differences(there: Any, here: Any, path: str = "") -> Iterator[str]:
    """The entries in which two values of JSON's types differ, one line each."""
    if isinstance(there, dict) and isinstance(here, dict):
        for key in sorted(there.keys() | here.keys()):
            inner = f"{path}.{key}" if path else key
            if key not in here:
                yield f"{inner}: {_short(there[key])} there, nothing here"
            elif key not in there:
                yield f"{inner}: nothing there, {_short(here[key])} here"
            else:
                yield from differences(there[key], here[key], inner)
    elif isinstance(there, list) and isinstance(here, list) and len(there) == len(here):
        for k, pair in enumerate(zip(there, here, strict=True)):
            yield from differences(*pair, f"{path}[{k}]")
    elif type(there) is not type(here) or there != here:
        yield f"{path}: {_short(there)} there, {_short(here)} here"


def _short(value: Any) -> str:
    text = json.dumps(value, ensure_ascii=False)
    return text if len(text) <= 60 else f"{text[:57]}…"


def _fingerprint(array: NDArray[Any]) -> str:
    plain = array.astype(array.dtype.newbyteorder("<"))
    return digest(plain.tobytes()).hex()[:16]


def _plain(value: Any, path: str) -> Any:
    """The value in JSON's types alone.

    Raises:
        ConfigurationError: it, or a value inside it, is not of these types.
    """
    if isinstance(value, Mapping):
        for key in value:
            if not isinstance(key, str):
                raise ConfigurationError(f"{path} has the key {key!r}, expected a text")
        return {key: _plain(item, f"{path}.{key}") for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item, f"{path}[{k}]") for k, item in enumerate(value)]
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, float) and not math.isfinite(value):
        raise ConfigurationError(f"{path} is {value}, which JSON does not know; give it as a text")
    if value is None or isinstance(value, str | bool | int | float):
        return value
    raise ConfigurationError(
        f"{path} is a {type(value).__name__}, expected a value of JSON's types"
    )
