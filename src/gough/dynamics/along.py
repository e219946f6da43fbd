"""Efforts, powers and energies along a motion, and what they ask of the motors."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gough.description.values import scalar
from gough.dynamics.dynamics import Dynamics
from gough.dynamics.results import ENDINGS, Ending, InverseDynamics
from gough.dynamics.trajectory import TIME, Motion
from gough.errors import OutOfReach, SingularError
from gough.geometry.coordinates import Coordinates

Array = NDArray[np.float64]

SHOWN = 10
"""Rows without an answer that are told in words."""
MISSING = 1e-9
"""Forces that motors can not give are told beyond this part of the largest effort."""
ROUNDING = 1e-12
"""Energies below this part of the largest are told as 0."""
_OUT_OF_REACH = ENDINGS.index(Ending.out_of_reach)


@dataclass(frozen=True)
class Load:
    """What a motion asks of one motor, largest values by size."""

    motor: str
    unit: str
    """Of its position, m or rad."""
    effort: float
    rms: float
    """Root of the mean square of the efforts over the rows."""
    rate: float
    power: float
    effort_limit: float | None
    rate_limit: float | None
    efforts_beyond: tuple[int, ...]
    """Rows whose effort is beyond the limit."""
    rates_beyond: tuple[int, ...]

    @property
    def effort_unit(self) -> str:
        """N or N m."""
        return "N" if self.unit == "m" else "N m"


@dataclass(frozen=True)
class Along:
    """Inverse dynamics along a motion; NaN in rows without an answer."""

    mechanism: str
    motion: Motion
    inverse: InverseDynamics
    units: tuple[str, ...]
    """Of the motors' positions."""
    positions: Array
    """Of the motors, (rows, motors), m and rad."""
    rates: Array
    kinetic: Array
    """(rows,), J."""
    potential: Array
    limits: tuple[tuple[float | None, float | None], ...]
    """Largest effort and rate of each motor, None where the description has none."""

    @property
    def solved(self) -> bool:
        """Whether every row has an answer."""
        return bool(np.all(self.inverse.solved))

    @property
    def powers(self) -> Array:
        """What each motor gives, (rows, motors), W."""
        return np.asarray(self.inverse.efforts * self.rates)

    def loads(self) -> list[Load]:
        """What the motion asks of each motor."""
        return [self._load(k) for k in range(len(self.inverse.motors))]

    def _load(self, k: int) -> Load:
        sound = self.inverse.solved
        effort, rate = self.inverse.efforts[:, k], self.rates[:, k]
        effort_limit, rate_limit = self.limits[k]
        kept = effort[sound]
        return Load(
            self.inverse.motors[k],
            self.units[k],
            _largest(kept),
            float(np.sqrt(np.mean(kept**2))) if kept.size else float("nan"),
            _largest(rate[sound]),
            _largest(self.powers[sound, k]),
            effort_limit,
            rate_limit,
            _beyond(effort, effort_limit),
            _beyond(rate, rate_limit),
        )

    # as data

    def as_dict(self) -> dict[str, Any]:
        """The content as plain data."""
        motion, columns = self.motion, self.motion.columns
        return {
            "name": self.mechanism,
            "space": motion.space,
            "solved": self.solved,
            "rows": len(motion),
            "derived": motion.derived or None,
            "time": None if motion.time is None else _plain(motion.time),
            "positions": {n: _plain(motion.at[:, k]) for k, (n, _) in enumerate(columns.positions)},
            "rates": {n: _plain(motion.rates[:, k]) for k, (n, _) in enumerate(columns.rates)},
            "accelerations": {
                name: _plain(motion.accelerations[:, k])
                for k, (name, _) in enumerate(columns.accelerations)
            },
            "motors": [self._motor(k, load) for k, load in enumerate(self.loads())],
            "kinetic_energy": _plain(self.kinetic),
            "potential_energy": _plain(self.potential),
            "independent": list(self.inverse.independent),
            "residual": _plain(self.inverse.residual),
            "regularity": _plain(self.inverse.regularity),
            "ending": [ENDINGS[code].name for code in self.inverse.ending],
            "failures": [self._failure(row) for row in self._failures()],
        }

    def _motor(self, k: int, load: Load) -> dict[str, Any]:
        largest = {
            "largest_effort": load.effort,
            "rms_effort": load.rms,
            "largest_rate": load.rate,
            "largest_power": load.power,
        }
        return {
            "name": load.motor,
            "effort_unit": load.effort_unit,
            "position_unit": load.unit,
            **{name: value if np.isfinite(value) else None for name, value in largest.items()},
            "effort_limit": load.effort_limit,
            "rate_limit": load.rate_limit,
            "effort_saturated_rows": list(load.efforts_beyond),
            "rate_saturated_rows": list(load.rates_beyond),
            "efforts": _plain(self.inverse.efforts[:, k]),
            "positions": _plain(self.positions[:, k]),
            "rates": _plain(self.rates[:, k]),
            "powers": _plain(self.powers[:, k]),
        }

    def _failures(self) -> list[int]:
        return [int(row) for row in np.flatnonzero(~self.inverse.solved)]

    def _failure(self, row: int) -> dict[str, Any]:
        time, lines = self.motion.time, self.motion.lines
        return {
            "row": row,
            "line": lines[row] if lines else None,
            "time": None if time is None else float(time[row]),
            "ending": ENDINGS[self.inverse.ending[row]].name,
            "reason": self.inverse.reasons[row],
        }

    def titles(self) -> list[str]:
        """Titles of the columns of `table`, with units."""
        columns = self.motion.columns
        given = [*columns.positions, *columns.rates, *columns.accelerations]
        if self.motion.time is not None:
            given = [(TIME, "s"), *given]
        for what, end in (("position", ""), ("rate", "/s")):
            given += [
                (f"{what} {motor}", f"{unit}{end}")
                for motor, unit in zip(self.inverse.motors, self.units, strict=True)
            ]
        for load in self.loads():
            given.append((f"effort {load.motor}", load.effort_unit))
        given += [(f"power {motor}", "W") for motor in self.inverse.motors]
        given += [("kinetic energy", "J"), ("potential energy", "J"), ("regularity", "1")]
        return [*(f"{name} [{unit}]" for name, unit in given), "ending"]

    def table(self) -> Iterator[list[object]]:
        """Rows of numbers and the name of their ending."""
        motion = self.motion
        parts = [motion.at, motion.rates, motion.accelerations, self.positions, self.rates]
        parts += [self.inverse.efforts, self.powers, self.kinetic[:, None]]
        parts += [self.potential[:, None], self.inverse.regularity[:, None]]
        if motion.time is not None:
            parts = [motion.time[:, None], *parts]
        for row, code in zip(np.hstack(parts).tolist(), self.inverse.ending, strict=True):
            yield [*row, ENDINGS[code].name]

    # in words

    def __str__(self) -> str:
        lines = [self._first_line()]
        if self.motion.derived:
            lines.append(f"  {self.motion.derived}")
        if np.any(self.inverse.solved):
            lines += [f"  {line}" for line in self._motors_in_words()]
            lines += [f"  {line}" for line in self._energies_in_words()]
        lines += [f"  {line}" for line in self._saturation_in_words()]
        missing = self._missing_in_words()
        lines += [f"  {missing}"] if missing else []
        return "\n".join([*lines, *self._failures_in_words()])

    def _first_line(self) -> str:
        motion, name = self.motion, self.mechanism
        if motion.at_home:
            return f"{name} at rest at home"
        rows = f"{len(motion)} rows" if len(motion) > 1 else "1 row"
        when = f", {motion.moment(0)} to {motion.moment(-1)}" if motion.time is not None else ""
        return f"{name} along a motion of {rows}{when}"

    def _motors_in_words(self) -> list[str]:
        one = len(self.motion) == 1
        heads = ("effort", "rate", "power") if one else ("|effort|", "|rate|", "|power|")
        titles = [
            "motor",
            heads[0],
            *([] if one else ["rms"]),
            "limit",
            heads[1],
            "limit",
            heads[2],
        ]
        lines = [titles]
        for k, load in enumerate(self.loads()):
            values = (load.effort, load.rate, load.power)
            if one:
                values = (self.inverse.efforts[0, k], self.rates[0, k], self.powers[0, k])
            effort, rate, power = values
            lines.append(
                [
                    load.motor,
                    _measured(effort, load.effort_unit),
                    *([] if one else [_measured(load.rms, load.effort_unit)]),
                    _measured(load.effort_limit, load.effort_unit),
                    _measured(rate, f"{load.unit}/s"),
                    _measured(load.rate_limit, f"{load.unit}/s"),
                    _measured(power, "W"),
                ]
            )
        return _aligned(lines)

    def _energies_in_words(self) -> list[str]:
        return [
            f"{name} energy {_range(values[self.inverse.solved])}"
            for name, values in (("kinetic", self.kinetic), ("potential", self.potential))
        ]

    def _saturation_in_words(self) -> list[str]:
        lines = []
        for load in self.loads():
            for what, rows, limit, unit in (
                ("effort", load.efforts_beyond, load.effort_limit, load.effort_unit),
                ("rate", load.rates_beyond, load.rate_limit, f"{load.unit}/s"),
            ):
                if rows:
                    first = (
                        "" if self.motion.at_home else f", first at {self.motion.moment(rows[0])}"
                    )
                    count = "" if len(self.motion) == 1 else f" in {len(rows)} rows"
                    lines.append(
                        f"{load.motor}: {what} beyond its limit of {_measured(limit, unit)}{count}"
                        f"{first}"
                    )
        return lines

    def _missing_in_words(self) -> str:
        """Forces that the motors can not give."""
        residual = np.abs(np.nan_to_num(self.inverse.residual))
        size = np.abs(np.nan_to_num(self.inverse.efforts)).max(initial=0.0)
        worst = residual.max(axis=0, initial=0.0)
        beyond = np.flatnonzero(worst > MISSING * max(size, worst.max(initial=0.0)))
        if not beyond.size:
            return ""
        names = ", ".join(f"{self.inverse.independent[k]} {worst[k]:.4g}" for k in beyond)
        return f"forces that the motors can not give (N and N m): {names}"

    def _failures_in_words(self) -> list[str]:
        failed = self._failures()
        if not failed:
            return []
        lines = [f"{len(failed)} of {len(self.motion)} rows have no answer"]
        for row in failed[:SHOWN]:
            line = f" (line {self.motion.lines[row]})" if self.motion.lines else ""
            lines.append(f"  {self.motion.moment(row)}{line}: {self.inverse.reasons[row]}")
        hidden = len(failed) - SHOWN
        return lines + ([f"  … and {hidden} more"] if hidden > 0 else [])


def along(dynamics: Dynamics, motion: Motion, gravity: ArrayLike | None = None) -> Along:
    """Inverse dynamics along a motion.

    Args:
        dynamics: the mechanism's.
        motion: see `trajectory.motion_of` and `trajectory.at_rest`.
        gravity: in base axes, (3,), m/s²; that of the description by default.

    Raises:
        ConfigurationError: the mechanism has no motors, or gravity is no vector.
    """
    at, missed = _placed(dynamics, motion)
    solve = dynamics.inverse if motion.space == "platform" else dynamics.inverse_joint
    found = _without(solve(at, motion.rates, motion.accelerations, gravity=gravity), missed)
    found, sound, q, v = _moved(dynamics, motion, at, found)
    positions, rates = np.full((2, len(motion), len(found.motors)), np.nan)
    kinetic, potential = np.full((2, len(motion)), np.nan)
    if sound.size:
        positions[sound] = Coordinates(dynamics.models, "actuated").of(q)
        rates[sound] = v[:, dynamics.structure.columns("actuated")]
        energies = dynamics.energy(at[sound], motion.rates[sound], gravity, motion.space)
        kinetic[sound], potential[sound] = energies
    return Along(
        dynamics.structure.mechanism.name,
        motion,
        found,
        tuple(str(dynamics.structure.variables[k].unit) for k in _motors(dynamics)),
        positions,
        rates,
        kinetic,
        potential,
        _limits(dynamics),
    )


def _placed(dynamics: Dynamics, motion: Motion) -> tuple[Array, dict[int, str]]:
    """Where the rows are, as dynamics take it, and why some rows are nowhere."""
    if motion.space == "platform":
        return motion.at, {}
    if motion.at_home:
        return dynamics.home[None], {}
    q, missed = [], {}
    for row, positions in enumerate(motion.at):
        try:
            q.append(dynamics.state(positions))
        except OutOfReach as error:
            q.append(dynamics.home)
            missed[row] = error.reasons[0]
    return np.array(q), missed


def _moved(
    dynamics: Dynamics, motion: Motion, at: Array, found: InverseDynamics
) -> tuple[InverseDynamics, NDArray[np.intp], Array, Array]:
    """Rows with an answer, and their configurations and rates.

    At the edge of the workspace a row may have efforts in closed form, but no configuration that
    closes: it loses its answer.
    """
    sound = np.flatnonzero(found.solved)
    if not sound.size:
        return found, sound, np.zeros((0, len(dynamics.home))), np.zeros((0, 0))
    take = at[sound], motion.rates[sound], motion.accelerations[sound]
    try:
        q, v, _ = dynamics.motion(*take, motion.space)
    except SingularError as error:
        lost = {int(sound[k]): why for k, why in zip(error.rows, error.reasons, strict=True)}
        return _moved(dynamics, motion, at, _without(found, lost))
    return found, sound, q, v


def _without(found: InverseDynamics, missed: dict[int, str]) -> InverseDynamics:
    """The same with no answer in some rows."""
    if not missed:
        return found
    rows, reasons = list(missed), list(found.reasons)
    ending, efforts = found.ending.copy(), found.efforts.copy()
    residual, regularity = found.residual.copy(), found.regularity.copy()
    ending[rows] = _OUT_OF_REACH
    efforts[rows], residual[rows], regularity[rows] = np.nan, np.nan, np.nan
    for row, reason in missed.items():
        reasons[row] = reason
    return InverseDynamics(
        ending,
        regularity,
        tuple(reasons),
        efforts,
        residual,
        found.null_space,
        found.motors,
        found.independent,
    )


def _motors(dynamics: Dynamics) -> list[int]:
    return dynamics.structure.columns("actuated")


def _limits(dynamics: Dynamics) -> tuple[tuple[float | None, float | None], ...]:
    joints, values = dynamics.structure.flat.joints, dynamics.assembler.values
    found: list[tuple[float | None, float | None]] = []
    for name in dynamics.motors:
        motor = joints[name].motor if name in joints else None
        given = (None, None) if motor is None else (motor.effort, motor.speed)
        effort, speed = (None if x is None else float(scalar(x, values)) for x in given)
        found.append((effort, speed))
    return tuple(found)


def _beyond(values: Array, limit: float | None) -> tuple[int, ...]:
    if limit is None:
        return ()
    return tuple(int(row) for row in np.flatnonzero(np.abs(values) > limit))


def _largest(values: Array) -> float:
    return float(np.max(np.abs(values))) if values.size else float("nan")


def _measured(value: float | None, unit: str) -> str:
    return "-" if value is None else f"{value + 0.0:.4g} {unit}"


def _range(values: Array) -> str:
    low, high = float(values.min()), float(values.max())
    size = max(abs(low), abs(high))
    low, high = (0.0 if abs(x) < ROUNDING * size else x for x in (low, high))
    return f"{low:.4g} J" if low == high else f"{low:.4g} J to {high:.4g} J"


def _aligned(lines: Sequence[Sequence[str]]) -> list[str]:
    """Lines of a table, the first column to the left and the others to the right."""
    widths = [max(len(line[k]) for line in lines) for k in range(len(lines[0]))]
    return [
        "  ".join(
            [
                line[0].ljust(widths[0]),
                *(t.rjust(w) for t, w in zip(line[1:], widths[1:], strict=True)),
            ]
        )
        for line in lines
    ]


def _plain(values: Array) -> Any:
    """Nested lists with None for what is no number."""
    if values.ndim > 1:
        return [_plain(value) for value in values]
    return [value if np.isfinite(value) else None for value in values.tolist()]
