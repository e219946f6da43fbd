"""Direct geometry: it undoes inverse geometry, and ends where it would leave its mode."""

from functools import cache

import numpy as np
import pytest

import gough
from gough import catalogue
from gough.errors import ConfigurationError, OutOfReach
from gough.geometry import direct as module
from gough.geometry.direct import ENDINGS, Found
from gough.geometry.direct_steps import NaturalNewton, PlatformNewton
from gough.kernels import Kernel
from gough.numerics.stepping import StepEnding

WITHOUT_OUTPUTS = {"andrews-squeezer", "biped-leg"}
ROBOTS = [name for name in catalogue.names() if name not in WITHOUT_OUTPUTS]
NATURAL = {
    "3-rps", "3-upu", "4-rpr", "agile-eye", "bennett", "bricard", "four-bar", "par4", "sarrus",
    "slider-crank", "tricept", "tripteron",
}  # fmt: skip
ON_PLATFORM = [name for name in ROBOTS if name not in NATURAL]
FAR = [
    "2rpr", "3-prr", "3-rpr", "3-rps", "3-rrr", "3-upu", "6-ups", "agile-eye", "delta", "five-bar",
    "gough-stewart", "hexa", "hexaglide", "sarrus", "tricept",
]  # fmt: skip
CROSSED, OPEN = ENDINGS.index(Found.crossed), ENDINGS.index(Found.open)


@cache
def load(name):
    return gough.load(name)


def moved(robot, x, far, rng):
    """Operational coordinates off others by up to ``far``, rad and characteristic lengths."""
    operational = robot._direct.direct.operational
    size = np.where(np.array(operational.units) == "m", robot.assembler.length, 1.0)
    found = x + far * rng.uniform(-1, 1, x.shape) * size
    if "qw" in [name.rpartition(".")[2] for name in operational.names]:
        found[..., -4:] /= np.linalg.norm(found[..., -4:], axis=-1, keepdims=True)
    return found


@cache
def poses(name, rows, far=0.05):
    """Reached operational coordinates around home, configurations, and motors' positions."""
    robot, rng = load(name), np.random.default_rng(2)
    x = moved(robot, np.tile(robot.home.x, (rows, 1)), far, rng)
    found = robot.reach(x)
    assert found.reached.mean() > 0.4
    x, q = x[found.reached], found.q[found.reached]
    return x, q, np.ascontiguousarray(robot._direct.direct.actuated.of(q))


@cache
def wandered(name, count=60):
    """Motors' positions of configurations that walks from home come by."""
    robot, rng, found = load(name), np.random.default_rng(0), []
    while len(found) < count:
        q = robot.home.q
        for _ in range(3):
            q = robot.assembler.wander(q, rng, rng.uniform(0.1, 1.2))
            if q is None:
                break
            found.append(q)
    return robot._direct.direct.actuated.of(np.array(found))


def followed(robot, near, q_actuated, parts):
    """Unknowns at the ends of straight ways of the motors, in equal parts, and who arrived."""
    direct, newton, p = robot._direct, robot._direct.newton, robot.assembler.p
    z, own = newton.start(near), direct.direct.actuated.of(robot.reach(near).q)
    way = module._shortest(q_actuated - own, direct.direct.actuated.units)
    side, arrived = np.sign(newton.side(z, own)), np.ones(len(z), dtype=bool)
    for part in np.arange(1, parts + 1) / parts:
        y = z.copy()
        for turn in range(8):
            with np.errstate(all="ignore"):
                *_, gap, d, size = np.moveaxis(step := newton.step(y, own + part * way, p), -1, 0)
            arrived &= np.isfinite(step).all(axis=1) & (np.sign(d) == side)
            arrived &= (size < 0.1) | (turn > 0)
            y = np.where(arrived[:, None], step[:, :-3], z)
        arrived &= gap < 1e-10
        z = np.where(arrived[:, None], y, z)
    return z, arrived


def side(robot, x, q_actuated):
    """The side of singularities of type 2 that solutions are on, 1 or -1."""
    newton = robot._direct.newton
    return np.sign(newton.side(newton.start(x), q_actuated))


# equations


@pytest.mark.parametrize("name", ROBOTS)
def test_only_platforms_are_unknown_where_legs_are_lengths(name):
    kind = PlatformNewton if name in ON_PLATFORM else NaturalNewton
    assert type(load(name)._direct.newton) is kind


@pytest.mark.parametrize("name", ON_PLATFORM)
def test_rows_of_legs_are_derivatives(name):
    robot = load(name)
    newton, models, p = robot._direct.newton, robot.models, robot.assembler.p
    inputs = {"q": models.closure.q, "p": models.closure.p}
    r = Kernel("r", inputs, newton.r, (newton.r.numel(),))
    J = Kernel("J", inputs, newton.J, newton.J.shape)
    for q in poses(name, 40)[1][:3]:
        step, slopes = 1e-5, []
        for k in newton.columns:
            rates = np.zeros(len(robot.structure.variables))
            rates[k] = step
            ends = [models.retract(q, sign * rates) for sign in (1, -1)]
            slopes.append((r(ends[0], p) - r(ends[1], p)) / (2 * step))
        assert abs(r(q, p)).max() < 1e-9
        np.testing.assert_allclose(J(q, p), np.transpose(slopes), atol=1e-8)


@pytest.mark.parametrize("name", ON_PLATFORM)
@pytest.mark.parametrize("wrong", [np.nan, np.inf, -np.inf])
def test_what_is_not_finite_never_closes(name, wrong):
    newton = load(name)._direct.newton
    x, _, q_actuated = poses(name, 40)
    given = np.concatenate([x[:1], q_actuated[:1]], axis=1)
    rows = np.repeat(given, given.shape[1], axis=0)
    np.fill_diagonal(rows, wrong)
    found = newton.solve(rows[:, : x.shape[1]], rows[:, x.shape[1] :].copy(), 1)
    assert not found.ended(StepEnding.closed).any()


# laws


@pytest.mark.parametrize("name", ROBOTS)
def test_it_undoes_inverse_geometry_on_its_mode(name):
    robot = load(name)
    x, q, q_actuated = poses(name, 10_000 if name in ON_PLATFORM else 300)
    near = moved(robot, x, 0.01, np.random.default_rng(3))
    start = robot.reach(near)
    x, q, q_actuated, near = (part[start.reached] for part in (x, q, q_actuated, near))
    found = robot._direct.solve(q_actuated, near)
    own = robot._direct.direct.actuated.of(start.q[start.reached])
    same = side(robot, near, own) == side(robot, x, q_actuated)
    assert same.mean() > 0.999  # else a singularity of type 2 lies between
    assert found.closed[same].all()
    assert set(found.ending) <= {0, CROSSED}
    astray = found.x[~same & found.closed]
    assert (side(robot, astray, q_actuated[~same & found.closed])
            == side(robot, near, own)[~same & found.closed]).all()  # fmt: skip
    x, q, own = x[same], q[same], found.x[same]
    assert abs(own - x).max() < 1e-9
    np.testing.assert_allclose(robot.inverse_geometry(own), q, atol=1e-7)
    if robot.has_closed_form:
        inverse = robot._inverse
        assert {tuple(inverse.signs(row)) for row in q[:20]} == {tuple(inverse.signs(robot.home.q))}


@pytest.mark.parametrize("name", FAR)
def test_far_solutions_are_those_that_small_steps_lead_to(name):
    robot = load(name)
    q_actuated = wandered(name)
    near = np.tile(robot._direct.home_x, (len(q_actuated), 1))
    found = robot._direct.solve(q_actuated, near)
    z, arrived = followed(robot, near, q_actuated, 200)
    if (doubt := found.closed != arrived).any():
        z[doubt], arrived[doubt] = followed(robot, near[doubt], q_actuated[doubt], 4000)
    x, _ = robot._direct.newton.outputs(z, q_actuated, near)
    assert found.closed.tolist() == arrived.tolist()
    assert abs(found.x - x)[arrived].max() < 1e-8
    assert set(found.ending) <= {0, CROSSED}


@pytest.mark.parametrize("name", ["3-rpr", "6-ups"])
def test_ways_through_singularities_are_told(name):
    robot = load(name)
    q_actuated = wandered(name)
    closed = robot._direct.solve(q_actuated).closed
    assert 0 < closed.sum() < len(closed)
    with pytest.raises(OutOfReach, match="meets a singularity of type 2") as caught:
        robot.direct_geometry(q_actuated)
    assert list(caught.value.rows) == np.flatnonzero(~closed).tolist()
    np.testing.assert_array_equal(
        robot.direct_geometry(q_actuated[closed]), robot._direct.solve(q_actuated).x[closed]
    )


def test_determinants_keep_their_sign_though_legs_move():
    # the equations of a start have another sign at the motors' goal than at its own
    robot = load("orthoglide")
    q_actuated = np.array([[0.07403125, 0.57023677, 0.57300711]])
    home = side(robot, robot.home.x[None], robot.home.q_actuated[None])
    found = robot._direct.solve(q_actuated)
    assert found.closed.all()
    assert side(robot, found.x, q_actuated) == home


def test_a_way_through_a_point_where_branches_meet_ends_there():
    robot = load("sarrus")
    flat = robot._direct.solve(np.array([[1.73520977]]))
    assert flat.ending.tolist() == [CROSSED]


# one row, many rows


@pytest.mark.parametrize("name", ["gough-stewart", "3-rpr", "five-bar", "delta", "sarrus"])
def test_one_row_has_the_bits_it_has_in_a_batch(name):
    robot = load(name)
    x, _, q_actuated = poses(name, 40)
    near = moved(robot, x, 0.01, np.random.default_rng(4))[: (n := 12)]
    near[3] = x[3]  # closed at the start
    whole = robot.direct_geometry(q_actuated[:n], near)
    for k in range(n):
        for q, start in ((q_actuated[k], near[k]), (q_actuated[k].tolist(), near[k].tolist())):
            np.testing.assert_array_equal(robot.direct_geometry(q, start), whole[k])
        np.testing.assert_array_equal(robot.direct_geometry(q_actuated[k : k + 1], near[k]),
                                      whole[k : k + 1])  # fmt: skip
        quick = robot._direct.quick(q_actuated[k], near[k])
        assert (quick is None) == (name == "sarrus")


@pytest.mark.parametrize("threads", [None, 1, 2, 5])
def test_a_row_has_the_same_bits_in_any_order_by_any_threads(threads):
    robot = load("6-ups")
    x, _, near_by = poses("6-ups", 40)
    q_actuated = np.concatenate([wandered("6-ups"), near_by[:40]])
    nearer = moved(robot, x[:40], 0.01, np.random.default_rng(5))
    near = np.concatenate([np.tile(robot.home.x, (len(q_actuated) - len(nearer), 1)), nearer])
    whole = robot._direct.solve(q_actuated, near)
    order = np.random.default_rng(0).permutation(len(near))
    mixed = robot._direct.solve(q_actuated[order], near[order], threads)
    np.testing.assert_array_equal(mixed.x, whole.x[order])
    np.testing.assert_array_equal(mixed.ending, whole.ending[order])


def test_batches_of_any_shape():
    robot = load("gough-stewart")
    x, _, q_actuated = (part[:10] for part in poses("gough-stewart", 40))
    many = robot.direct_geometry(q_actuated.reshape(2, 5, 6), x.reshape(2, 5, 7))
    assert many.shape == (2, 5, 7)
    np.testing.assert_allclose(many.reshape(10, 7), x, atol=1e-12)
    for near in (None, robot.home.x, robot.home.x[None, None], x[:5]):
        found = robot.direct_geometry(q_actuated.reshape(2, 5, 6), near)
        np.testing.assert_allclose(found.reshape(10, 7), x, atol=1e-12)
    assert robot.direct_geometry(q_actuated[0], x).shape == (10, 7)
    assert robot.direct_geometry(np.zeros((0, 6))).shape == (0, 7)
    assert robot.direct_geometry(np.zeros((3, 0, 6)), x[0]).shape == (3, 0, 7)
    np.testing.assert_allclose(robot.direct_geometry(q_actuated[0]), x[0], atol=1e-12)


def test_near_is_left_as_it_is_and_a_solution_is_new():
    robot = load("gough-stewart")
    x, _, q_actuated = poses("gough-stewart", 40)
    start, kept = x[0].copy(), x[0].copy()
    found = robot.direct_geometry(q_actuated[0], start)
    found += 1.0
    np.testing.assert_array_equal(start, kept)
    robot.direct_geometry(q_actuated[0])[0] = 9.0
    np.testing.assert_array_equal(robot._direct.home_x, robot.home.x)


def test_quaternions_of_nearly_length_1_are_made_1():
    robot = load("gough-stewart")
    x, _, q_actuated = (part[:2] for part in poses("gough-stewart", 40))
    near = x * np.array([1.0] * 3 + [1 + 1e-8] * 4)
    for found in (
        robot.direct_geometry(q_actuated, near),
        [robot.direct_geometry(*pair) for pair in zip(q_actuated, near, strict=True)],
    ):
        np.testing.assert_allclose(found, x, atol=1e-13)


# what can not be


def test_motors_out_of_reach_are_told_with_their_rows():
    robot = load("gough-stewart")
    _, _, q_actuated = poses("gough-stewart", 40)
    given = q_actuated[:5].copy()
    given[3] = [0.1, 3.0, 0.1, 3.0, 0.1, 3.0]
    with pytest.raises(OutOfReach, match="row 3 of 5 is out of reach") as caught:
        robot.direct_geometry(given)
    assert caught.value.rows == (3,)
    with pytest.raises(OutOfReach, match="row is out of reach"):
        robot.direct_geometry(given[3])
    found = robot._direct.solve(given)
    assert found.ending.tolist() == [0, 0, 0, CROSSED, 0]
    np.testing.assert_array_equal(found.x[:3], robot.direct_geometry(given[:3]))


def test_redundant_motors_that_contradict_each_other_are_told():
    robot = load("4-rpr")
    _, _, q_actuated = poses("4-rpr", 40)
    given = q_actuated[:2].copy()
    given[1, 2] += 0.01
    assert robot._direct.solve(given).ending.tolist() == [0, OPEN]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"q": np.zeros(5)}, r"q_actuated has shape \(5,\), expected \(\.\.\., 6\)"),
        ({"q": np.zeros((2, 7))}, r"q_actuated has shape \(2, 7\)"),
        ({"q": 1.0}, r"q_actuated has shape \(\)"),
        ({"q": ["long"] * 6}, "q_actuated is no array of real numbers"),
        ({"q": np.ones(6, complex)}, "q_actuated is no array of real numbers"),
        ({"q": [[1.0, 2.0], [1.0]]}, "q_actuated is no array of real numbers"),
        ({"q": [1.0, np.nan, 1.0, 1.0, 1.0, 1.0]}, "q_actuated has a .* that is not finite$"),
        ({"q": np.full((2, 6), np.inf)}, "q_actuated has a .* that is not finite in row 0"),
        ({"x": np.zeros(6)}, r"near has shape \(6,\), expected \(\.\.\., 7\): x, y, z, qw"),
        ({"x": [0, 0, np.nan, 1, 0, 0, 0]}, "near has a z that is not finite"),
        ({"x": [0, 0, 0.9, 1, 1, 0, 0]}, "quaternion of near is off by 0.414"),
        ({"x": [1, 0, 0, 0, 0, 0, 0.9]}, "quaternion of near is off by 0.1"),
        ({"x": [0, 0, 0.9, 0, 0, 0, 0]}, "quaternion of near is off by 1"),
        ({"q": np.ones((3, 6)), "x": np.tile([0, 0, 0.9, 1, 0, 0, 0], (2, 1))}, "do not broadcast"),
    ],
)
def test_wrong_arguments_are_named(change, message):
    robot = load("gough-stewart")
    given = {"q": robot.home.q_actuated, "x": robot.home.x} | change
    for robot_like in (robot, gough.load("gough-stewart")):
        with pytest.raises(ConfigurationError, match=message):
            robot_like.direct_geometry(given["q"], given["x"])


@pytest.mark.parametrize("name", sorted(WITHOUT_OUTPUTS))
def test_a_mechanism_without_outputs_is_refused(name):
    with pytest.raises(ConfigurationError, match="has no operational coordinates"):
        load(name).direct_geometry([0.0])
