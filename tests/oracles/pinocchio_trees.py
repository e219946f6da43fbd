"""A robot's tree as a Pinocchio model, and its loops closed by equations of our own."""

from __future__ import annotations

from functools import cached_property

import numpy as np
import pinocchio as pin

from gough.robot import Robot
from tests.oracles.trees import Array, Closed, Engine, Link, Motion, Moving, Tree, moving

JOINTS = {
    "x": pin.JointModelPX,
    "y": pin.JointModelPY,
    "z": pin.JointModelPZ,
    "rx": pin.JointModelRX,
    "ry": pin.JointModelRY,
    "rz": pin.JointModelRZ,
    "ball": pin.JointModelSpherical,
    "free": pin.JointModelFreeFlyer,
}
WORLD_AXES = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
RANK = 1e-9
"""Singular values of the constraints below this part of the largest count as zero."""


class PinocchioTree:
    """The tree of a robot in Pinocchio, and its closings as pairs of frames."""

    def __init__(self, robot: Robot) -> None:
        self.robot, self.tree, self.model = robot, Tree(robot), pin.Model()
        self.model.gravity.linear = self.tree.gravity
        self.joint_of = {self.tree.root: 0}
        self._T_joint_body = {self.tree.root: pin.SE3.Identity()}
        joints = [joint for link in self.tree.links for joint in self._add(link)]
        self._frames = [self._closing_frames(k, part) for k, part in enumerate(self.tree.closings)]
        self.data = self.model.createData()
        places = [(self.model.joints[j].idx_q, self.model.joints[j].idx_v) for j in joints]
        self.engine = Engine((self.model.nq, self.model.nv), tuple(places), True, True)

    def _add(self, link: Link) -> list[int]:
        """The joints of a link, one for each motion."""
        joint = self.joint_of[link.parent]
        placement = self._T_joint_body[link.parent] * pin.SE3(link.T_parent_joint)
        added = []
        for k, motion in enumerate(link.motions):
            joint = self._joint(joint, motion, placement, f"{link.name}/{k}")
            placement = pin.SE3.Identity()
            added.append(joint)
        T = placement * pin.SE3(link.T_joint_body)
        self.joint_of[link.name], self._T_joint_body[link.name] = joint, T
        if link.mass or link.inertia.any():
            self.model.appendBodyToJoint(joint, pin.Inertia(link.mass, link.com, link.inertia), T)
        return added

    def _joint(self, parent: int, motion: Motion, placement: pin.SE3, name: str) -> int:
        return int(self.model.addJoint(parent, JOINTS[motion.kind](), placement, name))

    def _closing_frames(self, k: int, part: Closed) -> tuple[int, int]:
        found: list[int] = []
        for body, T in zip(part.bodies, part.T_body_frame, strict=True):
            placement = self._T_joint_body[body] * pin.SE3(T)
            name = f"closing {k} {len(found)}"
            frame = pin.Frame(name, self.joint_of[body], 0, placement, pin.FrameType.OP_FRAME)
            found.append(int(self.model.addFrame(frame)))
        return found[0], found[1]

    def state(self, q: Array, v: Array, vd: Array) -> Moving:
        """The library's state in Pinocchio's coordinates."""
        return moving(self.tree, self.engine, q, v, vd)

    # Pinocchio's own closed loops

    @cached_property
    def contacts(self) -> tuple[pin.StdVec_RigidConstraintModel, pin.StdVec_RigidConstraintData]:
        """Its constraints of three or six equations, where those of the closings are such."""
        models = pin.StdVec_RigidConstraintModel()
        for (a, b), part in zip(self._frames, self.tree.closings, strict=True):
            points = part.type in ("spherical", "points-coincide")
            assert points or part.type == "frames-coincide"
            kind = pin.ContactType.CONTACT_3D if points else pin.ContactType.CONTACT_6D
            ends = [(self._frame(k).parentJoint, self._frame(k).placement) for k in (a, b)]
            model = pin.RigidConstraintModel(kind, self.model, *ends[0], *ends[1], pin.LOCAL)
            models.append(model)
        datas = pin.StdVec_RigidConstraintData()
        datas.extend([model.createData() for model in models])
        pin.initConstraintDynamics(self.model, self.data, models, datas)
        return models, datas

    def _frame(self, k: int) -> pin.Frame:
        return self.model.frames[k]

    def constrained(self, state: Moving, tau: Array) -> Array:
        """Accelerations by `constraintDynamics`."""
        models, datas = self.contacts
        settings = pin.ProximalSettings(1e-14, 0.0, 1)
        forces = state.S @ self.tree.efforts(tau)
        found = pin.constraintDynamics(
            self.model, self.data, state.q, state.v, forces, models, datas, settings
        )
        return np.array(found)

    # closings of any number of equations

    def projected(self, state: Moving, tau: Array) -> Array:
        """Accelerations by Z (Zᵀ M Z)⁻¹ Zᵀ (τ - h - M a0) + a0 with J Z = 0, J a0 = -γ.

        Raises:
            ArithmeticError: the rates break the closings, or their second rates contradict.
        """
        forces = state.S @ self.tree.efforts(tau)
        M = pin.crba(self.model, self.data, state.q)
        M = np.triu(M) + np.triu(M, 1).T
        h = pin.nonLinearEffects(self.model, self.data, state.q, state.v)
        J, gamma = self.closing_rows(state)
        U, s, Vt = np.linalg.svd(J)
        rank = int(np.sum(s > RANK * s[0]))
        a0, Z = -Vt[:rank].T @ (U[:, :rank].T @ gamma / s[:rank]), Vt[rank:].T
        if np.abs(J @ state.v).max() > 1e-8 * np.abs(state.v).max():
            raise ArithmeticError("the rates break the closings")
        if np.abs(J @ a0 + gamma).max() > 1e-7 * max(1.0, np.abs(gamma).max()):
            raise ArithmeticError("no accelerations keep the loops closed")
        left, right = Z.T @ M @ Z, Z.T @ (forces - h - M @ a0)
        return np.asarray(a0 + Z @ np.linalg.solve(left, right))

    def closing_rows(self, state: Moving) -> tuple[Array, Array]:
        """J and γ with J v = 0 and J v̇ + γ = 0, redundant rows and all."""
        model, data = self.model, self.data
        pin.computeJointJacobians(model, data, state.q)
        pin.forwardKinematics(model, data, state.q, state.v, np.zeros(model.nv))
        pin.updateFramePlacements(model, data)
        rows = [
            self._rows(a, b, part.type)
            for (a, b), part in zip(self._frames, self.tree.closings, strict=True)
        ]
        return np.vstack([J for J, _ in rows]), np.concatenate([gamma for _, gamma in rows])

    def _rows(self, a: int, b: int, kind: str) -> tuple[Array, Array]:
        model, data = self.model, self.data
        Ja, Jb = (np.array(pin.getFrameJacobian(model, data, k, WORLD_AXES)) for k in (a, b))
        acceleration = [
            pin.getFrameClassicalAcceleration(model, data, k, WORLD_AXES) for k in (a, b)
        ]
        J, gamma = Jb - Ja, acceleration[1].vector - acceleration[0].vector
        if kind in ("spherical", "points-coincide"):
            return J[:3], gamma[:3]
        if kind in ("fixed", "frames-coincide"):
            return J, gamma
        assert kind == "revolute"
        # ω_b - ω_a has no part across z_a: x·δω = 0, its rate is x·δω̇ + (ω_a × x)·δω
        across = np.array(data.oMf[a].rotation)[:, :2].T
        va, vb = (pin.getFrameVelocity(model, data, k, WORLD_AXES).angular for k in (a, b))
        turned = np.cross(va, across) @ (vb - va)
        rows = np.vstack([J[:3], across @ J[3:]])
        return rows, np.concatenate([gamma[:3], across @ gamma[3:] + turned])
