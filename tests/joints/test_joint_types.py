"""Laws that every joint type obeys."""

import numpy as np
import pytest

from gough import algebra as al
from gough.description.frames import transform
from gough.joints import TYPES, Free
from gough.joints.constraints import CONSTRAINTS
from tests.mechanisms import DIMENSIONS, numbers, random_frame, random_position

KINDS = [*TYPES.values(), Free(("x", "y")), Free(("x", "y", "rz")), Free(("z", "rx"))]
ROWS = {
    "revolute": 5,
    "prismatic": 5,
    "helical": 5,
    "cylindrical": 4,
    "universal": 4,
    "spherical": 3,
    "planar": 3,
    "parallelogram": 5,
    "fixed": 6,
}
STEP = 1e-6


def moved(T, twist, step):
    """The pose after a small twist (linear at the origin, angular; in the axes T maps to)."""
    v, w = (np.array(part) * step for part in twist)
    R, p = np.array(T[0]), np.array(T[1])
    W = np.array([[0, -w[2], w[1]], [w[2], 0, -w[0]], [-w[1], w[0], 0]])
    turned = (np.eye(3) + W + W @ W / 2) @ R
    return tuple(map(tuple, turned.tolist())), tuple((p + v).tolist())


def residuals(kind, a, b, dimensions):
    return np.array([row.residual for row in kind.rows(a, b, dimensions)], dtype=float)


def placed(kind, seed):
    """A frame a anywhere, a position, and the frame b it places."""
    rng = np.random.default_rng(seed)
    a = numbers(transform(random_frame(rng), {}))
    q = random_position(kind, rng)
    dimensions = DIMENSIONS.get(kind.name, {})
    return a, q, numbers(al.compose(a, kind.placement(q, dimensions))), dimensions


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: f"{kind.name}-{kind.freedoms}")
@pytest.mark.parametrize("seed", range(4))
def test_twists_are_the_rate_of_the_placement(kind, seed):
    _, q, _, dimensions = placed(kind, seed)
    for k, twist in enumerate(kind.twists(q, dimensions)):
        rates = np.eye(kind.freedoms)[k] * STEP
        ahead = numbers(kind.placement(kind.retract(q, rates), dimensions))
        behind = numbers(kind.placement(kind.retract(q, -rates), dimensions))
        here = numbers(kind.placement(q, dimensions))
        linear = (np.array(ahead[1]) - np.array(behind[1])) / (2 * STEP)
        spin = (np.array(ahead[0]) - np.array(behind[0])) / (2 * STEP) @ np.array(here[0]).T
        angular = [spin[2, 1], spin[0, 2], spin[1, 0]]
        np.testing.assert_allclose(np.r_[linear, angular], np.concatenate(twist), atol=1e-8)


def walked(kind, q, dimensions):
    """Each step of the chain: the element, the axes it turns or slides in, where, and the end."""
    R, p, steps = np.eye(3), np.zeros(3), []
    for element in kind.chain(dimensions):
        p = p + R @ np.array(element.shift)
        steps.append((element, R, p))
        x = element.factor * q[element.freedom]
        if element.kind == "slide":
            p = p + x * R[:, element.axis]
        elif element.kind == "turn":
            R = R @ np.array(al.rotation_about("xyz"[element.axis], x))
        else:
            ball = q[element.freedom : element.freedom + 4]
            R = R @ np.array(al.rotation_from_quaternion_wxyz(ball))
    return steps, R, p


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: f"{kind.name}-{kind.freedoms}")
@pytest.mark.parametrize("seed", range(4))
def test_the_motions_of_the_chain_make_the_placement(kind, seed):
    _, q, _, dimensions = placed(kind, seed)
    _, R, p = walked(kind, q, dimensions)
    expected = kind.placement(q, dimensions)
    np.testing.assert_allclose(R, np.array(expected[0], dtype=float), atol=1e-14)
    np.testing.assert_allclose(p, np.array(expected[1], dtype=float), atol=1e-14)


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: f"{kind.name}-{kind.freedoms}")
@pytest.mark.parametrize("seed", range(4))
def test_the_rates_of_the_chain_add_up_to_the_twists(kind, seed):
    """A turn about e through o gives the far end the twist (e x (p - o), e), a slide (e, 0)."""
    _, q, _, dimensions = placed(kind, seed)
    steps, _, end = walked(kind, q, dimensions)
    found = np.zeros((kind.freedoms, 6))
    for element, R, o in steps:
        axes = range(3) if element.kind == "ball" else [element.axis]
        for k, axis in enumerate(axes):
            e = element.factor * R[:, axis]
            twist = (e, np.zeros(3)) if element.kind == "slide" else (np.cross(e, end - o), e)
            found[element.freedom + k] += np.concatenate(twist)
    expected = [np.concatenate(twist) for twist in kind.twists(q, dimensions)]
    np.testing.assert_allclose(found, np.reshape(expected, (-1, 6)), atol=1e-14)


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: f"{kind.name}-{kind.freedoms}")
def test_position_rates_are_the_rate_of_the_retraction(kind):
    q = random_position(kind, np.random.default_rng(7))
    H = np.array(kind.position_rates(q), dtype=float).reshape(kind.coordinates, kind.freedoms)
    for k in range(kind.freedoms):
        rates = np.eye(kind.freedoms)[k] * STEP
        slope = (np.array(kind.retract(q, rates)) - np.array(kind.retract(q, -rates))) / (2 * STEP)
        np.testing.assert_allclose(slope, H[:, k], atol=1e-9)


@pytest.mark.parametrize("name", ROWS)
@pytest.mark.parametrize("seed", range(4))
def test_rows_vanish_where_the_joint_places_its_frames(name, seed):
    kind = TYPES[name]
    a, _, b, dimensions = placed(kind, seed)
    values = residuals(kind, a, b, dimensions)
    assert values.size == ROWS[name]
    np.testing.assert_allclose(values, 0, atol=1e-12)
    np.testing.assert_allclose(kind.alignment(a, b, dimensions), 1, atol=1e-12)


@pytest.mark.parametrize("name", ROWS)
@pytest.mark.parametrize("seed", range(4))
def test_rows_annihilate_the_motion_subspace_and_hold_all_else(name, seed):
    kind = TYPES[name]
    a, q, b, dimensions = placed(kind, seed)

    def slope(twist):
        ahead, behind = (
            residuals(kind, a, moved(b, twist, sign * STEP), dimensions) for sign in (1, -1)
        )
        return (ahead - behind) / (2 * STEP)

    for v, w in kind.twists(q, dimensions):
        twist = (al.turn(a[0], v), al.turn(a[0], w))
        np.testing.assert_allclose(slope(twist), 0, atol=1e-8)
    J = np.column_stack([slope((e[:3], e[3:])) for e in np.eye(6)])
    assert np.linalg.matrix_rank(J, tol=1e-6) == ROWS[name] == 6 - kind.freedoms


@pytest.mark.parametrize("name", [name for name in ROWS if TYPES[name].planar])
def test_planar_rows_hold_what_the_joint_holds_in_the_plane(name):
    kind = TYPES[name]
    rng = np.random.default_rng(3)
    from tests.mechanisms import planar_frame

    a = numbers(transform(planar_frame(kind, rng), {}))
    q = random_position(kind, rng)
    dimensions = DIMENSIONS.get(name, {})
    b = numbers(al.compose(a, kind.placement(q, dimensions)))

    def values(frame):
        return np.array([r.residual for r in kind.planar_rows(a, frame, dimensions)], dtype=float)

    np.testing.assert_allclose(values(b), 0, atol=1e-12)
    plane = [np.eye(6)[k] for k in (0, 1, 5)]
    slopes = [
        (values(moved(b, (e[:3], e[3:]), STEP)) - values(moved(b, (e[:3], e[3:]), -STEP)))
        / (2 * STEP)
        for e in plane
    ]
    assert np.linalg.matrix_rank(np.column_stack(slopes), tol=1e-6) == 3 - kind.freedoms


def test_the_helical_joint_tells_turns_apart():
    kind, dimensions = TYPES["helical"], {"pitch": 0.1}
    for turns in (-3, 0, 5):
        b = kind.placement([0.4 + 2 * np.pi * turns], dimensions)
        np.testing.assert_allclose(residuals(kind, al.HERE, b, dimensions), 0, atol=1e-12)
    half = kind.placement([0.4], dimensions)
    shifted = (half[0], (0.0, 0.0, half[1][2] + 0.05))
    assert abs(residuals(kind, al.HERE, shifted, dimensions)[-1]) == pytest.approx(0.05)


def test_a_half_turn_of_a_fixed_joint_is_on_the_reverse_side():
    kind = TYPES["fixed"]
    turned = (al.rotation_about("z", np.pi), al.ZERO)
    np.testing.assert_allclose(residuals(kind, al.HERE, turned, {}), 0, atol=1e-12)
    assert kind.alignment(al.HERE, turned, {})[0] == pytest.approx(-1)


def test_constraints_have_the_rows_of_their_names():
    a = numbers(transform(random_frame(np.random.default_rng(5)), {}))
    counts = {name: len(part.rows(a, a)) for name, part in CONSTRAINTS.items()}
    assert counts == {"points-coincide": 3, "directions-parallel": 2, "frames-coincide": 6}


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: f"{kind.name}-{kind.freedoms}")
def test_measuring_undoes_placing(kind):
    rng = np.random.default_rng(5)
    dimensions = DIMENSIONS.get(kind.name, {})
    q = rng.uniform(-1.5, 1.5, size=(20, kind.coordinates))
    if kind.coordinates > kind.freedoms:
        q[:, -4:] /= np.linalg.norm(q[:, -4:], axis=1, keepdims=True)
        q[:, -4:] *= np.where(q[:, -4:-3] < 0, -1, 1)
    T = np.tile(np.eye(4), (20, 1, 1))
    for row, position in zip(T, q.tolist(), strict=True):
        R, p = kind.placement(position, dimensions)
        row[:3, :3], row[:3, 3] = R, p
    measured = kind.measured(T, dimensions)
    if kind.coordinates > kind.freedoms:
        measured[:, -4:] *= np.where(measured[:, -4:-3] < 0, -1, 1)
    np.testing.assert_allclose(measured, q, atol=1e-12)
