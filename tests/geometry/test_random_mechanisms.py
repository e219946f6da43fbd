"""Assembly modes of random mechanisms against Newton's method from many starts."""

import numpy as np
import pytest
from hypothesis import settings

import gough
from gough import algebra as al
from gough.description import Body, Joint, Mechanism
from gough.description.frames import transform
from gough.geometry.closing import Closing
from gough.geometry.coordinates import Coordinates
from gough.joints import TYPES
from tests.mechanisms import (
    frame_of,
    numbers,
    random_frame,
    random_mechanism,
    random_position,
    written,
)

LONG = settings.get_current_profile_name() == "long"
STARTS = 1000 if LONG else 300
"""Random starts of Newton's method for each mechanism."""
CLOSED = 1e-9
"""Largest closure residual of a configuration that counts: sines, characteristic lengths."""
SAME = 1e-5
"""Poses that differ by less are one: entries of rotations, characteristic lengths."""
REGULAR = 1e-6
"""Least singular value of the equations, relative to the largest, at a solution that counts."""

LETTERS = {
    "R": "revolute", "P": "prismatic", "C": "cylindrical", "U": "universal", "S": "spherical",
}  # fmt: skip
ONE = ["SP*S", "P*SS", "R*SS"]
TWO = ["RP*S", "R*RS", "R*PS", "P*RS"]
THREE = ["R*P*S", "R*R*S", "P*P*S"]
"""Legs from base to platform that take one, two or three freedoms of it with their motors (*)
locked."""
PLATFORMS = [(TWO,) * 3, (THREE, TWO, ONE), (ONE,) * 6]
SLOW = [
    ([*ONE, "UP*S", "P*US", "R*US"],) * 6,
    ([*TWO, "R*CU", "P*CU"],) * 3,
    (TWO, TWO, ONE, ONE),
    (["R*RU", "P*RU"], TWO, ONE),
]
"""Whose start solutions take seconds or more."""


# mechanisms


def platform_on_legs(legs, seed):
    """A robot whose legs are words as "RP*S", from base to platform, all frames random."""
    rng = np.random.default_rng(seed)
    spherical = TYPES["spherical"]
    turn, _ = numbers(spherical.placement(random_position(spherical, rng), {}))
    poses = {"base": al.HERE, "platform": (turn, tuple(rng.uniform(-0.5, 0.5, 3).tolist()))}
    bodies, joints = {"platform": Body(home=frame_of(poses["platform"]))}, {}
    for n, leg in enumerate(legs):
        links = [f"link{n}{k}" for k in range(len(leg.replace("*", "")) - 1)]
        bodies |= {link: Body() for link in links}
        ends = zip(["base", *links], [*links, "platform"], strict=True)
        actuated = [leg[k + 1 : k + 2] == "*" for k, letter in enumerate(leg) if letter != "*"]
        for k, (letter, (a, b)) in enumerate(zip(leg.replace("*", ""), ends, strict=True)):
            joints[f"joint{n}{k}"] = joined(LETTERS[letter], a, b, actuated[k], poses, rng)
    return gough.Robot(
        Mechanism(
            name="+".join(legs),
            bodies=bodies,
            joints=joints,
            platform="platform",
            operational=("x", "y", "z", "rx", "ry", "rz"),
        )
    )


def joined(type_name, a, b, actuated, poses, rng):
    """A joint at a random position between two bodies; the second is placed if it is not yet."""
    kind = TYPES[type_name]
    q = random_position(kind, rng)
    on_a, on_b = random_frame(rng), random_frame(rng)
    across = al.compose(numbers(transform(on_a, {})), numbers(kind.placement(q, {})))
    joint = al.compose(poses[a], across)
    if b in poses:
        on_b = frame_of(numbers(al.compose(al.inverse(poses[b]), joint)))
    else:
        poses[b] = numbers(al.compose(joint, al.inverse(numbers(transform(on_b, {})))))
    return Joint(
        type=type_name, bodies=(a, b), frames=(on_a, on_b), home=written(kind, q), actuated=actuated
    )


def planar_with_motors(seed, bodies, closings):
    """A random planar robot with as many motors, at random joints, as it has freedoms."""
    mechanism = random_mechanism(seed, bodies=bodies, closings=closings, planar=True, roles=False)
    robot = gough.Robot(mechanism)
    E = robot.assembler.scaled_jacobian(robot.home.q)
    places = {
        edge.name: [k for k, v in enumerate(robot.structure.variables) if v.edge == n]
        for n, edge in enumerate(robot.structure.edges)
    }
    joints, passive = dict(mechanism.joints), list(range(E.shape[1]))
    for name in np.random.default_rng(seed).permutation([n for n in places if n in joints]):
        left = [k for k in passive if k not in places[name]]
        if freedoms(E[:, passive]) - freedoms(E[:, left]) == len(places[name]):
            joints[name] = joints[name].model_copy(update={"actuated": True})
            passive = left
    assert not freedoms(E[:, passive])
    return gough.Robot(mechanism.model_copy(update={"joints": joints}))


def freedoms(E):
    return E.shape[1] - rank(E)


def rank(E):
    s = np.linalg.svd(E, compute_uv=False)
    return int(np.sum(s > REGULAR * s.max(initial=0)))


# the search


def search(robot, seed=0):
    """Closed configurations with home's motors, a regular one for each pose that was met."""
    models, assembler = robot.models, robot.assembler
    actuated = Coordinates(models, "actuated")
    rng = np.random.default_rng(seed)
    reach = np.where(models.rate_is_length, 2 * assembler.length, np.pi)
    steps = reach * rng.uniform(-1, 1, (STARTS, len(reach))) * rng.choice([0.3, 1], (STARTS, 1))
    starts = np.array([models.retract(robot.home.q, step) for step in steps])
    motors = np.broadcast_to(robot.home.q_actuated, (STARTS, len(actuated)))
    starts = actuated.put(starts, motors)
    found = Closing(models, assembler, actuated).solve(starts, motors, threads=1)
    q = found.x[(found.gap < CLOSED) & (assembler.gaps(found.x) < CLOSED)]
    q = q[first_of_each(signatures(robot, q))]
    passive = [k for k in range(len(reach)) if k not in robot.structure.columns("actuated")]
    ranks = [rank(assembler.scaled_jacobian(row)[:, passive]) for row in [robot.home.q, *q]]
    return q[np.equal(ranks[1:], ranks[0])]


def signatures(robot, q):
    """What tells configurations apart: poses of the platform, or of all bodies without one."""
    T = robot.models.poses(q, robot.assembler.p)
    platform = robot.mechanism.platform
    if platform is not None:
        T = T[:, [robot.structure.bodies.index(platform)]]
    parts = T[..., :3, :3], T[..., :3, 3] / robot.assembler.length
    return np.concatenate([part.reshape(len(q), -1) for part in parts], axis=1)


def apart(rows, others):
    """Largest difference of each row from each other one, (rows, others)."""
    return np.abs(rows[:, None] - others[None]).max(axis=2)


def first_of_each(rows):
    near = apart(rows, rows) < SAME
    return [k for k in range(len(rows)) if not near[k, :k].any()]


def check(robot):
    """Everything listed closes with these motors, once; everything met is listed.

    Unless the list says that the search for its start solutions was cut short.
    """
    modes, met = robot.assembly_modes(robot.home.q_actuated, motion="any"), search(robot)
    assert robot.assembler.gaps(modes.q).max() < CLOSED
    actuated = Coordinates(robot.models, "actuated")
    motors = np.broadcast_to(robot.home.q_actuated, (len(modes), len(actuated)))
    np.testing.assert_allclose(actuated.of(modes.q), motors, atol=1e-12)
    listed = signatures(robot, modes.q)
    assert len(first_of_each(listed)) == len(modes)
    assert len(met)
    missed = apart(signatures(robot, met), listed).min(axis=1) > SAME
    cut_short = any("cut short" in note for note in modes.notes)
    assert cut_short or not missed.any(), f"{missed.sum()} of {len(met)} missed\n{modes}"
    return modes


# laws


@pytest.mark.parametrize("seed", range(400 if LONG else 12))
def test_planar_mechanisms_have_every_mode_that_newton_meets(seed):
    check(planar_with_motors(seed, bodies=6, closings=2))


@pytest.mark.parametrize("seed", range(200 if LONG else 5))
def test_platforms_have_every_mode_that_newton_meets(seed):
    rng = np.random.default_rng(seed)
    kinds = [*PLATFORMS, *SLOW] if LONG else PLATFORMS
    check(platform_on_legs([str(rng.choice(legs)) for legs in kinds[seed % len(kinds)]], seed))


@pytest.mark.parametrize(
    "legs", [("R*R*S", "P*RS", "UP*S"), ("P*RU", "P*RS", "UP*S"), ("P*RS", "P*RS", "P*RS")]
)
def test_no_equation_of_a_platform_is_lost(legs):
    """A locked slide's hinge keeps a point of the platform in a plane: a linear equation."""
    check(platform_on_legs(legs, seed=2))


def test_what_one_route_loses_another_finds():
    """Paths to this platform's modes are lost on the first route, and with them one real mode."""
    modes = check(platform_on_legs(["P*RU", "R*RS", "SP*S"], seed=90))
    assert any("other routes" in note for note in modes.notes)
