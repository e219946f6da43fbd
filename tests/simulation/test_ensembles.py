import logging
import os
import pickle
import signal
import subprocess
import sys
import time
import tracemalloc
from pathlib import Path

import casadi
import numpy as np
import psutil
import pytest
from hypothesis import settings

import gough
from gough.ensembles import DiskFull, OtherRun, StoreError, TaskFailed
from gough.errors import ConfigurationError, GoughError, SingularError, UnknownName
from gough.numerics.integration import integrate
from gough.simulation import ensemble as room
from gough.simulation.controllers import Custom, Sampled
from gough.simulation.many import Many, ensemble_of
from gough.simulation.origin import plain
from gough.simulation.simulate import Request
from gough.uncertainty import DistributionError, sobol_indices
from tests.ensembles.conftest import small_disk  # noqa: F401
from tests.ensembles.tasks import marks
from tests.ensembles.test_cluster import small_cluster  # noqa: F401
from tests.simulation.ensembles import HEXAPOD, equal, killable, robot_of

ROOT = Path(__file__).parents[2]
LONG = settings.get_current_profile_name() == "long"
COMPARED = (0, 1) if LONG else (1,)
"""Rows beside single runs; the machine code of each robot is made anew."""
SHORT = {"rtol": 1e-6, "progress": False}
ENDINGS = {word: k for k, word in enumerate(room.WORDS)}
KINDS = ("kinetic", "potential", "stored", "delivered", "dissipated")


@pytest.fixture(scope="module")
def hexapod():
    return gough.load(HEXAPOD)


def runs(robot, samples=9, duration=0.1, vary="±10 %", **more):
    return robot.simulate(duration, samples=samples, vary=vary, **{**SHORT, **more})


def compared(ensemble, row, single, within):
    """A row beside a single run."""
    x, xd = ("pose", "twist") if "pose" in ensemble else ("x", "xd")
    assert str(single.ending.values) == room.WORDS[int(ensemble.ending[row])]
    at_end = single.isel(time=-1)
    for name, other in ((x, x), (xd, xd)):
        size = max(1.0, float(np.abs(single[other].values).max()))
        difference = np.abs(ensemble[name].values[row] - at_end[other].values).max()
        assert difference < within * size, name
    energies = [float(at_end[f"energy_{kind}"]) for kind in KINDS]
    np.testing.assert_allclose(ensemble.energy[row], energies, rtol=0, atol=within * 100)


# rows and single runs


VARIED = {
    HEXAPOD: {"mass": "±10 %", "R": "normal(3 %)", "scale[2]": "uniform(0.9, 1.1)",
              "delta_A": "±5 %", "stroke": "±10 %", "z": "±5 %"},
    "delta": {"arm": "±2 %", "bar": "±2 %"},
    "3-rps": {"R": "±2 %", "z": "±2 %"},
    "four-bar": {"b": "±2 %"},
    "slider-crank": {"l": "±2 %"},
}  # fmt: skip
if LONG:
    VARIED |= {
        "gough-stewart": {"R": "±2 %", "z": "±2 %"},
        "hexa": {"arm": "±2 %", "bar": "±2 %"},
        "par4": {"arm": "±2 %", "bar": "±2 %"},
        "hexaglide": {"bar": "±2 %"},
        "orthoglide": {"r2": "±1 %", "a": "±1 %"},
        "tricept": {"R": "±2 %"},
    }


@pytest.mark.parametrize("name", VARIED)
def test_rows_are_single_runs_of_robots_with_these_parameters(name):
    # four-bar and slider-crank pass where their outputs are no coordinates
    data = runs(gough.load(name), 2, 0.3, VARIED[name], rtol=1e-9)
    assert data.factor_name.values.tolist() == list(VARIED[name])
    assert np.all(np.ptp(data.factor.values, axis=0) > 0)
    for row in COMPARED:
        robot = robot_of(name, VARIED[name], data.factor.values[row])
        compared(data, row, robot.simulate(0.3, rtol=1e-9), 1e-7)


def test_rows_with_other_coordinates_on_their_way_have_samples_and_events():
    robot, times = gough.load("four-bar"), [0.0, 0.1, 0.2, 0.3]
    asked = {"times": times, "rtol": 1e-9, "events": {"back": "d_D", "turn": "D - 0.4"}}
    data = runs(robot, 2, 0.3, {"b": "±2 %"}, **asked)
    again = runs(robot, 2, 0.3, {"b": "±2 %"}, **asked, workers=1)
    assert equal(data, again)
    for row in COMPARED:
        one = robot_of("four-bar", ["b"], data.factor.values[row]).simulate(0.3, **asked_one(asked))
        np.testing.assert_allclose(data.x_over_time[row], one.x, atol=1e-8)
        for event in asked["events"]:
            expected = first_of(one, event)
            assert data.first.sel(event=event)[row] == pytest.approx(
                expected, abs=1e-7, nan_ok=True
            )


def asked_one(asked):
    return {key: value for key, value in asked.items() if key != "progress"}


def first_of(single, event):
    found = single.event_time.values[single.event.values == event]
    return found.min() if len(found) else np.nan


def test_events_happen_first_when_they_do_in_single_runs(hexapod):
    asked = {"events": {"high": "platform.z - 0.5", "never": "platform.z - 50"}, "locate": True}
    vary = {"mass": "±10 %", "stroke": "±10 %"}
    data = runs(hexapod, 2, 1.0, vary, rtol=1e-8, **asked)
    assert np.isnan(data.first.sel(event="never")).all()
    for row in COMPARED:
        robot = robot_of(HEXAPOD, vary, data.factor.values[row])
        single = robot.simulate(1.0, rtol=1e-8, **asked)
        for event in data.event.values.tolist():
            found = float(data.first.sel(event=event)[row])
            assert found == pytest.approx(first_of(single, event), abs=1e-6, nan_ok=True)


def test_the_first_of_many_events_is_found(hexapod, monkeypatch):
    whole = runs(hexapod, 5, 1.0, locate=True)
    monkeypatch.setattr(room, "NOTED", 2)
    rooms = []

    def seen(*arguments, **named):
        rooms.append(named["room"])
        return integrate(*arguments, **named)

    monkeypatch.setattr(room, "integrate", seen)
    assert equal(runs(hexapod, 5, 1.0, locate=True), whole)
    assert max(rooms) == int(whole.counts.sel(count="events").max()) > 2


# starts and inputs


def test_starts_vary(hexapod):
    vary = {"x0.z": "±5 %", "x0.rx": "±0.1", "x0.ry": "±0.1", "v0.x": "±0.05", "v0.rz": "±0.1"}
    data = runs(hexapod, 3, 0.2, vary, rtol=1e-9)
    for row in COMPARED:
        z, rx, ry, vx, wz = data.factor.values[row]
        size = np.hypot(rx, ry)
        axis = np.array([rx, ry, 0]) / size
        pose = [0, 0, z, np.cos(size / 2), *np.sin(size / 2) * axis]
        single = hexapod.simulate(0.2, pose, [vx, 0, 0, 0, 0, wz], rtol=1e-9)
        compared(data, row, single, 1e-8)


@pytest.mark.parametrize("name", ["delta", "par4"] if LONG else ["delta", "3-rps"])
def test_starts_and_parameters_vary_together(name):
    robot = gough.load(name)
    names = list(VARIED.get(name, {"arm": "±2 %"}))
    vary = {names[0]: "±2 %", "x0.z": "±0.01", "v0.z": "±0.1"}
    data = runs(robot, 2, 0.1, vary, rtol=1e-9)
    for row in COMPARED:
        p, z, vz = data.factor.values[row]
        own = robot_of(name, [names[0]], [p])
        x, v = own.home.x.copy(), np.zeros(len(robot.structure.columns("operational")))
        x[-1 if name == "delta" else 0], v[-1 if name == "delta" else 0] = z, vz
        compared(data, row, own.simulate(0.1, x, v, rtol=1e-9), 1e-7)


@pytest.mark.parametrize("name", ["gough-stewart", "par4"] if LONG else ["3-rps"])
def test_outputs_that_are_given_stay_where_parameters_vary(name):
    robot = gough.load(name)
    x0 = robot.home.x.copy()
    x0[0] += 0.01
    vary = {"arm": "±2 %"} if name == "par4" else {"R": "±2 %"}
    data = runs(robot, 2, 0.05, vary, x0=x0, rtol=1e-9, times=[0.0, 0.05])
    start = data["pose_over_time" if "pose" in data else "x_over_time"].values[:, 0]
    np.testing.assert_allclose(start, np.tile(x0, (2, 1)), atol=1e-12)
    for row in COMPARED:
        own = robot_of(name, vary, data.factor.values[row])
        compared(data, row, own.simulate(0.05, x0, rtol=1e-9), 1e-7)


def test_a_given_configuration_is_put_onto_the_loops_of_each_row():
    robot = gough.load("delta")
    q0 = robot.inverse_geometry(robot.home.x + np.array([0.02, 0, 0]))
    data = runs(robot, 2, 0.05, {"arm": "±0.1 %"}, q0=q0, times=[0.0, 0.05])
    assert np.all(np.abs(data.x_over_time[:, 0, 0] - robot.home.x[0] - 0.02) < 1e-3)


def test_rates_of_mechanisms_without_outputs_are_kept():
    robot = gough.load("andrews-squeezer")
    v0 = [3.0]
    data = runs(robot, 2, 0.003, {"rr": "±1 %"}, v0=v0, rtol=1e-9)
    for row in COMPARED:
        single = robot_of("andrews-squeezer", ["rr"], data.factor.values[row])
        end = single.simulate(0.003, v0=v0, rtol=1e-9).isel(time=-1)
        assert float(data.energy[row, 0]) == pytest.approx(float(end.energy_kinetic), rel=1e-6)
        assert data.energy[row, 0] > 0


def test_inputs_vary():
    robot = gough.load("gough-stewart")
    told = {"leg1.slide.effort": 500.0, "leg2.slide": 100.0}
    vary = {"inputs.leg1.slide": "±10 %", "inputs.leg3.slide": "±200", "R": "±1 %"}
    data = runs(robot, 3, 0.1, vary, inputs=told, rtol=1e-9)
    assert np.all(np.abs(data.factor.values[:, 0] - 500) <= 50)
    for row in COMPARED:
        first, third, R = data.factor.values[row]
        inputs = {"leg1.slide": first, "leg2.slide": 100.0, "leg3.slide": third}
        compared(
            data,
            row,
            gough.load("gough-stewart", R=R).simulate(0.1, inputs=inputs, rtol=1e-9),
            1e-7,
        )


def test_tables_and_controllers_act_in_ensembles():
    robot = gough.load("gough-stewart")
    table = ([0.0, 0.05, 0.1], [0.0, 800.0, 100.0])
    law = Custom(lambda scene: {"leg2.slide": 300 * casadi.cos(20 * scene.t)})
    for more in ({"inputs": {"leg1.slide": table}}, {"controller": law}):
        data = runs(robot, 2, 0.1, {"R": "±2 %"}, rtol=1e-9, **more)
        for row in COMPARED:
            own = gough.load("gough-stewart", R=float(data.factor[row, 0]))
            compared(data, row, own.simulate(0.1, rtol=1e-9, **more), 1e-7)


def test_an_early_end_has_the_energies_of_its_time():
    robot = gough.load("gough-stewart")
    asked = {"inputs": {"leg1.slide": ([0.0, 1.0], [0.0, 9e3])}, "rtol": 1e-9}
    asked["events"] = {"low": gough.When("platform.z - 1.08", stop=True)}
    data = runs(robot, 2, 1.0, {"R": "±2 %"}, **asked)
    assert np.all(data.ending == ENDINGS["stopped"])
    assert np.all(data.end < 1)
    assert np.abs(data.energy_balance_error).max() < 1e-5
    np.testing.assert_allclose(data.first.sel(event="low"), data.end, atol=1e-9)


@pytest.mark.parametrize(
    "form",
    ["±10 %", "+-0.3", "uniform(3, 4)", "normal(3.5, 0.1)", "normal(5 %)", {"uniform": "10 %"},
     "truncated-normal(sd=5 %, low=3, high=4)", "lognormal(3.5, 0.1)", "triangular(3, 3.5, 4)",
     "beta(2, 5, 3, 4)", {"normal": {"mean": 3.5, "sd": 0.1}}, {"uniform": [3, 4]},
     {"scipy": {"name": "weibull_min", "c": 1.5, "loc": 3, "scale": 1}},
     gough.uncertainty.Distribution.read("uniform(3, 4)")],
    ids=str,
)  # fmt: skip
def test_every_form_of_a_distribution_varies(hexapod, form):
    data = runs(hexapod, 7, 0.01, {"mass": form})
    masses = data.factor.values[:, 0]
    assert len(set(masses)) == 7
    assert np.all((masses > 2.5) & (masses < 12))
    expected = gough.uncertainty.Distribution.read(form, 3.5)
    design = gough.uncertainty.Design("latin-hypercube", 7, 1, 0)
    assert np.array_equal(masses, expected.of(design.rows()[:, 0]))


# rows that fail


def test_rows_that_do_not_close_are_named_and_nothing_else_is_lost():
    robot = gough.load("3-rrr")
    vary = {"l1": "uniform(0.01, 0.6)"}
    data = runs(robot, 12, 0.05, vary, measures={"m": lambda c: c["x"][:, 0]}, times=[0.0, 0.05])
    lost = data.ending.values == ENDINGS["not_closed"]
    assert 0 < lost.sum() < 12, data.ending.values
    assert np.isfinite(data.factor.values).all()
    for name in ("end", "x", "xd", "energy", "energy_balance_error", "m", "x_over_time"):
        values = data[name].values.reshape(12, -1)
        assert np.isnan(values[lost]).all(), name
        assert np.isfinite(values[data.ending.values == 0]).all(), name
    assert np.all(data.counts.values[lost] == 0)
    assert f"{lost.sum()} not_closed" in data.endings
    for row in np.flatnonzero(lost)[:2]:
        with pytest.raises(GoughError):
            robot_of("3-rrr", ["l1"], data.factor.values[row]).simulate(0.05)


def test_nothing_closes():
    data = runs(gough.load("3-rrr"), 3, 0.05, {"l1": "uniform(0.001, 0.002)"})
    assert np.all(data.ending == ENDINGS["not_closed"])
    assert data.endings == "3 not_closed"


def test_runs_that_fail_keep_their_row(hexapod):
    data = runs(hexapod, 9, 1.0, max_steps=215, measures={"m": lambda c: c["pose"][:, 2]})
    lost = data.ending.values == ENDINGS["step_limit"]
    assert 0 < lost.sum() < 9
    assert np.isnan(data.m.values[lost]).all()
    assert np.isfinite(data.m.values[~lost]).all()
    assert np.all((data.end.values[lost] > 0) & (data.end.values[lost] < 1))
    whole = runs(hexapod, 9, 1.0)
    assert np.array_equal(data.pose.values[~lost], whole.pose.values[~lost])
    assert f"{lost.sum()} step_limit" in data.endings


# bits


@pytest.mark.parametrize("samples", [1, 7, 8, 9, 65])
def test_no_bit_depends_on_chunks_threads_order_or_store(hexapod, samples, tmp_path, monkeypatch):
    asked = {"times": [0.0, 0.25], "measures": {"m": lambda c: c["pose"][:, 2]}, "locate": True}
    first = runs(hexapod, samples, 0.5, **asked, workers=1)
    assert equal(runs(hexapod, samples, 0.5, **asked, workers=2), first)
    store = tmp_path / "store"
    assert equal(runs(hexapod, samples, 0.5, **asked, workers=2, store=store), first)
    assert equal(runs(hexapod, samples, 0.5, **asked, store=store), first)  # found
    for largest, smallest in ((1, 1), (3, 3), (8, 8), (9, 9)):
        monkeypatch.setattr(room, "LARGEST", largest)
        monkeypatch.setattr(room, "SMALLEST", smallest)
        assert equal(runs(hexapod, samples, 0.5, **asked, workers=2), first)
    task = task_of(hexapod, samples, 0.5)
    order = [task(k, k + 1)["pose"][0] for k in reversed(range(samples))]
    assert np.array_equal(order[::-1], first.pose.values)


def task_of(robot, samples, duration, vary="±10 %", **more):
    request = Request(duration, rtol=1e-6, locate=True)
    return ensemble_of(robot.mechanism, None, {}, request, Many(samples, vary, **more))


@pytest.mark.parametrize("name", ["four-bar", "3-rps"])
def test_no_bit_depends_on_which_row_came_first(name):
    vary, forwards, backwards = VARIED[name], [], []
    for order, found in ((range(4), forwards), (reversed(range(4)), backwards)):
        room._SIMULATORS.clear()
        task = task_of(gough.load(name), 4, 0.3, vary)
        found += [(k, task(k, k + 1)["x"][0]) for k in order]
    for (_, a), (_, b) in zip(forwards, sorted(backwards, key=lambda pair: pair[0]), strict=True):
        assert np.array_equal(a, b)


def test_a_task_is_the_same_in_another_process(hexapod):
    task = task_of(hexapod, 9, 0.1)
    expected = task(0, 9)
    other = pickle.loads(pickle.dumps(task))
    assert "_prepared" not in vars(other)
    assert np.array_equal(other(0, 9)["pose"], expected["pose"])
    assert other.plan.digest == task.plan.digest


def test_a_cluster_gives_the_same_bits_with_a_killed_worker(hexapod, small_cluster):  # noqa: F811
    cluster = small_cluster(2)
    expected = runs(hexapod, 700, 0.5)
    victim = next(iter(cluster.workers.values())).pid
    seen = []

    def progress(done, total):
        seen.append(done)
        if len(seen) == 1:
            os.kill(victim, signal.SIGKILL)

    logging.getLogger("distributed").setLevel(logging.CRITICAL)
    found = runs(hexapod, 700, 0.5, scheduler=cluster.scheduler_address, progress=progress)
    assert equal(found, expected)
    assert seen[-1] == 700


# stores


def test_a_killed_process_goes_on_where_it_was(tmp_path):
    folder = tmp_path / "store"
    process = subprocess.Popen(
        [sys.executable, "-m", "tests.simulation.ensembles", str(folder)], cwd=ROOT,
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    try:
        end = time.monotonic() + 90
        while marks(folder) < 3:
            assert process.poll() is None, process.communicate()
            assert time.monotonic() < end
            time.sleep(0.01)
    finally:
        process.kill()
        process.communicate()
    before = marks(folder)
    assert 3 <= before < 16
    found = killable(folder)
    assert found.rows_done == 1600
    expected = killable(None, slow=False)
    assert np.array_equal(found.height.values, expected.pose.values[:, 2])
    assert equal(found.drop_vars("height"), expected)


def test_a_full_disk_is_told_and_gone_on_with(hexapod, small_disk):  # noqa: F811
    disk = small_disk("size=2m")
    ballast = disk / "ballast"
    ballast.write_bytes(bytes(1_500_000))
    with pytest.raises(DiskFull, match=r"make room, then go on. \d+ of 16 chunks are kept in"):
        runs(hexapod, 1600, 0.01, store=disk / "store")
    ballast.unlink()
    found = runs(hexapod, 1600, 0.01, store=disk / "store")
    assert equal(found, runs(hexapod, 1600, 0.01))


def test_a_folder_that_can_not_be_written_is_told(hexapod, small_disk, tmp_path):  # noqa: F811
    with pytest.raises(StoreError, match="there is no folder"):
        runs(hexapod, store=tmp_path / "not" / "there")
    (tmp_path / "file").write_text("")
    with pytest.raises(StoreError, match="is a file"):
        runs(hexapod, store=tmp_path / "file")
    disk = small_disk("size=2m")
    small_disk("ro", again=True)
    with pytest.raises(StoreError, match="Read-only"):
        runs(hexapod, store=disk / "store")


OTHERS = {
    "duration": ({"duration": 0.2}, r"origin.duration: 0.1 there, 0.2 here"),
    "rtol": ({"rtol": 1e-7}, r"origin.rtol: 1e-06 there, 1e-07 here"),
    "seed": ({"seed": 3}, r"origin.design.seed: 0 there, 3 here"),
    "samples": ({"samples": 10}, r"rows: 9 there, 10 here"),
    "vary": ({"vary": {"mass": "±5 %"}}, r"origin.vary.mass: \"±10 %\" there, \"±5 %\" here"),
    "times": ({"times": [0.0, 0.05]}, "time"),
    "measures": ({"measures": {"m": lambda c: c["end"] + 1}}, "origin.measures.m.code"),
    "start": ({"x0": [0, 0, 0.23, 1, 0, 0, 0]}, "origin.start"),
    "gravity": ({"gravity": [0, 0, -1]}, "origin.gravity"),
    "events": ({"events": {"high": "platform.z - 0.5"}}, "origin.events.high"),
}


@pytest.mark.parametrize("what", OTHERS)
def test_a_store_of_another_ensemble_is_refused_by_name(hexapod, tmp_path, what):
    base = {"vary": {"mass": "±10 %"}, "measures": {"m": lambda c: c["end"]}}
    runs(hexapod, store=tmp_path / "s", **base)
    changes, words = OTHERS[what]
    with pytest.raises(OtherRun, match=words):
        runs(hexapod, store=tmp_path / "s", **{**base, **changes})


@pytest.mark.parametrize("what", OTHERS)
def test_ensembles_do_not_take_what_others_left(hexapod, what):
    base = {"vary": {"mass": "±10 %"}, "measures": {"m": lambda c: c["end"]}}
    changed = {**base, **OTHERS[what][0]}
    runs(hexapod, **base)
    room._SIMULATORS.clear()
    expected = runs(hexapod, **changed)
    runs(hexapod, **base)
    assert equal(runs(hexapod, **changed), expected)


def test_what_decides_numbers_is_told_apart():
    long = np.linspace(0, 1, 5000)
    near = long + 1e-12
    assert plain(long) != plain(near)
    assert plain(long) == plain(long.copy())

    def scaled(k):
        return lambda c: k * c["end"]

    assert plain(scaled(1)) != plain(scaled(2))
    assert plain(scaled(2)) == plain(scaled(2))
    assert plain(Custom(scaled(1))) != plain(Custom(scaled(2)))
    holder = {}
    holder["self"] = holder
    assert plain(holder) == {"self": "…"}
    assert plain({"a": np.float64(np.inf), "b": (np.int8(3), True)}) == {"a": "inf", "b": [3, True]}


# measures, indices


def test_measures_are_columns(hexapod):
    def height(columns):
        assert columns["events"].tolist()
        assert columns["time"].tolist() == [0.0, 0.1]
        return (
            columns["pose"][:, 2] - columns["pose_over_time"][:, 0, 2] + 0 * columns["factor"][:, 0]
        )

    data = runs(
        hexapod, 9, 0.1, measures={"rise": height, "n": lambda c: c["counts"][:, 0]}, times=2
    )
    expected = data.pose.values[:, 2] - data.pose_over_time.values[:, 0, 2]
    assert np.array_equal(data.rise.values, expected)
    assert np.array_equal(data.n.values, data.counts.values[:, 0].astype(float))


def failing(columns):
    raise ValueError("no luck")


def changing(columns):
    columns["pose"][:] = 0


@pytest.mark.parametrize(
    ("measure", "words"),
    [
        (failing, r"chunk 0 \(rows 0 to 8\) failed: .*measure m failed: ValueError: no luck"),
        (lambda c: c["pose"], r"measure m gives float64 of shape \(9, 7\), expected \(9,\)"),
        (lambda c: c["pose"][:, 2].mean(), r"measure m gives float64 of shape \(\)"),
        (lambda c: c["nothing"], "measure m failed: KeyError"),
        (lambda c: ["a"] * 9, "measure m gives <U1"),
        (changing, "measure m failed: ValueError: assignment destination is read-only"),
    ],
)
def test_a_measure_that_fails_names_the_chunk(hexapod, measure, words):
    with pytest.raises(TaskFailed, match=words):
        runs(hexapod, measures={"m": measure})


def test_sobol_indices_of_an_ensemble(hexapod):
    vary = {"mass": "±10 %", "thickness": "±10 %"}
    data = runs(hexapod, 64, 0.3, vary, design="saltelli")
    assert data.sizes["row"] == 64 * 4
    found = sobol_indices(data.pose[:, 2].values, list(vary), ["z"])
    assert found.ranked("z") == ("mass", "thickness")
    assert found.first[0, 0] > 0.99
    assert abs(found.total[0, 1]) < 1e-3


@pytest.mark.parametrize("design", ["latin-hypercube", "sobol", "random"])
def test_designs(hexapod, design):
    data = runs(hexapod, 8, 0.01, {"mass": "uniform(3, 4)"}, design=design, seed=5)
    u = gough.uncertainty.Design(design, 8, 1, 5).rows()[:, 0]
    np.testing.assert_allclose(data.factor[:, 0], 3 + u, rtol=1e-15)


def test_nothing_varies(hexapod):
    data = runs(hexapod, 3, 0.1, None)
    assert "factor" not in data
    assert np.all(np.ptp(data.pose.values, axis=0) == 0)


# wrong arguments


@pytest.mark.parametrize(
    ("asked", "error", "words"),
    [
        ({"samples": 0}, ConfigurationError, "samples is 0"),
        ({"samples": -3}, ConfigurationError, "samples is -3"),
        ({"samples": 2.5}, ConfigurationError, "samples is 2.5"),
        ({"samples": True}, ConfigurationError, "samples is True"),
        ({"vary": {"masss": "±10 %"}}, UnknownName, "masss.*mass"),
        ({"vary": {"scale": "±10 %"}}, UnknownName, r"scale.*scale\[0\]"),
        ({"vary": {"scale[6]": "±10 %"}}, UnknownName, r"scale\[6\]"),
        ({"vary": {"scale[-1]": "±10 %"}}, ConfigurationError, "neither a parameter"),
        ({"vary": {"": "±10 %"}}, ConfigurationError, "neither a parameter"),
        ({"vary": {"x0.a": "±0.1"}}, UnknownName, "a'.*rx"),
        ({"vary": {"x0.qw": "±0.1"}}, UnknownName, "qw"),
        ({"vary": {"v0.a": "±0.1"}}, UnknownName, "rate of an output"),
        ({"vary": {"inputs.leg9": "±0.1"}}, UnknownName, "leg9"),
        ({"vary": {"mass": "±10"}}, None, ""),
        ({"vary": {"mass": "unifrom(1, 2)"}}, DistributionError, "factor mass: .*uniform"),
        ({"vary": {"mass": "10 %"}}, DistributionError, "factor mass"),
        ({"vary": {"x0.rx": "±10 %"}}, DistributionError, "factor x0.rx: .*which is nothing"),
        ({"vary": {"x0.z": "±1 %", "x0.platform.z": "±1 %"}}, GoughError, "platform.z"),
        ({"vary": ["mass"]}, ConfigurationError, "vary is"),
        ({"vary": {3: "±1 %"}}, ConfigurationError, "vary has the name 3"),
        ({"vary": "much"}, GoughError, "much"),
        ({"design": "halton"}, UnknownName, "halton.*sobol"),
        ({"design": "saltelli", "vary": None}, ConfigurationError, "nothing varies"),
        ({"seed": -1}, GoughError, "seed"),
        ({"seed": 1.5}, GoughError, "seed"),
        ({"workers": 0}, ConfigurationError, "workers is 0"),
        ({"workers": "two"}, ConfigurationError, "workers is 'two'"),
        ({"measures": {"m": 3}}, ConfigurationError, "measures"),
        ({"measures": {"pose": len}}, ConfigurationError, "'pose' has the name of a column"),
        ({"measures": {"a b": len}}, ConfigurationError, "can not name a column"),
        ({"duration": -1.0}, ConfigurationError, "duration"),
        ({"duration": np.inf}, ConfigurationError, "duration"),
        ({"duration": np.nan}, ConfigurationError, "duration"),
        ({"duration": "long"}, ConfigurationError, "duration is 'long'"),
        ({"duration": -1.0, "times": 5}, ConfigurationError, "duration"),
        ({"duration": "long", "times": 5}, ConfigurationError, "duration"),
        ({"rtol": 0.0}, ConfigurationError, "rtol"),
        ({"rtol": None}, ConfigurationError, "rtol"),
        ({"atol": -1.0}, ConfigurationError, "atol"),
        ({"times": [0.0, 2.0]}, ConfigurationError, "times have to rise"),
        ({"times": [0.1, 0.05]}, ConfigurationError, "times have to rise"),
        ({"times": 1}, ConfigurationError, "times is 1"),
        ({"times": "x"}, ConfigurationError, "times"),
        ({"max_steps": 0}, ConfigurationError, "max_steps"),
        ({"method": "adams"}, ConfigurationError, "ensembles are made by dormand-prince"),
        ({"method": "euler"}, GoughError, "euler"),
        ({"x0": [1, 2]}, ConfigurationError, "shape"),
        ({"v0": [1, 2]}, ConfigurationError, "v0"),
        ({"gravity": [1, 2]}, ConfigurationError, "gravity"),
        ({"events": {"e": "nothing - 1"}}, GoughError, "nothing"),
        ({"controller": Sampled(lambda t, s: {}, 0.01)}, ConfigurationError, "every period"),
        ({"scheduler": "nowhere"}, GoughError, "nowhere"),
    ],
    ids=lambda x: x if isinstance(x, str) else "",
)
def test_wrong_arguments_are_told(hexapod, asked, error, words):
    if error is None:
        runs(hexapod, **asked)  # masses below zero are rows that end somehow
        return
    with pytest.raises(error, match=words):
        runs(hexapod, **asked)


def test_wrong_inputs_are_told():
    robot = gough.load("gough-stewart")
    table = {"leg1.slide.effort": ([0.0, 1.0], [0.0, 1.0])}
    for vary, inputs, words in [
        ({"inputs.leg1.slide": "±1"}, table, "inputs tell leg1.slide.effort a table"),
        ({"inputs.leg1.slide": "±1", "inputs.leg1.slide.effort": "±1"}, None, "the same number"),
        ({"inputs.leg1.slide": "±1 %"}, None, "which is nothing"),
    ]:
        with pytest.raises(GoughError, match=words):
            runs(robot, 3, 0.01, vary, inputs=inputs)
    with pytest.raises(SingularError):
        gough.load("3-rrr").simulate(0.1, [9.0, 9.0, 0.0], samples=3, vary={"l1": "±1 %"})


def test_vary_takes_samples(hexapod):
    with pytest.raises(ConfigurationError, match="samples"):
        hexapod.simulate(0.1, vary="±10 %")


# many


def test_time_is_linear_and_memory_bounded(hexapod, tmp_path):
    sizes = [1000, 30_000] if not LONG else [1000, 10_000, 100_000]
    seconds, bytes_ = {}, {}
    runs(hexapod, 1000, 0.02)
    for n in sizes:
        process = psutil.Process()
        before, cpu = process.memory_info().rss, time.process_time()
        runs(hexapod, n, 0.02, store=tmp_path / str(n))
        seconds[n] = time.process_time() - cpu
        bytes_[n] = process.memory_info().rss - before
    small, large = sizes[0], sizes[-1]
    assert seconds[large] / large < 1.5 * seconds[small] / small
    assert bytes_[large] < 150e6, bytes_


def test_chunks_are_smaller_where_many_times_are_kept(hexapod):
    plan = task_of(hexapod, 100_000, 0.5).plan
    assert plan.chunk == room.LARGEST
    many = ensemble_of(
        hexapod.mechanism, None, {}, Request(0.5, times=20_000), Many(100_000, "±10 %")
    ).plan
    states = room.prepared(task_of(hexapod, 9, 0.5)).formulation.layout.states
    assert many.chunk * 20_000 * states <= room.NUMBERS
    assert 1 <= many.chunk < 64


def test_ensembles_leave_nothing_behind(hexapod):
    runs(hexapod, 5, 0.01)
    tracemalloc.start()
    first = tracemalloc.get_traced_memory()[0]
    for seed in range(20):
        runs(hexapod, 5, 0.01, seed=seed, measures={"m": lambda c: c["end"]})
    left = tracemalloc.get_traced_memory()[0] - first
    tracemalloc.stop()
    assert left < 2e6, left
