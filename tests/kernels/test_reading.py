"""Tapes of CasADi functions: the same numbers, few operations, refusals with a way out."""

import casadi
import numpy as np
import pytest

from gough.errors import ConfigurationError
from gough.kernels.expansion import expanded
from gough.kernels.fusing import fused
from gough.kernels.reading import read
from gough.kernels.reference import run
from tests.kernels.random_tapes import exact_run

X = casadi.SX.sym("x", 4)
A, B, C, D = (X[k] for k in range(4))
if_else, vertcat = casadi.if_else, casadi.vertcat

EXPRESSIONS = {
    "arithmetic": (A + B) * (C - D) / (A * A + 1) - 2 * B + (-C) * D,
    "quotients": A / B + C / B + 1 / B + D / 3 + 2 / (C * B),
    "negations": -(A - B) * -(C + 1) - (-A) - -B + 3 * (-2 * C) + (-4) * (0.5 * D),
    "roots and powers": casadi.sqrt(A * A) + B**2 + C**3 + D**-2 + (A * A) ** 2.5 + (B * B) ** 0.7,
    "choices": if_else(A > B, C, D) + if_else(A <= 0, if_else(B < 0, 1, C), D * A),
    "one choice": if_else(A > 0, B, 0) + if_else(C > 0, 0, D),
    "logic": if_else(
        casadi.logic_or(casadi.logic_and(A > 0, B > 0), casadi.logic_not(C > 0)), 1, D
    ),
    "truths as numbers": (A > 0) * B + (C != D) + (A == A) - casadi.logic_and(A, B),
    "numbers as truths": if_else(A, B, C) + if_else(A - A, 5, D),
    "least and largest": casadi.fmin(A, B)
    + casadi.fmax(C, 0.5) * casadi.fmin(casadi.fmax(D, -1), 1),
    "parts": casadi.floor(A) + casadi.ceil(B) + casadi.fabs(C) + casadi.sign(D),
    "signs": casadi.copysign(A, B) + casadi.sign(A * 0) + casadi.sign(-casadi.fabs(C)),
    "angles": casadi.atan2(A, B) + casadi.sin(C) * casadi.cos(C) + casadi.tan(D) + casadi.atan(A),
    "arcs": casadi.asin(A / 10) + casadi.acos(B / 10),
    "growth": casadi.exp(A)
    + casadi.log(B * B + 1)
    + casadi.erf(C)
    + casadi.tanh(D)
    + casadi.sinh(A),
    "small growth": casadi.expm1(A) + casadi.log1p(B * B) + casadi.cosh(C) + casadi.hypot(C, D),
    "outputs": vertcat(A, A, 3, B, -A, D),
}


def read_expression(expression):
    return read(casadi.Function("f", [X], [casadi.densify(casadi.vec(expression))]))


@pytest.mark.parametrize("name", EXPRESSIONS)
def test_numbers_are_those_of_casadi(name):
    function = casadi.Function("f", [X], [EXPRESSIONS[name]])
    rows = np.random.default_rng(len(name)).normal(size=(200, 4)) * 2
    expected = np.array(function(rows.T)).T
    tape = expanded(read_expression(EXPRESSIONS[name]))
    np.testing.assert_allclose(run(tape, rows), expected, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(exact_run(fused(tape), rows), expected, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize(
    ("expression", "counts"),
    [
        (A / B + C / B, {"mul": 2, "add": 1, "div": 1, "total": 4}),
        (A / B * C, {"mul": 1, "div": 1, "total": 2}),
        (2 * (3 * A) - 6 * A, {"total": 0}),
        (if_else(A > 0, B, C), {"select": 1, "compare": 1, "total": 2}),
        (casadi.sin(A) + casadi.sin(A), {"add": 1, "trig": 1, "total": 2}),
        ((A - B) * (B - A) + (A - B) ** 2, None),
        (A * B + B * A, {"mul": 1, "add": 1, "total": 2}),
        (-2 * A + B, {"add": 2, "total": 2}),
        (casadi.SX(5.0), {"total": 0}),
    ],
)
def test_equal_work_is_done_once(expression, counts):
    found = read_expression(expression).counts()
    assert found == counts or (counts is None and found["total"] <= 5)


def test_products_in_sums_are_fused_once():
    tape = read_expression(A * B + C * D)
    assert fused(tape).counts() == {"mul": 1, "fma": 1, "total": 2}
    shared = read_expression(vertcat(A * B + C, A * B))
    assert fused(shared).counts() == {"mul": 1, "add": 1, "total": 2}


@pytest.mark.parametrize("operation", ["erfinv", "acosh", "fmod"])
def test_what_has_no_meaning_is_refused(operation):
    function = getattr(casadi, operation)
    expression = function(A, B) if operation == "fmod" else function(A)
    with pytest.raises(
        ConfigurationError, match=f"uses the operation '{operation}', which kernels"
    ):
        read_expression(expression)


def test_long_chains_are_read_without_recursion():
    x, y = casadi.SX.sym("x"), casadi.SX.sym("y")
    z = x
    for _ in range(20_000):
        z = z * y + x
    tape = read(casadi.Function("chain", [x, y], [z]))
    assert tape.counts() == {"mul": 20_000, "add": 20_000, "total": 40_000}
    assert len(fused(tape)) == 20_002


@pytest.mark.parametrize(
    ("expression", "x", "expected"),
    [
        (A / 1e-310, 0.0, 0.0),
        (A / 1e200 / 1e200, 1e308, 1e308 / 1e200 / 1e200),
        (A / np.inf, np.inf, np.nan),
        (casadi.hypot(A, B), 1e308, 1e308),
        (casadi.hypot(A, B), 1e-310, 1e-310),
        (casadi.hypot(A, B), 0.0, 0.0),
        (casadi.hypot(A, B), np.inf, np.inf),
    ],
)
def test_constants_and_sizes_near_the_ends_of_the_range(expression, x, expected):
    tape = expanded(read_expression(expression))
    found = run(tape, np.array([[x, 0.0, 0.0, 0.0]]))[0, 0]
    np.testing.assert_allclose(found, expected, rtol=1e-15)


@pytest.mark.parametrize("expression", [A * A - B * B, A * B - B * B, (A * A - B * B) + A * A * C])
def test_a_difference_of_equal_products_is_zero(expression):
    tape = fused(expanded(read_expression(expression)))
    x = np.random.default_rng(1).normal(size=500)
    rows = np.stack([x, x, np.zeros(500), x], axis=-1)
    np.testing.assert_array_equal(exact_run(tape, rows)[:, 0], 0)
