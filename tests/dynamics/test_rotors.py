"""Inertia of motors and of laws, as the freedoms of their joints feel it."""

import numpy as np
import pytest

from gough.description import Mechanism
from gough.dynamics.reactions import JointForces
from gough.errors import ConfigurationError
from gough.robot import Robot, load

REEL = {"law": "reel", "numbers": {"inertia": 0.002, "radius": 0.1}}
"""Felt as 0.2 kg."""
ROTOR = {"law": "motor", "freedom": 2, "numbers": {"inertia": 0.003, "ratio": 10}}
"""Felt as 0.3 kg m² by the second freedom."""


def drill(actuators, **more):
    joint = {"type": "cylindrical", "bodies": ["base", "bit"], "actuated": True, **more}
    content = {"mass": 2, "inertia": [1, 1, 0.5]}
    return Robot(
        Mechanism(
            name="drill",
            bodies={"bit": content},
            joints={"shaft": joint | {"actuators": actuators}},
        )
    )


def test_each_freedom_of_a_joint_feels_its_own():
    bare = drill({}).dynamics.mass_matrix(drill({}).home.q, space="joint")
    robot = drill(
        {
            "reel": REEL | {"freedom": 2},
            "more": REEL | {"freedom": 2},
            "turn": ROTOR | {"freedom": 1},
        }
    )
    names = [v.unit for v in robot.structure.variables]
    assert names == ["rad", "m"]
    found = robot.dynamics.mass_matrix(robot.home.q, space="joint")
    np.testing.assert_allclose(found - bare, np.diag([0.3, 0.4]), atol=1e-12)
    assert robot.check_dynamics(states=3).passed


def test_reactions_know_them():
    robot = drill({"reel": REEL | {"freedom": 2}, "turn": ROTOR | {"freedom": 1}})
    efforts, forces = np.array([3.0, 4.0]), JointForces(robot.dynamics)
    found = forces.at(
        robot.home.q, np.zeros(2), efforts=efforts, space="joint", gravity=np.zeros(3)
    )
    alpha, a = 3 / 0.8, 4 / 2.2
    np.testing.assert_allclose(found.of("shaft")[[2, 5]], [2 * a, 0.5 * alpha], rtol=1e-12)


def test_identified_inertia_goes_to_the_law_that_has_it():
    robot = load("deployable-hexapod")
    parameters = robot.identification.parameters
    values = parameters.values.copy()
    k = parameters.index("leg2.slide.Ia")
    np.testing.assert_allclose(values[k], 2e-4 / 0.05**2)
    values[k] *= 3
    from gough.dynamics.identification.mechanism import with_parameters

    other = Robot(with_parameters(parameters, values))
    rotors = list(other.dynamics.model("joint").rotors.values())
    np.testing.assert_allclose(rotors, 0.08 * np.array([1, 3, 1, 1, 1, 1]))


def test_inertia_without_a_motor_is_no_parameter():
    joint = {"type": "prismatic", "bodies": ["bit", "tip"], "actuators": {"reel": REEL}}
    content = {"mass": 2, "inertia": [1, 1, 0.5]}
    first = {"type": "revolute", "bodies": ["base", "bit"], "actuated": True}
    robot = Robot(
        Mechanism(
            name="drill",
            bodies={"bit": content, "tip": content},
            joints={"shaft": first, "slide": joint},
        )
    )
    with pytest.raises(ConfigurationError, match="slide has an actuator with inertia and no motor"):
        _ = robot.identification
