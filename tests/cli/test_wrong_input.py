"""Wrong input of every kind ends in a message that names file, line, thing, value and way out."""

import json

import pytest
from click.testing import CliRunner

from gough.cli import main

GOOD = """\
name: crank
motion: planar
parameters: {a: 0.1, b: 0.3, c: 0.25, d: 0.35}
bodies:
  crank: {mass: 0.2, inertia: [1.0e-4, 1.0e-4, 1.0e-4]}
  coupler: {mass: 0.5}
  rocker: {mass: 0.4}
joints:
  A: {type: revolute, bodies: [base, crank], actuated: true, home: pi/3}
  B: {type: revolute, bodies: [crank, coupler], frames: [{point: [a, 0]}, {}]}
  C: {type: revolute, bodies: [coupler, rocker], frames: [{point: [b, 0]}, {point: [c, 0]}]}
  D: {type: revolute, bodies: [base, rocker], frames: [{point: [d, 0]}, {}], home: 1.8}
operational: [D]
"""

WRONG = {
    "unknown joint type": (
        ("B: {type: revolute", "B: {type: revolut"),
        ":10:13: joints.B.type: 'revolut' is not a joint type. Did you mean 'revolute'?",
    ),
    "unknown body": (
        ("bodies: [coupler, rocker]", "bodies: [coupler, roker]"),
        ":11:41: joints.C.bodies.1: there is no body 'roker'. Did you mean 'rocker'?",
    ),
    "dangling body": (
        ("  rocker: {mass: 0.4}", "  rocker: {mass: 0.4}\n  spare: {mass: 1}"),
        ":8:3: bodies.spare: nothing holds body 'spare': no joint names it",
    ),
    "two bases": (
        ("name: crank", "name: crank\nbase: [base, ground]"),
        ":2:7: base: expected text",
    ),
    "base written twice": (("name: crank", "name: crank\nbase: a\nbase: b"), ":3:1: base:"),
    "disconnected graph": (
        (
            "operational",
            "  E: {type: revolute, bodies: [p, q]}\noperational",
            "bodies:\n",
            "bodies:\n  p: {}\n  q: {}\n",
        ),
        "body 'p' hangs together with q, but not with the base",
    ),
    "every joint of a loop has a motor": (
        ("bodies: [", "actuated: true, bodies: [", ", actuated: true, home", ", home", "[D]", "[]"),
        "is actuated and can not be cut, and no other joint of its loop can",
    ),
    "chosen cut has a motor": (
        ("operational: [D]", "operational: [D]\ncut: [A]"),
        ":14:7: cut.0: 'A' is actuated; only passive joints can be cut",
    ),
    "zero axis": (
        ("{point: [d, 0]}", "{point: [d, 0], axis: [0, 0, 0]}"),
        ":12:78: joints.D.frames.0.axis: the axis is zero and gives no direction",
    ),
    "axis that is no unit vector": (
        ("{point: [d, 0]}", "{point: [d, 0], axis: [0, 0, 2]}"),
        "the axis has length 2, not 1: write [0, 0, 1]",
    ),
    "axis out of the plane": (
        ("{point: [d, 0]}", "{point: [d, 0], axis: [1, 0, 0]}"),
        "the axis of a planar revolute joint is z, or -z",
    ),
    "negative mass": (
        ("mass: 0.5", "mass: -0.5"),
        ":6:19: bodies.coupler.mass: the mass is -0.5 kg; it can not be negative",
    ),
    "inertia that no body has": (
        ("[1.0e-4, 1.0e-4, 1.0e-4]", "[1, 2, 9]"),
        ":5:31: bodies.crank.inertia: no body has the principal moments 1, 2, 9 kg m²",
    ),
    "expressions in a circle": (
        ("a: 0.1", "a: b - 1", "b: 0.3", "b: a + 1"),
        ":3:17: parameters.a: the parameters refer to each other in a circle: a → b → a",
    ),
    "unknown parameter": (
        ("point: [b, 0]", "point: [bb, 0]"),
        ":11:67: joints.C.frames.0.point: there is no parameter 'bb'. Did you mean 'b'?",
    ),
    "infinite number": (("a: 0.1", "a: .inf"), ":3:17: parameters.a: "),
    "not a number": (("a: 0.1", "a: .nan"), ":3:17: parameters.a: "),
    "number too large": (("a: 0.1", "a: 1e999"), ":3:17: parameters.a: "),
    "expression too large": (("a: 0.1", "a: 10**400"), "is too large for a number"),
    "expression that calls": (
        ("a: 0.1", "a: __import__('os')"),
        "there is no function '__import__'",
    ),
    "unknown entry": (
        ("actuated: true", "actuate: true"),
        ":9:46: joints.A.actuate: there is no entry 'actuate' here. Did you mean 'actuated'?",
    ),
    "motor of a passive joint": (
        ("bodies: [crank, coupler]", "motor: {ratio: 50}, bodies: [crank, coupler]"),
        ":10:23: joints.B.motor: a joint with a motor needs actuated: true",
    ),
    "rotor of negative inertia": (
        ("actuated: true", "actuated: true, motor: {inertia: a - 1}"),
        ":9:79: joints.A.motor.inertia: the inertia of the rotor is -0.9 kg m²; it can not be",
    ),
    "unknown entry of a motor": (
        ("actuated: true", "actuated: true, motor: {gear: 50}"),
        ":9:70: joints.A.motor.gear: there is no entry 'gear' here. "
        "Known: effort, inertia, ratio, speed.",
    ),
    "motor that is a number": (
        ("actuated: true", "actuated: true, motor: 50"),
        ":9:69: joints.A.motor: expected a mapping of names, got 50",
    ),
    "tab": (("  crank:", "\tcrank:"), ":5:1: "),
    "alias": (("a: 0.1", "a: &x 0.1"), "anchor"),
    "tag": (("a: 0.1", "a: !!python/object/apply:os.system [ls]"), "tag"),
}


def run(*args):
    return CliRunner().invoke(main, list(args))


def written(tmp_path, *changes):
    text = GOOD
    for old, new in zip(changes[::2], changes[1::2], strict=True):
        assert old in text
        text = text.replace(old, new)
    file = tmp_path / "robot.yaml"
    file.write_text(text, "utf-8")
    return str(file)


def test_the_unchanged_description_is_right(tmp_path):
    result = run("check", written(tmp_path))
    assert result.exit_code == 0, result.output
    assert "is right" in result.stdout


@pytest.mark.parametrize("case", WRONG)
@pytest.mark.parametrize("command", ["check", "analyse"])
def test_a_wrong_description(tmp_path, case, command):
    changes, expected = WRONG[case]
    file = written(tmp_path, *changes)
    result = run(command, file)
    assert result.exit_code == 2
    assert expected in result.stderr
    assert file in result.stderr
    assert result.stdout == ""


@pytest.mark.parametrize("case", WRONG)
def test_errors_as_json_are_one_object(tmp_path, case):
    changes, expected = WRONG[case]
    result = run("analyse", written(tmp_path, *changes), "--json")
    data = json.loads(result.stdout)
    assert expected.split(": ", 2)[-1] in data["error"]
    assert all(problem["line"] for problem in data["problems"])


def test_all_errors_of_a_file_are_reported_at_once(tmp_path):
    file = written(
        tmp_path, "mass: 0.5", "mass: -0.5", "B: {type: revolute", "B: {type: x", "[d, 0]", "[q, 0]"
    )
    lines = run("check", file).stderr.splitlines()
    assert [line.split(":")[1] for line in lines] == ["6", "10", "12"]


def test_a_home_that_can_not_close(tmp_path):
    file = written(tmp_path, "b: 0.3", "b: 0.05", "c: 0.25", "c: 0.1")
    for command in ("check", "analyse"):
        result = run(command, file)
        assert result.exit_code == 1
        assert "does not close: the largest gap is 0." in result.stderr
        assert "at C (loop of" in result.stderr


def test_deep_nesting_binary_and_missing_files(tmp_path):
    deep, binary = tmp_path / "deep.yaml", tmp_path / "binary.yaml"
    deep.write_text("name: " + "[" * 10_000, "utf-8")
    binary.write_bytes(bytes(range(256)))
    for file, expected in (
        (deep, "64"),
        (binary, "not a text file"),
        (tmp_path / "missing.yaml", "can not be read: No such file or directory"),
        (tmp_path, "can not be read: Is a directory"),
    ):
        result = run("analyse", str(file))
        assert result.exit_code == 2
        assert expected in result.stderr
        assert len(result.stderr) < 500


def test_a_description_is_a_mapping(tmp_path):
    for text in ("- 1", "just text", "3"):
        file = tmp_path / "robot.yaml"
        file.write_text(text, "utf-8")
        result = run("check", str(file))
        assert result.exit_code == 2
        assert "a description is a mapping of names" in result.stderr


@pytest.mark.parametrize(
    ("args", "expected"),
    [
        (("analyse", "2rp"), "Did you mean '2rpr'?"),
        (("analise", "2rpr"), "Did you mean 'analyse'?"),
        (("analyse", "2rpr", "--set", "K=1"), "no parameter is named 'K'"),
        (("analyse", "2rpr", "--set", "L"), "expected NAME=VALUE"),
        (("analyse", "2rpr", "--set", "L=[1"), "--set L"),
        (("analyse", "2rpr", "--set", "L=nonsense"), "there is no parameter 'nonsense'"),
        (("analyse", "2rpr", "--set", "L={a: 1}"), "expected a number"),
        (("analyse", "four-bar", "--modelling", "cut-platform"), "needs a platform"),
        (("analyse", "2rpr", "--seed", "-1"), "-1"),
        (("analyse",), "Missing argument"),
        (("study", "2rp"), "Did you mean '2rpr'?"),
    ],
)
def test_wrong_arguments(args, expected):
    result = run(*args)
    assert result.exit_code == 2
    assert expected in result.stderr
    assert "Traceback" not in result.output


IN_A_LEG = """\
name: legs
bodies: {plate: {}}
legs:
  leg:
    repeat: 3
    parameters: {angle: 2*pi*i/3, x: acos(R), y: 2*x, foot: ["cos(angle)", "y + angel", 0]}
    bodies: {cart: {mass: 1}}
    joints:
      slide: {type: prismatic, bodies: [base, kart], frames: [{point: foot}, {}]}
      ball: {type: spherical, bodies: [cart, plate]}
parameters: {R: 2}
platform: plate
operational: [z, roll, rx]
"""


def test_errors_in_a_leg_speak_its_own_names(tmp_path):
    file = tmp_path / "legs.yaml"
    file.write_text(IN_A_LEG, "utf-8")
    lines = run("check", str(file)).stderr.splitlines()
    told = [line.split(": ", 1)[1] for line in lines]
    assert told == [
        "legs.leg.parameters.x: 'acos(R)' has no value: acos(2) is not defined",
        "legs.leg.joints.slide.bodies.1: there is no body 'kart'. Did you mean 'cart'? "
        "Known: cart, base, leg1.cart, leg2.cart, leg3.cart, plate.",
        "operational.1: there is no output 'roll'. Known: x, y, z, rx, ry, rz, leg1.ball, "
        "leg1.slide, leg2.ball, leg2.slide, leg3.ball, leg3.slide.",
    ]


def test_brackets_in_brackets_need_quotes(tmp_path):
    result = run("check", written(tmp_path, "[b, 0]", "[b[0], 0]"))
    assert "such as B[i], needs quotes" in result.stderr


def test_a_file_named_without_its_ending(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    written(tmp_path)
    result = run("check", "robot")
    assert result.exit_code == 2
    assert "the file beside you is called robot.yaml" in result.stderr


def test_check_says_what_gave_way(tmp_path):
    result = run("check", written(tmp_path, "b: 0.3", "b: 0.05"))
    assert result.exit_code == 0
    assert "these were moved from where it puts them: A" in result.stdout


def test_an_interruption_has_its_own_exit_code(monkeypatch):
    def interrupted(*args, **options):
        raise KeyboardInterrupt

    monkeypatch.setattr("gough.robot.load", interrupted)
    result = run("analyse", "2rpr")
    assert result.exit_code == 130
    assert result.stderr == "Interrupted.\n"


def chain(tmp_path, end):
    links = [f"p{k}: p{k + 1} + 1" for k in range(600)]
    file = tmp_path / "chain.yaml"
    parameters = ", ".join([*links, f"p600: {end}"])
    file.write_text(f"name: chain\nparameters: {{{parameters}}}\ngravity: [p0, 0, 0]\n", "utf-8")
    return str(file)


def test_a_long_chain_of_parameters_has_a_value(tmp_path):
    assert run("check", chain(tmp_path, 1)).exit_code == 0


def test_a_long_chain_without_an_end_is_one_error(tmp_path):
    result = run("check", chain(tmp_path, "sqrt(-1)"))
    assert result.exit_code == 2
    assert "p600" in result.stderr
    assert len(result.stderr.splitlines()) <= 3


def test_very_many_errors_are_counted(tmp_path):
    file = tmp_path / "many.yaml"
    bodies = "".join(f"  b{k}: {{mass: -1}}\n" for k in range(80))
    file.write_text(f"name: many\nbodies:\n{bodies}", "utf-8")
    lines = run("check", str(file)).stderr.splitlines()
    assert (len(lines), lines[-1]) == (51, "… and 30 more")
