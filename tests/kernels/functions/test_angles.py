"""Sine, cosine and tangent at the angles that are hardest to reduce."""

import mpmath
import numpy as np
import pytest

from gough.kernels.builder import Builder
from gough.kernels.functions import BOUNDS
from gough.kernels.functions.large_angles import routine
from gough.kernels.functions.sines import LIMIT, sin_cos
from gough.kernels.reference import run
from gough.kernels.tape import PRIMITIVES
from gough.kernels.value import Value
from tests.kernels.functions.measured import LONG, VARIANTS, exact, values, worst

HARDEST = 6381956970095103 * 2.0**797
"""No float64 is nearer to a multiple of π/2, in proportion."""


def quarter_turns():
    """The float64 on both sides of n π/2 for all n of the fast range, or a part of them."""
    n = np.arange(1, 2**14 + 3, 1 if LONG else 7, dtype=float)
    with mpmath.workprec(200):
        nearest = np.array([float(mpmath.mpf(k) * mpmath.pi / 2) for k in n])
    return np.concatenate([nearest, np.nextafter(nearest, 0), np.nextafter(nearest, 1e9)])


@pytest.mark.parametrize("variant", VARIANTS)
@pytest.mark.parametrize("name", ["sin", "cos", "tan"])
def test_next_to_quarter_turns(name, variant):
    angles = quarter_turns()
    true = [exact(name, bits=250)(x) for x in angles.tolist()]
    error, where = worst(values(name, angles, variant=variant), true, angles)
    assert error <= BOUNDS[name], where


@pytest.mark.parametrize("name", ["sin", "cos", "tan"])
def test_large_angles(name):
    rng = np.random.default_rng(6)
    multiples = np.ldexp(np.pi / 2, np.arange(14, 1024)) * rng.choice([-1, 1], 1010)
    edges = [np.nextafter(LIMIT, 1e9), 1e22, 2.0**1023, np.finfo(float).max]
    angles = np.array([HARDEST, -HARDEST, *edges, *multiples])
    true = [exact(name, bits=1400)(x) for x in angles.tolist()]
    error, where = worst(values(name, angles), true, angles)
    assert error <= BOUNDS[name], where


def test_both_ways_agree_where_they_meet():
    angles = np.concatenate([np.linspace(LIMIT * 0.9, LIMIT, 500), np.linspace(1e3, 1e4, 500)])
    for name in ("sin", "cos"):
        large = run(routine(name), angles[:, None])[:, 0]
        np.testing.assert_array_almost_equal_nulp(large, values(name, angles), 2)


@pytest.mark.parametrize("name", ["sin", "cos"])
def test_the_routine_is_a_tape_of_plain_primitives(name):
    tape = routine(name)
    assert routine(name) is tape
    assert (tape.inputs, len(tape.outputs)) == (1, 1)
    used = {op for op, _ in tape.code} - {"input", "constant", "bits", "flag"}
    assert used <= set(PRIMITIVES) - {"careful_sin", "careful_cos", "fma", "fms", "fnma"}
    assert tape.operations < 400
    assert np.isnan(run(tape, np.array([[np.inf], [-np.inf], [np.nan]]))).all()


def test_sine_and_cosine_share_their_work():
    builder = Builder(1)
    sine, cosine = sin_cos(Value.input(builder, 0))
    pair = builder.tape([sine.number, cosine.number])
    alone = builder.tape([sine.number])
    assert pair.operations <= 65
    assert pair.operations - alone.operations < 10


@pytest.mark.parametrize("variant", VARIANTS)
def test_squares_add_up_to_one(variant):
    angles = np.random.default_rng(8).uniform(-1e5, 1e5, 500)
    sine, cosine = (values(name, angles, variant=variant) for name in ("sin", "cos"))
    np.testing.assert_allclose(sine**2 + cosine**2, 1, rtol=0, atol=5e-16)
