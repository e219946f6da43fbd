"""A mechanism: a graph of bodies and joints with roles, as immutable data."""

from __future__ import annotations

from pydantic import model_validator

from gough.description.check import problems_of
from gough.description.flat import KINDS, flatten
from gough.description.form import Description
from gough.errors import DescriptionError


class Mechanism(Description):
    """A mechanism with any number of closed loops, its parts checked against each other.

    Raises:
        pydantic.ValidationError: a value has the wrong form, or the parts do not fit together.
    """

    @model_validator(mode="after")
    def _check(self) -> Mechanism:
        problems = problems_of(self)
        if problems:
            raise DescriptionError(problems, source=self.name)
        return self

    def written_out(self) -> Mechanism:
        """The same mechanism with its legs, and parallelograms with heavy bars, written out.

        Every part then has its full name and can be changed alone.
        """
        flat = flatten(self)
        parts = {kind: getattr(flat, kind) for kind in ("parameters", *KINDS)}
        return Mechanism(**{**dict(self), **parts, "legs": {}})
