"""Mechanisms as data: immutable, checked, legs written out, parameters in any order."""

import pytest
from pydantic import ValidationError

from gough import Body, DescriptionError, Joint, Mechanism, Robot, UnknownName, load
from gough.description.flat import flatten
from gough.formats.native import Source

LEGS = """\
name: three legs
parameters: {n: 3, R: {value: 2*r, unit: m}, r: 0.5, anchors: [[0, 0, 0], [r, 0, 0], [0, R, 0]]}
bodies: {plate: {mass: 1}}
legs:
  leg:
    repeat: 3
    bodies: {rod: {mass: 0.1*(i + 1)}}
    joints:
      foot: {type: spherical, bodies: [base, rod], frames: [{point: "anchors[i]"}, {}]}
      head: {type: spherical, bodies: [rod, plate], frames: [{point: [0, 0, R]}, {}]}
  arm:
    bodies: {link: {mass: 1}}
    joints: {pin: {type: revolute, bodies: [plate, link]}}
"""


def test_parts_are_immutable():
    body = Body(mass=1.0)
    with pytest.raises(ValidationError, match="frozen"):
        body.mass = 2.0


def test_legs_are_written_out_with_their_index():
    flat = flatten(Source(LEGS.encode(), "legs.yaml").mechanism())
    assert set(flat.bodies) == {"plate", "leg1.rod", "leg2.rod", "leg3.rod", "arm.link"}
    assert flat.joints["leg2.head"].bodies == ("leg2.rod", "plate")
    assert flat.joints["arm.pin"].bodies == ("plate", "arm.link")
    assert str(flat.bodies["leg3.rod"].mass) == "0.1 * (2 + 1)"


def test_a_name_that_comes_up_twice_is_refused():
    twice = LEGS.replace("bodies: {plate: {mass: 1}}", "bodies: {plate: {mass: 1}, leg1.rod: {}}")
    with pytest.raises(DescriptionError, match=r"the name 'leg1\.rod' is taken"):
        Source(twice.encode(), "legs.yaml").mechanism()


def test_an_error_in_a_leg_is_reported_once():
    wrong = LEGS.replace("{point: [0, 0, R]}", "{point: [0, 0, S]}")
    with pytest.raises(DescriptionError) as caught:
        Source(wrong.encode(), "legs.yaml").mechanism()
    assert [problem.line for problem in caught.value.problems] == [10]


def test_python_and_yaml_describe_the_same():
    text = """\
name: pendulum
bodies: {rod: {mass: 1, com: [0, 0, -0.5]}}
joints: {pin: {type: revolute, bodies: [base, rod], frames: [{axis: [0, 1, 0]}, {axis: [0, 1, 0]}]}}
"""
    axis = {"axis": (0, 1, 0)}
    in_python = Mechanism(
        name="pendulum",
        bodies={"rod": Body(mass=1, com=(0, 0, -0.5))},
        joints={"pin": Joint(type="revolute", bodies=("base", "rod"), frames=(axis, axis))},
    )
    assert Source(text.encode(), "pendulum.yaml").mechanism() == in_python


def test_a_description_survives_a_round_trip_through_plain_data():
    for name in ("3-rpr", "gough-stewart", "linear-delta"):
        mechanism = load(name).mechanism
        again = Mechanism.model_validate(mechanism.model_dump(mode="json", exclude_defaults=True))
        assert again == mechanism


def test_errors_in_python_name_the_part():
    with pytest.raises(DescriptionError, match=r"wrong: bodies\.rod\.mass: the mass is -1 kg"):
        Mechanism(
            name="wrong",
            bodies={"rod": Body(mass=-1)},
            joints={"pin": Joint(type="revolute", bodies=("base", "rod"))},
        )


def test_wrong_forms_in_python_are_named_alike():
    pin = {"type": "revolut", "bodies": ["a", "b"]}
    with pytest.raises(DescriptionError, match="'revolut' is not a joint type") as caught:
        Mechanism(name="wrong", bodies=3, joints={"pin": pin})
    paths = [problem.path for problem in caught.value.problems]
    assert paths == [("bodies",), ("joints", "pin", "type")]


def test_parameters_are_replaced_by_name():
    assert load("2rpr", L=2.0).home.q_actuated != pytest.approx(load("2rpr").home.q_actuated)
    with pytest.raises(UnknownName, match="no parameter is named 'length'"):
        load("2rpr", length=2.0)


def test_live_parameters_change_without_a_new_model():
    text = LEGS.replace("r: 0.5", "r: {value: 0.5, live: true}")
    mechanism = Source(text.encode(), "legs.yaml").mechanism()
    first, second = Robot(mechanism), Robot(mechanism, live={"r": 0.6})
    assert first.assembler.p == pytest.approx([0.5])
    assert second.assembler.p == pytest.approx([0.6])
    with pytest.raises(UnknownName, match="no live parameter is named 'R'"):
        _ = Robot(mechanism, live={"R": 1.0}).assembler


def test_too_many_parts_are_refused_before_they_are_built():
    many = LEGS.replace("repeat: 3", "repeat: 900")
    with pytest.raises(DescriptionError, match="1801 joints and constraints; at most 1000"):
        Source(many.encode(), "legs.yaml").mechanism()


def test_parameters_of_a_leg_are_its_own():
    text = """\
name: spokes
parameters: {R: 0.5}
bodies: {hub: {mass: 1}}
legs:
  spoke:
    repeat: 3
    parameters: {angle: 2*pi*i/3, end: ["R*cos(angle)", "R*sin(angle)", 0], mass: 0.1 + i}
    bodies: {rim: {mass: mass}}
    joints: {pin: {type: revolute, bodies: [hub, rim], frames: [{point: end}, {}]}}
joints: {axle: {type: revolute, bodies: [base, hub]}}
"""
    robot = Robot(Source(text.encode(), "spokes.yaml").mechanism())
    values = robot.models.closure.nominal
    assert values["spoke3__mass"] == 2.1
    assert values["spoke2__end"] == pytest.approx((-0.25, 0.75**0.5 / 2, 0))
    assert robot.mechanism.written_out().legs == {}
    wrong = text.replace("0.1 + i", "0.1 + j")
    with pytest.raises(DescriptionError, match=r"spoke\.parameters\.mass: there is no") as caught:
        Source(wrong.encode(), "spokes.yaml").mechanism()
    assert {problem.line for problem in caught.value.problems} == {7}


CIRCLE = """\
name: spokes
parameters: {R: a b}
bodies: {hub: {mass: 1}}
legs:
  spoke:
    repeat: 3
    parameters: {x: x + 1, y: 2*x, turn: [0.1, 0.2], far: R}
    joints:
      pin: {type: universal, bodies: [base, hub], frames: [{point: [y, 0, far]}, {}], home: turn}
"""


def test_errors_that_follow_from_another_are_not_repeated():
    with pytest.raises(DescriptionError) as caught:
        Source(CIRCLE.encode(), "spokes.yaml").mechanism()
    lines = str(caught.value).splitlines()
    assert [line.split(":")[1:3] for line in lines] == [["2", "17"], ["7", "21"]]
    assert "in a circle: spoke1.x → spoke1.x" in lines[1]


def test_names_of_functions_are_taken_in_legs_too():
    wrong = CIRCLE.replace("{x: x + 1", "{sqrt: 1, x: sqrt(2)").replace("a b", "1")
    with pytest.raises(DescriptionError, match="'sqrt' has a meaning of its own"):
        Source(wrong.encode(), "spokes.yaml").mechanism()


def test_a_home_may_be_a_named_list():
    right = CIRCLE.replace("a b", "0.5").replace("x + 1", "1")
    robot = Robot(Source(right.encode(), "spokes.yaml").mechanism())
    assert robot.models.closure.nominal["spoke2__turn"] == (0.1, 0.2)


def test_a_live_parameter_moves_home_and_scale():
    text = CIRCLE.replace("{R: a b}", "{R: {value: 0.5, live: true}}").replace("x + 1", "R")
    text = text.replace("turn: [0.1, 0.2]", "turn: [R, 0]").replace("y: 2*x", "y: 2*x*i")
    mechanism = Source(text.encode(), "spokes.yaml").mechanism()
    small, large = Robot(mechanism), Robot(mechanism, live={"R": 0.75})
    assert large.assembler.length / small.assembler.length == pytest.approx(1.5)
    assert 0.75 in large.assembler.start
    assert 0.5 not in large.assembler.start
