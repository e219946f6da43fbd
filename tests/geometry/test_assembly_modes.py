"""Assembly modes of any mechanism: reference lists, counts, laws, proofs."""

import json
from pathlib import Path

import numpy as np
import pytest

import gough
from gough import catalogue
from gough.errors import ConfigurationError

DATA = Path(__file__).parents[1] / "data"
CASES = {
    c["name"]: c for c in json.loads((DATA / "assembly_modes_mechanisms.json").read_text())["cases"]
}
SIX_LEGS = [
    case
    for name in ("6ups", "dietmaier")
    for case in json.loads((DATA / f"assembly_modes_{name}.json").read_text())["cases"]
]


def same_sets(found, expected, tolerance):
    """Whether two sets of rows are equal, each row near just one of the other."""
    found, expected = np.asarray(found, float), np.asarray(expected, float)
    assert len(found) == len(expected)
    distance = np.abs(found[:, None] - expected[None]).max(axis=2)
    assert (distance.min(axis=1) < tolerance).all()
    assert (distance.min(axis=0) < tolerance).all()


def of_quaternion(q):
    """Rotation matrices, which q and -q share."""
    w, x, y, z = np.moveaxis(np.asarray(q, float), -1, 0)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), -1, 0).reshape(-1, 9)


# reference lists


@pytest.mark.parametrize("case", SIX_LEGS, ids=lambda case: case["name"])
def test_platforms_on_six_legs(case):
    robot = gough.load("6-ups", base_anchors=case["base"], platform_anchors=case["platform"])
    for _ in range(2):  # from the generic start, then from the robot's own
        modes = robot.assembly_modes(case["lengths"])
        assert modes.certified.all()
        assert modes.complex_count == case["n_complex_certified"]
        assert modes.status == ("certified" if case["n_complex_certified"] == 40 else "expected")
        poses = [[*p["p"], *p["q"]] for p in case["poses"]]
        expected = np.array(poses)
        found = np.concatenate([modes.poses[:, :3], of_quaternion(modes.poses[:, 3:])], axis=1)
        same_sets(
            found, np.concatenate([expected[:, :3], of_quaternion(expected[:, 3:])], axis=1), 1e-8
        )
    assert robot.assembler.gaps(modes.q).max() < 1e-9


@pytest.mark.parametrize("name", [name for name in CASES if name.startswith("3-RPR")])
def test_planar_platforms(name):
    case = CASES[name]
    robot = gough.load("3-rpr", B=case["geometry"]["base"], P=case["geometry"]["platform"])
    modes = robot.assembly_modes(np.sqrt(case["parameters"]))
    x, y, angle = modes.x.T
    same_sets(np.column_stack([x, y, np.cos(angle), np.sin(angle)]), case["solutions"], 1e-6)
    assert modes.complex_count == case["n_complex_generic"]
    assert modes.certified.all()


def test_the_3_rps_has_two_operation_modes():
    case = CASES["3-RPS symmetric"]
    radius = case["geometry"]["platform_triangle_side"] / np.sqrt(3)
    robot = gough.load("3-rps", R=1, r=radius)
    modes = robot.assembly_modes(np.sqrt(case["parameters"]))
    names = list(robot.position_names)
    angles = modes.q[:, [names.index(f"leg{k}.hinge") for k in (1, 2, 3)]]
    lengths = np.sqrt(case["parameters"])
    found = np.stack([lengths * np.sin(angles), lengths * np.cos(angles)], axis=2).reshape(-1, 6)
    same_sets(found, case["solutions"], 1e-6)
    assert modes.complex_count == 16
    assert modes.certified.all()


def planar(platform, legs, moves):
    """A planar mechanism whose legs are bars on motors: (motor, elbow, length, point)."""
    bodies, joints = {"base": {}, "platform": {"free": moves}}, {}
    for k, (motor, elbow, length, point) in enumerate(legs):
        arm = float(np.hypot(*np.subtract(elbow, motor)))
        bodies |= {f"upper{k}": {}, f"lower{k}": {}}
        joints |= {
            f"motor{k}": {
                "type": "revolute", "bodies": ["base", f"upper{k}"], "actuated": True,
                "frames": [{"point": list(motor)}, {}],
            },
            f"elbow{k}": {
                "type": "revolute", "bodies": [f"upper{k}", f"lower{k}"],
                "frames": [{"point": [arm, 0]}, {}],
            },
            f"end{k}": {
                "type": "revolute", "bodies": [f"lower{k}", "platform"],
                "frames": [{"point": [length, 0]}, {"point": list(point)}],
            },
        }  # fmt: skip
    return gough.Robot(
        gough.Mechanism(
            name=platform, motion="planar", bodies=bodies, joints=joints,
            platform="platform", operational=moves,
        )
    )  # fmt: skip


def test_the_3_rrr_with_given_elbows():
    case = CASES["3-RRR, elbows given"]
    elbows = np.reshape(case["parameters"], (3, 2))
    geometry = case["geometry"]
    legs = [
        (np.subtract(elbow, [0.5, 0]), elbow, m, a)
        for elbow, m, a in zip(elbows, geometry["m"], geometry["a"], strict=True)
    ]
    robot = planar("rrr", legs, ["x", "y", "rz"])
    modes = robot.assembly_modes(np.zeros(3))
    x, y, angle = modes.x.T
    expected = np.array(case["solutions"])[:, :4]
    same_sets(np.column_stack([x, y, np.cos(angle), np.sin(angle)]), expected, 1e-6)
    assert modes.complex_count == 6


def test_the_working_modes_of_the_3_rrr():
    case = CASES["3-RRR working modes (inverse)"]
    g, points = case["geometry"], np.reshape(case["parameters"], (3, 2))
    legs = [
        (b, np.add(b, [l, 0]), m, p)
        for b, l, m, p in zip(g["b"], g["l"], g["m"], points, strict=True)
    ]
    robot = planar("rrr", legs, ["x", "y", "rz"])
    modes = robot.working_modes(np.zeros(3))
    assert len(modes) == case["n_real"] == 8
    names = list(robot.position_names)
    first, second = (
        modes.q[:, [names.index(f"{joint}{k}") for k in range(3)]] for joint in ("motor", "elbow")
    )
    angles = np.stack([first, first + second], axis=2)
    found = np.stack([np.cos(angles), np.sin(angles)], axis=3).reshape(len(modes), -1)
    same_sets(found, case["solutions"], 1e-6)


def test_the_five_bar():
    case = CASES["5-bar"]
    x, y, c, *rest = case["parameters"]
    legs = [
        (np.subtract(e, [0.5, 0]), e, float(np.sqrt(np.dot(e, e) - c)), [0, 0])
        for e, c in (([x, y], c), (rest[:2], rest[2]))
    ]
    robot = planar("five-bar", legs, ["x", "y"])
    modes = robot.assembly_modes(np.zeros(2))
    same_sets(modes.x, case["solutions"], 1e-6)
    assert (modes.complex_count, modes.status, modes.certified.all()) == (2, "expected", True)


def test_a_point_on_three_spheres():
    case = CASES["Delta/Orthoglide (three spheres)"]
    bodies, joints = {"base": {}, "point": {"free": ["x", "y", "z"]}}, {}
    for k, (*centre, c) in enumerate(np.reshape(case["parameters"], (3, 4)).tolist()):
        length = float(np.sqrt(np.dot(centre, centre) - c))
        bodies |= {f"slider{k}": {}, f"bar{k}": {}}
        joints |= {
            f"slide{k}": {
                "type": "prismatic", "bodies": ["base", f"slider{k}"], "actuated": True,
                "frames": [{"point": centre}, {}],
            },
            f"head{k}": {"type": "universal", "bodies": [f"slider{k}", f"bar{k}"]},
            f"end{k}": {
                "type": "spherical", "bodies": [f"bar{k}", "point"],
                "frames": [{"point": [0, 0, length]}, {}],
            },
        }  # fmt: skip
    robot = gough.Robot(
        gough.Mechanism(
            name="spheres", bodies=bodies, joints=joints, platform="point",
            operational=["x", "y", "z"],
        )
    )  # fmt: skip
    modes = robot.assembly_modes(np.zeros(3))
    same_sets(modes.x, case["solutions"], 1e-6)
    assert modes.complex_count == 2


def test_both_solutions_of_the_orthoglide():
    robot = gough.load("orthoglide")
    for case in json.loads((DATA / "orthoglide.json").read_text())["cases"]:
        sliders = [leg[0] for leg in case["q"]]
        modes = robot.assembly_modes(sliders)
        same_sets(modes.x, case["fgm_modes"], 1e-10)
        assert modes.certified.all()
        np.testing.assert_allclose(robot.direct_geometry(sliders, case["P"]), case["P"], atol=1e-10)


# counts of the catalogue

COUNTS = {
    "2rpr": (2, 2), "3-rpr": (6, 2), "3-rrr": (6, 2), "3-rps": (16, 16), "five-bar": (2, 2),
    "delta": (2, 2), "delta-parallelogram": (2, 2), "linear-delta": (2, 2), "orthoglide": (2, 2),
    "hexa": (40, 16), "hexaglide": (40, 12), "gough-stewart": (28, 8), "6-sps": (28, 8),
    "deployable-hexapod": (28, 8), "6-ups": (40, 40), "andrews-squeezer": (8, 4),
    "bennett": (1, 1), "four-bar": (2, 2), "slider-crank": (2, 2), "tripteron": (1, 1),
    "3-upu": (2, 2), "sarrus": (1, 1),
    "agile-eye": (8, 8), "biped-leg": (16, 8), "tricept": (24, 8), "4-rpr": (1, 1),
}  # fmt: skip
"""Complex and real solutions at home."""


@pytest.mark.parametrize("name", COUNTS)
def test_every_mode_closes_and_home_is_one(name):
    robot = gough.load(name)
    modes = robot.assembly_modes(robot.home.q_actuated)
    assert (modes.complex_count, len(modes)) == COUNTS[name]
    assert robot.assembler.gaps(modes.q).max() < 1e-9
    np.testing.assert_allclose(
        robot._direct_problem().actuated.of(modes.q),
        np.broadcast_to(robot.home.q_actuated, (len(modes), len(robot.home.q_actuated))),
        atol=1e-12,
    )
    nearest = min(robot.assembler.distance(q, robot.home.q) for q in modes.q)
    assert nearest < 1e-7


def test_a_delta_has_modes_with_twisted_bars():
    """The six bars alone let the platform turn; at home it only translates."""
    robot = gough.load("delta")
    turned = robot.assembly_modes(robot.home.q_actuated, motion="any")
    assert (turned.complex_count, len(turned), turned.status) == (40, 16, "certified")
    straight = np.abs(turned.poses[:, 3]) > 1 - 1e-9
    modes = robot.assembly_modes(robot.home.q_actuated)
    same_sets(turned.x[straight], modes.x, 1e-9)
    assert "motion='any'" in str(modes)


def test_an_agile_eye_away_from_home_has_eight_modes():
    """Four that any motors allow, thirds of a turn about the diagonals, and four that move.

    The equations that are solved have the first four twice; all equations have them once.
    """
    modes = gough.load("agile-eye").assembly_modes([0.2, 0.3, -0.1])
    assert len(modes) == 8
    third = 2 * np.pi / 3 / np.sqrt(3)
    still = third * np.array([[1, 1, -1], [1, -1, 1], [-1, 1, 1], [-1, -1, -1]])
    away = np.abs(modes.x[:, None] - still).max(axis=2).min(axis=0)
    assert away.max() < 1e-8


# laws


@pytest.mark.parametrize("name", ["3-rpr", "five-bar", "orthoglide", "gough-stewart"])
def test_a_walk_meets_its_own_modes(name):
    """Configurations found by Newton's method are among the modes of their motors."""
    robot = gough.load(name)
    rng, q = np.random.default_rng(3), robot.home.q
    direct = robot._direct_problem()
    for _ in range(8):
        q = robot.assembler.wander(q, rng, 0.3)
        modes = robot.assembly_modes(direct.actuated.of(q))
        assert np.abs(modes.x - direct.operational.of(q)).max(axis=1).min() < 1e-8


def test_mirrored_mechanisms_have_mirrored_modes():
    lengths = np.array([0.55, 0.6, 0.5])
    B, P = ([[0, 0], [1, 0], [0.45, 0.9]], [[-0.15, -0.1], [0.2, -0.12], [0.02, 0.18]])
    mirrored = [[[x, -y] for x, y in points] for points in (B, P)]
    one = gough.load("3-rpr", B=B, P=P).assembly_modes(lengths)
    other = gough.load("3-rpr", B=mirrored[0], P=mirrored[1], y=-0.4, theta=-0.2).assembly_modes(
        lengths
    )
    same_sets(other.x * [1, -1, -1], one.x, 1e-9)


def test_a_singular_home_is_no_obstacle():
    """A quarter turn of yaw is a singularity of type 2 of the platform at home."""
    straight = {"x": 0, "y": 0, "rx": 0, "ry": 0, "rz": np.pi / 2}
    robot = gough.load("gough-stewart", **straight)
    lengths = gough.load("gough-stewart").home.q_actuated
    same_sets(
        robot.assembly_modes(lengths).poses,
        gough.load("gough-stewart").assembly_modes(lengths).poses,
        1e-8,
    )
    singular = robot.assembly_modes(robot.home.q_actuated)
    near = np.abs(singular.poses - robot.home.x).max(axis=1).min()
    assert near < 1e-6
    flat = gough.load("five-bar", x=0.5, y=np.sqrt(1.3**2 - 0.25) * (1 - 1e-13))
    assert len(flat.assembly_modes(flat.home.q_actuated)) >= 1


def test_units_do_not_matter():
    """A machine a thousand times as large has modes a thousand times as far apart."""
    size = 1e3
    scale = {"x": 0.05 * size, "y": -0.1 * size, "z": 0.9 * size, "R": size, "r": 0.6 * size}
    robot, large = gough.load("gough-stewart"), gough.load("gough-stewart", **scale)
    lengths = robot.home.q_actuated
    found = large.assembly_modes(size * lengths)
    expected = robot.assembly_modes(lengths)
    same_sets(found.poses / ([size] * 3 + [1] * 4), expected.poses, 1e-8)
    assert found.certified.all()


def test_unreachable_motors_have_no_mode():
    robot = gough.load("five-bar")
    modes = robot.assembly_modes([np.pi, 0.0])
    assert len(modes) == 0
    assert modes.complex_count == 2
    assert str(modes).startswith("0 assembly modes of five-bar")


def test_six_legs_are_recognised_from_the_equations():
    for name in ("gough-stewart", "hexa", "hexaglide", "6-sps", "6-ups"):
        direct = gough.load(name)._direct_problem()
        legs = direct.legs.at(direct.home)
        T = direct.models.poses(direct.home, direct.assembler.p)
        T = T[direct.models.structure.bodies.index("platform")]
        ends = legs.platform @ T[:3, :3].T + T[:3, 3]
        np.testing.assert_allclose(
            np.linalg.norm(ends - legs.base, axis=1), legs.lengths, rtol=1e-12
        )
    for name in ("3-rps", "delta", "orthoglide", "3-rpr"):
        direct = gough.load(name)._direct_problem()
        assert direct.legs is None


def test_start_sets_are_kept_on_disk(monkeypatch):
    robot = gough.load("3-rrr")
    robot.assembly_modes(robot.home.q_actuated)
    again = gough.load("3-rrr")
    monkeypatch.setattr(
        "gough.geometry.monodromy.find_start_set", lambda *_: pytest.fail("searched again")
    )
    assert len(again.assembly_modes(again.home.q_actuated)) == 2


def test_a_search_that_is_cut_short_says_so():
    robot = gough.load("par4")
    modes = robot.assembly_modes(robot.home.q_actuated)
    assert modes.status == "found"
    assert "cut short at" in str(modes)


def test_wrong_input():
    robot = gough.load("3-rpr")
    with pytest.raises(
        ConfigurationError, match=r"q_actuated has shape \(2,\), expected \(3,\): leg1.slide"
    ):
        robot.assembly_modes([1, 2])
    with pytest.raises(ConfigurationError, match="not finite"):
        robot.assembly_modes([1, 2, np.nan])
    with pytest.raises(ConfigurationError, match="motion is 'all', expected one of home, any"):
        robot.assembly_modes([1, 1, 1], motion="all")


@pytest.mark.parametrize("name", catalogue.names())
def test_modes_print_and_are_plain_data(name):
    robot = gough.load(name)
    modes = robot.assembly_modes(robot.home.q_actuated)
    text = str(modes)
    assert text.startswith(f"{len(modes)} assembly mode")
    assert modes.status in text
    assert len(json.dumps(modes.as_dict())) > 50
