"""Kernels over tiles: the same bits for every number of lanes, as a whole and in parts."""

import ctypes

import casadi
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gough.kernels import Kernel, tiled
from gough.kernels.fusing import fused
from gough.kernels.native.machine import host
from gough.kernels.native.store import load
from gough.kernels.native.tiles import ENTRY, TileText
from gough.kernels.reference import run
from gough.kernels.skipping import CERTAIN
from gough.kernels.tiled import TiledKernel, widest
from tests.kernels.random_tapes import assert_same, exact_run, random_tape, special_rows

SIGNATURE = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_void_p)
WIDTHS = (1, 2, 4, 8)
MANY = 3000 if settings.get_current_profile_name() == "long" else 40
SX = casadi.SX


def through(address, width, rows, outputs):
    """Rows (rows, inputs) through tiles; nothing is written beside the tile."""
    function, found = SIGNATURE(address), np.full((len(rows), outputs), 7.0)
    for start in range(0, len(rows), width):
        tile = np.zeros((rows.shape[1], width))
        part = rows[start : start + width]
        tile[:, : len(part)] = part.T
        before, out = tile.copy(), np.full((outputs + 2, width), 5.0)
        function(tile.ctypes.data, out[1:].ctypes.data)
        np.testing.assert_array_equal(tile.view(np.uint64), before.view(np.uint64))
        np.testing.assert_array_equal(out[[0, -1]], 5.0)
        found[start : start + width] = out[1:-1, : len(part)].T
    return found


@settings(max_examples=MANY)
@given(st.integers(0, 2**32))
def test_random_tapes(seed):
    rng = np.random.default_rng(seed)
    tape = random_tape(rng, int(rng.integers(1, 50)), fused=bool(seed % 2), careful=seed % 8 == 0)
    tape = fused(tape) if seed % 3 == 0 else tape
    rows = np.ascontiguousarray(special_rows(rng, tape, 19)).reshape(19, tape.inputs)
    expected = exact_run(tape, rows)
    for width in WIDTHS:
        longest = int(rng.choice([4, 15, 5000]))
        text = str(TileText(tape, width, longest))
        loaded = load(host().object_code(text, int(rng.choice([0, 2]))))
        found = through(loaded.address(ENTRY), width, rows, len(tape.outputs))
        assert_same(found, expected)


def model(fuse=True, functions=True):
    """Some expression with functions, and inputs of which one is held."""
    x, p = SX.sym("x", 4), SX.sym("p", 3)
    waves = [casadi.sin(x[k] * p[k % 3]) * casadi.cos(p[(k + 1) % 3]) for k in range(4)]
    stops = [casadi.erf(300 * (x[k] - p[0])) * x[k] for k in range(4)] if functions else []
    chosen = [casadi.if_else(x[0] < p[1], p[2], x[3]), casadi.if_else(p[0] < p[1], x[1], p[2])]
    column = casadi.vertcat(*waves, *stops, *chosen, p[1], x[2], 2.5, p[0] * p[2])
    return Kernel("model", {"x": x, "p": p}, column, (column.numel(),), fuse)


def tiles(kernel, held, width, x, p):
    """Outputs of a kernel over tiles for rows of x and p."""
    found = TiledKernel(kernel, held)
    given = {"x": x, "p": p}
    columns = [given[name] for name in kernel.inputs if name not in held]
    if held:
        columns.append(found.prepare(*[given[name] for name in found.held]))
    rows = np.ascontiguousarray(np.concatenate(columns, axis=1))
    return through(found.address(width), width, rows, kernel.shape[0])


@pytest.mark.parametrize("functions", [False, True])
@pytest.mark.parametrize("held", [(), ("p",), ("x",), ("p", "x")])
def test_all_widths_give_the_bits_of_the_whole_without_fusing(held, functions):
    rng = np.random.default_rng(2)
    x, p = rng.normal(size=(2, 21, 4))
    p = p[:, :3]
    x[3], x[4, 2], p[7, 1], x[9, 0] = 1e5, np.inf, 1e-310, -0.0
    kernel = model(fuse=False, functions=functions)
    expected = run(kernel.program, np.concatenate([x, p], axis=1))
    assert_same(kernel(x, p), expected)
    for width in WIDTHS:
        assert_same(tiles(kernel, held, width, x, p), expected)


@pytest.mark.parametrize("held", [(), ("p",)])
def test_fused_tiles_of_all_widths_are_equal_and_near_the_whole(held):
    rng = np.random.default_rng(3)
    x, p = rng.normal(size=(30, 4)), rng.normal(size=(30, 3))
    kernel = model()
    expected = tiles(kernel, held, 1, x, p)
    np.testing.assert_allclose(expected, kernel(x, p), rtol=1e-13, atol=1e-14)
    for width in WIDTHS[1:]:
        assert_same(tiles(kernel, held, width, x, p), expected)


def test_long_programs_go_in_parts(monkeypatch):
    rng = np.random.default_rng(4)
    x, p = rng.normal(size=(11, 4)), rng.normal(size=(11, 3))
    monkeypatch.setattr("gough.kernels.tiled.LONGEST", 23)
    monkeypatch.setattr(tiled, "compiled_from", lambda origin, text: _made(text()))
    for functions in (True, False):
        kernel = model(fuse=False, functions=functions)
        expected = run(kernel.program, np.concatenate([x, p], axis=1))
        assert str(TiledKernel(kernel)._text(2)[0]).count("@part_") > 6
        for width in WIDTHS:
            assert_same(tiles(kernel, ("p",), width, x, p), expected)


def _made(text):
    return load(host().object_code(*text))


def test_lanes_do_not_see_their_neighbours():
    """Where error functions are certain and where they are not, NaN, and borders of both."""
    x, p = SX.sym("x", 2), SX.sym("p", 2)
    kernel = Kernel("stops", {"x": x, "p": p}, casadi.erf(x) + casadi.erf(p), (2,), fuse=False)
    edge = [CERTAIN, np.nextafter(CERTAIN, 0), np.nextafter(CERTAIN, -9), -5.0, -6.0, 0.3]
    values = np.array([*edge, -np.inf, np.inf, np.nan, -0.0])
    x = np.stack(np.meshgrid(values, values), axis=-1).reshape(-1, 2)
    p = np.roll(x, 7, axis=0)
    expected = run(kernel.program, np.concatenate([x, p], axis=1))
    for held in ((), ("p",)):
        for width in WIDTHS:
            assert_same(tiles(kernel, held, width, x, p), expected)
    quiet = np.full((8, 2), -50.0)
    for width in WIDTHS:
        assert_same(tiles(kernel, (), width, quiet, quiet), np.full((8, 2), -2.0))
        quiet[3, 0] = np.nan
        found = tiles(kernel, (), width, quiet, quiet)
        assert np.isnan(found[3, 0])
        assert np.isfinite(np.delete(found.ravel(), 6)).all()
        quiet[3, 0] = -50.0


def test_inputs_and_prepared_numbers_are_told():
    kernel = model()
    found = TiledKernel(kernel, ("p",))
    assert found.inputs == {"x": 4}
    assert found.prepare.inputs == {"p": 3}
    assert found.program.inputs == 4 + found.prepare.shape[0]
    assert TiledKernel(kernel).inputs == {"x": 4, "p": 3}
    assert TiledKernel(kernel).program.inputs == 7
    assert widest() in WIDTHS
