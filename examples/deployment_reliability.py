"""What production scatter does to the deployment of a hexapod, and how likely it is to fail.

Thousands of deployments with other masses, sizes, tape springs and stops give Sobol' indices of the
time of deployment and of the twist at the end, and the probability that one of them is beyond its
limit. The scatter and the limits are examples. With the name of a folder figures are drawn too.
"""

import sys
from pathlib import Path

import numpy as np

from gough import load, view
from gough.uncertainty import SaltelliDesign, reliability, sobol_indices

SCATTER = {
    "mass": "normal(2 %)",
    "R": "normal(0.2 %)",
    "r": "normal(0.2 %)",
    "z": "normal(0.5 %)",
    "reel_inertia": "normal(5 %)",
    "deploying[0]": "normal(5 %)",
    "folding[0]": "normal(5 %)",
    **{f"scale[{k}]": "normal(3 %)" for k in range(6)},
    "stroke": "normal(0.3 %)",
    "stop_damping": "±30 %",
}
LIMITS = ["time <= 0.43", "twist <= 30"]
BASE = 1024


def ensemble():
    """Factors, time of deployment and size of the twist of every run of a Saltelli design."""
    robot = load("deployable-hexapod")
    runs = robot.simulate(
        1.0, samples=BASE, vary=SCATTER, design="saltelli", rtol=1e-6, progress=False
    )
    time = runs["first"].values.max(axis=1)  # the last leg meets its stop
    qw, qz = runs.pose.values[:, 3], runs.pose.values[:, 6]
    twist = np.rad2deg(2 * np.arctan2(np.abs(qz), np.abs(qw)))  # either way, so without a jump
    return runs["factor"].values, time, twist


def main(folder: Path | None) -> None:
    factors, time, twist = ensemble()
    names, outputs = list(SCATTER), np.column_stack([time, twist])
    indices = sobol_indices(outputs, names, ["time [s]", "twist [°]"])
    print("total Sobol' indices with 95 % intervals")
    for k, output in enumerate(indices.outputs):
        print(f"{output}: mean {indices.mean[k]:.3g}, sd {np.sqrt(indices.variance[k]):.3g}")
        for name in indices.ranked(output)[:5]:
            i = names.index(name)
            low, high = indices.total_interval[k, i]
            print(f"  {name:<13} {indices.total[k, i]:.2f}  [{low:.2f}, {high:.2f}]")
    block = SaltelliDesign(BASE, len(names)).place(np.arange(len(time)))[1]
    own = block < 2  # the other blocks repeat these
    found = reliability(LIMITS, {"time": time[own], "twist": twist[own]})
    print(found)
    if folder:
        pictures(folder, names, factors[own], outputs[own], indices, found)


def pictures(folder, names, factors, outputs, s, found) -> None:
    bars = [
        view.IndexBars(name, s.first[k], s.total[k], s.first_interval[k], s.total_interval[k])
        for k, name in enumerate(s.outputs)
    ]
    drawn = {
        "sobol": view.draw_index_bars(names, bars),
        "scatter": view.draw_scatter(factors, outputs, names, s.outputs, s.total),
    }
    part = found.each[0]
    text = f"limit 0.43 s\nmissed: {part.probability:.1%} ({part.low:.1%} to {part.high:.1%})"
    limit = view.Limit(0.43, "above", text)
    drawn["time"] = view.draw_histogram(outputs[:, 0], "time of deployment [s]", limit)
    for name, picture in drawn.items():
        (folder / f"hexapod-{name}.png").write_bytes(view.png(picture))


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else None)
