"""Legs, and where the closure equations come from."""

from __future__ import annotations

from gough.studies.context import Context
from gough.studies.report import Block, Paragraph, Section, Table


def section(context: Context) -> Section:
    """Tables of legs and of closure equations."""
    structure = context.robot.structure
    closings = context.robot.models.closure.blocks
    blocks: list[Block] = []
    if structure.legs:
        rows = [(leg.name, leg.letters, ", ".join(leg.joints)) for leg in structure.legs]
        caption = "Legs from base to platform by the letters of their joints, motors in brackets."
        blocks.append(Table(("leg", "chain", "joints"), rows, caption))
    if closings:
        equations = [
            (block.name, block.kind, block.rows.stop - block.rows.start, ", ".join(block.joints))
            for block in closings
        ]
        caption = "Where the closure equations come from: cut joints, constraints and couplings."
        blocks.append(Table(("closing", "kind", "equations", "loop"), equations, caption))
    else:
        blocks.append(Paragraph("No loop is closed: the mechanism is a tree, without equations."))
    data = {
        "legs": [
            {"name": leg.name, "chain": leg.letters, "joints": list(leg.joints)}
            for leg in structure.legs
        ],
        "closings": [
            {
                "name": block.name,
                "kind": block.kind,
                "equations": block.rows.stop - block.rows.start,
                "loop": list(block.joints),
            }
            for block in closings
        ],
    }
    return Section("loops", "Legs and loops", blocks, data)
