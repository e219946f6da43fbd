"""Joint types, one file each, and the constraints that join frames without being a joint."""

from __future__ import annotations

from gough.joints.base import JointType
from gough.joints.cylindrical import Cylindrical
from gough.joints.fixed import Fixed
from gough.joints.free import Free
from gough.joints.helical import Helical
from gough.joints.parallelogram import Parallelogram
from gough.joints.planar import Planar
from gough.joints.prismatic import Prismatic
from gough.joints.revolute import Revolute
from gough.joints.spherical import Spherical
from gough.joints.universal import Universal

TYPES: dict[str, JointType] = {
    joint.name: joint
    for joint in (
        Revolute(),
        Prismatic(),
        Helical(),
        Cylindrical(),
        Universal(),
        Spherical(),
        Planar(),
        Parallelogram(),
        Free(),
        Fixed(),
    )
}
"""Every joint type by its name."""

__all__ = ["TYPES", "Free", "JointType"]
