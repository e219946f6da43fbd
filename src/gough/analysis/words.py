"""An analysis as a short text for people."""

from __future__ import annotations

import textwrap
from typing import TYPE_CHECKING

from gough.analysis.ranks import Counts, Defects

if TYPE_CHECKING:
    from gough.analysis.analysis import Analysis

WIDTH, LINE = 22, 100


def table(analysis: Analysis) -> str:
    """The analysis, one fact a line."""
    counts, structure, generic = analysis.counts, analysis.structure, analysis.defects_generic
    lines = [
        ("mechanism", f"{analysis.name} ({structure.architecture}, {structure.mechanism.motion})"),
        (
            "bodies, joints, loops",
            f"{structure.moving_bodies}, {len(structure.flat.joints)}, {structure.loops}",
        ),
        (
            "variables",
            f"{counts.total}: {counts.actuated} actuated, {counts.passive} passive, "
            f"{counts.operational} operational",
        ),
        ("equations", f"{analysis.equations}, rank {analysis.ranks.E}, {_redundant(analysis)}"),
        ("mobility", _mobility(analysis)),
        ("actuation", analysis.actuation),
        ("defects", _defects(analysis.defects, counts)),
        ("generic defects", "unknown" if analysis.isolated else _defects(generic, counts)),
        ("singularity", _singularity(analysis)),
        ("rank gap", f"{analysis.rates.gap:.1e}"),
        (
            "assembly",
            f"closed to {analysis.assembly.residual:.1e} in {analysis.assembly.steps} steps",
        ),
    ]
    lines += [("free motion", motion.description) for motion in analysis.free_motions]
    lines += [("note", warning) for warning in analysis.warnings]
    return "\n".join(
        textwrap.fill(
            text,
            LINE,
            initial_indent=f"{label:<{WIDTH}} ",
            subsequent_indent=" " * (WIDTH + 1),
            break_long_words=False,
        )
        for label, text in lines
    )


def _redundant(analysis: Analysis) -> str:
    return f"{analysis.redundant_equations or 'none'} redundant"


def _mobility(analysis: Analysis) -> str:
    usual = analysis.mobility_generic
    same = analysis.mobility == usual
    return str(usual) if same else f"{analysis.mobility} here, {usual} generic"


def _defects(defects: Defects, counts: Counts) -> str:
    """The defects that are not zero; without outputs RI only counts the motors and is left out."""
    found = defects.as_dict()
    if not counts.operational:
        del found["RI"]
    named = [f"{name} {value}" for name, value in found.items() if value]
    return ", ".join(named) or "none"


def _singularity(analysis: Analysis) -> str:
    found = analysis.singularity
    if analysis.isolated:
        return "unknown: there is no other configuration to compare with"
    kinds = [
        word
        for word, is_it in (
            ("type 1", found.type_1),
            ("type 2", found.type_2),
            ("constraint", found.constraint),
        )
        if is_it
    ]
    if not kinds and not any(analysis.excess.values()):
        return "none"
    kinds = kinds or ["of passive motion"]
    return f"{', '.join(kinds)}; {found.motion}" if found.motion else ", ".join(kinds)
