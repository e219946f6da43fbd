"""``gough modes`` and ``gough inverse``."""

import json

import numpy as np
import pytest
from click.testing import CliRunner

import gough
from gough.cli import main


def run(*args, code=0):
    result = CliRunner().invoke(main, [*map(str, args)])
    assert result.exit_code == code, result.output
    return result


def test_modes_at_home_and_elsewhere():
    text = run("modes", "five-bar").stdout
    assert text.startswith("2 assembly modes of five-bar, expected (2 of 2 complex solutions)")
    q = gough.load("five-bar").home.q_actuated + 0.1
    found = json.loads(run("modes", "five-bar", "--q", f"{q[0]}, {q[1]}", "--json").stdout)
    expected = gough.load("five-bar").assembly_modes(q)
    np.testing.assert_allclose(found["x"], expected.x, atol=1e-12)
    assert found["certified"] == [True, True]
    assert found["status"] == "expected"


def test_modes_of_a_delta_that_may_turn():
    found = json.loads(run("modes", "delta", "--motion", "any", "--json").stdout)
    assert (found["complex_count"], len(found["poses"])) == (40, 16)


def test_modes_with_own_points():
    base = "base_anchors=[[0,0,0],[1,0,0],[1,1,0],[0,1,0.1],[0.5,1.3,0],[-0.4,0.5,0]]"
    found = json.loads(run("modes", "6-ups", "--set", base, "--json").stdout)
    assert found["complex_count"] == 40
    assert found["status"] == "certified"


def test_inverse_on_every_working_mode():
    text = run("inverse", "orthoglide", "--x", "0.05 -0.03 0.67").stdout
    assert "leg1.slide   +0.284942733" in text
    assert "8 working modes of orthoglide" in text
    assert sum("home" in line for line in text.splitlines()) == 2
    found = json.loads(run("inverse", "orthoglide", "--x", "0.05,-3/100,0.67", "--json").stdout)
    robot = gough.load("orthoglide")
    np.testing.assert_allclose(
        list(found["q"].values()), robot.inverse_geometry([0.05, -0.03, 0.67])
    )
    assert len(found["working_modes"]["q_actuated"]) == 8
    assert "working_modes" not in json.loads(run("inverse", "3-rps", "--json").stdout)


def test_out_of_reach_says_what_is_missing():
    result = run("inverse", "orthoglide", "--x", "0.5,0,0.6", code=1)
    assert (
        result.stderr
        == "pose is out of reach: leg1 is 189.4 mm too short; leg3 is 189.4 mm too short\n"
    )
    data = json.loads(run("inverse", "orthoglide", "--x", "0.5,0,0.6", "--json", code=1).stdout)
    assert data["error"].startswith("pose is out of reach")


@pytest.mark.parametrize(
    ("args", "message"),
    [
        (["inverse", "five-bar", "--x", "1,a"], "'a' is no number: there is no parameter 'a'"),
        (["inverse", "five-bar", "--x", " , "], "expected numbers, with commas or spaces between"),
        (["inverse", "five-bar", "--x", "1"], "x has shape (1,), expected (..., 2): x, y"),
        (["inverse", "five-bar", "--x", "1/0,2"], "'1/0' is no number"),
        (["inverse", "biped-leg"], "biped-leg has no operational coordinates"),
        (["modes", "five-bar", "--q", "1,2,3"], "q_actuated has shape (3,), expected (2,)"),
        (["modes", "five-bar", "--motion", "all"], "'all' is not one of 'home', 'any'"),
        (["modes", "five-baar"], "Did you mean 'five-bar'?"),
    ],
)
def test_wrong_input(args, message):
    assert message in run(*args, code=2).stderr
