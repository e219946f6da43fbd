"""What dynamics cost: ``python -m benchmarks.dynamics`` [--json] [--peers].

Inverse and direct models as `robot.inverse_dynamics` and `robot.direct_dynamics` call them, with
pivoting and the guard that tells singular rows. Beside gough-stewart's stand the models of
six_ups.py, written by hand, for the same numbers; with --peers the answers of Pinocchio for the
catalogue's gough-stewart. Models have to agree before they are timed. Figures that are compared
are taken in turns on one thread, and medians are given.
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

import gough
from benchmarks import six_ups
from benchmarks.kernels import Repeated, in_turns, printed
from gough.description import Mechanism
from gough.kernels import Kernel
from gough.kernels.native.machine import host

Array = NDArray[np.float64]

ROWS = {10_000: 2, 64: 300}
"""Rows of a batch, and how often one sample repeats them: in the caches, and in the nearest."""
CALLS = 500
"""Single calls in one sample."""
AWAY = 0.05
"""States are off home by up to this, m and rad."""
HAND, PEERS = 1e-10, 1e-8
"""Largest difference that passes, as a part of the largest number."""
IN_BATCHES = "pinocchio in batches"
"""Name of its figures where numpy's part works on many rows at once."""
KINDS = ("inverse", "direct")
NEW = 3
"""Processes that make models anew, and as many that find them in the cache."""
ROBOTS = {
    "gough-stewart": "gough.load('gough-stewart')",
    "orthoglide": "gough.load('orthoglide')",
    "thin orthoglide": "dynamics.thin_orthoglide()",
    "delta-parallelogram": "gough.load('delta-parallelogram')",
    "3-rrr": "gough.load('3-rrr')",
}


# robots


def thin_orthoglide() -> gough.Robot:
    """The orthoglide with thin uniform bars."""
    from tests.dynamics import test_operations

    return test_operations.thin_orthoglide()


def hand_derived_robot() -> gough.Robot:
    """The catalogue's gough-stewart with the numbers of six_ups."""
    content = gough.load("gough-stewart").mechanism.model_dump(exclude_unset=True)
    legs, platform = six_ups.legs(), six_ups.Platform()
    content["gravity"] = six_ups.GRAVITY.tolist()
    content["parameters"] |= {name: {"value": 0.0} for name in ("x", "y", "rx", "ry", "rz")}
    content["parameters"] |= {
        "z": {"value": 1.1},
        "foot": {"value": [leg.anchor_base[:2].tolist() for leg in legs]},
        "tip": {"value": [leg.anchor_platform[:2].tolist() for leg in legs]},
        "turn": {"value": [float(leg.turn) for leg in legs]},
    }
    inertia = np.diag(platform.inertia).tolist()
    content["bodies"]["platform"] |= {"mass": platform.mass, "inertia": inertia}
    leg = content["legs"]["leg"]
    leg["parameters"] |= {
        "B": {"value": ["foot[i][0]", "foot[i][1]"]},
        "A": {"value": ["tip[i][0]", "tip[i][1]"]},
        "ex": {"value": "cos(turn[i])*dx + sin(turn[i])*dy"},
        "ey": {"value": "cos(turn[i])*dy - sin(turn[i])*dx"},
    }
    leg["joints"]["foot"] |= {
        "frames": [{"point": "B", "rotate": [["z", "turn[i]"]]}, {}],
        "home": ["atan2(-ey, dz)", "atan2(ex, sqrt(ey**2 + dz**2))"],
    }
    leg["joints"]["tip"].pop("home")
    leg["bodies"] = _leg_bodies(legs[0])
    return gough.Robot(Mechanism.model_validate(content))


def _leg_bodies(leg: six_ups.Leg) -> dict[str, Any]:
    """Cylinder and rod with the sum of inertia that the hand-written models know."""
    rod = 0.1 * leg.inertia
    at_foot = leg.masses[0] * leg.centre_cylinder**2 * np.array([1.0, 1.0, 0.0])
    cylinder = leg.inertia - rod - at_foot
    return {
        "cylinder": {
            "mass": leg.masses[0],
            "com": [0, 0, leg.centre_cylinder],
            "inertia": cylinder.tolist(),
        },
        "rod": {
            "mass": leg.masses[1],
            "com": [0, 0, -leg.centre_rod],
            "inertia": rod.tolist(),
        },
    }


# states


@dataclass
class States:
    """Motions of a robot near home, and the efforts that they take."""

    robot: gough.Robot
    x: Array
    xd: Array
    xdd: Array

    @classmethod
    def of(cls, robot: gough.Robot, rows: int) -> States:
        rng, home = np.random.default_rng(0), robot.home.x
        x = home + AWAY * rng.uniform(-1, 1, size=(rows, len(home)))
        if len(home) == 7:
            x[:, 3:] /= np.linalg.norm(x[:, 3:], axis=1)[:, None]
        outputs = len(robot.structure.columns("operational"))
        return cls(robot, x, *rng.normal(size=(2, rows, outputs)))

    @cached_property
    def tau(self) -> Array:
        return self.robot.inverse_dynamics(self.x, self.xd, self.xdd)

    def kernel(self, kind: str) -> Kernel:
        return self.robot.dynamics.model("platform").kernel(kind, "x")

    def given(self, kind: str) -> list[Array]:
        """Arguments of a kernel."""
        last = self.xdd if kind == "inverse" else self.tau
        return [np.ascontiguousarray(a) for a in (self.x, self.xd, last)]

    def calls(self, kind: str) -> list[tuple[Array, ...]]:
        """Arguments of many single calls, arrays of their own."""
        rows = zip(*self.given(kind), strict=True)
        return [tuple(a.copy() for a in row) for row, _ in zip(rows, range(CALLS), strict=False)]


def compared(found: Array, expected: Array, within: float, what: str) -> float:
    """The largest difference as a part of the largest number.

    Raises:
        ArithmeticError: it is too large.
    """
    difference = float(np.abs(found - expected).max() / np.abs(expected).max())
    if not difference <= within:
        raise ArithmeticError(f"{what}: answers differ by {difference:.1e}")
    return difference


# figures


def repeated(kernel: Kernel, given: list[Array], times: int) -> dict[str, Callable[[], None]]:
    """Machine code in wide registers and on single numbers, by name."""
    numbers = int(np.prod(kernel.shape))
    return {
        name: Repeated(kernel, width, times).on(given, numbers)
        for name, width in ((f"{host().width} lanes", host().width), ("scalar", 1))
    }


def per_row(programs: dict[str, tuple[Kernel, list[Array]]]) -> dict[str, dict[str, float]]:
    """ns for a row of all programs, in turns, for every size of batch."""
    found = {}
    for rows, times in ROWS.items():
        runs = {}
        for name, (kernel, given) in programs.items():
            part = [array[:rows] for array in given]
            for width, run in repeated(kernel, part, times).items():
                runs[f"{name}, {width}"] = run
        found[f"{rows} rows"] = in_turns(runs, rows * times)
    return found


def single(runs: dict[str, tuple[Callable[..., Any], list[tuple[Array, ...]]]]) -> dict[str, float]:
    """One call from Python on many different states, ns, all taken in turns."""

    def over(call: Callable[..., Any], states: list[tuple[Array, ...]]) -> None:
        for state in states:
            call(*state)

    return in_turns({name: partial(over, *run) for name, run in runs.items()}, CALLS)


def robot_figures(name: str) -> dict[str, Any]:
    """What the models of one robot cost."""
    robot = eval(ROBOTS[name], {"gough": gough, "dynamics": sys.modules[__name__]})
    states = States.of(robot, max(ROWS))
    programs = {kind: (states.kernel(kind), states.given(kind)) for kind in KINDS}
    compared(robot.direct_dynamics(*states.given("direct")), states.xdd, PEERS, name)
    faces: dict[str, Callable[[], Any]] = {
        f"{kind}, numpy": partial(kernel, *given, threads=1)
        for kind, (kernel, given) in programs.items()
    }
    calls = {
        f"robot.{kind}_dynamics": (getattr(robot, f"{kind}_dynamics"), states.calls(kind))
        for kind in KINDS
    }
    return {
        "operations": {kind: states.kernel(kind).tape.counts() for kind in KINDS},
        "ns_per_row": per_row(programs) | {"numpy, 10000 rows": in_turns(faces, max(ROWS))},
        "ns_per_single_call": single(calls),
        "making_ms": made(ROBOTS[name]),
    }


def beside_hand_derived() -> dict[str, Any]:
    """The models of a 6-UPS platform beside those written by hand, for the same numbers."""
    states = States.of(hand_derived_robot(), max(ROWS))
    by_hand = {"inverse": six_ups.kernel(), "direct": six_ups.direct_kernel()}
    programs: dict[str, tuple[Kernel, list[Array]]] = {}
    found: dict[str, Any] = {}
    for kind, written in by_hand.items():
        kernel, (x, xd, last) = states.kernel(kind), states.given(kind)
        rows = np.hstack([x[:, 3:], x[:, :3], xd, last])
        own = kernel(x, xd, last)[:, :-1]
        programs |= {kind: (kernel, [x, xd, last]), f"{kind}, by hand": (written, [rows])}
        found[kind] = {
            "largest_difference": compared(written(rows), own, HAND, f"{kind}, by hand"),
            "operations": kernel.tape.counts()["total"],
            "operations_by_hand": written.tape.counts()["total"],
        }
    ns = per_row(programs)
    ratios = {kind: _to_hand_derived(kind, ns) for kind in KINDS}
    return found | {"ratios": ratios, "ns_per_row": ns}


def _to_hand_derived(kind: str, ns: dict[str, dict[str, float]]) -> dict[str, float]:
    """The model's time over that of the one by hand, by size of batch and lanes."""
    return {
        f"{size}, {width}": times[f"{kind}, {width}"] / times[f"{kind}, by hand, {width}"]
        for size, times in ns.items()
        for width in (f"{host().width} lanes", "scalar")
    }


# making of models

CHILD = """
import time
import numpy as np
import gough.dynamics.dynamics, gough.geometry.inverse, gough.kernels.native.compilation
from benchmarks import dynamics
robot = {expression}
x = robot.home.x
zero = np.zeros(len(robot.structure.columns("operational")))
start = time.perf_counter()
tau = robot.inverse_dynamics(x, zero, zero)
middle = time.perf_counter()
robot.direct_dynamics(x, zero, tau)
print(1e3 * (middle - start), 1e3 * (time.perf_counter() - middle))
"""


def made(expression: str) -> dict[str, dict[str, float]]:
    """To the first results in a new process, imports done and home closed; medians in ms."""
    with tempfile.TemporaryDirectory() as kept:
        _child(expression, kept)
        warm = [_child(expression, kept) for _ in range(NEW)]
    return {"first time": _medians(_anew(expression)), "from the cache": _medians(warm)}


def _anew(expression: str) -> Iterator[list[float]]:
    for _ in range(NEW):
        with tempfile.TemporaryDirectory() as folder:
            yield _child(expression, folder)


def _medians(runs: Any) -> dict[str, float]:
    columns = zip(*runs, strict=True)
    return dict(zip(KINDS, (statistics.median(column) for column in columns), strict=True))


def _child(expression: str, cache: str) -> list[float]:
    done = subprocess.run(
        [sys.executable, "-c", CHILD.format(expression=expression)],
        env={**os.environ, "GOUGH_CACHE_DIR": cache},
        capture_output=True,
        text=True,
        check=True,
    )
    return [float(x) for x in done.stdout.split()[-2:]]


# Pinocchio


def beside_pinocchio() -> dict[str, Any]:
    """gough-stewart from Python, a call at a time and by rows."""
    import pinocchio

    from benchmarks.pinocchio_six_ups import PinocchioSixUps

    robot = gough.load("gough-stewart")
    states, peer = States.of(robot, max(ROWS)), PinocchioSixUps(robot)
    pairs = {
        "inverse": (robot.inverse_dynamics, peer.inverse),
        "direct": (robot.direct_dynamics, peer.direct),
    }
    found: dict[str, Any] = {"version": pinocchio.__version__}
    for kind, (own, other) in pairs.items():
        given, calls = states.given(kind), states.calls(kind)
        few = [array[:CALLS] for array in given]
        expected = own(*few)
        one_by_one = np.array([other(*call) for call in calls])
        compared(one_by_one, expected, PEERS, f"{kind}, Pinocchio")
        found[kind] = {
            "largest_difference": compared(other(*few), expected, PEERS, f"{kind}, Pinocchio"),
            "ns_per_single_call": single(
                {"gough": (own, calls), "pinocchio": (other, calls)} | _bare(peer, kind, calls)
            ),
            "ns_per_row": per_row({"gough": (states.kernel(kind), given)})["10000 rows"]
            | in_turns({"gough, numpy": partial(states.kernel(kind), *given, threads=1)}, max(ROWS))
            | in_turns({IN_BATCHES: partial(other, *few)}, CALLS),
        }
        found[kind]["ratios"] = _ratios(found[kind])
    return found


def _bare(peer: Any, kind: str, calls: list[tuple[Array, ...]]) -> dict[str, Any]:
    """Pinocchio's function alone, all that it takes being ready."""
    ready = []
    for x, xd, last in calls:
        state = peer.state(x, xd)
        own = peer.accelerations(state, xd, last) if kind == "inverse" else peer.of_motors(last)
        ready.append((state.q, state.v, own))
    if kind == "direct":
        return {"constraintDynamics alone": (peer.constrained, ready)}
    rnea, model, data = sys.modules["pinocchio"].rnea, peer.model, peer.data
    return {"rnea alone": (lambda q, v, a: rnea(model, data, q, v, a), ready)}


def _ratios(figures: dict[str, Any]) -> dict[str, dict[str, float]]:
    """Pinocchio's time over gough's: for one call, and for one row of a batch.

    A row of gough's is one in wide registers or, by numpy, one of the batched function; a row of
    Pinocchio's is one call, but for the last, where numpy's part works on batches.
    """
    calls, row = dict(figures["ns_per_single_call"]), figures["ns_per_row"]
    own, batches = calls.pop("gough"), {IN_BATCHES: row[IN_BATCHES]}
    wide, by_numpy = row[f"gough, {host().width} lanes"], row["gough, numpy"]
    return {
        "single_call": {name: ns / own for name, ns in calls.items()},
        "row": {name: ns / wide for name, ns in (calls | batches).items()},
        "row_by_numpy": {name: ns / by_numpy for name, ns in (calls | batches).items()},
    }


def measured(peers: bool) -> dict[str, Any]:
    """All figures."""
    found: dict[str, Any] = {
        "processor": host().cpu,
        "lanes": host().width,
        "load_before": os.getloadavg()[0],
        "beside_hand_derived": beside_hand_derived(),
        "robots": {name: robot_figures(name) for name in ROBOTS},
    }
    if peers:
        found["beside_pinocchio"] = beside_pinocchio()
    return found | {"load_after": os.getloadavg()[0]}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    parser.add_argument("--peers", action="store_true", help="compare with Pinocchio")
    options = parser.parse_args()
    result = measured(options.peers)
    if options.json:
        print(json.dumps(result))
    else:
        printed(result)


if __name__ == "__main__":
    main()
