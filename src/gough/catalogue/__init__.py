"""Named robots, one YAML file each."""

from __future__ import annotations

import json
from importlib import resources
from importlib.resources.abc import Traversable
from typing import Any

from gough.errors import UnknownName


def names() -> list[str]:
    """Names of the robots of the catalogue."""
    files = (entry.name for entry in resources.files(__package__).iterdir())
    return sorted(name.removesuffix(".yaml") for name in files if name.endswith(".yaml"))


def file(name: str) -> Traversable:
    """The description file of a robot of the catalogue.

    Raises:
        UnknownName: the catalogue has no robot of that name.
    """
    if name not in names():
        raise UnknownName("robot of the catalogue", name, names())
    return resources.files(__package__) / f"{name}.yaml"


def facts() -> list[dict[str, Any]]:
    """Legs, mobility, loops and redundant equations of every robot, as last computed.

    ``python -m gough.catalogue_facts`` computes them anew; a test compares.
    """
    stored = json.loads((resources.files(__package__) / "facts.json").read_text("utf-8"))
    rows: list[dict[str, Any]] = stored["robots"]
    return rows
