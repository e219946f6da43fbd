"""The same mechanism described otherwise: free links, cuts, constraints, couplings, bases."""

import numpy as np
import pytest

from gough import Body, Constraint, Coupling, DescriptionError, Frame, Joint, Mechanism, Robot, load
from gough.analysis import ranks
from tests.mechanisms import frame_of, random_mechanism

SEEDS = range(25)


def mobility(robot):
    return ranks.mobility(robot.rates.ranks, robot.rates.counts)


def poses_at_home(robot):
    found = robot.models.poses(robot.home.q, robot.assembler.p)
    return dict(zip(robot.structure.bodies, found, strict=True))


@pytest.mark.parametrize("seed", SEEDS)
def test_maximal_coordinates_have_the_same_mobility(seed):
    """Every body a free link, every joint cut: nothing of the placements of joints is used."""
    tree = Robot(random_mechanism(seed, roles=False))
    bodies = {
        name: Body(free="all", home=frame_of((pose[:3, :3].tolist(), pose[:3, 3].tolist())))
        for name, pose in poses_at_home(tree).items()
    }
    maximal = Robot(Mechanism(**{**dict(tree.mechanism), "bodies": bodies}))
    assert len(maximal.structure.closings) == len(tree.mechanism.joints)
    assert maximal.home.assembly.residual < 1e-12
    assert mobility(maximal) == mobility(tree)


@pytest.mark.parametrize("seed", SEEDS)
def test_any_passive_joint_of_a_loop_may_be_cut(seed):
    robot = Robot(random_mechanism(seed, roles=False))
    closing = robot.structure.closings[0]
    for name in robot.structure.loop_joints(closing):
        try:
            other = Robot(Mechanism(**{**dict(robot.mechanism), "cut": (name,)}))
        except DescriptionError as error:
            assert "would leave a body without a place" in str(error)
            continue
        assert name in {closing.name for closing in other.structure.closings}
        assert mobility(other) == mobility(robot)


def four_bar(closing, **more):
    lengths = {"a": 0.1, "b": 0.3, "c": 0.25, "d": 0.35}
    on_coupler = Frame(point=("b", 0), rotate=[("z", 1)] if closing == "frames-coincide" else [])
    ends = {"bodies": ("coupler", "rocker"), "frames": (on_coupler, Frame(point=("c", 0)))}
    pins = {
        "A": Joint(type="revolute", bodies=("base", "crank"), actuated=True, home="pi/3"),
        "B": Joint(
            type="revolute", bodies=("crank", "coupler"), frames=(Frame(point=("a", 0)), Frame())
        ),
        "D": Joint(
            type="revolute",
            bodies=("base", "rocker"),
            frames=(Frame(point=("d", 0)), Frame()),
            home=1.8,
        ),
    }
    constraints = {}
    if closing == "pin":
        pins["C"] = Joint(type="revolute", **ends)
    else:
        constraints["C"] = Constraint(type=closing, **ends)
    return Robot(
        Mechanism(
            name="four-bar",
            parameters=lengths,
            bodies={"crank": Body(), "coupler": Body(), "rocker": Body()},
            joints=pins,
            constraints=constraints,
            operational=("D",),
            **more,
        )
    )


@pytest.mark.parametrize(
    ("closing", "motion", "equations", "mobility_", "redundant"),
    [
        ("pin", "spatial", 5, 1, 3),
        ("points-coincide", "spatial", 3, 1, 1),
        ("directions-parallel", "spatial", 2, 3, 2),
        ("frames-coincide", "spatial", 6, 0, 3),
        ("pin", "planar", 2, 1, 0),
        ("points-coincide", "planar", 2, 1, 0),
        ("frames-coincide", "planar", 3, 0, 0),
        ("directions-parallel", "planar", 1, 2, 0),
    ],
)
def test_constraints_close_loops_like_joints(closing, motion, equations, mobility_, redundant):
    if closing == "directions-parallel" and motion == "planar":
        with pytest.raises(ValueError, match="lies in the x-y plane"):
            four_bar(closing, motion=motion)
        return
    found = four_bar(closing, motion=motion).analyse()
    counts = (found.equations, found.mobility, found.redundant_equations)
    assert counts == (equations, mobility_, redundant)


def train(size=1.0, **coupling):
    """Two wheels on the base, and a rack."""
    return Robot(
        Mechanism(
            name="train",
            bodies={"big": Body(), "small": Body(), "rack": Body()},
            joints={
                "big": Joint(type="revolute", bodies=("base", "big"), actuated=True, home=0.3),
                "small": Joint(
                    type="revolute",
                    bodies=("base", "small"),
                    frames=(Frame(point=(size, 0, 0)), Frame()),
                ),
                "rack": Joint(type="prismatic", bodies=("base", "rack")),
            },
            couplings=coupling,
            operational=("rack",),
        )
    )


def test_couplings_are_gears():
    gear = Coupling(terms={"big": 3, "small": 1}, offset=0.2)
    pinion = Coupling(terms={"small": 0.05, "rack": -1})
    assert train().analyse().mobility == 3
    robot = train(gear=gear, pinion=pinion)
    assert robot.analyse().mobility == 1
    np.testing.assert_allclose(robot.home.q, [0.3, 0.2 - 0.9, 0.05 * (0.2 - 0.9)], atol=1e-12)
    np.testing.assert_allclose(robot.inverse_velocity().matrix, [[1 / (-3 * 0.05)]], rtol=1e-12)


def test_a_coupled_joint_is_not_cut():
    robot = load("four-bar")
    coupled = {**dict(robot.mechanism), "couplings": {"gear": Coupling(terms={"C": 1}, offset=0)}}
    other = Robot(Mechanism(**coupled))
    assert "C" not in {closing.name for closing in other.structure.closings}


def test_a_floating_base_adds_six_freedoms_and_enters_no_equation():
    fixed = Robot(random_mechanism(3, roles=False))
    floating = Robot(Mechanism(**{**dict(fixed.mechanism), "floating": True}))
    assert mobility(floating) == mobility(fixed) + 6
    np.testing.assert_array_equal(floating.models.jacobian(floating.home.q, [])[:, :6], 0)
    whole = [m.description for m in floating.analyse().free_motions]
    assert sum("of the whole mechanism" in text for text in whole) == 6


def test_a_serial_robot_has_no_loop_and_its_platform_follows():
    arm = Robot(
        Mechanism(
            name="arm",
            bodies={"upper": Body(), "lower": Body()},
            joints={
                "shoulder": Joint(
                    type="revolute", bodies=("base", "upper"), actuated=True, home=0.4
                ),
                "elbow": Joint(
                    type="revolute",
                    bodies=("upper", "lower"),
                    frames=(Frame(point=(0.5, 0, 0)), Frame(point=(-0.3, 0, 0))),
                    actuated=True,
                    home=0.8,
                ),
            },
            platform="lower",
            operational=("x", "y"),
        )
    )
    found = arm.analyse()
    assert (found.structure.loops, found.mobility, found.actuation) == (0, 2, "full")
    (s, t), (c, d) = np.sin([0.4, 1.2]), np.cos([0.4, 1.2])
    np.testing.assert_allclose(arm.home.x, [0.5 * c + 0.3 * d, 0.5 * s + 0.3 * t], atol=1e-12)
    J = [[-0.5 * s - 0.3 * t, -0.3 * t], [0.5 * c + 0.3 * d, 0.3 * d]]
    np.testing.assert_allclose(arm.direct_velocity().matrix, J, atol=1e-12)


def test_an_unreachable_home_says_what_gave_way():
    robot = load("2rpr", x=0.4, y=0.7)
    moved = load("five-bar", x=0.45, y=5.0, q=[1.0, 1.0])
    assert robot.home.assembly.moved == ()
    assert set(moved.home.assembly.moved) >= {"point.x", "point.y"}
    assert any("were moved from" in warning for warning in moved.analyse().warnings)


@pytest.mark.parametrize("size", [1e-6, 1.0, 1e5])
@pytest.mark.parametrize("factor", [1e-3, 1.0, 1e4])
def test_the_unit_a_coupling_is_written_in_changes_no_rank(size, factor):
    """A pinion on a rack of any size, its equation multiplied by any number."""
    terms = {"small": 0.05 * size * factor, "rack": -factor}
    robot = train(size=size, pinion=Coupling(terms=terms))
    found = robot.analyse()
    assert (found.mobility, found.redundant_equations) == (2, 0)
    assert found.rates.gap > 1e9
