"""Maps over the workspace of the orthoglide, with its inverse geometry in closed form."""

import numpy as np
import pytest
import xarray

from gough import load
from gough.errors import ConfigurationError, UnknownName
from gough.geometry.maps import workspace_map
from gough.geometry.rates import Kinematics
from tests.geometry.test_rates import DATA, configuration

A, D4, D6 = (DATA["params"][name] for name in ("a", "D4", "D6"))
LOW, HIGH = DATA["workspace"]["lo"], DATA["workspace"]["hi"]


@pytest.fixture(scope="module")
def orthoglide():
    robot = load("orthoglide")
    return Kinematics(robot.models, robot.assembler)


def inverse_of(kinematics):
    """The inverse geometry of the orthoglide on its working mode, with cos q3 > 0, sin q2 < 0."""

    def leg(u, v, w):
        q3 = np.arcsin(-v / D4)
        q2 = np.arcsin(u / (D4 * np.cos(q3))) - np.pi / 2
        return w + D4 * np.sin(q2) * np.cos(q3) - D6, q2, q3

    def inverse(x):
        q = np.full((len(x), kinematics.models.positions), np.nan)
        X, Y, Z = x.T
        chains = [(X, Y, Z), (Y, Z - A, X + A), (Z - A, X, Y + A)]
        reached = np.all([u**2 + v**2 < D4**2 for u, v, _ in chains], axis=0)
        for k in np.flatnonzero(reached):
            legs = [leg(*(c[k] for c in chain)) for chain in chains]
            q[k] = configuration(kinematics, x[k], legs)
        return q, reached

    return inverse


def test_velocity_factors_stay_in_their_bounds_over_the_cube(orthoglide):
    axis = np.linspace(LOW, HIGH, 7)
    measures = ["velocity_factors", "conditioning", "type_1", "type_2", "determinant_sign"]
    found = workspace_map(orthoglide, inverse_of(orthoglide), measures, x=axis, y=axis, z=A + axis)
    assert dict(found.sizes) == {"x": 7, "y": 7, "z": 7, "factor": 3}
    assert found.reached.all()
    assert found.regular.all()
    factors = found.velocity_factors
    np.testing.assert_allclose([factors.min(), factors.max()], [0.5, 2], atol=1e-9)
    at = {"x": LOW, "y": LOW, "z": A + LOW}
    np.testing.assert_allclose(factors.sel(at), [0.8, 0.8, 2], atol=1e-9)
    np.testing.assert_allclose(found.conditioning.sel(at), 2.5, atol=1e-9)
    assert (found.determinant_sign == 1).all()
    assert found.x.attrs == {"long_name": "output x", "units": "m"}
    assert factors.attrs["units"] == "1"


def test_points_out_of_reach_are_nan_and_named(orthoglide):
    found = workspace_map(
        orthoglide, inverse_of(orthoglide), ["manipulability"], z=[A, A + 0.4], y=0, x=0
    )
    assert found.manipulability.dims == ("z",)
    assert found.reached.values.tolist() == [True, False]
    np.testing.assert_allclose(found.manipulability[0], 1, atol=1e-12)
    assert np.isnan(found.manipulability[1])
    assert float(found.y) == 0


def test_a_map_out_of_reach_altogether_has_its_shape(orthoglide):
    found = workspace_map(
        orthoglide, inverse_of(orthoglide), ["velocity_factors"], x=[5.0, 6], y=0, z=A
    )
    assert not found.reached.any()
    assert found.velocity_factors.isnull().all()
    assert found.velocity_factors.dims == ("x", "factor")


def test_type_2_points_have_infinite_factors(orthoglide):
    """On the diagonal at -D4/√6 the legs are coplanar."""
    t = -D4 / np.sqrt(6)
    points = np.array([t - 1e-3, t, t + 1e-3])
    q, reached = inverse_of(orthoglide)(np.stack([points, points, A + points], axis=1))
    assert reached.all()
    assert orthoglide.velocity_factors(q)[1, -1] > 1e12
    assert orthoglide.type_2(q)[1] < 1e-12 < orthoglide.type_2(q)[0]
    np.testing.assert_array_equal(orthoglide.determinant_sign(q)[[0, 2]], [-1, 1])


def test_one_measure_needs_no_list(orthoglide):
    found = workspace_map(orthoglide, inverse_of(orthoglide), "conditioning", x=0, y=0, z=A)
    assert set(found.data_vars) == {"reached", "regular", "conditioning"}


def test_what_is_wrong_is_named(orthoglide):
    inverse = inverse_of(orthoglide)
    with pytest.raises(UnknownName, match="no measure is named 'conditionning'"):
        workspace_map(orthoglide, inverse, ["conditionning"], x=0, y=0, z=A)
    with pytest.raises(UnknownName, match="no output is named 'rx'"):
        workspace_map(orthoglide, inverse, x=0, y=0, z=A, rx=0)
    with pytest.raises(ConfigurationError, match="no positions are given for y, z"):
        workspace_map(orthoglide, inverse, x=0)
    with pytest.raises(ConfigurationError, match="axis x has shape"):
        workspace_map(orthoglide, inverse, x=[0, np.nan], y=0, z=A)
    with pytest.raises(ConfigurationError, match="axis x is 'wide'; expected finite numbers"):
        workspace_map(orthoglide, inverse, x="wide", y=0, z=A)
    with pytest.raises(ConfigurationError, match="inverse gave arrays of shape"):
        workspace_map(orthoglide, lambda x: (x[0], True), x=0, y=0, z=A)


def test_six_freedoms_are_given_as_poses():
    robot = load("gough-stewart")
    kinematics = Kinematics(robot.models, robot.assembler)
    poses = []

    def inverse(x):
        poses.append(x)
        return np.tile(robot.home.q, (len(x), 1)), np.ones(len(x), dtype=bool)

    axes = {"x": 0, "y": 0, "z": [0.8, 0.9], "rx": 0, "ry": 0, "rz": [0, np.pi]}
    found = workspace_map(kinematics, inverse, ["regularity"], **axes)
    assert isinstance(found, xarray.Dataset)
    assert found.regularity.dims == ("z", "rz")
    np.testing.assert_allclose(poses[0][1], [0, 0, 0.8, 0, 0, 0, 1], atol=1e-15)
