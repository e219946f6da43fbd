"""Andrews' squeezing mechanism with its spring, against the published accelerations."""

import numpy as np
import pytest

from gough.actuators import LAWS, Situation
from gough.description.values import scalar
from gough.robot import load

TORQUE = 0.033
INITIAL = {"beta": 14222.4439199541, "Theta": -10666.8329399656}
"""Accelerations at rest in the initial configuration; those of all others are zero."""
LATER = {
    "beta": (15.810771196299, 1139.92030215121, -24631.763169452),
    "Theta": (-15.756371059843, -1424.37929499411, 51850.3770161033),
    "gamma": (0.040822240130731, 11.0329122193713, 324102.568641378),
    "Phi": (-0.534730116322695, 19.2933746442138, 566749.364517621),
    "delta": (0.52440996588053, 0.573569928479081, 16743.6292947936),
    "Omega": (0.534730116322695, -19.2933746442138, -566749.364517622),
    "epsilon": (1.04808074104226, 0.323179165802696, 9826.52079145842),
}
"""Positions, rates and accelerations at t = 0.03 s, by the authors of the test set.
With twelve decimals of the positions the rates follow from that of beta to 3e-8 rad/s, and the
accelerations to 0.06 rad/s² of 566749."""


@pytest.fixture(scope="module")
def robot():
    return load("andrews-squeezer", variants="spring")


def accelerations(robot, q, beta_rate):
    """Of all variables, with the force of the spring as an effort on its slide."""
    model = robot.dynamics.model("joint")
    names = [v.name for v in robot.structure.variables]
    assert robot.dynamics.independent("joint") == ("beta",)
    spring = robot.structure.flat.joints["spring"].actuators["spring"]
    numbers = {name: scalar(x, robot.assembler.values) for name, x in spring.numbers.items()}
    length = q[robot.position_names.index("spring")]
    force = LAWS[spring.law].effort(Situation(length, 0.0), numbers).force
    np.testing.assert_allclose(force, -4530 * (length - 0.07785), rtol=1e-12)
    y = np.array([beta_rate])
    along = model.kernel("rates", "q")(q, np.ones(1))[names.index("spring")]
    bias, A = model.kernel("bias", "q")(q, y), model.kernel("mass_matrix", "q")(q)
    yd = (TORQUE + along * force - bias) / A[0]
    rates = model.kernel("rates", "q")(q, y)
    found = model.kernel("accelerations", "q")(q, y, yd)
    return dict(zip(names, rates, strict=True)), dict(zip(names, found, strict=True))


def test_home_is_where_it_starts(robot):
    assert not robot.home.assembly.moved
    _, found = accelerations(robot, robot.home.q, 0.0)
    for name, value in found.items():
        np.testing.assert_allclose(value, INITIAL.get(name, 0.0), rtol=1e-10, atol=1e-8)


def test_accelerations_of_the_published_solution(robot):
    names = robot.position_names
    q = robot.home.q.copy()
    for name, (position, *_) in LATER.items():
        q[names.index(name)] = position
    gamma = LATER["gamma"][0]
    c, s = np.cos(gamma), np.sin(gamma)
    D = np.array([-0.03635 + 0.02 * c + 0.018 * s, 0.03273 + 0.02 * s - 0.018 * c])
    to_D = D - [0.014, 0.072]
    q[names.index("hinge")] = np.arctan2(to_D[1], to_D[0])
    q[names.index("spring")] = np.hypot(*to_D)
    closed = robot.assembler.close(q)
    assert np.abs(closed.q - q).max() < 1e-9
    rates, found = accelerations(robot, q, LATER["beta"][1])
    largest = max(abs(value) for *_, value in LATER.values())
    for name, (_, rate, value) in LATER.items():
        np.testing.assert_allclose(rates[name], rate, rtol=1e-8, atol=1e-7)
        np.testing.assert_allclose(found[name], value, rtol=0, atol=1.2e-7 * largest)


def test_laws(robot):
    check = robot.check_dynamics(states=4)
    assert check.passed, str(check)
