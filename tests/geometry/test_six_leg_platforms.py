"""Assembly modes of platforms on six legs: lists known to be complete, laws, counts, hard cases."""

import importlib.util
import json
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from hypothesis import settings

from gough.geometry.six_leg_classes import SHARED_POINTS, expected_counts
from gough.geometry.six_leg_platforms import (
    Completeness,
    SixLegPlatform,
)
from gough.geometry.six_leg_sections import DEGREE, PATTERN, generic_start

LONG = settings.get_current_profile_name() == "long"
DATA = Path(__file__).parents[1] / "data"
CASES = [
    case
    for name in ("dietmaier", "6ups")
    for case in json.loads((DATA / f"assembly_modes_{name}.json").read_text("utf-8"))["cases"]
]
DOUBLE = "proved, one of those that are equal but for rounding: a singularity of type 2"


def rotation(q):
    """The rotation of a unit quaternion w x y z."""
    w, v = q[0], np.asarray(q[1:])
    cross = np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])
    return np.eye(3) + 2 * w * cross + 2 * cross @ cross


def random_rotation(rng):
    q = rng.normal(size=4)
    return rotation(q / np.linalg.norm(q))


def lengths_at(base, platform, R, p):
    return np.linalg.norm(platform @ R.T + p - base, axis=1)


def hexagon(half, turn=0.0):
    """Three pairs of points on a circle, `half` from the middle of the pair, in rad."""
    angles = turn + np.array([2 * np.pi * k / 3 + s * half for k in range(3) for s in (-1, 1)])
    return np.stack([np.cos(angles), np.sin(angles), 0 * angles], axis=1)


def drawn(rng, points, of=range(6), flat=False):
    """Random points, one for each leg."""
    chosen = rng.normal(size=(points, 3)) * [1, 1, 0 if flat else 1]
    return chosen[list(of)]


def affine(rng):
    a = drawn(rng, 6, flat=True)
    return a, a @ (rng.normal(size=(3, 3)) * [1, 1, 0])


CLASSES = {
    "general": (40, lambda rng: (drawn(rng, 6), drawn(rng, 6))),
    "planar base": (40, lambda rng: (drawn(rng, 6), drawn(rng, 6, flat=True))),
    "planar platform": (40, lambda rng: (drawn(rng, 6, flat=True), drawn(rng, 6))),
    "both planar": (40, lambda rng: (drawn(rng, 6, flat=True), drawn(rng, 6, flat=True))),
    "6-5": (40, lambda rng: (drawn(rng, 5, [0, 1, 2, 3, 4, 4]), drawn(rng, 6))),
    "5-5, pairs with a common leg": (
        40,
        lambda rng: (drawn(rng, 5, [0, 1, 2, 3, 4, 4]), drawn(rng, 5, [0, 1, 2, 3, 3, 4])),
    ),
    "5-5, disjoint pairs": (
        24,
        lambda rng: (drawn(rng, 5, [0, 1, 2, 3, 4, 4]), drawn(rng, 5, [0, 0, 1, 2, 3, 4])),
    ),
    "6-4": (32, lambda rng: (drawn(rng, 4, [0, 1, 2, 2, 3, 3]), drawn(rng, 6))),
    "triple point": (16, lambda rng: (drawn(rng, 4, [0, 1, 2, 3, 3, 3]), drawn(rng, 6))),
    "6-3": (16, lambda rng: (drawn(rng, 3, [0, 0, 1, 1, 2, 2]), drawn(rng, 6))),
    "octahedral 3-3": (
        16,
        lambda rng: (drawn(rng, 3, [0, 0, 1, 1, 2, 2]), drawn(rng, 3, [0, 1, 1, 2, 2, 0])),
    ),
    "two hexagons": (
        28,
        lambda rng: (
            rng.uniform(0.4, 0.9) * hexagon(rng.uniform(0.1, 0.5)),
            hexagon(rng.uniform(0.1, 0.5))[[1, 0, 3, 2, 5, 4]],
        ),
    ),
    "affinely equal": (16, affine),
}


def member(name, rng):
    """Base, platform, lengths and the pose they are of."""
    platform, base = CLASSES[name][1](rng)
    R, p = random_rotation(rng), 1.5 * rng.normal(size=3)
    return base, platform, lengths_at(base, platform, R, p), R, p


def check_poses(base, platform, lengths, modes):
    for *p, w, x, y, z in modes.poses:
        assert w >= 0
        np.testing.assert_allclose(np.linalg.norm([w, x, y, z]), 1, atol=1e-15)
        found = lengths_at(base, platform, rotation([w, x, y, z]), p)
        np.testing.assert_allclose(found, lengths, rtol=1e-8, atol=1e-8)


def holds(modes, R, p, atol=1e-7):
    """Whether a pose is among the modes."""
    return any(
        np.abs(np.r_[pose[:3] - p, (rotation(pose[3:]) - R).ravel()]).max() < atol
        for pose in modes.poses
    )


def calls(platform, lengths):
    """The modes by the generic start, and by the platform's own."""
    first = platform.modes(lengths)
    platform.prepare(lengths)
    return first, platform.modes(lengths)


# lists that are known


@pytest.mark.parametrize("case", CASES, ids=lambda case: case["name"])
def test_the_modes_are_exactly_those_of_the_reference(case):
    base, platform = np.array(case["base"]), np.array(case["platform"])
    known = np.array([[*pose["p"], *pose["q"]] for pose in case["poses"]])
    for modes in calls(SixLegPlatform(base, platform), case["lengths"]):
        assert len(modes.poses) == len(known)
        assert modes.certified.all()
        near = []
        for pose in modes.poses:
            same = np.where(known[:, 3:] @ pose[3:] < 0, -1, 1)[:, None]
            apart = np.abs(known * np.c_[np.ones((len(known), 3)), same * np.ones(4)] - pose)
            size = np.r_[[np.abs(known[:, :3]).max()] * 3, [1] * 4]
            near.append(np.argmin((apart / size).max(axis=1)))
            assert (apart / size).max(axis=1).min() < 1e-9
        assert sorted(near) == list(range(len(known)))
        assert modes.complex_count == case["n_complex_certified"]
        general = modes.complex_count == DEGREE
        assert modes.completeness is (Completeness.certified if general else Completeness.expected)


# random platforms


@pytest.mark.parametrize("seed", range(1000 if LONG else 30))
def test_general_platforms_have_forty_proved_solutions(seed):
    base, platform, lengths, R, p = member("general", np.random.default_rng(seed))
    first, own = calls(SixLegPlatform(base, platform), lengths)
    for modes in (first, own):
        assert modes.completeness is Completeness.certified
        assert modes.complex_count == DEGREE
        assert modes.lost == 0
        assert modes.certified.all()
        assert not modes.certificates.lone.any()
        assert len(modes.poses) % 2 == 0
        check_poses(base, platform, lengths, modes)
        assert holds(modes, R, p)
    assert len(first.poses) == len(own.poses)
    bounds = first.pose_errors + own.pose_errors
    assert np.all(np.linalg.norm(first.poses[:, :3] - own.poses[:, :3], axis=1) <= bounds[:, 0])
    assert np.all(np.linalg.norm(first.poses[:, 3:] - own.poses[:, 3:], axis=1) <= bounds[:, 1])


@pytest.mark.parametrize("name", CLASSES)
def test_special_platforms_have_the_solutions_of_their_class(name):
    count = CLASSES[name][0]
    for seed in range(20):
        base, platform, lengths, R, p = member(name, np.random.default_rng(100 + seed))
        known = SixLegPlatform(base, platform)
        assert known.expected[0] == count
        for modes in calls(known, lengths):
            assert modes.complex_count == count
            assert modes.completeness is (
                Completeness.certified if count == DEGREE else Completeness.expected
            )
            assert modes.lost == 0
            assert holds(modes, R, p)
            check_poses(base, platform, lengths, modes)
        assert modes.infinite == 0  # from its own start


@pytest.mark.parametrize("count", [count for count in SHARED_POINTS if count])
def test_platforms_whose_legs_share_points_have_the_counts_of_the_table(count):
    rng = np.random.default_rng(count)
    for kind in SHARED_POINTS[count].split():
        platform, base = (drawn(rng, 6, [int(k) for k in side]) for side in kind.split("/"))
        order = rng.permutation(6)
        known = SixLegPlatform(base[order], platform[order])
        assert known.expected == (count,)
        assert known.prepare(rng.uniform(1, 3, 6)) == count


def test_each_mirror_that_base_and_platform_share_takes_four_solutions():
    rng = np.random.default_rng(5)
    half_a, half_b = rng.normal(size=(2, 3, 3))
    a, b = (np.concatenate([half, half * [1, -1, 1]]) for half in (half_a, half_b))
    known = SixLegPlatform(b, a)
    assert known.expected == (36,)
    assert known.modes(rng.uniform(1, 3, 6)).complex_count == 36
    # the wrong legs: nothing special
    assert SixLegPlatform(b, a[[0, 1, 2, 4, 5, 3]]).expected == (40,)


def test_rounded_hexagons_are_expected_to_lack_far_solutions():
    base, platform = np.round(hexagon(0.2), 4), np.round(0.6 * hexagon(0.3), 4)
    known = SixLegPlatform(base, platform)
    assert known.expected[1] == 28
    lengths = lengths_at(base, platform, rotation([1, 0, 0, 0]), [0.1, 0.05, 1])
    for modes in calls(known, lengths):
        assert modes.complex_count == 28
        assert modes.completeness is Completeness.expected
        assert modes.certified.all()


def test_a_class_does_not_depend_on_the_order_of_legs():
    rng = np.random.default_rng(0)
    for name in CLASSES:
        platform, base = CLASSES[name][1](rng)
        platform, base = platform - platform.mean(axis=0), base - base.mean(axis=0)
        order = rng.permutation(6)
        counts = expected_counts(platform, base)
        assert expected_counts(platform[order], base[order]) == counts
        assert expected_counts(base, platform) == counts


# laws


def test_moving_the_base_moves_the_modes():
    rng = np.random.default_rng(1)
    base, platform, lengths, *_ = member("general", rng)
    G, g = random_rotation(rng), rng.normal(size=3)
    modes = SixLegPlatform(base, platform).modes(lengths)
    moved = SixLegPlatform(base @ G.T + g, platform).modes(lengths)
    assert len(moved.poses) == len(modes.poses)
    for pose in modes.poses:
        assert holds(moved, G @ rotation(pose[3:]), G @ pose[:3] + g)


@pytest.mark.parametrize("factor", [1e-9, 1e-3, 1e3, 1e12, 1e60])
def test_the_unit_of_length_does_not_matter(factor):
    base, platform, lengths, *_ = member("general", np.random.default_rng(2))
    modes = SixLegPlatform(base, platform).modes(lengths)
    scaled = SixLegPlatform(factor * base, factor * platform).modes(factor * lengths)
    assert scaled.completeness is Completeness.certified
    np.testing.assert_allclose(scaled.poses[:, :3] / factor, modes.poses[:, :3], rtol=1e-9)
    np.testing.assert_allclose(scaled.poses[:, 3:], modes.poses[:, 3:], atol=1e-9)


def test_a_planar_base_has_mirrored_modes():
    base, platform, lengths, *_ = member("planar base", np.random.default_rng(3))
    modes = SixLegPlatform(base, platform).modes(lengths)
    assert len(modes.poses)
    # the mirrored platform, not the platform, is seen in the mirror
    mirrored = SixLegPlatform(base, platform * [1, 1, -1]).modes(lengths)
    M = np.diag([1.0, 1.0, -1.0])
    for pose in modes.poses:
        assert holds(mirrored, M @ rotation(pose[3:]) @ M, M @ pose[:3])


def test_exact_coefficients_lie_within_the_errors():
    rng = np.random.default_rng(4)
    for shift in (0.0, 1.0, 1e3, 1e7):
        base, platform, lengths, *_ = member("general", rng)
        known = SixLegPlatform(base + shift, platform - shift)
        legs = known._legs
        section = legs.section(lengths, legs.squares(lengths))
        exact = section.exact()
        for true, c, error in zip(exact, section.proof, section.errors, strict=True):
            assert abs(true - Fraction(float(c))) <= Fraction(float(error))


def test_errors_of_poses_cover_what_far_frames_cost():
    rng = np.random.default_rng(6)
    base, platform, lengths, *_ = member("general", rng)
    shift = np.array([1e5, -2e5, 3e4])
    far = SixLegPlatform(base, platform + shift).modes(lengths)
    near = SixLegPlatform(base, (platform + shift) - shift).modes(lengths)
    for pose, (distance, _) in zip(far.poses, far.pose_errors, strict=True):
        here = pose[:3] + rotation(pose[3:]) @ shift
        assert np.linalg.norm(near.poses[:, :3] - here, axis=1).min() <= 2 * distance
        assert distance < 1e-4


def test_modes_are_ordered_alike_each_time():
    base, platform, lengths, *_ = member("both planar", np.random.default_rng(8))
    known = SixLegPlatform(base, platform)
    first, own = calls(known, lengths)
    np.testing.assert_allclose(first.poses, own.poses, atol=1e-9)
    assert np.all(np.diff(np.round(first.poses[:, 2], 6)) <= 0)


# hard cases


def singular_member(seed):
    """A general platform at a singularity of type 2: two modes have become one."""
    rng = np.random.default_rng(seed)
    base, platform, _, R, p = member("general", rng)

    def determinant(s):
        legs = platform @ R.T + p + s * along - base
        return np.linalg.det(np.c_[legs, np.cross(legs, platform @ R.T)])

    s = np.linspace(-5, 5, 1001)
    changes = []
    while not len(changes):
        along = rng.normal(size=3)
        signs = np.sign([determinant(x) for x in s])
        changes = np.flatnonzero(np.diff(signs))
    k = changes[0]
    low, high = s[k], s[k + 1]
    for _ in range(60):
        middle = (low + high) / 2
        low, high = (middle, high) if np.sign(determinant(middle)) == signs[k] else (low, middle)
    p = p + low * along
    return base, platform, lengths_at(base, platform, R, p), R, p


@pytest.mark.parametrize("seed", range(2, 8))
def test_a_double_solution_is_told(seed):
    base, platform, lengths, R, p = singular_member(seed)
    for modes in calls(SixLegPlatform(base, platform), lengths):
        # rounding of the lengths makes of it two real solutions or two that are not real
        assert modes.endings == {"proved": 38, DOUBLE: 2}
        assert modes.complex_count == DEGREE
        assert holds(modes, R, p, atol=1e-6)
        near = np.abs(modes.poses[:, :3] - p).max(axis=1) < 1e-6
        assert near.sum() == (2 if modes.certified[near].all() else 1)
        assert modes.certified[~near].all()
        assert np.array_equal(np.isinf(modes.pose_errors[:, 0]), ~modes.certified)


def test_conditions_that_depend_on_each_other_have_no_modes():
    rng = np.random.default_rng(9)
    base, platform, lengths, R, p = member("general", rng)
    base[1], platform[1] = base[0], platform[0]
    circle = hexagon(0.3)
    similar = lengths_at(1.5 * circle, circle, R, p)
    for known, L in (
        (SixLegPlatform(base, platform), lengths),
        (SixLegPlatform(1.5 * circle, circle), similar),
        (SixLegPlatform(np.zeros((6, 3)), platform), lengths),
    ):
        for _ in range(2):
            modes = known.modes(L)
            assert modes.completeness is Completeness.dependent
            assert len(modes.poses) == 0
            assert modes.endings == {}


def test_a_continuum_of_solutions_gives_no_claim():
    rng = np.random.default_rng(10)
    a = rng.normal(size=(6, 3))
    # equal points and equal lengths: any translation of this length does
    modes = SixLegPlatform(a, a).modes(np.full(6, 1.3))
    assert modes.completeness is Completeness.found
    assert not modes.certified.any()


def test_a_leg_of_no_length_is_a_leg():
    base, platform, lengths, R, p = member("general", np.random.default_rng(11))
    lengths[0] = 0
    modes = SixLegPlatform(base, platform).modes(lengths)
    assert modes.completeness is Completeness.certified
    assert len(modes.poses) == 0  # six conditions on the rotation and nothing to turn about
    base[0] = R @ platform[0] + p
    modes = SixLegPlatform(base, platform).modes(lengths_at(base, platform, R, p))
    assert holds(modes, R, p, atol=1e-5)


def test_far_platforms_lose_nothing_that_is_real():
    base, platform, _, R, p = member("general", np.random.default_rng(12))
    for distance in (10, 100, 1000):
        far = p + np.array([0, 0, distance])
        known = SixLegPlatform(base, platform)
        for modes in calls(known, lengths_at(base, platform, R, far)):
            assert holds(modes, R, far, atol=1e-6)
            assert modes.certified.all()


# data and wrong input


def test_the_start_has_forty_solutions():
    start = generic_start().start
    assert start.x.shape == (DEGREE, 8)
    assert np.abs(PATTERN.values(start.entries, start.x)).max() < 1e-15
    along = np.abs(start.x.conj() @ start.x.T) - np.eye(DEGREE)
    np.testing.assert_allclose(np.linalg.norm(start.x, axis=1), 1)
    assert along.max() < 0.999


def test_the_start_can_be_found_anew():
    path = Path(__file__).parents[2] / "tools" / "six_leg_start.py"
    spec = importlib.util.spec_from_file_location("six_leg_start", path)
    tool = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(tool)
    start = tool.found_start(np.random.default_rng(3))
    assert start.start.x.shape == (DEGREE, 8)
    assert np.abs(PATTERN.values(start.start.entries, start.start.x)).max() < 1e-15
    assert tool.mean_steps(start, 2, 1) < 60


GOOD = np.random.default_rng(16).normal(size=(6, 3))


@pytest.mark.parametrize(
    ("base", "platform", "lengths", "words"),
    [
        (GOOD[:5], GOOD, np.ones(6), r"base has shape \(5, 3\), expected \(6, 3\)"),
        (GOOD, GOOD.T, np.ones(6), r"platform has shape \(3, 6\)"),
        (GOOD, 2 * GOOD + [np.nan, 0, 0], np.ones(6), r"platform\[0, 0\] is nan"),
        (GOOD, 1e120 * GOOD, np.ones(6), r"platform\[0, 0\] is .*e\+1"),
        (GOOD, GOOD**2, np.ones(5), r"lengths has shape \(5,\)"),
        (GOOD, GOOD**2, [1, 2, -3, 4, 5, 6], r"lengths\[2\] is -3.0, expected 0 or more"),
        (GOOD, GOOD**2, [1, 2, 3, 4, np.inf, 6], r"lengths\[4\] is inf"),
    ],
)
def test_wrong_input_is_named(base, platform, lengths, words):
    with pytest.raises(ValueError, match=words):
        SixLegPlatform(base, platform).modes(lengths)
