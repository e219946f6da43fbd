"""Sixteen or eight float64 numbers at a time in loops compiled by numba.

A value of this type is one vector in LLVM, so that a loop over systems of equations is written
once, for one system, and solves as many as there are lanes. Sixteen is twice the widest registers:
with two chains of operations at once, one works while the other waits for its last result. Eight
is for loops that have enough chains of their own; a loop that takes a tuple as its ``width`` is
compiled for as many lanes as that is long. Every operation rounds as IEEE 754 says: a lane's
result depends on nothing in the other lanes.
"""

from __future__ import annotations

import operator
from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba.core import types
from numba.extending import intrinsic, models, overload, register_model

LANES = 16
EIGHT = 8
Lowering = tuple[Any, Callable[..., Any]]


class LanesType(types.Type):
    """numba's name of that many numbers."""

    def __init__(self, width: int) -> None:
        super().__init__(name=f"gough.lanes{width}")
        self.width = width


LANES_TYPE = LanesType(LANES)
EIGHT_TYPE = LanesType(EIGHT)


def _vector(kind: LanesType) -> Any:
    return ir.VectorType(ir.DoubleType(), kind.width)


@register_model(LanesType)
class _Model(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, _vector(kind))  # type: ignore[no-untyped-call]


# memory


def _load(kind: LanesType) -> Any:
    """Neighbours from an index on."""

    def typed(context: Any, pointer: Any, index: Any) -> Lowering:
        def generate(target: Any, builder: Any, signature: Any, given: Any) -> Any:
            first = builder.gep(given[0], [given[1]])
            return builder.load(builder.bitcast(first, _vector(kind).as_pointer()), align=8)

        return kind(pointer, types.int64), generate

    return intrinsic(typed)


def _store(context: Any, pointer: Any, index: Any, value: Any) -> Lowering:
    """Write neighbours from an index on."""

    def generate(target: Any, builder: Any, signature: Any, given: Any) -> Any:
        first = builder.gep(given[0], [given[1]])
        builder.store(given[2], builder.bitcast(first, _vector(value).as_pointer()), align=8)
        return target.get_dummy_value()

    return types.void(pointer, types.int64, value), generate


def _gather(kind: LanesType) -> Any:
    """Numbers that stand ``step`` numbers apart."""

    def typed(context: Any, pointer: Any, index: Any, step: Any) -> Lowering:
        def generate(target: Any, builder: Any, signature: Any, given: Any) -> Any:
            at = builder.gep(given[0], [given[1]])
            value = ir.Constant(_vector(kind), ir.Undefined)
            for lane in range(kind.width):
                value = builder.insert_element(value, builder.load(at), ir.IntType(32)(lane))
                at = builder.gep(at, [given[2]])
            return value

        return kind(pointer, types.int64, types.int64), generate

    return intrinsic(typed)


def _scatter(context: Any, pointer: Any, index: Any, step: Any, value: Any) -> Lowering:
    """Write numbers ``step`` numbers apart."""

    def generate(target: Any, builder: Any, signature: Any, given: Any) -> Any:
        at = builder.gep(given[0], [given[1]])
        for lane in range(value.width):
            builder.store(builder.extract_element(given[3], ir.IntType(32)(lane)), at)
            at = builder.gep(at, [given[2]])
        return target.get_dummy_value()

    return types.void(pointer, types.int64, types.int64, value), generate


def _splat(kind: LanesType) -> Any:
    """One number in every lane."""

    def typed(context: Any, number: Any) -> Lowering:
        def generate(target: Any, builder: Any, signature: Any, given: Any) -> Any:
            nothing = ir.Constant(_vector(kind), ir.Undefined)
            one = builder.insert_element(nothing, given[0], ir.IntType(32)(0))
            zeros = ir.Constant(ir.VectorType(ir.IntType(32), kind.width), None)
            return builder.shuffle_vector(one, nothing, zeros)

        return kind(types.float64), generate

    return intrinsic(typed)


def _load_wide(context: Any, pointer: Any, index: Any, width: Any) -> Lowering:
    """Neighbours from an index on, as many as the tuple ``width`` is long."""
    kind = LanesType(width.count)

    def generate(target: Any, builder: Any, signature: Any, given: Any) -> Any:
        first = builder.gep(given[0], [given[1]])
        return builder.load(builder.bitcast(first, _vector(kind).as_pointer()), align=8)

    return kind(pointer, types.int64, width), generate


def _splat_wide(context: Any, number: Any, width: Any) -> Lowering:
    """One number in every lane, as many as the tuple ``width`` is long."""
    kind = LanesType(width.count)

    def generate(target: Any, builder: Any, signature: Any, given: Any) -> Any:
        nothing = ir.Constant(_vector(kind), ir.Undefined)
        one = builder.insert_element(nothing, given[0], ir.IntType(32)(0))
        zeros = ir.Constant(ir.VectorType(ir.IntType(32), kind.width), None)
        return builder.shuffle_vector(one, nothing, zeros)

    return kind(types.float64, width), generate


load_wide: Any = intrinsic(_load_wide)
splat_wide: Any = intrinsic(_splat_wide)
load, gather, splat = _load(LANES_TYPE), _gather(LANES_TYPE), _splat(LANES_TYPE)
load_eight, splat_eight = _load(EIGHT_TYPE), _splat(EIGHT_TYPE)
store: Any = intrinsic(_store)
scatter: Any = intrinsic(_scatter)


# arithmetic


def _operation(count: int, instruction: Callable[..., Any]) -> Any:
    """An intrinsic of lanes of one width made from a method of LLVM's builder."""

    def generate(target: Any, builder: Any, signature: Any, given: Any) -> Any:
        return instruction(builder, *given)

    if count == 1:
        return intrinsic(lambda context, a: (a(a), generate))
    if count == 2:
        return intrinsic(lambda context, a, b: (a(a, b), generate))
    if count == 3:
        return intrinsic(lambda context, a, b, c: (a(a, b, c), generate))
    return intrinsic(lambda context, a, b, c, d: (a(a, b, c, d), generate))


def _called(name: str) -> Callable[..., Any]:
    def instruction(builder: Any, *given: Any) -> Any:
        vector = given[0].type
        kind = ir.FunctionType(vector, [vector] * len(given))
        full = f"llvm.{name}.v{vector.count}f64"
        function = builder.module.globals.get(full) or ir.Function(builder.module, kind, full)
        return builder.call(function, given)

    return instruction


def _smaller(builder: Any, a: Any, b: Any) -> Any:
    return builder.select(builder.fcmp_ordered("<", b, a), b, a)


def _larger(builder: Any, a: Any, b: Any) -> Any:
    return builder.select(builder.fcmp_ordered(">", b, a), b, a)


def _where(relation: str) -> Callable[..., Any]:
    def instruction(builder: Any, a: Any, b: Any, then: Any, other: Any) -> Any:
        return builder.select(builder.fcmp_ordered(relation, a, b), then, other)

    return instruction


_OPERATORS = {
    operator.add: _operation(2, lambda builder, a, b: builder.fadd(a, b)),
    operator.sub: _operation(2, lambda builder, a, b: builder.fsub(a, b)),
    operator.mul: _operation(2, lambda builder, a, b: builder.fmul(a, b)),
    operator.truediv: _operation(2, lambda builder, a, b: builder.fdiv(a, b)),
}


def _overload(symbol: Any, operation: Any) -> None:
    implementation = lambda a, b: operation(a, b)  # noqa: E731
    overload(symbol)(lambda a, b: implementation if a == b and isinstance(a, LanesType) else None)


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
where_equal: Any = _operation(4, _where("=="))
"""c where a is b, else d."""
where_more: Any = _operation(4, _where(">"))
"""c where a is more than b, else d."""
