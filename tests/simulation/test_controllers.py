"""Laws of controllers: what they ask for is what the closed loop does."""

from dataclasses import replace
from functools import cache
from importlib import resources
from types import SimpleNamespace

import casadi
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from gough import ConfigurationError, Robot, UnknownName, load
from gough.formats.native import Source
from gough.simulation.controllers import (
    ComputedTorque,
    Custom,
    Feedforward,
    JointPD,
    PDGravity,
    Sampled,
    Tracked,
    seen,
    turn_between,
)
from gough.simulation.equations import Equations, Setting
from gough.simulation.forces import laws_of
from gough.simulation.trajectories import (
    Circle,
    Formula,
    Hold,
    PointToPoint,
    Table,
    evaluated,
    followed,
)

load = cache(load)
WN, RATIO = 12.0, 0.6
PLACES = pytest.mark.parametrize("place", ["x", "q"])


class Loop:
    """A mechanism under a controller; drives without limits."""

    def __init__(self, name, controller, place="x", space="platform"):
        self.robot = load(name) if isinstance(name, str) else name
        self.model = self.robot.dynamics.model(space)
        told = controller.signals(self.model)
        laws = laws_of(self.robot.dynamics.models.closure)
        laws = tuple(replace(law, numbers={}) for law in laws if law.law.commanded)
        setting = Setting(laws, source=controller, signals=told.names)
        self.equations = Equations(self.model, place, setting)
        self.place, self.told, self.controller = place, told, controller

    def kernel(self, t, state):
        """Rates of the state."""
        kernel = self.equations.motion.kernel
        values = {"t": [t], "state": state, "p": self.robot.assembler.p}
        values["signals"] = self.told.at(t)[0] if self.told.names else []
        return kernel(*[values[name] for name in kernel.inputs])[: len(state)]

    def start(self, q, v=None):
        """State at a configuration and rates of the independent variables."""
        layout = self.equations.layout
        state = np.zeros(layout.states)
        state[layout.part("positions")] = self.model.outputs.of(q) if self.place == "x" else q
        if v is not None:
            state[layout.part("rates")] = v
        return state

    def run(self, q, times, v=None):
        """Positions and rates at times."""
        given = {"rtol": 1e-10, "atol": 1e-11, "t_eval": times}
        found = solve_ivp(self.kernel, (0, times[-1]), self.start(q, v), method="DOP853", **given)
        assert found.success, found.message
        layout = self.equations.layout
        return found.y.T[:, layout.part("positions")], found.y.T[:, layout.part("rates")]

    def efforts(self, q, v=None, t=0.0):
        """What the controller asks for in a state, by motor."""
        scene, equations = self.equations.scene, self.equations
        found = self.controller.commands(scene)
        signals = casadi.vertcat(*scene.told.values(), casadi.SX(0, 1))
        state = casadi.vertcat(*equations.positions, *self.equations.writing.reduced.y)
        inputs = [scene.t, state, signals, scene.model.closure.p]
        column = casadi.vertcat(*[casadi.SX(found[name]) for name in self.robot.dynamics.motors])
        function = casadi.Function("efforts", inputs, [column])
        numbers = self.start(q, v)[: state.numel()]
        told = self.told.at(t)[0] if self.told.names else []
        return np.array(function(t, numbers, told, self.robot.assembler.p)).ravel()


def analytic(e0, times, wn=WN, ratio=RATIO):
    """e of ë + 2 ratio wn ė + wn² e = 0 from rest, as parts of e0."""
    wd, decay = wn * np.sqrt(1 - ratio**2), ratio * wn
    part = np.exp(-decay * times) * (np.cos(wd * times) + decay / wd * np.sin(wd * times))
    return np.outer(part, e0)


SHIFTS = {
    "orthoglide": [0.02, -0.03, 0.01],
    "delta": [0.02, -0.03, 0.01],
    "five-bar": [0.02, -0.01],
    "3-rpr": [0.02, -0.01, 0.1],
}
TIMES = np.linspace(0, 0.5, 11)


@PLACES
@pytest.mark.parametrize("name", sorted(SHIFTS))
def test_computed_torque_has_the_chosen_frequency(name, place):
    x0, shift = load(name).home.x, np.array(SHIFTS[name])
    reference = PointToPoint(x0 + shift, x0 - shift, 0.4)
    controller = ComputedTorque(reference, frequency=WN, damping_ratio=RATIO)
    loop = Loop(name, controller, place)
    coordinates = followed(loop.model)
    wanted, rates, _ = evaluated(reference, coordinates, TIMES)
    assert not rates[0].any()
    positions, _ = loop.run(load(name).home.q, TIMES)
    x = positions if place == "x" else loop.model.outputs.of(positions)
    np.testing.assert_allclose(wanted - x, analytic(shift, TIMES), atol=1e-6)


@PLACES
def test_computed_torque_of_a_pose(place):
    robot = load("gough-stewart")
    x0, angle, axis = robot.home.x, 0.2, np.array([1.0, 2.0, 2.0]) / 3
    half = np.concatenate([[np.cos(angle / 2)], np.sin(angle / 2) * axis])
    target = np.concatenate([np.add(x0[:3], [0.02, 0.01, -0.03]), product(half, x0[3:])])
    controller = ComputedTorque(Hold(target), WN**2, 2 * RATIO * WN)
    loop = Loop("gough-stewart", controller, place)
    positions, _ = loop.run(robot.home.q, TIMES)
    x = positions if place == "x" else loop.model.outputs.of(positions)
    expected = analytic(np.concatenate([target[:3] - x0[:3], angle * axis]), TIMES)
    np.testing.assert_allclose(target[:3] - x[:, :3], expected[:, :3], atol=1e-6)
    turns = [turn(target[3:], row) for row in x[:, 3:]]
    np.testing.assert_allclose(turns, expected[:, 3:], atol=1e-6)


def product(p, q):
    (a, *u), (w, *v) = p, q
    u, v = np.array(u), np.array(v)
    return np.array([a * w - u @ v, *(a * v + w * u + np.cross(u, v))])


def turn(a, b):
    symbols = casadi.SX.sym("b", 4)
    found = turn_between(list(a), [symbols[k] for k in range(4)])
    return np.array(casadi.Function("turn", [symbols], [casadi.vertcat(*found)])(b)).ravel()


def test_the_turn_between_orientations():
    rng = np.random.default_rng(0)
    for angle in (0.0, 1e-9, 1e-5, 0.3, 3.0, 3.5, 6.0, 6.2831):
        axis = rng.normal(size=3)
        axis /= np.linalg.norm(axis)
        b = rng.normal(size=4)
        b /= np.linalg.norm(b)
        step = np.concatenate([[np.cos(angle / 2)], np.sin(angle / 2) * axis])
        short = angle if angle < np.pi else angle - 2 * np.pi
        np.testing.assert_allclose(turn(product(step, b), b), short * axis, atol=1e-14)


def test_a_pose_follows_a_circle():
    robot = load("gough-stewart")
    x0 = robot.home.x
    reference = Circle(x0[:3] - [0.05, 0, 0], 0.05, [1, 1, 2], duration=0.6, begin=[1, 0, -0.5])
    start, *_ = evaluated(reference, followed(robot.dynamics.model("platform")), [0.0])
    q = robot.inverse_geometry(start[0])
    loop = Loop("gough-stewart", ComputedTorque(reference, frequency=20.0))
    loop.controller.require_start(loop.model, q)
    with pytest.raises(ConfigurationError, match=r"away from the start, in"):
        loop.controller.require_start(loop.model, robot.home.q)
    times = np.linspace(0, 0.7, 8)
    positions, _ = loop.run(q, times)
    wanted, *_ = evaluated(reference, followed(loop.model), times)
    np.testing.assert_allclose(positions, wanted, atol=1e-7)


@PLACES
def test_motors_follow_in_any_coordinates(place):
    robot = load("five-bar")
    coordinates = followed(robot.dynamics.model("platform"), "inputs")
    a0, shift = coordinates.of(robot.home.q), np.array([-0.1, 0.05])
    # whole turns make no difference
    reference = Hold(a0 + shift + [2 * np.pi, -4 * np.pi])
    controller = ComputedTorque(reference, frequency=WN, damping_ratio=RATIO, of="inputs")
    for space in ("platform", "joint"):
        if (place, space) == ("x", "joint"):
            continue
        loop = Loop("five-bar", controller, place, space)
        positions, _ = loop.run(robot.home.q, TIMES)
        q = positions if place == "q" else robot.inverse_geometry(positions)
        error = a0 + shift - coordinates.of(q)
        np.testing.assert_allclose(error, analytic(shift, TIMES), atol=1e-6)


def test_outputs_follow_in_joint_space():
    x0, shift = load("delta").home.x, np.array([0.02, -0.03, 0.01])
    controller = ComputedTorque(Hold(x0 + shift), frequency=WN, damping_ratio=RATIO)
    loop = Loop("delta", controller, "q", "joint")
    positions, _ = loop.run(load("delta").home.q, TIMES)
    error = x0 + shift - loop.model.outputs.of(positions)
    np.testing.assert_allclose(error, analytic(shift, TIMES), atol=1e-6)


@pytest.mark.parametrize("space", ["platform", "joint"])
@pytest.mark.parametrize(
    ("name", "shift"), [("3-rps", [0.02, 0.15, -0.1]), ("agile-eye", [0.2, -0.1, 0.15])]
)
def test_entries_of_a_rotation_vector_follow(name, shift, space):
    x0, shift = load(name).home.x, np.array(shift)
    reference = Hold(x0 + shift)
    loop = Loop(name, ComputedTorque(reference, frequency=WN, damping_ratio=RATIO), "q", space)
    positions, _ = loop.run(load(name).home.q, TIMES)
    error = x0 + shift - loop.model.outputs.of(positions)
    np.testing.assert_allclose(error, analytic(shift, TIMES), atol=1e-6)


def test_without_outputs_motors_are_followed():
    robot = load("andrews-squeezer")
    coordinates = followed(robot.dynamics.model("joint"))
    assert coordinates.names == robot.dynamics.motors
    a0 = coordinates.of(robot.home.q)
    controller = ComputedTorque(Hold(a0 + 0.1), frequency=WN, damping_ratio=RATIO)
    loop = Loop("andrews-squeezer", controller, "q", "joint")
    positions, _ = loop.run(robot.home.q, TIMES)
    error = a0 + 0.1 - coordinates.of(positions)
    np.testing.assert_allclose(error, analytic([0.1] * len(a0), TIMES), atol=1e-6)


def test_redundant_motors_share():
    x0, shift = load("4-rpr").home.x, np.array([0.02, -0.01, 0.05])
    controller = ComputedTorque(Hold(x0 + shift), frequency=WN, damping_ratio=RATIO)
    loop = Loop("4-rpr", controller)
    positions, _ = loop.run(load("4-rpr").home.q, TIMES)
    np.testing.assert_allclose(x0 + shift - positions, analytic(shift, TIMES), atol=1e-6)


def test_fewer_coordinates_than_freedoms_leave_the_rest_free():
    robot = load("3-rpr")
    q, motors = robot.home.q, robot.dynamics.motors
    coordinates = followed(robot.dynamics.model("platform"), motors[:2])
    l0 = coordinates.of(q)
    controller = ComputedTorque(Hold(l0 + 0.02), frequency=WN, damping_ratio=RATIO, of=motors[:2])
    loop = Loop("3-rpr", controller, "q")
    times = TIMES[:6]
    positions, _ = loop.run(q, times)
    error = l0 + 0.02 - coordinates.of(positions)
    np.testing.assert_allclose(error, analytic([0.02, 0.02], times), atol=1e-6)


def test_legs_that_spin_are_left_to_spin():
    robot = load("6-sps")
    x0 = robot.home.x
    target = x0.copy()
    target[:3] += [0.02, 0.01, -0.03]
    reference = Hold(target)
    loop = Loop("6-sps", ComputedTorque(reference, frequency=WN, damping_ratio=RATIO), "q")
    assert len(loop.model.independent) > 6
    state = loop.start(robot.home.q)
    acceleration = loop.kernel(0.0, state)[loop.equations.layout.part("rates")]
    names = [loop.model.structure.variables[k].name for k in loop.model.independent]
    found = [acceleration[names.index(name)] for name in followed(loop.model).rates]
    np.testing.assert_allclose(found, [*WN**2 * (target - x0)[:3], 0, 0, 0], atol=1e-9)


# at rest


@PLACES
@pytest.mark.parametrize("name", ["gough-stewart", "orthoglide", "delta", "five-bar", "4-rpr"])
def test_at_rest_every_controller_carries_the_load(name, place):
    robot = load(name)
    x0, q = robot.home.x, robot.home.q
    motors = followed(robot.dynamics.model("platform"), "inputs").of(q)
    still = np.zeros(len(robot.dynamics.model("platform").independent))
    expected = robot.inverse_dynamics(x0, still, still)
    controllers = [
        ComputedTorque(Hold(x0), 100.0, 20.0),
        PDGravity(Hold(x0), 100.0, 20.0),
        JointPD(Hold(motors), 100.0, 20.0),
        Feedforward(Hold(x0)),
        Feedforward(Hold(x0)) + JointPD(Hold(motors), 100.0, 20.0, gravity=False),
    ]
    for controller in controllers:
        found = Loop(name, controller, place).efforts(q)
        np.testing.assert_allclose(found, expected, atol=1e-9 * (1 + np.abs(expected).max()))


@PLACES
@pytest.mark.parametrize("name", ["gough-stewart", "delta", "five-bar"])
def test_efforts_along_a_reference_are_those_of_inverse_dynamics(name, place):
    robot = load(name)
    x0 = robot.home.x
    x1 = x0 + 0.02
    if len(x0) == 7:
        x1[3:] = product([np.cos(0.1), np.sin(0.1), 0, 0], x0[3:])
    reference = PointToPoint(x0, x1, 0.5)
    x, xd, xdd = evaluated(reference, followed(robot.dynamics.model("platform")), [0.2])
    expected = robot.inverse_dynamics(x[0], xd[0], xdd[0])
    q = robot.inverse_geometry(x[0])
    for controller in (ComputedTorque(reference, 100.0, 20.0), Feedforward(reference)):
        found = Loop(name, controller, place).efforts(q, xd[0], t=0.2)
        np.testing.assert_allclose(found, expected, rtol=1e-8)


def test_feedforward_follows_by_itself():
    robot = load("delta")
    x0 = robot.home.x
    reference = PointToPoint(x0, np.add(x0, [0.05, 0.02, 0.03]), 0.3)
    loop = Loop("delta", Feedforward(reference))
    times = np.linspace(0, 0.3, 7)
    positions, _ = loop.run(robot.home.q, times)
    wanted, *_ = evaluated(reference, followed(loop.model), times)
    np.testing.assert_allclose(positions, wanted, atol=1e-6)


@PLACES
@pytest.mark.parametrize("kind", [PDGravity, JointPD])
def test_a_spring_with_gravity_holds_still_and_comes_back(kind, place):
    robot = load("delta")
    q = robot.home.q
    model = robot.dynamics.model("platform")
    of = "outputs" if kind is PDGravity else "inputs"
    coordinates = followed(model, of)
    controller = kind(
        Hold(coordinates.of(q)),
        2e3 if of == "outputs" else 200.0,
        200.0 if of == "outputs" else 20.0,
        of=of,
    )
    loop = Loop("delta", controller, place)
    np.testing.assert_allclose(loop.kernel(0.0, loop.start(q)), 0, atol=1e-9)
    away = robot.inverse_geometry(np.add(robot.home.x, [0.02, 0.01, 0.02]))
    positions, rates = loop.run(away, np.array([0.0, 4.0]))
    found = positions[-1] if place == "x" else model.outputs.of(positions[-1])
    np.testing.assert_allclose(found, robot.home.x, atol=1e-5)
    np.testing.assert_allclose(rates[-1], 0, atol=1e-4)


def test_a_table_is_followed():
    robot = load("orthoglide")
    x0 = robot.home.x
    coordinates = followed(robot.dynamics.model("platform"))
    times = np.linspace(0, 0.5, 26)
    motion = PointToPoint(x0, np.add(x0, [0.03, -0.02, 0.04]), 0.5)
    table = Table(times, *evaluated(motion, coordinates, times))
    for controller in (
        ComputedTorque(table, frequency=30.0),
        ComputedTorque(table, frequency=30.0) + Custom(lambda scene: {}),
    ):
        loop = Loop("orthoglide", controller)
        positions, _ = loop.run(robot.home.q, times[::5])
        wanted, *_ = evaluated(motion, coordinates, times[::5])
        np.testing.assert_allclose(positions, wanted, atol=1e-6)


def test_two_tables_in_a_sum_keep_apart():
    robot = load("five-bar")
    model = robot.dynamics.model("platform")
    coordinates = followed(model)
    x0, times = robot.home.x, np.linspace(0, 0.5, 26)
    motions = [PointToPoint(x0, x0 + s, 0.5) for s in ([0.02, 0.0], [0.0, 0.03])]
    tables = [Table(times, *evaluated(m, coordinates, times)) for m in motions]
    one, other = (PDGravity(table, 100.0, 1.0) for table in tables)
    both = Loop("five-bar", one + other)
    parts = [Loop("five-bar", part) for part in (one, other)]
    expected = sum(loop.efforts(robot.home.q, t=0.31) for loop in parts)
    np.testing.assert_allclose(both.efforts(robot.home.q, t=0.31), expected)


# custom and sampled


@PLACES
def test_custom_formulas_see_time_positions_and_rates(place):
    robot = load("five-bar")
    first, second = robot.dynamics.motors

    def formula(scene):
        return {first: scene.t - 3 * scene.position(first), second: 2 * scene.rate(second)}

    q, xd = robot.home.q, np.array([0.3, -0.2])
    loop = Loop("five-bar", Custom(formula), place)
    model = robot.dynamics.model("platform")
    rates = model.kernel("motor_jacobian", "x")(robot.home.x) @ xd
    a = followed(model, "inputs").of(q)
    found = loop.efforts(q, xd, t=0.7)
    np.testing.assert_allclose(found, [0.7 - 3 * a[0], 2 * rates[1]], atol=1e-12)


@pytest.mark.parametrize(
    ("given", "error", "words"),
    [
        ({"leg1.moto": 1.0}, UnknownName, "Did you mean 'leg1.motor'"),
        ([1.0], ConfigurationError, "expected a dict"),
        ({"leg1.motor": float("nan")}, ConfigurationError, "gives nan for leg1.motor"),
        ({"leg1.motor": casadi.SX(2, 1)}, ConfigurationError, "for leg1.motor"),
    ],
)
def test_custom_formulas_are_checked(given, error, words):
    with pytest.raises(error, match=words):
        Loop("five-bar", Custom(lambda scene: given)).kernel(0.0, np.zeros(6))


def test_sampled_functions_are_checked():
    motors, state = ("a", "b"), SimpleNamespace()
    found = Sampled(lambda t, s: {"b": 2 * t}, 0.001).efforts(3.0, state, motors)
    np.testing.assert_array_equal(found, [0.0, 6.0])
    np.testing.assert_array_equal(Sampled(lambda t, s: (1, 2), 1).efforts(0, state, motors), [1, 2])
    for given, error, words in (
        ({"c": 1.0}, UnknownName, "motor"),
        ([1.0], ConfigurationError, r"at t = 0.5 s gives the shape \(1,\), expected \(2,\): a, b"),
        ([1.0, np.inf], ConfigurationError, "not finite: b"),
        (None, ConfigurationError, "shape"),
        ("hello", ConfigurationError, "expected efforts"),
    ):
        with pytest.raises(error, match=words):
            Sampled(lambda t, s, given=given: given, 0.1).efforts(0.5, state, motors)
    for period in (0, -1.0, np.nan, "fast"):
        with pytest.raises(ConfigurationError, match="period is"):
            Sampled(print, period)


def test_what_is_seen_is_the_state():
    robot = load("gough-stewart")
    model = robot.dynamics.model("platform")
    v = np.arange(len(model.structure.variables), dtype=float)
    found = seen(model, robot.home.q, v)
    np.testing.assert_array_equal(found.x, robot.home.x)
    np.testing.assert_array_equal(found.xd, np.arange(6.0))
    places = dict(zip(robot.position_names, robot.home.q, strict=True))
    assert found.positions["leg2.slide"] == places["leg2.slide"]
    assert "platform.rx" not in found.positions
    assert found.rates["platform.rz"] == 5.0


# what is refused


@pytest.mark.parametrize(
    ("name", "make", "error", "words"),
    [
        (
            "five-bar",
            lambda: ComputedTorque(Hold([0, 0]), [1, 2, 3], 1),
            ConfigurationError,
            "stiffness has 3 numbers, expected one, or 2: point.x, point.y",
        ),
        (
            "4-rpr",
            lambda: ComputedTorque(Hold([1, 1, 1, 1]), 1, 1, of="inputs"),
            ConfigurationError,
            "3 freedoms, and the reference is of 4 coordinates",
        ),
        (
            "five-bar",
            lambda: JointPD(Hold([0]), 1, 1, of=["leg1.elbow"]),
            UnknownName,
            "motor",
        ),
        (
            "five-bar",
            lambda: PDGravity(Hold([0, 0]), 1, 1, knows={"mass": 3}),
            UnknownName,
            "live parameter",
        ),
    ],
)
def test_what_does_not_fit_is_refused(name, make, error, words):
    with pytest.raises(error, match=words):
        Loop(name, make()).kernel(0.0, np.zeros(6))


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: ComputedTorque(Hold([0])), "give stiffness and damping, or frequency"),
        (lambda: ComputedTorque(Hold([0]), 1.0), "give stiffness and damping, or frequency"),
        (lambda: ComputedTorque(Hold([0]), 1, 1, frequency=2), "not both"),
        (lambda: ComputedTorque([0, 0], 1, 1), "expected one such as Hold"),
        (lambda: PDGravity(Hold([0]), -1, 1), "finite and not negative"),
        (lambda: PDGravity(Hold([0]), "stiff", 1), "expected numbers"),
        (lambda: Custom(3), "expected a function"),
        (lambda: Sampled(3, 0.1), "expected a function"),
    ],
)
def test_what_can_not_be_is_refused(make, words):
    with pytest.raises(ConfigurationError, match=words):
        make()


# what a controller knows


LOADED = (
    resources.files("gough.catalogue")
    .joinpath("five-bar.yaml")
    .read_text("utf-8")
    .replace("name: five-bar", "name: loaded")
    .replace("point: {mass: 0.5,", "point: {mass: payload,")
    .replace("parameters:\n", "parameters:\n  payload: {value: 0.5, live: true}\n", 1)
)


@PLACES
@pytest.mark.parametrize("kind", [ComputedTorque, PDGravity, JointPD])
def test_a_controller_may_believe_in_another_mass(kind, place):
    robot = Robot(Source(LOADED.encode(), "loaded.yaml").mechanism(), live={"payload": 1.5})
    nominal = load("five-bar")
    x0, q = robot.home.x, robot.home.q
    still = np.zeros(2)
    of = "inputs" if kind is JointPD else "outputs"
    target = followed(nominal.dynamics.model("platform"), of).of(q)
    for knows, expected in (
        (None, robot.inverse_dynamics(x0, still, still)),
        ({"payload": 0.5}, nominal.inverse_dynamics(x0, still, still)),
    ):
        controller = kind(Hold(target), 100.0, 20.0, of=of, knows=knows)
        np.testing.assert_allclose(Loop(robot, controller, place).efforts(q), expected, rtol=1e-9)
    with pytest.raises(ConfigurationError, match="expected 1 finite"):
        Loop(robot, kind(Hold(target), 1, 1, of=of, knows={"payload": [1, 2]}), place).efforts(q)


def test_slopes_are_those_of_accelerations():
    loop = Loop("five-bar", Custom(lambda scene: {}), "q")
    tracked = Tracked(loop.equations.scene, "outputs")
    J, b = tracked.slopes
    assert J == [[1.0, 0.0], [0.0, 1.0]]
    assert b == [0.0, 0.0]


def test_formulas_are_followed():
    x0 = load("five-bar").home.x
    reference = Formula(lambda t: [x0[0] + 0.02 * (4 * t).sin() ** 2, x0[1]])
    loop = Loop("five-bar", ComputedTorque(reference, frequency=20.0))
    positions, _ = loop.run(load("five-bar").home.q, TIMES)
    wanted, *_ = evaluated(reference, followed(loop.model), TIMES)
    np.testing.assert_allclose(positions, wanted, atol=1e-7)
