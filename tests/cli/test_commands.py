"""What the commands print, and what they cost to start."""

import json
import subprocess
import sys

import pytest
from click.testing import CliRunner

from gough.cli import COMMANDS, main

KEYS = {
    "name",
    "bodies",
    "joints",
    "loops",
    "tree_dof",
    "variables",
    "equations",
    "rank",
    "redundant_equations",
    "mobility",
    "mobility_generic",
    "ranks",
    "defects",
    "defects_generic",
    "actuation",
    "actuation_rank",
    "redundant",
    "free_motions",
    "singularity",
    "rank_gap",
    "assembly",
    "warnings",
}
HEAVY = (
    "casadi",
    "numba",
    "scipy",
    "matplotlib",
    "pydantic",
    "numpy",
    "yaml",
    "rich",
    "xarray",
    "flint",
)


def run(*args):
    result = CliRunner().invoke(main, list(args))
    assert result.exit_code == 0, result.output
    return result.stdout


def loaded_by(statement):
    code = f"import sys\n{statement}\nprint(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return {name.split(".")[0] for name in done.stdout.splitlines()[-1].split()}


def test_analyse_as_json_keeps_its_contract():
    found = json.loads(run("analyse", "3-rpr", "--json"))
    assert found.keys() >= KEYS
    assert found["variables"] == {"actuated": 3, "passive": 3, "operational": 3}
    assert set(found["ranks"]) == {"N", "MN", "NK", "E"}
    assert set(found["defects"]) == {"RPM", "RI", "RO", "II", "IO", "IIM"}
    assert set(found["singularity"]) == {"type_1", "type_2", "constraint", "motion"}
    assert found["actuation"] == "full"
    assert found["mobility"] == found["tree_dof"] - found["rank"] == 3


def test_a_parameter_changes_the_home():
    regular = json.loads(run("analyse", "2rpr", "--json"))
    aligned = json.loads(run("analyse", "2rpr", "--set", "y=0", "--json"))
    assert not regular["singularity"]["type_2"]
    assert aligned["singularity"]["type_2"]
    assert "translation along y" in aligned["singularity"]["motion"]


def test_lists_can_be_set():
    found = run("analyse", "five-bar", "--set", "q=[1.9, 1.4]")
    assert "five-bar" in found


def test_the_schema_is_one_json_object():
    schema = json.loads(run("check", "--schema"))
    assert {"name", "bodies", "joints", "legs"} <= schema["properties"].keys()
    joint = schema["$defs"]["Joint"]["properties"]
    assert "revolute" in joint["type"]["enum"]
    assert joint["actuated"]["type"] == "boolean"
    motor = schema["$defs"]["Motor"]
    assert motor["properties"].keys() == {"inertia", "ratio", "effort", "speed"}
    assert "required" not in motor


def test_every_command_has_help():
    for name in COMMANDS:
        assert "--json" in run(name, "--help")


@pytest.mark.parametrize("statement", ["import gough", "import gough.cli"])
def test_starting_loads_nothing_heavy(statement):
    assert not loaded_by(statement) & set(HEAVY)


def test_help_loads_nothing_heavy():
    statement = (
        "import sys\nsys.argv = ['gough', '--help']\nfrom gough.cli import main\n"
        "import contextlib, io\n"
        "with contextlib.suppress(SystemExit), contextlib.redirect_stdout(io.StringIO()):\n"
        "    main()"
    )
    assert not loaded_by(statement) & set(HEAVY)


def test_checking_loads_only_what_it_needs():
    """Reading one robot reads no other robot of the catalogue, and draws nothing."""
    assert not loaded_by("import gough; gough.load('2rpr')") & {"matplotlib", "numba", "rich"}


def test_the_public_names_exist():
    import gough

    assert all(getattr(gough, name) is not None for name in gough.__all__)
    with pytest.raises(AttributeError, match="no attribute 'nonsense'"):
        _ = gough.nonsense
