"""Sixteen float64 numbers at a time in loops compiled by numba.

A value of this type is one vector in LLVM, so that a loop over systems of equations is written
once, for one system, and solves sixteen. Sixteen and not the eight of the widest registers: with
two chains of operations at once, one works while the other waits for its last result. Every
operation rounds as IEEE 754 says: a lane's result depends on nothing in the other lanes.
"""

from __future__ import annotations

import operator
from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba.core import types
from numba.extending import intrinsic, models, overload, register_model

LANES = 16
VECTOR = ir.VectorType(ir.DoubleType(), LANES)
Lowering = tuple[Any, Callable[..., Any]]


class LanesType(types.Type):
    """numba's name of sixteen numbers."""

    def __init__(self) -> None:
        super().__init__(name="gough.lanes")


LANES_TYPE = LanesType()


@register_model(LanesType)
class _Model(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, VECTOR)  # type: ignore[no-untyped-call]


# memory


def _load(context: Any, pointer: Any, index: Any) -> Lowering:
    """Sixteen neighbours from an index on."""

    def generate(target: Any, builder: Any, signature: Any, given: Any) -> Any:
        first = builder.gep(given[0], [given[1]])
        return builder.load(builder.bitcast(first, VECTOR.as_pointer()), align=8)

    return LANES_TYPE(pointer, types.int64), generate


def _store(context: Any, pointer: Any, index: Any, value: Any) -> Lowering:
    """Write sixteen neighbours from an index on."""

    def generate(target: Any, builder: Any, signature: Any, given: Any) -> Any:
        first = builder.gep(given[0], [given[1]])
        builder.store(given[2], builder.bitcast(first, VECTOR.as_pointer()), align=8)
        return target.get_dummy_value()

    return types.void(pointer, types.int64, LANES_TYPE), generate


def _gather(context: Any, pointer: Any, index: Any, step: Any) -> Lowering:
    """Sixteen numbers that stand ``step`` numbers apart."""

    def generate(target: Any, builder: Any, signature: Any, given: Any) -> Any:
        at, value = builder.gep(given[0], [given[1]]), ir.Constant(VECTOR, ir.Undefined)
        for lane in range(LANES):
            value = builder.insert_element(value, builder.load(at), ir.IntType(32)(lane))
            at = builder.gep(at, [given[2]])
        return value

    return LANES_TYPE(pointer, types.int64, types.int64), generate


def _scatter(context: Any, pointer: Any, index: Any, step: Any, value: Any) -> Lowering:
    """Write sixteen numbers ``step`` numbers apart."""

    def generate(target: Any, builder: Any, signature: Any, given: Any) -> Any:
        at = builder.gep(given[0], [given[1]])
        for lane in range(LANES):
            builder.store(builder.extract_element(given[3], ir.IntType(32)(lane)), at)
            at = builder.gep(at, [given[2]])
        return target.get_dummy_value()

    return types.void(pointer, types.int64, types.int64, LANES_TYPE), generate


def _splat(context: Any, number: Any) -> Lowering:
    """One number in every lane."""

    def generate(target: Any, builder: Any, signature: Any, given: Any) -> Any:
        one = builder.insert_element(ir.Constant(VECTOR, ir.Undefined), given[0], ir.IntType(32)(0))
        zeros = ir.Constant(ir.VectorType(ir.IntType(32), LANES), None)
        return builder.shuffle_vector(one, ir.Constant(VECTOR, ir.Undefined), zeros)

    return LANES_TYPE(types.float64), generate


load: Any = intrinsic(_load)
store: Any = intrinsic(_store)
gather: Any = intrinsic(_gather)
scatter: Any = intrinsic(_scatter)
splat: Any = intrinsic(_splat)


# arithmetic


def _operation(count: int, instruction: Callable[..., Any]) -> Any:
    """An intrinsic of lanes made from a method of LLVM's builder."""

    def generate(target: Any, builder: Any, signature: Any, given: Any) -> Any:
        return instruction(builder, *given)

    signature = LANES_TYPE(*[LANES_TYPE] * count)
    if count == 1:
        return intrinsic(lambda context, a: (signature, generate))
    if count == 2:
        return intrinsic(lambda context, a, b: (signature, generate))
    return intrinsic(lambda context, a, b, c: (signature, generate))


def _called(name: str) -> Callable[..., Any]:
    def instruction(builder: Any, *given: Any) -> Any:
        kind = ir.FunctionType(VECTOR, [VECTOR] * len(given))
        full = f"llvm.{name}.v{LANES}f64"
        function = builder.module.globals.get(full) or ir.Function(builder.module, kind, full)
        return builder.call(function, given)

    return instruction


def _smaller(builder: Any, a: Any, b: Any) -> Any:
    return builder.select(builder.fcmp_ordered("<", b, a), b, a)


def _larger(builder: Any, a: Any, b: Any) -> Any:
    return builder.select(builder.fcmp_ordered(">", b, a), b, a)


_OPERATORS = {
    operator.add: _operation(2, lambda builder, a, b: builder.fadd(a, b)),
    operator.sub: _operation(2, lambda builder, a, b: builder.fsub(a, b)),
    operator.mul: _operation(2, lambda builder, a, b: builder.fmul(a, b)),
    operator.truediv: _operation(2, lambda builder, a, b: builder.fdiv(a, b)),
}


def _overload(symbol: Any, operation: Any) -> None:
    lanes = (LANES_TYPE, LANES_TYPE)
    implementation = lambda a, b: operation(a, b)  # noqa: E731
    overload(symbol)(lambda a, b: implementation if (a, b) == lanes else None)


for _symbol, _chosen in _OPERATORS.items():
    _overload(_symbol, _chosen)

negative: Any = _operation(1, lambda builder, a: builder.fneg(a))
root: Any = _operation(1, _called("sqrt"))
fma: Any = _operation(3, _called("fma"))
"""a b + c with one rounding."""
size: Any = _operation(1, _called("fabs"))
"""|a|."""
larger: Any = _operation(2, _larger)
"""b where it is more than a, else a."""
smaller: Any = _operation(2, _smaller)
"""b where it is less than a, else a."""
