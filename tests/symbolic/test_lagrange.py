"""Lagrange's equations: against Newton and Euler by virtual work, and the law of energy."""

import casadi
import numpy as np
import pytest

from gough.description import Body, Frame, Joint, Mechanism, Parameter
from gough.description.values import scalar, vector
from gough.models import Models
from gough.robot import open_source
from gough.symbolic.lagrange import Lagrange
from gough.topology import Structure
from tests.mechanisms import random_mechanism

SX = casadi.SX
ROBOTS = ["orthoglide", "gough-stewart", "6-sps", "biped-leg", "agile-eye", "delta-parallelogram"]


class Case:
    """Lagrange's equations of a mechanism, symbols of its motion, and a state at random."""

    def __init__(self, mechanism, seed=0):
        self.models = Models(Structure(mechanism))
        self.closure = self.models.closure
        self.lagrange = Lagrange(self.closure)
        count = len(self.closure.structure.variables)
        self.v, self.vd, self.g = SX.sym("v", count), SX.sym("vd", count), SX.sym("g", 3)
        rng = np.random.default_rng(seed)
        neutral = [x for edge in self.closure.structure.edges for x in edge.type.neutral()]
        q = self.models.retract(np.array(neutral), 0.7 * rng.normal(size=count))
        v, vd = rng.normal(size=(2, count))
        self.state = [q, self.models.parameters(), v, vd, 9 * rng.normal(size=3)]

    @property
    def forces(self):
        return self.lagrange.forces(self.v, self.vd, self.g)

    def numbers(self, *outputs):
        """Values of expressions at the state; columns as vectors."""
        inputs = [self.closure.q, self.closure.p, self.v, self.vd, self.g]
        found = casadi.Function("f", inputs, outputs).call(self.state)
        return [np.array(x)[:, 0] if x.shape[1] == 1 else np.array(x) for x in found]

    def rate(self, values):
        """The derivative of an expression by time."""
        H = self.closure.position_rates
        moving = casadi.vertcat(self.closure.q, self.v)
        return casadi.jtimes(values, moving, casadi.vertcat(H @ self.v, self.vd))


def virtual_work(case):
    """Σ Jᵀ of what moves each body, by Newton and Euler at its centre of mass."""
    closure, forces = case.closure, 0
    for name, body in closure.structure.flat.bodies.items():
        if name == closure.structure.root:
            continue
        R, _ = closure.poses[name]
        R = casadi.vertcat(*(casadi.horzcat(*row) for row in R))
        com = (*vector(body.com, closure.values, 2, 3), 0)[:3]
        xx, yy, zz, xy, xz, yz = (*vector(body.inertia, closure.values, 3, 6), 0, 0, 0)[:6]
        inertia = casadi.blockcat([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        J, arm = closure.body_jacobian(name), R @ casadi.vertcat(*com)
        J_w = J[3:, :]
        J_c = J[:3, :] - casadi.skew(arm) @ J_w
        momentum = R @ inertia @ R.T @ (J_w @ case.v)
        mass = scalar(body.mass, closure.values)
        forces += J_c.T @ (mass * (case.rate(J_c @ case.v) - case.g))
        forces += J_w.T @ case.rate(momentum)
    return forces


def random_body(body, rng):
    """The body with the mass of some points at random."""
    points = rng.normal(size=(5, 3))
    com, r = points.mean(axis=0), points - points.mean(axis=0)
    inertia = np.sum(r**2) * np.eye(3) - r.T @ r
    entries = [*np.diag(inertia), inertia[0, 1], inertia[0, 2], inertia[1, 2]]
    return body.model_copy(
        update={"mass": 5.0, "com": tuple(map(float, com)), "inertia": tuple(map(float, entries))}
    )


def assert_near(actual, expected, tolerance=1e-10):
    np.testing.assert_allclose(actual, expected, rtol=0, atol=tolerance * np.abs(expected).max())


def assert_virtual_work(case):
    assert_near(*case.numbers(case.forces, virtual_work(case)))


@pytest.mark.parametrize("name", ROBOTS)
def test_forces_are_those_of_newton_and_euler(name):
    assert_virtual_work(Case(open_source(name).mechanism({})))


@pytest.mark.parametrize("seed", range(12))
def test_forces_of_random_trees_are_those_of_newton_and_euler(seed):
    mechanism, rng = random_mechanism(seed), np.random.default_rng(seed)
    bodies = {name: random_body(body, rng) for name, body in mechanism.bodies.items()}
    assert_virtual_work(Case(Mechanism(**{**dict(mechanism), "bodies": bodies}), seed))


@pytest.mark.parametrize("name", ROBOTS)
def test_power_is_the_change_of_energy(name):
    case = Case(open_source(name).mechanism({}), seed=1)
    energy = case.lagrange.kinetic(case.v) + case.lagrange.potential(case.g)
    forces, change = case.numbers(case.forces, case.rate(energy))
    power = case.state[2] * forces
    assert abs(power.sum() - change[0]) < 1e-10 * np.abs(power).sum()


@pytest.mark.parametrize("name", ROBOTS)
def test_the_mass_matrix_is_symmetric_and_gives_forces_and_energy(name):
    case = Case(open_source(name).mechanism({}), seed=2)
    lagrange = case.lagrange
    M, bias, forces, kinetic = case.numbers(
        lagrange.mass_matrix(), lagrange.bias(case.v, case.g), case.forces, lagrange.kinetic(case.v)
    )
    _, _, v, vd, _ = case.state
    assert_near(M, M.T, 1e-14)
    assert_near(M @ vd + bias, forces, 1e-12)
    assert v @ M @ v / 2 == pytest.approx(kinetic[0], rel=1e-12)


def top():
    """A free body with products of inertia and its centre of mass at its origin."""
    body = Body(mass=2.0, inertia=(0.2, 0.3, 0.4, 0.03, -0.02, 0.05))
    joint = Joint(type="free", bodies=("base", "top"))
    return Mechanism(name="top", bodies={"top": body}, joints={"none": joint})


def test_a_free_body_obeys_eulers_equation():
    case = Case(top())
    (R,) = (T[:3, :3] for T in case.models.poses(*case.state[:2]))
    M, bias = case.numbers(case.lagrange.mass_matrix(), case.lagrange.bias(case.v, [0, 0, -9.81]))
    acceleration = np.linalg.solve(M, -bias)
    inertia = np.array([[0.2, 0.03, -0.02], [0.03, 0.3, 0.05], [-0.02, 0.05, 0.4]])
    spin = R.T @ case.state[2][3:]
    spin_rate = np.linalg.solve(inertia, np.cross(inertia @ spin, spin))
    np.testing.assert_allclose(acceleration[:3], [0, 0, -9.81], atol=1e-12)
    np.testing.assert_allclose(R.T @ acceleration[3:], spin_rate, atol=1e-12)


def test_live_masses_are_inputs_of_the_energies():
    body = Body(mass="m", com=(0, 0, "h"))
    case = Case(
        Mechanism(
            name="pendulum",
            parameters={"m": Parameter(value=2, live=True), "h": Parameter(value=0.5, live=True)},
            bodies={"bob": body},
            joints={"ball": Joint(type="spherical", bodies=("base", "bob"))},
        )
    )
    case.state[:2] = np.array([1.0, 0, 0, 0]), case.models.parameters({"m": 3.0, "h": 0.2})
    energy, M = case.numbers(case.lagrange.potential([0, 0, -10]), case.lagrange.mass_matrix())
    assert energy[0] == pytest.approx(3.0 * 10 * 0.2)
    np.testing.assert_allclose(M, 3.0 * 0.2**2 * np.diag([1, 1, 0]), atol=1e-15)


def test_a_mechanism_without_mass_takes_no_forces():
    joint = Joint(type="revolute", bodies=("base", "bar"), frames=(Frame(), Frame()))
    case = Case(Mechanism(name="light", bodies={"bar": Body()}, joints={"pin": joint}))
    kinetic, potential = case.lagrange.kinetic(case.v), case.lagrange.potential(case.g)
    for values in case.numbers(case.forces, case.lagrange.mass_matrix(), kinetic, potential):
        assert not values.any()
