"""Mobility, redundancy and singularity: ``gough analyse`` as a page."""

from __future__ import annotations

from typing import Any

from gough.studies.context import Context
from gough.studies.numbers import written
from gough.studies.report import Block, Paragraph, Points, Section, Table

DEFECTS = {
    "RPM": "redundant passive motion: passive joints move with motors and outputs at rest",
    "RI": "redundant input: motors move with the outputs at rest",
    "RO": "redundant output: outputs move with the motors locked",
    "II": "impossible input: dimensions of motor rates that can not occur",
    "IO": "impossible output: dimensions of output rates that can not occur",
    "IIM": "increased instantaneous mobility: mobility beyond the generic one",
}
RANKS = {"N": "N, passive", "MN": "[M N]", "NK": "[N K]", "E": "E = [M N K], all"}
PRINTED = {
    "eq5_m_ge_a": "(5) mobility ≥ a",
    "eq6_redundant": "(6) rank K < a, read as redundant",
    "eq7_under": "(7) rank M < rank K, read as under-actuated",
    "eq8": "(8) rank K = o",
    "eq9": "(9) rank [M N] = rank M + rank N",
    "eq10": "(10) rank [N K] = rank N + rank K",
}
KINDS = {
    "type_1": "type 1: outputs are lost, motors move with the outputs at rest",
    "type_2": "type 2: outputs can move with the motors locked",
    "constraint": "a constraint singularity: the legs no longer hold the platform to its usual "
    "motions",
}


def section(context: Context) -> Section:
    """The analysis in words and tables."""
    found = context.analysis.as_dict()
    blocks: list[Block] = [
        Paragraph(_mobility(found)),
        Paragraph(_singularity(found)),
        _counts(found),
        _ranks(found),
        _defects(found),
        *_listed("Redundant equations", [str(item) for item in context.analysis.redundant]),
        *_listed("Free motions", [item["description"] for item in found["free_motions"]]),
        *_listed("Warnings", _warnings(context)),
        _printed(found),
    ]
    return Section("analysis", "Mobility and singularity", blocks, {"analysis": found})


def _mobility(found: dict[str, Any]) -> str:
    here, usual = found["mobility"], found["mobility_generic"]
    if found["isolated"]:
        return (
            f"The mobility is {here} here: {found['tree_dof']} variables less {found['rank']} "
            "independent equations. No other closed configuration was found, so nothing is known "
            f"of a generic one (seed {found['seed']}); the assembly may be unable to move at all."
        )
    same = "here and at a generic configuration" if here == usual else f"here, {usual} generically"
    count = found["generic_samples"]
    return (
        f"The mobility is {here} {same}: {found['tree_dof']} variables less "
        f"{found['rank']} independent equations at home. The actuation is {found['actuation']}. "
        f"Generic values are the largest ranks over home and {count} random closed "
        f"configurations of the same assembly (seed {found['seed']})."
    )


def _singularity(found: dict[str, Any]) -> str:
    singular = found["singularity"]
    if found["isolated"]:
        return "Whether it is singular is unknown: there is no other configuration to compare with."
    kinds = [text for key, text in KINDS.items() if singular[key]]
    if not kinds and not any(found["excess"].values()):
        return "The home configuration is not singular."
    kinds = kinds or ["singular in its passive motions"]
    motion = f" Motions: {singular['motion']}." if singular["motion"] else ""
    return f"The home configuration is singular, {'; '.join(kinds)}.{motion}"


def _counts(found: dict[str, Any]) -> Table:
    roles = found["variables"]
    rows = {
        "bodies besides the base": found["bodies"],
        "joints": found["joints"],
        "independent loops": found["loops"],
        "variables, actuated (a)": roles["actuated"],
        "variables, passive (p)": roles["passive"],
        "variables, operational (o)": roles["operational"],
        "closure equations": found["equations"],
        "independent equations at home": found["rank"],
        "redundant equations at home": found["redundant_equations"],
        "dimension of motor rates that can occur": found["actuation_rank"],
    }
    return Table(("", "number"), list(rows.items()), "Counts.")


def _ranks(found: dict[str, Any]) -> Table:
    here, usual = found["ranks"], found["ranks_generic"]
    rows = [(RANKS[key], here[key], usual[key]) for key in RANKS]
    caption = (
        "Ranks of the blocks of the closure Jacobian: M of the actuated, N of the passive, K of "
        "the operational variables. The smallest singular value kept is "
        f"{written(found['rank_gap'], 2)} times the largest dropped."
    )
    return Table(("block", "rank at home", "generic"), rows, caption)


def _defects(found: dict[str, Any]) -> Table:
    here, usual, excess = found["defects"], found["defects_generic"], found["excess"]
    rows = [(key, here[key], usual[key], excess[key], text) for key, text in DEFECTS.items()]
    caption = (
        "Defects after Zlatanov, Fenton and Benhabib (1995). Generic defects say what kind of "
        "robot it is; an excess over them is a singularity."
    )
    return Table(("defect", "at home", "generic", "excess", "meaning"), rows, caption)


def _listed(title: str, items: list[str]) -> list[Block]:
    if not items:
        return [Paragraph(f"{title}: none.")]
    return [Paragraph(f"{title}:"), Points(items)]


def _warnings(context: Context) -> list[str]:
    """The analysis' warnings but for redundant equations, which have their own list."""
    said = {f"{item}." for item in context.analysis.redundant}
    return [text for text in context.analysis.warnings if text not in said]


def _printed(found: dict[str, Any]) -> Table:
    rows = [(PRINTED.get(key, key), value) for key, value in found["printed_tests"].items()]
    caption = (
        "Conditions as printed in the source paper (Lahouar, Zeghloul and Romdhane 2007), for "
        "comparison. Nothing above rests on them: (5) and (6) misjudge redundancy, (8) to (10) "
        "miss singularities of passive motion."
    )
    return Table(("condition", "holds at home"), rows, caption)
