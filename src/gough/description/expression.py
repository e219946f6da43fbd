"""Arithmetic of named parameters, evaluated by walking the syntax tree."""

from __future__ import annotations

import ast
import math
import operator
from collections.abc import Callable, Mapping
from functools import cached_property
from typing import Any

from gough import algebra
from gough.errors import GoughError, closest

FUNCTIONS: dict[str, int] = {
    "sqrt": 1,
    "sin": 1,
    "cos": 1,
    "tan": 1,
    "asin": 1,
    "acos": 1,
    "atan2": 2,
}
"""Names of the functions an expression may call, with their number of arguments."""

CONSTANTS = {"pi": 3.141592653589793}
RESERVED = frozenset(FUNCTIONS) | frozenset(CONSTANTS)
MAX_LENGTH = 1000
MAX_DEPTH = 64
"""Limits of a text that a person writes; expressions derived from it may be a little larger."""
SPARE_LENGTH, SPARE_DEPTH = 8 * MAX_LENGTH, MAX_DEPTH + 16

BINARY: dict[type[ast.operator], Callable[[Any, Any], Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Pow: operator.pow,
}
UNARY: dict[type[ast.unaryop], Callable[[Any], Any]] = {
    ast.UAdd: operator.pos,
    ast.USub: operator.neg,
}
GRAMMAR = (
    f"allowed are numbers, parameters, name[index], pi, + - * / **, brackets and "
    f"{', '.join(FUNCTIONS)}"
)


class ExpressionError(GoughError, ValueError):
    """An expression can not be read or has no value; the text says why."""


class Expression:
    """An arithmetic expression of named parameters, such as ``R*cos(pi/3 - d)``.

    Two expressions are equal when their texts are. Values of the names are given at evaluation;
    they may be floats, symbols, or nested sequences of these, which ``name[index]`` picks from.
    """

    def __init__(self, text: str) -> None:
        self.text = text.strip()
        self._tree = _parse(self.text, SPARE_LENGTH, SPARE_DEPTH)

    @classmethod
    def read(cls, text: str) -> Expression:
        """The expression that a person wrote.

        Raises:
            ExpressionError: the text is no arithmetic, too long, or too deeply nested.
        """
        _parse(text.strip(), MAX_LENGTH, MAX_DEPTH)
        return cls(text)

    @cached_property
    def names(self) -> frozenset[str]:
        """The parameters the expression needs, constants and functions left out."""
        found = {node.id for node in ast.walk(self._tree) if isinstance(node, ast.Name)}
        return frozenset(found - RESERVED)

    def evaluate(self, values: Mapping[str, Any]) -> Any:
        """The value for the given values of the names.

        Raises:
            ExpressionError: a name is unknown, or the arithmetic has no finite result.
        """
        try:
            result = _evaluate(self._tree, values)
        except ZeroDivisionError:
            raise ExpressionError(f"{self.text!r} divides by zero") from None
        except OverflowError:
            raise ExpressionError(f"{self.text!r} is too large for a number") from None
        except (ValueError, TypeError) as error:
            if isinstance(error, ExpressionError):
                raise
            raise ExpressionError(f"{self.text!r} has no value: {error}") from None
        if isinstance(result, float) and not math.isfinite(result):
            raise ExpressionError(f"{self.text!r} is not finite")
        return result

    def bind(self, values: Mapping[str, int | str]) -> Expression:
        """The expression with some names replaced, by whole numbers or by other names."""
        if not self.names & values.keys():
            return self
        return Expression(ast.unparse(_Bind(values).visit(ast.parse(self.text, mode="eval"))))

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Expression) and self.text == other.text

    def __hash__(self) -> int:
        return hash(self.text)

    def __repr__(self) -> str:
        return f"Expression({self.text!r})"

    def __str__(self) -> str:
        return self.text


class _Bind(ast.NodeTransformer):
    def __init__(self, values: Mapping[str, int | str]) -> None:
        self.values = values

    def visit_Call(self, node: ast.Call) -> ast.expr:
        """Only the arguments: the name of a function is none of ours."""
        node.args = [self.visit(arg) for arg in node.args]
        return node

    def visit_Name(self, node: ast.Name) -> ast.expr:
        """The name itself, or what stands for it."""
        value = self.values.get(node.id)
        if isinstance(value, str):
            return ast.Name(value)
        return node if value is None else ast.Constant(value)


def _parse(text: str, max_length: int, max_depth: int) -> ast.expr:
    if not text:
        raise ExpressionError("an expression is empty")
    if len(text) > max_length:
        raise ExpressionError(f"an expression has {len(text)} characters, at most {max_length}")
    try:
        tree = ast.parse(text, mode="eval").body
        _check(tree, max_depth)
    except (SyntaxError, ValueError, MemoryError, RecursionError) as error:
        if isinstance(error, ExpressionError):
            raise
        raise ExpressionError(f"{text[:60]!r} is not arithmetic: {GRAMMAR}") from None
    return tree


def _check(node: ast.expr, levels: int) -> None:
    """Refuse every part of the language that is not arithmetic, and nesting beyond ``levels``."""
    if levels < 0:
        raise ExpressionError(f"an expression is nested deeper than {MAX_DEPTH} levels")
    match node:
        case ast.Constant(value=bool() | str() | bytes() | complex() | None):
            raise ExpressionError(f"{node.value!r} is not a number")
        case ast.Constant(value=int() | float()):
            return
        case ast.Name():
            return
        case ast.UnaryOp(op=op, operand=operand) if type(op) in UNARY:
            _check(operand, levels - 1)
        case ast.BinOp(left=left, op=op, right=right) if type(op) in BINARY:
            _check(left, levels - 1)
            _check(right, levels - 1)
        case ast.Subscript(value=value, slice=index):
            _check(value, levels - 1)
            _check(index, levels - 1)
        case ast.Call(func=ast.Name(id=name), args=args, keywords=[]):
            _check_call(name, args, levels - 1)
        case _:
            raise ExpressionError(f"{ast.unparse(node)[:60]!r} is not arithmetic: {GRAMMAR}")


def _check_call(name: str, args: list[ast.expr], levels: int) -> None:
    if name not in FUNCTIONS:
        raise ExpressionError(f"there is no function {name!r}: {GRAMMAR}")
    if len(args) != FUNCTIONS[name]:
        raise ExpressionError(f"{name} takes {FUNCTIONS[name]} numbers, got {len(args)}")
    for arg in args:
        _check(arg, levels)


def _evaluate(node: ast.expr, values: Mapping[str, Any]) -> Any:
    match node:
        case ast.Constant(value=value):
            return float(value) if isinstance(value, int) and abs(value) > 2**53 else value
        case ast.Name(id=name):
            return _lookup(name, values)
        case ast.UnaryOp(op=op, operand=operand):
            return UNARY[type(op)](_scalar(operand, values))
        case ast.BinOp(left=left, op=op, right=right):
            if isinstance(op, ast.Pow):
                return _power(_scalar(left, values), _scalar(right, values))
            return BINARY[type(op)](_scalar(left, values), _scalar(right, values))
        case ast.Subscript(value=value, slice=index):
            return _item(_evaluate(value, values), _evaluate(index, values), node)
        case ast.Call(func=ast.Name(id="atan2"), args=[y, x]):
            return algebra.atan2(_scalar(y, values), _scalar(x, values))
        case ast.Call(func=ast.Name(id=name), args=[arg]):
            return algebra.apply(name, _scalar(arg, values))
    raise AssertionError(f"unchecked node {node!r}")


def _power(base: Any, exponent: Any) -> Any:
    """base ** exponent in floating point, so that no huge whole number is ever built."""
    base = float(base) if isinstance(base, int) else base
    power = base ** (float(exponent) if isinstance(exponent, int) else exponent)
    if isinstance(power, complex):
        raise ExpressionError(f"{base:g} ** {exponent:g} is not a real number")
    return power


def _lookup(name: str, values: Mapping[str, Any]) -> Any:
    if name in CONSTANTS:
        return CONSTANTS[name]
    if name not in values:
        raise ExpressionError(f"there is no parameter {name!r}.{_hint(name, values)}")
    return values[name]


def _hint(name: str, values: Mapping[str, Any]) -> str:
    """The closest known names; a leg's own parameter, leg1__q, goes by its short name."""
    return closest(name, sorted({known.rpartition("__")[2] for known in values}))


def _scalar(node: ast.expr, values: Mapping[str, Any]) -> Any:
    value = _evaluate(node, values)
    if isinstance(value, list | tuple):
        raise ExpressionError(f"{ast.unparse(node)!r} is a list of {len(value)}, not a number")
    return value


def _item(container: Any, index: Any, node: ast.Subscript) -> Any:
    if not isinstance(container, list | tuple):
        raise ExpressionError(f"{ast.unparse(node.value)!r} is one number and has no index")
    if not isinstance(index, int | float) or index != int(index):
        raise ExpressionError(f"index {ast.unparse(node.slice)!r} is not a whole number")
    if not 0 <= index < len(container):
        raise ExpressionError(
            f"index {int(index)} of {ast.unparse(node.value)!r} is outside 0…{len(container) - 1}"
        )
    return container[int(index)]
