"""What comes back from following a path: samples, events, and how it ended."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

Given = Literal["outputs", "inputs"]
Kind = Literal["toggle", "type 1", "type 2", "type 3", "not reached"]


class Ending(Enum):
    """How a path ended; the text is what the user reads."""

    arrived = "the path was followed to its end"
    stopped = (
        "stopped at a singularity that the path goes through; on_singularity='continue' goes on"
    )
    merged = "two solutions meet here, and beyond there is neither"
    out_of_reach = "a leg does not reach what comes next"
    open = "the loops do not close with what comes next"
    no_start = "the configuration to start near does not lead to the first point of the path"
    too_small = "no step, however small, was proved or closed, away from any singularity"
    step_limit = "the steps ran out before the path did"


@dataclass(frozen=True, eq=False)
class Event:
    """Something that happens at one place of a path."""

    s: float
    """Where, from 0 to 1."""
    kind: Kind
    """*toggle*: a leg passes from one branch to another, following inputs (a singularity of type
    1); *type 1*: outputs are lost; *type 2*: outputs move with the motors locked; *type 3*: both;
    *not reached*: what comes next has no configuration."""
    text: str
    """What happens, with the joints or the outputs that it happens to."""
    q: Array
    """The configuration there, as near as it is known, (positions,)."""

    def __str__(self) -> str:
        return f"s = {self.s:.9f}  {self.kind}: {self.text}"


@dataclass(frozen=True, eq=False)
class Track:
    """A path followed through closed configurations.

    Rows are at equal steps of s as far as the path was followed; where it ends before 1 the last
    row is where it ends, to within the smallest step.
    """

    robot: str
    given: Given
    s: Array
    """Places on the path, from 0, (rows,)."""
    q: Array
    """Configurations, (rows, positions)."""
    x: Array
    """Operational coordinates, (rows, n)."""
    q_actuated: Array
    """Positions of the actuated joints, (rows, actuated)."""
    mode: tuple[str, ...]
    """The working mode at each row as a word of + and -, a letter for each of `branches`."""
    determinant: NDArray[np.int8]
    """Sign of the determinant of the direct kinematics at each row, 1 at home; 0 where it has none
    or vanishes, (rows,)."""
    events: tuple[Event, ...]
    """In the order of s."""
    ending: Ending
    reason: str
    """What kept the path from going on, "" where it arrived."""
    certified: bool
    """Whether every step is proved: one solution, continuous in s, joins all rows."""
    steps: int
    """How many steps it took."""
    branches: tuple[str, ...] = ()
    """The joint or body at which each branch of a working mode splits."""
    notes: tuple[str, ...] = ()
    """What a reader should know, of what is proved and what is not."""

    def __len__(self) -> int:
        return len(self.s)

    @property
    def arrived(self) -> bool:
        """Whether the path was followed to its end."""
        return self.ending is Ending.arrived

    def of_kind(self, *kinds: Kind) -> list[Event]:
        """The events of some kinds."""
        return [event for event in self.events if event.kind in kinds]

    def as_dict(self) -> dict[str, Any]:
        """The content as plain data."""
        return {
            "name": self.robot,
            "given": self.given,
            "s": self.s.tolist(),
            "q": self.q.tolist(),
            "x": self.x.tolist(),
            "q_actuated": self.q_actuated.tolist(),
            "mode": list(self.mode),
            "branches": list(self.branches),
            "determinant": self.determinant.tolist(),
            "events": [
                {"s": e.s, "kind": e.kind, "text": e.text, "q": e.q.tolist()} for e in self.events
            ],
            "ending": self.ending.name,
            "reason": self.reason,
            "certified": self.certified,
            "steps": self.steps,
            "notes": list(self.notes),
        }

    def __str__(self) -> str:
        proof = "certified" if self.certified else "not certified"
        end = f"{self.s[-1]:.9g}" if len(self) else "-"
        lines = [f"path of {self.given} of {self.robot}: {self.steps} steps, {proof}"]
        lines += [f"  {k:<8} {text}" for k, text in self._ends()]
        lines += [f"  {event}" for event in self.events]
        lines.append(f"  s = {end}  end: {self.ending.value}")
        if self.reason not in ("", self.ending.value, *(event.text for event in self.events)):
            lines.append(f"  {self.reason}")
        return "\n".join([*lines, *self.notes])

    def _ends(self) -> list[tuple[str, str]]:
        """Mode and outputs (or motors, where there are none) of the first and the last row."""
        values = self.x if self.x.shape[1] else self.q_actuated
        found = []
        for name, row in (("start", 0), ("end", -1)) if len(self) else ():
            sign = {1: "+", -1: "-", 0: "·"}[int(self.determinant[row])]
            cells = " ".join(f"{value:+.6f}" for value in values[row])
            found.append((name, f"mode {self.mode[row] or '·'}  determinant {sign}  {cells}"))
        return found
