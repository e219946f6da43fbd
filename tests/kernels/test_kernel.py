"""An expression as a numpy function over batches."""

import threading
from concurrent.futures import ThreadPoolExecutor

import casadi
import numpy as np
import pytest

import gough
from gough.catalogue import names
from gough.errors import ConfigurationError
from gough.kernels import Kernel
from gough.kernels.reference import run
from tests.kernels.random_tapes import assert_same

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


# the numpy face

Q = casadi.SX.sym("q", 3)
WAVES = Kernel("waves", {"q": Q, "p": P}, casadi.sin(Q * P) @ casadi.cos(Q).T / (2 + Q[0]))
"""(3), (1) -> (3, 3)"""


def many(rows=50, columns=3):
    return np.random.default_rng(7).normal(size=(rows, columns))


def one_by_one(q, p):
    return np.array([WAVES(row, p) for row in q.reshape(-1, 3)]).reshape(*q.shape[:-1], 3, 3)


@pytest.mark.parametrize(
    "arrange",
    [
        lambda q: q.reshape(2, 25, 3),
        lambda q: q[::7],
        lambda q: q[::-1],
        np.asfortranarray,
        lambda q: np.repeat(q, 2, axis=1)[:, ::2],
        lambda q: np.ascontiguousarray(q[:, ::-1])[:, ::-1],
        lambda q: np.broadcast_to(q[0], (9, 3)),
        lambda q: q.T.reshape(3, 5, 10).T,
        lambda q: q[:0],
        lambda q: np.frombuffer(b"x" + q.tobytes(), np.uint8)[1:].view(np.float64).reshape(-1, 3),
        lambda q: q.astype(">f8"),
    ],
)
def test_any_arrangement_of_memory(arrange):
    q = arrange(many())
    q.flags.writeable = False
    np.testing.assert_array_equal(WAVES(q, [0.5]), one_by_one(np.asarray(q, float), [0.5]))


@pytest.mark.parametrize("threads", [None, 1, 2, 3, 70])
def test_threads_change_nothing(threads):
    q, p = many(60).reshape(3, 20, 3), many(20, 1)
    expected = WAVES(q, p)
    np.testing.assert_array_equal(WAVES(q, p, threads=threads), expected)
    out = np.full((3, 20, 3, 3), np.nan)
    assert WAVES(q, p, out=out, threads=threads) is out
    np.testing.assert_array_equal(out, expected)


def test_results_go_where_they_are_wanted():
    q = many(10)
    expected = WAVES(q, [2.0])
    for out in (
        np.empty((10, 3, 3)),
        np.empty((3, 3, 10)).T,
        np.empty((10, 6, 3))[:, ::2],
        np.empty((20, 3, 3))[::-2],
    ):
        WAVES(q, [2.0], out=out)
        np.testing.assert_array_equal(out, expected)


@pytest.mark.parametrize("threads", [1, 2])
def test_results_may_replace_inputs(threads):
    square = Kernel("square", {"x": Q}, Q * Q[::-1], (3,))
    x = many()
    expected = square(x)
    np.testing.assert_array_equal(square(x, out=x, threads=threads), expected)


def test_whole_numbers_and_float32_are_numbers():
    np.testing.assert_array_equal(MATRIX([1, 2]), MATRIX([1.0, 2.0]))
    np.testing.assert_array_equal(MATRIX(np.float32([1, 2])), MATRIX([1.0, 2.0]))


@pytest.mark.parametrize(
    ("call", "error", "message"),
    [
        (lambda: KERNEL([1, 2], [[1, 2]]), ValueError, r"demo: p has shape \(1, 2\), expected \("),
        (lambda: KERNEL(5.0, [1]), ValueError, r"demo: x has shape \(\), expected \(\*batch, 2\)"),
        (lambda: KERNEL([[1], [2, 3]], [1]), ValueError, "demo: x is ragged"),
        (lambda: KERNEL([1j, 2], [1]), TypeError, "demo: x holds complex128, expected real num"),
        (lambda: KERNEL(["a", "b"], [1]), TypeError, "demo: x holds <U1, expected real numbers"),
        (lambda: KERNEL([None, 2], [1]), TypeError, "demo: x holds object, expected real numbers"),
        (
            lambda: KERNEL(np.zeros((3, 2)), np.zeros((4, 1))),
            ValueError,
            r"demo: the leading axes of x \(3, 2\), p \(4, 1\) do not broadcast",
        ),
        (lambda: MATRIX([1, 2], out=np.zeros(3)), ValueError, r"out has shape \(3,\), expected \("),
        (lambda: MATRIX([1, 2], out=[0]), TypeError, "out holds list, expected an array of float"),
        (lambda: MATRIX([1, 2], out=np.zeros((3, 2), int)), TypeError, "out holds int64"),
        (lambda: MATRIX([1, 2], threads=0), ValueError, "threads is 0, expected a whole number"),
        (lambda: MATRIX([1, 2], threads=1.5), ValueError, "threads is 1.5, expected a whole num"),
    ],
)
def test_wrong_arguments_are_named(call, error, message):
    for _ in range(2):  # before and after a call that went well
        with pytest.raises(error, match=message):
            call()
        KERNEL([1.0, 2.0], [3.0])
        MATRIX(np.zeros(2))


def test_single_rows_complain_as_batches_do():
    MATRIX(np.zeros(2))
    with pytest.raises(ValueError, match=r"matrix: x has shape \(3,\), expected \(\*batch, 2\)"):
        MATRIX(np.zeros(3))
    with pytest.raises(TypeError, match="matrix: x holds complex128"):
        MATRIX(np.zeros(2, complex))


def test_a_read_only_out_is_refused():
    out = np.zeros((3, 2))
    out.flags.writeable = False
    with pytest.raises(ValueError, match="matrix: out is read-only"):
        MATRIX([1, 2], out=out)


def test_kernels_without_inputs_or_outputs():
    constant = Kernel("constant", {"p": casadi.SX(0, 1)}, casadi.SX([1.0, 2.0]), (2,))
    np.testing.assert_array_equal(constant(np.zeros(0)), [1, 2])
    np.testing.assert_array_equal(constant(np.zeros((4, 0))), [[1, 2]] * 4)
    empty = Kernel("empty", {"x": X}, casadi.SX(0, 1), (0,))
    assert empty(np.zeros((5, 2))).shape == (5, 0)


def test_no_warning_comes_from_results_that_are_not_finite():
    roots = Kernel("roots", {"x": X}, casadi.vertcat(casadi.sqrt(X[0]), 1 / X[1], casadi.log(X[0])))
    found = roots([[-1.0, 0.0], [1e300, 1e-310]])[..., 0]
    np.testing.assert_array_equal(np.isfinite(found), [[False] * 3, [True, False, True]])


def test_many_threads_may_make_and_call_one_kernel():
    q = many(40)
    kernel = Kernel("shared", {"q": Q}, casadi.tan(Q) + Q[0] ** 3, (3,))
    with ThreadPoolExecutor(8) as pool:
        found = list(pool.map(lambda k: kernel(q if k % 2 else q[0]), range(64)))
    expected = kernel(q)
    for k, result in enumerate(found):
        np.testing.assert_array_equal(result, expected if k % 2 else expected[0])


# against CasADi


@pytest.mark.parametrize("name", names())
def test_models_of_the_catalogue(name):
    robot = gough.load(name)
    models, closure = robot.models, robot.models.closure
    q = robot.home.q + 0.1 * np.random.default_rng(3).normal(size=(19, models.positions))
    p = models.parameters()
    for label in ("residual", "jacobian", "sides"):
        kernel, expression = getattr(models, label), getattr(closure, label)
        if not expression.numel():
            continue
        found = kernel(q, p)
        assert_same(found, np.array([kernel(row, p) for row in q]))
        assert_same(found, kernel(q, p, threads=2))
        oracle = np.array(kernel.expression(q.T, p)).T.reshape(found.shape)
        np.testing.assert_allclose(found, oracle, rtol=1e-12, atol=1e-13)
        plain = Kernel("plain", {"q": closure.q, "p": closure.p}, expression, fuse=False)
        rows = np.hstack([q, np.broadcast_to(p, (len(q), len(p)))])
        assert_same(plain(q, p).reshape(len(q), -1), run(plain.program, rows))


@pytest.mark.parametrize("shape", [(2,), (4,), (), (-1, -3), (-3,)])
def test_a_shape_that_does_not_hold_the_output_is_refused(shape):
    with pytest.raises(ConfigurationError, match="does not hold the 3 numbers of the output"):
        Kernel("wrong", {"q": Q}, Q, shape)


def test_sparse_inputs_are_refused():
    lower = casadi.SX.sym("L", casadi.Sparsity.lower(2))
    with pytest.raises(ConfigurationError, match="input L is sparse"):
        Kernel("wrong", {"L": lower}, lower[1, 1])


def test_long_rows_in_any_arrangement_need_no_large_stack():
    long = casadi.SX.sym("x", 3000)
    double = Kernel("double", {"x": long}, long + long, (3000,))
    x = np.asfortranarray(np.random.default_rng(1).normal(size=(9, 3000)))
    out = np.empty((3000, 9)).T
    before = threading.stack_size(256 * 1024)
    try:
        thread = threading.Thread(target=lambda: (double(x, out=out), double(x[0])))
        thread.start()
    finally:
        threading.stack_size(before)
    thread.join()
    np.testing.assert_array_equal(out, 2 * x)


# complex numbers and intervals


def test_complex_numbers_give_derivatives():
    x, step = np.array([0.3, 1.1, -0.7]), 1e-30
    columns = []
    for k in range(3):
        z = x.astype(complex)
        z[k] += 1j * step
        columns.append(WAVES.complex_lanes(z.view(float), [0.5, 0.0])[..., 1] / step)
    h = 1e-6
    for k, column in enumerate(columns):
        e = h * np.eye(3)[k]
        central = (WAVES(x + e, [0.5]) - WAVES(x - e, [0.5])) / (2 * h)
        np.testing.assert_allclose(column, central, atol=1e-8)


def test_intervals_contain_what_they_must():
    rng = np.random.default_rng(8)
    low = rng.normal(size=(30, 3))
    width = 10.0 ** rng.uniform(-8, -1, (30, 1))
    bounds = np.stack([low, low + width], axis=-1).reshape(30, 6)
    found = WAVES.intervals(bounds, [0.5, 0.5])
    assert found.shape == (30, 3, 3, 2)
    for inside in (0.0, 0.3, 1.0):
        values = WAVES(low + inside * width, [0.5])
        assert (found[..., 0] <= values).all()
        assert (values <= found[..., 1]).all()
    assert (found[..., 1] - found[..., 0] < 40 * width[..., None]).all()


@pytest.mark.parametrize("name", names())
def test_complex_numbers_and_intervals_of_the_catalogue(name):
    robot = gough.load(name)
    kernel, p = robot.models.jacobian, robot.models.parameters()
    q = robot.home.q + 0.1 * np.random.default_rng(4).normal(size=(9, robot.models.positions))
    expected = kernel(q, p)
    pairs = [np.stack([x, np.zeros_like(x)], axis=-1).reshape(*x.shape[:-1], -1) for x in (q, p)]
    found = kernel.complex_lanes(*pairs)
    np.testing.assert_allclose(found[..., 0], expected, rtol=1e-13, atol=1e-14)
    np.testing.assert_array_equal(found[..., 1], 0)
    points = [np.repeat(x, 2, axis=-1) for x in (q, p)]
    bounds = kernel.intervals(*points)
    assert (bounds[..., 0] <= expected).all()
    assert (expected <= bounds[..., 1]).all()
    assert (bounds[..., 1] - bounds[..., 0] <= 1e-11 * (1 + np.abs(expected))).all()
