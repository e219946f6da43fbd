import logging
import os
import signal
import threading
import time

import psutil
import pytest

from gough.ensembles import (
    ClusterError,
    Interrupted,
    Memory,
    MissingExtra,
    Store,
    TaskFailed,
    cluster,
    run,
)
from tests.ensembles.tasks import Waves, computed, files, plan


@pytest.fixture
def small_cluster():
    """Starts clusters of some processes on this machine, and ends them."""
    import dask
    from distributed import LocalCluster

    made = []

    def start(workers=2, **config):
        with dask.config.set(config):
            one = LocalCluster(
                n_workers=workers,
                threads_per_worker=1,
                processes=True,
                host="127.0.0.1",
                dashboard_address=None,
                silence_logs=logging.CRITICAL,
            )
        made.append(one)
        return one

    yield start
    for one in made:
        one.close()
    end = time.monotonic() + 10
    while here := ports_and_workers():
        assert time.monotonic() < end, here
        time.sleep(0.05)


def ports_and_workers():
    """What a cluster should give back; Python's own helper of processes stays."""
    here = psutil.Process()
    helped = [child for child in here.children() if "resource_tracker" in " ".join(child.cmdline())]
    workers = [child for child in here.children() if child not in helped]
    return here.net_connections("tcp") + workers


class Deadly(Waves):
    """Rows that kill whoever computes them."""

    def __call__(self, start, stop):
        if start == 40:
            os._exit(1)
        return super().__call__(start, stop)


class Untransportable:
    """Can be packed but not unpacked."""

    def __reduce__(self):
        return __import__, ("nowhere_to_be_found",)

    def __call__(self, start, stop):
        raise AssertionError


class Unpicklable:
    def __init__(self):
        self.guard = threading.Lock()

    def __call__(self, start, stop):
        raise AssertionError


def once(action, rows):
    """A progress function that acts when so many rows are done."""
    acted = []

    def progress(done, total):
        if not acted and done >= rows:
            acted.append(done)
            action()

    return progress


def test_a_worker_is_killed_and_nothing_is_lost(tmp_path, small_cluster):
    one = small_cluster()
    victim = next(iter(one.workers.values())).pid
    progress = once(lambda: os.kill(victim, signal.SIGKILL), 24)
    with Store.open(tmp_path / "store", plan(400)) as store:
        counts = run(Waves(0.02), store, scheduler=one.scheduler_address, progress=progress)
        assert counts.computed == counts.chunks == 50
    assert victim not in [worker.pid for worker in one.workers.values()]
    assert files(tmp_path / "store") == computed(tmp_path / "threads", rows=400)


def test_few_chunks_are_under_way(small_cluster, monkeypatch):
    seen = []
    hand_out = cluster._Cluster._hand_out

    def noted(self, chunk):
        hand_out(self, chunk)
        seen.append(len(self.under_way))

    monkeypatch.setattr(cluster._Cluster, "_hand_out", noted)
    address = small_cluster(1).scheduler_address
    for workers, most in [(None, 2), (3, 3)]:
        seen.clear()
        run(Waves(), Memory(plan()), scheduler=address, workers=workers, progress=False)
        assert max(seen) == most


def test_what_goes_wrong_on_workers_is_told(tmp_path, small_cluster):
    address = small_cluster(1).scheduler_address
    memory = Memory(plan())
    with pytest.raises(TaskFailed, match=r"chunk 5 \(rows 40 to 47\) failed: ValueError") as e:
        run(Waves(fails_at=42), memory, scheduler=address, workers=1, progress=False)
    assert isinstance(e.value.__cause__, ValueError)
    assert memory.chunks_done == 5
    with pytest.raises(ClusterError, match=r"can not unpack the task .*need the same gough"):
        run(Untransportable(), memory, scheduler=address, progress=False)
    with pytest.raises(ClusterError, match="can not be pickled"):
        run(Unpicklable(), memory, scheduler=address, progress=False)

    def interrupt():
        signal.raise_signal(signal.SIGINT)

    with Store.open(tmp_path / "store", plan()) as store:
        with pytest.raises(Interrupted, match=r"interrupted: \d+ of 13 chunks are kept in"):
            run(Waves(0.02), store, scheduler=address, progress=once(interrupt, 30))
        assert 4 <= store.chunks_done < 13
        found = store.chunks_done
        assert run(Waves(), store, scheduler=address, progress=False).found == found
    assert files(tmp_path / "store") == computed(tmp_path / "threads")


def test_a_chunk_that_kills_workers_is_told(small_cluster, monkeypatch):
    monkeypatch.setattr(cluster, "ROUNDS", 2)
    address = small_cluster(1, **{"distributed.scheduler.allowed-failures": 0}).scheduler_address
    memory = Memory(plan())
    with pytest.raises(ClusterError, match=r"chunk 5 \(rows 40 to 47\) was under way whenever"):
        run(Deadly(), memory, scheduler=address, workers=1, progress=False)
    assert memory.chunks_done == 5


def test_a_scheduler_that_goes_away_is_told(small_cluster):
    one = small_cluster(1)
    memory = Memory(plan())
    with pytest.raises(ClusterError, match=r"the scheduler is gone .* of 13 chunks"):
        run(
            Waves(0.02),
            memory,
            scheduler=one.scheduler_address,
            progress=once(one.close, 24),
        )
    assert memory.chunks_done >= 3


def test_a_cluster_without_workers_is_told(small_cluster, monkeypatch):
    monkeypatch.setattr(cluster, "FIRST_WORKER", 0.2)
    address = small_cluster(0).scheduler_address
    with pytest.raises(ClusterError, match="has no workers; start some with `dask worker tcp://"):
        run(Waves(), Memory(plan()), scheduler=address, progress=False)


def test_workers_that_stay_away_are_told(small_cluster, monkeypatch):
    monkeypatch.setattr(cluster, "PATIENCE", 0.5)
    one = small_cluster(1)
    memory = Memory(plan())

    def leave():
        one.scale(0)

    with pytest.raises(ClusterError, match=r"no worker for .*; start some"):
        run(Waves(0.05), memory, scheduler=one.scheduler_address, progress=once(leave, 16))


def test_nobody_at_an_address_is_told_soon(monkeypatch):
    monkeypatch.setattr(cluster, "ANSWER", 1.0)
    begun = time.monotonic()
    with pytest.raises(
        ClusterError, match=r"no scheduler answers at tcp://127\.0\.0\.1:9 within 1 s"
    ):
        run(Waves(), Memory(plan()), scheduler="tcp://127.0.0.1:9", progress=False)
    with pytest.raises(ClusterError, match="'here' is no address of a scheduler"):
        run(Waves(), Memory(plan()), scheduler="here", progress=False)
    assert time.monotonic() - begun < 5


def test_warnings_about_versions_are_not_hidden(small_cluster, monkeypatch):
    from distributed import client, versions

    told = {"warning": "\nversions of python differ", "source": "", "client": {}}
    monkeypatch.setattr(client.version_module, "error_message", lambda *_, **__: told)
    address = small_cluster(1).scheduler_address
    with pytest.warns(versions.VersionMismatchWarning, match="versions of python differ"):
        run(Waves(), Memory(plan()), scheduler=address, progress=False)


def test_a_missing_extra_names_the_way_out(monkeypatch):
    import sys

    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(MissingExtra, match=r'pip install "gough\[cluster\]"'):
        run(Waves(), Memory(plan()), scheduler="tcp://127.0.0.1:9", progress=False)
