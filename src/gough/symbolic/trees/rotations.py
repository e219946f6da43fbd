"""Rotation vectors, and bodies whose energy of rotation is a short formula in them.

With φ the rotation vector of a body and ω = J(φ) φ̇ its angular velocity in root axes,

    T = ½ φ̇ᵀ I φ̇ - κ φ̇ᵀ I (φ × φ̇),    M = I - κ (I φ̂ - φ̂ I),    forces along φ = M φ̈ + 2 κ φ̇ × I φ̇

The moment that moves the body is J⁻ᵀ times these forces. κ = ½ is the expansion of the exact energy
up to terms of third order; κ = 1 is what comes out if φ̇ itself is taken for the angular velocity
in fixed axes.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from math import pi

import casadi
from scipy.special import zeta

from gough import algebra as al
from gough.algebra import Matrix, Scalar, Vector
from gough.description.parts import Body
from gough.description.values import Values, vector
from gough.symbolic.trees.frames import Frames
from gough.symbolic.trees.motion import Motion
from gough.symbolic.trees.nodes import Node, Tree

KAPPA = {"truncated": 0.5, "as_printed": 1.0}
"""By what a description says of a body's rotation."""

ATAN_TERMS, REST_TERMS = 22, 14
"""Terms of the series below, for full precision up to half a turn."""
_ATAN = [(-1.0) ** k / (2 * k + 1) for k in range(ATAN_TERMS)]
"""arctan(t)/t in powers of t²; t is at most tan(π/8)."""
_FIRST = (2 * pi) ** 2
_REST = [2 * float(zeta(2 * k + 2, 2)) / (2 * pi) ** (2 * k + 2) for k in range(REST_TERMS)]
"""Σ 2/(4 n² π² - θ²) over n > 1 in powers of θ²."""


def rotation_vector(q: Sequence[Scalar]) -> Vector:
    """φ of a unit quaternion (w, x, y, z) or its opposite, |φ| ≤ π.

    θ/8 = arctan t after halving the angle twice more, so that no position is special.
    """
    w, x, y, z = q
    turned: Scalar = casadi.if_else(w < 0, -1.0, 1.0) if not al.is_number(w) else _sign(w)
    beside = al.add(1.0, al.mul(turned, w))
    v = al.scale(turned / beside, (x, y, z))
    fourth = al.dot(v, v)  # tan² θ/4
    halved = al.add(1.0, al.sqrt(al.add(1.0, fourth)))
    eighth = fourth / al.mul(halved, halved)
    return al.scale(al.mul(8.0, _horner(_ATAN, eighth)) / halved, v)


def _sign(w: float) -> float:
    return -1.0 if w < 0 else 1.0


def _horner(coefficients: Sequence[float], x: Scalar) -> Scalar:
    found: Scalar = coefficients[-1]
    for c in coefficients[-2::-1]:
        found = found * x + c
    return found


@dataclass(frozen=True)
class Turning:
    """J⁻¹ = 1 - ½ φ̂ + γ φ̂² at a rotation vector, which takes ω to φ̇."""

    phi: Vector
    gamma: Scalar
    """(1 - ½ θ cot ½ θ)/θ² = Σ 2/(4 n² π² - θ²)"""
    delta: Scalar
    """dγ/dθ over θ."""

    @classmethod
    def at(cls, phi: Vector) -> Turning:
        """The map at φ; the pole nearest to half a turn is taken by itself."""
        square = al.dot(phi, phi)
        first = 1.0 / (_FIRST - square)
        slopes = [2 * k * c for k, c in enumerate(_REST)][1:]
        gamma = 2.0 * first + _horner(_REST, square)
        return cls(phi, gamma, 4.0 * first * first + _horner(slopes, square))

    def rates(self, omega: Vector) -> Vector:
        """J⁻¹ ω."""
        return self._with(-0.5, omega)

    def moment(self, forces: Vector) -> Vector:
        """J⁻ᵀ times forces along φ."""
        return self._with(0.5, forces)

    def _with(self, half: float, x: Vector) -> Vector:
        once = al.cross(self.phi, x)
        twice = al.cross(self.phi, once)
        return al.plus(x, al.plus(al.scale(half, once), al.scale(self.gamma, twice)))

    def changes(self, phid: Vector, omega: Vector, alpha: Vector) -> Vector:
        """φ̈ = J⁻¹ α + (J⁻¹)˙ ω."""
        phi, once = self.phi, al.cross(self.phi, omega)
        slope = al.mul(self.delta, al.dot(phi, phid))
        mixed = al.plus(al.cross(phid, once), al.cross(phi, al.cross(phid, omega)))
        found = al.plus(self.rates(alpha), al.scale(-0.5, al.cross(phid, omega)))
        found = al.plus(found, al.scale(slope, al.cross(phi, once)))
        return al.plus(found, al.scale(self.gamma, mixed))


@dataclass(frozen=True)
class ShortRotation:
    """Energy of rotation of one body by the short formula."""

    inertia: Matrix
    """At the centre of mass, in body axes."""
    kappa: float

    def energy(self, phi: Vector, phid: Vector) -> Scalar:
        """T."""
        turned = al.turn(self.inertia, phid)
        exact = al.mul(0.5, al.dot(phid, turned))
        return al.sub(exact, al.mul(self.kappa, al.dot(turned, al.cross(phi, phid))))

    def forces(self, phi: Vector, phid: Vector, phidd: Vector) -> Vector:
        """M φ̈ + 2 κ φ̇ × I φ̇."""
        turning = al.cross(phid, al.turn(self.inertia, phid))
        return al.plus(self._mass(phi, phidd), al.scale(2 * self.kappa, turning))

    def _mass(self, phi: Vector, x: Vector) -> Vector:
        """M x."""
        one = al.turn(self.inertia, al.cross(phi, x))
        other = al.cross(phi, al.turn(self.inertia, x))
        return al.minus(al.turn(self.inertia, x), al.scale(self.kappa, al.minus(one, other)))

    def moment(self, phi: Vector, omega: Vector, alpha: Vector) -> Vector:
        """The moment that moves the body so, root axes."""
        turning = Turning.at(phi)
        phid = turning.rates(omega)
        return turning.moment(self.forces(phi, phid, turning.changes(phid, omega, alpha)))

    def tensor(self, phi: Vector) -> Matrix:
        """J⁻ᵀ M J⁻¹, the moment for unit angular accelerations from rest, root axes."""
        turning = Turning.at(phi)
        columns = [turning.moment(self._mass(phi, turning.rates(e))) for e in al.IDENTITY]
        return tuple(tuple(columns[max(i, k)][min(i, k)] for k in range(3)) for i in range(3))  # type: ignore[return-value]


@dataclass(frozen=True)
class OnNode:
    """A body of that kind on the ball that turns it."""

    node: Node
    rotation: ShortRotation

    def phi(self, frames: Frames) -> Vector:
        """Its rotation vector."""
        q, place = frames.tree.closure.q, self.node.place
        return rotation_vector([q[k] for k in range(place.start, place.stop)])

    def moment(self, motion: Motion) -> Vector:
        """The moment that moves it, in class axes."""
        frames, node = motion.frames, self.node
        root = frames.tree.root
        omega, alpha = (
            frames.turn(x, node.outer, root)
            for x in (motion.outer_spin(node), motion.outer_spin_rate(node))
        )
        found = self.rotation.moment(self.phi(frames), omega, alpha)
        return frames.turn(found, root, node.frame)

    def tensor(self, frames: Frames) -> Matrix:
        """Its tensor in root axes."""
        return self.rotation.tensor(self.phi(frames))


def short_rotations(tree: Tree, bodies: Iterable[str] | None = None) -> dict[int, OnNode]:
    """Bodies of a tree with such energies, by the index of their node.

    Args:
        tree: the mechanism.
        bodies: those that count; all by default.
    """
    described, values = tree.closure.structure.flat.bodies, tree.closure.values
    found = {}
    for body in tree.of_body if bodies is None else bodies:
        part = described.get(body)
        if part is None or part.rotation == "exact":
            continue
        node, *_ = tree.of_body[body]
        assert node.kind == "ball"
        assert not node.reversed
        found[node.index] = OnNode(node, short_rotation(part, values))
    return found


def short_rotation(body: Body, values: Values) -> ShortRotation:
    """The formula for a body as it is described."""
    xx, yy, zz, xy, xz, yz = (*vector(body.inertia, values, 3, 6), 0.0, 0.0, 0.0)[:6]
    return ShortRotation(((xx, xy, xz), (xy, yy, yz), (xz, yz, zz)), KAPPA[body.rotation])
