"""Many rows of results, computed chunk by chunk and kept on disk or in memory.

This room knows nothing of robots: a *plan* says which rows and columns there are, a *task* computes
some rows, *results* keep them. zarr, dask and rich are loaded at first use.
"""

from gough.ensembles.errors import (
    ClusterError,
    DiskFull,
    Interrupted,
    OtherRun,
    StoreBusy,
    StoreDamaged,
    StoreError,
    TaskFailed,
)
from gough.ensembles.memory import Memory
from gough.ensembles.plan import Column, Coordinate, Plan
from gough.ensembles.results import Results
from gough.ensembles.running import Counts, Task, run
from gough.ensembles.store import Store
from gough.errors import MissingExtra

__all__ = [
    "ClusterError",
    "Column",
    "Coordinate",
    "Counts",
    "DiskFull",
    "Interrupted",
    "Memory",
    "MissingExtra",
    "OtherRun",
    "Plan",
    "Results",
    "Store",
    "StoreBusy",
    "StoreDamaged",
    "StoreError",
    "Task",
    "TaskFailed",
    "run",
]
