"""What direct geometry costs: ``python -m benchmarks.direct_geometry`` [--json].

The robot is gough-stewart of the catalogue; `robot.direct_geometry` is asked for its pose at given
leg lengths, from starts that are off by about 1 % of its size. Beside it stand the steps of a
kernel written out for such a platform, and damped Newton steps by three kernels. Figures that are
compared are taken in turns, and medians are given.
"""

from __future__ import annotations

import argparse
import json
import statistics
import timeit
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import casadi
import numpy as np

import gough
from benchmarks import six_ups
from benchmarks.kernels import Repeated, in_turns, printed
from gough.geometry.direct_steps import PlatformNewton
from gough.kernels import Kernel
from gough.kernels.native.machine import host
from gough.kernels.solves import lu_solve_with_determinant
from gough.kernels.threading import cores
from gough.numerics.batch_newton import solve_batch
from gough.numerics.newton import Ending
from gough.numerics.stepping import ENDINGS, StepEnding, Stepper, step_batch

SX = casadi.SX
ROBOT = "gough-stewart"
ROWS = (10_000, 200_000)
"""Poses in a batch: in the caches, and beyond them."""
SAMPLES = 25
CALLS = 2000
"""Single calls in one sample."""
DISPLACED = 0.01
"""Starts are off by up to this, m and rad."""
WORKSPACE = 0.1
"""Poses of the robot are off home's by up to this, m and rad."""


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
        """|r|: a root of a sum of squares keeps a NaN, which a largest number may lose."""
        return casadi.norm_2(self.r)


def retracted(x: SX, step: SX) -> SX:
    """The pose that a twist in base axes leads to."""
    w, v, half = x[3], x[4:], step[3:] / 2
    q = casadi.vertcat(w - casadi.dot(half, v), v + w * half + casadi.cross(half, v))
    return casadi.vertcat(x[:3] + step[:3], q / casadi.sqrt(casadi.sumsqr(q)))


def step_kernel() -> Kernel:
    """One Newton step: pose (7), lengths (6), anchors (36) -> pose, gap, determinant, size (10)."""
    x, a, p = SX.sym("x", 7), SX.sym("a", 6), SX.sym("p", 36)
    equations = Equations(x, a, p)
    step, d = lu_solve_with_determinant(equations.J, -equations.r)
    output = casadi.vertcat(retracted(x, step), equations.gap, d, casadi.norm_2(step))
    return Kernel("step", {"x": x, "a": a, "p": p}, output, (10,))


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


@dataclass
class Asked:
    """What a robot is asked for: poses, their actuated positions, and starts near them."""

    robot: gough.Robot
    poses: np.ndarray
    q_actuated: np.ndarray
    near: np.ndarray

    @classmethod
    def of(cls, rows: int, seed: int = 0) -> Asked:
        robot, rng = gough.load(ROBOT), np.random.default_rng(seed)
        poses = moved(np.tile(robot.home.x, (rows, 1)), WORKSPACE, rng)
        q = robot.inverse_geometry(poses)
        lengths = robot._direct.direct.actuated.of(q)
        return cls(robot, poses, lengths, moved(poses, DISPLACED, rng))


def moved(poses: np.ndarray, far: float, rng: np.random.Generator) -> np.ndarray:
    """Poses off others by up to ``far``, m and rad in each direction, (rows, 7)."""
    by = far * rng.uniform(-1, 1, size=(len(poses), 7)) * [1, 1, 1, 0, 0.5, 0.5, 0.5]
    found = poses + by
    found[:, 3:] /= np.linalg.norm(found[:, 3:], axis=1)[:, None]
    return found


def batch(rows: int) -> dict[str, Any]:
    """Many poses at once, ns for a pose."""
    asked, step, (residual, jacobian, retraction) = Asked.of(rows), step_kernel(), newton_kernels()
    _, a, starts = data(rows)
    robot = partial(asked.robot._direct.solve, asked.q_actuated, asked.near)
    steps = partial(step_batch, step, starts, a, anchors())
    damped = partial(
        solve_batch, residual.addresses.wide, jacobian.addresses.wide, starts, a, 6,
        retraction=retraction.addresses.wide, x_scale=np.ones(6),
    )  # fmt: skip
    runs: dict[str, Callable[[], Any]] = {
        "direct_geometry": partial(asked.robot.direct_geometry, asked.q_actuated, asked.near)
    }
    runs |= {
        f"{name}, {label}": partial(solve, threads=threads)
        for name, solve in (("robot", robot), ("steps", steps), ("solve_batch", damped))
        for label, threads in (("1 thread", 1), (f"{cores()} threads", cores()))
    }
    own, found, other = asked.robot.direct_geometry(asked.q_actuated, asked.near), steps(), damped()
    return {
        "ns_per_solution": in_turns(runs, rows),
        "direct_geometry_largest_error": float(abs(own - asked.poses).max()),
        "steps_closed": float(found.ended(StepEnding.closed).mean()),
        "steps_mean": float(found.steps.mean()),
        "solve_batch_closed": float(other.ended(Ending.closed).mean()),
        "solve_batch_mean": float(other.steps.mean()),
    }


def kernel_alone() -> dict[str, Any]:
    """One call of each step kernel, ns for a row."""
    rows = 128
    asked, (_, a, starts) = Asked.of(rows), data(rows)
    newton = asked.robot._direct.newton
    assert isinstance(newton, PlatformNewton)
    own, written = newton.step, step_kernel()
    given = {
        "robot": (own, [asked.near, asked.q_actuated]),
        "written": (written, [starts, a, np.tile(anchors(), (rows, 1))]),
    }
    runs = {
        f"{name}, {kind}": Repeated(kernel, width, 100).on(operands, 10)
        for name, (kernel, operands) in given.items()
        for kind, width in (("wide", host().width), ("scalar", 1))
    }
    operations = {name: kernel.tape.counts()["total"] for name, (kernel, _) in given.items()}
    return {"operations": operations, "ns_per_row": in_turns(runs, 100 * rows)}


def single() -> dict[str, float]:
    """One call from Python, arrays in, array out, µs; many different starts."""
    asked, (_, a, starts) = Asked.of(CALLS, 1), data(CALLS, seed=1)
    stepper = Stepper(step_kernel(), 7, 6, anchors())
    robot = asked.robot
    given = {
        "direct_geometry": [
            (own.copy(), x.copy()) for own, x in zip(asked.q_actuated, asked.near, strict=True)
        ],
        "Stepper": [(x.copy(), own.copy()) for x, own in zip(starts, a, strict=True)],
    }
    assert all(robot._direct.quick(*pair) is not None for pair in given["direct_geometry"])
    assert all(ENDINGS[stepper(*pair)[1]] is StepEnding.closed for pair in given["Stepper"])
    calls = {"direct_geometry": robot.direct_geometry, "Stepper": stepper}
    found = {}
    for name, call in calls.items():

        def run(call: Callable[..., Any] = call, pairs: Any = given[name]) -> None:
            for pair in pairs:
                call(*pair)

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
