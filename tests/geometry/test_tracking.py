"""Paths through closed configurations: never on another mode, singularities where they are."""

import numpy as np
import pytest
from scipy.optimize import brentq, fsolve

import gough
from gough.errors import ConfigurationError
from gough.geometry.path_reports import Ending
from gough.geometry.path_routes import Route
from gough.geometry.tracking import Tracker

# the 3-RPR of Innocenti and Parenti-Castelli (1992) and McAree and Daniel (1999), in units of 10
# of theirs: sides of the platform 17.04, 16.54, 20.84
BASE = np.array([[0, 0], [1.591, 0], [0, 1]])
PLATFORM = np.array([[0, 0], [1.704, 0], [1.323637323943662, 1.609670854]])
CUSPS = [
    # the first leg; a cusp of the singular curve in the plane of the two others; where on a circle
    # round it there are most modes, and the sense in which one of them goes round
    (1.498, [1.60276705, 2.95667140], 5.0964, 1),
    (1.498, [1.79885469, 2.64461833], 4.5728, -1),
    (1.498, [3.12761261, 1.61784504], 3.5256, 1),
]


@pytest.fixture(scope="module")
def three_rpr():
    return gough.load(
        "3-rpr", B=BASE.tolist(), P=PLATFORM.tolist(), x=1.0, y=0.8, theta=0.3
    )  # fmt: skip


def tracker(robot):
    inverse = robot._inverse if robot.structure.columns("operational") else None
    return Tracker(robot.kinematics, inverse)


# an independent 3-RPR, in batches


def legs(x, base=BASE, platform=PLATFORM):
    """Legs from base to platform, (*batch, 3, 2), and the arms of the platform."""
    c, s = np.cos(x[..., 2]), np.sin(x[..., 2])
    R = np.stack([c, -s, s, c], axis=-1).reshape(*c.shape, 2, 2)
    arms = platform @ R.swapaxes(-1, -2)
    return x[..., None, :2] + arms - base, arms


def lengths(x):
    return np.linalg.norm(legs(x)[0], axis=-1)


def jacobian(x):
    """Derivative of half the squares of the lengths, (*batch, 3, 3)."""
    d, arms = legs(x)
    return np.concatenate([d, (d[..., 1] * arms[..., 0] - d[..., 0] * arms[..., 1])[..., None]], -1)


def followed(x, path, count):
    """Poses along paths of lengths by many short Newton steps, until a determinant changes sign.

    Args:
        x: where to start, (batch, 3).
        path: lengths at s, (batch, 3).
        count: how many steps.

    Returns:
        (count + 1, batch, 3), NaN from where a path ends on.
    """
    found, alive = [x], np.ones(len(x), dtype=bool)
    sign = np.sign(np.linalg.det(jacobian(x)))
    before = x
    for k in range(1, count + 1):
        goal, guess = path(k / count), 2 * x - before
        for _ in range(6):
            r = 0.5 * (np.sum(legs(guess)[0] ** 2, axis=-1) - goal**2)
            J = np.where(alive[:, None, None], jacobian(guess), np.eye(3))
            guess = guess - np.linalg.solve(J, r[..., None])[..., 0]
        with np.errstate(invalid="ignore"):
            alive &= np.abs(lengths(guess) - goal).max(axis=1) < 1e-10
            alive &= np.sign(np.linalg.det(jacobian(guess))) == sign
            alive &= np.abs(guess - x).max(axis=1) < 0.05
        before, x = x, np.where(alive[:, None], guess, x)
        found.append(np.where(alive[:, None], x, np.nan))
    return np.array(found)


def turned(x, y):
    """Distance of poses, whole turns aside."""
    d = x - y
    d[..., 2] -= 2 * np.pi * np.round(d[..., 2] / (2 * np.pi))
    return np.abs(d).max(axis=-1)


# assembly modes


@pytest.mark.parametrize("cusp", CUSPS)
def test_a_loop_round_a_cusp_changes_the_assembly_mode_without_a_singularity(three_rpr, cusp):
    first, centre, angle, sense = cusp

    def loop(s):
        w = angle + sense * 2 * np.pi * s
        return np.array([first, centre[0] + 0.06 * np.cos(w), centre[1] + 0.06 * np.sin(w)])

    modes = three_rpr.assembly_modes(loop(0.0))
    changed = []
    for k, start in enumerate(modes.q):
        track = tracker(three_rpr).follow(loop, "inputs", near=start, samples=201)
        assert track.certified
        if not track.arrived:
            assert track.ending is Ending.merged  # this one meets another at the fold
            continue
        assert not track.events
        assert len(set(track.determinant.tolist())) == 1
        (end,) = np.flatnonzero(turned(modes.x.copy(), track.x[-1]) < 1e-9)
        if end == k:
            continue
        changed.append((k, end))
        # every row is an assembly mode, and the one that short Newton steps lead to
        reference = followed(track.x[:1], lambda s: loop_of_pieces(loop, s)[None], 4000)[::20, 0]
        assert np.all(turned(reference, track.x) < 1e-8)
        for row in range(0, 201, 10):
            there = three_rpr.assembly_modes(loop(row / 200)).x
            distances = np.sort(turned(there.copy(), track.x[row]))
            assert distances[0] < 1e-8 < distances[1]
    assert changed


def loop_of_pieces(loop, s):
    """The straight pieces that are followed instead of a function."""
    k = min(int(s * 200 + 1e-9), 199)
    u = s * 200 - k
    return (1 - u) * loop(k / 200) + u * loop((k + 1) / 200)


def test_random_paths_never_jump(three_rpr):
    """Paths of a 3-RPR against many short Newton steps; those that merge pass near misses."""
    rng = np.random.default_rng(5)
    starts, ends, configurations = [], [], []
    while len(starts) < 50:
        x = np.array([*rng.uniform(-1, 2, 2), rng.uniform(-np.pi, np.pi)])
        if not three_rpr.reach(x).reached:
            continue
        starts.append(x)
        configurations.append(three_rpr.inverse_geometry(x))
        ends.append(lengths(x) + rng.normal(size=3) * rng.choice([0.05, 0.3, 0.8]))
    starts, ends = np.array(starts), np.abs(np.array(ends))
    given = lengths(starts)
    reference = followed(starts, lambda s: (1 - s) * given + s * ends, 3200)
    follow, merged = tracker(three_rpr), 0
    for k in range(50):
        path, near = [given[k], ends[k]], configurations[k]
        track = follow.follow(path, "inputs", near=near, samples=33)
        # steps as long as proofs allow lead to the same end
        fast = follow.follow(path, "inputs", near=near, samples=2)
        assert (fast.ending, fast.certified) == (track.ending, True)
        assert fast.s[-1] == pytest.approx(track.s[-1], abs=1e-9)
        assert turned(fast.x[-1].copy(), track.x[-1]) < 1e-5
        assert track.certified, str(track)
        assert track.ending in (Ending.arrived, Ending.merged), str(track)
        steps = np.round(track.s * 3200).astype(int)
        on_grid = np.abs(track.s * 3200 - steps) < 1e-6
        rows = reference[steps[on_grid], k]
        assert np.all(turned(rows, track.x[on_grid]) < 1e-6), k
        if track.arrived:
            assert np.isfinite(reference[-1, k]).all()
        else:
            merged += 1
            last = np.isfinite(reference[:, k, 0]).sum() - 1
            assert last / 3200 <= track.s[-1] <= (last + 2) / 3200
    assert merged > 5


@pytest.mark.parametrize("gap", [1e-2, 1e-4])
def test_modes_next_to_each_other_are_told_apart(three_rpr, gap):
    """Past a fold at a distance at which two modes are `gap` apart."""
    x = _singular_pose()
    null = np.linalg.svd(jacobian(x))[2][-1]
    near = x + 0.5 * gap * null
    other = x - 0.5 * gap * null
    target = lengths(near)
    # the partner: the solution of the same lengths on the other side
    found = fsolve(lambda z: lengths(z) - target, other, xtol=1e-14)
    assert 0.5 * gap < turned(found.copy(), near) < 2 * gap
    # along the fold: the direction of lengths that the singular pose allows
    along = jacobian(x)[:, :2] @ np.array([0.6, 0.8]) / lengths(x)
    for start in (near, found):
        q = three_rpr.inverse_geometry(start)
        for end in (target - 0.02 * along, target + 0.02 * along):
            track = tracker(three_rpr).follow([target, end], "inputs", near=q, samples=5)
            assert track.certified
            assert len(set(track.determinant.tolist())) == 1
            # poses change with the root of s here

            def path(u, end=end):
                return ((1 - u * u) * target + u * u * end)[None]

            reference = followed(start[None], path, 4000)[:, 0]
            for row, k in ((1, 2000), (4, 4000)):
                assert turned(reference[k], track.x[row]) < 1e-6


def _singular_pose():
    """A pose at a fold."""

    def determinant(theta):
        return float(np.linalg.det(jacobian(np.array([1.0, 0.8, theta]))))

    thetas = np.linspace(-np.pi, np.pi, 200)
    values = [determinant(theta) for theta in thetas]
    k = next(k for k in range(199) if values[k] * values[k + 1] < 0)
    theta = brentq(determinant, thetas[k], thetas[k + 1], xtol=1e-15)
    return np.array([1.0, 0.8, theta])


def test_a_path_through_a_fold_ends_there(three_rpr):
    x = _singular_pose()
    null = np.linalg.svd(jacobian(x))[2][-1]
    start = x + 0.1 * null
    goal = lengths(x) + (lengths(x) - lengths(start))
    track = tracker(three_rpr).follow(
        [lengths(start), goal], "inputs", near=three_rpr.inverse_geometry(start)
    )
    # the fold on this path: lengths on the line, determinant zero
    given = lengths(start)

    def fold(z):
        return [*(lengths(z[:3]) - given - z[3] * (goal - given)), np.linalg.det(jacobian(z[:3]))]

    z = fsolve(fold, [*x, 0.5], xtol=1e-14)
    assert np.abs(fold(z)).max() < 1e-12
    assert track.ending is Ending.merged
    assert track.certified
    (event,) = track.events
    assert event.kind == "type 2"
    assert "platform.rz" in event.text
    assert event.s == pytest.approx(z[3], abs=1e-9)
    assert turned(track.x[-1].copy(), z[:3]) < 1e-6
    assert len(three_rpr.assembly_modes(given + (event.s - 1e-6) * (goal - given))) == 2 + len(
        three_rpr.assembly_modes(given + (event.s + 1e-6) * (goal - given))
    )


def test_balls_hold_the_solution_all_along_a_stretch(three_rpr):
    """What a certificate says of every place of a stretch, at places where it can be solved."""
    follow = tracker(three_rpr)
    rng = np.random.default_rng(3)
    x = three_rpr.home.x
    found = 0
    for size in 10.0 ** rng.uniform(-4, 0, size=40):
        ends = lengths(x) + np.array([[0.0], [1.0]]) * size * rng.normal(size=3)
        route = Route(follow.coordinates["inputs"], three_rpr.home.q, ends)
        follower = follow.follower("inputs", route)
        state = follower.start(three_rpr.home.q)
        stretch = route.middle(0, 1), route.box(0, 1), route.change(0, 1)
        ball = follower.stretches.along(*stretch, state.unknowns)
        if not (ball.real and ball.holds(state.ball)):
            continue
        found += 1
        a = ball.found.x[0].real
        poses = followed(x[None], lambda s, e=ends: ((1 - s) * e[0] + s * e[1])[None], 200)[:, 0]
        assert np.isfinite(poses).all()
        closure = follower.closure
        for pose in poses[::20]:
            q = three_rpr.inverse_geometry(pose)
            values = closure.problem.measured(q, closure.problem.assembler.p)
            left = values[closure.problem.left]
            y = np.linalg.solve(ball.T, np.concatenate([[1.0], left]) / closure.size)
            assert np.abs(y * (a @ a) / (a @ y) - a).max() <= ball.found.radius[0] + 1e-9
    assert 5 < found < 40


# outputs


def test_a_path_of_outputs_that_crosses_type_2_stops_or_reports_it():
    robot = gough.load("five-bar")
    path = [robot.home.x, [0.45, -0.8]]
    stopped = tracker(robot).follow(path)
    assert stopped.ending is Ending.stopped
    (event,) = stopped.events
    assert event.kind == "type 2"
    assert robot.kinematics.type_2(event.q) < 1e-9
    assert stopped.s[-1] == event.s
    through = tracker(robot).follow(path, on_singularity="continue")
    assert through.arrived
    assert through.certified
    assert [e.kind for e in through.events] == ["type 2", "type 2"]
    assert through.events[0].s == pytest.approx(event.s, abs=1e-10)
    signs = through.determinant
    first, second = (e.s for e in through.events)
    inside = (through.s > first) & (through.s < second)
    assert np.all(signs == np.where(inside, -1, 1))
    assert set(through.mode) == {"-+"}


def test_a_path_that_leaves_the_workspace_ends_with_the_leg_named():
    robot = gough.load("five-bar")
    start, end = robot.home.x, np.array([0.5, 1.4])
    track = tracker(robot).follow([start, end], on_singularity="continue")

    def left(s):
        """What is left of the reach of leg 2, m: its links are 0.6 m and 0.7 m long."""
        return 1.3 - np.linalg.norm(start + s * (end - start) - [1, 0])

    assert track.ending is Ending.out_of_reach
    assert track.s[-1] == pytest.approx(brentq(left, 0, 1, xtol=1e-15), abs=1e-12)
    assert [e.kind for e in track.events] == ["type 1", "not reached"]
    assert "leg2.motor" in track.events[0].text
    assert track.reason.startswith("leg2.lower is too short")
    assert "leg2" in str(track)


@pytest.mark.parametrize("name", ["five-bar", "3-rrr"])
def test_a_path_of_inputs_past_a_toggle_changes_the_working_mode(name):
    """From one working mode at the edge of the workspace to the other, by the motors."""
    robot = gough.load(name)
    outside = np.array(robot.home.x)
    outside[:2] += [0.0, 2.0]
    to_edge = tracker(robot).follow([robot.home.x, outside], on_singularity="continue")
    at = robot.home.x + 0.995 * to_edge.s[-1] * (outside - robot.home.x)
    leg = next(k for k, label in enumerate(to_edge.branches) if label in to_edge.reason)
    modes = robot.working_modes(at)
    here = to_edge.mode[-1]
    there = here[:leg] + ("-" if here[leg] == "+" else "+") + here[leg + 1 :]
    q, goal = (modes.q_actuated[modes.words().index(word)] for word in (here, there))
    near = modes.q[modes.words().index(here)]
    track = tracker(robot).follow([q, goal], "inputs", near=near, on_singularity="continue")
    assert track.certified
    toggles = track.of_kind("toggle")
    assert [e.text.split()[0] for e in toggles] == [to_edge.branches[leg]]
    assert robot.kinematics.type_1(toggles[0].q) < 1e-8
    assert (track.mode[0], track.mode[-1]) == (here, there)
    stopped = tracker(robot).follow([q, goal], "inputs", near=near)
    assert stopped.ending is Ending.stopped
    assert stopped.s[-1] == pytest.approx(toggles[0].s, abs=1e-9)


@pytest.mark.parametrize("name", ["gough-stewart", "orthoglide", "agile-eye", "3-upu"])
@pytest.mark.parametrize("given", ["outputs", "inputs"])
def test_short_paths_are_followed_with_proof(name, given):
    robot = gough.load(name)
    follow = tracker(robot)
    coordinates = follow.coordinates[given]
    rng = np.random.default_rng(2)
    start = coordinates.of(robot.home.q)
    points = start + np.array([np.zeros(len(start)), *rng.normal(size=(2, len(start))) * 0.02])
    for k, label in enumerate(coordinates.names):
        if label.endswith("qw"):
            points[:, k : k + 4] /= np.linalg.norm(points[:, k : k + 4], axis=1, keepdims=True)
    track = follow.follow(points, given, samples=21)
    assert track.arrived
    assert track.certified
    assert not track.events
    np.testing.assert_allclose(coordinates.of(track.q)[[0, 10, -1]], points, atol=1e-9)
    assert robot.assembler.gaps(track.q).max() < 1e-9
    if given == "outputs":
        np.testing.assert_allclose(track.q, robot.inverse_geometry(track.x), atol=1e-8)
    else:
        x = robot.direct_geometry(track.q_actuated, near=track.x[np.maximum(np.arange(21) - 1, 0)])
        np.testing.assert_allclose(x, track.x, atol=1e-8)


def test_a_path_without_polynomials_is_followed_without_proof():
    robot = gough.load("3-rps")  # its outputs leave the platform's other coordinates open
    end = robot.home.x + np.array([0.05, 0.1, -0.1])
    track = tracker(robot).follow([robot.home.x, end])
    assert track.arrived
    assert not track.certified
    assert "not proved" in track.notes[0]
    np.testing.assert_allclose(track.x[-1], end, atol=1e-9)


def test_a_flat_parallelogram_is_passed_on_the_same_solution():
    """The two modes of a parallelogram cross where it is flat: no fold, no end."""
    robot = gough.load("four-bar", a=0.2, b=0.35, c=0.2, d=0.35)
    path = [[np.pi / 3], [-np.pi / 4]]
    stopped = tracker(robot).follow(path, "inputs")
    assert stopped.ending is Ending.stopped
    track = tracker(robot).follow(path, "inputs", on_singularity="continue")
    assert track.arrived
    assert not track.certified
    (event,) = track.events
    assert event.kind == "type 3"
    assert event.s == pytest.approx(4 / 7, abs=1e-8)
    np.testing.assert_allclose(track.q[-1], [-np.pi / 4, -np.pi / 4, np.pi / 4], atol=1e-9)


def test_motors_that_do_not_agree_are_named():
    robot = gough.load("4-rpr")
    goal = robot.home.q_actuated + np.array([0.02, 0, 0, 0])
    track = tracker(robot).follow([robot.home.q_actuated, goal], "inputs")
    assert track.ending is Ending.open
    assert track.s[-1] < 1e-5
    assert track.events[-1].kind == "not reached"
    assert "of which the proofs know nothing" in track.notes[0]


def test_a_path_begins_where_the_configuration_leads(three_rpr):
    goal = three_rpr.home.q_actuated * 1.02
    track = tracker(three_rpr).follow([goal, three_rpr.home.q_actuated], "inputs", samples=5)
    np.testing.assert_allclose(track.q[-1], three_rpr.home.q, atol=1e-9)
    far = tracker(three_rpr).follow([[9, 1, 1], three_rpr.home.q_actuated], "inputs")
    assert far.ending is Ending.no_start
    assert "on the way to it" in far.reason
    assert len(far) == 0
    assert str(far)


# boxes


def test_boxes_enclose_turning_paths():
    robot = gough.load("gough-stewart")
    coordinates = tracker(robot).coordinates["outputs"]
    rng = np.random.default_rng(0)
    points = rng.normal(size=(3, 7))
    points[:, 3:] /= np.linalg.norm(points[:, 3:], axis=1, keepdims=True)
    _assert_boxes_enclose(Route(coordinates, robot.home.q, points), rng)


def test_boxes_enclose_rotation_vectors():
    robot = gough.load("agile-eye")
    coordinates = tracker(robot).coordinates["outputs"]
    rng = np.random.default_rng(0)
    _assert_boxes_enclose(Route(coordinates, robot.home.q, rng.normal(size=(3, 3))), rng)


def _assert_boxes_enclose(route, rng):
    for _ in range(50):
        a, b = np.sort(rng.uniform(0, 0.5, size=2)) + rng.choice([0.0, 0.5])
        low, high = route.box(a, b)
        slow, fast = route.change(a, b)
        u = np.linspace(0, 1, 50)
        q = np.array([route.configuration(a + x * (b - a)) for x in u])
        assert np.all((low <= q) & (q <= high))
        rates = np.diff(q, axis=0) / np.diff(u)[:, None]
        assert np.all((slow - 1e-12 <= rates) & (rates <= fast + 1e-12))


# what is wrong


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"path": [[0.1, 0.2]]}, r"path has shape \(1, 2\), expected \(m, 2\)"),
        ({"path": [0.1, 0.2]}, r"path has shape \(2,\)"),
        ({"path": [[0.1, 0.2, 0.3]] * 2}, r"path has shape \(2, 3\)"),
        ({"path": [[0.1, 0.2], [0.1, np.nan]]}, "not finite, the first in row 1"),
        ({"path": lambda s: [s]}, r"path\(s\) has shape \(1,\), expected \(2,\)"),
        ({"given": "joints"}, "of is 'joints', expected one of outputs, inputs"),
        ({"on_singularity": "jump"}, "on_singularity is 'jump'"),
        ({"path": [[0.1, 0.2], [0.1]]}, "expected numbers in rows of one length"),
        ({"path": "straight"}, "path is 'straight', expected numbers"),
        ({"path": lambda s: "there"}, r"path\(s\) is 'there', expected numbers"),
        ({"samples": 1}, "samples is 1"),
        ({"samples": 10.5}, "samples is 10.5, expected a whole number"),
        ({"near": [0.0, 1.0]}, r"near has shape \(2,\), expected \(6,\)"),
        ({"near": np.zeros(6)}, "near is not closed"),
    ],
)
def test_wrong_arguments_are_named(change, message):
    robot = gough.load("five-bar")
    arguments = {"path": [robot.home.x, robot.home.x], "given": "outputs"} | change
    with pytest.raises(ConfigurationError, match=message):
        tracker(robot).follow(**arguments)


def test_quaternions_have_length_one():
    robot = gough.load("gough-stewart")
    path = np.array([robot.home.x, robot.home.x])
    path[1, 3:] *= 1.1
    with pytest.raises(ConfigurationError, match=r"quaternion in row 1 of path is 1\.1"):
        tracker(robot).follow(path)


def test_a_mechanism_without_outputs_says_so():
    robot = gough.load("biped-leg")
    with pytest.raises(ConfigurationError, match="has no operational coordinates to follow"):
        tracker(robot).follow([[0.0], [1.0]])
