import errno
import os
import signal
import subprocess
import sys
import threading
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
import xarray

from gough.ensembles import (
    DiskFull,
    Memory,
    MissingExtra,
    OtherRun,
    Store,
    StoreBusy,
    StoreDamaged,
    StoreError,
    locks,
    run,
)
from gough.errors import ConfigurationError
from tests.ensembles.conftest import ROOT
from tests.ensembles.tasks import Counting, Waves, computed, files, marks, plan

linux = pytest.mark.skipif(sys.platform != "linux", reason="needs Linux")


@pytest.fixture
def folder(tmp_path):
    return tmp_path / "store"


@pytest.fixture
def whole(folder):
    computed(folder)
    return folder


def results(kind, folder):
    return Store.open(folder, plan()) if kind == "store" else Memory(plan())


@pytest.mark.parametrize("kind", ["store", "memory"])
def test_chunks_come_back_bit_by_bit(kind, folder):
    with results(kind, folder) as kept:
        assert kept.pending() == list(range(13))
        for k in reversed(kept.pending()):
            kept.write(k, Waves()(*plan().bounds(k)))
            for name, values in kept.read(k).items():
                expected = Waves()(*plan().bounds(k))[name]
                assert values.tobytes() == expected.tobytes()
                assert values.dtype == expected.dtype
        assert kept.pending() == []
        assert kept.rows_done == 100


@pytest.mark.parametrize("kind", ["store", "memory"])
def test_wrong_arrays_are_refused(kind, folder):
    good = Waves()(0, 8)
    with results(kind, folder) as kept:
        for bad, words in [
            ({**good, "wave": np.zeros((8, 2))}, r"shape \(8, 2\), expected \(8, 3\)"),
            ({**good, "count": np.zeros(8, int)}, "is int64, expected int32"),
            ({**good, "ok": np.zeros(8)}, "is float64, expected bool"),
            ({"wave": good["wave"]}, r"missing \['count', 'ok'\]"),
            ({**good, "x": 1}, r"unknown \['x'\]"),
        ]:
            with pytest.raises(ConfigurationError, match=words):
                kept.write(0, bad)
        with pytest.raises(ConfigurationError, match="no chunk 13"):
            kept.write(13, good)
        with pytest.raises(StoreError, match="not computed yet"):
            kept.read(0)
        kept.write(0, good)
        with pytest.raises(StoreError, match="written already"):
            kept.write(0, good)
    with pytest.raises(StoreError, match="closed"):
        kept.write(1, Waves()(8, 16))


def test_disk_and_memory_give_the_same_dataset(folder):
    with results("memory", folder) as memory, results("store", folder) as store:
        for k in (0, 3, 12):
            memory.write(k, Waves()(*plan().bounds(k)))
            store.write(k, Waves()(*plan().bounds(k)))
        xarray.testing.assert_identical(store.dataset().load(), memory.dataset())
        assert store.dataset().attrs["rows_done"] == 20
        assert np.isnan(store.dataset().wave[8:24]).all()


def test_xarray_reads_a_store_without_gough(whole):
    with xarray.open_zarr(whole, consolidated=False, chunks=None) as data:
        assert data.wave.dims == ("row", "t")
        assert data.wave.attrs == {"units": "rad", "long_name": "a wave at some times"}
        assert data.amplitude.dims == ("row",)
        assert set(data.coords) == {"t", "leg", "amplitude"}
        assert list(data.leg.values) == ["a", "b", "ç"]
        assert data.t.attrs["units"] == "s"
        np.testing.assert_array_equal(data.wave, Waves()(0, 100)["wave"])
        assert data.done.values.all()


def test_a_killed_run_goes_on_to_the_same_bits(tmp_path, folder, started):
    process = started(folder, seconds=0.2)
    process.send_signal(signal.SIGKILL)
    assert process.wait() == -signal.SIGKILL
    before = files(folder)
    task = Counting(Waves())
    with Store.open(folder, plan()) as store:
        assert 3 <= store.chunks_done < 13
        counts = run(task, store, progress=False)
    assert counts.found + counts.computed == 13
    assert len(task.calls) == counts.computed < 13
    after = files(folder)
    assert after == computed(tmp_path / "undisturbed")
    kept = [name for name in before if name.startswith("done/c")]
    assert kept
    assert all(before[name] == after[name] for name in kept)


def test_a_chunk_without_its_mark_does_not_count(folder, monkeypatch):
    class Killed(BaseException):
        pass

    class Marks:
        def __setitem__(self, *_):
            raise Killed

    with Store.open(folder, plan()) as store:
        monkeypatch.setitem(store._arrays, "done", Marks())
        with pytest.raises(Killed):
            store.write(4, Waves()(32, 40))
        assert 4 in store.pending()
    with Store.open(folder, plan()) as store:
        assert 4 in store.pending()
        store.write(4, Waves()(32, 40))


def test_drafts_of_killed_processes_are_removed(folder):
    with Store.open(folder, plan()) as store:
        store.write(0, Waves()(0, 8))
    draft = folder / "wave" / "c" / "1" / "0.abc.partial"
    draft.parent.mkdir()
    draft.write_bytes(b"half")
    with Store.open(folder, plan()) as store:
        assert not draft.exists()
        assert len(store.pending()) == 12


def test_no_half_made_store_is_met(folder, monkeypatch):
    monkeypatch.setattr(os, "replace", lambda *_: (_ for _ in ()).throw(OSError(errno.EIO, "bad")))
    with pytest.raises(StoreError, match=r"can not use .*store for a store: bad; name another"):
        Store.open(folder, plan())
    assert list(folder.parent.iterdir()) == []


def test_an_empty_folder_will_do(folder):
    folder.mkdir()
    computed(folder)
    assert marks(folder) == 13


def test_the_store_of_another_run_is_left_alone(whole):
    before = files(whole)
    with pytest.raises(OtherRun, match=r"origin.seed: 1 there, 2 here") as raised:
        Store.open(whole, plan(seed=2, tolerance=1e-6))
    assert raised.value.differences == (
        "origin.seed: 1 there, 2 here",
        "origin.tolerance: nothing there, 1e-06 here",
    )
    with pytest.raises(OtherRun, match="chunk: 8 there, 9 here"):
        Store.open(whole, plan(chunk=9))
    with pytest.raises(OtherRun, match="… and 12 more"):
        Store.open(whole, plan(**{f"x{k}": k for k in range(20)}))
    assert files(whole) == before


@pytest.mark.parametrize("resume", ["auto", "repair", "must", "never"])
def test_other_files_are_left_alone(folder, resume):
    folder.mkdir()
    (folder / "thesis.tex").write_text("years")
    with pytest.raises(StoreError, match=r"other files \(thesis.tex\)|holds files already"):
        Store.open(folder, plan(), resume)
    assert files(folder) == {"thesis.tex": b"years"}


def test_a_zarr_store_of_others_is_left_alone(folder):
    import zarr

    zarr.create_group(folder)
    with pytest.raises(StoreError, match="did not make"):
        Store.open(folder, plan())


def test_a_store_of_a_later_format_is_left_alone(whole):
    head = whole / "zarr.json"
    head.write_text(head.read_text().replace('"format": 1', '"format": 9'))
    with pytest.raises(StoreError, match="has format 9, this gough knows 1"):
        Store.open(whole, plan())


def test_resume_says_what_is_expected(folder):
    with pytest.raises(StoreError, match="there is no store"):
        Store.open(folder, plan(), "must")
    Store.open(folder, plan(), "never").close()
    with pytest.raises(StoreError, match="holds files already"):
        Store.open(folder, plan(), "never")
    Store.open(folder, plan(), "must").close()
    with pytest.raises(ConfigurationError, match="resume is 'yes'"):
        Store.open(folder, plan(), "yes")


def test_places_that_can_not_hold_a_store(tmp_path):
    file = tmp_path / "file"
    file.write_text("x")
    with pytest.raises(StoreError, match="is a file"):
        Store.open(file, plan())
    with pytest.raises(StoreError, match="there is no folder"):
        Store.open(file / "below", plan())
    with pytest.raises(StoreError, match=r"there is no folder .*; make it first"):
        Store.open(tmp_path / "missing" / "store", plan())
    assert file.read_text() == "x"


@linux
def test_an_unwritable_place_is_told():
    with pytest.raises(StoreError, match=r"can not use /proc/gough for a store: .*; name another"):
        Store.open("/proc/gough", plan())


def test_a_read_only_disk_still_shows_a_whole_store(small_disk, tmp_path):
    disk = small_disk("size=8m")
    expected = computed(disk / "whole")
    Store.open(disk / "begun", plan()).close()
    small_disk("ro", again=True)
    with Store.open(disk / "whole", plan()) as store:
        assert store.pending() == []
        assert store.read(2)["count"].shape == (8,)
    with pytest.raises(StoreError, match="Read-only file system"):
        Store.open(disk / "begun", plan())
    with pytest.raises(StoreError, match="Read-only file system"):
        Store.open(disk / "new", plan())
    assert files(disk / "whole") == expected


def test_a_mount_point_is_told(small_disk):
    with pytest.raises(StoreError, match="mount point; name a folder inside"):
        Store.open(small_disk("size=8m"), plan())


def test_a_full_disk_keeps_what_is_done(small_disk, tmp_path):
    disk = small_disk("size=1m")
    ballast = disk / "ballast"
    ballast.write_bytes(bytes(1 << 20))
    with pytest.raises(DiskFull, match="No space left on device; make room or name"):
        Store.open(disk / "store", plan(4000, 100))
    assert list(disk.iterdir()) == [ballast]
    ballast.write_bytes(bytes(500_000))
    with Store.open(disk / "store", plan(4000, 100)) as store:
        with pytest.raises(DiskFull, match=r"make room, then go on. \d+ of 40 chunks are kept in"):
            run(Waves(), store, workers=2, progress=False)
        done = store.chunks_done
    assert 0 < done < 40
    small_disk("size=8m", again=True)
    with Store.open(disk / "store", plan(4000, 100)) as store:
        assert run(Waves(), store, workers=2, progress=False).found == done
    assert files(disk / "store") == computed(tmp_path / "undisturbed", rows=4000, chunk=100)


@pytest.mark.parametrize(
    ("code", "error", "words"),
    [
        (errno.ENOSPC, DiskFull, "the disk is full: chunk 5 .*0 of 13 chunks are kept in .*go on"),
        (errno.EIO, StoreError, "chunk 5 can not be written to .*Input/output error"),
    ],
)
def test_writing_that_fails_is_told(folder, monkeypatch, code, error, words):
    class Full:
        def __setitem__(self, *_):
            raise OSError(code, os.strerror(code))

    with Store.open(folder, plan()) as store:
        monkeypatch.setitem(store._arrays, "ok", Full())
        with pytest.raises(error, match=words):
            store.write(5, Waves()(40, 48))
        assert 5 in store.pending()
    assert marks(folder) == 0


def test_a_store_that_is_removed_meanwhile_is_told(folder):
    import shutil

    with Store.open(folder, plan()) as store:
        shutil.rmtree(folder)
        with pytest.raises(StoreError, match="was removed"):
            store.write(0, Waves()(0, 8))


def spoil(file, how):
    content = file.read_bytes()
    flipped = bytes([*content[:-1], content[-1] ^ 1])
    {
        "cut": lambda: file.write_bytes(content[: len(content) // 2]),
        "empty": lambda: file.write_bytes(b""),
        "flipped": lambda: file.write_bytes(flipped),
        "missing": file.unlink,
    }[how]()


@pytest.mark.parametrize("how", ["cut", "empty", "flipped"])
def test_damaged_marks_are_told_and_repaired(whole, how):
    expected = files(whole)
    for k in (2, 7):
        spoil(whole / "done" / "c" / str(k), how)
    with pytest.raises(
        StoreDamaged, match=r"marks of chunks 2, 7 can not be read; .*'repair'"
    ) as e:
        Store.open(whole, plan())
    assert e.value.chunks == (2, 7)
    task = Counting(Waves())
    with Store.open(whole, plan(), "repair") as store:
        assert store.pending() == [2, 7]
        run(task, store, progress=False)
    assert sorted(task.calls) == [16, 56]
    assert files(whole) == expected


def test_marks_are_nought_or_one(whole):
    import zarr

    zarr.open_group(whole, mode="r+")["done"][3] = 7
    with pytest.raises(StoreDamaged, match="marks of chunks 3 can"):
        Store.open(whole, plan())


@pytest.mark.parametrize("how", ["cut", "empty", "flipped", "missing"])
@pytest.mark.parametrize(("column", "chunk"), [("wave", "12/0"), ("count", "4")])
def test_damaged_chunks_are_told_and_repaired(whole, how, column, chunk):
    expected = files(whole)
    spoil(whole / column / "c" / chunk, how)
    number = int(chunk.split("/")[0])
    if how == "missing":
        with pytest.raises(StoreDamaged, match=f"chunks {number} lack files"):
            Store.open(whole, plan())
    else:
        with Store.open(whole, plan()) as store, pytest.raises(StoreDamaged, match=column) as e:
            store.read(number)
        assert e.value.chunks == (number,)
    with Store.open(whole, plan(), "repair") as store:
        assert store.pending() == [number]
        run(Waves(), store, progress=False)
    assert files(whole) == expected


@pytest.mark.parametrize("name", ["zarr.json", "wave/zarr.json", "done/zarr.json"])
@pytest.mark.parametrize("how", ["cut", "empty", "missing"])
def test_damaged_metadata_are_told(whole, name, how):
    spoil(whole / name, how)
    before = files(whole)
    with pytest.raises(StoreError, match=r"is damaged: .* can not be read|other files"):
        Store.open(whole, plan())
    assert files(whole) == before


def test_one_writer_at_a_time(folder, started):
    process = started(folder, seconds=0.2, chunks=1)
    with pytest.raises(StoreBusy, match=f"written by process {process.pid} on .*; wait"):
        Store.open(folder, plan())
    process.kill()
    process.wait()
    assert (folder / "done" / "lock").read_text().startswith(f"{process.pid} ")
    with Store.open(folder, plan()) as store:
        assert store.pending()
        with pytest.raises(StoreBusy, match="open in this process already"):
            Store.open(folder, plan())
    assert (folder / "done" / "lock").read_text() == ""


def test_a_forgotten_store_gives_its_lock_back(folder):
    store = Store.open(folder, plan())
    del store
    Store.open(folder, plan()).close()


def test_without_locks_of_the_system_the_process_counts(folder, monkeypatch):
    monkeypatch.setattr(locks, "_system_lock", lambda descriptor: False)
    store = Store.open(folder, plan())
    with pytest.raises(StoreBusy, match="open in this process"):
        Store.open(folder, plan())
    store.close()
    lock = folder / "done" / "lock"
    gone = subprocess.run(
        [sys.executable, "-c", "import os; print(os.getpid())"], capture_output=True
    )
    lock.write_text(f"{int(gone.stdout)} {locks.socket.gethostname()}\n")
    Store.open(folder, plan()).close()
    lock.write_text("1 elsewhere\n")
    with pytest.raises(StoreBusy, match=r"process 1 on elsewhere; .*delete"):
        Store.open(folder, plan())
    lock.write_text("nonsense")
    Store.open(folder, plan()).close()


def test_of_many_that_make_a_store_at_once_one_does(folder):
    gate = threading.Barrier(6)

    def make(_):
        gate.wait()
        try:
            return Store.open(folder, plan())
        except StoreBusy as error:
            return error

    with ThreadPoolExecutor(6) as pool:
        made = list(pool.map(make, range(6)))
    stores = [one for one in made if isinstance(one, Store)]
    assert len(stores) == 1
    stores[0].close()
    assert [entry.name for entry in folder.parent.iterdir()] == ["store"]


def test_threads_write_different_chunks_at_once(folder):
    with Store.open(folder, plan(4000, 20)) as store:
        gate = threading.Barrier(2)

        def write(first):
            gate.wait()
            for k in range(first, 200, 2):
                store.write(k, Waves()(*store.plan.bounds(k)))

        with ThreadPoolExecutor(2) as pool:
            list(pool.map(write, range(2)))
        assert store.pending() == []
        np.testing.assert_array_equal(store.dataset().wave, Waves()(0, 4000)["wave"])


def test_memory_that_does_not_suffice_is_told(monkeypatch):
    def full(*_):
        raise MemoryError

    monkeypatch.setattr(np, "full", full)
    with pytest.raises(ConfigurationError, match=r"take 0.0 GB, .*name a folder"):
        Memory(plan())


@pytest.mark.parametrize("version", [None, "2.18.0", "3.1.2"])
def test_a_missing_extra_names_the_way_out(folder, monkeypatch, version):
    fake = type(sys)("zarr")
    fake.__version__ = version
    monkeypatch.setitem(sys.modules, "zarr", fake if version else None)
    with pytest.raises(MissingExtra, match=r'pip install "gough\[store\]"'):
        Store.open(folder, plan())


def test_heavy_packages_wait_for_their_use():
    code = (
        "import sys, gough.ensembles as e; e.run(lambda a, b: {'x': [0] * (b - a)}, "
        "e.Memory(e.Plan(3, 1, {'x': e.Column()})), progress=False); "
        "print({'zarr', 'dask', 'distributed', 'rich'} & sys.modules.keys())"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=ROOT)
    assert done.stdout == "set()\n", done
