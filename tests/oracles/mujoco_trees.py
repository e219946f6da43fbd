"""A robot's tree as a MuJoCo model, all loops open."""

from __future__ import annotations

from xml.etree.ElementTree import Element, SubElement, tostring

import mujoco
import numpy as np

from gough.joints.quaternion import wxyz_from_rotations
from gough.robot import Robot
from tests.oracles.trees import Array, Engine, Link, Moving, Tree, moving

TYPES = {"x": "slide", "y": "slide", "z": "slide", "rx": "hinge", "ry": "hinge", "rz": "hinge"}


class MujocoTree:
    """The tree of a robot in MuJoCo. Its bodies have their frames where the library's joints are.

    Raises:
        ValueError: a body that moves has no mass.
    """

    def __init__(self, robot: Robot) -> None:
        self.robot, self.tree = robot, Tree(robot)
        self.model = mujoco.MjModel.from_xml_string(self._text())
        self.data = mujoco.MjData(self.model)
        joints = range(self.model.njnt)
        places = [(int(self.model.jnt_qposadr[j]), int(self.model.jnt_dofadr[j])) for j in joints]
        self.engine = Engine((self.model.nq, self.model.nv), tuple(places), False, False)

    def _text(self) -> str:
        """Bodies depth first, so that joints are numbered as the motions of the tree."""
        whole = Element("mujoco")
        SubElement(whole, "compiler", angle="radian")
        SubElement(whole, "option", gravity=_numbers(self.tree.gravity))
        bodies = {self.tree.root: SubElement(whole, "worldbody")}
        T_frame_body = {self.tree.root: np.eye(4)}
        for link in self.tree.links:
            T = T_frame_body[link.parent] @ link.T_parent_joint
            inertia = self._inertia(link)
            bodies[link.name] = _body(bodies[link.parent], link, T, inertia)
            T_frame_body[link.name] = link.T_joint_body
        return tostring(whole, encoding="unicode")

    def _inertia(self, link: Link) -> Array:
        """As described, but where only rotations about z are: MuJoCo wants all three moments."""
        planar = self.robot.mechanism.motion == "planar"
        return link.inertia[2, 2] * np.eye(3) if planar else link.inertia

    def state(self, q: Array, v: Array, vd: Array) -> Moving:
        """The library's state in MuJoCo's coordinates."""
        return moving(self.tree, self.engine, q, v, vd)

    def mass_matrix_and_bias(self, state: Moving) -> tuple[Array, Array]:
        """M and h with M v̇ + h = forces, in MuJoCo's coordinates."""
        self.data.qpos, self.data.qvel = state.q, state.v
        mujoco.mj_forward(self.model, self.data)
        M = np.zeros((self.model.nv, self.model.nv))
        mujoco.mj_fullM(self.model, self.data, M)
        return M, self.data.qfrc_bias.copy()


def _body(parent: Element, link: Link, T: Array, inertia: Array) -> Element:
    quaternion = wxyz_from_rotations(T[:3, :3])
    body = SubElement(
        parent, "body", name=link.name, pos=_numbers(T[:3, 3]), quat=_numbers(quaternion)
    )
    for motion in link.motions:
        if motion.kind in TYPES:
            axis = np.eye(3)["xyz".index(motion.kind[-1])]
            SubElement(body, "joint", type=TYPES[motion.kind], axis=_numbers(axis))
        else:
            SubElement(body, "joint", type=motion.kind)
    R, p = link.T_joint_body[:3, :3], link.T_joint_body[:3, 3]
    six = (R @ inertia @ R.T)[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]
    at = _numbers(p + R @ link.com)
    SubElement(body, "inertial", pos=at, mass=repr(link.mass), fullinertia=_numbers(six))
    return body


def _numbers(values: Array) -> str:
    return " ".join(repr(float(x)) for x in values)
