"""The isotropic point of the Orthoglide, and the cube around it with bounded velocity factors.

Factors between 1/2 and 2 are asked for: the platform moves at most twice as fast, and at least half
as fast, as the motors, in every direction. On the diagonal p = τ (1, 1, 1) from the isotropic point
the factors are 1 / |1 + 2λ| and twice 1 / |1 - λ| with λ = τ / √(D² - 2τ²). They are in bounds for
-1/4 ≤ λ ≤ 1/2. With the name of a file a map over x and y is drawn too, the worst over the cube's
z.
"""

import sys
from math import sqrt
from pathlib import Path

import numpy as np

from gough import load, view

A, D = 0.6, 0.31058  # where the slides meet, and the length of the bars, m
LOW, HIGH = -D / (3 * sqrt(2)), D / sqrt(6)
robot = load("orthoglide", a=A, D4=D)


def diagonal() -> None:
    tau = np.array([LOW, 0.0, HIGH])
    found = robot.workspace_map(x=tau, y=tau, z=A + tau)
    for k, name in enumerate(("Q-", "K", "Q+")):
        here = found.isel(x=k, y=k, z=k)
        factors = " ".join(f"{factor:.6f}" for factor in here.velocity_factors.values)
        condition = float(here.conditioning)
        print(f"{name:2}  τ = {tau[k]:+.6f} m  factors {factors}  condition {condition:.4f}")


def cube() -> None:
    axis = np.union1d(np.linspace(LOW, HIGH, 20), 0.0)  # motors turn back at x = y = 0
    factors = robot.workspace_map(x=axis, y=axis, z=A + axis).velocity_factors
    print(f"edge {HIGH - LOW:.6f} m = {(HIGH - LOW) / D:.5f} D")
    low, high = float(factors.min()), float(factors.max())
    print(f"factors over {factors.sizes['x']}³ points: {low:.6f} to {high:.6f}")
    x = np.stack(np.meshgrid(axis, axis, A + axis), axis=-1)
    slide = robot.inverse_geometry(x)[..., robot.position_names.index("leg1.slide")]
    print(f"travel of a motor {np.ptp(slide):.6f} m = {np.ptp(slide) / D:.5f} D")


def picture(file: str) -> None:
    axis, z = np.linspace(-0.8 * D, 0.8 * D, 97), A + np.linspace(LOW, HIGH, 21)
    found = robot.workspace_map(["velocity_factors"], x=axis, y=axis, z=z)
    factors = found.velocity_factors.transpose("factor", "z", "y", "x")
    smallest = factors[0].min("z", skipna=False).values
    largest = factors[2].max("z", skipna=False).values
    ratios = [
        view.Ratio("smallest factor", smallest, grows=False, octaves=True),
        view.Ratio("largest factor", largest, grows=True, octaves=True),
    ]
    marks = view.Marks(isotropic=(0.0, 0.0), square=((LOW, LOW), (HIGH, HIGH)))
    drawn = view.draw_ratios(axis, axis, ratios, ("x (m)", "y (m)"), marks)
    Path(file).write_bytes(view.png(drawn))


if __name__ == "__main__":
    diagonal()
    cube()
    if len(sys.argv) > 1:
        picture(sys.argv[1])
