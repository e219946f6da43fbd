"""Generalised Dahl hysteresis: a force between two envelopes, such as that of a tape spring."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import ClassVar

from gough import algebra as al
from gough.actuators import curves
from gough.actuators.base import Effort, Event, Law, Number, Numbers, Situation, safe
from gough.algebra import Scalar

TOLERANCE = 1e-9
"""Relative; a loop without loss passes, and slopes that differ by less are equal."""


class Dahl(Law):
    """A force R that nears one envelope while w grows and the other while it shrinks.

        dR/dt = beta (Fᵈ(w) - R) v  where v ≥ 0,   beta (R - Fᶠ(w)) v  where v < 0

    with Fᵈ ``deploying`` and Fᶠ ``folding``: the generalised Dahl model of Al Majid and Dufour, as
    in Aridon, Al Majid, Rémond and Dufour 2007. It does not depend on how fast w moves. R starts
    on the folding envelope, or at ``start``. The power R v is counted as delivered, since R has no
    potential.

    Over a steady loop from w₁ to w₂ the law takes the energy

        E = ∫ Δ'(w) c(w) dw,   Δ' = Fᶠ - Fᵈ + (dFᶠ/dw + dFᵈ/dw) / beta,
        c(w) = 1 - cosh(beta (w - (w₁ + w₂)/2)) / cosh(beta (w₂ - w₁)/2) ≥ 0,

    so no loop gives energy if and only if Δ' ≥ 0 wherever loops can be. With straight envelopes of
    one slope Δ' is constant; of tables it is least beside a corner.
    """

    name = "dahl"
    numbers: ClassVar[Mapping[str, Number]] = {
        "beta": Number(
            "per position", "how fast R nears an envelope", required=True, sign="positive"
        ),
        "deploying": Number("force", "envelope while w grows", required=True, shape="curve"),
        "folding": Number("force", "envelope while w shrinks", required=True, shape="curve"),
        "start": Number("force", "R at the start; without it the folding envelope"),
        "range": Number("position", "positions between which loops take energy", shape="pair"),
    }
    memory = ("force",)
    memory_units = ("force",)
    switches = ("reversal",)

    def start(self, numbers: Numbers, w: Scalar) -> tuple[Scalar, ...]:
        given = self.number(numbers, "start")
        return (curves.value(numbers["folding"], w) if given is None else given,)

    def problems(self, numbers: Numbers) -> Iterator[tuple[str, str]]:
        span = self.number(numbers, "range")
        if span is not None and span[0] >= span[1]:
            yield (
                "range",
                f"range must go from the smaller position to the larger one, not {list(span)}",
            )
            return
        deploying, folding = numbers["deploying"], numbers["folding"]
        bends = curves.corners(deploying) + curves.corners(folding)
        if span is None and not bends and not _equal(deploying[1], folding[1]):
            yield (
                "range",
                f"the envelopes have the slopes {deploying[1]:g} and {folding[1]:g}, so whether a "
                "loop takes energy depends on where it is: write the positions it can have, "
                "range: [from, to]",
            )
            return
        low, high = span or (min(bends, default=0.0), max(bends, default=0.0))
        places = sorted({low, high, *(w for w in bends if low < w < high)})
        yield from self._active(numbers, places)

    def _active(self, numbers: Numbers, places: list[float]) -> Iterator[tuple[str, str]]:
        """A problem if loops at one of the places could give energy."""
        beta = numbers["beta"]
        beside = [pair for w in places for pair in _gaps_and_slopes(numbers, w)]
        losses = [gap + slope / beta for _, gap, slope in beside]
        worst = min(range(len(losses)), key=losses.__getitem__)
        w, gap, slope = beside[worst]
        if losses[worst] >= -TOLERANCE * (abs(gap) + abs(slope) / beta):
            return
        way = f"raise the folding envelope by {safe(-losses[worst], 'up')}"
        if all(gap > 0 for _, gap, _ in beside):
            enough = max(-slope / gap for _, gap, slope in beside)
            way += f", or beta to {safe(enough, 'up')}"
        yield (
            "beta",
            f"loops near w = {w:g} give energy: folding less deploying force and the sum of their "
            f"slopes over beta, {gap:g} + ({slope:g})/{beta:g}, is {losses[worst]:.4g}, and must "
            f"not be negative; {way}",
        )

    def effort(self, situation: Situation, numbers: Numbers) -> Effort:
        w, v, (R,) = situation.position, situation.rate, situation.memory
        if situation.branches is None:
            growing, shrinking = al.maximum(v, 0.0), al.minimum(v, 0.0)
        else:
            (up,) = situation.branches
            growing, shrinking = al.mul(up, v), al.mul(al.sub(1.0, up), v)
        nearing = al.mul(curves.value(numbers["deploying"], w) - R, growing)
        leaving = al.mul(R - curves.value(numbers["folding"], w), shrinking)
        return Effort(
            force=R,
            memory_rates=(al.mul(numbers["beta"], al.add(nearing, leaving)),),
            delivered=R * v,
            events=(Event("reversal", v, "switch"),),
        )


def _equal(a: float, b: float) -> bool:
    return abs(a - b) <= TOLERANCE * (abs(a) + abs(b))


def _gaps_and_slopes(numbers: Numbers, w: float) -> Iterator[tuple[float, float, float]]:
    """w, Fᶠ - Fᵈ, and dFᶠ/dw + dFᵈ/dw just below and just above w."""
    deploying, folding = numbers["deploying"], numbers["folding"]
    gap = curves.value(folding, w) - curves.value(deploying, w)
    sides = zip(curves.slopes_beside(deploying, w), curves.slopes_beside(folding, w), strict=True)
    for first, second in sides:
        yield w, gap, first + second
