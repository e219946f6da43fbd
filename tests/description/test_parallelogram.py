"""A parallelogram in one line: as one joint, and as bodies, joints and couplings."""

import pytest

from gough import Body, Frame, Joint, Mechanism, Robot
from gough.formats.native import Source

TEXT = """\
name: table
bodies: {table: {mass: 1}}
joints:
  lift:
    type: parallelogram
    bodies: [base, table]
    frames: [{axis: [0, 1, 0]}, {axis: [0, 1, 0]}]
    dimensions: {length: 0.4, width: 0.1}
    actuated: true
    home: 0.3
"""


def robot(**bars):
    dimensions = {"length": 0.4, "width": 0.1, **bars}
    joint = Joint(
        type="parallelogram",
        bodies=("base", "table"),
        frames=(Frame(axis=(0, 1, 0)), Frame(axis=(0, 1, 0), offset=(0.0, 0.02, 0.0))),
        dimensions=dimensions,
        actuated=True,
        home=0.3,
    )
    return Robot(Mechanism(name="table", bodies={"table": Body(mass=1.0)}, joints={"lift": joint}))


def test_heavy_bars_become_bodies_pins_and_couplings():
    light, heavy = robot(), robot(bar_mass=0.3)
    assert (len(light.structure.flat.bodies), len(heavy.structure.flat.bodies)) == (1, 3)
    assert set(heavy.structure.flat.couplings) == {"lift.bars", "lift.level"}
    assert heavy.analyse().mobility == light.analyse().mobility == 1
    assert heavy.analyse().redundant_equations == 0


def test_both_forms_place_the_far_body_alike():
    poses = []
    for each in (robot(), robot(bar_mass=0.3)):
        found = each.models.poses(each.home.q, each.assembler.p)
        poses.append(found[each.structure.bodies.index("table")])
    assert poses[0] == pytest.approx(poses[1], abs=1e-15)


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("{length: 0.4,", "{", "a parallelogram joint needs dimensions: {length: …}"),
        ("{length: 0.4, width", "{bar_mass: 1, width", "needs dimensions: {length: …}"),
        ("length: 0.4", "bar_mass: 1, length: -1", "length is -1; it must be positive"),
        ("length: 0.4", "bar_mass: 1, length: 1, depth: 2", "has no dimension 'depth'"),
        ("home: 0.3", "home: [1, 2]", "expected 1 numbers, got 2"),
    ],
)
def test_wrong_dimensions(old, new, expected):
    with pytest.raises(ValueError, match=expected.replace("{", r"\{").replace("}", r"\}")):
        Source(TEXT.replace(old, new).encode(), "table.yaml").mechanism()
