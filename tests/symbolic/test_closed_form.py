"""Positions in closed form against the closed configurations they stand for."""

import casadi
import numpy as np
import pytest

from gough.geometry.samples import sample
from gough.robot import load
from gough.symbolic import plans
from gough.symbolic.trees.closed_form import ClosedForm
from gough.symbolic.trees.nodes import Tree

SX = casadi.SX
COMPLETE = [
    *["2rpr", "3-prr", "3-rpr", "3-rrr", "3-upu", "4-rpr", "agile-eye", "bennett", "delta"],
    *["delta-parallelogram", "deployable-hexapod", "five-bar", "gough-stewart", "hexa"],
    *["linear-delta", "orthoglide", "par4", "sarrus", "slider-crank", "tripteron"],
]
TWO_MODES = {
    "6-ups": {"leg4.foot.rx", "leg4.foot.ry"},
    "hexaglide": {"leg2.slide", "leg2.head.ry", "leg5.slide", "leg5.head.ry"},
    "four-bar": {"A", "B"},
}
"""Samples of these lie in more than one working mode: variables whose branches differ."""
OPEN = {
    "2rpr-slider": "the outputs do not settle the leg with two sliders",
    "3-rps": "the platform turns in ways that are no outputs",
    "tricept": "the platform turns in ways that are no outputs",
    "6-sps": "a spherical joint has no closed form here",
    "bricard": "no equation holds one unsolved angle",
}
TOLERANCE = 1e-11
BENT = [casadi.OP_TAN, casadi.OP_ASIN, casadi.OP_ACOS, casadi.OP_ATAN, casadi.OP_ATAN2]


class Case:
    """Closed forms of a robot from its outputs, and what they are at a configuration."""

    def __init__(self, name, first_mode=False):
        self.robot = load(name)
        structure, assembler = self.robot.structure, self.robot.assembler
        sampled = sample(assembler, self.robot.home.q, 0)
        count, actuated = len(structure.variables), structure.columns("actuated")
        self.given = structure.columns("operational")
        y = plans.best_independent(sampled.E, [*self.given, *actuated], range(count))
        priority = list(dict.fromkeys([*y, *actuated, *range(count)]))
        self.samples = sampled.samples
        kept, C = plans.relations(
            sampled.E, priority, self.samples.rate_scale, self.samples.telling
        )
        tree = Tree(self.robot.models.closure, self.samples, C)
        self.form = ClosedForm(tree, C, kept, self.given, first_mode)
        self.nodes = {node.variables[0]: node for node in tree.nodes if node.variables}
        places = self.form.known.values()
        flat = [SX(x) for place in places for x in (place if isinstance(place, tuple) else [place])]
        closure = self.robot.models.closure
        column = casadi.densify(casadi.vertcat(*flat, SX(0, 1)))
        self.function = casadi.Function("places", [closure.q, closure.p], [column])

    @property
    def left(self):
        return {self.robot.structure.variables[v].name for v in self.form.left}

    def gap(self, q, p):
        """The largest difference between closed forms and a configuration."""
        found = []
        for v, place in self.form.known.items():
            x = q[self.nodes[v].place.start]
            found += [np.cos(x), np.sin(x)] if isinstance(place, tuple) else [x]
        return np.abs(np.array(self.function(q, p)).ravel() - found).max(initial=0.0)


@pytest.mark.parametrize("name", COMPLETE)
def test_a_closed_form_is_where_the_joints_are(name):
    case, rng = Case(name), np.random.default_rng(1)
    assert not case.form.left
    assembler, home = case.robot.assembler, case.robot.home.q
    found = [assembler.wander(home, rng, 0.3) for _ in range(10)]
    gaps = [case.gap(q, assembler.p) for q in [home, *found] if q is not None]
    assert len(gaps) > 5
    assert max(gaps) < TOLERANCE
    _assert_plain(case)


def _assert_plain(case):
    """No angle is found but from its cosine and sine; none is read that is not given."""
    codes = [case.function.instruction_id(k) for k in range(case.function.n_instructions())]
    assert not set(codes) & set(BENT)
    turns = [v for v, node in case.nodes.items() if node.kind == "turn" and v not in case.given]
    asked = case.function.jac_sparsity(0, 0)
    columns = set(asked.get_col())
    assert not columns & {case.nodes[v].place.start for v in turns}


@pytest.mark.parametrize("name", TWO_MODES)
def test_a_variable_with_samples_in_two_modes_is_left(name):
    case = Case(name)
    assert case.left == TWO_MODES[name]
    assert all(case.gap(q, p) < TOLERANCE for q, p in _pairs(case))


@pytest.mark.parametrize("name", TWO_MODES)
def test_of_two_modes_that_of_the_first_sample_may_be_taken(name):
    case = Case(name, first_mode=True)
    assert not case.left
    gaps = np.array([case.gap(q, p) for q, p in _pairs(case)])
    near = gaps < TOLERANCE
    assert near[0]
    assert not near.all()
    np.testing.assert_array_equal(near, case.form.in_mode)


def _pairs(case):
    return zip(case.samples.q, case.samples.p, strict=True)


@pytest.mark.parametrize("name", OPEN)
def test_what_outputs_do_not_settle_is_left(name):
    assert Case(name).left
