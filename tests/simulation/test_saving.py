"""Datasets of simulations in files, and back."""

import json
import os

import numpy as np
import pytest
import xarray

import gough
from gough.errors import ConfigurationError, MissingExtra
from gough.formats.trajectory import read_table
from gough.simulation import saving
from gough.simulation.saving import save, table_of, unit_of, writable
from gough.simulation.summary import summary


@pytest.fixture(scope="module")
def hexapod():
    return gough.load("deployable-hexapod")


@pytest.fixture(scope="module")
def datasets(hexapod):
    """With events, without events, without laws, and of an ensemble."""
    return {
        "events": hexapod.simulate(0.41, times=5),
        "quiet": hexapod.simulate(0.1, times=5),
        "bare": gough.load("andrews-squeezer").simulate(0.01, times=3),
        "ensemble": hexapod.simulate(
            0.3,
            samples=6,
            vary={"mass": "±10 %", "x0.z": "±0.01"},
            events={"half": "platform.z - 0.4"},
            times=3,
            progress=False,
        ),
    }


def opened(path):
    """As anybody reads it: no options."""
    read = xarray.open_zarr if path.suffix == ".zarr" else xarray.open_dataset
    with read(path) as found:
        return found.load()


def texts(values):
    return values.astype(object).tolist()


def assert_same(before, after):
    """Every bit of every variable, coordinate and attribute; texts may have other widths."""
    assert set(before.variables) == set(after.variables)
    assert set(before.coords) == set(after.coords)
    for name, a in before.variables.items():
        b = after[name]
        assert a.dims == b.dims
        assert a.attrs == b.attrs, name
        if a.dtype.kind in "UO":
            assert texts(a.values) == texts(b.values), name
        else:
            assert a.dtype == b.dtype, name
            assert b.values.tobytes() == a.values.tobytes(), name
    assert before.attrs == after.attrs


@pytest.mark.parametrize("suffix", [".nc", ".zarr"])
@pytest.mark.parametrize("kind", ["events", "quiet", "bare", "ensemble"])
def test_everything_survives_bit_for_bit(datasets, kind, suffix, tmp_path):
    before, path = datasets[kind], tmp_path / f"run{suffix}"
    assert save(before, path) == path
    after = opened(path)
    assert_same(before, after)
    assert str(summary(after)) == str(summary(before))
    again = tmp_path / f"again{suffix}"
    assert_same(before, opened(save(after, again)))


def test_signs_of_zero_and_what_is_no_number_survive(tmp_path):
    odd = np.array([0.0, -0.0, np.nan, np.inf, 5e-324, 0.1])
    data = xarray.Dataset(
        {"a": ("time", odd), "n": ("time", np.arange(6)), "b": ("time", odd == 0)},
        {"time": ("time", np.arange(6.0), {"units": "s"})},
        {"seed": 3, "robot": ""},
    )
    for name in ("odd.nc", "odd.zarr"):
        found = opened(save(data, tmp_path / name))
        assert found["a"].values.tobytes() == odd.tobytes()
        assert found["n"].values.tolist() == list(range(6))
        assert found["b"].dtype == bool
        assert found["time"].attrs == {"units": "s"}


def test_attributes_of_any_size(tmp_path):
    """Large seeds stay whole numbers; NetCDF has no truth values."""
    data = xarray.Dataset({"a": ("row", [1.0])}, attrs={"seed": 2**62, "yes": True})
    assert opened(save(data, tmp_path / "a.nc")).attrs == {"seed": 2**62, "yes": 1}
    assert opened(save(data, tmp_path / "a.zarr")).attrs == {"seed": 2**62, "yes": True}


def test_tables_have_titles_with_units(datasets, tmp_path):
    run = datasets["events"]
    path = save(run, tmp_path / "deep" / "run.csv")
    lines = path.read_text().splitlines()
    titles = lines[0].split(",")
    assert len(lines) == 1 + run.sizes["time"]
    assert titles[:4] == ["time [s]", "pose x [m]", "pose y [m]", "pose z [m]"]
    assert {"pose qw [1]", "twist platform.rz [rad/s]", "energy_kinetic [J]"} <= set(titles)
    read = read_table(
        "\n".join(",".join(line.split(",")[:4]) for line in lines).encode(),
        "run.csv",
        {"time": "s", "pose x": "m", "pose y": "m", "pose z": "m"},
    )
    assert read.columns["pose z"] == run["pose"].values[:, 2].tolist()


def test_tables_of_ensembles_have_a_row_for_each_run(datasets):
    titles, columns = table_of(datasets["ensemble"])
    table = dict(zip(titles, columns, strict=True))
    assert table["row"].tolist() == list(range(6))
    assert set(table["ending"]) == {"finished"}
    assert {"factor mass", "first half [s]", "pose_over_time z at 0.15 s [m]"} <= set(titles)
    np.testing.assert_array_equal(table["pose z [m]"], datasets["ensemble"]["pose"].values[:, 2])


@pytest.mark.parametrize(
    ("units", "part", "unit"),
    [
        ("J", "", "J"),
        ("m, rad", "platform.rx", "rad"),
        ("m/s, rad/s", "x", "m/s"),
        ("m, rad", "leg1.slide", ""),
        ("m, 1", "qw", "1"),
        ("", "beta", ""),
    ],
)
def test_units_of_parts(units, part, unit):
    assert unit_of(units, part) == unit


# what can not be written


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("run.txt", r"the suffix '\.txt'; results are saved as \.nc"),
        ("run", "no suffix"),
        ("run.ncc", r"Did you mean '\.nc'"),
        ("folder.nc", r"folder\.nc is a folder; name a file"),
        ("folder.csv", "is a folder"),
        ("file.zarr", "is a file, and Zarr makes a folder"),
        ("mine.zarr", "holds other files"),
        ("store.zarr", "the store of an ensemble"),
        ("file.zarr/run.nc", "is no folder"),
    ],
)
def test_what_is_in_the_way_is_told_beforehand(name, message, tmp_path):
    for folder in ("folder.nc", "folder.csv", "mine.zarr", "store.zarr"):
        (tmp_path / folder).mkdir()
    (tmp_path / "file.zarr").touch()
    (tmp_path / "mine.zarr" / "thesis.tex").touch()
    (tmp_path / "store.zarr" / "zarr.json").write_text(json.dumps({"attributes": {"gough": {}}}))
    with pytest.raises(ConfigurationError, match=message):
        writable(tmp_path / name)
    with pytest.raises(ConfigurationError, match=message):
        save(xarray.Dataset({"a": ("time", [1.0])}, {"time": [0.0]}), tmp_path / name)
    assert (tmp_path / "mine.zarr" / "thesis.tex").exists()


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() == 0, reason="root may write all")
def test_a_folder_without_the_right_to_write(tmp_path):
    tmp_path.chmod(0o500)
    try:
        with pytest.raises(ConfigurationError, match="no right to write"):
            writable(tmp_path / "run.nc")
    finally:
        tmp_path.chmod(0o700)


@pytest.mark.parametrize(("suffix", "extra"), [(".nc", "netcdf"), (".zarr", "store")])
def test_formats_are_extras(suffix, extra, tmp_path, monkeypatch):
    monkeypatch.setattr(saving.importlib.util, "find_spec", lambda name: None)
    with pytest.raises(MissingExtra, match=rf"gough\[{extra}\]"):
        writable(tmp_path / f"run{suffix}")
    assert writable(tmp_path / "run.csv")


@pytest.mark.parametrize("suffix", [".nc", ".zarr", ".csv"])
def test_what_is_there_stays_until_the_new_one_is_whole(datasets, suffix, tmp_path, monkeypatch):
    path = save(datasets["quiet"], tmp_path / f"run{suffix}")
    before = sorted((p, p.stat().st_mtime_ns) for p in path.parent.rglob("*"))

    def full(*args, **options):
        raise OSError(28, "No space left on device")

    for name in ("to_netcdf", "to_zarr"):
        monkeypatch.setattr(xarray.Dataset, name, full)
    monkeypatch.setattr(saving, "write_table", full)
    with pytest.raises(ConfigurationError, match=rf"run\{suffix} can not be written: No space"):
        save(datasets["events"], path)
    assert sorted((p, p.stat().st_mtime_ns) for p in path.parent.rglob("*")) == before
    monkeypatch.undo()
    save(datasets["events"], path)
    assert [p.name for p in tmp_path.iterdir()] == [path.name]
    if suffix != ".csv":
        assert_same(datasets["events"], opened(path))


def test_tables_with_too_many_columns(monkeypatch, datasets, tmp_path):
    monkeypatch.setattr(saving, "MOST_COLUMNS", 10)
    with pytest.raises(ConfigurationError, match=r"would have \d+ columns; save it as \.nc"):
        save(datasets["events"], tmp_path / "run.csv")
    assert not list(tmp_path.iterdir())
