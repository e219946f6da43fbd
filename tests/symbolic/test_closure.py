"""Closure equations of random mechanisms: Jacobians against finite differences."""

import numpy as np
import pytest

from gough.assembly import TOLERANCE, Assembler
from gough.models import Models
from gough.topology import Structure
from tests.mechanisms import random_mechanism

STEP = 1e-6


def closed(seed, **options):
    models = Models(Structure(random_mechanism(seed, **options)))
    assembler = Assembler(models, models.parameters())
    return models, assembler


@pytest.mark.parametrize("seed", range(40))
def test_a_home_closed_by_construction_needs_no_step(seed):
    _, assembler = closed(seed)
    home = assembler.home()
    assert home.residual < TOLERANCE
    assert (home.steps, home.restarts) == (0, 0)


@pytest.mark.parametrize("seed", range(40))
@pytest.mark.parametrize("planar", [False, True])
def test_the_closure_jacobian_is_the_slope_of_the_residual(seed, planar):
    models, assembler = closed(seed, planar=planar)
    rng = np.random.default_rng(seed)
    p = assembler.p
    q = models.retract(assembler.start, rng.normal(size=len(models.structure.variables)) * 0.3)
    E = models.jacobian(q, p)
    for k, e in enumerate(np.eye(E.shape[1])):
        ahead, behind = models.retract(q, STEP * e), models.retract(q, -STEP * e)
        slope = (models.residual(ahead, p) - models.residual(behind, p)) / (2 * STEP)
        np.testing.assert_allclose(E[:, k], slope, atol=1e-7 * max(1, np.abs(E).max()))


@pytest.mark.parametrize("seed", range(20))
def test_body_jacobians_are_the_slopes_of_the_poses(seed):
    models, assembler = closed(seed)
    q, p = assembler.start, assembler.p
    J = np.array([models.body_jacobian(body)(q, p) for body in models.structure.bodies])
    T = models.poses(q, p)
    for k, e in enumerate(np.eye(J.shape[2])):
        ahead = models.poses(models.retract(q, STEP * e), p)
        behind = models.poses(models.retract(q, -STEP * e), p)
        slope = (ahead - behind) / (2 * STEP)
        spin = slope[:, :3, :3] @ np.swapaxes(T[:, :3, :3], 1, 2)
        angular = np.stack([spin[:, 2, 1], spin[:, 0, 2], spin[:, 1, 0]], axis=1)
        np.testing.assert_allclose(J[:, :3, k], slope[:, :3, 3], atol=1e-7)
        np.testing.assert_allclose(J[:, 3:, k], angular, atol=1e-7)


@pytest.mark.parametrize("seed", range(10))
def test_a_disturbed_home_closes_again(seed):
    models, assembler = closed(seed)
    rng = np.random.default_rng(seed + 100)
    step = 0.02 * rng.normal(size=len(models.structure.variables))
    solution = assembler.close(models.retract(assembler.start, step))
    assert solution.ending.name == "closed", solution
    assert np.abs(models.residual(solution.q, assembler.p)).max(initial=0.0) < 1e-11


def test_live_parameters_are_inputs_of_every_kernel():
    from gough.description import Body, Frame, Joint, Mechanism, Parameter

    mechanism = Mechanism(
        name="slide",
        parameters={"L": Parameter(value=0.5, live=True), "twice": "2*L"},
        bodies={"a": Body(), "b": Body()},
        joints={
            "slider": Joint(type="prismatic", bodies=("base", "a"), actuated=True),
            "pin": Joint(
                type="revolute", bodies=("a", "b"), frames=(Frame(), Frame(point=(0, 0, "twice")))
            ),
            "hold": Joint(type="spherical", bodies=("b", "base")),
        },
    )
    models = Models(Structure(mechanism))
    q = np.zeros(models.positions)
    F1, F2 = (models.residual(q, models.parameters({"L": L})) for L in (0.5, 0.8))
    assert abs(F2 - F1).max() == pytest.approx(0.6)
