"""How many operations models take from the description alone, and that none of it is a fit."""

import numpy as np
import pytest

from gough import catalogue
from gough.description import Mechanism
from gough.dynamics import model as model_module
from gough.dynamics import plans
from gough.dynamics.model import Model
from gough.dynamics.writing import Inputs
from gough.errors import ConfigurationError
from gough.robot import Robot, load
from gough.symbolic.trees.selection import Selector

GUARD = 60
"""Operations that tell singular rows: determinants by their size, numbers that are none."""
PIVOTING = 260
"""What the choice of pivots of a system of six costs, about."""


def thin_orthoglide():
    """The orthoglide with thin uniform bars."""
    content = load("orthoglide").mechanism.model_dump(exclude_unset=True)
    short, long = "0.15*(2*r2)**2/12", "0.22*D4**2/12"
    bar = {"mass": 0.22, "com": ["D4/2", 0, 0], "inertia": [0, long, long]}
    content["legs"]["leg"]["bodies"] = {
        "slider": {"mass": 1.4},
        "fork": {"mass": 0.15, "com": [0, 0, "-r2"], "inertia": [short, short, 0]},
        "bar3": bar,
        "bar7": bar,
        "bar4": {"mass": 0.15, "com": [0, "r2", 0], "inertia": [short, 0, short]},
    }
    return Robot(Mechanism.model_validate(content))


@pytest.mark.parametrize(
    ("name", "inverse", "direct", "turns"),
    [
        ("gough-stewart", 1750 + PIVOTING, 2250 + GUARD, 0),
        ("thin orthoglide", 250 + GUARD, 300 + GUARD, 0),
        ("orthoglide", 750, 1050, 0),
        ("delta-parallelogram", 1200, 1650, 0),
        ("delta", 1200, 1650, 0),
        ("3-rrr", 700, 900, 2),  # of the platform's own angle, which is given
    ],
)
def test_operations_of_models_placed_by_outputs(name, inverse, direct, turns):
    robot = thin_orthoglide() if name == "thin orthoglide" else load(name)
    model = robot.dynamics.model("platform")
    counts = [model.kernel(kind, "x").tape.counts() for kind in ("inverse", "direct")]
    assert counts[0]["total"] <= inverse
    assert counts[1]["total"] <= direct
    assert [c.get("trig", 0) for c in counts] == [turns, turns]


def test_direct_dynamics_of_many_freedoms_by_composite_inertia():
    model = load("biped-leg").dynamics.model("joint")
    inverse, direct = (
        model.kernel(kind, "q").tape.counts()["total"] for kind in ("inverse", "direct")
    )
    forces = model.kernel("forces", "q").tape.counts()["total"]
    assert direct <= 2.5 * max(inverse, forces)


def test_operations_of_legs_without_inertia():
    """Of a leg that is only a length no angle is solved: a root and a quotient each."""
    model = load("deployable-hexapod").dynamics.model("platform")
    for kind, most, fused in (("inverse", 920 + PIVOTING, 970), ("direct", 1140, 820)):
        kernel = model.kernel(kind, "x")
        counts = kernel.tape.counts()
        assert counts["total"] <= most
        assert kernel.program.operations <= fused
        assert counts["sqrt"] == 6
        assert counts["div"] == 12
        assert not counts.get("trig", 0)


def with_massless_legs(name):
    """A robot of which only the platform has inertia, and motors on its slides."""
    content = load(name).mechanism.model_dump(exclude_unset=True)
    for leg in content["legs"].values():
        for body in leg["bodies"].values():
            body["mass"], body["inertia"] = 0, [0, 0, 0]
        for joint in leg["joints"].values():
            if joint.get("actuated"):
                joint["motor"] = {"inertia": 0.01, "ratio": 3}
    return Robot(Mechanism.model_validate(content))


@pytest.mark.parametrize("space", ["platform", "joint"])
@pytest.mark.parametrize("name", ["gough-stewart", "6-sps", "3-upu", "tricept", "3-rpr"])
def test_rates_of_lengths_say_the_same(name, space, monkeypatch):
    """Models by the lengths of massless legs, and by the motion of their tips."""
    robot = with_massless_legs(name)
    args = robot.models, robot.assembler, robot.home.q, space
    one = Model(*args, regrouped=False, searched=False)
    monkeypatch.setattr(Selector, "_lengths", lambda *_: {})
    other = Model(*args, regrouped=False, searched=False)
    rng = np.random.default_rng(14)
    q = [robot.assembler.wander(robot.home.q, rng, 0.5) for _ in range(4)]
    q = np.array([at for at in q if at is not None])
    y, yd = rng.normal(size=(2, len(q), len(one.given)))
    for kind, *rates in (("forces", y, yd), ("mass_matrix",), ("motor_jacobian",), ("rates", y)):
        found, expected = (model.kernel(kind, "q")(q, *rates) for model in (one, other))
        np.testing.assert_allclose(found, expected, atol=1e-9 * np.abs(expected).max())
    fewer, more = (model.kernel("forces", "q").program.operations for model in (one, other))
    assert fewer < more


@pytest.mark.parametrize("name", ["gough-stewart", "6-sps", "3-upu"])
def test_a_wrench_on_a_massless_leg_is_felt(name, monkeypatch):
    """What acts on a leg feels its angles, which lengths do not tell."""
    robot = with_massless_legs(name)
    args = robot.models, robot.assembler, robot.home.q, "platform"
    one = Model(*args, regrouped=False, searched=False)
    monkeypatch.setattr(Selector, "_lengths", lambda *_: {})
    other = Model(*args, regrouped=False, searched=False)
    body = next(body for body in robot.structure.flat.bodies if body.startswith("leg1."))
    rng = np.random.default_rng(15)
    y, yd, wrench = rng.normal(size=(3, len(one.given)))
    inputs = Inputs(bodies=(body,))
    found, expected = (
        model.kernel("forces", "q", inputs)(robot.home.q, y, yd, np.resize(wrench, 6))
        for model in (one, other)
    )
    np.testing.assert_allclose(found, expected, atol=1e-10 * np.abs(expected).max())
    without = one.kernel("forces", "q")(robot.home.q, y, yd)
    assert np.abs(found - without).max() > 0.1


@pytest.mark.parametrize("name", sorted(catalogue.names()))
def test_moved_inertia_moves_alike(name):
    """Equivalent inertia against that of the description, far from where anything was read."""
    robot = load(name)
    space = "platform" if robot.structure.columns("operational") else "joint"
    home = robot.home.q
    models = [
        Model(robot.models, robot.assembler, home, space, regrouped=r, searched=False)
        for r in (True, False)
    ]
    rng = np.random.default_rng(11)
    q = [robot.assembler.wander(home, rng, 0.7) for _ in range(8)]
    q = np.array([at for at in q if at is not None])
    y, yd = rng.normal(size=(2, len(q), len(models[0].independent)))
    p = [robot.assembler.p] * bool(robot.assembler.p.size)
    one, other = (model.kernel("forces", "q")(q, *p, y, yd) for model in models)
    row = np.abs(other).max(axis=1, keepdims=True)
    regular = row < 1e4 * np.median(row)  # near a singularity rounding is as large as the forces
    np.testing.assert_allclose((one - other) / row, np.zeros_like(one), atol=1e-10, rtol=0)
    assert regular.any()
    A, B = (model.kernel("mass_matrix", "q")(q, *p) for model in models)
    size = np.abs(B).max(axis=(1, 2), keepdims=True)
    np.testing.assert_allclose((A - B) / size, np.zeros_like(A), atol=1e-10, rtol=0)


@pytest.mark.parametrize("name", ["orthoglide", "delta-parallelogram", "3-rrr", "tripteron"])
def test_every_tree_gives_the_same(name):
    """Each way to cut the loops, and the one in which the platform is cut in pieces."""
    robot = load(name)
    outputs = robot.structure.columns("operational")
    rng = np.random.default_rng(12)
    x = np.array([robot.home.x] * 4)
    x[1:, :2] += rng.uniform(-0.02, 0.02, size=(3, 2))
    xd, xdd = rng.normal(size=(2, 4, len(outputs)))
    expected = robot.inverse_dynamics(x, xd, xdd)
    tried = 0
    for plan in plans.plans(robot.structure):
        other = plans.planned(plan, robot.models, robot.assembler, robot.home.q)
        if other is None:
            continue
        model = Model(other.models, other.assembler, other.home, "platform", searched=False)
        if "x" in model.places:
            found = model.kernel("inverse", "x")(x, xd, xdd)[:, :-1]
            np.testing.assert_allclose(found, expected, atol=1e-9 * np.abs(expected).max())
            tried += 1
    assert tried >= 2


@pytest.mark.parametrize("name", ["gough-stewart", "delta", "orthoglide", "tricept", "3-rps"])
def test_both_ways_of_modelling_give_the_same(name):
    """The platform as a free link, and cut into pieces that only closings keep parallel to it."""
    one, other = (load(name, modelling) for modelling in ("cut-joints", "cut-platform"))
    rng = np.random.default_rng(13)
    xd, xdd = rng.normal(size=(2, len(one.structure.columns("operational"))))
    expected = one.inverse_dynamics(one.home.x, xd, xdd)
    found = other.inverse_dynamics(one.home.x, xd, xdd)
    np.testing.assert_allclose(found, expected, atol=1e-9 * np.abs(expected).max())


@pytest.mark.parametrize("name", ["andrews-squeezer", "bennett", "gough-stewart"])
def test_false_relations_between_rates_are_seen(name, monkeypatch):
    """Rates that seem to follow from others at a few states, as seven of a mechanism with one
    freedom may: inverse and direct dynamics would be consistent, and accelerations wrong."""
    robot = load(name)
    space = "platform" if robot.structure.columns("operational") else "joint"
    true = Model(robot.models, robot.assembler, robot.home.q, space, searched=False)

    def fitted(E, order, unit, telling):
        """Relations that hold at home only."""
        few = list(true.independent)
        motions = np.linalg.svd(E[0])[2][np.linalg.matrix_rank(E[0], 1e-9) :].T
        C = motions @ np.linalg.pinv(motions[few])
        return tuple(few), unit[:, None] * C / unit[few]

    monkeypatch.setattr(model_module, "relations", fitted)
    with pytest.raises(ConfigurationError, match="does not hold farther away"):
        Model(robot.models, robot.assembler, robot.home.q, space, searched=False)
