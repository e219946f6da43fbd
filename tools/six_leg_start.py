"""The generic start of six-leg platforms, computed anew: ``python tools/six_leg_start.py``.

Six random complex rows through one random point of the Study quadric have that point as a solution.
Ways round through other random sections lead from known solutions to others (monodromy; Sommese and
Wampler 2005, ch. 15), until all 40 are known. Some such sections are made, and the one from which
random platforms are reached in the fewest steps is written. The seed makes it the same each time.
"""

from __future__ import annotations

import argparse
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gough.geometry.six_leg_platforms import leg_rows
from gough.geometry.six_leg_sections import (
    DEGREE,
    FORM_COUNT,
    FORMS,
    LIGHT,
    MIXED_PAIRS,
    PATTERN,
    START_FILE,
    X_PAIRS,
    GenericStart,
    split,
)
from gough.numerics.path_tracking import PathEnding, Settings, track

Complex = NDArray[np.complex128]

SETTINGS = Settings(tolerance=1e-6, share=0.5)
SAME = 1e-8
"""Rays closer than this are the same."""
LOOPS = 100
"""Ways round before giving up."""


def random_complex(rng: np.random.Generator, *shape: int) -> Complex:
    """Normal numbers."""
    return rng.normal(size=shape) + 1j * rng.normal(size=shape)


def section_through(x: Complex, rng: np.random.Generator) -> Complex:
    """Six random rows that vanish at a point of the Study quadric, (6, 17)."""
    left, right = np.array([*X_PAIRS, *MIXED_PAIRS]).T
    values = FORMS @ np.append(x[left] * x[right], x[4:] @ x[4:])
    rows = random_complex(rng, 6, FORM_COUNT)
    return rows - np.outer(rows @ values, values.conj()) / np.vdot(values, values)


def random_point(rng: np.random.Generator) -> Complex:
    """A random complex point of the Study quadric, (8,)."""
    x, y = random_complex(rng, 2, 4)
    return np.concatenate([x, y - x * (x @ y) / (x @ x)])


def split_rows(rows: Complex) -> Complex:
    """Rows that suit tracking, (6, 17)."""
    good = split(rows)
    return np.concatenate([good.first[None], good.others])


def round_trip(rows: Complex, x: Complex, rng: np.random.Generator) -> Complex:
    """Where solutions come back to, by way of two random sections."""
    corners = [rows, *(split_rows(random_complex(rng, 6, FORM_COUNT)) for _ in range(2)), rows]
    for here, there in pairwise(corners):
        begin, end = (GenericStart.of(corner, x).start.entries for corner in (here, there))
        paths = track(PATTERN, begin, end, x, SETTINGS, light=LIGHT)
        x = paths.x[paths.ended(PathEnding.arrived)]
    return x


def distinct(x: Complex) -> Complex:
    """Rays, each once and of length 1."""
    x = x / np.linalg.norm(x, axis=1, keepdims=True)
    kept: list[Complex] = []
    for ray in x:
        if all(np.linalg.norm(ray - np.vdot(other, ray) * other) > SAME for other in kept):
            kept.append(ray)
    return np.array(kept)


def refined(rows: Complex, x: Complex) -> Complex:
    """Solutions after Newton steps with left sides in extended precision."""
    c = GenericStart.of(rows, x).start.entries
    for _ in range(4):
        long = c.astype(np.clongdouble), x.astype(np.clongdouble)
        F = np.append(PATTERN.values(*long).astype(np.complex128), np.zeros((len(x), 1)), axis=1)
        J = np.append(PATTERN.jacobian(c, x), x.conj()[:, None], axis=1)
        x = x - np.linalg.solve(J, F[..., None])[..., 0]
    return x


def found_start(rng: np.random.Generator) -> GenericStart:
    """A generic section with its 40 solutions."""
    x = random_point(rng)
    rows = split_rows(section_through(x, rng))
    known = distinct(x[None])
    for _ in range(LOOPS):
        known = distinct(np.concatenate([known, round_trip(rows, known, rng)]))
        if len(known) >= DEGREE:
            break
    if len(known) != DEGREE:
        raise RuntimeError(f"{len(known)} solutions found, expected {DEGREE}")
    x = refined(rows, known)
    if len(distinct(x)) != DEGREE:
        raise RuntimeError("some solutions became the same when refined")
    return GenericStart.of(rows, x)


def mean_steps(start: GenericStart, platforms: int, seed: int) -> float:
    """Steps per path to random platforms."""
    rng, steps = np.random.default_rng(seed), []
    for _ in range(platforms):
        a, b = rng.normal(size=(2, 6, 3)) / np.sqrt(3)
        rows = leg_rows(a - a.mean(axis=0), b - b.mean(axis=0))
        rows[:, 0] -= rng.uniform(0.5, 3.0, 6) ** 2
        goal = start.target(rows)
        paths = track(PATTERN, start.start.entries, goal, start.start.x, light=LIGHT)
        steps.append(paths.steps.mean())
    return float(np.mean(steps))


def main() -> None:
    """Find starts and write the best."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=START_FILE, help="the file to write")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--starts", type=int, default=20, help="how many to choose from")
    parser.add_argument("--platforms", type=int, default=100, help="how many to compare them at")
    options = parser.parse_args()
    rng = np.random.default_rng(options.seed)
    starts = [found_start(rng) for _ in range(options.starts)]
    steps = [mean_steps(start, options.platforms, options.seed) for start in starts]
    best = starts[int(np.argmin(steps))]
    rows = np.concatenate([best.rows.first[None], best.rows.others])
    np.savez(options.out, rows=rows, x=best.start.x)
    residual = np.abs(PATTERN.values(best.start.entries, best.start.x)).max()
    print(f"steps per path: {min(steps):.1f} best, {np.median(steps):.1f} median")
    print(f"largest residual {residual:.1e}; written to {options.out}")


if __name__ == "__main__":
    main()
