"""Random mechanisms of all joint types: dynamics against maximal coordinates."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gough.description import Body, Mechanism
from gough.errors import ClosureError, ConfigurationError
from gough.robot import Robot
from tests.dynamics.maximal import Maximal
from tests.mechanisms import random_mechanism

CASES = settings().max_examples // 5 + 1


def with_masses(mechanism, seed):
    """The mechanism with a mass, its centre and a possible inertia for every body."""
    rng = np.random.default_rng(seed + 1000)
    content = mechanism.model_dump(exclude_unset=True)
    for name in mechanism.bodies:
        points = rng.normal(size=(6, 3)) * 0.3
        weights = rng.uniform(0.1, 0.5, 6)
        com = weights @ points / weights.sum()
        r = points - com
        J = sum(w * (x @ x * np.eye(3) - np.outer(x, x)) for w, x in zip(weights, r, strict=True))
        content["bodies"][name] = Body(
            mass=float(weights.sum()),
            com=com.tolist(),
            inertia=[float(J[i, k]) for i, k in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))],
        )
    return Mechanism.model_validate(content | {"gravity": [1.0, -3.0, -9.0]})


@settings(max_examples=CASES)
@given(st.integers(0, 100_000), st.booleans())
def test_dynamics_of_random_mechanisms(seed, planar):
    robot = Robot(with_masses(random_mechanism(seed, planar=planar), seed))
    try:
        robot.home  # noqa: B018
        names = robot.dynamics.independent()
    except ClosureError:  # a home that was moved by what holds the platform
        return
    except ConfigurationError as error:
        assert "independent rows" in str(error) or "does not hold" in str(error)
        return
    if not names:
        return
    rng = np.random.default_rng(seed)
    model, truth = robot.dynamics.model("joint"), Maximal(robot)
    compared = 0
    for reach in (0.0, 0.2, 0.5):
        q = robot.home.q if not reach else robot.assembler.wander(robot.home.q, rng, reach)
        if q is None:
            continue
        y, tau = rng.normal(size=len(names)), rng.normal(size=len(robot.dynamics.motors))
        found = robot.dynamics.direct_joint(q, y, tau)
        if not found.solved or found.regularity < 1e-2:
            continue
        v = model.kernel("rates", "q")(q, y)
        change = model.kernel("accelerations", "q")(q, y, found.accelerations)
        efforts = dict(zip(robot.dynamics.motors, tau, strict=True))
        try:
            expected = truth.tree_accelerations(q, v, by_joint(robot, efforts))
        except ArithmeticError:  # a singular configuration of the truth's own equations
            continue
        size = max(np.abs(expected).max(), np.abs(v).max() ** 2, 1.0)
        np.testing.assert_allclose(change, expected, rtol=0, atol=1e-8 * size)
        compared += 1


def by_joint(robot, efforts):
    """Efforts by joint, arrays where a joint has several freedoms."""
    found = {}
    for k in robot.structure.columns("actuated"):
        variable = robot.structure.variables[k]
        name = robot.structure.edges[variable.edge].name
        found.setdefault(name, []).append(efforts[variable.name])
    return {name: x[0] if len(x) == 1 else np.array(x) for name, x in found.items()}


@pytest.mark.parametrize("seed", range(3))
def test_models_of_the_whole_tree_need_no_loop(seed):
    """A chain without loops: nothing is eliminated."""
    mechanism = random_mechanism(seed, closings=1)
    content = with_masses(mechanism, seed).model_dump(exclude_unset=True)
    content["joints"] = {
        name: joint for name, joint in content["joints"].items() if not name.startswith("closing")
    }
    content |= {"operational": [], "platform": None}
    robot = Robot(Mechanism.model_validate(content))
    names = robot.dynamics.independent()
    assert len(names) == len(robot.structure.variables)
