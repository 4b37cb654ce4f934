"""Robot of a draft at its start values, with the base pose of the file."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pinocchio as pin

from rnc_pin.applications.init.evidence import DriveEvidence, body_frame, sliding_axis, turning_axis
from rnc_pin.applications.init.shapes import ALIGNED, GEOMETRY, Shape, first_smallest, missing_meshes, shapes
from rnc_pin.applications.init.source import FileNames
from rnc_pin.robots import Robot


@dataclass(frozen=True)
class RobotAtStart:
    """Robot at its start values, with the base pose of the file.

    Attributes:
        robot: the robot.
        start: start values of joints with one degree of freedom.
        names: names in the file that the model does not contain.
        drives: evidence for which joints have a motor.
        is_urdf: True for a URDF; a base cannot replace free joints of a URDF.
        is_rigid: True if the file has no movable joint; the robot then has a free base.
    """

    robot: Robot
    start: dict[str, float]
    names: FileNames
    drives: DriveEvidence
    is_urdf: bool = True
    is_rigid: bool = False

    @cached_property
    def q(self) -> np.ndarray:
        """Configuration at the start (nq,)."""
        return self.robot.configuration(self.start)

    @cached_property
    def data(self) -> pin.Data:
        """Placements and joint Jacobians at the start."""
        data = self.robot.model.createData()
        pin.computeJointJacobians(self.robot.model, data, self.q)
        pin.updateFramePlacements(self.robot.model, data)
        return data

    @cached_property
    def shapes(self) -> dict[str, list[Shape]]:
        """Shapes of the "collision" and the "visual" geometry.

        A body behind the base that lacks a mesh has no shapes of that geometry: the rest, such as the hub of a wheel
        without its tyre, would give a wrong size.
        """
        return {
            kind: [
                each
                for each in shapes(self.robot, kind, self.q)
                if each.joint <= self.root or each.joint not in self.missing_meshes[kind]
            ]
            for kind in GEOMETRY
        }

    @cached_property
    def missing_meshes(self) -> dict[str, dict[int, list[str]]]:
        """Names of missing meshes of the "collision" and the "visual" geometry, by joint index."""
        return {kind: missing_meshes(self.robot, kind) for kind in GEOMETRY}

    @cached_property
    def own_planar_joints(self) -> tuple[str, ...]:
        """Joints of the file's own planar base: two horizontal slides and a vertical revolute joint, or none."""
        model = self.robot.model
        joints: list[str] = []
        index, slides, turns = 0, 0, 0
        while len(model.children[index]) == 1 and len(joints) < 3:
            index = int(model.children[index][0])
            if model.joints[index].nv != 1:
                return ()
            axis = turning_axis(model, self.data, index)
            slides += not axis.any() and abs(sliding_axis(model, self.data, index)[2]) < ALIGNED
            turns += abs(axis[2]) > 0.999
            joints.append(str(model.names[index]))
        return tuple(joints) if (slides, turns) == (2, 1) else ()

    @cached_property
    def root(self) -> int:
        """Index of the joint that carries the base; 0 if the base is fixed to the world."""
        if self.own_planar_joints:
            return self.robot.joint_id(self.own_planar_joints[-1])
        model = self.robot.model
        return 1 if model.joints[1].nv > 1 and len(model.children[0]) == 1 else 0

    @property
    def has_replaceable_free_joint(self) -> bool:
        """True if a free joint of a URDF carries the base: a planar base can replace it if it is locked."""
        return bool(self.is_urdf and self.root and self.robot.model.joints[self.root].nv == 6) and not self.is_rigid

    @property
    def own_joint(self) -> dict[str, list[float]]:
        """Name and value of the joint that carries the base."""
        return {str(self.robot.model.names[self.root]): self.several_values(self.root)}

    @property
    def loose(self) -> dict[str, list[float]]:
        """Names and values of joints with several degrees of freedom, without the joint of the base."""
        joints = list(self.robot.model.joints)
        return {
            str(self.robot.model.names[index]): self.several_values(index)
            for index in range(1, len(joints))
            if joints[index].nv > 1 and index != self.root
        }

    def several_values(self, index: int) -> list[float]:
        """Return the start values of a joint with several degrees of freedom."""
        values = self.robot.joint_values(self.q)[str(self.robot.model.names[index])]
        return values if isinstance(values, list) else [values]

    def leader(self, joint: str) -> str:
        """Return the last leader in a joint's chain of mimics, or the joint itself."""
        follows = {each.joint: each.of for each in self.robot.mimics if each.of in self.robot.joint_names}
        seen = {joint}
        while joint in follows and follows[joint] not in seen:
            joint = follows[joint]
            seen.add(joint)
        return joint

    @cached_property
    def frame(self) -> str:
        """Frame of the base: ``base_link`` if it exists, else the first link."""
        frames = [
            str(frame.name)
            for frame in self.robot.model.frames
            if frame.parentJoint == self.root and frame.type == pin.FrameType.BODY and frame.name != "universe"
        ]
        if "base_link" in frames:
            return "base_link"
        return frames[0] if frames else body_frame(self.robot, max(self.root, 1))

    @cached_property
    def placement(self) -> pin.SE3:
        """Placement of the base's frame in the world."""
        return self.data.oMf[self.robot.frame_id(self.frame)]

    def along(self, direction: np.ndarray) -> str:
        """Return the base's local axis nearest to a direction in the world frame (3,); the first one in a tie."""
        return "xyz"[first_smallest(-np.abs(self.placement.rotation.T @ direction), ALIGNED)]

    def own_point(self, point: np.ndarray) -> list[float]:
        """Return a point of the world frame (3,) in the base's frame [m]."""
        return [round(float(each), 6) + 0.0 for each in self.placement.actInv(point)]

    @cached_property
    def title(self) -> tuple[str, ...]:
        """Names of the whole robot: of its file, its model, its plugins and the frame of its base.

        Links of one rigid body count too. Those of other robots do not: "rotor" may be a part of an arm's motor.
        """
        links = [str(frame.name) for frame in self.robot.model.frames] if self.is_rigid else []
        return self.names.title, self.robot.model.name, self.names.plugins, self.frame, *links

    def names_on(self, *joints: str) -> tuple[str, ...]:
        """Return the names of joints, of the links on them, and of the meshes of these links."""
        indices = {0 if joint == "universe" else self.robot.joint_id(joint) for joint in joints}
        links = [str(frame.name) for frame in self.robot.model.frames if frame.parentJoint in indices]
        return *joints, *links, *(self.names.meshes.get(link, "") for link in links)
