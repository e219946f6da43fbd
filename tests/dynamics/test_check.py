"""The check of dynamics passes on robots of the catalogue, and finds what is broken."""

import json

import pytest

from gough import load
from gough.dynamics.check import AGREED, check_dynamics
from gough.dynamics.writing import PLAIN
from gough.errors import ConfigurationError
from gough.symbolic.trees.forces import Loads

ROBOTS = [
    "orthoglide",
    "gough-stewart",
    "delta",
    "tricept",
    "4-rpr",
    "3-upu",
    "four-bar",
    "biped-leg",
    "agile-eye",
    "3-rrr",
    "bennett",
    "andrews-squeezer",
    "2rpr-slider",
    "hexaglide",
]


@pytest.mark.parametrize("name", ROBOTS)
def test_laws_hold(name):
    found = check_dynamics(load(name).dynamics, states=5)
    assert found.passed, str(found)
    assert found.worst <= AGREED
    assert sum(law.states > 0 for law in found.laws) >= 8


def test_a_wrong_inertia_is_found():
    dynamics = load("2rpr").dynamics
    model = dynamics.model("platform")
    own = model.loads
    heavy = {variable: 1.0 for variable in model.actuated}
    model.__dict__["loads"] = Loads(own.inertia, rotors=heavy, pairs=own.pairs)
    found = check_dynamics(dynamics, states=3, space="platform")
    broken = {law.name for law in found.laws if not law.holds}
    assert not found.passed
    assert "forces are Lagrange's" in broken
    assert "kinetic energy is Lagrange's" in broken
    assert "A is symmetric" not in broken
    assert "BROKEN" in str(found)


def test_wrong_rates_are_found():
    dynamics = load("four-bar").dynamics
    model = dynamics.model("joint")
    kernel = model.kernel("rates", "q")
    model._kernels["rates", "q", PLAIN] = lambda *inputs: kernel(*inputs) + 0.01
    found = check_dynamics(dynamics, states=3)
    broken = {law.name for law in found.laws if not law.holds}
    assert {"rates obey the closure", "forces are Lagrange's"} <= broken


def test_results_print_and_travel_and_repeat():
    dynamics = load("four-bar").dynamics
    found = check_dynamics(dynamics, states=4, seed=3)
    again = check_dynamics(dynamics, states=4, seed=3)
    assert found == again
    content = json.loads(json.dumps(found.as_dict()))
    assert content["passed"] is True
    assert {law["space"] for law in content["laws"]} == {law.space for law in found.laws}
    text = str(found)
    assert "every law holds" in text
    assert "seed 3" in text
    with pytest.raises(ConfigurationError, match="at least 1"):
        check_dynamics(dynamics, states=0)
