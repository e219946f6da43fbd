"""Results in a folder, in the format zarr 3, so that a run can be killed at any time and go on.

One group, one array for each column and coordinate, and an array of marks, one file each. A chunk
counts when its mark is there, and that is written last. Files appear by an atomic rename and carry
checksums. A folder is made beside its place and renamed, so no half-made store is ever met.
Against a power cut there are only the checksums.
"""

from __future__ import annotations

import errno
import json
import os
import re
import shutil
import uuid
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from gough.ensembles.errors import (
    DiskFull,
    OtherRun,
    StoreDamaged,
    StoreError,
)
from gough.ensembles.locks import Lock
from gough.ensembles.memory import attributes, coordinates
from gough.ensembles.plan import CHUNK, DONE, ROW, Plan, differences
from gough.ensembles.results import Arrays, Results
from gough.errors import ConfigurationError, MissingExtra

if TYPE_CHECKING:
    import xarray

KEY = "gough"
"""Attribute of the group that holds format, digest and identity of the plan."""
FORMAT = 1
OLDEST = (3, 1, 3)
"""Version of zarr from which on its files appear by an atomic rename."""
SHOWN = 8
"""Differences, files or chunks that a message names."""
FULL = (errno.ENOSPC, getattr(errno, "EDQUOT", errno.ENOSPC))

Resume = Literal["auto", "never", "must", "repair"]


class Store(Results):
    """Chunks in a folder; made by `open`, read by xarray and anything else that knows zarr 3.

    `xarray.open_zarr(folder, consolidated=False)` reads it, also while it is being written.
    """

    def __init__(
        self, folder: Path, plan: Plan, arrays: Mapping[str, Any], lock: Lock | None
    ) -> None:
        super().__init__(plan)
        self.folder = folder
        self._arrays, self._lock = arrays, lock

    @classmethod
    def open(cls, folder: str | os.PathLike[str], plan: Plan, resume: Resume = "auto") -> Store:
        """The store of a plan in a folder.

        A store with chunks pending is locked against other writers until it is closed.

        Args:
            folder: absent, empty, or holding a store of this plan; the one above it must exist.
            plan: what is computed.
            resume: "auto" goes on with a store that is there; "never" wants to make one, "must" to
                find one; "repair" goes on, and chunks that can not be read are computed again.

        Raises:
            StoreError: the folder can not be used: another run's, other files, no right to write.
            MissingExtra: zarr is not installed.
        """
        if resume not in ("auto", "never", "must", "repair"):
            raise ConfigurationError(
                f"resume is {resume!r}, expected 'auto', 'never', 'must' or 'repair'"
            )
        zarr = _zarr()
        path = Path(folder).expanduser().resolve()
        with _told(f"can not use {path} for a store"):
            if _is_free(path):
                if resume == "must":
                    raise StoreError(f"there is no store in {path}; resume='auto' makes one")
                made = _make(zarr, path, plan)
                if made:
                    return made
            elif resume == "never":
                raise StoreError(f"{path} holds files already; name another folder")
            return cls._found(zarr, path, plan, resume == "repair")

    @classmethod
    def _found(cls, zarr: ModuleType, path: Path, plan: Plan, repair: bool) -> Store:
        _check_run(path, plan)
        try:
            arrays = _arrays(zarr, path, plan)
        except (LookupError, ValueError, TypeError, FileNotFoundError) as error:
            raise _damaged(path, f"its metadata can not be read ({error})") from error
        store = cls(path, plan, arrays, None)
        if not repair:
            store._look()
            if not store.pending():
                return store  # nothing to write, so a read-only folder will do
        store._lock = Lock(path / DONE / "lock")
        try:
            store._sweep()
            if repair:
                store._repair()
            store._look()  # again: another process may have gone on until now
        except BaseException:
            store.close()
            raise
        return store

    @property
    def kept(self) -> str:
        """A sentence that says how much is kept where, and how to go on."""
        text = f"{self.chunks_done} of {self.plan.chunks} chunks are kept in {self.folder}"
        return f"{text}; run the same again to go on" if self.pending() else text

    def dataset(self) -> xarray.Dataset:
        """All columns and coordinates; values are read from disk when they are used."""
        import xarray

        with _told(f"can not read the store in {self.folder}"):
            data: xarray.Dataset = xarray.open_zarr(
                self.folder,
                consolidated=False,
                chunks=None,
                mask_and_scale=False,
                decode_times=False,
            )
        data.attrs = {"rows_done": self.rows_done, "digest": self.plan.digest}
        return data[list(self.plan.columns)].assign_coords(coordinates(self.plan))

    def close(self) -> None:
        """End writing, so that others may."""
        super().close()
        if self._lock is not None:
            self._lock.release()

    def _put(self, chunk: int, arrays: Arrays) -> None:
        if not (self.folder / "zarr.json").exists():
            raise StoreError(f"the store in {self.folder} was removed while it was written")
        start, stop = self.plan.bounds(chunk)
        try:
            for name, values in arrays.items():
                self._arrays[name][start:stop] = values
            self._arrays[DONE][chunk] = 1
        except OSError as error:
            if error.errno in FULL:
                raise DiskFull(
                    f"the disk is full: chunk {chunk} does not fit in {self.folder}, the "
                    f"{len(self.pending())} chunks to come take up to "
                    f"{self._to_come() / 1e6:.1f} MB; make room, then go on. {self.kept}"
                ) from error
            reason = error.strerror or str(error)
            raise StoreError(
                f"chunk {chunk} can not be written to {self.folder}: {reason}. {self.kept}"
            ) from error

    def _get(self, chunk: int) -> dict[str, NDArray[Any]]:
        start, stop = self.plan.bounds(chunk)
        if lost := self._lost(chunk):
            raise _damaged(self.folder, f"{lost[0]} is missing", [chunk])
        arrays = {}
        for name in self.plan.columns:
            try:
                arrays[name] = np.asarray(self._arrays[name][start:stop])
            except Exception as error:  # codecs raise what they like
                reason = f"column {name!r} of chunk {chunk} can not be read ({error})"
                raise _damaged(self.folder, reason, [chunk]) from error
        return arrays

    def _to_come(self) -> int:
        return (self.plan.rows - self.rows_done) * self.plan.row_bytes

    def _look(self) -> None:
        """Take over the marks.

        Raises:
            StoreDamaged: a mark can not be read, or a marked chunk lacks a file.
        """
        marks, broken = self._read_marks()
        if broken:
            raise _damaged(self.folder, f"marks of chunks {_some(broken)} can not be read", broken)
        hollow = [int(k) for k in np.flatnonzero(marks) if self._lost(int(k))]
        if hollow:
            raise _damaged(self.folder, f"chunks {_some(hollow)} lack files", hollow)
        self._marks[:] = marks

    def _read_marks(self) -> tuple[NDArray[np.bool_], list[int]]:
        """The marks, and the chunks whose marks can not be read."""
        done, broken = self._arrays[DONE], []
        try:
            marks = np.asarray(done[:])
        except Exception:  # one of them, as it seems
            marks = np.zeros(self.plan.chunks, np.uint8)
            for k in range(self.plan.chunks):
                try:
                    marks[k] = np.asarray(done[k])
                except Exception:
                    broken.append(k)
        broken += [int(k) for k in np.flatnonzero(marks > 1)]
        return marks == 1, sorted(broken)

    def _repair(self) -> None:
        """Take the marks from chunks that can not be read, reading all of them."""
        marks, broken = self._read_marks()
        self._marks[:] = marks
        for k in map(int, np.flatnonzero(marks)):
            try:
                self._get(k)
            except StoreDamaged:
                broken.append(k)
        for k in broken:
            self._marks[k] = False
            # the mark goes first: a chunk is whole or does not count, here too
            self._file(DONE, k).unlink(missing_ok=True)
            for name in self.plan.columns:
                self._file(name, k).unlink(missing_ok=True)

    def _sweep(self) -> None:
        """Remove drafts of files that a killed process left."""
        for name in [*self.plan.columns, DONE]:
            for draft in (self.folder / name).rglob("*.partial"):
                draft.unlink(missing_ok=True)

    def _file(self, name: str, chunk: int) -> Path:
        """The file of a chunk of a column."""
        inner = ["0"] * len(self.plan.columns[name].shape) if name in self.plan.columns else []
        return self.folder.joinpath(name, "c", str(chunk), *inner)

    def _lost(self, chunk: int) -> list[Path]:
        """Files that a chunk should have and has not."""
        files = [self._file(name, chunk) for name in self.plan.columns]
        return [file for file in files if not file.is_file()]


def _zarr() -> ModuleType:
    try:
        import zarr
    except ImportError as error:
        raise MissingExtra("a store on disk", "zarr 3", "store") from error
    if tuple(int(part) for part in re.findall(r"\d+", zarr.__version__)[:3]) < OLDEST:
        wanted = ".".join(map(str, OLDEST))
        raise MissingExtra("a store on disk", f"zarr {wanted}, not {zarr.__version__}", "store")
    return zarr


@contextmanager
def _told(what: str) -> Iterator[None]:
    """Errors of the system as errors of ours."""
    try:
        yield
    except StoreError:
        raise
    except OSError as error:
        reason = error.strerror or str(error)
        full = error.errno in FULL
        way = "make room or name another folder" if full else "name another folder"
        raise (DiskFull if full else StoreError)(f"{what}: {reason}; {way}") from error


def _is_free(path: Path) -> bool:
    """Whether there is nothing at a path, or an empty folder.

    Raises:
        StoreError: there is a file, or the folder above is missing.
    """
    if path.is_dir():
        return not any(path.iterdir())
    if path.exists():
        raise StoreError(f"{path} is a file; a store is a folder")
    if not path.parent.is_dir():
        raise StoreError(
            f"there is no folder {path.parent} to make the store {path.name} in; make it first"
        )
    return True


def _make(zarr: ModuleType, path: Path, plan: Plan) -> Store | None:
    """A new store, made beside its place and renamed; None if another process was quicker."""
    draft = path.with_name(f".{path.name}-{uuid.uuid4().hex[:8]}")
    lock = None
    try:
        group = zarr.create_group(draft, zarr_format=3, attributes=_attributes(plan))
        _fill(zarr, group, plan)
        lock = Lock(draft / DONE / "lock")
        try:
            os.replace(draft, path)
        except OSError as error:
            taken = error.errno in (errno.ENOTEMPTY, errno.EEXIST, errno.EACCES)
            if taken and path.is_dir() and any(path.iterdir()):
                return None
            if error.errno in (errno.EBUSY, errno.EXDEV):
                raise StoreError(f"{path} is a mount point; name a folder inside it") from error
            raise
        store = Store(path, plan, _arrays(zarr, path, plan), lock)
        lock = None
        return store
    finally:
        if lock is not None:
            lock.release()
        shutil.rmtree(draft, ignore_errors=True)


def _arrays(zarr: ModuleType, path: Path, plan: Plan) -> dict[str, Any]:
    """The columns and the marks of a store."""
    # a chunk of zeros gets a file too, so that missing files are seen
    with zarr.config.set({"array.write_empty_chunks": True}):
        group = zarr.open_group(path, mode="r+", use_consolidated=False)
        return {name: group[name] for name in [*plan.columns, DONE]}


def _attributes(plan: Plan) -> dict[str, Any]:
    return {
        KEY: {"format": FORMAT, "digest": plan.digest, "identity": plan.identity},
        "coordinates": " ".join(plan.coords),
    }


def _fill(zarr: ModuleType, group: Any, plan: Plan) -> None:
    """The arrays of a new store."""
    packing = [zarr.codecs.ZstdCodec(level=1, checksum=True)]
    for name, column in plan.columns.items():
        group.create_array(
            name,
            shape=(plan.rows, *column.shape),
            chunks=(plan.chunk, *column.shape),
            dtype=column.type,
            fill_value=column.fill,
            compressors=packing,
            dimension_names=plan.dims(name),
            attributes=attributes(column.unit, column.about),
        )
    for name, coordinate in plan.coords.items():
        values, dims = coordinate.array, plan.dims(name)
        text = values.dtype.kind == "U"
        array = group.create_array(
            name,
            shape=values.shape,
            chunks=tuple(
                plan.chunk if dim == ROW else size
                for dim, size in zip(dims, values.shape, strict=True)
            ),
            dtype="str" if text else values.dtype,
            compressors=packing,
            dimension_names=dims,
            attributes=attributes(coordinate.unit, coordinate.about),
        )
        array[...] = values.astype(object) if text else values
    group.create_array(
        DONE,
        shape=(plan.chunks,),
        chunks=(1,),
        dtype="u1",
        fill_value=0,
        compressors=[zarr.codecs.Crc32cCodec()],
        dimension_names=(CHUNK,),
        attributes={"long_name": "1 where a chunk is complete"},
    )


def _check_run(path: Path, plan: Plan) -> None:
    """See that a folder holds a store of this plan.

    Raises:
        StoreError: it holds something else.
    """
    head = path / "zarr.json"
    if not head.is_file():
        names = sorted(entry.name for entry in path.iterdir())
        raise StoreError(
            f"{path} holds other files ({_some(names)}) and no store; name another folder"
        )
    try:
        there = json.loads(head.read_text("utf-8")).get("attributes", {}).get(KEY)
    except (ValueError, AttributeError) as error:
        raise _damaged(path, f"{head.name} can not be read ({error})") from error
    if not isinstance(there, dict):
        raise StoreError(f"{path} holds a zarr store that gough did not make; name another folder")
    if there.get("format") != FORMAT:
        raise StoreError(
            f"the store in {path} has format {there.get('format')}, this gough knows {FORMAT}; "
            "use the gough that made it or name another folder"
        )
    if there.get("digest") == plan.digest:
        return
    found = list(differences(there.get("identity"), plan.identity))
    more = [f"… and {len(found) - SHOWN} more"] if len(found) > SHOWN else []
    lines = "".join(f"\n  {line}" for line in [*found[:SHOWN], *more])
    raise OtherRun(
        f"{path} holds the store of another run; name another folder. They differ in{lines}", found
    )


def _damaged(path: Path, reason: str, chunks: list[int] | None = None) -> StoreDamaged:
    way = (
        "open it with resume='repair' to compute them again, the others stay"
        if chunks
        else "nothing was changed; name another folder"
    )
    return StoreDamaged(f"the store in {path} is damaged: {reason}; {way}", chunks or ())


def _some(items: list[Any]) -> str:
    shown = ", ".join(str(item) for item in items[:SHOWN])
    return f"{shown}, … ({len(items)} in all)" if len(items) > SHOWN else shown
