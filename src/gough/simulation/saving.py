"""Datasets in files: NetCDF, Zarr or CSV; a file is replaced once the new one is whole."""

from __future__ import annotations

import importlib.util
import itertools
import json
import os
import re
import shutil
import uuid
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from gough.errors import ConfigurationError, MissingExtra, closest
from gough.formats.trajectory import write_table

if TYPE_CHECKING:
    import xarray

SUFFIXES = (".nc", ".zarr", ".csv")
TURNS, QUATERNION = ("rx", "ry", "rz"), ("qw", "qx", "qy", "qz")
PACKAGES = {".nc": ("h5netcdf", "h5py"), ".zarr": ("zarr",)}
EXTRAS = {".nc": "netcdf", ".zarr": "store"}
MOST_COLUMNS = 10_000
"""Columns of a CSV file; a guess at what other programs still open."""
STORE = "gough"
"""Attribute of a zarr group that says that it is the store of an ensemble."""


def save(dataset: xarray.Dataset, path: str | Path) -> Path:
    """Write a dataset of `Robot.simulate` to a file.

    Args:
        dataset: of one run, or of an ensemble.
        path: its suffix says the format: ``.nc`` is NetCDF-4, ``.zarr`` a folder in Zarr 3;
            both hold everything. ``.csv`` is a table of what goes over time, or
            over the rows of an ensemble.

    Returns:
        The path.

    Raises:
        ConfigurationError: the suffix is another one, or the file can not be written.
        MissingExtra: zarr, or h5netcdf with h5py, is not installed.
    """
    path = writable(path)
    writers = {".nc": _write_netcdf, ".zarr": _write_zarr, ".csv": _write_csv}
    with _whole(path) as beside:
        writers[path.suffix.lower()](dataset, beside, path)
    return path


def writable(path: str | Path) -> Path:
    """A path that a dataset can be saved to, as far as can be told before it is there.

    Raises:
        ConfigurationError: the suffix is unknown, or something else is in the way.
        MissingExtra: zarr, or h5netcdf with h5py, is not installed.
    """
    path = Path(path).expanduser()
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        told = f"the suffix {path.suffix!r}" if path.suffix else "no suffix"
        raise ConfigurationError(
            f"{path} has {told}; results are saved as .nc (NetCDF), .zarr or .csv."
            + (closest(suffix, SUFFIXES).partition(" Known")[0] if path.suffix else "")
        )
    for package in PACKAGES.get(suffix, ()):
        if importlib.util.find_spec(package) is None:
            raise MissingExtra(str(path), package, EXTRAS[suffix])
    if suffix == ".zarr":
        _require_replaceable(path)
    elif path.is_dir():
        raise ConfigurationError(f"{path} is a folder; name a file")
    above = next(folder for folder in (path.absolute().parents) if folder.exists())
    if not above.is_dir():
        raise ConfigurationError(f"{path} can not be written: {above} is no folder")
    if not os.access(above, os.W_OK | os.X_OK):
        raise ConfigurationError(f"{path} can not be written: no right to write to {above}")
    return path


def _require_replaceable(path: Path) -> None:
    """Raise if a path holds something other than a dataset in Zarr."""
    if not path.exists():
        return
    if not path.is_dir():
        raise ConfigurationError(f"{path} is a file, and Zarr makes a folder; name another path")
    head = path / "zarr.json"
    if any(path.iterdir()) and not head.is_file():
        raise ConfigurationError(f"{path} holds other files; name another path")
    try:
        attributes = json.loads(head.read_text("utf-8"))["attributes"] if head.is_file() else {}
    except (OSError, ValueError, LookupError, TypeError):
        attributes = {}
    if STORE in attributes:
        raise ConfigurationError(
            f"{path} is the store of an ensemble, which holds its results already; name another "
            "path"
        )


@contextmanager
def _whole(path: Path) -> Iterator[Path]:
    """A path beside another one; what is written there takes its place at the end."""
    beside = path.with_name(f".{path.stem}-{uuid.uuid4().hex[:8]}{path.suffix}")
    old = beside.with_name(beside.name + ".old")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        yield beside
        if path.is_dir():  # folders are not replaced in one go
            path.rename(old)
        beside.replace(path)
    except OSError as error:
        if old.exists() and not path.exists():
            old.rename(path)
        raise ConfigurationError(f"{path} can not be written: {error.strerror or error}") from None
    finally:
        for rest in (beside, old):
            if rest.is_dir():
                shutil.rmtree(rest, ignore_errors=True)
            else:
                rest.unlink(missing_ok=True)


# whole datasets


def _write_netcdf(dataset: xarray.Dataset, beside: Path, path: Path) -> None:
    """NetCDF-4: NetCDF-3 has one dimension at most that may be empty, and runs have several."""
    plain = _with_texts(dataset, "U", {})
    flags = {k: int(v) for k, v in dataset.attrs.items() if isinstance(v, bool | np.bool_)}
    floats = [str(n) for n, v in plain.variables.items() if v.dtype.kind == "f"]
    plain.assign_attrs(flags).to_netcdf(
        beside,
        engine="h5netcdf",
        encoding={name: {"_FillValue": None} for name in floats},
    )


def _write_zarr(dataset: xarray.Dataset, beside: Path, path: Path) -> None:
    """Zarr 3, with the metadata in one place, so that plain `xarray.open_zarr` finds it."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="Consolidated metadata is currently not part")
        plain = _with_texts(dataset, "O", {"dtype": str})  # texts of a width are no part of Zarr 3
        plain.to_zarr(beside, mode="w", zarr_format=3, consolidated=True)


def _with_texts(dataset: xarray.Dataset, kind: str, encoding: dict[str, Any]) -> xarray.Dataset:
    """The dataset with texts of one kind of dtype, and no memory of files it came from."""
    found = dataset.drop_encoding()
    for name, variable in dataset.variables.items():
        if variable.dtype.kind in "UTO":
            values = variable.values.astype("O").astype("U").astype(kind)
            changed = {name: (variable.dims, values, variable.attrs, encoding)}
            coordinate = name in dataset.coords
            found = found.assign_coords(changed) if coordinate else found.assign(changed)
    return found


# tables


def _write_csv(dataset: xarray.Dataset, beside: Path, path: Path) -> None:
    """A row for each time, or each row of an ensemble."""
    titles, columns = table_of(dataset)
    if len(titles) > MOST_COLUMNS:
        raise ConfigurationError(
            f"{path} would have {len(titles)} columns; save it as .nc or .zarr, or keep fewer times"
        )
    rows = zip(*(column.tolist() for column in columns), strict=True)
    try:
        write_table(beside, titles, rows)
    except ConfigurationError as error:  # it knows the path beside only
        raise ConfigurationError(str(error).replace(str(beside), str(path), 1)) from None


def table_of(dataset: xarray.Dataset) -> tuple[list[str], list[NDArray[Any]]]:
    """Titles and columns of all that goes over time, or over the rows of an ensemble.

    A title has its unit in brackets; without brackets it is SI and rad, or there is none.
    """
    over = "row" if "row" in dataset.dims else "time"
    first = dataset["time"].values if over == "time" else np.arange(dataset.sizes["row"])
    titles = ["time [s]" if over == "time" else "row"]
    columns: list[NDArray[Any]] = [first]
    for name, variable in dataset.data_vars.items():
        if over not in variable.dims:
            continue
        values = variable.transpose(over, ...)
        others = [str(dim) for dim in values.dims[1:]]
        labels = [
            dataset[d].values if d in dataset else np.arange(dataset.sizes[d]) for d in others
        ]
        numbers = values.values.reshape(dataset.sizes[over], -1)
        for k, parts in enumerate(itertools.product(*labels)):
            named = dict(zip(others, parts, strict=True))
            titles.append(_title(str(name), named, str(variable.attrs.get("units", ""))))
            columns.append(numbers[:, k])
    if "ending" in dataset and over == "row":
        at = titles.index("ending")
        columns[at] = np.array([endings(dataset)[k] for k in columns[at].tolist()], dtype=object)
    return titles, columns


def _title(name: str, parts: dict[str, Any], units: str) -> str:
    """Title of one column: pose x [m]."""
    words = [name]
    for dim, part in parts.items():
        if dim != "time":
            words.append(str(part))
            units = unit_of(units, words[-1])
    if "time" in parts:
        words.append(f"at {parts['time']:.9g} s")
    return " ".join(words) + (f" [{units}]" if units and "," not in units else "")


def unit_of(units: str, part: str) -> str:
    """The unit of one part of a variable; none where several are possible.

    Args:
        units: of the variable, such as "m, rad".
        part: name of the part, such as platform.x.
    """
    given = [unit.strip() for unit in units.split(",") if unit.strip()]
    if len(given) < 2:
        return "".join(given)
    last, ending = part.rpartition(".")[2], re.sub(r"^(m|rad|1)", "", given[0])
    known = {"x": "m", "y": "m", "z": "m"} | dict.fromkeys(TURNS, "rad")
    known |= dict.fromkeys(QUATERNION, "1")
    unit = known[last] + ending if last in known else ""
    return unit if unit in given else ""


def endings(dataset: xarray.Dataset) -> dict[int, str]:
    """Names of the endings of an ensemble's rows by their number."""
    told = str(dataset["ending"].attrs.get("long_name", ""))
    pairs = (part.split() for part in told.split(";") if part.strip())
    return {int(number): word for number, word in pairs}
