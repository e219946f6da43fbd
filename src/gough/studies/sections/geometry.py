"""Working modes and assembly modes at home: pictures side by side, and tables."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gough import view
from gough.errors import ConfigurationError
from gough.geometry.assembly_modes import AssemblyModes
from gough.geometry.direct_problem import DirectProblem
from gough.geometry.inverse import WorkingModes
from gough.studies.context import Context
from gough.studies.report import Block, Cell, Paragraph, Picture, Section, Table
from gough.view import Panel, Skeleton

Array = NDArray[np.float64]

TITLE = "Working modes and assembly modes"
MOST_WORKING, MOST_ASSEMBLY = 8, 12
"""Modes that are drawn."""
MOST_ROWS = 16
"""Rows of the table of working modes."""
MOST_JOINTS = 6
"""Columns of the table of assembly modes where there are no outputs."""
MOST_UNKNOWNS = 24
"""Unknowns up to which assembly modes are listed: the search for the start set of more is not known
to end within seconds; a guess."""
SAME = 1e-6
"""Skeletons whose points differ by less, in characteristic lengths, are one."""
DECIMALS = 4
STATUS = {
    "certified": "the list is proved complete",
    "expected": (
        "there are as many complex solutions as this mechanism is known to have, or as its start "
        "set has; that is no proof that the list is complete"
    ),
    "found": "nothing is claimed about completeness",
}


def section(context: Context) -> Section:
    """Pictures and tables of both kinds of modes, or sentences that say why there are none."""
    working, inverse = _working(context)
    assembly, direct = _assembly(context)
    data = {"geometry": {"working_modes": inverse, "assembly_modes": direct}}
    return Section("geometry", TITLE, [*working, *assembly], data)


# working modes


def _working(context: Context) -> tuple[list[Block], dict[str, Any] | None]:
    context.progress("working modes")
    robot = context.robot
    if not robot.structure.columns("operational"):
        text = "There are no working modes: the mechanism has no operational coordinates."
        return [Paragraph(text)], None
    try:
        modes = robot.working_modes(context.home.x)
    except ConfigurationError as error:
        return [Paragraph(f"Working modes are not listed: {error}.")], None
    if len(modes) < 2:
        text = "The pose of home has one working mode: no leg has a choice."
        return [Paragraph(text)], modes.as_dict()
    blocks: list[Block] = [Paragraph(_meaning(modes)), _working_picture(context, modes)]
    return [*blocks, _working_table(modes)], modes.as_dict()


def _meaning(modes: WorkingModes) -> str:
    return (
        f"The pose of home has {len(modes)} working modes. Each is a word of + and −, a sign for "
        f"the choice at {_listed(modes.labels)}. Slides count with the sign they have at home, and "
        "turns of passive joints that move nothing else are left out."
    )


def _listed(names: Sequence[str]) -> str:
    *first, last = names
    return f"{', '.join(first)} and {last}, in this order" if first else last


def _working_picture(context: Context, modes: WorkingModes) -> Picture:
    drawn = min(len(modes), MOST_WORKING)
    panels = [
        Panel(view.skeleton(context.robot, q), _word(word, modes.near), word == modes.near)
        for q, word in zip(modes.q[:drawn], modes.words(), strict=False)
    ]
    caption = f"Working modes of {context.robot.name} at the pose of home, to one scale"
    caption += _rest(drawn, len(modes)) + "."
    about = f"{drawn} configurations of the legs with the platform at one place"
    return context.picture("working-modes", view.draw_modes(panels), caption, about)


def _word(word: str, near: str) -> str:
    plain = word.replace("-", "\N{MINUS SIGN}")
    return f"{plain} · home" if word == near else plain


def _rest(drawn: int, total: int) -> str:
    return f"; {drawn} of {total} are drawn, {total - drawn} more are not" if drawn < total else ""


def _working_table(modes: WorkingModes) -> Table:
    rows: list[list[Cell]] = [
        [_word(word, modes.near), *_rounded(q)]
        for word, q in zip(modes.words(), modes.q_actuated, strict=True)
    ]
    more = len(rows) - MOST_ROWS
    left = f" {more} more are in report.json." if more > 0 else ""
    caption = f"Positions of the motors in each working mode, rad and m.{left}"
    return Table(["mode", *modes.names], rows[:MOST_ROWS], caption)


def _rounded(values: Array) -> list[Cell]:
    return [round(value, DECIMALS) + 0.0 for value in values.tolist()]


# assembly modes


def _assembly(context: Context) -> tuple[list[Block], dict[str, Any] | None]:
    context.progress("assembly modes")
    robot, home = context.robot, context.home
    if not robot.models.closure.blocks:
        text = "There is one assembly mode: no loop is closed."
        return [Paragraph(text)], None
    try:
        problem = DirectProblem(robot.models, robot.assembler, home.q)
        if problem.closure.n > MOST_UNKNOWNS:
            return [Paragraph(_too_many(problem.closure.n))], None
        modes = problem.modes(home.q_actuated)
    except ConfigurationError as error:
        return [Paragraph(f"Assembly modes are not listed: {error}.")], None
    bones = [view.skeleton(robot, q) for q in modes.q]
    at_home = _same(view.skeleton(robot), bones)
    blocks: list[Block] = [Paragraph(text) for text in (_claim(modes), *_notes(modes))]
    if len(modes) > 1:
        blocks.append(_assembly_picture(context, modes, bones, at_home))
    if len(modes):
        blocks.append(_assembly_table(modes, at_home))
    return blocks, modes.as_dict() | {"home": at_home}


def _too_many(unknowns: int) -> str:
    return (
        f"Assembly modes are not listed: linear equations leave {unknowns} unknowns, and a study "
        f"stops at {MOST_UNKNOWNS}, since the search for start solutions may take long. "
        "robot.assembly_modes takes the time."
    )


def _same(home: Skeleton, bones: Sequence[Skeleton]) -> int | None:
    """The first mode whose points are those of home, if there is one."""
    for k, other in enumerate(bones):
        if np.abs(other.points - home.points).max() <= SAME * home.length:
            return k
    return None


def _claim(modes: AssemblyModes) -> str:
    many = len(modes)
    known = f" of {' or '.join(map(str, modes.expected))}" if modes.expected else ""
    proved = int(modes.certified.sum())
    each = {0: "None is proved by itself.", many: "Each is proved to exist by itself."}
    verb, plural = ("are", "s") if many != 1 else ("is", "")
    solutions = "complex solution" if modes.complex_count == 1 else "complex solutions"
    return (
        f"With the motors of home there {verb} {many} assembly mode{plural}, {modes.status}: "
        f"{STATUS[modes.status]} ({modes.complex_count}{known} {solutions}). "
        + each.get(proved, f"{proved} of them are proved to exist by themselves.")
    )


def _notes(modes: AssemblyModes) -> list[str]:
    return [f"{note[0].upper()}{note[1:]}." for note in modes.notes]


def _assembly_picture(
    context: Context, modes: AssemblyModes, bones: Sequence[Skeleton], at_home: int | None
) -> Picture:
    drawn = min(len(modes), MOST_ASSEMBLY)
    panels = []
    for k in range(drawn):
        said = [str(k), "proved" if modes.certified[k] else "not proved"]
        said += ["home"] if k == at_home else []
        panels.append(Panel(bones[k], " · ".join(said), k == at_home))
    caption = f"Assembly modes of {context.robot.name} with the motors of home, to one scale"
    caption += _rest(drawn, len(modes)) + "."
    about = f"{drawn} configurations with the motors at one place"
    return context.picture("assembly-modes", view.draw_modes(panels), caption, about)


def _assembly_table(modes: AssemblyModes, at_home: int | None) -> Table:
    names, numbers = _columns(modes)
    rows: list[list[Cell]] = [
        [f"{k} · home" if k == at_home else str(k), *_rounded(row), bool(proved)]
        for k, (row, proved) in enumerate(zip(numbers, modes.certified, strict=True))
    ]
    caption = f"Assembly modes at home, {modes.status}; rad and m."
    return Table(["mode", *names, "proved"], rows, caption)


def _columns(modes: AssemblyModes) -> tuple[Sequence[str], Array]:
    """Outputs; without them the joints that tell the modes apart."""
    if modes.names:
        return modes.names, modes.x
    differs = np.flatnonzero(np.ptp(modes.q, axis=0) > 1e-9)[:MOST_JOINTS]
    return [modes.position_names[k] for k in differs], modes.q[:, differs]
