"""Actuators in a description: numbers or expressions, their places, what is wrong with them."""

import numpy as np
import pytest

from gough import Actuator, Body, DescriptionError, Joint, Mechanism, load
from gough.actuators import LAWS
from gough.description.expression import Expression
from gough.description.flat import flatten
from gough.description.values import array, evaluate_parameters
from gough.formats.native import Source
from gough.topology import Structure

TEXT = """\
name: hoist
parameters: {k: {value: 40, live: true}, soft: [9, -3]}
bodies: {arm: {mass: 1}, car: {mass: 1}, end: {mass: 1}}
joints:
  lift:
    type: prismatic
    bodies: [base, car]
    actuators:
      tape: {law: dahl, numbers: {beta: 50, deploying: [6, -3], folding: soft}}
      spring: {law: spring-damper, reference: k/100, numbers: {stiffness: k}}
  swing: {type: universal, bodies: [base, arm], actuators: {brake: {law: friction, freedom: 2}}}
  wrist:
    type: spherical
    bodies: [arm, end]
    actuators: {grease: {law: friction, numbers: {viscous: 1}}}
"""
TAPE = "{law: dahl, numbers: {beta: 50, deploying: [6, -3], folding: soft}}"
SPRING = "{law: spring-damper, reference: k/100, numbers: {stiffness: k}}"
GREASE = "{law: friction, numbers: {viscous: 1}}"
BRAKE = "{law: friction, freedom: 2}"


def read(text=TEXT):
    return Source(text.encode(), "hoist.yaml").mechanism()


def test_actuators_have_numbers_expressions_and_lists():
    joints = read().joints
    assert joints["lift"].actuators["spring"] == Actuator(
        law="spring-damper", reference="k/100", numbers={"stiffness": "k"}
    )
    assert joints["swing"].actuators["brake"] == Actuator(law="friction", freedom=2)
    table = Actuator(law="dahl", numbers={"deploying": np.array([[0, 6], [1, 3]])})
    assert table.numbers == {"deploying": ((0.0, 6.0), (1.0, 3.0))}
    assert Joint(type="fixed", bodies=("a", "b")).actuators == {}


def test_actuators_survive_a_round_trip_through_plain_data():
    mechanism = read()
    for some in ({}, {"exclude_defaults": True}):
        assert Mechanism.model_validate(mechanism.model_dump(mode="json", **some)) == mechanism
    assert mechanism.written_out().joints == mechanism.joints


def test_parameters_of_a_leg_reach_its_actuators():
    text = """\
name: hexapod
parameters: {scale: [1.06, 0.95]}
legs:
  leg:
    repeat: 2
    parameters: {s: "scale[i]"}
    bodies: {tape: {mass: 1}}
    joints:
      slide:
        type: prismatic
        bodies: [base, tape]
        actuators:
          spring:
            law: dahl
            reference: 0.1*(i + 1)
            numbers:
              beta: 50
              deploying: ["6*scale[i]", "-3*scale[i]"]
              folding: [[0, 9*s], [1, 6*s]]
"""
    flat = flatten(read(text))
    values = evaluate_parameters(flat.parameters)
    for k, scale in enumerate((1.06, 0.95)):
        actuator = flat.joints[f"leg{k + 1}.slide"].actuators["spring"]
        numbers = {key: array(x, values) for key, x in actuator.numbers.items()}
        assert numbers["deploying"] == (6 * scale, -3 * scale)
        assert numbers["folding"] == ((0.0, 9 * scale), (1.0, 6 * scale))
        assert array(actuator.reference, values) == pytest.approx(0.1 * (k + 1))
        assert not list(LAWS["dahl"].problems(numbers))
    assert actuator.numbers["folding"][0][1] == Expression("9 * leg2__s")


@pytest.mark.parametrize("form", [flatten, Mechanism.written_out])
def test_the_pin_that_tells_the_angle_of_a_parallelogram_has_its_actuators(form):
    text = TEXT.replace("prismatic", "parallelogram").replace(
        "    bodies: [base, car]",
        "    bodies: [base, car]\n    dimensions: {length: 1, width: 0.1, bar_mass: 2}",
    )
    joints = form(read(text)).joints
    assert {name: list(joint.actuators) for name, joint in joints.items() if joint.actuators} == {
        "lift": ["tape", "spring"],
        "swing": ["brake"],
        "wrist": ["grease"],
    }
    assert joints["lift"].type == "revolute"
    assert Structure(read(text)).edges  # its pins are where the loop of the bars keeps them


WRONG = {
    "unknown law": (
        ("law: dahl", "law: dhal"),
        "9:19: joints.lift.actuators.tape.law: 'dhal' is not a law. Did you mean 'dahl'? Known: "
        "force, motor, spring-damper, friction, lugre, dahl, end-stop, reel.",
    ),
    "no law": (
        ("law: dahl, ", ""),
        "9:13: joints.lift.actuators.tape.law: is missing",
    ),
    "unknown entry": (
        ("freedom: 2", "freedoms: 2"),
        "11:84: joints.swing.actuators.brake.freedoms: there is no entry 'freedoms' here. "
        "Did you mean 'freedom'? Known: freedom, law, numbers, reference.",
    ),
    "no mapping": (
        ("actuators: {brake: " + BRAKE + "}", "actuators: [friction]"),
        "11:60: joints.swing.actuators: expected a mapping of names, got ['friction']",
    ),
    "no name": (
        ("brake:", "2:"),
        "11:61: joints.swing.actuators.2: '2' is no name: a letter, then letters, digits, - and _ "
        "(words joined by dots), at most 80 characters",
    ),
    "unknown number": (
        ("{beta: 50,", "{bata: 50, beta: 50,"),
        "9:35: joints.lift.actuators.tape.numbers.bata: the law dahl has no number 'bata'. "
        "Did you mean 'beta'? Known: beta, deploying, folding, start, range.",
    ),
    "missing number": (
        ("{beta: 50, deploying", "{deploying"),
        "9:7: joints.lift.actuators.tape: the law dahl needs numbers: {beta: …} "
        "(how fast R nears an envelope, 1/m)",
    ),
    "no numbers": (
        (", numbers: {stiffness: k}", ""),
        "10:7: joints.lift.actuators.spring: the law spring-damper needs numbers: {stiffness: …} "
        "(of the spring, N/m)",
    ),
    "list for a number": (
        ("beta: 50", "beta: [50, 60]"),
        "9:41: joints.lift.actuators.tape.numbers.beta: beta is one number, and not a list of 2",
    ),
    "number for a curve": (
        ("folding: soft", "folding: 9"),
        "9:74: joints.lift.actuators.tape.numbers.folding: folding is [b, a], for the force "
        "b + a w, or a table of rows [w, F]; got the number 9",
    ),
    "three numbers for a curve": (
        ("folding: soft", "folding: [9, -3, 1]"),
        "9:74: joints.lift.actuators.tape.numbers.folding: folding is [b, a], for the force "
        "b + a w, or a table of rows [w, F]; got a list of 3",
    ),
    "table with a short row": (
        ("folding: soft", "folding: [[0, 9], [1]]"),
        "9:74: joints.lift.actuators.tape.numbers.folding: folding is [b, a], for the force "
        "b + a w, or a table of rows [w, F]; row 1 is something else (rows are counted from 0)",
    ),
    "table of one row": (
        ("folding: soft", "folding: [[0, 9]]"),
        "9:74: joints.lift.actuators.tape.numbers.folding: folding is a table of 1 rows; there "
        "must be 2 to 1000",
    ),
    "table that goes back": (
        ("folding: soft", "folding: [[0, 9], [1, 8], [0.5, 7]]"),
        "9:74: joints.lift.actuators.tape.numbers.folding: the positions of the table folding must "
        "increase: 0.5 in row 2 comes after 1 (rows are counted from 0)",
    ),
    "pair": (
        ("folding: soft", "folding: soft, range: 2"),
        "9:87: joints.lift.actuators.tape.numbers.range: range is a list of two numbers",
    ),
    "not positive": (
        ("beta: 50", "beta: -k"),
        "9:41: joints.lift.actuators.tape.numbers.beta: beta is -40 1/m; it must be positive",
    ),
    "negative": (
        ("stiffness: k", "stiffness: -k, damping: -1"),
        "10:75: joints.lift.actuators.spring.numbers.stiffness: stiffness is -40 N/m; it can not "
        "be negative\n"
        "10:88: joints.lift.actuators.spring.numbers.damping: damping is -1 N s/m; it can not be "
        "negative",
    ),
    "negative of a turn": (
        ("viscous: 1", "viscous: -1"),
        "15:60: joints.wrist.actuators.grease.numbers.viscous: viscous is -1 N m s/rad; it can "
        "not be negative",
    ),
    "loops that give energy": (
        ("folding: soft", "folding: [6.1, -3]"),
        "9:41: joints.lift.actuators.tape.numbers.beta: loops near w = 0 give energy: folding less "
        "deploying force and the sum of their slopes over beta, 0.1 + (-6)/50, is -0.02, and must "
        "not be negative; raise the folding envelope by 0.02, or beta to 60",
    ),
    "envelopes of two slopes": (
        ("folding: soft", "folding: [9, -2]"),
        "9:7: joints.lift.actuators.tape: the envelopes have the slopes -3 and -2, so whether a "
        "loop takes energy depends on where it is: write the positions it can have, "
        "range: [from, to]",
    ),
    "dry friction without its rate": (
        ("freedom: 2", "freedom: 2, numbers: {coulomb: 1}"),
        "11:61: joints.swing.actuators.brake: dry friction needs velocity, the rate over which it "
        "turns its sign, well below the rates of interest; the law lugre does without",
    ),
    "friction that is less at rest": (
        (GREASE, "{law: lugre, numbers: {stiffness: 1, coulomb: 2, static: 1, stribeck: 1}}"),
        "15:82: joints.wrist.actuators.grease.numbers.static: static is 1 and less than coulomb, "
        "2; friction at rest is the larger one: leave static out where they are equal",
    ),
    "a law that needs a position": (
        (GREASE, "{law: spring-damper, freedom: 3, numbers: {stiffness: 1}}"),
        "15:31: joints.wrist.actuators.grease.law: the law spring-damper needs a position, and "
        "freedom 3 of a spherical joint has a rate alone; laws of rates are force, motor, "
        "friction, lugre",
    ),
    "a freedom beyond the last": (
        ("freedom: 2", "freedom: 3"),
        "11:93: joints.swing.actuators.brake.freedom: there is no freedom 3: a universal joint has "
        "2 freedoms, counted from 1",
    ),
    "a freedom beyond the only one": (
        ("reference: k/100", "freedom: 2"),
        "10:45: joints.lift.actuators.spring.freedom: there is no freedom 2: a prismatic joint has "
        "one freedom",
    ),
    "freedoms counted from 0": (
        ("freedom: 2", "freedom: 0"),
        "11:93: joints.swing.actuators.brake.freedom: expected a whole number from 1 to 1000, "
        "got 0",
    ),
    "a fixed joint": (
        ("type: spherical", "type: fixed"),
        "15:17: joints.wrist.actuators.grease: a fixed joint has no freedom that an actuator "
        "could act on",
    ),
    "a reel on a turn": (
        (BRAKE, "{law: reel, numbers: {inertia: 1, radius: 1}}"),
        "11:74: joints.swing.actuators.brake.law: a reel acts on a slide, in m; freedom 1 of a "
        "universal joint is a turn, in rad",
    ),
    "inertia in two places": (
        (
            "    actuators:\n",
            "    actuated: true\n    motor: {inertia: 1}\n    actuators:\n",
            SPRING,
            "{law: reel, numbers: {inertia: 1, radius: 1}}",
        ),
        "12:7: joints.lift.actuators.spring: the joint feels the inertia of its motor already, "
        "and that of this reel would be added: write all of it in one place",
    ),
    "unknown parameter": (
        ("reference: k/100", "reference: K", "folding: soft", "folding: [soff, 1]"),
        "9:74: joints.lift.actuators.tape.numbers.folding: there is no parameter 'soff'. "
        "Did you mean 'soft'? Known: k, soft.\n"
        "10:47: joints.lift.actuators.spring.reference: there is no parameter 'K'. Known: k, soft.",
    ),
    "number too large": (
        ("stiffness: k", "stiffness: 1e300"),
        "10:75: joints.lift.actuators.spring.numbers.stiffness: 1e+300 is too large; numbers go up "
        "to 1e+12, in SI units",
    ),
    "empty list": (
        ("folding: soft", "folding: []"),
        "9:74: joints.lift.actuators.tape.numbers.folding: expected at least one number, got an "
        "empty list",
    ),
    "chosen cut": (
        ("joints:\n", "cut: [lift]\njoints:\n"),
        "4:7: cut.0: 'lift' has actuators, which need its variable, and can not be cut",
    ),
}


@pytest.mark.parametrize("case", WRONG)
def test_a_wrong_actuator(case):
    changes, expected = WRONG[case]
    text = TEXT
    for old, new in zip(changes[::2], changes[1::2], strict=True):
        assert old in text
        text = text.replace(old, new)
    with pytest.raises(DescriptionError) as caught:
        read(text)
    lines = [line.removeprefix("hoist.yaml:") for line in str(caught.value).splitlines()]
    assert lines == expected.splitlines()


def test_a_law_of_rates_acts_on_rotations_and_one_of_positions_on_what_has_one():
    for law, freedom, right in (
        ("lugre", 5, True),
        ("spring-damper", 2, True),
        ("spring-damper", 5, False),
    ):
        numbers = {"stiffness": 1.0} | ({"coulomb": 1.0} if law == "lugre" else {})
        joint = Joint(
            type="free",
            bodies=("base", "ball"),
            actuators={"one": Actuator(law=law, freedom=freedom, numbers=numbers)},
        )
        entries = {"name": "ball", "bodies": {"ball": Body(mass=1.0)}, "joints": {"held": joint}}
        if right:
            assert Mechanism(**entries).joints["held"] == joint
        else:
            with pytest.raises(DescriptionError, match="needs a position, and freedom 5 of a free"):
                Mechanism(**entries)


@pytest.mark.parametrize("repeat", ["", "repeat: 3, "])
def test_an_actuator_of_a_leg_or_a_parallelogram_is_told_once_by_short_names(repeat):
    text = f"""\
name: table
legs:
  leg:
    {{{repeat}parameters: {{q: -2}}, bodies: {{table: {{mass: 1}}}}, joints: {{lift: {{
      type: parallelogram, bodies: [base, table],
      dimensions: {{length: 0.4, width: 0.1, bar_mass: 1}},
      actuators: {{spring: {{law: spring-damper, numbers: {{stiffness: q}}}}, none: {{law: force,
        numbers: {{limit: "q*x"}}}}}}}}}}}}
"""
    with pytest.raises(DescriptionError) as caught:
        read(text)
    assert [problem.message for problem in caught.value.problems] == [
        "stiffness is -2 N m/rad; it can not be negative",
        "there is no parameter 'x'. Known: q.",
    ]


def loop(**actuators):
    """A four-bar, with actuators of some joints."""
    content = load("four-bar").mechanism.model_dump(exclude_unset=True)
    for name, law in actuators.items():
        content["joints"][name]["actuators"] = {"one": law}
    return Mechanism.model_validate(content)


VISCOUS = {"law": "friction", "numbers": {"viscous": 0.1}}


def test_a_joint_with_actuators_is_not_cut():
    free = Structure(loop())
    joints = list(free.mechanism.joints)
    passive = [name for name in joints if not free.mechanism.joints[name].actuated]
    passive = [name for name in passive if name not in free.mechanism.operational]
    for kept in passive:
        structure = Structure(loop(**{kept: VISCOUS}))
        assert kept in [edge.name for edge in structure.edges]
        assert all(closing.name != kept for closing in structure.closings)
    mechanism = loop(**{name: VISCOUS for name in passive})
    with pytest.raises(DescriptionError) as caught:
        Structure(mechanism)
    assert "has actuators and can not be cut, and no other joint of its loop can" in str(
        caught.value
    )
    assert "a loop needs a passive joint without actuators" in str(caught.value)


def test_a_platform_gives_way_to_a_joint_that_must_stay():
    """A leg whose every joint has friction keeps them all: the platform is cut there instead."""
    content = load("3-rpr").mechanism.model_dump(exclude_unset=True)
    for joint in next(iter(content["legs"].values()))["joints"].values():
        joint["actuators"] = {"grease": VISCOUS}
    structure = Structure(Mechanism.model_validate(content))
    assert {edge.name for edge in structure.edges} >= structure.flat.joints.keys()
    assert {closing.kind for closing in structure.closings} == {"coincidence"}
