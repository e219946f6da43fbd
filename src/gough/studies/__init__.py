"""Studies: sweeps over a robot's workspace, and the report of all that is known of a robot."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from gough.robot import Robot
from gough.studies.context import POINTS, Context
from gough.studies.folder import Folder, StudyError
from gough.studies.html import page
from gough.studies.plain import as_json
from gough.studies.report import Section
from gough.studies.sections import SECTIONS

__all__ = ["StudyError", "study"]


def study(
    robot: Robot,
    folder: Path,
    progress: Callable[[str], None] | None = None,
    *,
    points: int = POINTS,
    seed: int = 0,
) -> Path:
    """Write a report on a robot; the path of its page, ``report.html``.

    Beside the page stand ``report.json``, the same content as plain data, and ``pictures/``, each
    as SVG and PNG. Nothing is written before everything is computed, and files are renamed into
    place: an interrupted study leaves no half report.

    Args:
        robot: the robot.
        folder: where to write; made if it does not exist.
        progress: told what is going on, in a few words.
        points: of a sweep along each of its two coordinates, 3 or more.
        seed: of the random configurations that generic values are taken from.

    Raises:
        StudyError: the folder is a file, or can not be written.
        ClosureError: the loops of the robot do not close.
        ViewError: matplotlib is not installed.
        ValueError: ``points`` is below 3.
    """
    if points < 3:
        raise ValueError(f"points is {points}; a sweep needs 3 or more along a coordinate")
    with Folder(Path(folder)) as desk:
        context = Context(robot, seed, points, **({"progress": progress} if progress else {}))
        made = (section(context) for section in SECTIONS)
        sections = [section for section in made if section is not None]
        context.progress("writing")
        desk.write(_files(robot, sections))
    return Path(folder) / "report.html"


def _files(robot: Robot, sections: list[Section]) -> dict[str, bytes]:
    """Content by name, the page last: it is what refers to the others."""
    pictures = [picture for section in sections for picture in section.pictures]
    data: dict[str, Any] = {}
    for section in sections:
        data |= section.data
    data["pictures"] = [
        {
            "name": picture.name,
            "caption": picture.caption,
            "files": [f"pictures/{picture.name}.{kind}" for kind in ("svg", "png")],
        }
        for picture in pictures
    ]
    files: dict[str, bytes] = {}
    for picture in pictures:
        files[f"pictures/{picture.name}.svg"] = picture.svg
        files[f"pictures/{picture.name}.png"] = picture.png
    files["report.json"] = as_json(data)
    files["report.html"] = page(robot.name, robot.mechanism.about, sections).encode()
    return files
