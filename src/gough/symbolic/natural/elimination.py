"""Equations of natural coordinates made fewer: what is linear solved, what repeats left out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from math import prod

import numpy as np

from gough import algebra as al
from gough.symbolic.natural.parts import ORDER, PIVOT, ZERO, Condition, Family, Probing, Unknown
from gough.symbolic.polynomials import Polynomial


class Elimination:
    """Solves and tidies conditions.

    Args:
        conditions: the equations.
        implied: what the shapes among them imply, to simplify other equations with.
        unknowns: every unknown.
        sizes: what each is a multiple of.
        families: classes of orientation.
        probing: tells zeros.

    Attributes:
        solved: the unknowns that linear equations gave, in terms of those left.
        conditions: the equations left.
        checks: equations without unknowns left: conditions on what is known.
        flips: classes whose angle only one homogeneous equation asks for, with that equation.
    """

    def __init__(
        self,
        conditions: Sequence[Condition],
        implied: Sequence[Condition],
        unknowns: Sequence[Unknown],
        sizes: Sequence[float],
        families: Sequence[Family],
        probing: Probing,
    ) -> None:
        self.unknowns, self.sizes = unknowns, sizes
        self.families, self.probing, self.implied = families, probing, list(implied)
        self.solved: dict[int, Polynomial] = {}
        self.checks: list[Condition] = []
        self.flips: list[tuple[Family, Condition]] = []
        scales = self._terms([c.polynomial for c in conditions])
        self.conditions = [
            replace(c, scale=max([c.scale, *found]))
            for c, found in zip(conditions, scales, strict=True)
        ]
        self._eliminate()

    def _terms(self, polynomials: Sequence[Polynomial]) -> list[list[float]]:
        """The largest size of each term at any state, unknowns at their sizes."""
        scalars = [x for polynomial in polynomials for x in polynomial.terms.values()]
        largest = iter(np.max(np.abs(self.probing.probe(scalars)), axis=0) if scalars else [])
        return [
            [float(next(largest)) * prod(self.sizes[u] for u in key) for key in polynomial.terms]
            for polynomial in polynomials
        ]

    def _eliminate(self) -> None:
        """Solve linear equations whose pivot is a number, the platform's unknowns last."""
        rank = {k: ORDER.index(u.kind) for k, u in enumerate(self.unknowns)}
        while True:
            choice = self._pivot(rank)
            if choice is None:
                break
            condition, index = choice
            pivot = condition.polynomial.coefficient(index)
            rest = condition.polynomial - Polynomial({(index,): pivot})
            value = {index: rest.scaled(-1.0 / pivot)}
            self.conditions.remove(condition)
            self.conditions = [
                replace(c, polynomial=c.polynomial.substituted(value)) for c in self.conditions
            ]
            self.implied = [
                replace(c, polynomial=c.polynomial.substituted(value)) for c in self.implied
            ]
            self.solved = {k: p.substituted(value) for k, p in self.solved.items()} | value
            self._tidy()
        self._tidy()
        for n in range(len(self.conditions)):
            if self.keeps_shape(self.conditions[n]):  # as earlier ones have left it
                self._reduce(self.conditions[n])
        for shape in self.implied:
            if self.keeps_shape(shape):
                self._reduce(shape)
        self._tidy()
        self._drop_repeats()
        self._drop_flips()

    def _reduce(self, shape: Condition) -> None:
        """Take squares and products that the shape of a class knows out of other equations."""
        plain = {k: x for k, x in shape.polynomial.terms.items() if len(k) == 2 and al.is_number(x)}
        if not plain:
            return
        lead, value = next(iter(plain.items()))
        reduced = {
            n: condition.polynomial - shape.polynomial.scaled(x / value)
            for n, condition in enumerate(self.conditions)
            if condition is not shape and (x := condition.polynomial.terms.get(lead)) is not None
        }
        for n, polynomial in self._without_zeros(reduced).items():
            before = self.conditions[n]
            if len(polynomial.terms) < len(before.polynomial.terms):
                self.conditions[n] = replace(before, polynomial=polynomial)

    def _without_zeros(self, polynomials: Mapping[int, Polynomial]) -> dict[int, Polynomial]:
        """Polynomials of conditions without the terms that are zero at every state."""
        sizes = self._terms(list(polynomials.values()))
        return {
            n: Polynomial(
                {
                    key: x
                    for (key, x), size in zip(polynomial.terms.items(), found, strict=True)
                    if size > ZERO * self.conditions[n].scale
                }
            )
            for (n, polynomial), found in zip(polynomials.items(), sizes, strict=True)
        }

    def _drop_repeats(self) -> None:
        """Leave out equations that are a multiple of an earlier one at every probed state."""
        kept: list[Condition] = []
        for condition in self.conditions:
            same = [
                c for c in kept if c.polynomial.terms.keys() == condition.polynomial.terms.keys()
            ]
            if not any(self._proportional(c.polynomial, condition.polynomial) for c in same):
                kept.append(condition)
        self.conditions = kept

    def _proportional(self, a: Polynomial, b: Polynomial) -> bool:
        """Whether b is a multiple of a at every state, with coefficients in the order of a."""
        found = self.probing.probe([p.terms[key] for p in (a, b) for key in a.terms])
        for first, second in found.reshape(len(found), 2, -1):
            k = int(np.argmax(np.abs(first)))
            rest = second * first[k] - first * second[k]
            if np.abs(rest).max() > ZERO * abs(first[k]) * np.abs(second).max():
                return False
            if first[k] == 0 and np.abs(second).max() > 0:
                return False
        return True

    def _drop_flips(self) -> None:
        """Leave out an angle that only one homogeneous equation a c + b s = 0 asks for.

        It has two solutions half a turn apart, whatever the rest is, and moves nothing else.
        """
        for family in self.families:
            if family.pair is None or not set(family.pair) <= self._left():
                continue
            pair = set(family.pair)
            asking = [c for c in self.conditions if pair & c.polynomial.unknowns]
            own = [c for c in asking if c.polynomial.unknowns == pair and c.kind == "shape"]
            others = [c for c in asking if c not in own]
            if (
                len(others) == 1
                and len(own) == 1
                and all(len(pair & set(key)) == 1 for key in others[0].polynomial.terms)
            ):
                self.conditions = [c for c in self.conditions if c not in asking]
                self.flips.append((family, others[0]))

    def keeps_shape(self, condition: Condition) -> bool:
        """Whether an equation only says what the vectors of one class are by themselves."""
        owners = {self.unknowns[u].owner for u in condition.polynomial.unknowns}
        return condition.kind == "shape" and owners == {condition.source}

    def _left(self) -> set[int]:
        return {u for c in self.conditions for u in c.polynomial.unknowns}

    def _pivot(self, rank: Mapping[int, int]) -> tuple[Condition, int] | None:
        best: tuple[tuple[int, float], Condition, int] | None = None
        for condition in self.conditions:
            if condition.polynomial.degree != 1:
                continue
            for index in condition.polynomial.unknowns:
                value = condition.polynomial.coefficient(index)
                if not al.is_number(value):
                    continue
                share = abs(value) * self.sizes[index] / condition.scale
                if share > PIVOT:
                    key = (rank[index], -share)
                    if best is None or key < best[0]:
                        best = (key, condition, index)
        return None if best is None else (best[1], best[2])

    def _tidy(self) -> None:
        """Drop coefficients that are zero at every probed state, and equations that say nothing."""
        found = self._without_zeros({n: c.polynomial for n, c in enumerate(self.conditions)})
        tidy = [replace(c, polynomial=found[n]) for n, c in enumerate(self.conditions)]
        self.conditions = [c for c in tidy if c.polynomial.degree > 0]
        self.checks += [c for c in tidy if c.polynomial.degree == 0 and c.polynomial.terms]
