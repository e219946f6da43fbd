"""A description whose models move as estimated base parameters say.

Of all full sets of parameters with these base parameters the one nearest to the description is
taken; where that is no body's inertia, one that is: a body's pseudo-inertia

    P = [[Σ, s], [sᵀ, m]],   Σ = ½ tr(J) 1 - J,

is positive semidefinite if and only if masses could be distributed so (Wensing, Kim and Slotine
2018). Both conditions are convex, and projecting on one after the other (Dykstra) finds a common
point where there is one.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from gough.description import Mechanism
from gough.description.parts import Body, Joint, Motor
from gough.description.values import array, scalar
from gough.dynamics.identification.base import BaseParameters
from gough.dynamics.identification.parameters import (
    ENTRIES,
    INERTIAL,
    Parameters,
    ten_numbers,
    tensor_of,
)
from gough.dynamics.rotors import rotors_of
from gough.errors import GoughError

Array = NDArray[np.float64]

TINY = 1e-12
"""Eigenvalues of a scaled pseudo-inertia may be this far below 0, by rounding."""
PROJECTIONS = 2000
"""Pairs of projections before it is given up."""
MARGIN = 1e-6
"""Scaled eigenvalues that are aimed at for bodies with mass: inside, so that the way there ends."""
MASSLESS = 1e-12
"""A smaller part of a typical mass is none."""


class ImpossibleParameters(GoughError, ValueError):
    """Estimated parameters belong to no bodies with masses.

    Attributes:
        owners: bodies and motors whose numbers are impossible.
        values: the full set nearest to the description, which a regressor can still use.
    """

    def __init__(self, owners: Sequence[str], values: Array) -> None:
        self.owners, self.values = tuple(owners), values
        super().__init__(
            "no distribution of mass has the estimated base parameters; the nearest full set is "
            f"impossible for {', '.join(self.owners)}. Measure a motion that excites them more, or "
            "use the estimate through the regressor: identification.efforts"
        )


def full_parameters(parameters: Parameters, base: BaseParameters, values: Array) -> Array:
    """All parameters with given base parameters, with the least change of the description.

    Changes are measured in typical sizes: min |(φ - φ_described) / size|, matrix φ = values.
    """
    return np.asarray(parameters.values + _least(parameters, base) @ (values - base.values))


def _least(parameters: Parameters, base: BaseParameters) -> Array:
    """Least changes of all parameters for changes of base parameters, (all, base)."""
    return np.asarray(parameters.scale[:, None] * np.linalg.pinv(base.matrix * parameters.scale))


def possible_parameters(parameters: Parameters, base: BaseParameters, values: Array) -> Array:
    """All parameters with given base parameters that bodies and motors can have.

    Raises:
        ImpossibleParameters: none were found.
    """
    nearest = full_parameters(parameters, base, values)
    if not _impossible(parameters, nearest):
        return nearest
    least, found, rest = _least(parameters, base), nearest.copy(), np.zeros(parameters.inertial)
    for _ in range(PROJECTIONS):
        pushed = found.copy()
        pushed[: parameters.inertial] += rest
        inside = _projected(parameters, pushed)
        rest = pushed[: parameters.inertial] - inside[: parameters.inertial]
        found = inside + least @ (values - base.of(inside))
        if not _impossible(parameters, found):
            return found
    raise ImpossibleParameters(_impossible(parameters, nearest), nearest)


# pseudo-inertia


def pseudo_inertia(ten: Array) -> Array:
    """P of ten numbers, (*batch, 4, 4)."""
    J = tensor_of(ten)
    P = np.zeros((*ten.shape[:-1], 4, 4))
    P[..., :3, :3] = _spread(J)
    P[..., :3, 3] = P[..., 3, :3] = ten[..., 1:4]
    P[..., 3, 3] = ten[..., 0]
    return P


def _spread(J: Array) -> Array:
    """Σ = ½ tr(J) 1 - J."""
    half = 0.5 * np.trace(J, axis1=-2, axis2=-1)[..., None, None]
    return np.asarray(half * np.eye(3) - J)


def _ten(P: Array) -> Array:
    """The ten numbers of pseudo-inertias: J = tr(Σ) 1 - Σ."""
    spread = P[..., :3, :3]
    J = np.trace(spread, axis1=-2, axis2=-1)[..., None, None] * np.eye(3) - spread
    entries = np.stack([J[..., i, k] for i, k in ENTRIES], axis=-1)
    return np.concatenate([P[..., 3, 3:], P[..., :3, 3], entries], axis=-1)


def _scaled(parameters: Parameters, values: Array) -> tuple[Array, Array]:
    """Ten numbers of each body in typical sizes, and these sizes, (bodies, 10)."""
    shape = len(parameters.bodies), len(INERTIAL)
    size = parameters.scale[: parameters.inertial].reshape(shape)
    return values[: parameters.inertial].reshape(shape) / size, size


def _projected(parameters: Parameters, values: Array) -> Array:
    """The nearest parameters that bodies and motors can have."""
    scaled, size = _scaled(parameters, values)
    described, _ = _scaled(parameters, parameters.values)
    found = values.copy()
    least = np.where(described.any(axis=1), MARGIN, 0.0)[:, None]
    eigenvalues, vectors = np.linalg.eigh(pseudo_inertia(scaled))
    P = (vectors * np.maximum(eigenvalues, least)[:, None, :]) @ np.swapaxes(vectors, 1, 2)
    found[: parameters.inertial] = (_ten(P) * size).ravel()
    rotors = slice(parameters.inertial, parameters.inertial + len(parameters.motors))
    found[rotors] = np.maximum(found[rotors], 0.0)
    return found


def _impossible(parameters: Parameters, values: Array) -> list[str]:
    """Bodies and motors that can not have these parameters."""
    scaled, _ = _scaled(parameters, values)
    least = np.linalg.eigvalsh(pseudo_inertia(scaled))[:, 0]
    found = [body for body, x in zip(parameters.bodies, least, strict=True) if x < -TINY]
    rotors = values[parameters.inertial : parameters.inertial + len(parameters.motors)]
    sizes = parameters.scale[parameters.inertial :]
    for motor, x, size in zip(parameters.motors, rotors, sizes, strict=False):
        if x < -TINY * size:
            found.append(motor.name)
    return found


# the description


def with_parameters(parameters: Parameters, values: Array) -> Mechanism:
    """The mechanism, its legs written out, with other inertia of bodies and rotors.

    Friction is no part of a description and is left out.

    Raises:
        ImpossibleParameters: a body or a motor can not have its numbers.
    """
    impossible = _impossible(parameters, values)
    if impossible:
        raise ImpossibleParameters(impossible, values)
    written = parameters.structure.mechanism.written_out()
    bodies, joints = dict(written.bodies), dict(written.joints)
    typical = parameters.scale[0] if parameters.inertial else 1.0
    for k, body in enumerate(parameters.bodies):
        ten = values[k * len(INERTIAL) : (k + 1) * len(INERTIAL)]
        described = parameters.values[k * len(INERTIAL) : (k + 1) * len(INERTIAL)]
        if not np.array_equal(ten, described):
            bodies[body] = _with_inertia(bodies[body], ten, typical)
    rotors = values[parameters.inertial :]
    for motor, rotor in zip(parameters.motors, rotors, strict=False):
        joint = joints.get(motor.name)
        if joint is not None and rotor != parameters.values[parameters.index(f"{motor.name}.Ia")]:
            joints[motor.name] = _with_rotor(parameters, joint, max(float(rotor), 0.0))
    return Mechanism(**{**dict(written), "bodies": bodies, "joints": joints})


def _with_inertia(body: Body, ten: Array, typical: float) -> Body:
    """A body with ten numbers about its origin."""
    mass = float(ten[0])
    if mass < MASSLESS * typical:
        update = {"mass": 0.0, "com": (0.0, 0.0, 0.0), "inertia": (0.0, 0.0, 0.0)}
        return body.model_copy(update=update)
    com = ten[1:4] / mass
    central = ten - ten_numbers(mass, com, np.zeros((3, 3)))
    J = _central(tensor_of(central))
    entries = tuple(float(J[i, k]) for i, k in ENTRIES)
    return body.model_copy(update={"mass": mass, "com": tuple(com.tolist()), "inertia": entries})


def _central(J: Array) -> Array:
    """An inertia at the centre of mass without what rounding puts below what is possible."""
    eigenvalues, vectors = np.linalg.eigh(_spread(J))
    spread = (vectors * np.maximum(eigenvalues, 0.0)) @ vectors.T
    return np.asarray(np.trace(spread) * np.eye(3) - spread)


def _with_rotor(parameters: Parameters, joint: Joint, rotor: float) -> Joint:
    """A joint that feels a given inertia: of its laws where these have any, else of its motor."""
    values = parameters.assembler.values
    laws = rotors_of(joint.model_copy(update={"motor": None}), values).get(0, 0.0)
    if laws:
        factor, actuators = rotor / float(laws), dict(joint.actuators)
        for name, actuator in actuators.items():
            if "inertia" in actuator.numbers:
                own = float(array(actuator.numbers["inertia"], values))
                numbers = {**actuator.numbers, "inertia": factor * own}
                actuators[name] = actuator.model_copy(update={"numbers": numbers})
        return joint.model_copy(update={"actuators": actuators})
    motor = joint.motor or Motor()
    ratio = float(scalar(motor.ratio, values))
    driven = motor.model_copy(update={"inertia": rotor / ratio**2})
    return joint.model_copy(update={"motor": driven})
