"""Commanded laws: clipping, gears, torque that falls with the rate."""

import numpy as np
import pytest

from gough.actuators import LAWS, Situation
from gough.actuators.base import unit_of
from tests.actuators.examples import ALL

FORCE, MOTOR = LAWS["force"], LAWS["motor"]


def test_laws_with_a_command():
    assert {name for name, law in LAWS.items() if law.commanded} == {"force", "motor"}
    assert unit_of(FORCE.command, "m") == "N"
    assert {unit_of(MOTOR.command, unit) for unit in ("m", "rad")} == {"N m"}


@pytest.mark.parametrize(("asked", "given"), [(2.0, 2.0), (7.0, 3.0), (-7.0, -3.0)])
def test_a_force_is_clipped_at_its_limit(asked, given):
    here = Situation(0.0, 0.5, command=asked)
    effort = FORCE.effort(here, {"limit": 3.0})
    assert effort.force == given
    assert effort.delivered == 0.5 * given
    (event,) = effort.events
    assert (event.name, event.kind, event.value) == ("saturation", "mark", 3.0 - abs(asked))
    assert FORCE.effort(here, {}).force == asked
    assert FORCE.effort(here, {}).events == ()


def torque_given(turning, asked, **numbers):
    """Torque of a rotor without damping, by a gear of 1."""
    return MOTOR.effort(Situation(0.0, turning, command=asked), numbers).force


def test_torque_in_the_direction_of_motion_falls_to_nothing_at_the_no_load_speed():
    limits = {"torque": 2.0, "speed": 10.0}
    turning = np.array([-30.0, -10.0, -5.0, 0.0, 5.0, 10.0, 30.0])
    up = [torque_given(rate, 1e9, **limits) for rate in turning]
    down = [torque_given(rate, -1e9, **limits) for rate in turning]
    np.testing.assert_allclose(up, [2, 2, 2, 2, 1, 0, 0])
    np.testing.assert_allclose(down, [0, 0, -1, -2, -2, -2, -2])
    assert torque_given(5.0, 0.6, **limits) == 0.6
    assert torque_given(5.0, 9.0, torque=2.0) == 2.0
    assert torque_given(50.0, 9.0) == 9.0


def test_a_gear_multiplies_torque_and_rate_and_squares_inertia():
    numbers = {"ratio": -20.0, "inertia": 1e-3, "damping": 2e-3}
    assert MOTOR.inertia(numbers) == pytest.approx(0.4)
    effort = MOTOR.effort(Situation(0.0, 0.5, command=1.0), numbers)
    assert effort.force == pytest.approx(-20 * (1.0 + 2e-3 * 10))
    assert effort.dissipated == pytest.approx(2e-3 * 100)
    assert effort.delivered == pytest.approx(-10.0)
    assert MOTOR.inertia({"inertia": 1e-3}) == 1e-3


@pytest.mark.parametrize("turning", [-4.0, 0.0, 3.0])
def test_the_mark_of_a_motor_is_where_its_torque_begins_to_be_clipped(turning):
    _, numbers = ALL["motor with limits"]
    rate = turning / numbers["ratio"]
    for sign in (-1, 1):
        least = abs(
            torque_given(turning, sign * 1e9, torque=numbers["torque"], speed=numbers["speed"])
        )
        for asked, saturated in ((0.999 * least, False), (1.001 * least, True)):
            effort = MOTOR.effort(Situation(0.0, rate, command=sign * asked), numbers)
            assert (effort.events[0].value < 0) == saturated
            assert (abs(effort.delivered) < abs(asked * turning)) == (saturated and turning != 0)


def test_what_is_wrong_with_a_motor():
    assert dict(MOTOR.problems({"ratio": 0.0})).keys() == {"ratio"}
    assert dict(MOTOR.problems({"speed": 5.0})).keys() == {"torque"}
    assert not list(MOTOR.problems({"torque": 5.0}))
