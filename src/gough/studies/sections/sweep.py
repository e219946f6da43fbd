"""How near singularities are around home: a slice through the operational space."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from gough import view
from gough.studies.context import Context
from gough.studies.numbers import written
from gough.studies.report import Block, Cell, Paragraph, Picture, Section, Table
from gough.studies.sweep import Sweep, sweep
from gough.view import Layer

TITLE = "Singularities around home"
NEAR = {"A": "type 1", "B": "type 2"}


def section(context: Context) -> Section:
    """Maps over two coordinates, curves over one, or a sentence that says why there are none."""
    found = sweep(context.robot, context.analysis, context.points, context.progress)
    if isinstance(found, str):
        return Section("sweep", TITLE, [Paragraph(found)], {"sweep": None, "no_sweep": found})
    sigma = {"A": found.sigma_a, "B": found.sigma_b}
    values = {name: array for name, array in sigma.items() if array is not None}
    blocks: list[Block] = [Paragraph(_meaning(context)), Paragraph(_course(found))]
    blocks += [_picture(context, found, values), _extremes(found, values)]
    return Section("sweep", TITLE, blocks, {"sweep": _data(found)})


def _meaning(context: Context) -> str:
    length = context.robot.assembler.length
    return (
        "With the passive rates eliminated, motors and outputs obey A q̇ₐ + B ẋ = 0 with A = OᵀM "
        "and B = OᵀK; the columns of O are an orthonormal basis of the left null space of N. "
        "Where the smallest singular value of A tends to zero, a singularity of type 1 is near: "
        "outputs are lost. Where that of B does, one of type 2: the motors no longer hold the "
        "outputs. Values beyond the generic ranks of A and B, zero everywhere, are left out. "
        f"Lengths are divided by the characteristic length, {written(length, 4)} m."
    )


def _course(found: Sweep) -> str:
    varied = " and ".join(f"{axis.name} at {len(axis.values)} points" for axis in found.axes)
    text = f"Varied: {varied}."
    if found.held:
        text += f" Held at home: {', '.join(found.held)}."
    if found.following:
        text += f" Not free beside these, and following them: {', '.join(found.following)}."
    reached, total = int(found.reached.sum()), found.reached.size
    text += f" The assembly of home was followed outwards to {reached} of {total} points."
    if reached < total:
        text += (
            " The others are hatched: there the loops do not close, or the way from home passes "
            "a singularity into another assembly."
        )
    return text


def _picture(context: Context, found: Sweep, values: dict[str, NDArray[np.float64]]) -> Picture:
    layers = [Layer(f"smallest singular value of {name}", s) for name, s in values.items()]
    labels = [axis.label for axis in found.axes]
    first = found.axes[0]
    if len(found.axes) == 1:
        figure = view.draw_curves(first.values, layers, labels[0], first.home)
        over = first.name
    else:
        second = found.axes[1]
        at = (float(first.values[first.home]), float(second.values[second.home]))
        figure = view.draw_maps(first.values, second.values, layers, (labels[0], labels[1]), at)
        over = f"{first.name} and {second.name}"
    named = " and ".join(f"{name} ({NEAR[name]})" for name in values)
    caption = f"Smallest singular values of {named} over {over}. Low values are near singularities."
    return context.picture("sweep", figure, caption, caption)


def _extremes(found: Sweep, values: dict[str, NDArray[np.float64]]) -> Table:
    columns = ["value", "at home", "smallest", *(f"at {axis.label}" for axis in found.axes)]
    rows: list[list[Cell]] = []
    for name, array in values.items():
        cell = np.unravel_index(int(np.nanargmin(array)), array.shape)
        places = [float(axis.values[k]) for axis, k in zip(found.axes, cell[::-1], strict=True)]
        at_home = float(array[found.home])
        rows.append([f"σ of {name}, {NEAR[name]}", at_home, float(array[cell]), *places])
    return Table(columns, rows, "At home, and the smallest over the points reached.")


def _data(found: Sweep) -> dict[str, Any]:
    return {
        "axes": [
            {"name": axis.name, "unit": axis.unit, "values": axis.values} for axis in found.axes
        ],
        "order": "rows over the second axis, columns over the first" if len(found.axes) > 1 else "",
        "home": [axis.home for axis in found.axes],
        "held": list(found.held),
        "following": list(found.following),
        "reached": found.reached,
        "sigma_A": found.sigma_a,
        "sigma_B": found.sigma_b,
        "sigma_unit": "1",
    }
