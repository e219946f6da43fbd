"""Velocity factors or condition numbers over the first two translations."""

from __future__ import annotations

from typing import Any

import numpy as np

from gough import view
from gough.studies.context import Context
from gough.studies.numbers import written
from gough.studies.ratios import ISOTROPIC, Ratios, ratios
from gough.studies.report import Block, Paragraph, Picture, Section
from gough.view import Marks, Ratio

NAME, TITLE = "velocity-factors", "Velocity factors"


def section(context: Context) -> Section:
    """A map, or a sentence that says why there is none."""
    found: Ratios | str = (
        "There are no velocity factors: the assembly may be unable to move at all."
    )
    if not context.analysis.isolated:
        found = ratios(context.robot, context.points, context.progress)
    if isinstance(found, str):
        return Section(NAME, TITLE, [Paragraph(found)], {"velocity_factors": None})
    blocks: list[Block] = [Paragraph(text) for text in (_meaning(context, found), _course(found))]
    if found.translational:
        blocks.append(Paragraph(_isotropy(found)))
    if not _all_equal(found):
        blocks.append(_picture(context, found))
    return Section(NAME, TITLE, blocks, {"velocity_factors": _data(found)})


def _meaning(context: Context, found: Ratios) -> str:
    length = written(context.robot.assembler.length, 4)
    if found.translational:
        return (
            "Velocity factors are the singular values of J in ẋ = J q̇ₐ: how much faster than the "
            "motors the platform moves, in its slowest and in its fastest direction. Their ratio "
            "is the condition number."
        )
    return (
        "The condition number is the largest over the smallest singular value of J in ẋ = J q̇ₐ. "
        f"Where lengths meet angles they are divided by the characteristic length, {length} m; "
        "another length gives other numbers."
    )


def _course(found: Ratios) -> str:
    units = {axis.name: axis.unit for axis in found.outputs}
    held = [f"{name} at {written(value)} {units[name]}" for name, value in found.held.items()]
    text = "The working mode is that of home."
    if held:
        text += f" Held: {', '.join(held)}."
    condition = found.conditioning
    if np.isfinite(condition).any():
        text += f" The smallest condition number over the map is {written(found.best, 4)}."
    return text


def _isotropy(found: Ratios) -> str:
    if _all_equal(found):
        same = float(np.nanmin(found.factor(0)))
        return f"All factors are {written(same)} everywhere on the map, which is not drawn."
    if found.isotropy is None:
        return (
            "No isotropic point, where all factors are equal, was found on home's side of the "
            "singularities of type 2; the search follows the best of a coarse grid."
        )
    place = ", ".join(f"{name} = {written(v)} m" for name, v in found.isotropy.place.items())
    unit = "" if found.unit == "1" else f" {found.unit}"
    there = written(found.isotropy.factor)
    return f"There is an isotropic point at {place}: all factors are {there}{unit} there."


def _all_equal(found: Ratios) -> bool:
    """Whether every point of the map is isotropic, so that there is nothing to draw."""
    known = found.conditioning[~np.isnan(found.conditioning)]
    return bool(known.size) and bool(np.all(known <= 1 + ISOTROPIC))


def _picture(context: Context, found: Ratios) -> Picture:
    x, y = found.points
    first, second = found.axes
    home = (first.home, second.home) if found.through_home else None
    place = found.isotropy.place if found.isotropy else {}
    isotropic = (place[first.name], place[second.name]) if place else None
    marks = Marks(home, isotropic, None, found.side)
    figure = view.draw_ratios(x, y, _layers(found), (first.label, second.label), marks)
    what = "Smallest and largest velocity factor" if found.translational else "Condition number"
    caption = f"{what} over {first.name} and {second.name}."
    if found.translational and found.unit == "1":
        caption += " Thick lines: factors of ½ and 2; thin lines: 1."
    if home is None:
        caption += " The plane is that of the isotropic point; home does not lie in it."
    return context.picture(NAME, figure, caption, caption)


def _layers(found: Ratios) -> list[Ratio]:
    if not found.translational:
        return [Ratio("condition number", found.conditioning, grows=True)]
    octaves = found.unit == "1"
    unit = "" if octaves else f" ({found.unit})"
    return [
        Ratio(f"smallest velocity factor{unit}", found.factor(0), False, octaves),
        Ratio(f"largest velocity factor{unit}", found.factor(-1), True, octaves),
    ]


def _data(found: Ratios) -> dict[str, Any]:
    x, y = found.points
    values = [(axis, grid) for axis, grid in zip(found.axes, (x, y), strict=True)]
    return {
        "axes": [{"name": a.name, "unit": a.unit, "values": v} for a, v in values],
        "order": "rows over the second axis, columns over the first",
        "held": found.held,
        "unit": found.unit,
        "smallest": found.factor(0),
        "largest": found.factor(-1),
        "conditioning": found.conditioning,
        "isotropic_point": found.isotropy and vars(found.isotropy),
    }
