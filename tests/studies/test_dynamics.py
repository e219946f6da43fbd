"""Efforts in the report: their shares add up to inverse dynamics."""

from __future__ import annotations

import numpy as np
import pytest

from gough import load
from gough.studies.context import Context
from gough.studies.report import Paragraph, Table
from gough.studies.sections import dynamics


@pytest.mark.parametrize("name", ["3-rrr", "4-rpr"])
def test_shares_add_up_to_the_efforts(name: str) -> None:
    robot = load(name)
    found = dynamics.section(Context(robot))
    data = found.data["dynamics"]
    shares = np.array(data["efforts"])
    run = dynamics.run(robot)
    x, xd, xdd = dynamics._path(robot, dynamics._moving(robot), run.size, run.time)
    efforts = robot.inverse_dynamics(x, xd, xdd)
    np.testing.assert_allclose(shares.sum(axis=(0, 2)), efforts, atol=1e-9 * np.abs(efforts).max())
    assert {p.name for p in found.pictures} == {"efforts-by-part", "efforts-by-kind"}
    table = next(block for block in found.blocks if isinstance(block, Table))
    assert [row[0] for row in table.rows] == [*data["parts"], "sum"]


@pytest.mark.parametrize(
    ("name", "why"),
    [("biped-leg", "no platform"), ("agile-eye", "turns of the platform"), ("bennett", "platform")],
)
def test_robots_without_a_path_say_why(name: str, why: str) -> None:
    found = dynamics.section(Context(load(name)))
    (block,) = found.blocks
    assert isinstance(block, Paragraph)
    assert why in block.text
    assert found.data["dynamics"] is None
