"""Random mechanisms of all joint types, closed by construction."""

import numpy as np

from gough import algebra as al
from gough.description import Body, Frame, Joint, Mechanism
from gough.description.frames import transform
from gough.joints import TYPES

TREE_TYPES = [name for name in TYPES if name != "free"]
CLOSING_TYPES = [name for name in TREE_TYPES if name != "fixed"]
DIMENSIONS = {"helical": {"pitch": 0.3}, "parallelogram": {"length": 0.7, "width": 0.2}}


def unit(rng):
    v = rng.normal(size=3)
    return v / np.linalg.norm(v)


def random_frame(rng):
    axis = unit(rng)
    across = np.cross(axis, unit(rng))
    return Frame(point=list(rng.uniform(-1, 1, 3)), axis=list(axis), across=list(across))


def random_position(kind, rng):
    """A position well inside the range where angles are single-valued."""
    steps = rng.uniform(-0.9, 0.9, kind.freedoms)
    return kind.retract(kind.neutral(), steps)


def frame_of(T):
    R, p = T
    return Frame(point=list(p), axis=list(al.column(R, 2)), across=list(al.column(R, 0)))


def numbers(T):
    """The transform with every entry a plain float."""
    R, p = T
    return tuple(tuple(float(x) for x in row) for row in R), tuple(float(x) for x in p)


def written(kind, q):
    """The position as a person writes it under ``home``."""
    return list(q)


def random_mechanism(seed, *, bodies=None, closings=None, types=None, planar=False, roles=True):
    """A mechanism with loops of random joints, whose described home is closed.

    Bodies hang in a random tree at random positions; further joints get the frame on their
    second body from the poses, so that every loop is closed whichever joint is cut.
    """
    rng = np.random.default_rng(seed)
    count = bodies or int(rng.integers(3, 6))
    extra = closings or int(rng.integers(1, 3))
    poses, joints = {"base": al.HERE}, {}

    def add(name, type_name, a, b, passive):
        kind = TYPES[type_name]
        q = random_position(kind, rng)
        dimensions = DIMENSIONS.get(type_name, {})
        on_a = planar_frame(kind, rng) if planar else random_frame(rng)
        across = numbers(kind.placement(q, dimensions))
        joint_in_root = al.compose(al.compose(poses[a], numbers(transform(on_a, {}))), across)
        if b in poses:
            on_b = frame_of(numbers(al.compose(al.inverse(poses[b]), joint_in_root)))
        else:
            on_b = planar_frame(kind, rng) if planar else random_frame(rng)
            poses[b] = numbers(al.compose(joint_in_root, al.inverse(numbers(transform(on_b, {})))))
        joints[name] = Joint(
            type=type_name,
            bodies=(a, b),
            frames=(on_a, on_b),
            dimensions=dimensions,
            home=written(kind, q) if kind.coordinates else None,
            actuated=bool(roles and not passive and kind.freedoms and rng.random() < 0.3),
        )

    choices = types or (["revolute", "prismatic"] if planar else TREE_TYPES)
    closing_choices = types or (["revolute", "prismatic"] if planar else CLOSING_TYPES)
    names = [f"body{k}" for k in range(count)]
    for k, name in enumerate(names):
        parent = "base" if k == 0 else str(rng.choice(["base", *names[:k]]))
        add(f"joint{k}", str(rng.choice(choices)), parent, name, passive=False)
    for k in range(extra):
        a, b = rng.choice(["base", *names], size=2, replace=False)
        add(f"closing{k}", str(rng.choice(closing_choices)), str(a), str(b), passive=True)
    platform = str(rng.choice(names)) if roles else None
    parts = {name: Body(mass=1.0, inertia=(0.1, 0.1, 0.1)) for name in names}
    if platform:
        parts[platform] = Body(mass=1.0, inertia=(0.1, 0.1, 0.1), home=frame_of(poses[platform]))
    outputs = ("x", "y", "rz") if planar else ("x", "y", "z", "rx", "ry", "rz")
    return Mechanism(
        name=f"random-{seed}",
        motion="planar" if planar else "spatial",
        bodies=parts,
        joints=joints,
        platform=platform,
        operational=outputs if platform else (),
    )


def planar_frame(kind, rng):
    point = [*rng.uniform(-1, 1, 2), 0.0]
    angle = rng.uniform(-3, 3)
    in_plane = [float(np.cos(angle)), float(np.sin(angle)), 0.0]
    if kind.name == "prismatic":
        return Frame(point=point, axis=in_plane, across=[0.0, 0.0, 1.0])
    return Frame(point=point, axis=[0.0, 0.0, 1.0], across=in_plane)
