"""Arithmetic of parameters: Python's numbers without Python's powers."""

import math

import casadi
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gough.description.expression import FUNCTIONS, Expression, ExpressionError

NAMES = {"a": 1.5, "b": -0.25, "R": 2.0}
MATHS = {name: getattr(math, name) for name in FUNCTIONS} | {"pi": math.pi}

leaves = st.one_of(
    st.integers(0, 99).map("{}.0".format),
    st.floats(0, 1e6).map(repr),
    st.sampled_from([*NAMES, "pi"]),
)


def combined(inner):
    operators = st.sampled_from(["+", "-", "*", "/", "**"])
    return st.one_of(
        st.tuples(inner, operators, inner).map(lambda t: f"({t[0]} {t[1]} {t[2]})"),
        inner.map(lambda t: f"-{t}"),
        st.tuples(st.sampled_from(["sin", "cos", "tan", "sqrt", "asin", "acos"]), inner).map(
            lambda t: f"{t[0]}({t[1]})"
        ),
        st.tuples(inner, inner).map(lambda t: f"atan2({t[0]}, {t[1]})"),
    )


@given(st.recursive(leaves, combined, max_leaves=12))
def test_values_are_those_of_the_language(text):
    try:
        expected = eval(text, {"__builtins__": {}}, NAMES | MATHS)
    except (ZeroDivisionError, OverflowError, ValueError, TypeError):
        expected = None
    try:
        found = Expression.read(text).evaluate(NAMES)
    except ExpressionError:
        assert (
            expected is None
            or isinstance(expected, complex)
            or not math.isfinite(expected)
            or abs(expected) > 1e300
        )
    else:
        assert found == pytest.approx(expected, rel=1e-12, nan_ok=True)


@given(st.text(max_size=40))
def test_any_text_is_read_or_refused(text):
    try:
        Expression.read(text).evaluate(NAMES)
    except ExpressionError as error:
        assert str(error)


@pytest.mark.parametrize(
    "text",
    [
        "__import__('os').system('ls')",
        "a.real",
        "a if b else R",
        "[a for a in b]",
        "lambda: 1",
        "'text'",
        "True",
        "a < b",
        "a // b",
        "a % b",
        "a @ b",
        "sin(a, b)",
        "sin(x=a)",
        "sin",
        "(" * 500,
        "-" * 900 + "1",
        "+".join(["1"] * 400),
        "1" * 1001,
        "2 ** 99999",
        "9" * 400,
        "",
        "a b",
    ],
)
def test_what_is_no_arithmetic_is_refused(text):
    with pytest.raises(ExpressionError):
        Expression.read(text).evaluate(NAMES)


def test_elements_of_lists():
    values = {"B": ((0.0, 1.0), (2.0, 3.0)), "i": 1}
    assert Expression("B[i][0] + B[0][1]").evaluate(values) == 3.0
    assert Expression("B[i]").evaluate(values) == (2.0, 3.0)
    for text, reason in (
        ("B[2]", "outside 0…1"),
        ("B[-1]", "outside 0…1"),
        ("B[0.5]", "not a whole number"),
        ("i[0]", "has no index"),
        ("B + 1", "is a list of 2"),
    ):
        with pytest.raises(ExpressionError, match=reason):
            Expression(text).evaluate(values)


def test_symbols_go_through_like_numbers():
    a = casadi.SX.sym("a")
    expression = Expression("atan2(sin(a), cos(a))**2 + sqrt(a)*acos(a/2) - asin(a/3)")
    symbolic = casadi.Function("f", [a], [expression.evaluate({"a": a})])
    assert float(symbolic(0.7)) == pytest.approx(expression.evaluate({"a": 0.7}), rel=1e-14)


def test_an_index_is_bound():
    expression = Expression("R*cos(2*pi*i/3)")
    assert expression.bind({"i": 2}).names == {"R"}
    assert expression.bind({"i": 2}).evaluate({"R": 1.0}) == pytest.approx(-0.5)
    assert Expression("R").bind({"i": 2}) == Expression("R")


def test_an_unknown_name_is_answered_with_the_closest():
    with pytest.raises(ExpressionError, match=r"no parameter 'radius'\. Did you mean 'radios'"):
        Expression("radius").evaluate({"radios": 1.0})
