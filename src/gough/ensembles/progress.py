"""Telling how far a run is: to a bar on a terminal, to a function, or to nobody."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

Progress = bool | Callable[[int, int], None]
"""True: a bar if there is a terminal; a function: called with rows done and rows in all."""


@dataclass(frozen=True)
class Teller:
    """How a run speaks to its user."""

    rows: Callable[[int], None]
    """Told how many rows more are done."""
    say: Callable[[str], None]
    """Told a few words about what is going on."""


@contextmanager
def telling(progress: Progress, total: int, found: int) -> Iterator[Teller]:
    """A teller for one run.

    Args:
        progress: to whom.
        total: rows in all.
        found: rows done before.
    """
    if callable(progress):
        tell, done = progress, found

        def rows(more: int) -> None:
            nonlocal done
            done += more
            tell(done, total)

        yield Teller(rows, lambda words: None)
    elif progress:
        with _bar(total, found) as teller:
            yield teller
    else:
        yield Teller(lambda more: None, lambda words: None)


@contextmanager
def _bar(total: int, found: int) -> Iterator[Teller]:
    """A bar with rows per second and the time left, if the output for errors is a terminal."""
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        Progress,
        ProgressColumn,
        Task,
        TextColumn,
        TimeRemainingColumn,
    )
    from rich.text import Text

    console = Console(stderr=True)
    if not console.is_terminal:
        yield Teller(lambda more: None, lambda words: None)
        return

    class Speed(ProgressColumn):
        def render(self, task: Task) -> Text:
            return Text(f"{task.speed:,.0f} rows/s" if task.speed else "")

    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.completed:,.0f} of {task.total:,.0f} rows"),
        Speed(),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=console) as bar:
        line = bar.add_task("computing", total=total, completed=found)
        yield Teller(
            lambda more: bar.advance(line, more),
            lambda words: bar.update(line, description=words),
        )
