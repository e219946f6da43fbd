"""Laws of the analysis over random mechanisms of all joint types."""

import numpy as np
import pytest

from gough import Robot, load
from gough import algebra as al
from gough.analysis import elimination, ranks
from gough.description import Frame, Mechanism
from gough.description.frames import transform
from gough.errors import DescriptionError
from tests.mechanisms import frame_of, numbers, random_frame, random_mechanism

SEEDS = range(30)


def facts(robot):
    """Everything of the analysis that does not depend on names or on a frame of reference."""
    rates = robot.rates
    return {
        "counts": (rates.counts.actuated, rates.counts.operational),
        "mobility": ranks.mobility(rates.ranks, rates.counts),
        "defects": ranks.defects(rates.ranks, rates.counts, rates.ranks),
        "redundant": rates.E.shape[0] - rates.ranks.E,
    }


def buildable(seed, modelling=None, **options):
    """A robot of a random mechanism, or None if every joint of one of its loops has a motor."""
    try:
        return Robot(random_mechanism(seed, **options), modelling)
    except DescriptionError as error:
        assert "a loop needs a passive joint" in str(error)
        return None


@pytest.mark.parametrize("modelling", ["cut-joints", "cut-platform"])
def test_most_random_mechanisms_can_be_built(modelling):
    built = [seed for seed in SEEDS if buildable(seed, modelling) is not None]
    assert len(built) >= 0.8 * len(SEEDS)


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("planar", [False, True])
def test_identities_of_the_defects(seed, planar):
    robot = buildable(seed, planar=planar)
    if robot is None:
        return
    analysis = robot.analyse()
    for d, m in (
        (analysis.defects, analysis.mobility),
        (analysis.defects_generic, analysis.mobility_generic),
    ):
        a, o = analysis.counts.actuated, analysis.counts.operational
        assert m == d.RPM + d.RO + (a - d.II)
        assert m == d.RPM + d.RI + (o - d.IO)
        assert min(d.RPM, d.RI, d.RO, d.II, d.IO) >= 0
    assert analysis.redundant_equations == sum(item.equations for item in analysis.redundant)
    assert len(analysis.free_motions) == analysis.defects.RPM


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("planar", [False, True])
def test_both_ways_of_modelling_agree(seed, planar):
    first = buildable(seed, "cut-joints", planar=planar)
    second = buildable(seed, "cut-platform", planar=planar)
    if first is None or second is None:
        return
    one, two = facts(first), facts(second)
    del one["redundant"], two["redundant"]  # what is written twice depends on what is cut
    assert one == two
    for J, K in (
        (first.inverse_velocity(), second.inverse_velocity()),
        (first.direct_velocity(), second.direct_velocity()),
    ):
        assert (J.valid, J.unique) == (K.valid, K.unique)
        if J.valid and J.unique:
            size = max(1, np.abs(J.matrix).max(initial=0))
            np.testing.assert_allclose(J.matrix, K.matrix, atol=1e-9 * size)


@pytest.mark.parametrize("seed", SEEDS)
def test_three_constructions_of_the_complement_agree(seed):
    robot = buildable(seed)
    if robot is None:
        return
    rates = robot.rates
    blocks = elimination.by_gram_schmidt(rates)
    complements = [elimination.by_svd(rates), elimination.by_qr(rates), blocks.complement]
    projectors = [O @ O.T for O in complements]
    for O, P in zip(complements, projectors, strict=True):
        np.testing.assert_allclose(O.T @ O, np.eye(O.shape[1]), atol=1e-12)
        np.testing.assert_allclose(O.T @ rates.N, 0, atol=10 * rates.threshold)
        np.testing.assert_allclose(P, projectors[0], atol=1e-6)
    r, n = rates.ranks, rates.E.shape[0]
    sizes = [part.shape[1] for part in (blocks.Q_N, blocks.Q_M, blocks.Q_K, blocks.Q_0)]
    assert sizes == [r.N, r.MN - r.N, r.E - r.MN, n - r.E]


@pytest.mark.parametrize("seed", SEEDS)
def test_maps_agree_with_the_tangent_space(seed):
    """The one-shot construction from ker E, which uses no elimination."""
    robot = buildable(seed)
    if robot is None:
        return
    rates = robot.rates
    a, o = rates.counts.actuated, rates.counts.operational
    V_a, V_x = rates.kernel[:a], rates.kernel[rates.kernel.shape[0] - o :]
    inverse, direct = elimination.inverse_map(rates), elimination.direct_map(rates)
    assert inverse.refused.shape[1] == o - np.linalg.matrix_rank(V_x, tol=1e-7)
    assert direct.refused.shape[1] == a - np.linalg.matrix_rank(V_a, tol=1e-7)
    if inverse.unique:
        np.testing.assert_allclose(inverse.matrix @ V_x, V_a, atol=1e-6)
    if direct.unique:
        np.testing.assert_allclose(direct.matrix @ V_a, V_x, atol=1e-6)


def moved_base(mechanism, T):
    """The mechanism with its base moved as a rigid whole."""
    joints = {}
    for name, joint in mechanism.joints.items():
        frames = tuple(
            frame_of(numbers(al.compose(T, numbers(transform(frame, {})))))
            if body == "base"
            else frame
            for frame, body in zip(joint.frames, joint.bodies, strict=True)
        )
        joints[name] = joint.model_copy(update={"frames": frames})
    bodies = {
        name: body.model_copy(
            update={"home": frame_of(numbers(al.compose(T, numbers(transform(body.home, {})))))}
        )
        if body.home
        else body
        for name, body in mechanism.bodies.items()
    }
    return Mechanism(**{**dict(mechanism), "joints": joints, "bodies": bodies})


@pytest.mark.parametrize("seed", SEEDS)
def test_a_motion_of_the_base_changes_nothing(seed):
    robot = buildable(seed)
    if robot is None:
        return
    T = numbers(transform(random_frame(np.random.default_rng(seed + 1)), {}))
    other = Robot(moved_base(robot.mechanism, T))
    assert facts(robot) == facts(other)


def shuffled(mechanism, rng):
    """The mechanism with its parts renamed and in another order."""
    names = {"base": "base", **{b: f"part-{k}" for k, b in enumerate(mechanism.bodies)}}
    joints = [
        (f"j{k}", joint.model_copy(update={"bodies": tuple(names[b] for b in joint.bodies)}))
        for k, joint in enumerate(mechanism.joints.values())
    ]
    bodies = [(names[name], body) for name, body in mechanism.bodies.items()]
    rng.shuffle(joints)
    rng.shuffle(bodies)
    platform = names[mechanism.platform]
    fields = {"joints": dict(joints), "bodies": dict(bodies), "platform": platform}
    return Mechanism(**{**dict(mechanism), **fields})


@pytest.mark.parametrize("seed", SEEDS)
def test_names_and_order_change_nothing_but_where_loops_are_cut(seed):
    robot = buildable(seed)
    if robot is None:
        return
    other = Robot(shuffled(robot.mechanism, np.random.default_rng(seed)))
    one, two = facts(robot), facts(other)
    assert {k: one[k] for k in ("counts", "mobility", "defects")} == {
        k: two[k] for k in ("counts", "mobility", "defects")
    }


@pytest.mark.parametrize("seed", SEEDS)
def test_the_unit_of_length_changes_no_rank(seed):
    """The same mechanism in millimetres instead of metres."""
    robot = buildable(seed, types=["revolute", "prismatic", "universal", "spherical"])
    if robot is None:
        return
    m = robot.mechanism

    def enlarged(frame):
        return frame.model_copy(update={"point": tuple(1000 * x for x in frame.point)})

    joints = {
        name: j.model_copy(
            update={
                "frames": tuple(enlarged(f) for f in j.frames),
                "home": tuple(1000 * x for x in j.home) if j.type == "prismatic" else j.home,
            }
        )
        for name, j in m.joints.items()
    }
    bodies = {
        name: b.model_copy(update={"home": enlarged(b.home)}) if b.home else b
        for name, b in m.bodies.items()
    }
    assert facts(robot) == facts(
        Robot(Mechanism(**{**dict(m), "joints": joints, "bodies": bodies}))
    )


def test_an_isolated_assembly_has_no_other_configuration():
    """A five-bar stretched out flat has three instantaneous freedoms and can not move."""
    found = load("five-bar", d=2.6, x=1.3, y=0, q=[0, np.pi]).analyse()
    assert (found.mobility, found.generic.samples) == (3, 0)
    assert any("it may be isolated" in warning for warning in found.warnings)


def test_a_singular_home_found_by_a_search_is_not_called_regular_without_a_word():
    found = load("five-bar", d=2.6, x=1.3, y=0, q=[0.01, 3.13]).analyse()
    assert found.assembly.steps > 0
    assert found.rates.margin < 1e-6
    assert any("next to a singularity" in warning for warning in found.warnings)


def test_a_point_of_a_frame_may_be_left_out():
    assert numbers(transform(Frame(), {})) == al.HERE
