"""Measures over a grid of the operational space, as labelled arrays."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gough.errors import ConfigurationError, UnknownName
from gough.geometry.rates import SINGULAR, Kinematics
from gough.joints import quaternion
from gough.joints.free import POSE

if TYPE_CHECKING:
    import xarray

Array = NDArray[np.float64]
Inverse = Callable[[Array], tuple[Array, NDArray[np.bool_]]]
"""Output positions (rows, o) to (configurations (rows, positions), whether reached (rows,))."""

MEASURES = {
    "velocity_factors": "velocity factors: singular values of J, ascending",
    "conditioning": "condition number of J",
    "manipulability": "manipulability √det(J Jᵀ)",
    "type_1": "smallest singular value of A over the largest of E: 0 at a type 1 singularity",
    "type_2": "smallest singular value of B over the largest of E: 0 at a type 2 singularity",
    "determinant_sign": "sign of the determinant of the direct kinematics, 1 at home",
    "regularity": "distance from where ẋ does not determine all rates, 0 to 1",
}
"""What can be mapped."""


def workspace_map(
    kinematics: Kinematics,
    inverse: Inverse,
    measures: str | Sequence[str] = ("conditioning", "velocity_factors"),
    **axes: ArrayLike,
) -> xarray.Dataset:
    """Measures over a grid of output positions.

    Args:
        kinematics: of the mechanism.
        inverse: inverse geometry, from output positions (rows, o) to configurations
            (rows, positions) and whether each is reached (rows,). With all six freedoms of the
            platform it is given poses (rows, 7): x, y, z and the quaternion (w, x, y, z).
        measures: one name or more from `MEASURES`.
        axes: for each output, by its name, the positions of the grid (n,), or one number; m and
            rad. With six freedoms rx, ry, rz are the entries of the rotation vector.

    Returns:
        A dataset with a dimension for each axis of several positions, and ``reached`` and
        ``regular``. Measures are NaN where one of these is false: where the point is out of reach,
        and where its configuration is singular for the passive joints or the motors (type 1).

    Raises:
        UnknownName: an axis is no output, or a measure does not exist.
        ConfigurationError: an output has no axis, or an axis is no list of finite numbers.
    """
    import xarray

    measures = [measures] if isinstance(measures, str) else list(measures)
    for name in measures:
        if name not in MEASURES:
            raise UnknownName("measure", name, MEASURES)
    grid = _grid(kinematics, axes)
    dims = [name for name, positions in grid.items() if positions.ndim]
    shape = tuple(len(grid[name]) for name in dims)
    q, reached = _reached(inverse, _positions(grid))
    q_reached = q[reached]
    regular = np.zeros(len(reached), dtype=bool)
    regular[reached] = kinematics.regularity(q_reached) >= SINGULAR
    flags = {
        "reached": (dims, reached.reshape(shape), _about("whether the point is in reach")),
        "regular": (dims, regular.reshape(shape), _about("whether all rates follow from ẋ")),
    }
    data: dict[str, Any] = dict(flags)
    for name in measures:
        extra = ["factor"] if name == "velocity_factors" else []
        sizes = (kinematics.factors,) if extra else ()
        values = _values(getattr(kinematics, name), q, regular, sizes)
        unit = _unit(kinematics, name)
        about = _about(MEASURES[name], unit)
        data[name] = ([*dims, *extra], values.reshape((*shape, *values.shape[1:])), about)
    return xarray.Dataset(data, coords=_coordinates(kinematics, grid))


def _outputs(kinematics: Kinematics) -> dict[str, str]:
    """Unit of each output, by the name it has in the description."""
    structure = kinematics.models.structure
    found: dict[str, str] = {}
    for k in structure.columns("operational"):
        variable = structure.variables[k]
        edge = structure.edges[variable.edge]
        label = edge.type.labels[variable.freedom]
        found[label if edge.link else variable.name] = variable.unit
    return found


def _grid(kinematics: Kinematics, axes: dict[str, ArrayLike]) -> dict[str, Array]:
    """Positions of each output in their order."""
    outputs = _outputs(kinematics)
    for name in axes:
        if name not in outputs:
            raise UnknownName("output", name, outputs)
    missing = [name for name in outputs if name not in axes]
    if missing:
        raise ConfigurationError(
            f"no positions are given for {', '.join(missing)}; give an array, or one number to "
            "hold an output"
        )
    return {name: _axis(name, axes[name]) for name in outputs}


def _axis(name: str, given: ArrayLike) -> Array:
    try:
        positions = np.asarray(given, dtype=float)
    except (TypeError, ValueError):
        raise ConfigurationError(
            f"axis {name} is {given!r:.60}; expected finite numbers (n,), or one"
        ) from None
    if positions.ndim > 1 or not np.all(np.isfinite(positions)):
        raise ConfigurationError(
            f"axis {name} has shape {positions.shape}; expected finite numbers (n,), or one"
        )
    return positions


def _positions(grid: dict[str, Array]) -> Array:
    """Every point of the grid, the last axis fastest: (rows, o), or poses (rows, 7)."""
    mesh = np.meshgrid(*grid.values(), indexing="ij")
    points = np.stack([axis.ravel() for axis in mesh], axis=-1)
    if tuple(grid) != POSE:
        return points
    turns = [quaternion.wxyz_from_rotation_vector(v) for v in points[:, 3:].tolist()]
    return np.hstack([points[:, :3], np.array(turns).reshape(-1, 4)])


def _reached(inverse: Inverse, x: Array) -> tuple[Array, NDArray[np.bool_]]:
    q, reached = inverse(x)
    q, reached = np.asarray(q, dtype=float), np.asarray(reached, dtype=bool)
    if reached.shape != (len(x),) or q.shape[:1] != (len(x),) or q.ndim != 2:
        raise ConfigurationError(
            f"inverse gave arrays of shape {q.shape} and {reached.shape} for {len(x)} rows; "
            f"expected ({len(x)}, positions) and ({len(x)},)"
        )
    return q, reached


def _values(
    measure: Callable[[Array], Array],
    q: Array,
    regular: NDArray[np.bool_],
    sizes: tuple[int, ...],
) -> Array:
    """A measure where it exists, NaN elsewhere: (rows, *sizes)."""
    values = np.full((len(q), *sizes), np.nan)
    if regular.any():
        values[regular] = measure(q[regular])
    return values


def _unit(kinematics: Kinematics, measure: str) -> str:
    return kinematics.factor_unit if measure == "velocity_factors" else "1"


def _about(text: str, unit: str | None = None) -> dict[str, str]:
    return {"long_name": text} | ({"units": unit} if unit else {})


def _coordinates(kinematics: Kinematics, grid: dict[str, Array]) -> dict[str, Any]:
    units = _outputs(kinematics)
    return {
        name: ((name,) if positions.ndim else (), positions, _about(f"output {name}", units[name]))
        for name, positions in grid.items()
    }
