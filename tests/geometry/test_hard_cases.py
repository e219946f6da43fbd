"""Mechanisms and input whose modes were once wrong: one small case for each cause."""

import numpy as np
import pytest
import yaml

import gough
from gough import catalogue
from gough.errors import ConfigurationError
from gough.geometry import monodromy
from gough.geometry.coordinates import Coordinates
from gough.numerics.quadratics import Quadratics

TURN = 2 * np.pi


def robot(name, bodies, joints, **more):
    return gough.Robot(gough.Mechanism(name=name, bodies=bodies, joints=joints, **more))


def joint(kind, a, b, on_a=None, on_b=None, **more):
    return {"type": kind, "bodies": [a, b], "frames": [on_a or {}, on_b or {}], **more}


def along(axis, point=(0, 0, 0)):
    return {"point": list(point), "axis": list(axis)}


def at(*point):
    return {"point": [float(x) for x in point]}


def unit(rng):
    v = rng.normal(size=3)
    return (v / np.linalg.norm(v)).tolist()


def modes_at_home(robot, motion="home"):
    """The modes for home's motors; all of them close, have these, and home is one."""
    modes = robot.assembly_modes(robot.home.q_actuated, motion=motion)
    assert robot.assembler.gaps(modes.q).max() < 1e-8
    motors = np.tile(robot.home.q_actuated, (len(modes), 1))
    np.testing.assert_allclose(given(robot, modes.q), motors, atol=1e-12)
    assert min(robot.assembler.distance(q, robot.home.q) for q in modes.q) < 1e-6
    return modes


def given(robot, q, role="actuated"):
    return Coordinates(robot.models, role).of(q)


# equations


@pytest.mark.parametrize("seed", [1, 2, 3, 5])
def test_skew_axes_make_no_equation_of_rounding(seed):
    rng = np.random.default_rng(seed)
    on_base, on_rocker = along(unit(rng), (0.7, 0.1, 0.2)), along(unit(rng))
    rssr = robot(
        "rssr",
        {"base": {}, "crank": {}, "rod": {}, "rocker": {}},
        {
            "motor": joint("revolute", "base", "crank", actuated=True, home=0.5),
            "near": joint("spherical", "crank", "rod", at(0.3, 0, 0)),
            "far": joint("spherical", "rod", "rocker", at(1, 0, 0), at(0.5, 0.1, 0.05)),
            "pin": joint("revolute", "base", "rocker", on_base, on_rocker, home=1.0),
        },
        operational=["pin"],
    )
    modes = modes_at_home(rssr)
    assert (len(modes), modes.status, modes.certified.all()) == (2, "expected", True)
    assert rssr.reach(rssr.home.x).reached


def test_two_legs_of_slides_and_a_cross_have_four_modes():
    axes = np.eye(3).tolist()
    bodies = {"base": {}, "platform": {"free": "all", "home": {"rotate": [["z", 0.3]]}}}
    joints = {}
    crosses = {
        1: {"axis": [0, 0, 1], "across": [0, 1, 0]},
        2: {"axis": [0, 0, 1], "across": [1, 0, 0], "point": [0.4, 0.1, 0.2]},
    }
    for leg, cross in crosses.items():
        links = ["base", *(f"link{leg}{k}" for k in range(3))]
        bodies |= {link: {} for link in links[1:]}
        for k, axis in enumerate(axes):
            frame = {"axis": axis, "across": axes[(k + 1) % 3]}
            actuated = leg == 1 or k == 0
            joints[f"slide{leg}{k}"] = joint(
                "prismatic", links[k], links[k + 1], frame, frame, actuated=actuated
            )
        hinge = {"axis": [1, 0, 0], "across": [0, 0, 1]}
        joints[f"cross{leg}"] = joint("universal", links[-1], "platform", hinge, cross)
    joints["slide20"]["home"] = 0.3
    pppu = robot(
        "2-pppu", bodies, joints, platform="platform",
        operational=["x", "y", "z", "rx", "ry", "rz"],
    )  # fmt: skip
    modes = modes_at_home(pppu)
    assert len(modes) == 4


def shaper(coupled):
    """A crank's block slides on a lever; with a coupler at the lever's end that moves a ram."""
    up, across = along([0, 1, 0]), along([1, 0, 0])
    bodies = {name: {} for name in ("base", "crank", "lever", "block")}
    joints = {
        "motor": joint("revolute", "base", "crank", at(0, 0.5), actuated=True, home=0.4),
        "pivot": joint("revolute", "base", "lever", home=0.2),
        "slide": joint("prismatic", "lever", "block", up, up, home=0.6),
        "pin": joint("revolute", "crank", "block", at(0.2, 0)),
    }
    if coupled:
        bodies |= {"coupler": {}, "ram": {}}
        guide = along([1, 0, 0], (0, 1.1, 0))
        joints |= {
            "top": joint("revolute", "lever", "coupler", at(0, 1)),
            "wrist": joint("revolute", "coupler", "ram", at(0.5, 0)),
            "guide": joint("prismatic", "base", "ram", guide, across, home=0.5),
        }
    output = "guide" if coupled else "pivot"
    return robot("shaper", bodies, joints, motion="planar", operational=[output])


def test_a_quick_return_with_a_coupler_has_its_modes():
    """A lever turned by half a turn is out of the coupler's reach, so only the ram has two."""
    modes = modes_at_home(shaper(coupled=True))
    assert (len(modes), modes.complex_count, modes.certified.all()) == (2, 4, True)
    angle = modes.q[0, shaper(coupled=True).position_names.index("pivot")]
    end, height = -np.sin(angle), np.cos(angle)
    half = np.sqrt(0.5**2 - (1.1 - height) ** 2)
    np.testing.assert_allclose(modes.x[:, 0], [end + half, end - half], atol=1e-9)


def test_a_lever_as_output_is_seen_from_both_sides_of_its_pivot():
    """The block is at the same place of the crank; the lever is turned by half a turn."""
    lever = shaper(coupled=False)
    modes = modes_at_home(lever)
    assert len(modes) == 2
    np.testing.assert_allclose(abs(np.diff(modes.x[:, 0])), np.pi, atol=1e-9)
    slides = modes.q[:, lever.position_names.index("slide")]
    np.testing.assert_allclose(slides.sum(), 0, atol=1e-9)


def test_a_slide_and_a_pin_in_line_are_a_cylinder():
    """Legs U-P-R-U, whose slide and pin have one axis."""
    rng = np.random.default_rng(0)
    base = [[1, 0, 0], [-0.5, 0.8, 0], [-0.5, -0.8, 0], [0.8, 0.6, 0], [-1, 0.1, 0], [0.2, -1, 0]]
    bodies, joints = {"base": {}, "platform": {"free": "all", "home": at(0, 0, 1)}}, {}
    for k in range(6):
        end = 0.5 * np.array(base[(k + 1) % 6]) + 0.05 * rng.normal(size=3)
        lower, upper, head = (f"{part}{k}" for part in ("lower", "upper", "head"))
        bodies |= {lower: {}, upper: {}, head: {}}
        joints |= {
            f"foot{k}": joint("universal", "base", lower, at(*base[k])),
            f"slide{k}": joint("prismatic", lower, upper, actuated=True, home=1.1),
            f"pin{k}": joint("revolute", upper, head),
            f"end{k}": joint("universal", head, "platform", {}, at(*end)),
        }
    upru = robot(
        "6-upru", bodies, joints, platform="platform",
        operational=["x", "y", "z", "rx", "ry", "rz"],
    )  # fmt: skip
    found = upru.reach(upru.home.x)
    assert found.reached
    np.testing.assert_allclose(given(upru, found.q), upru.home.q_actuated, atol=1e-9)
    assert upru.assembler.gaps(found.q) < 1e-9


def three_puu():
    """Vertical slides, and bars between two crosses: the platform only translates at home."""
    bodies, joints = {"base": {}, "platform": {"free": "all", "home": at(0, 0, 0.7)}}, {}
    for k in range(3):
        angle = TURN * k / 3 + 0.2 * k
        out = np.array([np.cos(angle), np.sin(angle), 0])
        side = [-out[1], out[0], 0]
        foot = {"axis": out.tolist(), "across": side}
        on_platform = {"axis": out.tolist(), "across": [0, 0, 1], **at(*(0.3 * out))}
        bar, head = {"axis": [1, 0, 0], "across": [0, 0, 1]}, {"axis": [1, 0, 0], **at(1, 0, 0)}
        up = along([0, 0, 1], 0.8 * out)
        bodies |= {f"slider{k}": {}, f"bar{k}": {}}
        joints |= {
            f"slide{k}": joint(
                "prismatic", "base", f"slider{k}", up, along([0, 0, 1]), actuated=True,
                home=0.05 * k,
            ),
            f"foot{k}": joint("universal", f"slider{k}", f"bar{k}", foot, bar),
            f"head{k}": joint(
                "universal", f"bar{k}", "platform", {**head, "across": [0, 1, 0]}, on_platform
            ),
        }  # fmt: skip
    return robot("3-puu", bodies, joints, platform="platform", operational=["x", "y", "z"])


def test_locked_motors_hold_a_3_puu_in_every_orientation():
    puu = three_puu()
    turned, straight = modes_at_home(puu, motion="any"), modes_at_home(puu)
    assert len(straight) == 2
    assert len(turned) == 16
    assert turned.status == "found"
    for pose in straight.poses:
        assert np.abs(turned.poses - pose).max(axis=1).min() < 1e-8


# legs opposed to home


def test_a_vertical_bar_of_a_tripod_points_down_in_a_mirrored_mode():
    bodies, joints = {"base": {}, "platform": {"free": ["x", "y", "z"], "home": at(0, 0, 1)}}, {}
    for k, (foot, length) in enumerate([([0, 0, 0], 1), ([1, 0, 0], 2**0.5), ([0, 1, 0], 2**0.5)]):
        slide = along([1, 0, 0], foot)
        bodies |= {f"slider{k}": {}, f"bar{k}": {}}
        joints |= {
            f"slide{k}": joint(
                "prismatic", "base", f"slider{k}", slide, along([1, 0, 0]), actuated=True, home=0.0
            ),
            f"foot{k}": joint("spherical", f"slider{k}", f"bar{k}"),
            f"end{k}": joint("spherical", f"bar{k}", "platform", at(length, 0, 0)),
        }
    tripod = robot("tripod", bodies, joints, platform="platform", operational=["x", "y", "z"])
    modes = modes_at_home(tripod)
    np.testing.assert_allclose(modes.x, [[0, 0, 1], [0, 0, -1]], atol=1e-9)
    for shift in (1e-6, 1e-4):
        near = tripod.assembly_modes([shift, 0, 0])
        assert len(near) == 2
        assert tripod.assembler.gaps(near.q).max() < 1e-8


def test_a_vertical_leg_of_six_points_down_in_a_mirrored_mode():
    rng = np.random.default_rng(0)
    base = [[1, 0, 0], [0.5, 0.87, 0], [-0.5, 0.8, 0], [-1, 0.1, 0], [-0.45, -0.8, 0],
            [0.5, -0.9, 0]]  # fmt: skip
    bodies, joints = {"base": {}, "platform": {"free": "all", "home": at(0, 0, 1)}}, {}
    for k, foot in enumerate(base):
        end = np.array(foot) + (k > 0) * 0.2 * rng.normal(size=3) * [1, 1, 0]
        length = float(np.linalg.norm(np.add(end, [0, 0, 1]) - foot))
        bodies |= {f"lower{k}": {}, f"upper{k}": {}}
        joints |= {
            f"foot{k}": joint("spherical", "base", f"lower{k}", at(*foot)),
            f"slide{k}": joint("prismatic", f"lower{k}", f"upper{k}", actuated=True, home=length),
            f"end{k}": joint("spherical", f"upper{k}", "platform", {}, at(*end)),
        }
    sps = robot(
        "6-sps", bodies, joints, platform="platform",
        operational=["x", "y", "z", "rx", "ry", "rz"],
    )  # fmt: skip
    modes = modes_at_home(sps)
    below = np.abs(modes.poses - [0, 0, -1, 1, 0, 0, 0]).max(axis=1)
    assert below.min() < 1e-9


# turns


def test_a_screw_has_its_modes_beyond_a_turn():
    screw = robot(
        "screw",
        {"base": {}, "nut": {}, "bar": {}, "rocker": {}},
        {
            "motor": joint(
                "helical", "base", "nut", actuated=True, dimensions={"pitch": 0.01}, home=1.0
            ),
            "near": joint("spherical", "nut", "bar"),
            "far": joint("spherical", "bar", "rocker", at(0.5, 0, 0), at(0.3, 0, 0)),
            "pin": joint(
                "revolute", "base", "rocker", along([0, 1, 0], (0.5, 0, 0.1)), along([0, 1, 0]),
                home=1.2,
            ),
        },
        operational=["pin"],
    )  # fmt: skip
    assert len(modes_at_home(screw)) == 2
    for angle in (4.0, 10.0, -10.0):
        modes = screw.assembly_modes([angle])
        assert len(modes) == 2
        assert screw.assembler.gaps(modes.q).max() < 1e-8
        np.testing.assert_allclose(given(screw, modes.q), angle, atol=1e-12)


@pytest.mark.parametrize("turns", [-2, 1, 3])
def test_motors_keep_the_turns_they_are_given(turns):
    bar = gough.load("five-bar")
    motors = bar.home.q_actuated + TURN * np.array([turns, 0])
    modes, first = bar.assembly_modes(motors), bar.assembly_modes(bar.home.q_actuated)
    np.testing.assert_allclose(given(bar, modes.q), np.tile(motors, (2, 1)), atol=1e-12)
    np.testing.assert_allclose(modes.x, first.x, atol=1e-9)


@pytest.mark.parametrize("turns", [-1, 2])
def test_outputs_keep_the_turns_they_are_given(turns):
    rpr = gough.load("3-rpr")
    x = np.add(rpr.home.x, [0, 0, TURN * turns])
    found = rpr.reach(x)
    assert found.reached
    np.testing.assert_allclose(given(rpr, found.q, "operational"), x, atol=1e-9)


# lists


@pytest.mark.parametrize("name", ["delta", "five-bar", "gough-stewart"])
def test_a_floating_base_changes_no_mode(name):
    text = yaml.safe_load(catalogue.file(name).read_bytes())
    floating = gough.Robot(gough.Mechanism(**text, floating=True))
    fixed = gough.load(name)
    modes = modes_at_home(floating)
    expected = fixed.assembly_modes(fixed.home.q_actuated)
    np.testing.assert_allclose(modes.poses, expected.poses, atol=1e-8)
    assert modes.status == expected.status
    assert floating.reach(floating.home.x).reached


@pytest.mark.parametrize(("name", "count"), [("3-upu", 2), ("tripteron", 1)])
def test_poses_are_listed_once_however_passive_joints_fit(name, count):
    modes = modes_at_home(gough.load(name))
    assert len(modes) == modes.complex_count == count
    assert "passive joints fit each mode in 8 ways; the nearest to home is given" in modes.notes


def test_an_orthoglide_has_no_turned_modes():
    """Equations of its parallelograms are redundant, which makes many solutions of one pose."""
    robot = gough.load("orthoglide")
    modes, straight = modes_at_home(robot, motion="any"), modes_at_home(robot)
    assert len(modes) == 2
    np.testing.assert_allclose(modes.poses, straight.poses, atol=1e-8)


# singularities


@pytest.mark.parametrize("gap", [1e-2, 1e-6, 1e-10, 1e-12, 1e-13, 1e-14, 1e-15, 0.0])
def test_modes_that_nearly_meet_are_listed(gap):
    """Motors of a five-bar that put its elbows, level with each other, 1.4 m - gap apart."""
    angle = np.arccos((0.4 - gap) / 1.2)
    modes = gough.load("five-bar").assembly_modes([np.pi - angle, angle])
    middle, half = 0.6 * np.sin(angle), np.sqrt(0.7**2 - (0.7 - gap / 2) ** 2)
    for y in (middle + half, middle - half):
        assert np.abs(modes.x - [0.5, y]).max(axis=1).min() < 1e-6
    if gap >= 1e-12:
        assert (len(modes), modes.certified.all()) == (2, True)
    else:
        assert (len(modes), modes.certified.any(), modes.status) == (1, False, "found")
        assert "singularity of type 2" in str(modes)


def test_elbows_too_far_apart_leave_no_mode():
    for gap in (1e-12, 1e-6, 1e-2):
        angle = np.arccos((0.4 + gap) / 1.2)
        assert len(gough.load("five-bar").assembly_modes([np.pi - angle, angle])) == 0


@pytest.mark.parametrize("away", [1e-4, 1e-8, 1e-14, 0.0])
def test_a_home_at_a_singularity_is_among_its_modes(away):
    """The bars of a five-bar in line: two modes are, or nearly are, one."""
    bar = gough.load("five-bar", x=0.5, y=np.sqrt(0.32) + away)
    modes = modes_at_home(bar)
    assert len(modes) == (2 if away > 1e-6 else 1)
    assert modes.certified.all() == (away > 1e-6)
    elsewhere = gough.load("five-bar").home.q_actuated
    assert len(bar.assembly_modes(elsewhere)) == 2


def test_a_start_that_leads_nowhere_is_told():
    """A double solution of 0 + x² = 0, where every path to another right-hand side forks."""
    pattern = Quadratics(2, np.zeros(2, int), np.array([0, 1]), np.array([0, 1]))
    family = monodromy.Family(pattern, np.array([[0.0, 1.0]]), np.array([0]))
    with pytest.raises(ConfigurationError, match="no path leads from home"):
        monodromy.find_start_set(
            family, np.array([0.0, 1.0]), np.array([1.0, 0.0]), np.random.default_rng(0)
        )


def test_working_modes_that_meet_are_listed_once():
    """Legs of 1.3 m at full stretch: both of them, then the first alone."""
    bar = gough.load("five-bar")
    both, first = [0.5, np.sqrt(1.3**2 - 0.25)], [1.3 * np.cos(1), 1.3 * np.sin(1)]
    for x, count in ((both, 1), (first, 2)):
        modes = bar.working_modes(x)
        assert len(modes) == count
        assert bar.assembler.gaps(modes.q).max() < 1e-8
    np.testing.assert_allclose(modes.q_actuated[:, 0], 1, atol=1e-6)


# without loops


def test_a_serial_chain_has_one_mode():
    chain = robot(
        "chain",
        {"base": {}, "arm": {}, "hand": {}},
        {
            "turn": joint("revolute", "base", "arm", actuated=True),
            "slide": joint("prismatic", "arm", "hand", actuated=True),
        },
    )
    modes = chain.assembly_modes([0.3, 0.2])
    np.testing.assert_allclose(modes.q, [[0.3, 0.2]])
    assert (modes.status, modes.complex_count) == ("expected", 1)


def test_a_gantry_has_one_mode():
    x, y = along([1, 0, 0]), along([0, 1, 0])
    gantry = robot(
        "gantry",
        {"base": {}, "bridge": {}, "beam": {}, "platform": {"free": ["x", "y", "rz"]}},
        {
            "x1": joint("prismatic", "base", "bridge", x, x, actuated=True),
            "y1": joint("prismatic", "bridge", "platform", y, y),
            "y2": joint("prismatic", "base", "beam", y, y, actuated=True),
            "x2": joint("prismatic", "beam", "platform", x, x),
        },
        motion="planar",
        platform="platform",
        operational=["x", "y"],
    )
    modes = gantry.assembly_modes([0.1, 0.2])
    np.testing.assert_allclose(modes.x, [[0.1, 0.2]], atol=1e-12)
    assert (modes.status, modes.certified.tolist()) == ("expected", [True])
    np.testing.assert_allclose(gantry.working_modes([0.3, 0.4]).q_actuated, [[0.3, 0.4]])


# wrong input


@pytest.mark.parametrize("motors", [[1e155, 1, 1], [1, 1, -1e200]])
def test_lengths_far_beyond_the_mechanism_are_refused(motors):
    with pytest.raises(ConfigurationError, match=r"q_actuated has a length of .*e\+"):
        gough.load("3-rpr").assembly_modes(motors)


def test_outputs_far_beyond_the_mechanism_are_refused():
    for call in ("reach", "working_modes", "inverse_geometry"):
        with pytest.raises(ConfigurationError, match=r"x has a length of 1e\+300 m"):
            getattr(gough.load("five-bar"), call)([1e300, 0])


@pytest.mark.parametrize("x", ["abc", [[0.4, 0.8], [0.4]], {"x": 1}])
def test_outputs_that_are_no_numbers_are_named(x):
    with pytest.raises(ConfigurationError, match=r"x is .*, expected numbers: x, y"):
        gough.load("five-bar").reach(x)


def test_near_that_is_no_configuration_is_named():
    bar = gough.load("five-bar")
    for near in ("abc", [[1, 2], [3]]):
        with pytest.raises(ConfigurationError, match=r"near is .*, expected joint positions"):
            bar.reach(bar.home.x, near=near)


@pytest.mark.parametrize("motion", [["home"], None, 1])
def test_a_motion_that_is_no_word_is_named(motion):
    bar = gough.load("five-bar")
    with pytest.raises(ConfigurationError, match=r"motion is .*, expected one of home, any"):
        bar.assembly_modes(bar.home.q_actuated, motion=motion)
