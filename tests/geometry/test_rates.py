"""Velocities and accelerations of every robot of the catalogue, and the orthoglide's numbers."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from gough import catalogue, load
from gough.analysis import elimination
from gough.analysis.ranks import linearise
from gough.assembly import Assembler
from gough.description import Mechanism
from gough.errors import ConfigurationError, UnknownName
from gough.geometry.rates import Kinematics
from gough.geometry.samples import Sampled, sample
from gough.robot import Robot

DATA = json.loads((Path(__file__).parents[1] / "data" / "orthoglide.json").read_text("utf-8"))
CASES = DATA["cases"]
WITH_OUTPUTS = [n for n in catalogue.names() if n not in ("andrews-squeezer", "biped-leg")]
ROWS, STEP = 20, 1e-5


def close_to(actual, expected, tolerance=1e-10):
    scale = max(1.0, float(np.abs(expected).max(initial=0.0)))
    np.testing.assert_allclose(actual, expected, rtol=0, atol=tolerance * scale)


# the orthoglide


@pytest.fixture(scope="module")
def orthoglide():
    robot = load("orthoglide")
    return Kinematics(robot.models, robot.assembler)


def configuration(kinematics, P, legs):
    """All positions of the tree from those of the platform and of q1, q2, q3 of each leg."""
    structure = kinematics.models.structure
    q = np.zeros(kinematics.models.positions)
    given = {"platform.x": P[0], "platform.y": P[1], "platform.z": P[2]}
    for k, (q1, q2, q3) in enumerate(legs):
        joints = {"slide": q1, "j2": q2, "j3": q3, "j4": -q3, "j7": q3, "j5": -q2 - np.pi / 2}
        given |= {f"leg{k + 1}.{name}": value for name, value in joints.items()}
    for variable in structure.variables:
        part = kinematics.models.closure.slices[variable.edge]
        if variable.name in given:
            q[part.start + variable.freedom] = given[variable.name]
    q[3] = 1.0
    return q


@pytest.fixture(scope="module")
def glide_cases(orthoglide):
    return np.array([configuration(orthoglide, case["P"], case["q"]) for case in CASES])


def of_legs(kinematics, v):
    """Rates of q1, q2, q3 of each leg: (*batch, 3, 3)."""
    index = {x.name: k for k, x in enumerate(kinematics.models.structure.variables)}
    names = [[index[f"leg{i}.{joint}"] for joint in ("slide", "j2", "j3")] for i in (1, 2, 3)]
    return v[..., np.array(names)]


def reference(key):
    return np.array([case[key] for case in CASES])


def test_orthoglide_rates_and_accelerations(orthoglide, glide_cases):
    V, A = reference("V"), reference("A")
    v = orthoglide.velocity(glide_cases, V)
    close_to(of_legs(orthoglide, v), reference("qdot"))
    close_to(of_legs(orthoglide, orthoglide.acceleration(glide_cases, V, A)), reference("qddot"))
    back = orthoglide.velocity_from_actuated(glide_cases, of_legs(orthoglide, v)[..., 0])
    close_to(back, v, 1e-9)


def test_orthoglide_jacobians(orthoglide, glide_cases):
    close_to(orthoglide.inverse_jacobian(glide_cases), reference("Jp_inv"))
    close_to(
        orthoglide.jacobian(glide_cases) @ reference("Jp_inv"), np.tile(np.eye(3), (24, 1, 1)), 1e-9
    )
    close_to(orthoglide.velocity_factors(glide_cases), reference("velocity_factors"))


def test_orthoglide_legs(orthoglide, glide_cases):
    v = orthoglide.velocity(glide_cases, reference("V"))
    for k, leg in enumerate(("leg1", "leg2", "leg3")):
        assert orthoglide.leg_variables(leg) == tuple(f"{leg}.{j}" for j in ("slide", "j2", "j3"))
        close_to(orthoglide.leg_jacobian(glide_cases, leg), reference("J_legs")[:, k])
        close_to(orthoglide.inverse_leg_jacobian(glide_cases, leg), reference("Jinv_legs")[:, k])
        close_to(orthoglide.leg_bias(glide_cases, v, leg), reference("Jdot_qdot")[:, k])


def test_orthoglide_factors_in_the_cube(orthoglide, glide_cases):
    assert CASES[1]["P"][0] > 0 > CASES[2]["P"][0]
    plus, minus = orthoglide.velocity_factors(glide_cases[[1, 2]])
    np.testing.assert_allclose(plus, [0.5, 2, 2], atol=1e-9)
    np.testing.assert_allclose(minus, [0.8, 0.8, 2], atol=1e-9)
    np.testing.assert_allclose(orthoglide.conditioning(glide_cases[0]), 1, atol=1e-12)
    np.testing.assert_allclose(orthoglide.manipulability(glide_cases[1]), 2, atol=1e-9)


def test_orthoglide_is_solved_leg_by_leg_in_few_operations(orthoglide):
    found = orthoglide.from_operational
    assert max(len(block.unknowns) for block in found.plan.blocks) <= 3
    assert found.rates.tape.counts()["total"] < 120
    assert found.accelerations.tape.counts()["total"] < 300


def test_gough_stewart_has_six_blocks_of_three():
    kinematics = kinematics_of("gough-stewart")
    sizes = [len(block.unknowns) for block in kinematics.from_operational.plan.blocks]
    assert sizes == [3] * 6
    assert kinematics.from_operational.rates.tape.counts()["total"] < 700


# every robot

_built = {}


def kinematics_of(name):
    if name not in _built:
        robot = load(name)
        _built[name] = Kinematics(robot.models, robot.assembler)
    return _built[name]


def configurations(kinematics, count=ROWS, seed=7):
    rng = np.random.default_rng(seed)
    found = []
    while len(found) < count:
        q = kinematics.assembler.wander(kinematics.home, rng, rng.uniform(0.1, 0.6))
        if q is not None:
            found.append(q)
    return np.array(found), rng


def maps_of(kinematics):
    """Each map that the mechanism has, and its name."""
    structure = kinematics.models.structure
    return [
        (role, getattr(kinematics, f"from_{role}"))
        for role in ("operational", "actuated")
        if structure.columns(role)
    ]


def given_rates(kinematics, found, role, q, rng):
    """Rates that some motion has, of random size."""
    if not found.restricted:
        return rng.normal(size=(len(q), len(found.plan.inputs)))
    rows = []
    for at in q:
        motions = linearise_columns(kinematics, at)
        rows.append((motions @ rng.normal(size=motions.shape[1]))[list(found.plan.inputs)])
    return np.array(rows)


def linearise_columns(kinematics, q):
    """Motions in SI units, (variables, m)."""
    E = kinematics.models.jacobian(q, kinematics.assembler.p)
    _, s, Vt = np.linalg.svd(E * kinematics.assembler.rate_scale)
    return kinematics.assembler.rate_scale[:, None] * Vt[int(np.sum(s > 1e-9 * s[0])) :].T


def velocity(kinematics, role, q, y):
    if role == "operational":
        return kinematics.velocity(q, y)
    return kinematics.velocity_from_actuated(q, y)


@pytest.mark.parametrize("name", catalogue.names())
def test_rates_obey_the_closure_and_keep_what_is_given(name):
    kinematics = kinematics_of(name)
    q, rng = configurations(kinematics)
    for role, found in maps_of(kinematics):
        y = given_rates(kinematics, found, role, q, rng)
        v = velocity(kinematics, role, q, y)
        E = kinematics.models.jacobian(q, kinematics.assembler.p)
        gap = np.abs(np.einsum("nij,nj->ni", E, v)).max(axis=1)
        assert (gap <= 1e-10 * np.maximum(1, np.abs(v).max(axis=1))).all()
        close_to(v[:, list(found.plan.inputs)], y, 1e-12)
        close_to(np.einsum("nij,nj->ni", found.matrix(q, kinematics.assembler.p), y), v, 1e-9)


@pytest.mark.parametrize("name", WITH_OUTPUTS)
def test_jacobians_agree_with_elimination(name):
    kinematics = kinematics_of(name)
    q, _ = configurations(kinematics)
    scale, columns = kinematics.assembler.rate_scale, kinematics.models.structure.columns
    motors, outputs = scale[columns("actuated")], scale[columns("operational")]
    for at, inverse, direct in zip(
        q, kinematics.inverse_jacobian(q), kinematics.jacobian(q), strict=True
    ):
        rates = linearise(kinematics.assembler, at)
        close_to(inverse, elimination.inverse_map(rates).in_units(motors, outputs).matrix, 1e-9)
        close_to(direct, elimination.direct_map(rates).in_units(outputs, motors).matrix, 1e-9)


def neighbours(kinematics, q, v, inputs):
    """Closed configurations a small step ahead and behind along v, of one configuration."""
    models = kinematics.models
    held = np.isin(np.arange(len(v)), inputs)
    found = []
    for step in (STEP, -STEP):
        solution = kinematics.assembler.close(models.retract(q, step * v), held)
        found.append(solution.q)
    return found


def position_rates(kinematics, q, v):
    """dq/dt = H v by small retractions, which need no closure."""
    ahead, behind = (kinematics.models.retract(q, step * v) for step in (STEP, -STEP))
    return (ahead - behind) / (2 * STEP)


@pytest.mark.parametrize("name", catalogue.names())
def test_velocities_and_accelerations_are_slopes_of_a_closed_motion(name):
    kinematics = kinematics_of(name)
    models, p = kinematics.models, kinematics.assembler.p
    q, rng = configurations(kinematics, 3)
    for role, found in maps_of(kinematics):
        y = given_rates(kinematics, found, role, q, rng)
        y /= np.abs(velocity(kinematics, role, q, y)).max(axis=1, keepdims=True)
        yd = np.zeros_like(y) if found.restricted else rng.normal(size=y.shape)
        v = velocity(kinematics, role, q, y)
        vd = found.accelerations(q, p, v, yd)
        for k in range(len(q)):
            ahead, behind = neighbours(
                kinematics, q[k], v[k], () if found.restricted else found.plan.inputs
            )
            rates = position_rates(kinematics, q[k], v[k])
            close_to((ahead - behind) / (2 * STEP), rates, 1e-6)
            slope = (models.jacobian(ahead, p) - models.jacobian(behind, p)) / (2 * STEP)
            E = models.jacobian(q[k], p)
            if not found.restricted:
                close_to(E @ vd[k], -slope @ v[k], 1e-7 * max(1, np.abs(vd[k]).max()))
            if found.unique and not found.restricted:
                there = np.array([ahead, behind])
                moved = velocity(
                    kinematics, role, there, y[k] + STEP * np.array([[1], [-1]]) * yd[k]
                )
                close_to(vd[k], (moved[0] - moved[1]) / (2 * STEP), 2e-5)


@pytest.mark.parametrize("name", ["2rpr", "delta", "gough-stewart", "3-rps"])
def test_accelerations_from_outputs_and_from_motors_agree(name):
    kinematics = kinematics_of(name)
    q, rng = configurations(kinematics)
    columns = kinematics.models.structure.columns
    xd, xdd = rng.normal(size=(2, ROWS, len(columns("operational"))))
    v, vd = kinematics.velocity(q, xd), kinematics.acceleration(q, xd, xdd)
    motors = columns("actuated")
    back = kinematics.acceleration_from_actuated(q, v[:, motors], vd[:, motors])
    close_to(back, vd, 1e-7)


# redundancy


def test_spinning_legs_stay_at_rest():
    kinematics = kinematics_of("6-sps")
    assert not kinematics.from_operational.unique
    v = kinematics.velocity(kinematics.home, [0.1, 0, 0.2, 0, 0.3, 0])
    moves = linearise_columns(kinematics, kinematics.home)
    spins = moves @ null(moves[kinematics.models.structure.columns("operational")])
    assert spins.shape[1] == 6
    close_to((spins / kinematics.assembler.rate_scale[:, None] ** 2).T @ v, np.zeros(6))


def null(A):
    _, s, Vt = np.linalg.svd(A)
    return Vt[int(np.sum(s > 1e-9 * s[0])) :].T


def test_redundant_motors_must_fit():
    kinematics = kinematics_of("4-rpr")
    assert kinematics.from_actuated.restricted
    v = kinematics.velocity(kinematics.home, [0.1, -0.2, 0.3])
    motors = v[kinematics.models.structure.columns("actuated")]
    close_to(kinematics.velocity_from_actuated(kinematics.home, motors), v)
    with pytest.raises(ConfigurationError, match="no motion with the given rates"):
        kinematics.velocity_from_actuated(kinematics.home, motors + np.eye(4)[0])
    with pytest.raises(ConfigurationError, match="has no determinant"):
        kinematics.determinant_sign(kinematics.home)


def test_a_floating_base_stays_at_rest():
    kinematics = kinematics_of("biped-leg")
    v = kinematics.velocity_from_actuated(kinematics.home, [0.1, 0.2, 0.3, 0.4])
    np.testing.assert_array_equal(v[:6], 0)


# measures


def test_a_type_2_singularity_shows_in_every_measure():
    quarter = {"rz": np.pi / 2, "x": 0, "y": 0, "rx": 0, "ry": 0}
    near, beyond = (
        load("gough-stewart", **(quarter | {"rz": np.pi / 2 + e})) for e in (-0.01, 0.01)
    )
    kinematics = Kinematics(near.models, near.assembler)
    q = np.array([near.home.q, beyond.home.q])
    np.testing.assert_array_equal(kinematics.determinant_sign(q), [1, -1])
    assert (kinematics.type_2(q) < 0.01).all()
    assert (kinematics.type_1(q) > 0.1).all()
    assert (kinematics.conditioning(q) > 100).all()
    there = load("gough-stewart", **quarter)
    measure = Kinematics(there.models, there.assembler)
    assert measure.type_2(there.home.q) < 1e-9
    assert measure.conditioning(there.home.q) > 1e9
    with pytest.raises(ConfigurationError, match="singular for"):
        measure.jacobian(there.home.q)


def test_the_sign_of_the_determinant_is_that_of_the_equations_with_the_motors_locked():
    kinematics = kinematics_of("3-rpr")
    q, _ = configurations(kinematics, 40)
    columns = kinematics.models.structure.columns
    locked = columns("passive") + columns("operational")
    signs, home = (
        np.linalg.slogdet(kinematics.models.jacobian(at, kinematics.assembler.p)[..., locked])[0]
        for at in (q, kinematics.home)
    )
    np.testing.assert_array_equal(kinematics.determinant_sign(q), signs * home)
    assert set(signs) == {-1, 1}


# what is refused


def test_open_configurations_are_refused_with_their_row():
    robot = load("five-bar")
    kinematics = Kinematics(robot.models, robot.assembler)
    q = np.array([robot.home.q] * 3)
    open_ = q.copy()
    open_[1, 0] += 0.1
    with pytest.raises(ConfigurationError, match=r"row 1 is not closed"):
        kinematics.velocity(open_, [0.1, 0.2])
    nan = q.copy()
    nan[2] = np.nan
    with pytest.raises(ConfigurationError, match=r"row 2 is not closed"):
        kinematics.velocity(nan, [0.1, 0.2])


def test_a_singular_leg_is_refused_with_its_row_and_its_joints():
    """2RPR at a leg length of zero: the leg spins and the point leaves along the leg only."""
    robot = load("2rpr")
    kinematics = Kinematics(robot.models, robot.assembler)
    q = np.array([robot.home.q] * 2)
    q[1] = configuration_of_zero_leg(kinematics)
    with pytest.raises(ConfigurationError, match=r"row 1 is singular for leg1.pin, leg1.slide"):
        kinematics.velocity(q, [0.1, 0.2])
    assert kinematics.regularity(q)[1] < 1e-12 < 0.1 < kinematics.regularity(q)[0]


def configuration_of_zero_leg(kinematics):
    index = {v.name: k for k, v in enumerate(kinematics.models.structure.variables)}
    q = np.zeros(kinematics.models.positions)
    q[index["leg2.pin"]], q[index["leg2.slide"]] = np.pi, 1.0
    return q


def test_mechanisms_without_outputs_say_so():
    kinematics = kinematics_of("andrews-squeezer")
    with pytest.raises(ConfigurationError, match="andrews-squeezer has no outputs; declare some"):
        kinematics.velocity(kinematics.home, [])


def test_a_leg_that_does_not_determine_the_platform_says_so():
    kinematics = kinematics_of("gough-stewart")
    with pytest.raises(ConfigurationError, match="leg1 has 3 independent rates and the platform 6"):
        kinematics.leg_jacobian(kinematics.home, "leg1")
    with pytest.raises(UnknownName, match="no leg is named 'leg9'"):
        kinematics.leg_variables("leg9")
    assert kinematics.inverse_leg_jacobian(kinematics.home, "leg1").shape == (3, 6)


def test_another_assembly_is_no_silent_number():
    """A parallelogram turned into its antiparallelogram: pins no longer turn alike."""
    robot = load("four-bar", a=0.25, c=0.25, b=0.35, d=0.35)
    kinematics = Kinematics(robot.models, robot.assembler)
    assert len(kinematics.from_actuated.plan.kept) == 1
    index = {v.name: k for k, v in enumerate(kinematics.models.structure.variables)}
    q = kinematics.home.copy()
    held = np.zeros(len(index), dtype=bool)
    held[kinematics.models.structure.columns("actuated")] = True
    rng = np.random.default_rng(0)
    for _ in range(200):
        start = np.where(held, q, rng.uniform(-3, 3, len(q)))
        solution = robot.assembler.close(start, held)
        far = np.abs(np.sin((solution.q - q) / 2)).max()
        if solution.ending.name == "closed" and far > 0.2:
            break
    with pytest.raises(ConfigurationError, match="another assembly than home"):
        kinematics.velocity_from_actuated(solution.q, [1.0])


# what the samples tell


def test_live_parameters_may_change_after_the_equations_are_chosen():
    """Relations are those that hold for other values too: bars of a pair stay parallel."""
    robot = live_robot("delta", ("arm", "bar"))
    for values in ({}, {"arm": 0.36, "bar": 0.78}):
        assembler = Assembler(robot.models, robot.models.parameters(values))
        kinematics = Kinematics(robot.models, assembler)
        assert len(kinematics.from_operational.plan.kept) == 12
        v = kinematics.velocity(kinematics.home, [0.1, 0.2, -0.3])
        E = robot.models.jacobian(kinematics.home, assembler.p)
        close_to(E @ v, np.zeros(len(E)), 1e-12)


def live_robot(name, parameters):
    mechanism = load(name).mechanism
    changed = dict(mechanism.parameters)
    for key in parameters:
        changed[key] = changed[key].model_copy(update={"live": True})
    return Robot(Mechanism(**{**dict(mechanism), "parameters": changed}))


def test_few_samples_tell_nothing_and_all_equations_are_kept():
    kinematics = kinematics_of("orthoglide")
    other = Kinematics(kinematics.models, kinematics.assembler)
    whole = sample(kinematics.assembler, kinematics.home, 0)
    one = replace(whole.samples, q=whole.samples.q[:1], p=whole.samples.p[:1], telling=False)
    E_open = np.random.default_rng(0).normal(size=(1, *whole.E.shape[1:]))
    other._sampled = Sampled(one, whole.E[:1], E_open)
    assert len(other.from_operational.plan.kept) == whole.E.shape[2]
    v = other.velocity(kinematics.home, [0.1, 0.2, 0.3])
    close_to(v, kinematics.velocity(kinematics.home, [0.1, 0.2, 0.3]))


def test_a_seed_changes_nothing_but_rounding():
    kinematics = kinematics_of("bennett")
    other = Kinematics(kinematics.models, kinematics.assembler, seed=3)
    q, _ = configurations(kinematics)
    close_to(other.jacobian(q), kinematics.jacobian(q))
