"""What all modes of six-leg platforms cost: ``python -m benchmarks.assembly_modes`` [--json].

All figures are taken in one run, in turns, and medians over platforms are given. A call from Python
is timed whole, proofs included; machine code is loaded before.
"""

from __future__ import annotations

import argparse
import json
import statistics
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from gough.geometry.six_leg_platforms import Completeness, PlatformModes, SixLegPlatform
from gough.geometry.six_leg_sections import LIGHT, PATTERN, generic_start
from gough.numerics.certificates import certify
from gough.numerics.path_tracking import track

PLATFORMS = 100
DIETMAIER = Path(__file__).parents[1] / "tests" / "data" / "assembly_modes_dietmaier.json"


def timed(run: Callable[[], Any]) -> tuple[float, Any]:
    """Milliseconds of a call, and what it gives."""
    start = time.perf_counter()
    result = run()
    return 1e3 * (time.perf_counter() - start), result


def lengths_at(base: np.ndarray, platform: np.ndarray, R: np.ndarray, p: np.ndarray) -> np.ndarray:
    return np.linalg.norm(platform @ R.T + p - base, axis=1)


def random_rotation(rng: np.random.Generator) -> np.ndarray:
    Q = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    return Q * np.linalg.det(Q)


def hexagon(half: float, radius: float) -> np.ndarray:
    """Three pairs of points on a circle, `half` from the middle of the pair, in rad."""
    angles = np.array([2 * np.pi * k / 3 + s * half for k in range(3) for s in (-1, 1)])
    return radius * np.stack([np.cos(angles), np.sin(angles), 0 * angles], axis=1)


def general(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Random points of base and platform."""
    base, platform = rng.normal(size=(2, 6, 3))
    return base, platform


def hexagons(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Those of a common motion platform, of random proportions."""
    base = hexagon(rng.uniform(0.1, 0.5), 1.0)[[1, 0, 3, 2, 5, 4]]
    return base, hexagon(rng.uniform(0.1, 0.5), rng.uniform(0.4, 0.9))


class Tally:
    """Times by name, and what was found."""

    def __init__(self) -> None:
        self.times: dict[str, list[float]] = {}
        self.modes: list[PlatformModes] = []

    def take(self, name: str, run: Callable[[], Any]) -> Any:
        """Time a call."""
        ms, result = timed(run)
        self.times.setdefault(name, []).append(ms)
        if isinstance(result, PlatformModes):
            self.modes.append(result)
        return result

    def medians(self) -> dict[str, float]:
        return {name: statistics.median(times) for name, times in self.times.items()}

    def counts(self) -> dict[str, float]:
        """Shares of calls, in which nothing was left open."""
        whole = [m.completeness is Completeness.certified for m in self.modes]
        expected = [m.completeness is Completeness.expected for m in self.modes]
        return {
            "calls": len(self.modes),
            "certified": sum(whole),
            "expected": sum(expected),
            "paths_lost": sum(m.lost for m in self.modes),
            "modes_not_proved": sum(int(np.sum(~m.certified)) for m in self.modes),
        }


def measured_class(draw: Callable[[np.random.Generator], Any], platforms: int) -> dict[str, Any]:
    """Times for random platforms of a class."""
    rng, tally = np.random.default_rng(1), Tally()
    for _ in range(platforms):
        base, platform = draw(rng)
        R, p = random_rotation(rng), rng.normal(size=3)
        lengths = lengths_at(base, platform, R, p)
        one_off = SixLegPlatform(base, platform)
        known = SixLegPlatform(base, platform)
        tally.take("any_platform_ms", lambda b=base, a=platform, L=lengths: _modes(b, a, L))
        tally.take("own_start_set_ms", lambda k=known, L=lengths: k.prepare(L))
        one_off.modes(lengths)
        new = lengths_at(base, platform, R, p + 0.2 * rng.normal(size=3))
        tally.take("known_platform_new_lengths_ms", lambda k=known, L=new: k.modes(L))
        x = one_off._legs.section(lengths, one_off._legs.squares(lengths))
        found = known.modes(lengths).certificates.x
        tally.take(
            "certification_ms", lambda s=x, z=found: certify(PATTERN, s.proof, s.errors, z).distinct
        )
        legs = one_off._legs
        goal = generic_start().target(legs.rows_with(legs.squares(lengths)))
        start = generic_start().start
        tally.take(
            "tracking_ms", lambda g=goal, s=start: track(PATTERN, s.entries, g, s.x, light=LIGHT)
        )
    ms = tally.medians()
    ratio = ms["any_platform_ms"] / ms["known_platform_new_lengths_ms"]
    return {**ms, "any_to_known_ratio": ratio, **tally.counts()}


def _modes(base: np.ndarray, platform: np.ndarray, lengths: np.ndarray) -> PlatformModes:
    return SixLegPlatform(base, platform).modes(lengths)


def dietmaier(times: int = 25) -> dict[str, Any]:
    """The platform with 40 real modes."""
    case = json.loads(DIETMAIER.read_text("utf-8"))["cases"][0]
    base, platform, lengths = (np.array(case[k]) for k in ("base", "platform", "lengths"))
    tally, known = Tally(), SixLegPlatform(base, platform)
    known.prepare(lengths)
    for _ in range(times):
        modes = tally.take("any_platform_ms", lambda: _modes(base, platform, lengths))
        tally.take("known_platform_ms", lambda: known.modes(lengths))
    return {**tally.medians(), "modes": len(modes.poses), **tally.counts()}


def measured(platforms: int) -> dict[str, Any]:
    """All figures."""
    for draw in (general, hexagons):
        measured_class(draw, 2)  # loads the machine code
    return {
        "general": measured_class(general, platforms),
        "two_hexagons": measured_class(hexagons, platforms),
        "dietmaier": dietmaier(),
    }


def printed(result: dict[str, Any]) -> None:
    """The figures as text."""
    for group, figures in result.items():
        print(group)
        for name, value in figures.items():
            text = f"{value:.4g}" if isinstance(value, float) else value
            print(f"  {name:<34}{text}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    parser.add_argument("--platforms", type=int, default=PLATFORMS, help="how many of each class")
    options = parser.parse_args()
    result = measured(options.platforms)
    if options.json:
        print(json.dumps(result))
    else:
        printed(result)


if __name__ == "__main__":
    main()
