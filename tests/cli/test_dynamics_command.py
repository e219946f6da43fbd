"""``gough dynamics``."""

import csv
import json

import numpy as np
import pytest
from click.testing import CliRunner

import gough
from gough import catalogue
from gough.cli import main

TIME = np.linspace(0, 1, 101)
S = 10 * TIME**3 - 15 * TIME**4 + 6 * TIME**5
SD = 30 * TIME**2 - 60 * TIME**3 + 30 * TIME**4
SDD = 60 * TIME - 180 * TIME**2 + 120 * TIME**3


def run(*args, code=0):
    result = CliRunner().invoke(main, ["dynamics", *map(str, args)])
    assert result.exit_code == code, result.output
    return result


def written(path, titles, *columns):
    rows = np.column_stack(columns)
    lines = [titles, *(",".join(map(repr, row)) for row in rows.tolist())]
    path.write_text("\n".join(lines) + "\n")
    return path


def moved(name, by):
    """A quintic motion from home: x, ẋ, ẍ."""
    by = np.asarray(by)
    x = gough.load(name).home.x + S[:, None] * by
    return x, SD[:, None] * by, SDD[:, None] * by


def test_a_motion_with_all_its_columns(tmp_path):
    x, xd, xdd = moved("3-rpr", [0.06, -0.04, 0.2])
    titles = "x,y [m],rz [deg],dx [mm/s],dy [m/s],drz [deg/s],ddx [m/s²],ddy [m/s2],ddrz [rad/s^2]"
    degrees = [1, 1, 180 / np.pi]
    path = written(tmp_path / "t.csv", titles, x * degrees, xd * [1e3, 1, 180 / np.pi], xdd)
    found = json.loads(run("3-rpr", "--trajectory", path, "--json").stdout)
    expected = gough.load("3-rpr").inverse_dynamics(x, xd, xdd)
    efforts = np.transpose([motor["efforts"] for motor in found["motors"]])
    np.testing.assert_allclose(efforts, expected, rtol=1e-11, atol=1e-11)
    assert found["solved"]
    assert found["time"] is None
    assert found["derived"] is None


def test_missing_rates_are_derived_and_said_so(tmp_path):
    x, xd, xdd = moved("five-bar", [0.06, -0.04])
    path = written(tmp_path / "t.csv", "time [ms],x [mm],y [mm]", 1e3 * TIME, 1e3 * x)
    text = run("five-bar", "--trajectory", path).stdout
    assert text.startswith("five-bar along a motion of 101 rows, 0 s to 1 s\n")
    assert "rates and accelerations are derivatives of a quintic spline" in text
    found = json.loads(run("five-bar", "--trajectory", path, "--json").stdout)
    expected = gough.load("five-bar").inverse_dynamics(x, xd, xdd)
    efforts = np.transpose([motor["efforts"] for motor in found["motors"]])
    np.testing.assert_allclose(efforts, expected, atol=1e-6)
    path = written(tmp_path / "t.csv", "time,x,y,dx,dy", TIME, x, xd)
    found = json.loads(run("five-bar", "--trajectory", path, "--json").stdout)
    assert found["derived"].startswith("accelerations are derivatives")
    np.testing.assert_allclose(found["accelerations"]["ddy"], xdd[:, 1], atol=1e-8)


def test_poses_turn_by_their_angular_velocity(tmp_path):
    """Quaternions of any sign are differentiated to twists."""
    angle, axis = 0.3 * np.sin(2 * TIME), np.array([1, 2, 2]) / 3
    w = 0.6 * np.cos(2 * TIME)[:, None] * axis
    turn = np.column_stack([np.cos(angle / 2), np.sin(angle / 2)[:, None] * axis])
    turn[50:] *= -1
    p = np.tile(gough.load("gough-stewart").home.x[:3], (101, 1))
    titles = "time;x;y;z;qw;qx;qy;qz"
    path = written(tmp_path / "t.csv", titles, TIME, p, turn)
    path.write_text(path.read_text().replace(",", ";"))
    found = json.loads(run("gough-stewart", "--trajectory", path, "--json").stdout)
    rates = np.transpose([found["rates"][name] for name in ("drx", "dry", "drz")])
    np.testing.assert_allclose(rates, w, atol=1e-9)
    _power_is_the_change_of_energy(found, 1e-3)


def _power_is_the_change_of_energy(found, tolerance):
    power = np.sum([motor["powers"] for motor in found["motors"]], axis=0)
    energy = np.add(found["kinetic_energy"], found["potential_energy"])
    change = np.gradient(energy, found["time"])
    size = np.abs(power).max()
    np.testing.assert_allclose(change[2:-2], power[2:-2], atol=tolerance * size)


def test_rotation_vectors_and_joint_space(tmp_path):
    """Rates of rx, ry are angular velocities, not derivatives; without outputs joints are given."""
    by = [0.02, 0.2, -0.1]
    path = written(tmp_path / "t.csv", "time,z,rx,ry", TIME, moved("3-rps", by)[0])
    _power_is_the_change_of_energy(
        json.loads(run("3-rps", "--trajectory", path, "--json").stdout), 1e-3
    )
    robot = gough.load("andrews-squeezer")
    beta = robot.home.q[robot.position_names.index("beta")]
    path = written(tmp_path / "t.csv", "time,beta [deg]", TIME, np.rad2deg(beta + 0.3 * S))
    found = json.loads(run("andrews-squeezer", "--trajectory", path, "--json").stdout)
    assert found["space"] == "joint"
    _power_is_the_change_of_energy(found, 1e-2)


def test_rest_at_home():
    found = json.loads(run("five-bar", "--json").stdout)
    robot, still = gough.load("five-bar"), np.zeros(2)
    held = robot.inverse_dynamics(robot.home.x, still, still)
    np.testing.assert_allclose([motor["efforts"][0] for motor in found["motors"]], held)
    moon = json.loads(run("five-bar", "--gravity", "0 -1.62 0", "--json").stdout)
    expected = robot.inverse_dynamics(robot.home.x, still, still, gravity=[0, -1.62, 0])
    np.testing.assert_allclose([motor["efforts"][0] for motor in moon["motors"]], expected)
    text = run("biped-leg").stdout
    assert text.startswith("biped-leg at rest at home\n")
    assert "forces that the motors can not give (N and N m): torso.z 128.5" in text


def test_the_file_that_is_written(tmp_path):
    x, _, _ = moved("five-bar", [0.02, -0.03])
    path = written(tmp_path / "t.csv", "time,x,y", TIME, x)
    run("five-bar", "--trajectory", path, "--out", tmp_path / "new" / "out.csv")
    with (tmp_path / "new" / "out.csv").open() as file:
        titles, *rows = csv.reader(file)
    assert titles[:3] == ["time [s]", "x [m]", "y [m]"]
    assert "effort leg1.motor [N m]" in titles
    assert titles[-1] == "ending"
    found = json.loads(run("five-bar", "--trajectory", path, "--json").stdout)
    column = [float(row[titles.index("power leg2.motor [W]")]) for row in rows]
    assert column == found["motors"][1]["powers"]
    assert {len(row) for row in rows} == {len(titles)}


def test_rows_without_an_answer_are_named(tmp_path):
    x, xd, xdd = moved("five-bar", [0.3, 0.9])
    titles = "time,x,y,dx,dy,ddx,ddy"
    path = written(tmp_path / "t.csv", titles, TIME, x, xd, xdd)
    text = run("five-bar", "--trajectory", path, code=1).stdout
    out = tmp_path / "out.csv"
    found = json.loads(run("five-bar", "--trajectory", path, "--out", out, "--json", code=1).stdout)
    first = found["failures"][0]
    row, failed = first["row"], len(found["failures"])
    assert not found["solved"]
    assert first["line"] == row + 2
    assert first["ending"] == "out_of_reach"
    assert f"{failed} of 101 rows have no answer" in text
    assert f"{TIME[row]:.6g} s (line {row + 2}): {first['reason']}" in text
    assert "too short" in first["reason"]
    assert f"… and {failed - 10} more" in text
    assert found["motors"][0]["efforts"][row] is None
    assert found["motors"][0]["efforts"][row - 1] is not None
    lines = out.read_text().splitlines()
    assert lines[row + 1].endswith(",out_of_reach")
    assert ",,,," in lines[row + 1]
    assert lines[row].endswith(",solved")


def test_saturation(tmp_path):
    text = catalogue.file("five-bar").read_bytes().decode()
    limited = text.replace(
        "actuated: true", "actuated: true\n        motor: {effort: 0.5, speed: 0.1}"
    )
    robot = tmp_path / "limited.yaml"
    robot.write_text(limited)
    x, _, _ = moved("five-bar", [0.05, -0.08])
    path = written(tmp_path / "t.csv", "time,x,y", TIME, x)
    found = json.loads(run(robot, "--trajectory", path, "--json").stdout)
    motor = found["motors"][0]
    beyond = [k for k, effort in enumerate(motor["efforts"]) if abs(effort) > 0.5]
    assert motor["effort_limit"] == 0.5
    assert motor["effort_saturated_rows"] == beyond
    text = run(robot, "--trajectory", path).stdout
    assert "rate beyond its limit of 0.1 rad/s in" in text


WRONG = [
    ("", "t.csv: the file is empty"),
    ("time,x,y,z\n", "t.csv:1:1: there are no rows below the header"),
    ("time,x,y,zz\n0,0,0,0\n", "t.csv:1:10: there is no column 'zz'. Did you mean"),
    ("time,x,y\n0,0,0\n", "t.csv:1:1: columns are missing: z; expected x, y, z; rates dx, dy, dz"),
    ("x,y,z\n0,0,0\n", "t.csv:1:1: column time is missing, and so is dx"),
    ("time,x,y,z,dx\n0,0,0,0,0\n", "columns are missing: dy, dz"),
    ("time,x,x,z\n0,0,0,0\n", "t.csv:1:8: column 'x' occurs twice"),
    ("time,x [inch],y,z\n0,0,0,0\n", "t.csv:1:6: x has the unit 'inch', expected one of m, mm"),
    ("time,x [m,y,z\n0,0,0,0\n", "t.csv:1:6: 'x [m' is no title of a column"),
    ("time,x,y,z\n0,0,0.6\n", "t.csv:2:1: has 3 cells, expected 4, as the header"),
    ("# a\n\ntime,x,y,z\n0,0,b,0\n", "t.csv:4:5: y: 'b' is no finite number"),
    ("time,x,y,z\n0,0,nan,0\n1,2,,3\n", "t.csv:2:5: y: 'nan' is no finite number"),
    ("time,x,y,z\n0,0,nan,0\n1,2,,3\n", "t.csv:3:5: y: is empty"),
    ("time,x,y,z\n0,0,0,0\n1,0,0,0\n1,0,0,0\n2,0,0,0\n", "t.csv:4:1: time: 1 s does not come"),
    ("time,x,y,z\n0,0,0,0\n1,0,0,0\n", "2 rows are too few for derivatives: give at least 4, or"),
]


@pytest.mark.parametrize(("text", "message"), WRONG)
def test_a_wrong_file_is_an_error_with_its_place(tmp_path, text, message):
    path = tmp_path / "t.csv"
    path.write_text(text)
    assert message in run("delta", "--trajectory", path, code=2).stderr


def test_wrong_input(tmp_path):
    missing = tmp_path / "no.csv"
    assert "can not be read: No such file" in run("2rpr", "--trajectory", missing, code=2).stderr
    path = tmp_path / "t.csv"
    path.write_bytes(b"time,x\n\xff,1\n")
    assert "t.csv:2:1: is no text in UTF-8" in run("2rpr", "--trajectory", path, code=2).stderr
    assert "gravity has shape (2,)" in run("2rpr", "--gravity", "0 1", code=2).stderr
    path.write_text("time,hip,knee\n0,1,1\n")
    message = "torso.x has no position of its own that a column could hold"
    assert message in run("biped-leg", "--trajectory", path, code=2).stderr
    path.write_text(
        "time,x,y,z,qw,qx,qy,qz\n0,0,0,1,1,0,0,0\n1,0,0,1,1,1,0,0\n2,0,0,1,1,0,0,0\n3,0,0,1,1,0,0,0\n"
    )
    found = run("gough-stewart", "--trajectory", path, code=2).stderr
    assert "t.csv:3:1: qw: the quaternion has the length 1.41421; it must be 1" in found
    x, _, _ = moved("2rpr", [0.01, 0.01])
    written(path, "time,x,y", TIME, x)
    blocked = tmp_path / "t.csv" / "out.csv"
    found = run("2rpr", "--trajectory", path, "--out", blocked, code=2).stderr
    assert "can not be written" in found
