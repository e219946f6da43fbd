"""Motions sampled in time: read from a table, differentiated where rates are missing."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline, make_interp_spline

from gough.dynamics.dynamics import Dynamics
from gough.dynamics.model import Space
from gough.errors import ConfigurationError, OutOfReach
from gough.formats.trajectory import Table
from gough.geometry.coordinates import Coordinates

Array = NDArray[np.float64]
Number = tuple[str, str]
"""Name and unit of a column."""

TIME = "time"
FEWEST = 4
"""Rows that a derivative takes at least."""
ROUNDED = 1e-3
"""How far the length of a quaternion in a file may be from 1: what rounding to few digits does."""


@dataclass(frozen=True)
class Columns:
    """Names and units of the columns that a motion has."""

    positions: tuple[Number, ...]
    rates: tuple[Number, ...]
    accelerations: tuple[Number, ...]

    @property
    def known(self) -> dict[str, str]:
        """Every column's unit by its name."""
        return dict([(TIME, "s"), *self.positions, *self.rates, *self.accelerations])


@dataclass(frozen=True)
class Motion:
    """Positions, rates and accelerations, row by row."""

    space: Space
    columns: Columns
    time: Array | None
    """(rows,), s."""
    at: Array
    """Operational coordinates, or positions of the independent variables, (rows, n)."""
    rates: Array
    """ẋ, or rates of the independent variables, (rows, ·)."""
    accelerations: Array
    derived: str = ""
    """What was not given and how it was found, in words."""
    lines: Sequence[int] = ()
    """In which line of a file each row stands."""
    at_home: bool = False
    """Whether this is rest at home, which has no positions of its own in joint space."""

    def __len__(self) -> int:
        return len(self.at)

    def moment(self, row: int) -> str:
        """When a row is, in words."""
        if self.time is not None:
            return f"{self.time[row]:.6g} s"
        return f"row {row + 1}"


def columns_of(dynamics: Dynamics) -> Columns:
    """The columns of a mechanism's motions: outputs, or independent variables without any.

    A rate is called d and an acceleration dd and the name of the position. Rates of rx, ry and rz
    are angular velocities in base axes, also where a quaternion is the position.
    """
    structure = dynamics.structure
    outputs = structure.columns("operational")
    if outputs:
        given = Coordinates(dynamics.models, "operational")
        positions = list(zip(given.names, given.units, strict=True))
        moving: list[Number] = []
        for v in (structure.variables[k] for k in outputs):
            edge = structure.edges[v.edge]
            moving.append((edge.type.labels[v.freedom] if edge.link else v.name, str(v.unit)))
    else:
        variables = [structure.variables[k] for k in dynamics.model("joint").independent]
        positions = moving = [(v.name, str(v.unit)) for v in variables]
    return Columns(
        tuple(positions),
        tuple((f"d{name}", f"{unit}/s") for name, unit in moving),
        tuple((f"dd{name}", f"{unit}/s^2") for name, unit in moving),
    )


def at_rest(dynamics: Dynamics) -> Motion:
    """Home, at rest, as a motion of one row."""
    columns = columns_of(dynamics)
    inverse = dynamics.inverse_geometry
    n = len(columns.positions)
    at = np.full(n, np.nan) if inverse is None else inverse.coordinates.of(dynamics.home)
    still = np.zeros((1, len(columns.rates)))
    space: Space = "joint" if inverse is None else "platform"
    return Motion(space, columns, None, at[None], still, still, at_home=True)


def motion_of(dynamics: Dynamics, table: Table) -> Motion:
    """The motion that a table describes.

    Rates and accelerations that have no columns are derivatives of a spline through the rows.

    Raises:
        DescriptionError: columns are missing, times do not increase, a quaternion is none.
        ConfigurationError: an independent variable has no position of its own.
        OutOfReach: orientations can not be differentiated since a row is out of reach.
    """
    columns = columns_of(dynamics)
    _require_positions(dynamics)
    _require_complete(table, columns)
    time = np.array(table.columns[TIME]) if TIME in table.columns else None
    if time is not None:
        _require_increase(table, time)
    at = _unit(table, columns, _stacked(table, columns.positions))
    space: Space = "joint" if dynamics.inverse_geometry is None else "platform"
    rates, accelerations, derived = _moving(dynamics, table, columns, time, at)
    return Motion(space, columns, time, at, rates, accelerations, derived, table.lines)


# what a table has to hold


def _require_positions(dynamics: Dynamics) -> None:
    structure = dynamics.structure
    if dynamics.inverse_geometry is not None:
        return
    for k in dynamics.model("joint").independent:
        variable = structure.variables[k]
        kind = structure.edges[variable.edge].type
        if kind.coordinates > kind.freedoms:
            raise ConfigurationError(
                f"{structure.mechanism.name} has no outputs, and {variable.name} has no position "
                "of its own that a column could hold; call robot.inverse_dynamics_joint(q, v, a) "
                "from Python"
            )


def _require_complete(table: Table, columns: Columns) -> None:
    """Every position, and all or none of the rates and of the accelerations."""
    have = set(table.columns)
    words = (
        f"expected {', '.join(name for name, _ in columns.positions)}; rates "
        f"{', '.join(name for name, _ in columns.rates)} and accelerations "
        f"{', '.join(name for name, _ in columns.accelerations)} as well or {TIME} alone"
    )
    for group in (columns.positions, columns.rates, columns.accelerations):
        missing = [name for name, _ in group if name not in have]
        some = group is columns.positions or len(missing) < len(group)
        if missing and some:
            raise table.wrong_header(f"columns are missing: {', '.join(missing)}; {words}")
        if missing and TIME not in have:
            raise table.wrong_header(f"column {TIME} is missing, and so is {missing[0]}; {words}")
        if missing and len(table) < FEWEST:
            raise table.wrong_header(
                f"{len(table)} rows are too few for derivatives: give at least {FEWEST}, or "
                f"columns {', '.join(name for name, _ in group)}"
            )


def _require_increase(table: Table, time: Array) -> None:
    back = np.flatnonzero(np.diff(time) <= 0)
    if back.size:
        row = int(back[0]) + 1
        message = (
            f"{time[row]:.9g} s does not come after {time[row - 1]:.9g} s; times must increase"
        )
        raise table.problem(row, message, TIME)


def _unit(table: Table, columns: Columns, at: Array) -> Array:
    """Positions with quaternions of length 1, each on the side of the one before it."""
    for k in _quaternions(columns):
        size = np.linalg.norm(at[:, k : k + 4], axis=1)
        wrong = np.flatnonzero(~(np.abs(size - 1) <= ROUNDED))
        if wrong.size:
            row = int(wrong[0])
            message = f"the quaternion has the length {size[row]:.6g}; it must be 1"
            raise table.problem(row, message, columns.positions[k][0])
        at[:, k : k + 4] /= size[:, None]
        at[:, k : k + 4] = _continuous(at[:, k : k + 4])
    return at


def _quaternions(columns: Columns) -> list[int]:
    """Where quaternions begin among the positions."""
    names = [name for name, _ in columns.positions]
    return [k for k, name in enumerate(names) if name.rpartition(".")[2] == "qw"]


def _continuous(q_wxyz: Array) -> Array:
    """The same rotations with signs such that neighbours are near each other."""
    sides = np.where(np.sum(q_wxyz[1:] * q_wxyz[:-1], axis=1) < 0, -1.0, 1.0)
    signs = np.concatenate([[1.0], np.cumprod(sides)])
    return np.asarray(q_wxyz * signs[:, None])


def _stacked(table: Table, group: Sequence[Number]) -> Array:
    return np.array([table.columns[name] for name, _ in group]).reshape(len(group), -1).T.copy()


# derivatives


def _moving(
    dynamics: Dynamics, table: Table, columns: Columns, time: Array | None, at: Array
) -> tuple[Array, Array, str]:
    """Rates and accelerations, as given or derived, and what was derived, in words."""
    have_rates, have_accelerations = (
        all(name in table.columns for name, _ in group)
        for group in (columns.rates, columns.accelerations)
    )
    kind = "quintic" if len(at) > 5 else "cubic"
    rates = _stacked(table, columns.rates) if have_rates else None
    accelerations = _stacked(table, columns.accelerations) if have_accelerations else None
    if rates is not None and accelerations is not None:
        return rates, accelerations, ""
    assert time is not None
    if rates is not None:
        found = np.asarray(_spline(time, rates).derivative()(time))
        return rates, found, f"accelerations are derivatives of a {kind} spline through the rates"
    first, second = _derivatives(dynamics, columns, time, at)
    through = f"derivatives of a {kind} spline through the positions"
    if accelerations is not None:
        return first, accelerations, f"rates are {through}"
    return first, second, f"rates and accelerations are {through}"


def _spline(time: Array, values: Array) -> BSpline:
    return make_interp_spline(time, values, k=5 if len(time) > 5 else 3)


def _derivatives(
    dynamics: Dynamics, columns: Columns, time: Array, at: Array
) -> tuple[Array, Array]:
    """First and second derivatives of positions as rates and accelerations."""
    starts, turned = _quaternions(columns), _turned(dynamics, at)
    first, second, k = [], [], 0
    while k < at.shape[1]:
        if k in starts:
            w, alpha = _turning(time, at[:, k : k + 4])
        elif turned is not None and k in turned[1]:
            w, alpha = (part[:, [turned[1][k]]] for part in _turning(time, turned[0]))
        else:
            spline = _spline(time, at[:, [k]])
            w, alpha = (spline.derivative(n)(time) for n in (1, 2))
        first.append(w)
        second.append(alpha)
        k += 4 if k in starts else 1
    return np.hstack(first), np.hstack(second)


def _turned(dynamics: Dynamics, at: Array) -> tuple[Array, dict[int, int]] | None:
    """The platform's quaternions where entries of its rotation vector are outputs, and their axes.

    Rates of these outputs are angular velocities, which all three entries decide.
    """
    inverse = dynamics.inverse_geometry
    if inverse is None or not inverse.coordinates.turned:
        return None
    found = inverse.solve(at)
    missed = np.flatnonzero(~found.reached).tolist()
    if missed:
        raise OutOfReach("row", len(at), missed, [found.reasons[k] for k in missed])
    quaternion = inverse.coordinates.turned[0][1]
    axes = {place: axis for place, _, axis in inverse.coordinates.turned}
    return _continuous(found.q[:, quaternion]), axes


def _turning(time: Array, q_wxyz: Array) -> tuple[Array, Array]:
    """Angular velocities and accelerations of quaternions, (rows, 3) each.

    With q = s/|s| of a spline s that has length 1 in the rows, and the vector parts of products:

        ω = 2 (ṡ q*),    ω̇ = 2 (s̈ q*) - 2 (q·ṡ) ω
    """
    spline = _spline(time, q_wxyz)
    first, second = (np.asarray(spline.derivative(n)(time)) for n in (1, 2))
    w = 2 * _vector_part(first, q_wxyz)
    growth = np.sum(q_wxyz * first, axis=1, keepdims=True)
    return w, 2 * _vector_part(second, q_wxyz) - 2 * growth * w


def _vector_part(a_wxyz: Array, b_wxyz: Array) -> Array:
    """The vector part of a b*, (rows, 3)."""
    a, b = a_wxyz[:, 1:], b_wxyz[:, 1:]
    return np.asarray(b_wxyz[:, :1] * a - a_wxyz[:, :1] * b - np.cross(a, b))
