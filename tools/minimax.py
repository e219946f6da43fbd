"""Coefficients of the polynomials in `gough.kernels.functions`, computed anew.

Each line of output is one list: its name, the largest weighted error once the coefficients are
rounded to float64 (as a power of two) and the coefficients, from the constant one up. Run it as
``python tools/minimax.py``, or with the names of some lists.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple

from mpmath import lu_solve, matrix, mp, mpf

mp.dps = 45
Function = Callable[[Any], Any]


class Task(NamedTuple):
    """A polynomial of ``count`` coefficients near f on [low, high].

    Its error times the weight is made as small as possible. The variable of f and of the weight
    is the function's own one, x; that of the polynomial is x^power.
    """

    f: Function
    weight: Function
    low: Any
    high: Any
    count: int
    power: int = 1


QUARTER = mp.pi / 4 + mpf(2) ** -20
HALF_LN2 = mp.log(2) / 2 + mpf(2) ** -12
SERIES = (mp.sqrt(2) - 1) / (mp.sqrt(2) + 1)
"""Largest (m - 1)/(m + 1) of a number between √½ and √2."""

TASKS = {
    "SINE": Task(
        lambda y: (y - mp.sin(y)) / y**3, lambda y: y**3 / mp.sin(y), 0, QUARTER, 6, power=2
    ),
    "COSINE": Task(
        lambda y: (mp.cos(y) - 1 + y**2 / 2) / y**4,
        lambda y: y**4 / mp.cos(y),
        *(0, QUARTER, 6, 2),
    ),
    "ATAN": Task(
        lambda y: (mp.atan(y) - y) / y**3, lambda y: y**3 / mp.atan(y), 0, mpf(0.5), 12, power=2
    ),
    "ASIN": Task(
        lambda y: (mp.asin(y) - y) / y**3, lambda y: y**3 / mp.asin(y), 0, mpf(0.5), 13, power=2
    ),
    "EXP": Task(
        lambda r: (mp.exp(r) - 1 - r) / r**2,
        lambda r: r**2 / mp.expm1(r),
        *(-HALF_LN2, HALF_LN2, 11),
    ),
    "SINH": Task(
        lambda r: (mp.sinh(r) - r) / r**3, lambda r: r**3 / mp.sinh(r), 0, HALF_LN2, 5, power=2
    ),
    "COSH": Task(
        lambda r: (mp.cosh(r) - 1) / r**2, lambda r: r**2 / mp.cosh(r), 0, HALF_LN2, 6, power=2
    ),
    "TANH": Task(
        lambda y: (mp.tanh(y) - y) / y**3, lambda y: y**3 / mp.tanh(y), 0, mpf(0.55), 11, power=2
    ),
    "LOG": Task(
        lambda s: (2 * mp.atanh(s) / s - 2) / s**2,
        lambda s: s**3 / mp.log1p(2 * s / (1 - s)),
        *(0, SERIES, 7, 2),
    ),
    "ATANH": Task(
        lambda s: (mp.atanh(s) / s - 1 - s**2 / 3) / s**4, lambda s: s**4, 0, SERIES, 8, power=2
    ),
    "ERF": Task(lambda x: mp.erf(x) / x - 1, lambda x: x / mp.erf(x), 0, mpf(1), 13, power=2),
    "ERFC": Task(
        lambda x: -mp.log(mp.erfc(x)) / x,
        lambda x: x * mp.erfc(x) / mp.erf(x),
        *(mpf(1), mpf(5.9375), 18),
    ),
}


def rounded(task: Task) -> list[float]:
    """Coefficients in float64.

    Some of the first ones are rounded before the others are fitted: as many as serves best.
    """
    first: list[float] = []
    found = []
    for _ in range(5):
        further = [float(c) for c in best(task, first)]
        found.append(first + further)
        first = [*first, further[0]]
    return min(found, key=lambda coefficients: worst(task, coefficients))


def best(task: Task, known: list[float]) -> list[Any]:
    """Further coefficients after the known ones, by the exchange of Remez on a fine grid."""
    free = task.count - len(known)
    grid, values, weights = _samples(task)
    lowest = [mp.polyval(known[::-1] or [0], x**task.power) for x in grid]
    unit = task.high**task.power
    powers = [
        [weight * (x**task.power / unit) ** j for j in range(len(known), task.count)]
        for x, weight in zip(grid, weights, strict=True)
    ]
    values = [
        weight * (value - low) for value, low, weight in zip(values, lowest, weights, strict=True)
    ]
    chosen = [round((k + 0.5) * len(grid) / (free + 1)) for k in range(free + 1)]
    for _ in range(30):
        rows = [[*powers[k], mpf(-1) ** i] for i, k in enumerate(chosen)]
        *coefficients, level = lu_solve(matrix(rows), matrix([values[k] for k in chosen]))
        errors = [
            mp.fdot(row, coefficients) - value for row, value in zip(powers, values, strict=True)
        ]
        chosen = _exchanged(errors, free + 1)
        if len(chosen) <= free or max(map(abs, errors)) < abs(level) * mpf(1.001):
            break
    return [c / unit**j for j, c in enumerate(coefficients, len(known))]


@cache
def _samples(task: Task) -> tuple[list[Any], list[Any], list[Any]]:
    """Points, values and weights; points are denser near the ends."""
    count = 40 * task.count
    middle, half = (task.low + task.high) / 2, (task.high - task.low) / 2
    grid = [middle - half * mp.cos(mp.pi * (k + 0.5) / count) for k in range(count)]
    if task.low == 0:
        grid = [task.high * mp.sin(mp.pi * (k + 0.5) / count / 2) for k in range(count)]
    return grid, [task.f(x) for x in grid], [abs(task.weight(x)) for x in grid]


def _exchanged(errors: list[Any], count: int) -> list[int]:
    """Places of ``count`` neighbouring extremes with alternating signs."""
    places: list[int] = []
    for k, error in enumerate(errors):
        if places and (error > 0) == (errors[places[-1]] > 0):
            if abs(error) > abs(errors[places[-1]]):
                places[-1] = k
        else:
            places.append(k)
    while len(places) > count:
        places.pop(0 if abs(errors[places[0]]) < abs(errors[places[-1]]) else -1)
    return places


def worst(task: Task, coefficients: list[float]) -> Any:
    """Largest weighted error on a grid."""
    points = 1000
    grid = [task.low + (task.high - task.low) * mpf(k + 0.5) / points for k in range(points)]
    exact = [mpf(c) for c in reversed(coefficients)]
    return max(abs((mp.polyval(exact, x**task.power) - task.f(x)) * task.weight(x)) for x in grid)


def main(names: list[str]) -> None:
    """Print the lists with these names, or all."""
    for name in names or TASKS:
        found = rounded(TASKS[name])
        error = mp.nstr(mp.log(worst(TASKS[name], found), 2), 4)
        print(f"{name}  2^{error}\n    {', '.join(map(repr, found))}")


if __name__ == "__main__":
    main(sys.argv[1:])
