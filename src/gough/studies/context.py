"""What every section of a report is made from."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

from gough import view
from gough.analysis.analysis import Analysis
from gough.robot import Home, Robot
from gough.studies.deployments import Deployment, deployment
from gough.studies.report import Picture

if TYPE_CHECKING:
    from matplotlib.figure import Figure


POINTS = 25
"""Points of a sweep along each of its two coordinates, where nothing else is asked for."""


def _silent(message: str) -> None:
    """What happens with progress that nobody asked for."""


@dataclass(frozen=True)
class Context:
    """One study: the robot, how finely it is looked at, and results that sections share."""

    robot: Robot
    seed: int = 0
    points: int = POINTS
    """Points of a sweep along each of its two coordinates."""
    progress: Callable[[str], None] = field(default=_silent, repr=False)

    @cached_property
    def home(self) -> Home:
        """The closed start configuration."""
        self.progress("closing the loops")
        return self.robot.home

    @cached_property
    def analysis(self) -> Analysis:
        """The analysis at home."""
        self.progress("analysing")
        return self.robot.analyse(self.seed)

    @cached_property
    def deployment(self) -> Deployment | str:
        """The run that laws of force make from home, or a sentence that says why there is none."""
        self.progress("simulating")
        return deployment(self.robot)

    def picture(self, name: str, figure: Figure, caption: str, about: str) -> Picture:
        """A drawn figure as a block of a section."""
        self.progress(f"drawing {name}")
        return Picture(name, caption, about, view.svg(figure), view.png(figure))
