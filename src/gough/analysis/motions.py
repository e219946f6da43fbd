"""Motions in words: internal mobility, and what a singularity gains or loses."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gough.analysis.ranks import Linearisation, null_space
from gough.analysis.twists import ZERO, echelon, name_space, name_twist
from gough.assembly import Assembler
from gough.description.frames import transform
from gough.joints.free import POSE

Array = NDArray[np.float64]


@dataclass(frozen=True)
class FreeMotion:
    """A motion that leaves motors and outputs at rest."""

    bodies: tuple[str, ...]
    description: str


class Motions:
    """The bodies of a mechanism at one closed configuration, and how rates move them."""

    def __init__(self, assembler: Assembler, q: Array, rates: Linearisation) -> None:
        models = assembler.models
        self.structure, self.rates, self.length = models.structure, rates, assembler.length
        self.values = assembler.values
        self.rate_scale = assembler.rate_scale
        bodies = self.structure.bodies
        self.poses = dict(zip(bodies, models.poses(q, assembler.p), strict=True))
        self.poses[self.structure.root] = np.eye(4)
        self._models, self._at = models, (q, assembler.p)

    def twists(self, body: str, columns: list[int], scaled: Array) -> Array:
        """Twists (6, k) of a body for k columns of scaled rates of some variables, root axes."""
        J = self._models.body_jacobian(body)(*self._at)[:, columns]
        return np.asarray(J * self.rate_scale[columns] @ scaled)

    def origin(self, body: str) -> Array:
        """Origin of a body in axes of the root, m."""
        return np.asarray(self.poses[body][:3, 3])

    # internal mobility

    def free(self) -> list[FreeMotion]:
        """The passive motions with motors and outputs at rest, each as few bodies as can be."""
        columns = self.structure.columns("passive")
        basis = echelon(null_space(self.rates.N, self.rates.threshold).T)
        return [self._free_motion(columns, row) for row in basis]

    def _free_motion(self, columns: list[int], rates: Array) -> FreeMotion:
        groups = self._groups(columns, rates)
        texts = [self._group_text(bodies, twist) for bodies, twist in groups]
        moving = tuple(body for bodies, _ in groups for body in bodies)
        return FreeMotion(moving, "; ".join(texts))

    def _groups(self, columns: list[int], rates: Array) -> list[tuple[list[str], Array]]:
        """Bodies that move as one, with their common twist at the first one's origin."""
        fields: list[tuple[list[str], Array, Array]] = []
        largest = 0.0
        for body in self.structure.bodies:
            twist = self.twists(body, columns, rates[:, None])[:, 0]
            field = np.concatenate(
                [(twist[:3] - np.cross(twist[3:], self.origin(body))) / self.length, twist[3:]]
            )
            largest = max(largest, float(np.abs(field).max()))
            same = next((f for f in fields if np.allclose(f[1], field, atol=ZERO)), None)
            if same is not None:
                same[0].append(body)
            else:
                fields.append(([body], field, twist))
        moving = [(b, t) for b, f, t in fields if np.abs(f).max() > ZERO * largest]
        named = [([body for body in b if "@" not in body], t) for b, t in moving]
        return [(bodies, twist) for bodies, twist in named if bodies]

    def _group_text(self, bodies: list[str], twist: Array) -> str:
        whole = set(self.structure.bodies) <= {*bodies, *self._pieces}
        who = "the whole mechanism" if whole else ", ".join(bodies)
        verb = "spins" if len(bodies) == 1 else "spin together"
        # the axis of several bodies is told from the origin of the root, whichever comes first
        start = self.origin(bodies[0]) if len(bodies) == 1 else np.zeros(3)
        moved = twist.copy()
        moved[:3] += np.cross(twist[3:], start - self.origin(bodies[0]))
        motion = name_twist(moved, start, self.length, who, tell_axis=len(bodies) > 1)
        if (
            not whole
            and motion.kind == "rotation"
            and self._through_joints(bodies, motion.direction, motion.point)
        ):
            own = "its own axis" if len(bodies) == 1 else "their own axis"
            return f"{who} {verb} about {own}"
        return motion.text

    @property
    def _pieces(self) -> set[str]:
        return {body for body in self.structure.bodies if "@" in body}

    def _through_joints(self, bodies: list[str], direction: object, point: object) -> bool:
        """Whether an axis passes all joints that hold a group of bodies, at two points or more."""
        ends = self._ends(bodies)
        if len(ends) < 2:
            return False
        arms = np.array(ends) - np.asarray(point)
        off = np.linalg.norm(np.cross(arms, np.asarray(direction)), axis=1)
        apart = np.linalg.norm(np.ptp(np.array(ends), axis=0))
        return bool(np.all(off < 1e-6 * self.length) and apart > 1e-6 * self.length)

    def _ends(self, bodies: list[str]) -> list[Array]:
        """Where joints and constraints hold a group of bodies, in axes of the root."""
        ends = []
        for part in self.structure.flat.links:
            inside = [body in bodies for body in part.bodies]
            if sum(inside) == 1:
                k = inside.index(True)
                _, origin = transform(part.frames[k], self.values)
                ends.append((self.poses[part.bodies[k]] @ np.array([*origin, 1.0]))[:3])
        return ends

    # the platform

    @property
    def platform_columns(self) -> list[int]:
        """The variables in the order of the columns of E by role: motors, passive, outputs."""
        columns = self.structure.columns
        return columns("actuated") + columns("passive") + columns("operational")

    def platform_twists(self, kernel: Array) -> Array:
        """V_P: twists of the platform relative to the base (6, k), base axes, for rates by role."""
        platform, base = self.structure.mechanism.platform, self.structure.mechanism.base
        if platform is None:
            return np.zeros((6, 0))
        own = self.twists(platform, self.platform_columns, kernel)
        if base == self.structure.root:
            return own
        carried = self.twists(base, self.platform_columns, kernel)
        arm = self.origin(platform) - self.origin(base)
        carried[:3] += np.cross(carried[3:], arm, axis=0)
        back = self.poses[base][:3, :3].T
        return np.vstack([back @ (own - carried)[:3], back @ (own - carried)[3:]])

    def _platform_origin(self, platform: str) -> Array:
        """Origin of the platform in axes of the base, m."""
        base = self.poses[self.structure.mechanism.base]
        return np.asarray(base[:3, :3].T @ (self.origin(platform) - base[:3, 3]))

    def platform_rank(self) -> int:
        """Rank of the platform twists that the equations allow."""
        twists = self.platform_twists(self.rates.kernel)
        scaled = twists / np.repeat([self.length, 1.0], 3)[:, None]
        s = np.linalg.svd(scaled, compute_uv=False) if scaled.size else np.zeros(0)
        return int(np.sum(s > 1e-7))

    def with_motors_locked(self) -> list[str]:
        """What the outputs can still do with the motors locked, in words."""
        rates = self.rates
        locked = null_space(np.hstack([rates.N, rates.K]), rates.threshold)
        a, p, o = rates.counts.actuated, rates.counts.passive, rates.counts.operational
        kernel = np.vstack([np.zeros((a, locked.shape[1])), locked])
        if self.structure.platform_is_output:
            return self._platform_words(kernel)
        scale = self.rate_scale[self.structure.columns("operational")]
        return [self._output_words(r * scale) for r in echelon(_range(locked[p:]).T)] if o else []

    def with_outputs_at_rest(self) -> list[str]:
        """Platform motions that the equations allow while the outputs are at rest, in words."""
        kernel, o = self.rates.kernel, self.rates.counts.operational
        at_rest = null_space(kernel[kernel.shape[0] - o :], 1e-9) if o else np.eye(kernel.shape[1])
        return self._platform_words(kernel @ at_rest)

    def lost(self) -> list[str]:
        """Directions of the outputs that no motor can follow, in words."""
        o = self.rates.counts.operational
        reach = self.rates.kernel[self.rates.kernel.shape[0] - o :]
        # what a combination of output rates comes to: its weights are divided by the scale
        scale = self.rate_scale[self.structure.columns("operational")]
        return [self._output_words(row / scale) for row in echelon(null_space(reach.T, 1e-7).T)]

    def _platform_words(self, kernel: Array) -> list[str]:
        platform = self.structure.mechanism.platform
        if platform is None or not kernel.size:
            return []
        twists = self.platform_twists(kernel)
        size = np.abs(twists / np.repeat([self.length, 1.0], 3)[:, None]).max(initial=0.0)
        if size < ZERO:
            return []
        named = name_space(twists, self._platform_origin(platform), self.length, platform)
        return [motion.text for motion in named]

    def _output_words(self, weights: Array) -> str:
        """Outputs with weights, as a sum of their names."""
        names = [self.structure.variables[k].name for k in self.structure.columns("operational")]
        platform = self.structure.mechanism.platform
        plain = [
            n.removeprefix(f"{platform}.") if n.rsplit(".", 1)[-1] in POSE else n for n in names
        ]
        weights = weights / weights[np.argmax(np.abs(weights) > 0)]
        terms = [f"{w:.4g} {n}" if w != 1 else n for w, n in zip(weights, plain, strict=True) if w]
        return " + ".join(terms).replace("+ -", "- ")


def _range(A: Array) -> Array:
    """Orthonormal basis of the columns of A."""
    if not A.size:
        return np.zeros((A.shape[0], 0))
    U, s, _ = np.linalg.svd(A, full_matrices=False)
    return np.asarray(U[:, s > 1e-7])
