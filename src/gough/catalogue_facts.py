"""``python -m gough.catalogue_facts`` computes what ``gough list`` prints and stores it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from gough import catalogue
from gough.robot import load

KEYS = ("architecture", "mobility", "loops", "redundant_equations")


def compute(name: str) -> dict[str, Any]:
    """The facts of one robot of the catalogue."""
    robot = load(name)
    found = robot.analyse().as_dict()
    facts = {key: found[key] for key in KEYS}
    return {"name": name, **facts, "variants": list(robot.mechanism.variants)}


def main() -> None:
    """Write the facts of the whole catalogue beside its robots."""
    rows = [compute(name) for name in catalogue.names()]
    target = Path(catalogue.__file__).with_name("facts.json")
    target.write_text(json.dumps({"robots": rows}, indent=1) + "\n", "utf-8")


if __name__ == "__main__":
    main()
