"""What simulation costs: ``python -m benchmarks.simulation`` [--json] [--peers] [--long].

One deployment of the catalogue's hexapod of 1 s, and ensembles of deployments in which every number
of the description is dispersed by ±10 %. With --peers SciPy's solve_ivp and SUNDIALS CVODE run the
same compiled kernel through a Python callback. Errors are those of the pose against runs at 1e-13.
Figures that are compared are taken in turns, and medians are given.
"""

from __future__ import annotations

import argparse
import ctypes
import json
import statistics
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

import gough
from benchmarks.kernels import printed
from gough.numerics.calling import call_tile, pointer_to
from gough.numerics.integration import Runs, Tolerances, integrate
from gough.simulation.ensemble import Ensemble, prepared
from gough.simulation.many import Many, ensemble_of
from gough.simulation.run import LOWEST
from gough.simulation.simulate import Request

Array = NDArray[np.float64]

HEXAPOD, SHARE = "deployable-hexapod", "±10 %"
TOLERANCES = (1e-6, 1e-10)
ROUNDS, ROWS, COMPARED = 15, 2048, 256
EVALUATIONS = 2000
POSE = 7


# one run


class Single:
    """One deployment at one tolerance, ready to be repeated.

    Args:
        variant: of the hexapod, or none.
        rtol: tolerance.
        locate: whether reversals are located; the library decides by default.
    """

    def __init__(self, variant: tuple[str, ...], rtol: float, locate: bool | None = None) -> None:
        simulator = gough.load(HEXAPOD, variants=variant).simulator
        runner = simulator.runner(Request(1.0, rtol=rtol, locate=locate))
        start = simulator.start(None, None)
        self.formulation = runner.formulations.first(start.q)
        self.start = runner.start_state(self.formulation, start)
        self.problem = self.formulation.problem(start.q, *runner.signals)
        switches = self.problem.switches
        self._given: dict[str, Any] = {"branches": np.ones((1, switches))}
        self.tolerances = Tolerances(
            rtol, np.array([rtol]), guard=LOWEST, exact=runner.formulations.setting.located
        )

    def run(self) -> Runs:
        """The run."""
        return integrate(self.problem, self.start[None], (0.0, 1.0), self.tolerances, **self._given)

    def rates(self) -> Callable[[float, Array], Array]:
        """The right-hand side as a Python function."""
        n, events = len(self.start), len(self.problem.events)
        code = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_void_p)(self.problem.address(1))
        given, found = np.ones(1 + n + self.problem.switches), np.empty(n + events)
        inside, outside = given.ctypes.data, found.ctypes.data

        def rates(t: float, y: Array) -> Array:
            given[0], given[1 : 1 + n] = t, y
            code(inside, outside)
            return found[:n].copy()

        rates.owner = self  # type: ignore[attr-defined]
        return rates


def peers(single: Single, rtol: float) -> dict[str, Callable[[], Array]]:
    """End states by other integrators on the same kernel, whose laws decide at reversals."""
    from scipy.integrate import solve_ivp
    from sksundae.cvode import CVODE

    f, y0 = single.rates(), single.start

    def ivp(method: str) -> Callable[[], Array]:
        return lambda: solve_ivp(f, (0.0, 1.0), y0, method, rtol=rtol, atol=rtol).y[:, -1]

    def rhs(t: float, y: Array, yp: Array) -> None:
        yp[:] = f(t, y)

    def cvode(method: str) -> Callable[[], Array]:
        solver = CVODE(rhs, method=method, rtol=rtol, atol=rtol, max_num_steps=100_000)
        return lambda: np.asarray(solver.solve(np.array([0.0, 1.0]), y0).y)[-1]

    return {
        "scipy LSODA": ivp("LSODA"),
        "scipy DOP853": ivp("DOP853"),
        "cvode adams": cvode("Adams"),
        "cvode bdf": cvode("BDF"),
    }


def in_turns(runs: dict[str, Callable[[], Any]], rounds: int = ROUNDS) -> dict[str, float]:
    """Median seconds of each, taken in turns."""
    taken: dict[str, list[float]] = {name: [] for name in runs}
    for run in runs.values():
        run()
    for _ in range(rounds):
        for name, run in runs.items():
            begun = time.perf_counter()
            run()
            taken[name].append(time.perf_counter() - begun)
    return {name: statistics.median(times) for name, times in taken.items()}


def single_runs(with_peers: bool) -> dict[str, Any]:
    """Time and error of one run, and ratios to others."""
    found: dict[str, Any] = {}
    for variant in ((), ("dispersed",)):
        exact = Single(variant, 1e-13, True).run().states[0, :POSE]
        for rtol in TOLERANCES:
            single = Single(variant, rtol)
            runs: dict[str, Callable[[], Any]] = {"gough": lambda s=single: s.run().states[0]}
            if with_peers:
                runs |= peers(Single(variant, rtol, False), rtol)
            times = in_turns(runs)
            entry: dict[str, Any] = {"evaluations": int(single.run().counts[0, 2])}
            for name, run in runs.items():
                entry[f"{name} [ms]"] = times[name] * 1e3
                entry[f"{name} error"] = float(np.abs(run()[:POSE] - exact).max())
                if name != "gough":
                    entry[f"{name} / gough"] = times[name] / times["gough"]
            found[f"{variant[0] if variant else 'symmetric'} at {rtol:g}"] = entry
    return found


# ensembles


@numba.njit  # type: ignore[untyped-decorator]
def repeated(code: int, given: Array, found: Array, times: int) -> None:
    """The kernel over a tile again and again."""
    for _ in range(times):
        call_tile(code, pointer_to(given, 0), pointer_to(found, 0))


def aligned(size: int) -> Array:
    """Zeros that begin at a line of the cache."""
    whole = np.zeros(size + 8)
    first = (-whole.ctypes.data // 8) % 8
    return whole[first : first + size]


def ensemble(rtol: float, locate: bool | None = None) -> Ensemble:
    """Deployments with every number dispersed."""
    request = Request(1.0, rtol=rtol, locate=locate)
    return ensemble_of(gough.load(HEXAPOD).mechanism, None, {}, request, Many(ROWS, SHARE))


def right_hand_side(rows: Any) -> dict[str, float]:
    """ns of an evaluation in a lane, far from the stops and at them, for one lane and eight."""
    values = rows.factors.values(rows.ensemble.design.rows(0, 8))
    held = rows._held(values)
    states, _ = rows._states(values, held)
    motion = rows.formulation.equations.motion
    prepared_numbers = motion.prepare(*[held[k] for k in motion.held])
    at_stops = rows._integrated(states, held).states
    found = {}
    for place, chosen in (("away", states), ("at the stops", at_stops)):
        ones = np.ones((8, motion.inputs.get("branches", 0)))
        lanes = np.concatenate([np.zeros((8, 1)), chosen, ones, prepared_numbers], axis=1)
        for width in (1, 8):
            given = aligned(lanes.shape[1] * width)
            given[:] = lanes[:width].T.ravel()
            out = aligned(width * len(motion.program.outputs))
            code = motion.address(width)
            run = lambda c=code, g=given, o=out: repeated(c, g, o, EVALUATIONS)  # noqa: E731
            seconds = in_turns({"run": run})["run"]
            found[f"{place}, {width} lanes [ns]"] = seconds / EVALUATIONS / width * 1e9
    return found


def ensembles() -> dict[str, Any]:
    """Runs a second on one core, their errors, and what they cost beside evaluations alone."""
    found: dict[str, Any] = {}
    exact = prepared(ensemble(1e-13, True)).rows(0, COMPARED)["pose"]
    for rtol, locate in ((1e-6, None), (1e-6, True), (1e-10, True)):
        rows = prepared(ensemble(rtol, locate))
        seconds = in_turns({"rows": lambda r=rows: r.rows(0, ROWS)}, 5)["rows"]
        got = rows.rows(0, ROWS)
        error = np.abs(got["pose"][:COMPARED] - exact).max(axis=1)
        cost = right_hand_side(rows)
        evaluations = float(got["counts"][:, 2].mean())
        dearest = evaluations * cost["at the stops, 8 lanes [ns]"] * 1e-9 * ROWS
        located = "located" if rows.runner.formulations.setting.located else "passed over"
        found[f"at {rtol:g}, reversals {located}"] = {
            "runs a second and core": ROWS / seconds,
            "evaluations a run": evaluations,
            "pose error, median": float(np.median(error)),
            "pose error, 95 %": float(np.quantile(error, 0.95)),
            "pose error, most": float(error.max()),
            "seconds / (evaluations x right-hand side)": seconds / dearest,
            **cost,
        }
    return found


def stored(long: bool) -> dict[str, Any]:
    """Runs a second on all cores with outputs in a store, by the number of runs."""
    robot, found = gough.load(HEXAPOD), {}
    robot.simulate(1.0, samples=256, vary=SHARE, rtol=1e-6, progress=False)
    for samples in (1_000, 10_000, 100_000, *((1_000_000,) if long else ())):
        with tempfile.TemporaryDirectory() as folder:
            begun = time.perf_counter()
            robot.simulate(
                1.0,
                samples=samples,
                vary=SHARE,
                rtol=1e-6,
                store=Path(folder) / "runs.zarr",
                progress=False,
            )
            seconds = time.perf_counter() - begun
        found[f"{samples} runs"] = {"seconds": seconds, "runs a second": samples / seconds}
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--peers", action="store_true")
    parser.add_argument("--long", action="store_true")
    asked = parser.parse_args()
    result = {
        "one run of 1 s": single_runs(asked.peers),
        "ensembles": ensembles(),
        "all cores, with a store": stored(asked.long),
    }
    if asked.json:
        print(json.dumps(result, indent=2))
    else:
        printed(result)


if __name__ == "__main__":
    main()
