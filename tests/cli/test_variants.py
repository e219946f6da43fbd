"""The option --variant, in every command that takes a robot."""

import json

import pytest
from click.testing import CliRunner

from gough.cli import COMMANDS, main

TEXT = """\
name: arm
parameters: {L: {value: 0.4, unit: m}}
bodies: {rod: {mass: 1, com: [L, 0, 0], inertia: [0, 1, 1]}}
joints: {pin: {type: revolute, bodies: [base, rod], actuated: true}}
variants:
  long: {about: twice as long, changes: {parameters: {L: 0.8}}}
  heavy: {changes: {bodies: {rod: {mass: 2}}}}
"""


def run(*args):
    return CliRunner().invoke(main, list(map(str, args)))


@pytest.fixture
def arm(tmp_path):
    file = tmp_path / "arm.yaml"
    file.write_text(TEXT)
    return file


def test_check_tells_which_there_are(arm):
    found = run("check", arm)
    assert found.exit_code == 0, found.output
    assert "long   twice as long" in found.output
    assert "heavy" in found.output
    data = json.loads(run("check", arm, "--variant", "long", "--json").output)
    assert data["variants"] == {"long": "twice as long", "heavy": ""}


def test_check_looks_at_every_variant(arm):
    arm.write_text(TEXT + "  bad: {changes: {bodies: {rod: {mass: -1}}}}\n")
    assert run("analyse", arm).exit_code == 0
    found = run("check", arm)
    assert found.exit_code == 2
    assert "arm.yaml:8:" in found.output
    assert "can not be negative" in found.output


def test_list_tells_which_there_are():
    data = json.loads(run("list", "--json").output)
    known = {row["name"]: row["variants"] for row in data["robots"]}
    assert "truncated" in known["deployable-hexapod"]
    assert known["bennett"] == []
    assert "truncated" in run("list").output


def test_unknown_variants(arm):
    found = run("analyse", arm, "--variant", "lang")
    assert found.exit_code == 2
    assert "Did you mean 'long'" in found.output


def test_variants_change_what_is_computed(arm):
    outputs = [
        run("dynamics", arm, "--gravity", "0 -1 0", *options).output
        for options in ((), ("--variant", "long"), ("--variant", "long", "--variant", "heavy"))
    ]
    assert len(set(outputs)) == 3


@pytest.mark.parametrize("name", sorted(COMMANDS))
def test_every_command_has_it(name):
    help_text = run(name, "--help").output
    if "ROBOT" in help_text.splitlines()[0]:
        assert "--variant" in help_text
