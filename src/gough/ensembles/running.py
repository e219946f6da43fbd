"""Running a task over all pending chunks, in threads of this process or on a cluster."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Callable
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from dataclasses import dataclass
from typing import NoReturn

from gough.ensembles.errors import Interrupted, TaskFailed
from gough.ensembles.progress import Progress, Teller, telling
from gough.ensembles.results import Arrays, Results
from gough.errors import ConfigurationError

Task = Callable[[int, int], Arrays]
"""Computes the rows from `start` to before `stop`: all columns, each (stop - start, *shape)."""

WAITING = 2
"""Chunks handed out for each worker, so that none waits for the next."""
LOOK_EVERY = 1.0
"""Seconds; on some systems a thread that waits without end can not be interrupted."""


@dataclass(frozen=True)
class Counts:
    """What a run did."""

    rows: int
    """In all."""
    chunks: int
    found: int
    """Chunks that were there before."""
    computed: int
    """Chunks computed now."""
    computed_rows: int
    seconds: float


def run(
    task: Task,
    results: Results,
    *,
    workers: int | None = None,
    scheduler: str | None = None,
    progress: Progress = True,
) -> Counts:
    """Compute all pending chunks and keep them; the order they come in changes no bit.

    Args:
        task: called in several threads at once, so it should release the interpreter's lock; with
            a scheduler it is sent to the workers, so it can be pickled.
        results: a `Store` or `Memory`.
        workers: chunks computed at once; None: one for each core this process may use, or twice
            the threads of the cluster.
        scheduler: address of a Dask scheduler, as tcp://host:8786; None: threads of this process.
        progress: True shows a bar on a terminal; a function is called with rows done and in all.

    Raises:
        TaskFailed: the task failed for a chunk; chunks computed by then are kept.
        StoreError: a chunk can not be written.
        Interrupted: the user stopped the run; chunks under way are finished first, unless the user
            asks twice.
        ClusterError: the cluster does not answer or loses its workers.
    """
    if workers is not None and workers < 1:
        raise ConfigurationError(f"workers is {workers}, expected at least 1")
    begun = time.monotonic()
    plan, found, rows = results.plan, results.chunks_done, results.rows_done
    with telling(progress, plan.rows, rows) as teller:
        if not results.pending():
            pass
        elif scheduler is None:
            _Threads(task, results, workers or _cores(), teller).run()
        else:
            from gough.ensembles.cluster import run_on_cluster

            run_on_cluster(task, results, scheduler, workers, teller)
    return Counts(
        plan.rows,
        plan.chunks,
        found,
        results.chunks_done - found,
        results.rows_done - rows,
        time.monotonic() - begun,
    )


class _Threads:
    """A run in threads; each computes a chunk and writes it, so nothing piles up."""

    def __init__(self, task: Task, results: Results, workers: int, teller: Teller) -> None:
        self.task, self.results, self.teller = task, results, teller
        self.workers = workers
        self.todo = iter(results.pending())
        self.under_way: dict[Future[None], int] = {}
        self.stopped = threading.Event()

    def run(self) -> None:
        pool = ThreadPoolExecutor(self.workers, thread_name_prefix="ensemble")
        try:
            self._hand_out(pool)
            while self.under_way:
                done, _ = wait(self.under_way, LOOK_EVERY, FIRST_COMPLETED)
                for future in done:
                    future.result()
                    start, stop = self.results.plan.bounds(self.under_way.pop(future))
                    self.teller.rows(stop - start)
                self._hand_out(pool)
        except KeyboardInterrupt:
            self._end(pool)
            raise Interrupted(f"interrupted: {self.results.kept}") from None
        except _Failure:
            self._end(pool)
            self._raise_first()
        except BaseException:
            self._end(pool)
            raise
        pool.shutdown()

    def _hand_out(self, pool: ThreadPoolExecutor) -> None:
        while len(self.under_way) < WAITING * self.workers:
            chunk = next(self.todo, None)
            if chunk is None:
                return
            self.under_way[pool.submit(self._one, chunk)] = chunk

    def _one(self, chunk: int) -> None:
        if self.stopped.is_set():
            return
        try:
            arrays = self.task(*self.results.plan.bounds(chunk))
        except Exception as error:
            raise _Failure(chunk) from error
        self.results.write(chunk, arrays)

    def _end(self, pool: ThreadPoolExecutor) -> None:
        """Wait for what is under way; a second interrupt leaves at once."""
        self.stopped.set()
        self.teller.say("finishing; interrupt again to leave at once")
        try:
            pool.shutdown(wait=True, cancel_futures=True)
        except KeyboardInterrupt:
            pool.shutdown(wait=False)
            left = sum(not future.done() for future in self.under_way)
            raise Interrupted(
                f"interrupted twice: {left} chunks under way are given up. {self.results.kept}"
            ) from None

    def _raise_first(self) -> NoReturn:
        """Raise the failure of the first chunk for which the task failed."""
        failures = [
            error
            for future in self.under_way
            if future.done() and not future.cancelled()
            for error in [future.exception()]
            if isinstance(error, _Failure)
        ]
        first = min(failures, key=lambda failure: failure.chunk)
        raise failure_of(self.results, first.chunk, first.__cause__) from first.__cause__


class _Failure(Exception):
    """The task failed for a chunk; its error is the cause."""

    def __init__(self, chunk: int) -> None:
        self.chunk = chunk
        super().__init__(chunk)


def failure_of(results: Results, chunk: int, error: BaseException | None) -> TaskFailed:
    """The error that a user sees for a chunk that failed."""
    assert error is not None
    return TaskFailed(chunk, results.plan.bounds(chunk), error, results.kept)


def _cores() -> int:
    """Cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
