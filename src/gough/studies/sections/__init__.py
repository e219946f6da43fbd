"""The sections of a report, one file each: a function from a context to a section."""

from collections.abc import Callable

from gough.studies.context import Context
from gough.studies.report import Section
from gough.studies.sections import (
    analysis,
    dynamics,
    geometry,
    home,
    loops,
    singular_values,
    subject,
    sweep,
    velocity_factors,
)

SECTIONS: tuple[Callable[[Context], Section], ...] = (
    subject.section,
    home.section,
    loops.section,
    analysis.section,
    singular_values.section,
    sweep.section,
    geometry.section,
    velocity_factors.section,
    dynamics.section,
)
"""In the order of the report."""
