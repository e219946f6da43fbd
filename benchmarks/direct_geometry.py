"""Direct geometry by steps of one kernel: ``python -m benchmarks.direct_geometry`` [--json].

A 6-UPS platform, its pose wanted for given leg lengths. Starts are off by about 1 % of the size of
the platform. Figures that are compared are taken in turns, and medians are given.
"""

from __future__ import annotations

import argparse
import json
import statistics
import timeit
from dataclasses import dataclass
from functools import partial
from typing import Any

import casadi
import numpy as np

from benchmarks import six_ups
from benchmarks.kernels import Repeated, in_turns, printed
from gough.kernels import Kernel
from gough.kernels.native.machine import host
from gough.kernels.solves import lu_solve_with_determinant
from gough.kernels.threading import cores
from gough.numerics.batch_newton import solve_batch
from gough.numerics.newton import Ending
from gough.numerics.stepping import ENDINGS, StepEnding, Stepper, step_batch

SX = casadi.SX
ROWS = (10_000, 200_000)
"""Poses in a batch: in the caches, and beyond them."""
SAMPLES = 25
CALLS = 2000
"""Single calls in one sample."""
DISPLACED = 0.01
"""Starts are off by up to this, m and rad."""


def anchors() -> np.ndarray:
    """Of each leg its point in the base and in the platform, one after the other, (36,), in m."""
    return np.concatenate(
        [[leg.anchor_base, leg.anchor_platform] for leg in six_ups.legs()]
    ).ravel()


@dataclass
class Equations:
    """Loop equations of a pose x = (position, quaternion wxyz), (7,).

    r_i = (|l_i|² - a_i²) / 2 in m², with l_i = p + R b_i - a_i the vector along leg i and a_i its
    length; J is their derivative by the platform's twist (linear at its origin, angular) in base
    axes, with the rows (l_i, R b_i × l_i).
    """

    x: SX
    lengths: SX
    points: SX

    def __post_init__(self) -> None:
        R = six_ups.rotation(self.x[3:])
        r, J = [], []
        for k in range(6):
            base, platform = self.points[6 * k : 6 * k + 3], self.points[6 * k + 3 : 6 * k + 6]
            arm = R @ platform
            along = self.x[:3] + arm - base
            r.append((casadi.sumsqr(along) - self.lengths[k] ** 2) / 2)
            J.append(casadi.horzcat(along.T, casadi.cross(arm, along).T))
        self.r, self.J = casadi.vertcat(*r), casadi.vertcat(*J)

    @property
    def gap(self) -> SX:
        """max |r|, and NaN where an entry is: a largest number alone may lose it."""
        largest = SX(0)
        for k in range(6):
            largest = casadi.fmax(largest, casadi.fabs(self.r[k]))
        return largest + 0 * casadi.sum1(self.r)


def retracted(x: SX, step: SX) -> SX:
    """The pose that a twist in base axes leads to."""
    w, v, half = x[3], x[4:], step[3:] / 2
    q = casadi.vertcat(w - casadi.dot(half, v), v + w * half + casadi.cross(half, v))
    return casadi.vertcat(x[:3] + step[:3], q / casadi.sqrt(casadi.sumsqr(q)))


def step_kernel() -> Kernel:
    """One Newton step: pose (7), lengths (6), anchors (36) -> pose, gap, determinant (9)."""
    x, a, p = SX.sym("x", 7), SX.sym("a", 6), SX.sym("p", 36)
    equations = Equations(x, a, p)
    step, d = lu_solve_with_determinant(equations.J, -equations.r)
    output = casadi.vertcat(retracted(x, step), equations.gap, d)
    return Kernel("step", {"x": x, "a": a, "p": p}, output, (9,))


def newton_kernels() -> tuple[Kernel, Kernel, Kernel]:
    """Residual, Jacobian and retraction of the same equations, for `solve_batch`."""
    x, a, v = SX.sym("x", 7), SX.sym("a", 6), SX.sym("v", 6)
    equations = Equations(x, a, SX(anchors()))
    given = {"x": x, "a": a}
    return (
        Kernel("r", given, equations.r, (6,)),
        Kernel("J", given, equations.J, (6, 6)),
        Kernel("retraction", {"x": x, "v": v}, retracted(x, v), (7,)),
    )


def lengths(poses: np.ndarray) -> np.ndarray:
    """Leg lengths of poses (rows, 7), (rows, 6), in m."""
    x = SX.sym("x", 7)
    squares = 2 * Equations(x, SX(6, 1), SX(anchors())).r
    return np.sqrt(Kernel("squares", {"x": x}, squares, (6,))(poses))


def data(rows: int, seed: int = 0, displaced: float = DISPLACED) -> tuple[np.ndarray, ...]:
    """Poses near the middle of the workspace, their leg lengths, and starts near the poses."""
    rng = np.random.default_rng(seed)
    poses = six_ups.states(rows, seed)[:, [4, 5, 6, 0, 1, 2, 3]]
    starts = poses + displaced * rng.uniform(-1, 1, size=(rows, 7)) * [1, 1, 1, 0, 0.5, 0.5, 0.5]
    starts[:, 3:] /= np.linalg.norm(starts[:, 3:], axis=1)[:, None]
    return poses, lengths(poses), starts


def batch(rows: int) -> dict[str, Any]:
    """Many poses at once, ns for a pose."""
    step, (residual, jacobian, retraction) = step_kernel(), newton_kernels()
    poses, a, starts = data(rows)
    wide, scalar = step.addresses.wide, step.addresses.scalar
    steps = partial(step_batch, wide, scalar, starts, a, anchors())
    damped = partial(
        solve_batch, residual.addresses.wide, jacobian.addresses.wide, starts, a, 6,
        retraction=retraction.addresses.wide, x_scale=np.ones(6),
    )  # fmt: skip
    runs = {
        f"{name}, {label}": partial(solve, threads=threads)
        for name, solve in (("steps", steps), ("solve_batch", damped))
        for label, threads in (("1 thread", 1), (f"{cores()} threads", cores()))
    }
    found, other = steps(), damped()
    closed = found.ended(StepEnding.closed)
    return {
        "ns_per_solution": in_turns(runs, rows),
        "closed": float(closed.mean()),
        "steps": float(found.steps[closed].mean()),
        "largest_error": float(abs(found.x - poses)[closed].max()),
        "solve_batch_closed": float(other.ended(Ending.closed).mean()),
        "solve_batch_steps": float(other.steps.mean()),
    }


def kernel_alone() -> dict[str, Any]:
    """One call of the step kernel, ns for a row."""
    kernel, rows = step_kernel(), 128
    _, a, starts = data(rows)
    operands = [starts, a, np.tile(anchors(), (rows, 1))]
    runs = {
        "wide": Repeated(kernel, host().width, 100).on(operands, 9),
        "scalar": Repeated(kernel, 1, 100).on(operands, 9),
    }
    return {"operations": kernel.tape.counts()["total"], "ns_per_row": in_turns(runs, 100 * rows)}


def single() -> dict[str, float]:
    """One call of a `Stepper` from Python, array in, array out, µs; many different starts."""
    kernel = step_kernel()
    _, a, starts = data(CALLS, seed=1)
    pairs = [(start.copy(), own.copy()) for start, own in zip(starts, a, strict=True)]
    found = {}
    for name, address in zip(("scalar", "wide"), kernel.addresses, strict=True):
        stepper = Stepper(address, 7, 6, anchors())
        assert all(ENDINGS[stepper(*pair)[1]] is StepEnding.closed for pair in pairs[:100])

        def run(stepper: Stepper = stepper) -> None:
            for start, own in pairs:
                stepper(start, own)

        found[name] = statistics.median(timeit.repeat(run, number=1, repeat=SAMPLES)) / CALLS * 1e6
    return found


def measured() -> dict[str, Any]:
    """All figures."""
    return {
        "processor": host().cpu,
        "lanes": host().width,
        "step_kernel": kernel_alone(),
        "rows": {str(rows): batch(rows) for rows in ROWS},
        "us_per_single_call": single(),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    options = parser.parse_args()
    result = measured()
    if options.json:
        print(json.dumps(result))
    else:
        printed(result)


if __name__ == "__main__":
    main()
