"""How feet, legs and the model of the platform change the deployment of a hexapod.

With legs that have mass, universal feet make each leg turn about itself as the platform moves;
spherical feet do not, and the platform rises a little faster. The energy of rotation of the
platform is exact, of third order in its rotation vector, or as the paper prints it, with twice the
term of third order. With the name of a folder figures are drawn too.
"""

import sys
from pathlib import Path

import numpy as np

from gough import load, view

HEXAPOD = "deployable-hexapod"
NAMES = ["x", "y", "z", "turn about x", "turn about y", "turn about z"]


def outputs(run) -> np.ndarray:
    """Position and rotation vector of the platform, (6, times)."""
    position, quaternion = run.pose.values[:, :3], run.pose.values[:, 3:]
    half = np.linalg.norm(quaternion[:, 1:], axis=1, keepdims=True)
    angle = 2 * np.arctan2(half, quaternion[:, :1])
    turn = angle * quaternion[:, 1:] / np.where(half > 0, half, 1.0)
    return np.column_stack([position, turn]).T


def feet(folder: Path | None) -> None:
    names = ["spherical", "universal"]
    chosen = [["massive-legs", "spherical"], ["massive-legs", "universal-radial"]]
    time = np.linspace(0, 0.42, 211)
    runs = [load(HEXAPOD, variants=each).simulate(0.42, times=time) for each in chosen]
    z = np.array([run.pose.values[:, 2] for run in runs])
    at = int(np.argmin(np.abs(time - 0.4)))
    print("feet of legs with mass   z at 0.40 s      behind")
    for name, row in zip(names, z, strict=True):
        print(f"{name:<24} {row[at]:.6f} m {1e3 * (z[0, at] - row[at]):8.2f} mm")
    if folder:
        rate = np.array([run.twist.values[:, 2] for run in runs])
        shown = [view.Compared("z [m]", z), view.Compared("rate of z [m/s]", rate)]
        picture = view.draw_comparison(time, shown, names)
        (folder / "hexapod-feet.png").write_bytes(view.png(picture))


def models(folder: Path | None) -> None:
    names = ["exact", "truncated", "as-printed"]
    chosen = [["dispersed"], ["dispersed", "truncated"], ["dispersed", "as-printed"]]
    runs = [load(HEXAPOD, variants=each).simulate(1.0, times=1001) for each in chosen]
    x = np.array([outputs(run) for run in runs])
    print("\nlargest difference from exact   truncated   as printed")
    worst = 1e3 * np.abs(x[1:] - x[0]).max(axis=2)
    for name, unit, (a, b) in zip(NAMES, 3 * ["mm"] + 3 * ["mrad"], worst.T, strict=True):
        print(f"{name + ' [' + unit + ']':<28} {a:12.2f} {b:12.2f}")
    if folder:
        x[:, 3:] = np.rad2deg(x[:, 3:])
        units = 3 * ["m"] + 3 * ["°"]
        shown = [view.Compared(f"{NAMES[k]} [{units[k]}]", x[:, k]) for k in (0, 2, 3, 5)]
        picture = view.draw_comparison(runs[0].time.values, shown, names)
        (folder / "hexapod-models.png").write_bytes(view.png(picture))


if __name__ == "__main__":
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else None
    feet(folder)
    models(folder)
