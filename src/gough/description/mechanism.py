"""A mechanism: a graph of bodies and joints with roles, as immutable data."""

from __future__ import annotations

from typing import Any

from pydantic import ValidationError

from gough.description.check import problems_of
from gough.description.flat import KINDS, flatten
from gough.description.form import Description
from gough.description.messages import problem
from gough.description.variants import merged
from gough.errors import DescriptionError, UnknownName


class Mechanism(Description):
    """A mechanism with any number of closed loops, its parts checked against each other.

    Raises:
        DescriptionError: values have the wrong form, or the parts do not fit together; all that is
            wrong is told at once.
    """

    def __init__(self, **entries: Any) -> None:
        try:
            super().__init__(**entries)
        except ValidationError as error:
            found = [problem(detail) for detail in error.errors(include_url=False)]
        else:
            found = problems_of(self)
        if found:
            raise DescriptionError(found, source=str(entries.get("name", "mechanism")))

    def written_out(self) -> Mechanism:
        """The same mechanism with its legs, and parallelograms with heavy bars, written out.

        Every part then has its full name and can be changed alone; variants, which change parts as
        they were described, are left out.
        """
        flat = flatten(self)
        parts = {kind: getattr(flat, kind) for kind in ("parameters", *KINDS)}
        return Mechanism(**{**dict(self), **parts, "legs": {}, "variants": {}})

    def varied(self, *names: str) -> Mechanism:
        """The mechanism with the changes of some of its variants, one after the other.

        Raises:
            UnknownName: there is no such variant.
            DescriptionError: what comes out does not fit together.
        """
        content: Any = self.model_dump(exclude_unset=True)
        for name in names:
            if name not in self.variants:
                raise UnknownName("variant", name, self.variants)
            content, _ = merged(content, self.variants[name].changes)
        return Mechanism(**content)
