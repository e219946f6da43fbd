"""The same run on a Dask cluster: workers compute, the client writes the store.

The task is sent once, as a result that Dask can make again where a worker with it is lost.
"""

from __future__ import annotations

import math
import queue
import time
import uuid
from collections import Counter
from types import ModuleType
from typing import Any, NoReturn

from gough.ensembles.errors import ClusterError, Interrupted
from gough.ensembles.progress import Teller
from gough.ensembles.results import Arrays, Results
from gough.ensembles.running import LOOK_EVERY, WAITING, Task, failure_of
from gough.errors import MissingExtra

ANSWER = 5.0
"""Seconds in which a scheduler has to answer."""
FIRST_WORKER = 30.0
"""Seconds in which a first worker has to be there."""
PATIENCE = 300.0
"""Seconds without any worker until a run gives up; queues of big machines may need more."""
ROUNDS = 3
"""Times that Dask may give a chunk up because its workers died (each after several deaths)."""


def run_on_cluster(
    task: Task, results: Results, address: str, workers: int | None, teller: Teller
) -> None:
    """Compute all pending chunks on the workers of a scheduler and write them here.

    Args:
        task: it can be pickled, and unpickled by the workers.
        results: where chunks are kept.
        address: of the scheduler.
        workers: chunks under way at once; None: twice the threads of all workers.
        teller: told how far it is.

    Raises:
        ClusterError: nobody answers, there are no workers, or they die again and again.
        TaskFailed, StoreError, Interrupted: as with threads.
    """
    distributed = _distributed()
    packed = _packed(task)
    client = _connected(distributed, address)
    try:
        _Cluster(distributed, client, packed, results, workers, teller).run()
    finally:
        client.close()


class _Cluster:
    """One run."""

    def __init__(
        self,
        distributed: ModuleType,
        client: Any,
        packed: bytes,
        results: Results,
        workers: int | None,
        teller: Teller,
    ) -> None:
        self.killed: type[Exception] = distributed.scheduler.KilledWorker
        self.client, self.packed, self.results = client, packed, results
        self.workers, self.teller = workers, teller
        self.todo = results.pending()[::-1]
        self.under_way: dict[str, tuple[int, Any]] = {}
        """Chunk and future of each key."""
        self.ended: queue.SimpleQueue[str] = queue.SimpleQueue()
        self.deaths: Counter[int] = Counter()
        self.name = f"gough-{uuid.uuid4().hex[:8]}"
        self.sent = 0
        self.room = 0
        self.last_look = -math.inf
        self.last_worker = time.monotonic()

    def run(self) -> None:
        self.task = self._send(_unpack, self.packed)
        try:
            while self.todo or self.under_way:
                self._look()
                while self.todo and len(self.under_way) < self.room:
                    self._hand_out(self.todo.pop())
                try:
                    key = self.ended.get(timeout=LOOK_EVERY)
                except queue.Empty:
                    continue
                self._take(key)
        except KeyboardInterrupt:
            self._end()
            raise Interrupted(f"interrupted: {self.results.kept}") from None
        except BaseException:
            self._end()
            raise

    def _send(self, function: Any, *arguments: Any) -> Any:
        self.sent += 1
        return self.client.submit(function, *arguments, key=f"{self.name}-{self.sent}", pure=False)

    def _hand_out(self, chunk: int) -> None:
        future = self._send(_compute, self.task, *self.results.plan.bounds(chunk))
        self.under_way[future.key] = chunk, future
        future.add_done_callback(lambda ended: self.ended.put(ended.key))

    def _take(self, key: str) -> None:
        """Write the chunk of a future that ended, or see what became of it."""
        chunk, future = self.under_way[key]
        if future.status == "finished":
            arrays = future.result()
            del self.under_way[key]
            self._write(chunk, arrays)
        elif future.status == "error":
            error = future.exception()
            if self.task.status == "error":
                self._task_lost(error)
            if not isinstance(error, self.killed):
                raise failure_of(self.results, chunk, error) from error
            self._died(chunk)
            del self.under_way[key]
            self.todo.append(chunk)
        else:
            self._gone(f"chunk {chunk} is {future.status}")

    def _write(self, chunk: int, arrays: Arrays) -> None:
        start, stop = self.results.plan.bounds(chunk)
        self.results.write(chunk, arrays)
        self.teller.rows(stop - start)

    def _task_lost(self, error: BaseException) -> None:
        """The task itself did not arrive: send it again if only its workers died.

        Raises:
            ClusterError: the workers can not unpack it.
        """
        if not isinstance(error, self.killed):
            raise ClusterError(
                f"the workers can not unpack the task ({type(error).__name__}: {error}); they need "
                f"the same gough, and what else the task imports. {self.results.kept}"
            ) from error
        self.task = self._send(_unpack, self.packed)

    def _died(self, chunk: int) -> None:
        self.deaths[chunk] += 1
        if self.deaths[chunk] >= ROUNDS:
            start, stop = self.results.plan.bounds(chunk)
            raise ClusterError(
                f"chunk {chunk} (rows {start} to {stop - 1}) was under way whenever a worker died, "
                f"in {ROUNDS} rounds; give workers more memory or make chunks smaller. "
                f"{self.results.kept}"
            )
        self.teller.say(f"workers died; chunk {chunk} once more")

    def _look(self) -> None:
        """See now and then how many workers there are.

        Raises:
            ClusterError: none for long, or the scheduler is gone.
        """
        now = time.monotonic()
        if now - self.last_look < LOOK_EVERY:
            return
        self.last_look = now
        if self.client.status != "running":
            self._gone(f"the client is {self.client.status}")
        try:
            threads = sum(self.client.nthreads().values())
        except (OSError, TimeoutError) as error:
            self._gone(str(error))
        if threads:
            self.last_worker = now
            self.room = self.workers or WAITING * threads
        elif now - self.last_worker > PATIENCE:
            raise ClusterError(
                f"there has been no worker for {PATIENCE:.0f} s; start some. {self.results.kept}"
            )

    def _gone(self, reason: str) -> NoReturn:
        raise ClusterError(f"the scheduler is gone ({reason}). {self.results.kept}")

    def _end(self) -> None:
        """Write what is finished, cancel the rest."""
        self.teller.say("finishing")
        if self.client.status != "running":
            return
        for chunk, future in self.under_way.values():
            if future.status == "finished":
                try:
                    self._write(chunk, future.result(timeout=ANSWER))
                except Exception:  # the first error is the one to tell
                    break
        self.client.cancel([future for _, future in self.under_way.values()])


def _unpack(packed: bytes) -> Task:
    import cloudpickle

    task: Task = cloudpickle.loads(packed)
    return task


def _compute(task: Task, start: int, stop: int) -> Arrays:
    return task(start, stop)


def _packed(task: Task) -> bytes:
    import cloudpickle

    try:
        packed: bytes = cloudpickle.dumps(task)
    except Exception as error:  # whatever its parts raise
        raise ClusterError(f"the task can not be pickled to be sent to workers: {error}") from error
    return packed


def _distributed() -> ModuleType:
    try:
        import distributed
    except ImportError as error:
        raise MissingExtra("a run on a cluster", "dask", "cluster") from error
    return distributed


def _connected(distributed: ModuleType, address: str) -> Any:
    """A client of a scheduler that has a worker at least."""
    try:
        client = distributed.Client(address, timeout=ANSWER, set_as_default=False)
    except ValueError as error:
        raise ClusterError(
            f"{address!r} is no address of a scheduler ({error}); expected one as tcp://host:8786"
        ) from error
    except (OSError, TimeoutError) as error:
        raise ClusterError(
            f"no scheduler answers at {address} within {ANSWER:.0f} s ({error}); start one with "
            "`dask scheduler` and give the address it prints"
        ) from error
    try:
        client.wait_for_workers(1, timeout=FIRST_WORKER)
    except (OSError, TimeoutError) as error:
        client.close()
        raise ClusterError(
            f"the scheduler at {address} has no workers; start some with `dask worker {address}`"
        ) from error
    return client
