"""A room uses only rooms below it, and heavy imports stay in the rooms that need them."""

import ast
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parents[1] / "src" / "gough"
FLOORS = [
    {"errors", "algebra"},
    {"cache"},
    {"joints", "actuators", "kernels", "numerics", "ensembles", "uncertainty"},
    {"description"},
    {"topology", "formats", "catalogue"},
    {"symbolic"},
    {"models"},
    {"assembly"},
    {"analysis", "geometry"},
    {"dynamics"},
    {"exporting", "simulation"},
    {"robot"},
    {"view"},
    {"studies", "catalogue_facts"},
    {"cli"},
]
LEVEL = {room: k for k, floor in enumerate(FLOORS) for room in floor}
HEAVY = {
    "casadi": {"kernels", "symbolic", "models", "geometry", "dynamics", "simulation"},
    "llvmlite": {"kernels", "numerics"},
    "numba": {"numerics"},
    "matplotlib": {"view"},
    "scipy": {"simulation", "analysis", "symbolic", "dynamics", "uncertainty"},
    "pydantic": {"description", "formats"},
    "yaml": {"formats"},
    "click": {"cli"},
    "flint": {"numerics"},
    "xarray": {"simulation", "geometry", "ensembles"},
    "zarr": {"ensembles"},
    "dask": {"ensembles"},
    "distributed": {"ensembles"},
    "cloudpickle": {"ensembles"},
    "rich": {"ensembles", "cli"},
}


def room_of(file):
    return file.relative_to(PACKAGE).parts[0].removesuffix(".py")


def imports(file):
    """Every module a file imports outside `if TYPE_CHECKING:`."""
    tree = ast.parse(file.read_text("utf-8"))
    only_types = [
        node
        for test in ast.walk(tree)
        if isinstance(test, ast.If) and getattr(test.test, "id", "") == "TYPE_CHECKING"
        for node in ast.walk(test)
    ]
    for node in ast.walk(tree):
        if node in only_types:
            continue
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            yield node.module
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


FILES = [f for f in sorted(PACKAGE.rglob("*.py")) if room_of(f) not in ("__init__", "__main__")]


@pytest.mark.parametrize("file", FILES, ids=lambda f: str(f.relative_to(PACKAGE)))
def test_a_room_imports_only_from_below(file):
    here = room_of(file)
    for module in imports(file):
        parts = module.split(".")
        if parts[0] == "gough" and len(parts) > 1 and parts[1] in LEVEL and parts[1] != here:
            assert LEVEL[parts[1]] < LEVEL[here], f"{here} imports {module}"


@pytest.mark.parametrize("file", FILES, ids=lambda f: str(f.relative_to(PACKAGE)))
def test_heavy_packages_stay_in_their_rooms(file):
    for module in imports(file):
        rooms = HEAVY.get(module.split(".")[0])
        assert rooms is None or room_of(file) in rooms, f"{room_of(file)} imports {module}"
