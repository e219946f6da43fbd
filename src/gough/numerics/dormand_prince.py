"""The embedded Runge-Kutta pair of orders 5 and 4 of Dormand and Prince, on lanes.

J. R. Dormand and P. J. Prince, A family of embedded Runge-Kutta formulae, J. Comput. Appl. Math. 6
(1980) 19-26; the interpolant is that of L. F. Shampine, Some practical Runge-Kutta formulas, Math.
Comput. 46 (1986) 135-150. The seventh stage is the first of the next step.
"""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from typing import Any

from gough.numerics.calling import part
from gough.numerics.lanes import fma, load_wide, splat_wide

STAGES = 7
ORDER = 5
NODES = (0.0, 1 / 5, 3 / 10, 4 / 5, 8 / 9, 1.0, 1.0)
"""Times of the stages in parts of a step."""
_WEIGHTS = (
    (Fraction(1, 5),),
    (Fraction(3, 40), Fraction(9, 40)),
    (Fraction(44, 45), Fraction(-56, 15), Fraction(32, 9)),
    (Fraction(19372, 6561), Fraction(-25360, 2187), Fraction(64448, 6561), Fraction(-212, 729)),
    (
        Fraction(9017, 3168),
        Fraction(-355, 33),
        Fraction(46732, 5247),
        Fraction(49, 176),
        Fraction(-5103, 18656),
    ),
    (
        Fraction(35, 384),
        0,
        Fraction(500, 1113),
        Fraction(125, 192),
        Fraction(-2187, 6784),
        Fraction(11, 84),
    ),
)
_ERROR = (
    *(
        Fraction(71, 57600),
        0,
        Fraction(-71, 16695),
        Fraction(71, 1920),
        Fraction(-17253, 339200),
        Fraction(22, 525),
    ),
    Fraction(-1, 40),
)
INTERPOLANT = (
    (1.0, -8048581381 / 2820520608, 8663915743 / 2820520608, -12715105075 / 11282082432),
    (0.0, 0.0, 0.0, 0.0),
    (
        *(0.0, 131558114200 / 32700410799, -68118460800 / 10900136933),
        87487479700 / 32700410799,
    ),
    (0.0, -1754552775 / 470086768, 14199869525 / 1410260304, -10690763975 / 1880347072),
    (
        *(0.0, 127303824393 / 49829197408, -318862633887 / 49829197408),
        701980252875 / 199316789632,
    ),
    (0.0, -282668133 / 205662961, 2019193451 / 616988883, -1453857185 / 822651844),
    (0.0, 40617522 / 29380423, -110615467 / 29380423, 69997945 / 29380423),
)
"""Weight of stage k at the share s of a step: s (p₀ + s (p₁ + s (p₂ + s p₃)))."""


def _sum(weights: Sequence[Fraction | int]) -> Any:
    """The function Σ weight · stage of one number, the stages ``apart`` numbers from each other."""
    last, weight = len(weights) - 1, float(weights[-1])
    if last == 0:

        def first(stages: Any, at: int, apart: int, width: Any) -> Any:
            return splat_wide(weight, width) * load_wide(stages, at, width)

        return part(first)
    rest = _sum(weights[:-1])
    if weight == 0:
        return rest

    def more(stages: Any, at: int, apart: int, width: Any) -> Any:
        before = rest(stages, at, apart, width)
        return fma(splat_wide(weight, width), load_wide(stages, at + last * apart, width), before)

    return part(more)


stage_2, stage_3, stage_4, stage_5, stage_6, stage_7 = (_sum(row) for row in _WEIGHTS)
"""(stages, at, apart, width) -> the increment that leads to a stage, over the step."""
error = _sum(_ERROR)
"""The same for the difference of both results."""
