"""The sections of a report, one file each: a function from a context to a section."""

from collections.abc import Callable

from gough.studies.context import Context
from gough.studies.report import Section
from gough.studies.sections import analysis, home, loops, singular_values, subject, sweep

SECTIONS: tuple[Callable[[Context], Section], ...] = (
    subject.section,
    home.section,
    loops.section,
    analysis.section,
    singular_values.section,
    sweep.section,
)
"""In the order of the report."""
