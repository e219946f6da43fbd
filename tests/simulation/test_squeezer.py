"""Andrews' squeezing mechanism against the published solution of the Test Set for IVP Solvers."""

import numpy as np
import pytest

from gough.robot import load

AT_END = {  # at 0.03 s: position and rate
    "beta": (15.810771196299, 1139.92030215121),
    "Theta": (-15.756371059843, -1424.37929499411),
    "gamma": (0.040822240130731, 11.0329122193713),
    "Phi": (-0.534730116322695, 19.2933746442138),
    "delta": (0.52440996588053, 0.573569928479081),
    "Omega": (0.534730116322695, -19.2933746442138),
    "epsilon": (1.04808074104226, 0.323179165802696),
}
BETWEEN = {  # by another engine, rtol 1e-12
    0.01: {
        "beta": (2.16011313153125, 711.923152830992),
        "gamma": (0.15851675800128, -136.438191378111),
    },
    0.02: {
        "beta": (8.18490588966133, 726.558342609025),
        "gamma": (0.209536913384768, -145.739237584385),
    },
}


@pytest.fixture(scope="module")
def run():
    robot = load("andrews-squeezer", variants="spring")
    times = [0, 0.01, 0.02, 0.03]
    return robot.simulate(0.03, inputs={"beta": 0.033}, rtol=1e-13, times=times)


def agrees(run, time, expected, within):
    at = run.sel(time=time, method="nearest")
    for name, (q, v) in expected.items():
        assert float(at.q.sel(coordinate=name)) == pytest.approx(q, rel=within, abs=within)
        scale = 300 * within  # rates are 1e3 rad/s
        assert float(at.v.sel(variable=name)) == pytest.approx(v, rel=scale, abs=300 * scale)


def test_the_published_solution(run):
    """Angles to 1e-10, rates to some 1e-8 of the largest: the digits of the source."""
    agrees(run, 0.03, AT_END, 2e-10)


@pytest.mark.parametrize("time", BETWEEN)
def test_on_the_way(run, time):
    agrees(run, time, BETWEEN[time], 1e-8)


def test_energy_is_in_balance(run):
    assert np.abs(run.energy_balance_error.values).max() < 1e-10


def test_loose_tolerances_give_few_digits_and_no_wrong_ones():
    robot = load("andrews-squeezer", variants="spring")
    loose = robot.simulate(0.03, inputs={"beta": 0.033}, rtol=1e-8, times=2)
    beta = float(loose.q.sel(coordinate="beta")[-1])
    assert beta == pytest.approx(AT_END["beta"][0], abs=1e-5)
