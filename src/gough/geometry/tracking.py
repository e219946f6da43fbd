"""Paths followed through closed configurations, on one solution from beginning to end."""

from __future__ import annotations

from collections.abc import Iterable
from functools import cached_property
from numbers import Integral
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gough.errors import ConfigurationError
from gough.geometry.coordinates import Coordinates, constant_turn
from gough.geometry.inverse import InverseGeometry
from gough.geometry.path_reports import Given, Track
from gough.geometry.path_routes import Path, Route, checked_points
from gough.geometry.path_steps import (
    ClosedFormFollower,
    Follower,
    NewtonFollower,
    QuadraticFollower,
)
from gough.geometry.path_walks import Walk
from gough.geometry.placing import Placing
from gough.geometry.problem import Problem
from gough.geometry.quadratic_closure import QuadraticClosure
from gough.geometry.rates import Kinematics

Array = NDArray[np.float64]
OnSingularity = Literal["stop", "continue"]


class Tracker:
    """Follows paths of one mechanism.

    Args:
        kinematics: its rates, with its models and its home.
        inverse: its inverse geometry; None if it has no outputs.
    """

    def __init__(self, kinematics: Kinematics, inverse: InverseGeometry | None) -> None:
        self.kinematics, self.inverse = kinematics, inverse
        self.models, self.assembler = kinematics.models, kinematics.assembler
        self.home = kinematics.home
        self.coordinates: dict[Given, Coordinates] = {
            "inputs": Coordinates(self.models, "actuated"),
            "outputs": Coordinates(self.models, "operational"),
        }

    def follow(
        self,
        path: Path,
        given: Given = "outputs",
        near: ArrayLike | None = None,
        on_singularity: OnSingularity = "stop",
        samples: int = 101,
    ) -> Track:
        """Follow a path.

        Args:
            path: waypoints, (m, n), at equal steps of s, or a function of s from 0 to 1 that gives
                (n,), smooth. Between waypoints coordinates change at constant rates and a platform
                turns about one axis at a constant rate. A function is sampled: what is followed
                are straight pieces between the points at the samples.
            given: what the path is of: "outputs", the operational coordinates, or "inputs", the
                positions of the actuated joints; m, rad, poses with a quaternion w, x, y, z.
            near: a closed configuration whose mode is followed; home by default. Paths of inputs
                that begin elsewhere are reached from it along a straight line.
            on_singularity: whether to "stop" at the first singularity or to "continue" where the
                same solution goes on.
            samples: how many rows the result has, at equal steps of s; no step is longer.

        Raises:
            ConfigurationError: an argument has the wrong shape or value.
        """
        _require("of", given, ("outputs", "inputs"))
        _require("on_singularity", on_singularity, ("stop", "continue"))
        if not isinstance(samples, Integral) or samples < 2:
            raise ConfigurationError(f"samples is {samples!r}, expected a whole number, 2 or more")
        coordinates = self.coordinates[given]
        if not len(coordinates):
            what = "operational coordinates" if given == "outputs" else "actuated joints"
            raise ConfigurationError(
                f"{self.models.structure.mechanism.name} has no {what} to follow; name some in its "
                "description"
            )
        points = checked_points(path, coordinates, samples, given)
        q = self._near(near)
        walk = Walk(self, given, Route(coordinates, q, points), q, on_singularity, samples)
        return walk.track()

    def _near(self, near: ArrayLike | None) -> Array:
        q = self.home if near is None else np.array(near, dtype=float)
        if q.shape != self.home.shape:
            raise ConfigurationError(
                f"near has shape {q.shape}, expected {self.home.shape}: a configuration q"
            )
        gap = float(self.assembler.gaps(q)) if np.all(np.isfinite(q)) else np.inf
        if not gap <= 1e-6:
            raise ConfigurationError(
                f"near is not closed: its largest scaled gap is {gap:.3g}; close the loops first"
            )
        return q

    # the equations

    def follower(self, given: Given, route: Route) -> Follower:
        """What makes the steps: certified where the equations allow it."""
        if given == "outputs" and self.inverse is not None and self.inverse.closed_form:
            return ClosedFormFollower(route, self.inverse)
        found = self.outputs_known if given == "outputs" else self.inputs_known(route.base)
        if found is not None:
            return QuadraticFollower(route, *found)
        return NewtonFollower(route, self.kinematics)

    @cached_property
    def outputs_known(self) -> tuple[QuadraticClosure, Placing] | None:
        """The equations of the inverse problem; None where they have no square system."""
        problem = self.inverse.problem if self.inverse else None
        return None if problem is None else _equations(problem)

    def inputs_known(self, q: Array) -> tuple[QuadraticClosure, Placing] | None:
        """The equations of the direct problem on the motion of a configuration."""
        kept = self._turn is not None and self._keeps_turn(q)
        return self._turned_inputs if kept else self._free_inputs

    @cached_property
    def _turn(self) -> Array | None:
        """R_base_platform where home's motion keeps it."""
        walked = self.assembler.walked(self.home)
        turn = constant_turn(self.models, self.assembler, walked)
        return None if turn is None else np.array(turn, dtype=float)

    def _keeps_turn(self, q: Array) -> bool:
        structure = self.models.structure
        place = structure.bodies.index(str(structure.mechanism.platform))
        R = self.models.poses(q, self.assembler.p)[place, :3, :3]
        return self._turn is not None and bool(np.abs(R - self._turn).max() < 1e-9)

    @cached_property
    def _turned_inputs(self) -> tuple[QuadraticClosure, Placing] | None:
        return self._inputs_problem(self._turn)

    @cached_property
    def _free_inputs(self) -> tuple[QuadraticClosure, Placing] | None:
        return self._inputs_problem(None)

    def _inputs_problem(self, turn: Array | None) -> tuple[QuadraticClosure, Placing] | None:
        known = [edge.name for edge in self.models.structure.edges if edge.actuated]
        matrix = None if turn is None else tuple(tuple(row) for row in turn.tolist())
        try:
            return _equations(Problem(self.models, self.assembler, self.home, known, matrix))  # type: ignore[arg-type]
        except ConfigurationError:
            return None


def _equations(problem: Problem) -> tuple[QuadraticClosure, Placing] | None:
    try:
        closure = QuadraticClosure(problem)
    except ConfigurationError:
        return None
    return (closure, Placing(problem)) if closure.left else None


def _require(name: str, value: str, known: Iterable[str]) -> None:
    if value not in known:
        raise ConfigurationError(f"{name} is {value!r}, expected one of {', '.join(known)}")
