"""Motors of joints: numbers or expressions, one freedom, and a place in every form of a joint."""

import pytest

from gough import DescriptionError, Joint, Mechanism, Motor, Robot, load
from gough.description.flat import flatten
from gough.formats.native import Source

TEXT = """\
name: hoist
parameters: {radius: {value: 0.05, live: true}, rotor: 2e-4}
bodies: {arm: {mass: 1}, car: {mass: 1}, end: {mass: 1}}
joints:
  lift:
    {type: prismatic, bodies: [base, car], actuated: true, motor: {inertia: rotor, ratio: 1/radius}}
  swing: {type: revolute, bodies: [base, arm], actuated: true, motor: {}}
  wrist: {type: spherical, bodies: [arm, end], actuated: true}
"""
REEL = "{inertia: rotor, ratio: 1/radius}"


def read(text=TEXT):
    return Source(text.encode(), "hoist.yaml").mechanism()


def test_a_motor_is_direct_and_without_limits_where_nothing_else_is_written():
    assert read().joints["swing"].motor == Motor(inertia=0.0, ratio=1.0, effort=None, speed=None)
    assert read().joints["wrist"].motor is None


def test_a_motor_survives_a_round_trip_through_plain_data():
    text = TEXT.replace("motor: {}", "motor: {ratio: -50, effort: 20, speed: 2*pi}")
    for mechanism in (read(text), load("deployable-hexapod").mechanism):
        for some in ({}, {"exclude_defaults": True}):
            assert Mechanism.model_validate(mechanism.model_dump(mode="json", **some)) == mechanism
    assert read(text).joints["swing"].motor == Motor(ratio=-50, effort=20, speed="2*pi")


def test_numbers_of_a_motor_may_be_live_and_a_legs_own():
    assert read().joints["lift"].motor == Motor(inertia="rotor", ratio="1/radius")
    assert Robot(read(), live={"radius": 0.1}).assembler.p == pytest.approx([0.1])
    text = """\
name: hoists
legs:
  leg:
    repeat: 2
    parameters: {rotor: 1e-4*(i + 1)}
    bodies: {car: {mass: 1}}
    joints: {lift: {type: prismatic, bodies: [base, car], actuated: true, motor: {inertia: rotor}}}
"""
    motors = [joint.motor for joint in read(text).written_out().joints.values()]
    assert motors == [Motor(inertia="leg1__rotor"), Motor(inertia="leg2__rotor")]


@pytest.mark.parametrize("form", [flatten, Mechanism.written_out])
def test_the_pin_that_tells_the_angle_of_a_parallelogram_has_its_motor(form):
    text = TEXT.replace("prismatic", "parallelogram").replace(
        "motor: {inertia", "dimensions: {length: 1, width: 0.1, bar_mass: 2}, motor: {inertia"
    )
    joints = form(read(text)).joints
    assert {name: joint.motor for name, joint in joints.items() if joint.motor} == {
        "lift": Motor(inertia="rotor", ratio="1/radius"),
        "swing": Motor(),
    }
    assert joints["lift"].type == "revolute"


WRONG = {
    "passive joint": (
        ("arm], actuated: true, motor: {}", "arm], motor: {}"),
        "7:48: joints.swing.motor: a joint with a motor needs actuated: true",
    ),
    "three freedoms": (
        ("end], actuated: true", "end], actuated: true, motor: {}"),
        "8:64: joints.wrist.motor: a motor needs a joint of one freedom; a spherical joint has 3",
    ),
    "no freedom": (
        ("type: spherical", "type: fixed", "end], actuated: true", "end], motor: {}"),
        "8:44: joints.wrist.motor: a motor needs a joint of one freedom; a fixed joint has 0",
    ),
    "negative inertia": (
        ("rotor: 2e-4", "rotor: -2e-4"),
        "6:77: joints.lift.motor.inertia: the inertia of the rotor is -0.0002 kg m²; "
        "it can not be negative",
    ),
    "no ratio": (
        ("ratio: 1/radius", "ratio: radius - 0.05"),
        "6:91: joints.lift.motor.ratio: the ratio is zero: the motor would not move the joint",
    ),
    "effort of a slide": (
        (REEL, "{effort: 0}"),
        "6:76: joints.lift.motor.effort: the largest effort is 0 N; it must be positive",
    ),
    "speed of a slide": (
        (REEL, "{speed: -rotor}"),
        "6:75: joints.lift.motor.speed: the largest speed is -0.0002 m/s; it must be positive",
    ),
    "limits of a turn": (
        ("motor: {}", "motor: {effort: -1, speed: -2}"),
        "7:80: joints.swing.motor.effort: the largest effort is -1 N m; it must be positive\n"
        "7:91: joints.swing.motor.speed: the largest speed is -2 rad/s; it must be positive",
    ),
    "unknown parameter": (
        ("inertia: rotor", "inertia: roter"),
        "6:77: joints.lift.motor.inertia: there is no parameter 'roter'. Did you mean 'rotor'? "
        "Known: radius, rotor.",
    ),
    "list": (
        ("ratio: 1/radius", "ratio: [1, 2]"),
        "6:91: joints.lift.motor.ratio: expected a number or an expression, got [1, 2]",
    ),
    "unknown entry": (
        ("motor: {}", "motor: {inertias: 1}"),
        "7:72: joints.swing.motor.inertias: there is no entry 'inertias' here. "
        "Did you mean 'inertia'? Known: effort, inertia, ratio, speed.",
    ),
    "no mapping": (
        ("motor: {}", "motor: [1, 2]"),
        "7:71: joints.swing.motor: expected a mapping of names, got [1, 2]",
    ),
}


@pytest.mark.parametrize("case", WRONG)
def test_a_wrong_motor(case):
    changes, expected = WRONG[case]
    text = TEXT
    for old, new in zip(changes[::2], changes[1::2], strict=True):
        assert old in text
        text = text.replace(old, new)
    with pytest.raises(DescriptionError) as caught:
        read(text)
    lines = [line.removeprefix("hoist.yaml:") for line in str(caught.value).splitlines()]
    assert lines == expected.splitlines()


def test_an_expanded_parallelogram_reports_its_motor_once():
    joint = Joint(
        type="parallelogram",
        bodies=("base", "table"),
        dimensions={"length": 0.4, "width": 0.1, "bar_mass": 1},
        actuated=True,
        motor=Motor(effort=-1),
    )
    with pytest.raises(DescriptionError) as caught:
        Mechanism(name="table", bodies={"table": {"mass": 1}}, joints={"lift": joint})
    assert [problem.path for problem in caught.value.problems] == [
        ("joints", "lift", "motor", "effort")
    ]


@pytest.mark.parametrize("name", ["motor", "home", "frames"])
def test_a_part_named_like_an_entry_has_its_own_entries(name):
    pin = {"type": "revolute", "bodies": ["base", "arm"], "actuatd": True}
    with pytest.raises(DescriptionError, match="Did you mean 'actuated'"):
        Mechanism(name="named", bodies={"arm": {}}, joints={name: pin})


def test_the_reels_of_the_hexapod_follow_their_radius():
    robot = load("deployable-hexapod", reel_radius=0.1)
    slides = [j for j in flatten(robot.mechanism).joints.values() if j.type == "prismatic"]
    assert [slide.actuators["reel"].law for slide in slides] == ["reel"] * 6
    rotors = robot.dynamics.model("joint").rotors
    names = [robot.structure.variables[k].name for k in rotors]
    assert names == [f"leg{i + 1}.slide" for i in range(6)]
    assert list(rotors.values()) == pytest.approx([2e-4 / 0.1**2] * 6)
