"""Runs of an ensemble that need other coordinates on their way, made one by one."""

from __future__ import annotations

import threading
from collections.abc import Sequence
from copy import copy
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from gough.assembly import Assembler
from gough.dynamics.dynamics import Dynamics
from gough.geometry.inverse import InverseGeometry
from gough.numerics.integration import Ending
from gough.simulation.formulations import Formulation, Formulations
from gough.simulation.run import Runner, Start, Trace

Array = NDArray[np.float64]

_ONE_BY_ONE = threading.Lock()
"""Formulations found on the way are written with symbols, which threads must not share."""


class Onward:
    """Makes single runs with parameters of their own, on the machine code of an ensemble.

    Args:
        runner: of the nominal run.
        formulation: that all rows start in.
    """

    def __init__(self, runner: Runner, formulation: Formulation) -> None:
        self.runner, self.formulation = runner, formulation

    def run(self, state: Array, p: Array, inputs: Array, duration: float, times: Array) -> Trace:
        """One run from a state, seen at some times and, where it is stopped, at its end.

        Raises:
            ClosureError: the loops do not close at home with these parameters.
        """
        with _ONE_BY_ONE:
            shared = self.runner.formulations
            shared.dynamics.model("joint")
            own = _Own(shared, _with_parameters(shared.dynamics, p))
            told = dict(zip(self.runner.inputs.constant, inputs.tolist(), strict=True))
            runner = replace(
                self.runner,
                formulations=own,
                inputs=replace(self.runner.inputs, constant=told),
                _pieces=[],
            )
            start = self._start(own.dynamics, state)
            trace = runner.go(start, duration, times)
            if trace.ending is Ending.stopped:
                trace = runner.go(start, duration, np.unique([*times, trace.end]))
            return trace

    def _start(self, dynamics: Dynamics, state: Array) -> Start:
        layout, formulation = self.formulation.layout, _rebound(self.formulation, dynamics)
        q = formulation.configurations(state[layout.part("positions")], dynamics.home)
        return Start(q, formulation.all_rates(q, state[layout.part("rates")]))


def _with_parameters(dynamics: Dynamics, p: Array) -> Dynamics:
    if np.array_equal(p, dynamics.assembler.p):
        return dynamics
    found = copy(dynamics)
    found.assembler = Assembler(dynamics.models, p)
    found.home = found.assembler.home().require().q
    if dynamics.inverse_geometry is not None:
        found.inverse_geometry = InverseGeometry(dynamics.models, found.assembler, found.home)
    # kernels hold the scales of whoever makes them
    scales = ("row_scale", "rate_scale")
    vars(found.assembler).update({name: getattr(dynamics.assembler, name) for name in scales})
    return found


class _Own(Formulations):
    """The formulations of a nominal mechanism, at other parameters.

    What is not there yet is made for the nominal one, so that no run depends on those before it.
    """

    def __init__(self, shared: Formulations, dynamics: Dynamics) -> None:
        super().__init__(dynamics, shared.setting)
        self.shared = shared
        by_outputs = shared.by_outputs
        vars(self)["by_outputs"] = by_outputs and _rebound(by_outputs, dynamics)

    def _with(self, chosen: Sequence[int]) -> Formulation:
        return _rebound(self.shared._with(chosen), self.dynamics)


def _rebound(formulation: Formulation, dynamics: Dynamics) -> Formulation:
    """The same equations and machine code with the parameters of some dynamics."""
    _ = formulation._kernels  # made once, for all copies
    found = copy(formulation)
    found.dynamics = dynamics
    return found
