"""Tasks and plans for tests, and a run that a test can start in a process of its own and kill."""

import sys
import threading
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gough.ensembles import Column, Coordinate, Plan, Store, run
from gough.ensembles.plan import DONE

TIMES = np.linspace(0.0, 1.0, 3)


def plan(rows=100, chunk=8, **origin):
    columns = {
        "wave": Column((3,), unit="rad", about="a wave at some times", dims=("t",)),
        "ok": Column((), "b1"),
        "count": Column((), "i4"),
    }
    coords = {
        "t": Coordinate(TIMES, unit="s"),
        "leg": Coordinate(["a", "b", "ç"], ("t",), about="names"),
        "amplitude": Coordinate(np.arange(rows) / 7, ("row",), unit="m"),
    }
    return Plan(rows, chunk, columns, coords, {"seed": 1, **origin})


@dataclass
class Waves:
    """Values that depend on the row alone; rows that are a multiple of a number give zeros."""

    seconds: float = 0.0
    fails_at: int | None = None

    def __call__(self, start, stop):
        if self.fails_at is not None and start <= self.fails_at < stop:
            raise ValueError(f"row {self.fails_at} went wrong")
        if self.seconds:
            time.sleep(self.seconds)
        rows = np.arange(start, stop)
        wave = np.sin(np.outer(rows, 1 + TIMES)) / (1 + rows[:, None] % 7)
        wave[rows % 11 == 3] = np.nan
        return {"wave": wave, "ok": rows % 3 > 0, "count": (rows // 40).astype("i4")}


class Counting:
    """A task that notes which rows it was called for, and how often at once."""

    def __init__(self, task):
        self.task, self.calls, self.most, self.now = task, [], 0, 0
        self.guard = threading.Lock()

    def __call__(self, start, stop):
        with self.guard:
            self.calls.append(start)
            self.now += 1
            self.most = max(self.most, self.now)
        try:
            return self.task(start, stop)
        finally:
            with self.guard:
                self.now -= 1


def files(folder):
    """The content of all files of a store except its lock."""
    return {
        str(file.relative_to(folder)): file.read_bytes()
        for file in sorted(Path(folder).rglob("*"))
        if file.is_file() and file.name != "lock"
    }


def marks(folder):
    """Number of done marks in a folder."""
    return len(list((Path(folder) / DONE / "c").glob("*")))


def computed(folder, workers=2, **options):
    """The files of an undisturbed run."""
    with Store.open(folder, plan(**options)) as store:
        run(Waves(), store, workers=workers, progress=False)
    return files(folder)


def main():
    folder, seconds = sys.argv[1], float(sys.argv[2])
    with Store.open(folder, plan()) as store:
        print("open", flush=True)
        run(Waves(seconds), store, workers=2, progress=False)
    print("finished", flush=True)


if __name__ == "__main__":
    main()
