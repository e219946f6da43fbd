import os
import random
import signal
import subprocess
import sys
import threading
import time
import tracemalloc

import numpy as np
import pytest

from gough.ensembles import (
    Column,
    DiskFull,
    Interrupted,
    Memory,
    Plan,
    Store,
    TaskFailed,
    run,
    running,
)
from gough.errors import ConfigurationError
from tests.ensembles.conftest import ROOT
from tests.ensembles.tasks import Counting, Waves, computed, files, marks, plan


@pytest.fixture
def folder(tmp_path):
    return tmp_path / "store"


@pytest.mark.parametrize("workers", [1, 2, 7, None])
def test_no_order_of_chunks_changes_a_bit(tmp_path, folder, workers):
    lots = random.Random(workers)

    def task(start, stop):
        time.sleep(lots.random() * 0.02)
        return Waves()(start, stop)

    with Store.open(folder, plan()) as store:
        # what is pending comes in another order too
        store.pending = lambda: lots.sample(range(13), 13) if marks(folder) < 13 else []
        counts = run(task, store, workers=workers, progress=False)
    assert (counts.rows, counts.chunks, counts.found, counts.computed) == (100, 13, 0, 13)
    assert counts.computed_rows == 100
    assert files(folder) == computed(tmp_path / "one", workers=1)


def test_a_finished_run_computes_nothing(folder):
    computed(folder)
    task = Counting(Waves())
    with Store.open(folder, plan()) as store:
        counts = run(task, store, progress=False)
    assert (counts.found, counts.computed, task.calls) == (13, 0, [])


def test_as_many_chunks_at_once_as_there_are_workers():
    task = Counting(Waves(0.01))
    run(task, Memory(plan()), workers=3, progress=False)
    assert task.most == 3
    assert sorted(task.calls) == list(range(0, 100, 8))
    with pytest.raises(ConfigurationError, match="workers is 0"):
        run(task, Memory(plan()), workers=0)


@pytest.mark.parametrize("workers", [1, 4])
def test_a_failing_task_names_chunk_and_rows(tmp_path, folder, workers):
    with Store.open(folder, plan()) as store:
        with pytest.raises(TaskFailed, match=r"chunk 5 \(rows 40 to 47\) failed: ValueError") as e:
            run(Waves(0.01, fails_at=42), store, workers=workers, progress=False)
        done = store.chunks_done
        assert f"{done} of 13 chunks are kept in {folder}; run the same again to go on" in str(
            e.value
        )
    assert isinstance(e.value.__cause__, ValueError)
    assert (e.value.chunk, e.value.rows) == (5, (40, 48))
    assert 5 - workers < done < 13
    task = Counting(Waves())
    with Store.open(folder, plan()) as store:
        run(task, store, workers=workers, progress=False)
    assert len(task.calls) == 13 - done
    assert files(folder) == computed(tmp_path / "undisturbed")


def test_of_several_failures_the_first_chunk_is_told():
    gate = threading.Barrier(3)

    def task(start, stop):
        if start < 24:
            gate.wait(5)
            time.sleep(0.05 if start == 0 else 0)
        raise ValueError(start)

    with pytest.raises(TaskFailed, match="chunk 0 "):
        run(task, Memory(plan()), workers=3, progress=False)


def test_a_task_that_gives_wrong_arrays_is_told():
    with pytest.raises(ConfigurationError, match="chunk 0 has not the columns"):
        run(lambda a, b: {}, Memory(plan()), workers=1, progress=False)


def test_a_full_disk_ends_a_run(folder, monkeypatch):
    class Full:
        def __setitem__(self, where, _):
            if where.start >= 40:
                raise OSError(28, "No space left on device")

    with Store.open(folder, plan()) as store:
        monkeypatch.setitem(store._arrays, "count", Full())
        with pytest.raises(DiskFull, match="5 of 13 chunks are kept"):
            run(Waves(), store, workers=1, progress=False)


def test_an_interrupt_finishes_what_is_under_way(tmp_path, folder, started):
    process = started(folder, seconds=0.3, chunks=2)
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=30)
    assert process.returncode
    assert "finished" not in out
    kept = marks(folder)
    assert 3 <= kept < 9
    assert f"interrupted: {kept} of 13 chunks are kept in {folder}; run the same again" in err
    with Store.open(folder, plan()) as store:
        assert run(Waves(), store, progress=False).found == kept
    assert files(folder) == computed(tmp_path / "undisturbed")


def test_interrupted_twice_leaves_at_once():
    go, signals = threading.Event(), []

    def task(start, stop):
        if start and not signals:
            signals.extend([signal.SIGINT] * 2)
            for number in signals:
                time.sleep(0.1)
                signal.pthread_kill(threading.main_thread().ident, number)
        if start:
            go.wait(10)
        return Waves()(start, stop)

    memory = Memory(plan())
    begun = time.monotonic()
    with pytest.raises(
        Interrupted, match=r"interrupted twice: [1-4] chunks under way are given up"
    ):
        run(task, memory, workers=2, progress=False)
    assert time.monotonic() - begun < 5
    memory.close()
    go.set()
    for thread in threading.enumerate():
        if thread.name.startswith("ensemble"):
            thread.join()
    assert memory.chunks_done <= 2


def test_an_interrupt_is_none_of_the_errors_that_programs_catch():
    assert not issubclass(Interrupted, Exception)


def test_a_function_is_told_how_far_it_is():
    seen = []
    memory = Memory(plan())
    memory.write(0, Waves()(0, 8))
    run(Waves(), memory, workers=1, progress=lambda *now: seen.append(now))
    assert seen == [*((rows, 100) for rows in range(16, 97, 8)), (100, 100)]


def test_a_function_that_fails_ends_the_run():
    memory = Memory(plan())
    with pytest.raises(ZeroDivisionError):
        run(Waves(), memory, workers=1, progress=lambda done, total: 1 / 0)
    assert memory.pending()


def test_silent_without_a_terminal(capfd):
    run(Waves(), Memory(plan()), workers=1)
    assert capfd.readouterr() == ("", "")


@pytest.mark.skipif(sys.platform == "win32", reason="there are no such terminals")
def test_a_bar_on_a_terminal():
    code = (
        "from tests.ensembles.tasks import *; from gough.ensembles import Memory;"
        "run(Waves(0.05), Memory(plan()), workers=1)"
    )
    main, other = os.openpty()
    process = subprocess.Popen(
        [sys.executable, "-c", code],
        stderr=other,
        cwd=ROOT,
        env={**os.environ, "TERM": "xterm", "COLUMNS": "100"},
    )
    os.close(other)
    text = b""
    try:
        while part := os.read(main, 4096):
            text += part
    except OSError:
        pass  # Linux ends so
    os.close(main)
    assert process.wait() == 0
    assert b"100 of 100 rows" in text
    assert b"rows/s" in text


@pytest.mark.parametrize("kind", ["store", "memory"])
def test_a_million_rows_need_the_memory_of_a_few_chunks(folder, kind):
    big = Plan(1_000_000, 8192, {"x": Column((4,)), "n": Column((), "i2")})

    def task(start, stop):
        rows = np.arange(start, stop)
        return {"x": np.outer(rows, [1.0, 2, 3, 4]), "n": (rows % 7).astype("i2")}

    chunk = big.chunk * big.row_bytes
    tracemalloc.start()
    try:
        with Store.open(folder, big) if kind == "store" else Memory(big) as results:
            held = tracemalloc.get_traced_memory()[0]
            tracemalloc.reset_peak()
            run(task, results, workers=2, progress=False)
            peak = tracemalloc.get_traced_memory()[1] - held
            assert not results.pending()
            last = results.read(big.chunks - 1)
    finally:
        tracemalloc.stop()
    np.testing.assert_array_equal(last["x"], task(*big.bounds(big.chunks - 1))["x"])
    assert peak < 16 * chunk + 4e6  # of 123 chunks


def test_workers_are_the_cores_of_this_process():
    assert 1 <= running._cores() <= os.cpu_count()
