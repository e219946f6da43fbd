"""Initial value problems written with CasADi, for every integrator."""

from collections.abc import Callable

import casadi
import numpy as np

from gough.kernels import Kernel
from gough.kernels.tiled import TiledKernel
from gough.numerics import sundials
from gough.numerics.integration import (
    ENDINGS,
    Constraints,
    Event,
    Problem,
    Tolerances,
    integrate,
)

SX = casadi.SX
METHODS = {"dormand-prince": integrate, "adams": sundials.adams, "bdf": sundials.bdf}


class Written:
    """A problem and what keeps its machine code alive.

    ``rates`` and ``values`` of events are functions of symbols that have the attributes t, y,
    signals, branches and p.
    """

    def __init__(
        self,
        states: int,
        rates: Callable,
        values: Callable | None = None,
        events: tuple[Event, ...] = (),
        *,
        p: int = 0,
        equations: Callable | None = None,
        **named,
    ) -> None:
        self.t, self.y, self.p = SX.sym("t"), SX.sym("y", states), SX.sym("p", p)
        signals = named["coefficients"].shape[1] if "coefficients" in named else 0
        switches = sum(event.kind == "switch" for event in events)
        self.signals, self.branches = SX.sym("signals", signals), SX.sym("branches", switches)
        given = {name: getattr(self, name) for name in ("t", "y", "signals", "branches", "p")}
        inputs = {name: symbols for name, symbols in given.items() if symbols.numel()}
        outputs = [*rates(self), *(values(self) if values else [])]
        column = casadi.densify(casadi.vertcat(*outputs))
        kernel = Kernel("ordinary", inputs, column, (column.numel(),))
        self.motion = TiledKernel(kernel, ("p",) if p else ())
        constraints = None if equations is None else self._constraints(*equations(self))
        self.problem = Problem(
            self.motion.address, states, tuple(events), constraints=constraints, **named
        )

    def _constraints(self, q, F, moved, step) -> Constraints:
        """Equations F(q) = 0, and q moved by a step of the unknowns."""
        along = casadi.jacobian(moved, step)
        both = casadi.vertcat(F, casadi.vec((casadi.jacobian(F, q) @ along).T))
        self.rows = TiledKernel(Kernel("rows", {"q": q}, casadi.densify(both), (both.numel(),)))
        self.move = TiledKernel(Kernel("moved", {"q": q, "step": step}, moved, (q.numel(),)))
        return Constraints(self.rows.address(1), self.move.address(1), F.numel(), q.numel())

    def run(self, method, start, end, *, rtol=1e-8, atol=None, begin=0.0, **named):
        """Runs from starts (runs, states); ``end`` is the last time."""
        own = ("reversal", "closeness", "guard", "exact", "once", "first_step", "largest_step")
        told = {k: named.pop(k) for k in (*own, "max_steps") if k in named}
        tolerances = Tolerances(rtol, np.array([rtol if atol is None else atol]), **told)
        if "p" in named:
            named["prepared"] = self.motion.prepare(np.atleast_2d(named.pop("p")))
        starts = np.atleast_2d(np.array(start, dtype=float))
        call = METHODS[method]
        if call is integrate:
            named.setdefault("width", 1)
        return call(self.problem, starts, (begin, end), tolerances, **named)


def ending(runs, k=0):
    return ENDINGS[int(runs.ending[k])].name


def events(runs, k=0):
    """Times of events by kind, of one run."""
    kinds, times = runs.event_kinds[k], runs.event_times[k]
    return {int(i): times[kinds == i] for i in np.unique(kinds[kinds >= 0])}
