"""Natural coordinates: what closed configurations fulfil, and configurations from them."""

import numpy as np
import pytest

import gough
from gough import catalogue
from gough.errors import ConfigurationError
from gough.geometry.coordinates import Coordinates, constant_turn
from gough.geometry.placing import Placing
from gough.geometry.problem import Problem
from gough.geometry.quadratic_closure import QuadraticClosure
from gough.symbolic import polynomials as po
from gough.symbolic.polynomials import DegreeError, Polynomial

ROBOTS = catalogue.names()
TRANSLATING = ["3-upu", "delta", "delta-parallelogram", "linear-delta", "orthoglide", "tripteron"]


def walk(robot, count=4, reach=0.3, seed=1):
    """Closed configurations, home first."""
    rng, q = np.random.default_rng(seed), robot.home.q
    found = [q]
    while len(found) < count:
        q = robot.assembler.wander(q, rng, reach)
        assert q is not None
        found.append(q)
    return np.array(found)


def direct(robot, turned=False):
    """The direct problem; with a platform that keeps its orientation."""
    known = [edge.name for edge in robot.structure.edges if edge.actuated]
    turn = None
    if turned:
        turn = constant_turn(robot.models, robot.assembler, robot.assembler.walked(robot.home.q))
        assert turn is not None
    return Problem(robot.models, robot.assembler, robot.home.q, known, turn)


def inverse(robot):
    """The inverse problem, with the platform or the output joints known."""
    platform = robot.structure.mechanism.platform
    known = [platform] if platform else robot.structure.mechanism.operational
    return Problem(robot.models, robot.assembler, robot.home.q, known)


@pytest.mark.parametrize("make", [direct, inverse])
@pytest.mark.parametrize("name", ROBOTS)
def test_closed_configurations_fulfil_the_equations(name, make):
    robot = gough.load(name)
    problem = make(robot)
    conditions = [*problem.natural.conditions, *problem.natural.checks]
    measured = problem.measured(walk(robot), robot.assembler.p)
    values = [
        problem.kernel("condition", [c.polynomial.terms[key] for key in c.polynomial.terms])
        for c in conditions
    ]
    for q, x in zip(walk(robot), measured, strict=True):
        for condition, kernel in zip(conditions, values, strict=True):
            terms = [
                float(c) * np.prod([x[u] for u in key])
                for key, c in zip(
                    condition.polynomial.terms, kernel(q, robot.assembler.p), strict=True
                )
            ]
            assert abs(sum(terms)) <= 1e-10 * max(condition.scale, *map(abs, terms))


@pytest.mark.parametrize("name", ROBOTS)
def test_configurations_come_back_from_their_coordinates(name):
    robot = gough.load(name)
    turned = [False, True] if name in TRANSLATING else [False]
    for problem in [direct(robot, t) for t in turned]:
        place = Placing(problem)
        q = walk(robot)
        left = problem.measured(q, robot.assembler.p)[:, problem.left]
        np.testing.assert_allclose(place.configurations(q, left, q), q, atol=1e-9)
        from_home = place.configurations(q, left, robot.home.q)
        assert robot.assembler.gaps(from_home).max() < 1e-9


@pytest.mark.parametrize("name", ROBOTS)
def test_the_square_system_is_regular_at_home(name):
    robot = gough.load(name)
    closure = QuadraticClosure(direct(robot))
    for q in walk(robot):
        c, T = closure.coefficients(q)
        x = closure.homogeneous(q)
        assert np.abs(closure.pattern.values(c, x)).max(initial=0.0) < 1e-12
        assert np.abs(closure.residuals(q, x)).max(initial=0.0) < 1e-10
        np.testing.assert_allclose((T @ x)[0], 1.0)


def test_linear_equations_use_the_fewest_unknowns():
    """As small as by hand: points of the platform's plane, one angle, one point."""
    left = {
        name: len(direct(gough.load(name)).left) for name in ("gough-stewart", "3-rpr", "five-bar")
    }
    assert left == {"gough-stewart": 9, "3-rpr": 4, "five-bar": 2}
    assert len(direct(gough.load("orthoglide"), turned=True).left) == 3


def test_small_machines_keep_their_terms():
    """A platform of a tenth of a millimetre has the equations of one of a metre."""
    size = 1e-4
    small = gough.load(
        "gough-stewart", x=0.05 * size, y=-0.1 * size, z=0.9 * size, R=size, r=0.6 * size
    )
    large, small = (
        QuadraticClosure(direct(gough.load("gough-stewart"))),
        QuadraticClosure(direct(small)),
    )
    np.testing.assert_array_equal(large.pattern.rows, small.pattern.rows)
    for closure in (large, small):
        q = closure.problem.home
        x = closure.homogeneous(q)
        assert np.abs(closure.pattern.values(closure.coefficients(q)[0], x)).max() < 1e-12


def test_what_is_no_polynomial_is_refused():
    frames = [{}, {}]
    screw = gough.Mechanism(
        name="screw",
        bodies={"base": {}, "nut": {}, "arm": {}},
        joints={
            "motor": {"type": "revolute", "bodies": ["base", "arm"], "actuated": True},
            "thread": {
                "type": "helical", "bodies": ["base", "nut"], "dimensions": {"pitch": 0.01},
            },
            "slide": {"type": "cylindrical", "bodies": ["arm", "nut"], "frames": frames},
        },
    )  # fmt: skip
    with pytest.raises(ConfigurationError, match="joint 'thread' is helical"):
        direct(gough.Robot(screw))


@pytest.mark.parametrize("name", ["3-rps", "agile-eye", "gough-stewart", "par4", "four-bar"])
def test_coordinates_are_written_and_read(name):
    robot = gough.load(name)
    outputs = Coordinates(robot.models, "operational")
    for q in walk(robot):
        np.testing.assert_allclose(
            outputs.of(outputs.put(robot.home.q, outputs.of(q))), outputs.of(q), atol=1e-12
        )
    np.testing.assert_allclose(outputs.of(robot.home.q), robot.home.x, atol=1e-12)


# polynomials


def test_polynomials_add_multiply_and_substitute():
    x, y, one = Polynomial.unknown(0), Polynomial.unknown(1), Polynomial.constant(1.0)
    p = (x + y.scaled(2.0)) * (x - one)
    assert p.terms == {(0, 0): 1.0, (0,): -1.0, (0, 1): 2.0, (1,): -2.0}
    assert p.value({0: 3.0, 1: 4.0}) == (3 + 8) * 2
    q = p.substituted({1: x.scaled(0.5)})
    assert q.value({0: 3.0}) == p.value({0: 3.0, 1: 1.5})
    assert (x - x).terms == {}
    with pytest.raises(DegreeError):
        p * x


def test_vectors_of_polynomials():
    rng = np.random.default_rng(0)
    numbers = rng.normal(size=6)
    a, b = (tuple(Polynomial.unknown(k + n) for k in range(3)) for n in (0, 3))
    values = [part.value(numbers) for part in po.cross(a, b)]
    np.testing.assert_allclose(values, np.cross(numbers[:3], numbers[3:]))
    assert po.dot(a, b).value(numbers) == pytest.approx(numbers[:3] @ numbers[3:])
