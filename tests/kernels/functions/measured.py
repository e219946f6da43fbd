"""Functions on tapes, what mpmath says they are, and how far apart these are."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import mpmath
import numpy as np
from hypothesis import settings

from gough.kernels.builder import Builder
from gough.kernels.expansion import expanded
from gough.kernels.functions import FORMULAS
from gough.kernels.fusing import fused
from gough.kernels.reference import Array
from gough.kernels.tape import FUNCTIONS, Tape
from gough.kernels.value import Value
from tests.kernels.random_tapes import exact_run

LONG = settings.get_current_profile_name() == "long"
VARIANTS = ("unfused", "fused")
BITS = 150
"""Precision of the references."""


@cache
def tape(name: str, variant: str = "unfused") -> Tape:
    """A function of its arguments, written out."""
    builder = Builder(len(FUNCTIONS[name][0]))
    arguments = [Value.input(builder, k) for k in range(builder.inputs)]
    written = expanded(builder.tape([arguments[0].emit(name, *arguments[1:]).number]))
    assert written.code == builder_of(name).code
    return fused(written) if variant == "fused" else written


def builder_of(name: str) -> Tape:
    """The same by the formula alone."""
    builder = Builder(len(FUNCTIONS[name][0]))
    arguments = [Value.input(builder, k) for k in range(builder.inputs)]
    return builder.tape([FORMULAS[name](*arguments).number])


def values(name: str, *arguments: object, variant: str = "unfused") -> Array:
    """A function of arrays or numbers."""
    columns = np.broadcast_arrays(*[np.asarray(a, float) for a in arguments])
    rows = np.stack([column.ravel() for column in columns], axis=-1)
    return exact_run(tape(name, variant), rows)[:, 0].reshape(columns[0].shape)


def exact(name: str, bits: int = BITS) -> Callable[..., mpmath.mpf]:
    """The function of mpmath; infinite where it is above all float64."""
    function = getattr(mpmath, {"log": "ln", "pow": "power"}.get(name, name))

    def value(*arguments: float) -> mpmath.mpf:
        with mpmath.workprec(bits):
            return function(*[mpmath.mpf(a) for a in arguments])

    return value


def ulps(found: float, true: mpmath.mpf) -> float:
    """The distance in units of the last place that the true value has in float64."""
    if found == true:
        return 0.0
    unit = mpmath.ldexp(1, max(mpmath.frexp(true)[1] - 53, -1074))
    if np.isinf(found):  # stands for the number after the largest
        found = np.sign(found) * mpmath.ldexp(1, 1024)
        if abs(true) > abs(found):
            return 0.0 if true * found > 0 else np.inf
    with mpmath.workprec(BITS):
        error = float(abs(mpmath.mpf(found) - true) / unit)
    return np.inf if np.isnan(error) else error


def worst(found: Array, true: list[mpmath.mpf], *arguments: Array) -> tuple[float, list[str]]:
    """The largest error in ulp, and the arguments that have it."""
    errors = [ulps(float(f), t) for f, t in zip(found, true, strict=True)]
    k = int(np.argmax(errors))
    return errors[k], [float(a[k]).hex() for a in arguments]
