"""The sections of a report, one file each: a function from a context to a section, or to None where
there is nothing to say."""

from collections.abc import Callable

from gough.studies.context import Context
from gough.studies.report import Section
from gough.studies.sections import (
    analysis,
    comparison,
    dynamics,
    geometry,
    home,
    loops,
    simulation,
    singular_values,
    subject,
    sweep,
    uncertainty,
    velocity_factors,
)

SECTIONS: tuple[Callable[[Context], Section | None], ...] = (
    subject.section,
    home.section,
    loops.section,
    analysis.section,
    singular_values.section,
    sweep.section,
    geometry.section,
    velocity_factors.section,
    dynamics.section,
    simulation.section,
    comparison.section,
    uncertainty.section,
)
"""In the order of the report."""
