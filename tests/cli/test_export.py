"""Models as code, and how many operations they take."""

import ctypes
import json
import shutil
import subprocess

import numpy as np
import pytest
from click.testing import CliRunner

import gough
from gough.cli import main
from tests.kernels.random_tapes import assert_same


def run(*args, code=0):
    result = CliRunner().invoke(main, ["export", *map(str, args)])
    assert result.exit_code == code, result.output
    return result


def test_counts_are_those_of_the_tapes():
    table = run("orthoglide", "--count").stdout.splitlines()
    assert table[0].split()[:4] == ["model", "mul", "add", "trig"]
    assert table[0].split()[-1] == "total"
    found = json.loads(run("orthoglide", "--count", "--json").stdout)["operations"]
    for line in table[1:]:
        name, *numbers = line.split()
        assert [found[name].get(kind, 0) for kind in table[0].split()[1:]] == [*map(int, numbers)]
        assert sum(found[name].values()) == 2 * found[name]["total"]
    assert [line.split()[0] for line in table[1:]] == list(found)
    assert {"residual", "inverse_dynamics", "direct_dynamics", "mass_matrix"} < set(found)


def test_the_number_of_operations_is_held():
    """Not more operations than today: simplification must not get worse unseen."""
    counts = gough.load("gough-stewart").operations()
    assert counts["residual"]["total"] <= 175
    assert counts["jacobian"]["total"] <= 609


@pytest.mark.skipif(shutil.which("gcc") is None, reason="needs gcc")
@pytest.mark.parametrize("name", ["2rpr", "orthoglide", "gough-stewart"])
def test_exported_c_gives_the_bits_of_the_library(tmp_path, name):
    files = run(name, "--to", "c", "--out", tmp_path).stdout.split()
    sources = [file for file in files if file.endswith(".c")]
    flags = ["-std=c99", "-O2", "-ffp-contract=off", "-Wall", "-Wextra", "-Werror"]
    flags += ["-shared", "-fPIC"]
    library = tmp_path / "models.so"
    subprocess.run(["gcc", *flags, "-o", library, *sources, "-lm"], check=True)
    models = gough.load(name).models
    q = gough.load(name).home.q + 0.1 * np.random.default_rng(1).normal(size=(7, models.positions))
    for label, kernel in models.kernels().items():
        prefix = name.replace("-", "_") if name[0].isalpha() else f"robot_{name}"
        function = getattr(ctypes.CDLL(str(library)), f"{prefix}_{label}_batch")
        out = np.empty((7, *kernel.shape))
        pointers = [ctypes.c_void_p(array.ctypes.data) for array in (q, out)]
        function(ctypes.c_size_t(len(q)), *pointers)
        assert_same(out, kernel(q, models.parameters()))


def test_wrong_input(tmp_path):
    assert "say --count, or --to c" in run("2rpr", code=2).output
    assert "'rust' is not one of 'c', 'cuda'" in run("2rpr", "--to", "rust", code=2).output
    blocked = tmp_path / "file"
    blocked.write_text("")
    result = run("2rpr", "--to", "c", "--out", blocked / "in", code=2)
    assert "can not be written: Not a directory" in result.output
