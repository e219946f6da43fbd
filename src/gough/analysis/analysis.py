"""The analysis of one mechanism: counts, ranks, defects, redundancy, singularity, in words."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gough.analysis import ranks as rk
from gough.analysis.motions import FreeMotion, Motions
from gough.analysis.ranks import Counts, Defects, Linearisation, Ranks
from gough.analysis.redundancy import Redundancy, redundancies
from gough.assembly import Assembler, Assembly
from gough.topology import Structure

Array = NDArray[np.float64]

SAMPLES = 8
"""Random closed configurations that generic values are taken from."""
SHARP = 1e-6
"""A rank that rests on a smaller singular value may rest on an error of position: a search locates
a singular root to 1e-8 at best."""
ELSEWHERE = 1e-3
"""A configuration nearer than this to home, rad or characteristic lengths, may be home again."""
CLEAR_GAP = 1e3
"""A smaller gap in the singular values means that a rank is a matter of opinion."""


@dataclass(frozen=True)
class Singularity:
    """What kind of singularity a configuration is, if any."""

    type_1: bool
    """Gosselin-Angeles type 1: outputs are lost, motors move with the outputs at rest."""
    type_2: bool
    """Type 2: outputs can move with the motors locked."""
    constraint: bool
    """The legs no longer hold the platform to its usual motions (Zlatanov et al. 2002)."""
    motion: str | None
    """The lost or gained motions in words."""


@dataclass(frozen=True)
class Generic:
    """Ranks at a generic configuration of the same assembly."""

    ranks: Ranks
    platform: int
    """Rank of the platform twists."""
    samples: int
    """Random closed configurations that were found."""


@dataclass(frozen=True)
class Analysis:
    """What ``gough analyse`` prints; see the glossary for the words."""

    name: str
    structure: Structure = field(repr=False)
    rates: Linearisation = field(repr=False)
    assembly: Assembly
    generic: Generic
    redundant: tuple[Redundancy, ...]
    free_motions: tuple[FreeMotion, ...]
    singularity: Singularity
    seed: int

    # numbers

    @property
    def counts(self) -> Counts:
        """Variables by role."""
        return self.rates.counts

    @property
    def ranks(self) -> Ranks:
        """Ranks at this configuration."""
        return self.rates.ranks

    @property
    def equations(self) -> int:
        """Closure equations."""
        return int(self.rates.E.shape[0])

    @property
    def mobility(self) -> int:
        """Instantaneous mobility at this configuration."""
        return rk.mobility(self.ranks, self.counts)

    @property
    def mobility_generic(self) -> int:
        """Mobility at a generic configuration of the same assembly."""
        return rk.mobility(self.generic.ranks, self.counts)

    @property
    def defects(self) -> Defects:
        """The six defects at this configuration."""
        return rk.defects(self.ranks, self.counts, self.generic.ranks)

    @property
    def defects_generic(self) -> Defects:
        """The six defects at a generic configuration: what kind of robot it is."""
        return rk.defects(self.generic.ranks, self.counts, self.generic.ranks)

    @property
    def excess(self) -> dict[str, int]:
        """Defects beyond the generic ones: not all zero at a singularity."""
        generic = self.defects_generic.as_dict()
        return {key: value - generic[key] for key, value in self.defects.as_dict().items()}

    @property
    def redundant_equations(self) -> int:
        """Equations that others imply."""
        return self.equations - self.ranks.E

    @property
    def redundant_equations_generic(self) -> int:
        """Equations that others imply at a generic configuration: how overconstrained it is."""
        return self.equations - self.generic.ranks.E

    @property
    def actuation_rank(self) -> int:
        """Dimension of the motor rates that can occur."""
        return self.counts.actuated - self.defects.II

    # words

    @property
    def actuation(self) -> str:
        """``full``, or what is redundant or missing, joined by commas; ``unknown`` if isolated.

        Without outputs every motor moves with "the output at rest", so RI says nothing then.
        """
        if self.isolated:
            return "unknown"
        generic = self.defects_generic
        words = []
        if generic.II > 0:
            words.append("redundant")
        if generic.RI > 0 and self.counts.operational:
            words.append("kinematically redundant")
        if generic.RO > 0 or self._idle_without_output:
            words.append("under")
        return ", ".join(words) or "full"

    @property
    def isolated(self) -> bool:
        """Whether it could move, but no other configuration was found: nothing is generic."""
        return self.generic.samples == 0 and self.mobility > 0

    @property
    def _idle_without_output(self) -> bool:
        """Without outputs, whether joints move with the motors locked; a floating base may."""
        if self.counts.operational:
            return False
        floating = 0
        if self.structure.mechanism.floating:
            floating = self.structure.edges[0].type.freedoms
        return floating < self.defects_generic.RPM

    @property
    def printed_tests(self) -> dict[str, bool]:
        """Conditions (5) to (10) of the source paper as printed, for comparison only."""
        return rk.printed_tests(self.rates)

    @property
    def warnings(self) -> tuple[str, ...]:
        """What to know before trusting the numbers."""
        found = []
        if self.rates.gap < CLEAR_GAP:
            found.append(
                f"the smallest singular value kept is only {self.rates.gap:.3g} times the largest "
                "dropped: a rank here is not clear-cut"
            )
        if self.rates.margin < SHARP:
            found.append(
                f"a rank here rests on a singular value of {self.rates.margin:.1e} times the "
                "largest: the configuration is next to a singularity, or is one that was found "
                "only to rounding; give its home exactly to tell"
            )
        if self.isolated:
            found.append(
                "no other closed configuration was found near this one: it may be isolated, and "
                "generic values are those of this configuration"
            )
        if self.assembly.moved:
            found.append(self.assembly.moved_text)
        if self.assembly.restarts:
            found.append(
                f"the described start did not close; restart {self.assembly.restarts} from "
                "perturbed passive joints did, and chose the assembly"
            )
        here = "" if self.redundant_equations == self.redundant_equations_generic else ", here"
        found += [f"{item}{here}." for item in self.redundant]
        return tuple(found)

    def as_dict(self) -> dict[str, Any]:
        """The analysis as plain data, one JSON object."""
        counts, structure = self.counts, self.structure
        return {
            "name": self.name,
            "architecture": structure.architecture,
            "modelling": structure.modelling,
            "motion": structure.mechanism.motion,
            "bodies": structure.moving_bodies,
            "joints": len(structure.flat.joints),
            "loops": structure.loops,
            "tree_dof": counts.total,
            "variables": {
                "actuated": counts.actuated,
                "passive": counts.passive,
                "operational": counts.operational,
            },
            "equations": self.equations,
            "rank": self.ranks.E,
            "redundant_equations": self.redundant_equations,
            "redundant_equations_generic": self.redundant_equations_generic,
            "mobility": self.mobility,
            "mobility_generic": self.mobility_generic,
            "ranks": vars(self.ranks).copy(),
            "ranks_generic": vars(self.generic.ranks).copy(),
            "defects": self.defects.as_dict(),
            "defects_generic": self.defects_generic.as_dict(),
            "excess": self.excess,
            "actuation": self.actuation,
            "actuation_rank": self.actuation_rank,
            "redundant": [
                {
                    "joint": item.joint,
                    "equations": item.equations,
                    "of": item.of,
                    "implied_by": list(item.implied_by),
                }
                for item in self.redundant
            ],
            "free_motions": [
                {"bodies": list(motion.bodies), "description": motion.description}
                for motion in self.free_motions
            ],
            "singularity": vars(self.singularity).copy(),
            "rank_gap": self.rates.gap,
            "assembly": {
                "residual": self.assembly.residual,
                "steps": self.assembly.steps,
                "restarts": self.assembly.restarts,
                "moved": list(self.assembly.moved),
            },
            "generic_samples": self.generic.samples,
            "isolated": self.isolated,
            "seed": self.seed,
            "printed_tests": self.printed_tests,
            "warnings": list(self.warnings),
        }

    def __str__(self) -> str:
        from gough.analysis.words import table

        return table(self)


def analyse(assembler: Assembler, assembly: Assembly, seed: int = 0) -> Analysis:
    """The analysis at one closed configuration.

    Args:
        assembler: the mechanism with its live parameters.
        assembly: a closed configuration.
        seed: of the random configurations that generic values are taken from.
    """
    structure = assembler.models.structure
    rates = rk.linearise(assembler, assembly.q)
    motions = Motions(assembler, assembly.q, rates)
    generic = _generic(assembler, assembly.q, rates, motions, seed)
    redundant = redundancies(
        assembler.scaled_jacobian(assembly.q), assembler.models.closure.blocks, rates.threshold
    )
    return Analysis(
        structure.mechanism.name,
        structure,
        rates,
        assembly,
        generic,
        tuple(redundant),
        tuple(motions.free()),
        _singularity(rates, generic, motions),
        seed,
    )


def _generic(
    assembler: Assembler, q: Array, rates: Linearisation, motions: Motions, seed: int
) -> Generic:
    """Largest ranks over random closed configurations; platform rank where they are reached."""
    rng = np.random.default_rng(seed)
    seen = [(rates.ranks, motions.platform_rank())]
    for _ in range(SAMPLES):
        other = assembler.wander(q, rng)
        if other is None:
            continue
        there = rk.linearise(assembler, other)
        if there.margin < SHARP and assembler.distance(q, other) < ELSEWHERE:
            continue
        seen.append((there.ranks, Motions(assembler, other, there).platform_rank()))
    best = seen[0][0]
    for ranks, _ in seen:
        best = best.largest(ranks)
    platform = min((rank for ranks, rank in seen if not ranks.below(best)), default=seen[0][1])
    return Generic(best, platform, len(seen) - 1)


def _singularity(rates: Linearisation, generic: Generic, motions: Motions) -> Singularity:
    here = rk.defects(rates.ranks, rates.counts, generic.ranks)
    usual = rk.defects(generic.ranks, rates.counts, generic.ranks)
    type_1, type_2 = here.RI > usual.RI, here.RO > usual.RO
    constraint = motions.platform_rank() > generic.platform
    words = []
    if type_2:
        how = "possible" if usual.RO or usual.RPM else "gained"
        words += [f"{how} with the motors locked: {w}" for w in motions.with_motors_locked()]
    if constraint:
        words += [f"possible with the outputs at rest: {w}" for w in motions.with_outputs_at_rest()]
    if here.IO > usual.IO:
        words += [f"lost: {w}" for w in motions.lost()]
    if here.RPM > usual.RPM:
        words += [f"gained by passive joints: {m.description}" for m in motions.free()]
    return Singularity(type_1, type_2, constraint, "; ".join(words) or None)
