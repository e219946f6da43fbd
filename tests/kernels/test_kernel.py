"""An expression as a numpy function over batches."""

import casadi
import numpy as np
import pytest

from gough.kernels import Kernel

X, P = casadi.SX.sym("x", 2), casadi.SX.sym("p", 1)
KERNEL = Kernel("demo", {"x": X, "p": P}, casadi.vertcat(X[0] * P, X[1] + P))
MATRIX = Kernel("matrix", {"x": X}, casadi.vertcat(X.T, 2 * X.T, casadi.SX.zeros(1, 2)))


def test_leading_axes_are_batches_and_broadcast():
    x = np.random.default_rng(1).normal(size=(3, 1, 2))
    p = np.arange(4.0)[:, None]
    found = KERNEL(x, p)
    assert found.shape == (3, 4, 2, 1)
    np.testing.assert_array_equal(found[2, 3, :, 0], [x[2, 0, 0] * 3, x[2, 0, 1] + 3])


def test_rows_vary_slowest_and_zeros_are_there():
    np.testing.assert_array_equal(MATRIX([1.0, 5.0]), [[1, 5], [2, 10], [0, 0]])
    assert MATRIX(np.zeros((0, 2))).shape == (0, 3, 2)


def test_strides_and_read_only_inputs():
    wide = np.arange(8.0).reshape(2, 4)[:, ::2]
    wide.flags.writeable = False
    np.testing.assert_array_equal(MATRIX(wide)[:, 0], wide)


def test_wrong_shapes_name_the_argument():
    with pytest.raises(ValueError, match=r"demo: x has shape \(3,\), expected \(\*batch, 2\)"):
        KERNEL(np.zeros(3), np.zeros(1))
    with pytest.raises(ValueError, match="demo takes x, p; got 1 arrays"):
        KERNEL(np.zeros(2))
