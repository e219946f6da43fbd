"""Motions under laws of force in the report: runs, variants compared, and ensembles."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest

from gough import Body, Joint, Mechanism, Robot, load
from gough.description.parts import Variant
from gough.studies.context import Context
from gough.studies.deployments import Deployment, alike, turned, turns
from gough.studies.plain import as_json
from gough.studies.report import Paragraph, Section, Table
from gough.studies.sections import comparison, simulation, uncertainty

HEXAPOD = "deployable-hexapod"


@pytest.fixture(scope="module")
def hexapod() -> Context:
    return Context(load(HEXAPOD))


def names(section: Section | None) -> list[str]:
    assert section is not None
    return [picture.name for picture in section.pictures]


def tables(section: Section) -> list[Table]:
    return [block for block in section.blocks if isinstance(block, Table)]


def said(section: Section) -> str:
    return " ".join(block.text for block in section.blocks if isinstance(block, Paragraph))


def slider(**numbers: Any) -> Robot:
    """A mass on a slide, with a spring that pushes it and maybe a stop."""
    spring = {"law": "spring-damper", "numbers": {"stiffness": "k", "damping": 0.5, "rest": 0.2}}
    actuators: dict[str, Any] = {"spring": spring}
    if numbers:
        actuators["stop"] = {"law": "end-stop", "numbers": numbers}
    slide = {"type": "prismatic", "bodies": ("base", "mass"), "actuators": actuators}
    return Robot(
        Mechanism.model_validate(
            {
                "name": "slider",
                "gravity": [0, 0, 0],
                "parameters": {"k": {"value": 100.0, "unit": "N/m"}},
                "bodies": {"mass": {"mass": 1.0}},
                "joints": {"slide": slide},
                "operational": ["slide"],
            }
        )
    )


STOP = {"upper": 0.1, "stiffness": 1e4, "damping": 50.0, "sharpness_spring": 2000.0}


# runs


def test_the_deployment_is_that_of_the_reference(hexapod: Context) -> None:
    found = hexapod.deployment
    assert isinstance(found, Deployment)
    assert found.duration == 1.0
    assert found.whole
    assert found.time == pytest.approx(0.404, abs=1e-4)
    section = simulation.section(hexapod)
    assert names(section) == ["deployment", "force-loops", "energies"]
    data = section.data["simulation"]
    z = np.array(data["outputs"]["z"]["values"])
    at = np.searchsorted(data["time"], [0.0, 0.2, 0.4, 0.45, 0.5])
    np.testing.assert_allclose(z[at], [0.22, 0.3961, 0.8732, 0.8837, 0.8857], atol=6e-5)
    assert data["numbers"]["energy delivered"]["value"] == pytest.approx(18.91)
    json.loads(as_json(section.data))


def test_a_slow_cycle_loses_what_the_formula_says(hexapod: Context) -> None:
    """E = Δ' (s - 2/β tanh(β s / 2)), Δ' = b_f - b_d + 2 a / β."""
    (loop,) = simulation.section(hexapod).data["simulation"]["loops"]
    beta, s = 50.0, float(np.ptp(loop["position"]))
    expected = (3 + 2 * -3 / beta) * (s - 2 / beta * np.tanh(beta * s / 2))
    assert len(loop["actuators"]) == 6
    assert loop["lost"] == pytest.approx(expected, rel=1e-4)


def test_a_spring_without_a_stop_moves_and_has_no_ensemble() -> None:
    context = Context(slider())
    found = context.deployment
    assert isinstance(found, Deployment)
    assert not found.whole
    assert found.time == np.inf
    section = simulation.section(context)
    assert names(section) == ["deployment", "energies"]
    assert "by its own size" in said(section)
    assert uncertainty.section(context) is None
    assert comparison.section(context) is None


@pytest.mark.parametrize("name", ["four-bar", "andrews-squeezer", "gough-stewart"])
def test_a_robot_that_nothing_moves_gets_a_sentence(name: str) -> None:
    context = Context(load(name))
    section = simulation.section(context)
    assert said(section) == "There is no run: no law of force moves the robot from rest at home."
    assert section.data == {"simulation": None}
    assert uncertainty.section(context) is None
    assert comparison.section(context) is None


def test_a_drive_that_nobody_tells_moves_nothing() -> None:
    pin = Joint(type="revolute", bodies=("base", "rod"), actuated=True)
    robot = Robot(Mechanism(name="rod", bodies={"rod": Body(mass=1.0)}, joints={"pin": pin}))
    assert isinstance(Context(robot).deployment, str)


# turns


def test_turns_go_on_beyond_half_a_turn() -> None:
    angle = np.linspace(0, 1.8 * np.pi, 200)
    axis = np.array([0.6, 0.0, 0.8])
    wxyz = np.column_stack([np.cos(angle / 2), np.sin(angle / 2)[:, None] * axis])
    wxyz[50:] *= -1  # the same orientations
    np.testing.assert_allclose(turns(wxyz), angle[:, None] * axis, atol=1e-12)
    near = turned(wxyz, wxyz[0])
    np.testing.assert_allclose(near[-1], (1.8 - 2) * np.pi * axis, atol=1e-12)


def test_turns_count_from_the_first_orientation_in_base_axes() -> None:
    half = np.sqrt(0.5)
    first, then = np.array([half, half, 0, 0]), np.array([0.5, 0.5, 0.5, 0.5])
    # a quarter turn about x, then one about z of the base
    product = np.array([half * half, half * half, half * half, half * half])
    np.testing.assert_allclose(then, product)
    np.testing.assert_allclose(turns(np.array([first, then]))[1], [0, 0, np.pi / 2], atol=1e-12)


def test_equal_curves_are_one() -> None:
    a, b = np.array([0.0, 1.0]), np.array([0.0, 1.1])
    assert alike([a, b, a + 1e-9]) == [[0, 2], [1]]


# variants


def test_variants_that_change_the_same_are_alternatives() -> None:
    variants = load(HEXAPOD).mechanism.variants
    assert comparison.alternatives(variants) == [
        ["truncated", "as-printed"],
        ["massive-legs"],
        ["universal-radial", "universal-tangential", "universal-vertical", "spherical"],
        ["dispersed"],
    ]
    one = Variant(changes={"parameters": {"a": {"live": True}}})
    assert comparison.alternatives({"live": one}) == []


def test_models_and_feet_differ_as_in_the_reference(hexapod: Context) -> None:
    section = comparison.section(hexapod)
    assert section is not None
    single, models, feet = section.data["comparison"]
    assert single["names"] == ["as described", "massive-legs", "dispersed"]
    assert models["names"] == ["as described", "truncated", "as-printed"]
    assert models["together_with"] == "dispersed"
    x = np.array([models["outputs"][q]["values"] for q in ("x", "turn about x")])
    truncated, printed = (1e3 * np.abs(x[:, k] - x[:, 0]).max(axis=1) for k in (1, 2))
    np.testing.assert_allclose(truncated, [0.05, 0.15], atol=0.005)
    np.testing.assert_allclose(printed, [1.2, 3.7], atol=0.05)
    assert feet["together_with"] == "massive-legs"
    assert feet["names"][-1] == "spherical"
    z, at = np.array(feet["outputs"]["z"]["values"]), np.searchsorted(feet["time"], 0.4)
    assert 1e3 * (z[-1] - z[0])[at] == pytest.approx(0.23, abs=0.005)
    np.testing.assert_allclose(z[2], z[3], atol=1e-6)  # a vertical first axis: no spin


# ensembles


def test_an_ensemble_of_a_slider_finds_what_formulas_say(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(uncertainty, "RUNS", 400)
    monkeypatch.setattr(uncertainty, "SLOW_RUNS", 400)
    robot = slider(**STOP)
    section = uncertainty.section(Context(robot))
    assert section is not None
    data = section.data["uncertainty"]
    assert data["sobol"]["factors"] == ["k"]
    assert data["sobol"]["outputs"] == ["time of deployment", "kinetic energy left"]
    # one factor is behind all of the variance
    assert data["sobol"]["total"][0][0] == pytest.approx(1.0, abs=0.1)
    # t is about acos(1/2) / sqrt(k), so it falls with k
    nominal, low, high = (
        np.array(data["tornado"][key]) for key in ("nominal", "at_low", "at_high")
    )
    assert nominal[0] == pytest.approx(np.arccos(0.5) / 10, rel=0.02)
    assert low[0] > nominal[0] > high[0]
    assert low[0, 0] / nominal[0] == pytest.approx(1 / np.sqrt(0.91), rel=2e-3)
    assert {"sobol", "scatter"} <= set(names(section))
    json.loads(as_json(section.data))


def test_an_ensemble_of_the_hexapod_is_told(
    hexapod: Context, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(uncertainty, "RUNS", 26 * 64)
    section = uncertainty.section(hexapod)
    assert section is not None
    data = section.data["uncertainty"]
    assert data["design"]["saltelli"]["base"] == 64
    assert len(data["sobol"]["factors"]) == 24
    # by symmetry one spring alone turns the platform as far one way as its neighbour the other
    k = data["sobol"]["factors"].index("scale[0]")
    low = np.array(data["tornado"]["at_low"])[1]
    np.testing.assert_allclose(low[k : k + 6], low[k], rtol=1e-3)
    assert data["reliability"]["any"]["probability"] > 0
    assert [row[0] for row in tables(section)[-1].rows] == [
        "time of deployment ≤ 0.44 s",
        "size of turn about z ≤ 30 °",
        "kinetic energy left ≤ 2 %",
        "any of them",
    ]


def test_rows_of_both_designs_are_the_same_in_parts() -> None:
    design = uncertainty.Design(uncertainty.SaltelliDesign(8, 3))
    whole = design.rows()
    assert len(whole) == len(design) == 7 + 8 * 5
    parts = [design.rows(start, min(start + 5, 47)) for start in range(0, 47, 5)]
    np.testing.assert_array_equal(np.concatenate(parts), whole)


def test_too_many_parameters_for_an_ensemble_are_told(
    hexapod: Context, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(uncertainty, "RUNS", 100)
    section = uncertainty.section(hexapod)
    assert section is not None
    assert "24 parameters take more than 100 runs" in said(section)
