"""``gough simulate``."""

import json
import os
import subprocess
import sys

import numpy as np
import pytest
import xarray
from click.testing import CliRunner

import gough
from gough.cli import main
from gough.cli.simulate_request import inputs_of
from gough.ensembles import Interrupted
from gough.robot import Robot
from gough.simulation.events import When
from gough.simulation.summary import RunSummary, summary, units_of


def run(*args, code=0):
    result = CliRunner().invoke(main, ["simulate", *map(str, args)])
    assert result.exit_code == code, result.output
    return result


def numbers_of(line):
    return [float(word) for word in line.split()]


def table_of(text):
    """Rows of the table of outputs by time."""
    lines = text.splitlines()
    start = next(k for k, line in enumerate(lines) if line.lstrip().startswith("t [s]"))
    stop = next(k for k in range(start, len(lines)) if not lines[k].strip())
    rows = [numbers_of(line) for line in lines[start + 1 : stop]]
    return {row[0]: row[1:] for row in rows}


def written_motion(path, x, by, duration, count=51):
    """A quintic motion from outputs x."""
    u = np.linspace(0, 1, count)
    s = 10 * u**3 - 15 * u**4 + 6 * u**5
    lines = [",".join(["time", *"xyz"[: len(x)]])]
    rows = np.column_stack([duration * u, np.asarray(x) + s[:, None] * np.asarray(by)])
    path.write_text("\n".join([*lines, *(",".join(map(repr, row)) for row in rows.tolist())]))
    return path


# one run


def test_the_deployment_of_the_reference():
    """Section 9 of the reference: heights, energy delivered, rest in the stops."""
    text = run("deployable-hexapod").stdout
    assert text.startswith("deployable-hexapod over 1 s: finished\n")
    rows = table_of(text)
    heights = [f"{rows[t][2]:.4f}" for t in (0, 0.2, 0.4, 0.45, 0.5)]
    assert heights == ["0.2200", "0.3961", "0.8732", "0.8837", "0.8857"]
    delivered = next(line for line in text.splitlines() if line.lstrip().startswith("delivered"))
    assert delivered.split()[2] == "18.911"
    assert "leg1.slide.stop.contact_upper" in text
    assert "balance open by at most" in text
    assert " steps and " in text


def test_the_squeezer_of_the_test_set():
    """beta and Theta at the end, from the Test Set for IVP Solvers."""
    found = json.loads(
        run(
            "andrews-squeezer", "--variant", "spring", "--input", "beta=0.033",
            "--duration", "0.03", "--times", "2", "--json",
        ).stdout
    )  # fmt: skip
    assert found["outputs"]["beta"][-1] == pytest.approx(15.81077119, abs=1e-6)
    assert found["units"] == {"beta": "rad"}


def test_json_has_the_numbers_of_the_dataset():
    found = json.loads(run("four-bar", "--duration", "0.2", "--times", "5", "--json").stdout)
    expected = gough.load("four-bar").simulate(0.2, times=5)
    assert list(found) == [
        "name", "kind", "ending", "reason", "duration", "end", "method", "rtol", "atol", "time",
        "units", "outputs", "rates", "energies", "balance_error", "events", "counts",
        "formulations", "files",
    ]  # fmt: skip
    assert found["kind"] == "run"
    assert found["ending"] == "finished"
    assert found["time"] == expected["time"].values.tolist()
    assert found["outputs"]["D"] == expected["x"].values[:, 0].tolist()
    assert found["rates"]["D"] == expected["xd"].values[:, 0].tolist()
    for kind, values in found["energies"].items():
        assert values == expected[f"energy_{kind}"].values.tolist()
    assert found["counts"]["steps"] == expected.attrs["steps"]


def test_starts_gravity_and_accuracy_reach_the_run():
    args = ["five-bar", "--x0", "0.1 0.5", "--v0", "0.2 0", "--gravity", "0 -1.62 0"]
    args += ["--duration", "0.1", "--rtol", "1e-6", "--atol", "1e-9", "--times", "3"]
    robot = gough.load("five-bar")
    args[2] = " ".join(map(repr, robot.home.x.tolist()))
    found = json.loads(run(*args, "--json").stdout)
    expected = robot.simulate(
        0.1, robot.home.x, [0.2, 0], gravity=[0, -1.62, 0], rtol=1e-6, atol=1e-9, times=3
    )
    moved = np.transpose(list(found["outputs"].values()))
    np.testing.assert_array_equal(moved, expected["x"].values)
    assert (found["rtol"], found["atol"]) == (1e-6, 1e-9)
    q = " ".join(map(repr, robot.home.q.tolist()))
    again = json.loads(run("five-bar", "--q0", q, "--duration", "0.1", "--json").stdout)
    assert again["outputs"]["x"][0] == pytest.approx(robot.home.x[0], abs=1e-12)


def test_inputs_are_numbers_or_tables(tmp_path):
    path = tmp_path / "push.csv"
    path.write_text("time [ms], value\n0, 1\n100, 3\n")
    assert inputs_of(["a=2*pi", f"b={path}"]) == {"a": 2 * np.pi, "b": ([0.0, 0.1], [1.0, 3.0])}
    args = ["four-bar", "--duration", "0.1", "--times", "3", "--out", tmp_path / "run.nc"]
    run(*args, "--input", f"A={path}")
    with xarray.open_dataset(tmp_path / "run.nc") as found:
        assert found["actuator"].values.tolist() == ["A.effort"]
        np.testing.assert_allclose(found["actuator_force"].values[:, 0], [1, 2, 3])


@pytest.mark.parametrize(
    "options",
    [
        [],
        ["--frequency", "30", "--damping-ratio", "0.7"],
        ["--stiffness", "400 500 600", "--damping", "40"],
        ["--controller", "pd-gravity", "--stiffness", "1e4", "--damping", "200"],
        ["--controller", "joint-pd", "--stiffness", "200", "--damping", "20"],
    ],
)
def test_a_controller_holds(options):
    """At rest where it starts, away from home."""
    x0 = np.add(gough.load("delta").home.x, [0.02, -0.01, 0.03])
    given = ["delta", "--x0", " ".join(map(repr, x0.tolist())), "--hold", "--duration", "0.2"]
    found = json.loads(run(*given, *options, "--json").stdout)
    moved = np.transpose(list(found["outputs"].values()))
    np.testing.assert_allclose(moved, np.tile(x0, (len(moved), 1)), atol=1e-6)


@pytest.mark.parametrize(
    ("options", "near"),
    [
        ([], 1e-6),
        (["--controller", "pd-gravity", "--stiffness", "1e5", "--damping", "1e3"], 1e-2),
        (["--controller", "joint-pd", "--stiffness", "1e4", "--damping", "1e2"], 1e-2),
    ],
)
def test_a_controller_follows_a_file_from_its_first_row(options, near, tmp_path):
    """Time and start are those of the file."""
    x = np.add(gough.load("delta").home.x, [0.02, -0.01, 0.03])
    path = written_motion(tmp_path / "way.csv", x, [0.05, 0.02, -0.05], 0.5)
    found = json.loads(run("delta", "--trajectory", path, *options, "--json").stdout)
    moved = np.transpose(list(found["outputs"].values()))
    assert found["end"] == 0.5
    np.testing.assert_allclose(moved[0], x, atol=1e-12)
    np.testing.assert_allclose(moved[-1], np.add(x, [0.05, 0.02, -0.05]), atol=near)


def test_a_mechanism_without_outputs_follows_its_motor(tmp_path):
    beta = -0.0617138900142764
    path = written_motion(tmp_path / "way.csv", [beta], [0.3], 0.2)
    path.write_text(path.read_text().replace("time,x", "time,beta"))
    text = json.loads(run("andrews-squeezer", "--trajectory", path, "--json").stdout)
    assert text["outputs"]["beta"][-1] == pytest.approx(beta + 0.3, abs=1e-6)


def test_events_are_noted_and_stop(tmp_path):
    text = run("four-bar", "--event", "mid=D-2", "--stop-at", "down=D - 2.4").stdout
    assert text.startswith("four-bar: stopped by down at 0.28899")
    assert "is not among the times that were seen" in text
    found = json.loads(run("four-bar", "--stop-at", "down=D-2.4", "--json").stdout)
    assert found["ending"] == "stopped"
    assert found["events"][-1]["name"] == "down"
    assert found["events"][-1]["time"] == pytest.approx(found["end"], abs=1e-9)


def test_a_run_that_does_not_reach_its_end(monkeypatch, tmp_path):
    """Told, kept, and exit code 1."""

    def short(self, duration, **options):
        return real(self, duration, **options, max_steps=20)

    real = Robot.simulate
    monkeypatch.setattr(Robot, "simulate", short)
    result = run("four-bar", "--out", tmp_path / "run.nc", code=1)
    assert result.stdout.startswith("four-bar: step_limit at 0.")
    assert "took the largest number of steps" in result.stdout
    assert (tmp_path / "run.nc").exists()


def test_quiet_prints_nothing(tmp_path):
    result = run("four-bar", "--duration", "0.1", "--quiet", "--out", tmp_path / "run.csv")
    assert not result.output
    assert (tmp_path / "run.csv").read_text().startswith("time [s],x D [rad],xd D [rad/s]")


# pictures


def test_pictures_of_a_run(tmp_path):
    found = json.loads(
        run("deployable-hexapod", "--duration", "0.5", "--plot", tmp_path / "p", "--json").stdout
    )
    names = ["motion.png", "energy.png", "loops.png"]
    assert found["files"] == [str(tmp_path / "p" / name) for name in names]
    assert all((tmp_path / "p" / name).read_bytes()[:4] == b"\x89PNG" for name in names)
    run("four-bar", "--hold", "--event", "a=t-0.05", "--duration", "0.1",
        "--plot", tmp_path / "one.svg")  # fmt: skip
    assert (tmp_path / "one.svg").read_text().startswith("<?xml")


def test_pictures_of_an_ensemble(tmp_path):
    run("five-bar", "--samples", "20", "--vary", "x0.x=±0.01", "--duration", "0.1",
        "--plot", tmp_path)  # fmt: skip
    assert {"scatter.png", "spread-x.png"} <= {p.name for p in tmp_path.iterdir()}


# ensembles


def test_an_ensemble_in_words_and_as_data(tmp_path):
    given = ["deployable-hexapod", "--samples", "24", "--vary", "all=±2%", "--vary",
             "mass=normal(3 %)", "--duration", "0.45", "--rtol", "1e-6",
             "--event", "half=platform.z-0.5", "--store", tmp_path / "store"]  # fmt: skip
    text = run(*given).stdout
    assert text.startswith("deployable-hexapod: 24 runs: 24 finished\n")
    assert "half" in text
    assert "rows/s" in text
    assert f"kept in {tmp_path / 'store'}" in text
    again = run(*given)
    assert "rows/s" not in again.stdout  # nothing was made
    found = json.loads(run(*given, "--json").stdout)
    assert found["kind"] == "ensemble"
    assert found["rows"] == 24
    assert found["endings"] == {"finished": 24}
    assert {"mass", "scale[2]", "deploying[0]"} <= set(found["factors"])
    assert found["store"] == str(tmp_path / "store")
    heights = next(output for output in found["outputs"] if output["name"] == "z")
    with xarray.open_zarr(tmp_path / "store", consolidated=False, mask_and_scale=False) as rows:
        expected = np.quantile(rows["pose"].values[:, 2], [0.05, 0.5, 0.95])
    np.testing.assert_allclose(heights["quantiles"], expected)
    other = run(*given[:-1], tmp_path / "store", "--seed", "1", code=2)
    assert "holds the store of another run" in other.stderr


def test_a_saltelli_design_is_told_without_its_repetitions():
    given = ["five-bar", "--samples", "8", "--vary", "x0.x=±0.01", "--vary", "x0.y=±0.01",
             "--design", "saltelli", "--duration", "0.05", "--json"]  # fmt: skip
    found = json.loads(run(*given).stdout)
    assert found["rows"] == 32
    assert {output["runs"] for output in found["outputs"]} == {16}


def test_an_ensemble_whose_runs_all_fail():
    result = run("five-bar", "--samples", "4", "--vary", "x0.x=uniform(8, 9)",
                 "--duration", "0.1", code=1)  # fmt: skip
    first, second, *_ = result.stdout.splitlines()
    assert first.startswith("five-bar: 4 runs: 4 not_")
    assert second.startswith("  not_")  # why
    assert "output at the end" not in result.stdout


def test_an_interrupted_ensemble_says_how_to_go_on(monkeypatch):
    def interrupted(self, *args, **options):
        raise Interrupted("interrupted: 3 of 9 chunks are kept in here; run the same again")

    monkeypatch.setattr(Robot, "simulate", interrupted)
    given = ["five-bar", "--samples", "4", "--vary", "x0.x=±0.01"]
    result = run(*given, code=130)
    assert result.stderr == "interrupted: 3 of 9 chunks are kept in here; run the same again\n"
    found = json.loads(run(*given, "--json", code=130).stdout)
    assert found["error"].startswith("interrupted: 3 of 9")


INTERRUPTING = """
import os, signal, threading
from gough.cli import main
from gough.simulation.run import Runner

def advance(self, *arguments):
    threading.Timer(1.0, os.kill, (os.getpid(), signal.SIGINT)).start()
    return real(self, *arguments)

real, Runner.advance = Runner.advance, advance
main(["simulate", "four-bar", "--duration", "1e7"])
"""


@pytest.mark.skipif(os.name != "posix", reason="signals")
def test_a_long_run_can_be_interrupted():
    """Compiled loops see no signals; the command does."""
    run("four-bar", "--duration", "0.01", "--quiet")  # machine code is on the disk
    ended = subprocess.run(
        [sys.executable, "-c", INTERRUPTING], capture_output=True, text=True, timeout=60
    )
    assert ended.returncode == 130, ended.stderr
    assert ended.stderr == "Interrupted.\n"


# what is wrong


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--duration", "0"], "duration is 0.0, expected a positive number"),
        (["--duration", "-1"], "duration is -1.0"),
        (["--duration", "nan"], "duration is nan"),
        (["--duration", "inf"], "duration is infinite"),
        (["--x0", "0 0"], "x has shape (2,)"),
        (["--x0", "0 0 nan"], "'nan' is no number"),
        (["--x0", "0 0 -0.7", "--q0", "1 2"], "give x0 or q0, and not both"),
        (["--v0", "1"], "v0 has shape (1,)"),
        (["--input", "leg1=3"], "no joint or law that takes a command is named 'leg1'"),
        (["--input", "leg1.motor"], "expected JOINT=VALUE"),
        (["--input", "leg1.motor=x"], "'x' is neither a number nor a file"),
        (["--input", "leg1.motor=nan"], "'nan' is neither a number nor a file"),
        (["--input", "leg1.motor=none.csv"], "none.csv: can not be read"),
        (["--input", "leg1.motor=1", "--input", "leg1.motor=2"], "leg1.motor occurs twice"),
        (["--event", "half"], "expected NAME=EXPRESSION"),
        (["--event", "a=t-1", "--stop-at", "a=t-2"], "a is the name of an --event"),
        (["--hold", "--trajectory", "way.csv"], "give --hold or --trajectory, and not both"),
        (["--trajectory", "none.csv"], "none.csv: can not be read"),
        (["--frequency", "3"], "--frequency: a controller follows something"),
        (["--hold", "--controller", "pid"], "no controller is named 'pid'"),
        (["--hold", "--controller", "pd-gravity"], "pd-gravity takes --stiffness and --damping"),
        (
            ["--hold", "--controller", "joint-pd", "--frequency", "3"],
            "--frequency can be given for computed-torque",
        ),
        (
            ["--hold", "--stiffness", "3", "--damping", "1", "--damping-ratio", "1"],
            "--frequency and --damping-ratio, or --stiffness and --damping",
        ),
        (["--hold", "--frequency", "-3"], "frequency is -3.0; it must be finite"),
        (["--gravity", "1 2"], "gravity has shape (2,), expected (3,)"),
        (["--method", "rk4"], "no method is named 'rk4'"),
        (["--rtol", "0"], "rtol is 0.0"),
        (["--times", "1"], "1 is not in the range"),
        (["--out", "run.txt"], "results are saved as .nc (NetCDF), .zarr or .csv"),
        (["--plot", "run.pdf"], "pictures are .png or .svg"),
        (["--samples", "3"], "nothing varies; give --vary"),
        (["--vary", "x=±1%"], "--vary: for ensembles alone; --samples N"),
        (["--store", "s", "--seed", "1"], "--seed and --store: for ensembles alone"),
        (["--samples", "3", "--vary", "x"], "expected NAME=DISTRIBUTION"),
        (["--samples", "3", "--vary", "mas=±1%"], "no parameter is named 'mas'"),
        (["--samples", "3", "--vary", "all=huge"], "'huge' is no distribution"),
        (["--samples", "3", "--vary", "x0.z=±0.01", "--design", "grid"], "no design is named"),
    ],
)
def test_wrong_input(options, message, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    result = run("delta", *options, code=2)
    assert message in result.stderr
    assert not result.stdout
    assert not list(tmp_path.iterdir())


def test_wrong_files_tell_every_place(tmp_path):
    path = tmp_path / "push.csv"
    path.write_text("time,val\n0,1\n")
    assert (
        f"{path}:1:6: there is no column 'val'"
        in run("delta", "--input", f"leg1.motor={path}", code=2).stderr
    )
    path.write_text("time\n0\n1\n")
    wrong = run("delta", "--input", f"leg1.motor={path}", code=2)
    assert "there is no column 'value'; expected time and value" in wrong.stderr
    path.write_text("time,value\n0,1\n1,nan\n")
    wrong = run("delta", "--input", f"leg1.motor={path}", code=2)
    assert "'nan' is no finite number" in wrong.stderr


def test_out_of_reach_is_no_wrong_input():
    result = run("delta", "--x0", "0 0 5", "--json", code=1)
    assert "too short" in json.loads(result.stdout)["error"]


# summaries


def test_a_summary_of_few_times_and_many_columns():
    """Rows at equal steps and the last; what has no position is not shown."""
    robot = gough.load("biped-leg")
    found = RunSummary(robot.simulate(0.1, times=50), units_of(robot.dynamics))
    rows = list(table_of(str(found)))
    assert len(rows) <= 21
    assert rows[-1] == 0.1
    steps = np.diff(rows[:-1])
    np.testing.assert_allclose(steps, steps[0], rtol=1e-3)
    assert "torso.z [m]" in str(found)
    assert "hip [rad]" in str(found)


def test_small_changes_are_seen():
    """Digits follow what changes, and rounding errors are 0."""
    robot = gough.load("gough-stewart")
    text = str(summary(robot.simulate(1e-3, times=3), units_of(robot.dynamics)))
    heights = [row[2] for row in table_of(text).values()]
    assert len(set(heights)) == 3
    still = gough.load("3-rps")
    text = str(summary(still.simulate(0.1, times=3), units_of(still.dynamics)))
    assert all(row[1:] == [0.0, 0.0] for row in table_of(text).values())


def test_a_summary_without_units_knows_those_that_are_clear():
    robot = gough.load("deployable-hexapod")
    found = robot.simulate(0.1, times=3, events={"e": When("platform.z - 0.25")})
    assert "x [m]" in str(summary(found))
    assert summary(found).as_dict()["units"]["qw"] == "1"
