"""Laws of motions to follow."""

import numpy as np
import pytest

from gough import ConfigurationError, UnknownName, load
from gough.simulation.trajectories import (
    Circle,
    Followed,
    Formula,
    Hold,
    PointToPoint,
    Quintic,
    Sequence,
    Signals,
    Table,
    Trapezoid,
    corners,
    evaluated,
    followed,
    joined,
    require_start,
)

POSE = ("x", "y", "z", "qw", "qx", "qy", "qz")
STEP = 1e-5


def coordinates(names):
    """Coordinates by name, without a mechanism."""
    units = tuple("1" if n.startswith("q") else "rad" if n.startswith("r") else "m" for n in names)
    moving = [n for n in names if not n.startswith("q")]
    if "qw" in names:
        moving += ["rx", "ry", "rz"]
    home = np.array([1.0 if n == "qw" else 0.1 * k for k, n in enumerate(names)])
    if "qw" in names:
        home[3:] = [1.0, 0, 0, 0]
    periodic = tuple(n.startswith("r") for n in names)
    return Followed(names, units, tuple(moving), periodic, home, lambda q: q, ())


FULL, PLANE, SPACE = coordinates(POSE), coordinates(("x", "y", "rz")), coordinates(POSE[:3])


def quaternion(rng):
    q = rng.normal(size=4)
    return q / np.linalg.norm(q)


def pose(rng):
    return np.concatenate([rng.normal(size=3), quaternion(rng)])


def product(p, q):
    (a, *u), (w, *v) = p, q
    u, v = np.array(u), np.array(v)
    return np.array([a * w - u @ v, *(a * v + w * u + np.cross(u, v))])


def turned_rate(before, now, after, step):
    """Angular velocity from neighbours in time."""
    rate = (after - before) / (2 * step)
    return 2 * product(rate, now * [1, -1, -1, -1])[1:]


def motions():
    rng = np.random.default_rng(3)
    a, b, c = pose(rng), pose(rng), pose(rng)
    times = np.array([0.3, 0.7, 1.0, 1.6, 2.0])
    still = np.zeros((1, 6))
    rows = np.vstack([still, rng.normal(size=(3, 6)), still])
    poses = np.array([a, *(pose(rng) for _ in range(3)), b])
    poses[2, 3:] *= -1
    table = Table(times, poses, rows, rng.normal(size=(5, 6)))
    yield "quintic", FULL, PointToPoint(a, b, 1.5, delay=0.2), 2.0
    yield "trapezoid", FULL, PointToPoint(a, b, 1.5, Trapezoid(0.2)), 1.6
    yield "half", PLANE, PointToPoint([0, 1, 2], [1, 1, -2], 1.5, Trapezoid(0.5)), 1.6
    yield "circle", FULL, Circle([0, 1, 2], 0.3, [1, 2, 2], 1.5, duration=2.0), 2.1
    yield "circle in a plane", PLANE, Circle([0, 1], 0.3, laps=-1, duration=2.0), 2.1
    yield "table", FULL, table, 2.1
    parts = PointToPoint(c, a, 0.5), Hold(a, 0.2), table, PointToPoint(b, c, 0.5)
    yield "sequence", FULL, Sequence(*parts), 3.4
    yield "formula", FULL, Formula(spiral), 2.0


def spiral(t):
    return [t.sin(), t * t, 1 - t, t.cos() + 2, t, t.sin(), 0.3 * t]


MOTIONS = list(motions())
EVERY = pytest.mark.parametrize(
    ("coordinates", "reference", "last"), [m[1:] for m in MOTIONS], ids=[m[0] for m in MOTIONS]
)


@EVERY
def test_rates_and_accelerations_are_derivatives(coordinates, reference, last):
    rng = np.random.default_rng(0)
    times = rng.uniform(0.0, last, 60)
    jumps = reference.signals(coordinates).breaks
    near = np.abs(times[:, None] - jumps[None]).min(axis=1, initial=np.inf)
    times = times[near > 3 * STEP]
    before, now, after = (evaluated(reference, coordinates, times + d) for d in (-STEP, 0, STEP))
    for at, moving in coordinates.blocks:
        if at.stop - at.start == 4:
            rows = zip(before[0][:, at], now[0][:, at], after[0][:, at], strict=True)
            rate = np.array([turned_rate(*row, STEP) for row in rows])
        else:
            rate = (after[0][:, at] - before[0][:, at]) / (2 * STEP)
        np.testing.assert_allclose(now[1][:, moving], rate, atol=3e-7 * (1 + np.abs(rate).max()))
    acceleration = (after[1] - before[1]) / (2 * STEP)
    size = 1 + np.abs(acceleration).max()
    np.testing.assert_allclose(now[2], acceleration, atol=1e-6 * size)


@EVERY
def test_quaternions_have_length_1(coordinates, reference, last):
    found = evaluated(reference, coordinates, np.linspace(-1.0, last + 3.0, 50))
    assert all(np.isfinite(part).all() for part in found)
    for at, _ in coordinates.blocks:
        if at.stop - at.start == 4:
            np.testing.assert_allclose(np.linalg.norm(found[0][:, at], axis=1), 1.0, rtol=1e-14)


@EVERY
def test_they_rest_after_their_end(coordinates, reference, last):
    if not np.isfinite(reference.end):
        return
    end, later = reference.end, reference.end + 7.0
    positions, rates, accelerations = evaluated(reference, coordinates, [end, later])
    np.testing.assert_allclose(positions[0], positions[1], atol=1e-14)
    np.testing.assert_allclose(rates, 0, atol=1e-13)
    np.testing.assert_array_equal(accelerations[1], 0)


@pytest.mark.parametrize("profile", [Quintic(), Trapezoid(0.1), Trapezoid(0.5)])
def test_ends_are_exact(profile):
    rng = np.random.default_rng(5)
    a, b = pose(rng), pose(rng)
    reference = PointToPoint(a, b, 1.7, profile, delay=0.4)
    times = [-1.0, 0.0, 0.4, 2.1, 50.0]
    positions, rates, accelerations = evaluated(reference, FULL, times)
    np.testing.assert_array_equal(positions[:3, :3], np.tile(a[:3], (3, 1)))
    np.testing.assert_array_equal(positions[3:, :3], np.tile(b[:3], (2, 1)))
    for row in positions[:3, 3:]:
        np.testing.assert_allclose(row, a[3:], atol=1e-15)
    for row in positions[3:, 3:]:
        np.testing.assert_allclose(row * np.sign(row @ b[3:]), b[3:], atol=5e-16)
    np.testing.assert_array_equal(rates[[0, 1, 4]], 0)
    np.testing.assert_allclose(rates, 0, atol=1e-14)
    np.testing.assert_array_equal(accelerations[[0, 1, 4]], 0)


def test_an_orientation_turns_about_one_axis_the_shorter_way():
    rng = np.random.default_rng(11)
    for _ in range(20):
        a, b = pose(rng), pose(rng)
        _, rates, _ = evaluated(PointToPoint(a, b, 1.0, "trapezoid"), FULL, [0.1, 0.5, 0.7])
        axes = rates[:, 3:] / np.linalg.norm(rates[:, 3:], axis=1, keepdims=True)
        np.testing.assert_allclose(axes, np.tile(axes[0], (3, 1)), atol=1e-12)
        # the mean rate is that of the trapezoid in the middle times 1 - ramp
        angle = 0.75 * np.linalg.norm(rates[1, 3:])
        assert angle == pytest.approx(2 * np.arccos(abs(a[3:] @ b[3:])))
        assert angle <= np.pi


def test_half_a_turn_and_none():
    still, over = [0, 0, 0, 1, 0, 0, 0], [0, 0, 0, 0, 1, 0, 0]
    positions, rates, _ = evaluated(PointToPoint(still, over, 1.0), FULL, [0.5])
    np.testing.assert_allclose(np.abs(positions[0, 3:5]), np.sqrt(0.5))
    np.testing.assert_allclose(np.abs(rates[0, 3:]), [np.pi * 1.875, 0, 0])
    _, rates, _ = evaluated(PointToPoint(still, still, 1.0), FULL, [0.5])
    np.testing.assert_array_equal(rates, 0)


def test_a_trapezoid_has_the_rate_of_its_name():
    times = np.linspace(0, 2.0, 401)
    motion = PointToPoint([0, 0, 0], [1, 0, 0], 2.0, Trapezoid(0.3))
    _, rates, accelerations = evaluated(motion, SPACE, times)
    assert rates.max() == pytest.approx(1 / (2.0 * 0.7))
    assert set(np.round(accelerations[:, 0], 9)) <= set(np.round([-1 / 0.84, 0, 1 / 0.84], 9))


def test_a_circle_is_one():
    centre, normal = np.array([0.1, 0.2, 0.3]), np.array([1.0, 2.0, 2.0]) / 3
    reference = Circle(centre, 0.25, normal, 2, duration=3.0)
    times = np.linspace(0, 3, 50)
    positions, rates, _ = evaluated(reference, FULL, times)
    off = positions[:, :3] - centre
    np.testing.assert_allclose(np.linalg.norm(off, axis=1), 0.25)
    np.testing.assert_allclose(off @ normal, 0, atol=1e-15)
    np.testing.assert_allclose(positions[0], positions[-1], atol=1e-15)
    assert (np.cross(off, rates[:, :3]) @ normal >= 0).all()
    np.testing.assert_array_equal(positions[:, 3:], np.tile([1, 0, 0, 0], (50, 1)))
    half = np.sqrt(0.5)
    reference = Circle(centre, 0.25, duration=3.0, orientation=[half, 0, 0, half], begin=[0, 2, 5])
    positions, rates, _ = evaluated(reference, FULL, [0.0])
    np.testing.assert_allclose(positions[0], [0.1, 0.45, 0.3, half, 0, 0, half], atol=1e-15)


def test_a_table_matches_its_rows():
    name, coordinates, table, _ = MOTIONS[5]
    assert name == "table"
    found = evaluated(table, coordinates, table.times)
    signs = np.sign(np.sum(found[0][:, 3:] * table.positions[:, 3:], axis=1))
    rows = table.positions.copy()
    rows[:, 3:] *= signs[:, None]
    np.testing.assert_allclose(found[0], rows, atol=1e-14)
    np.testing.assert_allclose(found[1], table.rates, atol=1e-13)
    # behind the last row accelerations are 0
    np.testing.assert_allclose(found[2][:-1], table.accelerations[:-1], atol=1e-12)
    before = evaluated(table, coordinates, [0.0])
    np.testing.assert_allclose(before[0][0], found[0][0], atol=1e-15)
    np.testing.assert_array_equal(before[1], 0)


def test_signals_side_by_side_stay_what_they_are():
    rng = np.random.default_rng(2)
    a = Signals(("a",), np.array([0.0, 1.0, 2.0]), rng.normal(size=(3, 1, 6)))
    b = Signals(("b", "c"), np.array([0.3, 1.0]), rng.normal(size=(2, 2, 6)))
    times = np.linspace(0.3, 3, 30)
    both = joined([a, corners(0.5), b.later(0.2)])
    assert both.names == ("a", "b", "c")
    assert 0.5 in both.breaks
    expected = np.hstack([a.at(times), b.at(times - 0.2)])
    np.testing.assert_allclose(both.at(times), expected, rtol=1e-11, atol=1e-11)
    assert joined([]).names == ()


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: PointToPoint([0, 0, 0], [1, 0, 0], 0.0), "duration is 0.0 s; it must be positive"),
        (lambda: PointToPoint([0, 0], [1, 0, 0], 1.0), "start has 2 numbers and end has 3"),
        (lambda: PointToPoint([0, np.nan], [1, 0], 1.0), "start has entries that are not finite"),
        (lambda: PointToPoint([[0]], [1], 1.0), r"start has shape \(1, 1\)"),
        (lambda: PointToPoint(["a"], [1], 1.0), "expected numbers"),
        (lambda: PointToPoint([0], [1], "long"), "duration is 'long', expected a finite number"),
        (lambda: PointToPoint([0], [1], 1.0, delay=-1), "delay is -1 s"),
        (lambda: Trapezoid(0.6), "ramp is 0.6"),
        (lambda: Circle([0, 0, 0], -1, duration=1), "radius is -1 m"),
        (lambda: Circle([0, 0, 0], 1, [0, 0, 0], duration=1), "normal has the length 0"),
        (lambda: Circle([0, 0, 0], 1, begin=[0, 0, 1], duration=1), "other than the normal"),
        (lambda: Circle([0], 1, duration=1), "expected 3 each"),
        (lambda: Sequence(), "one reference at least"),
        (lambda: Sequence(Formula(spiral), Hold([0])), "never ends"),
        (lambda: Hold([0], -1), "can not be negative"),
        (lambda: Table([0, 1], [[0], [1]], [[0], [1]], [[0], [0]]), "last row, at 1 s, is not at"),
        (lambda: Table([1, 2], [[0], [1]], [[1], [0]], [[0], [0]]), "first row, at 1 s, is not at"),
        (lambda: Table([0, 0], [[0], [1]], [[1], [0]], [[0], [0]]), "does not come after"),
        (lambda: Table([0, 1], [[0]], [[1], [0]], [[0], [0]]), "positions has 1 rows"),
        (lambda: Table([0], [[0]], [[0]], [[0]]), "two at least"),
    ],
)
def test_what_can_not_be_is_refused(make, words):
    with pytest.raises(ConfigurationError, match=words):
        make()


def test_an_unknown_profile_is_named():
    with pytest.raises(UnknownName, match="Did you mean 'quintic'"):
        PointToPoint([0], [1], 1.0, "quintik")


@pytest.mark.parametrize(
    ("reference", "coordinates", "words"),
    [
        (Hold([0, 0]), SPACE, r"shape \(2,\), expected \(3,\): x, y, z"),
        (Hold([0, 0, 0, 2, 0, 0, 0]), FULL, "quaternion of positions has the length 2"),
        (Circle([0, 0, 0], 1, [1, 0, 0], duration=1), PLANE, "needs the coordinate z"),
        (Circle([0, 0, 0], 1, orientation=[1, 0], duration=1), FULL, "expected 4: qw, qx, qy, qz"),
        (Formula(lambda t: [t]), SPACE, "gives 1 expressions, expected 3"),
        (Table([0, 1], np.zeros((2, 3)), np.zeros((2, 3)), np.zeros((2, 3))), FULL, "expected 7"),
        (
            Table([0, 1], np.zeros((2, 3)), np.zeros((2, 3)), np.zeros((2, 3)), ("a", "b", "c")),
            SPACE,
            "the table is of a, b, c",
        ),
        (
            Sequence(Hold([0, 0, 0], 1), PointToPoint([0, 0, 0.5], [0, 0, 1], 1)),
            SPACE,
            "reference 2 of 2 does not begin where the one before ends: .* 0.5 m away .* z",
        ),
    ],
)
def test_what_does_not_fit_a_mechanism_is_refused(reference, coordinates, words):
    with pytest.raises(ConfigurationError, match=words):
        evaluated(reference, coordinates, [0.0])


def test_a_start_away_from_the_reference_tells_how_far():
    rng = np.random.default_rng(4)
    a, b = pose(rng), pose(rng)
    reference = PointToPoint(a, b, 1.0)
    other = a.copy()
    other[3:] *= -1
    require_start(reference, FULL, other, np.zeros(6))
    other[1] += 0.25
    with pytest.raises(ConfigurationError, match=r"begins 0.25 m away from the start, in y"):
        require_start(reference, FULL, other)
    require_start(reference, FULL, other, tolerance=0.3)
    turned = product([np.cos(0.1), 0, 0, np.sin(0.1)], a[3:])
    with pytest.raises(ConfigurationError, match=r"begins 0.2 rad away .* in orientation"):
        require_start(reference, FULL, np.concatenate([a[:3], turned]))
    with pytest.raises(ConfigurationError, match=r"rate of y that is 2 away"):
        require_start(reference, FULL, a, np.array([0, 2.0, 0, 0, 0, 0]))
    require_start(Hold([0, 0, 7.0]), PLANE, np.array([0, 0, 7.0 - 2 * np.pi]))


def test_coordinates_of_mechanisms():
    robot = load("gough-stewart")
    model = robot.dynamics.model("platform")
    whole = followed(model)
    assert whole.names == POSE
    assert [r.stop - r.start for r, _ in whole.blocks] == [1, 1, 1, 4]
    motors = followed(model, "inputs")
    assert motors.names == robot.dynamics.motors
    lengths = robot.home.q[[robot.position_names.index(name) for name in motors.names]]
    np.testing.assert_array_equal(motors.of(robot.home.q), lengths)
    assert followed(model, ["leg2.slide"]).names == ("leg2.slide",)
    with pytest.raises(UnknownName, match=r"leg2\.slide"):
        followed(model, ["leg2.slid"])
    with pytest.raises(ConfigurationError, match="a quaternion holds it"):
        followed(model, ["platform.rx"])
    biped = load("biped-leg").dynamics.model("joint")
    assert followed(biped).names == load("biped-leg").dynamics.motors
    with pytest.raises(ConfigurationError, match="no outputs"):
        followed(biped, "outputs")


def test_tables_are_read_from_files_and_columns(tmp_path):
    robot = load("five-bar")
    coordinates = followed(robot.dynamics.model("platform"))
    times = np.linspace(0, 1, 41)
    start, end = robot.home.x, np.add(robot.home.x, [0.05, -0.02])
    motion = PointToPoint(start, end, 1.0)
    positions, rates, accelerations = evaluated(motion, coordinates, times)
    path = tmp_path / "motion.csv"
    rows = [f"{t!r},{1e3 * x!r},{1e3 * y!r}" for t, (x, y) in zip(times, positions, strict=True)]
    path.write_text("\n".join(["time [s],x [mm],y [mm]", *rows]).replace("np.float64", ""))
    path.write_text(path.read_text().replace("(", "").replace(")", ""))
    fine = np.linspace(0, 1, 333)
    expected = evaluated(motion, coordinates, fine)
    columns = {"time": times, "x": positions[:, 0], "y": positions[:, 1]}
    exact = columns | {f"d{n}": rates[:, k] for k, n in enumerate("xy")}
    exact |= {f"dd{n}": accelerations[:, k] for k, n in enumerate("xy")}
    for source, far in ((path, 1e-6), (columns, 1e-6), (exact, 1e-14)):
        found = evaluated(Table.read(robot, source), coordinates, fine)
        np.testing.assert_allclose(found[0], expected[0], atol=far)
    with pytest.raises(UnknownName, match="column"):
        Table.read(robot, {"time": times, "u": times})


def test_a_rotation_vector_in_a_table_has_its_own_rates():
    robot = load("3-rps")
    coordinates = followed(robot.dynamics.model("platform"))
    assert coordinates.turned
    times = np.linspace(0, 1, 61)
    motion = PointToPoint(robot.home.x, np.add(robot.home.x, [0.02, 0.2, -0.1]), 1.0)
    positions, *_ = evaluated(motion, coordinates, times)
    columns = dict(zip(coordinates.names, positions.T, strict=True)) | {"time": times}
    found = evaluated(Table.read(robot, columns), coordinates, times + 0.003)
    expected = evaluated(motion, coordinates, times + 0.003)
    np.testing.assert_allclose(found[0], expected[0], atol=1e-8)
    np.testing.assert_allclose(found[1], expected[1], atol=1e-5)
