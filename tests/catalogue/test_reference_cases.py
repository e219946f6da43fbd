"""Every case of the reference through the catalogue: integers exact, maps to 1e-9.

Parameters bring a robot of the catalogue to the configuration of the case. Some of its joints are
counted in another order or from another zero than the reference's; the tables below say which.
"""

import json
from pathlib import Path

import numpy as np
import pytest

from gough import Mechanism, Robot, load
from gough import algebra as al
from gough.analysis import elimination

DATA = Path(__file__).parents[1] / "data" / "systematic.json"
CASES = json.loads(DATA.read_text("utf-8"))["cases"]


def two_legs(case):
    y = case["x"][1] if len(case["x"]) == 2 else case["qp"][2]
    return {"x": case["x"][0], "y": y, "angles": case["qp"][:2]}


def planar_pose(case):
    x, y, theta = case["x"]
    return {"x": x, "y": y, "theta": theta}


def with_motors(case):
    names = ("x", "y", "theta")[: len(case["x"])]
    return dict(zip(names, case["x"], strict=True)) | {"q": case["qa"]}


def five_bar(case):
    lengths = {key: case["params"][key] for key in ("d", "l1", "l2")}
    return lengths | {"x": case["x"][0], "y": case["x"][1], "q": case["qa"]}


def slider(case):
    return {"x": case["x"][0], "y": case["x"][1], "shift": case["qa"][2]}


def four_bar(case):
    (angle,), (coupler,), (rocker,) = case["qa"], case["qp"], case["x"]
    joints = {"angle": angle, "coupler": coupler - angle, "rocker": rocker}
    return case["params"] | joints


def position(case):
    return dict(zip("xyz", case["x"], strict=True))


def yawed(case):
    if case["label"] == "regular":
        return {}
    return {"x": 0, "y": 0, "rx": 0, "ry": 0, "rz": "pi/2"}


ROBOTS = {
    "2RPR": ("2rpr", two_legs),
    "3-RPR": ("3-rpr", planar_pose),
    "3-RPR leg 3 passive": ("3-rpr", planar_pose),
    "4-RPR": ("4-rpr", planar_pose),
    "3-RRR": ("3-rrr", with_motors),
    "5-bar": ("five-bar", five_bar),
    "5-bar flat type 3": ("five-bar", five_bar),
    "5-bar fully stretched": ("five-bar", five_bar),
    "6-UPS": ("gough-stewart", yawed),
    "6-SPS method 1": ("6-sps", lambda case: {}),
    "6-SPS method 2": ("6-sps", lambda case: {}),
    "Delta SS bars": ("delta", lambda case: {}),
    "Delta 4R parallelograms": ("delta-parallelogram", lambda case: {}),
    "3-UPU": ("3-upu", position),
    "2RPR with base slider": ("2rpr-slider", slider),
    "4-bar parallelogram": ("four-bar", four_bar),
    "Orthoglide": ("orthoglide", position),
}
MOTORS = {"2rpr-slider": [1, 2, 0]}
"""Our motors in the order of the reference, where that is another."""
TURNED_RODS = {"6-UPS", "6-SPS method 1", "6-SPS method 2"}
"""Cases whose outputs end in a rotation vector; ours are twists."""


def passive_third_leg(mechanism):
    """The mechanism with the motor of its third leg left out."""
    mechanism = mechanism.written_out()
    joints = dict(mechanism.joints)
    name = next(name for name in joints if name.startswith("leg3") and joints[name].actuated)
    joints[name] = joints[name].model_copy(update={"actuated": False})
    return Mechanism(**{**dict(mechanism), "joints": joints})


def robot_of(case):
    name, settings = ROBOTS[case["robot"]]
    modelling = "cut-platform" if case["robot"] == "6-SPS method 2" else None
    robot = load(name, modelling, **settings(case))
    if case["robot"] == "3-RPR leg 3 passive":
        return Robot(passive_third_leg(robot.mechanism))
    if case["label"] == "x_op = x4 only":
        return Robot(Mechanism(**{**dict(robot.mechanism), "operational": ("x",)}))
    return robot


def left_jacobian(v):
    """ω = J φ̇ for a rotation vector φ, ω in base axes."""
    t = np.linalg.norm(v)
    V = np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])
    return np.eye(3) + (1 - np.cos(t)) / t**2 * V + (t - np.sin(t)) / t**3 * V @ V


@pytest.fixture(params=CASES, ids=lambda case: f"{case['robot']}, {case['label']}")
def case(request):
    return request.param


@pytest.fixture
def robot(case):
    return robot_of(case)


def outputs_to_ours(case):
    """Our output rates for unit output rates of the reference."""
    T = np.eye(len(case["x"]))
    if case["robot"] in TURNED_RODS:
        T[3:, 3:] = left_jacobian(np.array(case["x"][3:]))
    return T


def test_the_catalogue_reaches_every_case():
    assert {case["robot"] for case in CASES} == ROBOTS.keys()
    assert len(CASES) == 34


def test_integers(case, robot):
    analysis = robot.analyse()
    expected = case["ranks"]
    assert analysis.equations == case["n"]
    assert vars(analysis.ranks) == {key: expected[f"r{key}"] for key in ("N", "MN", "NK", "E")}
    assert analysis.mobility == case["mobility"]
    assert analysis.redundant_equations == case["redundant_equations"]
    defects = analysis.defects.as_dict()
    assert {key: defects[key] for key in case["dims"]} == case["dims"]
    if "excess" in case:
        assert analysis.excess == case["excess"]
    O = elimination.by_svd(analysis.rates)
    assert analysis.rates.rank(O.T @ analysis.rates.M) == case["rank_A"]
    assert analysis.rates.rank(O.T @ analysis.rates.K) == case["rank_B"]
    assert analysis.assembly.residual < 1e-12


def test_conditions_as_printed(case, robot):
    assert robot.analyse().printed_tests == case["printed_tests"]


def test_motors_and_outputs(case, robot):
    motors = robot.home.q_actuated[MOTORS.get(robot.name, slice(None))]
    turns = np.round((motors - case["qa"]) / (2 * np.pi)) * (case["robot"][0] in "35")
    np.testing.assert_allclose(motors - 2 * np.pi * turns, case["qa"], atol=1e-9)
    if case["robot"] not in TURNED_RODS:
        np.testing.assert_allclose(robot.home.x, case["x"], atol=1e-9)


def test_velocity_maps(case, robot):
    order = MOTORS.get(robot.name, slice(None))
    T = outputs_to_ours(case)
    inverse, direct = robot.inverse_velocity(), robot.direct_velocity()
    if case.get("qa_dot_from_x_dot") is not None:
        assert inverse.unique
        found = inverse.matrix[order] @ T
        np.testing.assert_allclose(found, case["qa_dot_from_x_dot"], atol=1e-9)
    if case.get("x_dot_from_qa_dot") is not None:
        assert direct.unique
        found = np.linalg.solve(T, direct.matrix[:, order])
        np.testing.assert_allclose(found, case["x_dot_from_qa_dot"], atol=1e-9)


PASSIVE = {
    "2RPR": {"pin": 1},
    "3-RPR": {"pin": 1},
    "4-RPR": {"pin": 1},
    "3-RRR": {"elbow": 1},
    "5-bar": {"elbow": 1},
    "5-bar flat type 3": {"elbow": 1},
    "6-UPS": {"foot.rx": 1, "foot.ry": 1},
    "Delta 4R parallelograms": {"elbow": 1, "pin1": 1, "pin2": 1, "pin3": 1, "wrist": 1},
    "3-UPU": {"foot.rx": 1, "foot.ry": 1, "tip.ry": -1, "tip.rx": -1},
    "Orthoglide": {"j2": 1, "j3": 1, "j4": 1, "j5": 1, "j7": 1},
}
"""Our passive variables of a leg in the order of the reference, and their signs there. The bars of
the Delta with S-S bars turn about other axes there, relative to the base."""
MEASURED_FROM_LINK = {"3-RRR", "5-bar", "5-bar flat type 3", "Delta 4R parallelograms"}
"""Cases whose first passive angle of a leg is relative to the motor's link here."""


def in_reference_order(case, robot, rates):
    """Passive rates of ours as the reference counts them, legs first and then the platform's."""
    structure = robot.structure
    row = {
        structure.variables[k].name: r
        for k, r in zip(structure.columns("passive"), rates, strict=True)
    }
    signs = PASSIVE[case["robot"]]
    legs = sorted({name.split(".")[0] for name in row if name.startswith("leg")})
    rows = []
    for k, leg in enumerate(legs):
        first = len(rows)
        rows += [sign * row[f"{leg}.{name}"] for name, sign in signs.items()]
        if case["robot"] in MEASURED_FROM_LINK:
            rows[first] = rows[first] + np.array(case["qa_dot_from_x_dot"])[k]
    own = [f"platform.{r}" for r in ("rx", "ry", "rz")]
    return np.array(rows + [row[name] for name in own if name in row])


def test_passive_rates(case, robot):
    if case.get("qp_dot_from_x_dot") is None or case["robot"] not in PASSIVE:
        return
    found = robot.passive_velocity().matrix
    found = in_reference_order(case, robot, found) @ outputs_to_ours(case)
    np.testing.assert_allclose(found, case["qp_dot_from_x_dot"], atol=1e-9)


def rotation(axis, angle):
    return np.array(al.rotation_about(axis, angle), dtype=float)


def test_passive_rates_of_the_delta_with_bars():
    """The bars' angles are measured from the base there: their directions and rates compare."""
    case = next(case for case in CASES if case["robot"] == "Delta SS bars")
    robot = robot_of(case)
    structure, q, p = robot.structure, robot.home.q, robot.assembler.p
    rates = np.zeros((len(structure.variables), 3))
    rates[structure.columns("operational")] = np.eye(3)
    rates[structure.columns("actuated")] = robot.inverse_velocity().matrix
    rates[structure.columns("passive")] = robot.passive_velocity().matrix
    poses = robot.models.poses(q, p)
    expected_rates = np.array(case["qp_dot_from_x_dot"])
    for k in range(6):
        bar = f"leg{k // 2 + 1}.bar{k % 2 + 1}"
        direction = poses[structure.bodies.index(bar)][:3, 2]
        spin = robot.models.body_jacobian(bar)(q, p)[3:] @ rates
        alpha, beta = case["qp"][2 * k : 2 * k + 2]
        leg, X, Y = (
            rotation("z", 2 * np.pi * (k // 2) / 3),
            rotation("x", alpha),
            rotation("y", beta),
        )
        expected = leg @ X @ Y @ [0, 0, -1]
        np.testing.assert_allclose(direction, expected, atol=1e-9)
        axes = np.column_stack([leg @ [1, 0, 0], leg @ X @ [0, 1, 0]])
        expected_spin = axes @ expected_rates[2 * k : 2 * k + 2]
        for found, wanted in zip(spin.T, expected_spin.T, strict=True):
            change, expected_change = np.cross(found, direction), np.cross(wanted, expected)
            np.testing.assert_allclose(change, expected_change, atol=1e-9)
    platform = [f"platform.{r}" for r in ("rx", "ry", "rz")]
    names = [v.name for v in structure.variables]
    turning = rates[[names.index(name) for name in platform]]
    np.testing.assert_allclose(turning, expected_rates[12:], atol=1e-9)
