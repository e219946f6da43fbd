"""What an exciting trajectory has to stay within."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from gough.description.values import scalar
from gough.dynamics.identification.placing import Motion, Placing
from gough.dynamics.identification.regressor import Regressor, States
from gough.errors import ConfigurationError, UnknownName

Array = NDArray[np.float64]
Range = tuple[float, float]

LENGTH, ANGLE = 0.15, 0.25
"""Ranges either side of the centre where none is given, in characteristic lengths and rad; guesses
that keep most mechanisms away from their singularities."""
UNREACHED = 10.0
"""What a motion out of reach counts as, in ratios of a limit, and the part that is missed more."""


@dataclass(frozen=True)
class Limits:
    """Limits by name."""

    low: Array
    """Of the coordinates of a series, from the centre, (n,)."""
    high: Array
    joints: Mapping[int, Range] = field(default_factory=dict)
    """Ranges of motors' positions, by place among the motors."""
    speeds: Mapping[int, float] = field(default_factory=dict)
    efforts: Mapping[int, float] = field(default_factory=dict)


def limits_of(
    regressor: Regressor,
    placing: Placing,
    ranges: Mapping[str, Range] | None,
    speeds: Mapping[str, float] | None,
    efforts: Mapping[str, float] | None,
) -> Limits:
    """Limits as given, else as described.

    Args:
        regressor: of the mechanism.
        placing: the coordinates of the series.
        ranges: (low, high) by the name of a coordinate or a motor, rad and m.
        speeds: largest rates of motors by name; those described by default.
        efforts: largest efforts of motors by name; those described by default.

    Raises:
        UnknownName: a name is of no coordinate and no motor.
        ConfigurationError: a range is empty or the centre is outside.
    """
    motors = regressor.dynamics.motors
    own = dict(ranges or {})
    low, high = _coordinate_ranges(regressor, placing, own)
    for name in own:
        if name not in motors:
            raise UnknownName("coordinate or motor", name, [*placing.names, *motors])
    joints = {motors.index(name): (float(a), float(b)) for name, (a, b) in own.items()}
    return Limits(
        low,
        high,
        joints,
        _of_motors(regressor, "speed", speeds),
        _of_motors(regressor, "effort", efforts),
    )


def _coordinate_ranges(
    regressor: Regressor, placing: Placing, ranges: dict[str, Range]
) -> tuple[Array, Array]:
    """Ranges of the coordinates from the centre; takes them out of those given."""
    length = regressor.dynamics.assembler.length
    low, high = [], []
    for name, unit, at in zip(placing.names, placing.units, placing.centre, strict=True):
        size = LENGTH * length if unit == "m" else ANGLE
        a, b = ranges.pop(name, (at - size, at + size))
        if not a < b or not a <= at <= b:
            raise ConfigurationError(
                f"the range of {name}, {a:g} to {b:g} {unit}, does not hold the centre, {at:g}"
            )
        low.append(a - at)
        high.append(b - at)
    return np.array(low), np.array(high)


def _of_motors(
    regressor: Regressor, what: str, given: Mapping[str, float] | None
) -> dict[int, float]:
    """Limits of motors by place: those given, else those described."""
    dynamics = regressor.dynamics
    motors, values = dynamics.motors, dynamics.assembler.values
    for name in given or {}:
        if name not in motors:
            raise UnknownName("motor", name, motors)
    found = {}
    for k, name in enumerate(motors):
        joint = dynamics.structure.flat.joints.get(name)
        described = None if joint is None or joint.motor is None else getattr(joint.motor, what)
        if given is not None and name in given:
            found[k] = float(given[name])
        elif described is not None:
            found[k] = float(scalar(described, values))
    return found


def use_of(regressor: Regressor, limits: Limits, motion: Motion) -> float:
    """Largest part of any limit of motors that a motion takes: at most 1 where it keeps them all.

    Motions that are out of reach, or cross a singularity of the motors, count as far beyond.
    """
    states = motion.states
    if states is None:
        return UNREACHED * (1 + motion.missed)
    J = regressor.jacobian(states)
    if not np.isfinite(J).all() or _crosses(regressor, J):
        return UNREACHED
    return max(
        _positions_used(regressor, limits, states),
        _rates_used(limits, np.einsum("rmi,ri->rm", J, states.y)),
        _efforts_used(regressor, limits, states),
    )


def _crosses(regressor: Regressor, J: Array) -> bool:
    if regressor.form != "efforts":
        return False
    sign, _ = np.linalg.slogdet(J)
    return bool(np.any(sign != sign[0]) or sign[0] == 0)


def _positions_used(regressor: Regressor, limits: Limits, states: States) -> float:
    """Distance from the middle of a joint's range, over half its width."""
    if not limits.joints:
        return 0.0
    structure, slices = regressor.dynamics.structure, regressor.dynamics.models.closure.slices
    used = []
    for k, (a, b) in limits.joints.items():
        variable = structure.variables[regressor.model.actuated[k]]
        q = states.q[:, slices[variable.edge].start + variable.freedom]
        used.append(float(np.abs(q - (a + b) / 2).max() / ((b - a) / 2)))
    return max(used)


def _rates_used(limits: Limits, rates: Array) -> float:
    return max(
        (float(np.abs(rates[:, k]).max() / most) for k, most in limits.speeds.items()), default=0.0
    )


def _efforts_used(regressor: Regressor, limits: Limits, states: States) -> float:
    if not limits.efforts:
        return 0.0
    efforts = regressor.efforts(states, regressor.parameters.values)
    return max(float(np.abs(efforts[:, k]).max() / most) for k, most in limits.efforts.items())
