"""Mechanisms that once came out wrong."""

import numpy as np
import pytest

from gough import (
    Body,
    ConfigurationError,
    Constraint,
    Coupling,
    DescriptionError,
    Frame,
    GoughError,
    Joint,
    Mechanism,
    Parameter,
    Robot,
    UnknownName,
    load,
)
from gough.description.expression import Expression, ExpressionError
from gough.formats.native import Source

IN_LINE = """\
name: five-bar
motion: planar
bodies: {a: {}, b: {}, c: {}, d: {}}
joints:
  A: {type: revolute, bodies: [base, a], actuated: true, home: 0}
  B: {type: revolute, bodies: [a, b], frames: [{point: [1, 0]}, {}]}
  C: {type: revolute, bodies: [b, c], frames: [{point: [1.3, 0]}, {point: [1.3, 0]}]}
  D: {type: revolute, bodies: [d, c], frames: [{point: [1, 0]}, {}]}
  E: {type: revolute, bodies: [base, d], frames: [{point: [1, 0]}, {}], actuated: true, home: 0}
operational: [B]
"""


def planar(**parts):
    return Mechanism(name="planar", motion="planar", **parts)


def test_a_restart_leaves_motors_where_they_are_described():
    home = Robot(Source(IN_LINE.encode(), "five-bar.yaml").mechanism()).home
    assert home.assembly.restarts > 0
    np.testing.assert_array_equal(home.q_actuated, 0.0)
    assert home.assembly.moved == ()


def test_a_free_joint_does_not_leave_the_plane():
    with pytest.raises(ValueError, match="a free joint leaves the plane"):
        planar(bodies={"b": Body()}, joints={"f": Joint(type="free", bodies=("base", "b"))})


@pytest.mark.parametrize("across", [None, (0, 1, 0), (0, 0, 1)])
def test_parallel_directions_in_the_plane_are_one_equation(across):
    frames = (Frame(axis=(1, 0, 0), across=across), Frame(axis=(1, 0, 0)))
    parallel = Constraint(type="directions-parallel", bodies=("base", "b"), frames=frames)
    robot = Robot(planar(bodies={"b": Body(free="all")}, constraints={"k": parallel}))
    assert (robot.analyse().mobility, robot.analyse().redundant_equations) == (2, 0)


def test_frames_that_turn_a_body_out_of_the_plane_are_refused():
    frames = (Frame(axis=(1, 0, 0)), Frame(axis=(1, 0, 0), across=(0, 1, 0)))
    slider = Joint(type="prismatic", bodies=("base", "b"), frames=frames)
    with pytest.raises(ValueError, match="turn one body out of the plane"):
        planar(bodies={"b": Body()}, joints={"s": slider})


def test_a_floating_base_hides_no_singularity():
    for name, settings in (("3-upu", {"x": 0, "y": 0}), ("2rpr", {"y": 0})):
        fixed = load(name, **settings)
        floating = Robot(Mechanism(**{**dict(fixed.mechanism), "floating": True}))
        one, two = fixed.analyse(), floating.analyse()
        assert one.generic.platform == two.generic.platform
        assert one.singularity.constraint == two.singularity.constraint
        assert one.singularity.type_2 == two.singularity.type_2
        motions = {text.split(": ", 1)[1] for text in two.singularity.motion.split("; ")}
        assert motions == {text.split(": ", 1)[1] for text in one.singularity.motion.split("; ")}


def test_outputs_that_move_together_have_the_right_ratio():
    """A slider drives the crank at dead centre; a rack is geared to the crank."""
    for size in (1.0, 10.0):
        crank = load("slider-crank", r=0.05 * size, l=0.18 * size, angle=0).mechanism
        joints = {
            **crank.joints,
            "crank": crank.joints["crank"].model_copy(update={"actuated": False}),
            "slide": crank.joints["slide"].model_copy(update={"actuated": True}),
            "rack": Joint(type="prismatic", bodies=("base", "rack"), frames=RAIL),
        }
        gear = Coupling(terms={"rack": 1, "crank": -0.05 * size})
        changed = {
            "joints": joints,
            "bodies": {**crank.bodies, "rack": Body()},
            "couplings": {"gear": gear},
            "operational": ("crank", "rack"),
        }
        found = Robot(Mechanism(**{**dict(crank), **changed})).analyse()
        assert found.singularity.type_2
        assert f"crank + {0.05 * size:.4g} rack" in found.singularity.motion


RAIL = (Frame(axis=(1, 0, 0)), Frame(axis=(1, 0, 0)))


def test_a_platform_without_outputs_and_motors_is_not_fully_actuated():
    pin = Joint(type="revolute", bodies=("base", "b"))
    robot = Robot(Mechanism(name="door", bodies={"b": Body()}, joints={"pin": pin}, platform="b"))
    assert robot.analyse().actuation == "under"


@pytest.mark.parametrize("pitch", [1e-1, 1e-3, 1e-5, 1e-6])
def test_a_fine_screw_drives_a_crank_through_dead_centre(pitch):
    screw = load("slider-crank", angle=0).mechanism
    joints = {
        **screw.joints,
        "crank": screw.joints["crank"].model_copy(update={"actuated": False}),
        "screw": Joint(type="revolute", bodies=("base", "nut"), frames=RAIL, actuated=True),
        "thread": Joint(
            type="helical", bodies=("nut", "slider"), frames=RAIL, dimensions={"pitch": pitch}
        ),
    }
    changed = {
        "motion": "spatial",
        "joints": joints,
        "bodies": {**screw.bodies, "nut": Body()},
        "operational": ("crank",),
    }
    robot = Robot(Mechanism(**{**dict(screw), **changed}))
    found = robot.analyse()
    assert found.generic.samples > 0
    assert (found.mobility, found.singularity.type_2, found.actuation) == (1, True, "full")


def test_an_isolated_assembly_has_no_class():
    found = load("five-bar", d=2.6, x=1.3, y=0, q=[0, np.pi]).analyse()
    assert found.actuation == "unknown"
    assert "singularity            unknown" in str(found)


def test_motions_of_several_bodies_tell_their_axis():
    pin = Joint(type="revolute", bodies=("base", "a"), frames=(Frame(point=(1000, 0, 0)), Frame()))
    weld = Joint(type="fixed", bodies=("a", "b"))
    both = {"a": Body(), "b": Body()}
    robot = Robot(Mechanism(name="w", bodies=both, joints={"pin": pin, "weld": weld}))
    (motion,) = robot.analyse().free_motions
    assert motion.description.endswith("axis through (1000, 0, 0)")


def test_a_home_that_a_free_link_can_not_have_is_refused():
    with pytest.raises(ValueError, match="'b' moves in x, y alone; this pose asks for more"):
        Mechanism(
            name="point",
            bodies={"b": Body(free=("x", "y"), home=Frame(point=(1, 2, 0.5)))},
            joints={"s": Joint(type="spherical", bodies=("base", "b"))},
        )


def test_heavy_bars_change_no_name():
    for bars in ({}, {"bar_mass": 0.2}):
        lift = Joint(
            type="parallelogram",
            bodies=("base", "table"),
            dimensions={"length": 0.4, "width": 0.1, **bars},
            home=0.3,
        )
        robot = Robot(
            Mechanism(
                name="t", bodies={"table": Body()}, joints={"lift": lift}, operational=("lift",)
            )
        )
        np.testing.assert_allclose(robot.home.x, [0.3])


def test_freedom_of_a_map_is_a_basis():
    pins = {
        "motor": Joint(type="revolute", bodies=("base", "a"), actuated=True),
        "pin": Joint(type="revolute", bodies=("base", "b")),
    }
    robot = Robot(Mechanism(name="idle", bodies={"a": Body(), "b": Body()}, joints=pins))
    assert robot.passive_velocity().freedom.shape == (1, 1)


def test_wrong_values_from_python_are_errors_of_ours():
    k = {"k": Parameter(value=1.0, live=True)}
    pin = {
        "pin": Joint(
            type="revolute", bodies=("base", "b"), frames=(Frame(point=("sqrt(k)", 0, 0)), Frame())
        )
    }
    mechanism = Mechanism(name="live", parameters=k, bodies={"b": Body()}, joints=pin)
    for wrong in (np.nan, "x", [1, 2], None):
        with pytest.raises(ConfigurationError, match="parameter k"):
            _ = Robot(mechanism, live={"k": wrong}).assembler
    with pytest.raises(GoughError, match="no value"):
        _ = Robot(mechanism, live={"k": -1.0}).home
    with pytest.raises(UnknownName, match="no way of modelling is named 'cut-foo'"):
        Robot(mechanism, "cut-foo")
    with pytest.raises(ConfigurationError, match="the seed is -1"):
        Robot(mechanism).analyse(seed=-1)
    with pytest.raises(ExpressionError, match="not a real number"):
        Expression("sin((-0.25)**1.5)").evaluate({})


def test_numbers_of_numpy_are_numbers():
    robot = load("3-rpr", x=np.float32(0.5), B=np.array([[0, 0], [1, 0], [0.45, 0.9]]))
    np.testing.assert_allclose(robot.home.q, load("3-rpr").home.q, atol=1e-7)


def test_a_reverse_side_is_named():
    text = IN_LINE.replace(
        "{point: [1.3, 0]}, {point: [1.3, 0]}",
        "{point: [1.3, 0]}, {point: [1.3, 0], axis: [0, 0, -1]}",
    )
    with pytest.raises(GoughError, match=r"C \(loop of .*\) is turned to its reverse side"):
        _ = Robot(Source(text.encode(), "five-bar.yaml").mechanism()).home


def test_every_joint_of_a_loop_has_a_motor():
    with pytest.raises(DescriptionError, match="and no other joint of its loop can"):
        Robot(
            Mechanism(
                name="m",
                bodies={"b": Body(free="all")},
                joints={"pin": Joint(type="revolute", bodies=("base", "b"), actuated=True)},
            )
        )


def test_a_joint_may_have_the_name_of_a_free_link():
    robot = Robot(
        Mechanism(
            name="namesakes",
            bodies={"arm": Body(free="all"), "rod": Body()},
            joints={
                "arm": Joint(type="revolute", bodies=("base", "rod")),
                "ball": Joint(type="spherical", bodies=("rod", "arm")),
            },
            operational=("arm",),
        )
    )
    assert robot.rates.counts.operational == 1
    assert robot.analyse().mobility == 4
    assert robot.structure.loop_joints(robot.structure.closings[0]) == ("arm", "ball")
