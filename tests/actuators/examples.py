"""Laws with numbers, situations for them, and their efforts as CasADi functions."""

import casadi
import numpy as np

from gough.actuators import LAWS, Effort, Situation

TABLE = ((0.0, 7.0), (0.1, 6.0), (0.3, 5.5), (0.6, 4.0))
EXAMPLES = {
    "force": ("force", {}),
    "force with a limit": ("force", {"limit": 3.0}),
    "motor": ("motor", {"ratio": -20.0, "inertia": 1e-3, "damping": 2e-3}),
    "motor with limits": (
        "motor",
        {"ratio": 4.0, "torque": 1.5, "speed": 9.0, "damping": 0.01, "inertia": 2e-4},
    ),
    "spring-damper": (
        "spring-damper",
        {"stiffness": 40.0, "damping": 3.0, "rest": 0.2, "preload": -1.5},
    ),
    "viscous friction": ("friction", {"viscous": 2.0}),
    "coulomb friction": ("friction", {"coulomb": 2.0, "velocity": 0.05}),
    "friction": (
        "friction",
        {"viscous": 0.5, "coulomb": 2.0, "static": 3.0, "stribeck": 0.3, "velocity": 0.05},
    ),
    "lugre": ("lugre", {"stiffness": 100.0, "coulomb": 2.0, "damping": 3.0, "viscous": 0.4}),
    "lugre after Stribeck": (
        "lugre",
        {
            "stiffness": 100.0,
            "coulomb": 2.0,
            "static": 3.0,
            "stribeck": 0.3,
            "damping": 3.0,
            "damping_velocity": 0.5,
        },
    ),
    "dahl": ("dahl", {"beta": 50.0, "deploying": (6.0, -3.0), "folding": (9.0, -3.0)}),
    "dahl of tables": (
        "dahl",
        {
            "beta": 20.0,
            "deploying": TABLE,
            "folding": ((0.0, 8.5), (0.2, 8.0), (0.7, 7.0)),
            "start": 7.5,
        },
    ),
    "upper stop": (
        "end-stop",
        {"upper": 0.3, "stiffness": 2e3, "damping": 15.0, "sharpness_spring": 8.0},
    ),
    "lower stop": (
        "end-stop",
        {
            "lower": -0.2,
            "stiffness": 2e3,
            "damping": 15.0,
            "sharpness_spring": 8.0,
            "sharpness_damper": 3.0,
        },
    ),
    "both stops": (
        "end-stop",
        {
            "lower": -0.2,
            "upper": 0.3,
            "stiffness": 500.0,
            "damping": 15.0,
            "sharpness_spring": 8.0,
            "one_signed": 1.0,
        },
    ),
    "reel": ("reel", {"inertia": 2e-4, "radius": 0.05}),
}
MIXED = {
    "dahl of a table and a line": (
        "dahl",
        {"beta": 50.0, "deploying": TABLE, "folding": (9.0, -3.0), "range": (0.0, 0.5)},
    )
}
ALL = EXAMPLES | MIXED
QUANTITIES = ("force", "stored", "dissipated", "delivered")


def situations(law, count, seed=0):
    """Random situations of a law, with memory where it can be."""
    rng = np.random.default_rng(seed)
    for _ in range(count):
        memory = {"dahl": rng.uniform(3, 10), "lugre": rng.uniform(-0.02, 0.02)}
        yield Situation(
            position=rng.uniform(-1, 1),
            rate=rng.choice([0.0, 1.0]) if rng.random() < 0.1 else rng.normal(),
            memory=(memory[law.name],) if law.memory else (),
            command=5 * rng.normal(),
        )


def symbols(law, branches=False):
    """A situation of symbols, and their list."""
    w, v, command = (casadi.SX.sym(name) for name in ("w", "v", "command"))
    memory = tuple(casadi.SX.sym(name) for name in law.memory)
    taken = tuple(casadi.SX.sym(name) for name in law.switches) if branches else None
    listed = [w, v, *memory, command, *(taken or ())]
    return Situation(w, v, memory, command, taken), listed


def flat(situation):
    """The numbers of a situation in the order of `symbols`."""
    branches = situation.branches or ()
    return [situation.position, situation.rate, *situation.memory, situation.command, *branches]


def values_of(effort: Effort):
    """Every number of an effort."""
    parts = [getattr(effort, name) for name in QUANTITIES]
    return [*parts, *effort.memory_rates, *(event.value for event in effort.events)]


def power_of_storing(situation, effort):
    """d(stored)/dt by automatic differentiation."""
    states = [situation.position, *situation.memory]
    rates = [situation.rate, *effort.memory_rates]
    slope = casadi.jacobian(casadi.SX(effort.stored), casadi.vertcat(*states))
    return slope @ casadi.vertcat(*rates)


def law_of(name):
    """The law of an example and its numbers."""
    law, numbers = ALL[name]
    return LAWS[law], numbers
