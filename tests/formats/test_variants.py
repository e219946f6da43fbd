"""Variants of a description: merging, places of errors, round trips."""

import pytest

from gough.description import Mechanism
from gough.errors import DescriptionError, UnknownName
from gough.formats.native import Source
from gough.robot import load

TEXT = """\
name: arm
parameters:
  L: {value: 0.4, unit: m, about: length}
  m: 2
bodies:
  rod: {mass: m, com: [L/2, 0, 0]}
joints:
  pin: {type: revolute, bodies: [base, rod], actuated: true, motor: {inertia: 1e-4}}
variants:
  long:
    about: twice as long
    changes:
      parameters: {L: 0.8}
  light:
    changes:
      parameters:
        m: {live: true, value: 0.5}
      joints:
        pin: {motor: null}
  sliding:
    changes:
      joints:
        pin: {type: prismatic}
  two:
    changes:
      bodies: {tip: {mass: 1, com: null}}
      joints: {end: {type: fixed, bodies: [rod, tip]}}
"""


def read(text, *variants, **parameters):
    return Source(text.encode(), "arm.yaml").mechanism(parameters, variants)


def test_mappings_merge_and_null_removes():
    plain, long, light = read(TEXT), read(TEXT, "long"), read(TEXT, "light")
    assert plain.parameters["L"].value == 0.4
    assert long.parameters["L"].value == 0.8
    assert (long.parameters["L"].unit, long.parameters["L"].about) == ("m", "length")
    assert light.parameters["m"].live
    assert not plain.parameters["m"].live
    assert light.joints["pin"].motor is None
    assert light.joints["pin"].actuated
    assert read(TEXT, "two").bodies["tip"].mass == 1


def test_several_are_made_in_order_and_settings_come_last():
    text = TEXT + "  short: {changes: {parameters: {L: 0.1}}}\n"
    assert read(text, "long", "short").parameters["L"].value == 0.1
    assert read(text, "short", "long").parameters["L"].value == 0.8
    found = read(text, "short", "light", L=0.3)
    assert found.parameters["L"].value == 0.3
    assert found.parameters["L"].unit == "m"


def test_python_does_the_same_and_round_trips():
    plain = read(TEXT)
    for names in (("long",), ("light", "two"), ("two", "long", "sliding")):
        assert plain.varied(*names) == read(TEXT, *names)
    assert plain.varied("long").varied("light") == plain.varied("long", "light")
    content = plain.model_dump(exclude_unset=True)
    assert Mechanism.model_validate(content) == plain
    assert Mechanism.model_validate_json(plain.model_dump_json(exclude_unset=True)) == plain
    dumps = {m.model_dump_json(exclude_unset=True) for m in (plain, plain.varied("long"))}
    assert len(dumps) == 2
    with pytest.raises(UnknownName, match="Did you mean 'long'"):
        plain.varied("lang")


def problems(text, *variants):
    with pytest.raises(DescriptionError) as caught:
        read(text, *variants)
    return [(p.line, p.message) for p in caught.value.problems]


@pytest.mark.parametrize(
    ("changes", "at", "words"),
    [
        ("joints: {pin: {type: revolut}}", "revolut}", "'revolut' is not a joint type"),
        ("bodies: {rod: {mass: -1}}", "-1", "can not be negative"),
        ("bodies: {rod: {mas: 1}}", "mas:", "no entry 'mas'"),
        ("bodies: {rod: {mass: k}}", "k}", "'k'"),
        ("parameters: {L: L}", "L}", "circle"),
        ("parameters: {n: {about: new}}", "{about", "missing"),
        ("bodies: {x: {mass: 1}}", "x:", "nothing holds body 'x'"),
        ("platform: plate", "plate", "no body 'plate'"),
        ("gravity: 3", "3", "3"),
        ("bodies: {rod: null}", "rod]}", "no body 'rod'"),
    ],
)
def test_errors_stand_where_the_variant_has_them(changes, at, words):
    text = f"""\
name: arm
parameters: {{L: 0.4}}
bodies:
  rod: {{mass: 1, com: [L, 0, 0]}}
joints:
  pin: {{type: revolute, bodies: [base, rod]}}
variants:
  good: {{}}
  wrong:
    about: something wrong
    changes:
      {changes}
"""
    assert read(text, "good")
    with pytest.raises(DescriptionError) as caught:
        read(text, "wrong")
    problem = caught.value.problems[0]
    assert words in problem.message
    lines = text.splitlines()
    line = 6 if at == "rod]}" else 12
    assert (problem.line, problem.column) == (line, lines[line - 1].rindex(at) + 1)


@pytest.mark.parametrize(
    ("entry", "words"),
    [
        ("variants: {a: {changes: {bodys: {}}}}", "no entry 'bodys' to change. Did you mean"),
        ("variants: {a: {changes: {variants: {}}}}", "can not change the variants"),
        ("variants: {a: {changes: 3}}", "expected a mapping"),
        ("variants: {a: 3}", "expected a mapping"),
        ("variants: {a: {chnges: {}}}", "Did you mean 'changes'"),
        ("variants: [a]", "expected a mapping"),
    ],
)
def test_what_is_wrong_with_variants_themselves(entry, words):
    text = f"name: nothing\n{entry}\n"
    assert any(line == 2 and words in message for line, message in problems(text)), problems(text)


def test_unknown_ones_are_told_with_a_hint():
    with pytest.raises(UnknownName, match="Did you mean 'long'"):
        read(TEXT, "lon")
    with pytest.raises(UnknownName, match="no variant is named 'any'"):
        load("bennett", variants=("any",))


def test_a_robot_knows_its_variants(tmp_path):
    file = tmp_path / "arm.yaml"
    file.write_text(TEXT)
    assert load(file, variants=["long", "light"]).origin.variants == ("long", "light")
    assert load(file, variants="long").origin.variants == ("long",)
    assert load(file).origin != load(file, variants="long").origin
    assert set(load(file, variants="long").mechanism.variants) == {
        "long",
        "light",
        "sliding",
        "two",
    }
