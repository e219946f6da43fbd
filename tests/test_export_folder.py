"""Exported folders: their tests pass, and their README tells all there is."""

import re
import shutil
import subprocess

import numpy as np
import pytest

import gough
from gough.errors import ConfigurationError, UnknownName
from gough.exporting import exported_models, files
from gough.exporting.models import ABOUT, DYNAMICS
from gough.formats.native import Source

STRICT = ["-std=c99", "-O2", "-ffp-contract=off", "-Wall", "-Wextra", "-Werror"]
needs_cc = pytest.mark.skipif(shutil.which("cc") is None, reason="there is no C compiler")

PENDULUM = """
name: pendulum */ "2" \\\\
motion: planar
gravity: [0, -9.81, 0]
parameters: {m: {value: 1.5, live: true}, r: {value: [0.4, 0.1], live: true}}
bodies: {bob: {mass: m, com: "r", inertia: [0, 0.1, 0.1]}}
joints: {pin: {type: revolute, bodies: [base, bob]}}
"""
MASSLESS = """
name: crank
motion: planar
bodies: {bob: {}}
joints: {pin: {type: revolute, bodies: [base, bob], actuated: true}}
"""


def described(text):
    return gough.Robot(Source(text.encode(), "test.yaml").mechanism())


def compiled_and_run(folder, *flags):
    program = folder / "test"
    sources = sorted(str(path) for path in folder.glob("*.c"))
    subprocess.run(["cc", *STRICT, *flags, "-o", program, *sources, "-lm"], check=True)
    return subprocess.run([program], capture_output=True, text=True, check=False)


@needs_cc
@pytest.mark.parametrize("name", ["orthoglide", "gough-stewart", "biped-leg", "4-rpr"])
def test_the_test_of_a_folder_passes(tmp_path, name):
    robot = gough.load(name)
    robot.export_c(tmp_path)
    result = compiled_and_run(tmp_path)
    assert result.returncode == 0, result.stdout
    lines = result.stdout.splitlines()
    assert lines == [f"{m}: the same bits in 20 states" for m in robot.operations()] + ["PASS"]


@needs_cc
def test_the_test_of_a_folder_can_fail(tmp_path):
    gough.load("2rpr").export_c(tmp_path)
    _spoil(next(tmp_path.glob("test_*.c")))
    result = compiled_and_run(tmp_path)
    assert result.returncode == 1
    assert "inverse_dynamics: state 0, number 0 is" in result.stdout
    assert result.stdout.endswith("FAIL\n")


def _spoil(program):
    """Change one recorded number in its last digit."""
    text = program.read_text()
    start = text.index("out_inverse_dynamics[ROWS")
    number = re.search(r"-?0x1\.[0-9a-f]+p[+-]\d+", text[start:])
    other = np.nextafter(float.fromhex(number[0]), np.inf).hex()
    end = start + number.end()
    program.write_text(text[: start + number.start()] + other + text[end:])


@needs_cc
def test_names_live_parameters_and_robots_without_motors(tmp_path):
    robot = described(PENDULUM)
    robot.export_c(tmp_path)
    assert compiled_and_run(tmp_path).returncode == 0
    text = (tmp_path / "README.md").read_text("utf-8")
    assert "Their values when this was written: m = 1.5, r[0] = 0.4, r[1] = 0.1." in text
    assert "inverse_dynamics" not in robot.operations()
    assert "inverse_dynamics" not in text
    assert "direct_dynamics" in robot.operations()


def test_a_mechanism_without_inertia_has_no_direct_dynamics():
    names = described(MASSLESS).operations()
    assert "inverse_dynamics" in names
    assert "direct_dynamics" not in names


@needs_cc
@pytest.mark.parametrize("name", ["five-bar", "biped-leg", "4-rpr"])
def test_the_readme_tells_every_model_and_its_example_compiles(tmp_path, name):
    robot = gough.load(name)
    robot.export_c(tmp_path)
    text = (tmp_path / "README.md").read_text("utf-8")
    for model in exported_models(robot.dynamics):
        _, _, rest = text.partition(f"### {model.name}\n")
        section = rest.partition("\n### ")[0]
        assert f"Operations: {model.kernel.tape.counts()['total']}" in section
        assert f"out[{model.width}]" in section
        for label, numbers in model.inputs.items():
            assert f"const double {label}[{len(numbers)}]" in section
    for motor in robot.dynamics.motors:
        assert motor in text
    blocks = re.findall(r"```c\n(.*?)```", text, re.DOTALL)
    (tmp_path / "example.c").write_text(blocks[-1])
    subprocess.run(["cc", *STRICT, "-c", "example.c"], check=True, cwd=tmp_path)


@pytest.mark.parametrize("name", ["orthoglide", "3-rps", "biped-leg", "6-sps"])
def test_every_number_has_a_name(name):
    for model in exported_models(gough.load(name).dynamics):
        assert tuple(len(axis) for axis in model.axes) == model.kernel.shape
        sizes = {label: size for label, size in model.kernel.inputs.items() if size}
        assert {label: len(numbers) for label, numbers in model.inputs.items()} == sizes
    assert set(DYNAMICS) < set(ABOUT)


def test_names_follow_the_tree_of_the_model():
    """Closed forms may stand on another tree: columns are named by what moves."""
    robot = gough.load("sarrus")
    assert robot.dynamics.model("platform").posed is not robot.dynamics.model("platform")
    rates = {m.name: m for m in exported_models(robot.dynamics)}["rates"]
    names = [name for name, _ in rates.axes[0]]
    found = dict(zip(names, rates.kernel(robot.home.x, [0.1]), strict=True))
    _, v, _ = robot.dynamics.motion(robot.home.x, [0.1], [0.0])
    own = {x.name: rate for x, rate in zip(robot.structure.variables, v, strict=True)}
    common = set(own) & set(found)
    assert set(robot.dynamics.motors) < common
    for name in common:
        np.testing.assert_allclose(found[name], own[name], atol=1e-12)


def test_cuda_has_the_same_models():
    robot = gough.load("4-rpr")
    texts = files("cuda", robot.dynamics)
    assert set(texts) == {
        *(f"robot_4_rpr_{name}.cu" for name in robot.operations()),
        "test_robot_4_rpr.cu",
        "README.md",
    }
    program = texts["test_robot_4_rpr.cu"]
    for name in robot.operations():
        assert f"robot_4_rpr_{name}_batch<<<1, 64>>>(ROWS, " in program
        assert f"### {name}" in texts["README.md"]


def test_records_repeat():
    """Two exports are the same to the bit, so that folders can be compared."""
    first, second = (files("c", gough.load("five-bar").dynamics) for _ in range(2))
    assert first == second


def test_wrong_input(tmp_path):
    with pytest.raises(UnknownName, match="no language is named 'rust'"):
        files("rust", gough.load("2rpr").dynamics)
    (tmp_path / "file").write_text("")
    with pytest.raises(ConfigurationError, match="can not be written"):
        gough.load("2rpr").export_c(tmp_path / "file" / "in")
