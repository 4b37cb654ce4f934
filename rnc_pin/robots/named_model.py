"""Pinocchio model with look-ups by name that raise an error for unknown names."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pinocchio as pin

from rnc_pin.errors import ModelError, nearest
from rnc_pin.robots.joint_values import JointValue, SingleJoint, configuration, joint_index, values_of


class NamedModel:
    """Joints, frames and configurations of a model by name.

    Args:
        model: any ``pinocchio.Model``.
    """

    def __init__(self, model: pin.Model) -> None:
        self.model = model
        self.nq: int = model.nq
        self.nv: int = model.nv
        self.name: str = model.name

    def joint_id(self, name: str) -> int:
        """Index of a joint. An unknown name raises ModelError with the nearest name."""
        return joint_index(self.model, name)

    def frame_id(self, name: str) -> int:
        """Index of a frame (link, joint or operational frame).

        If a link and a joint share the name, the link's frame is returned. An unknown name raises ModelError with the
        nearest name.
        """
        if not isinstance(name, str) or not self.model.existFrame(name):
            valid = [frame.name for frame in self.model.frames]
            raise ModelError(f"no frame '{name}' in robot '{self.name}'{nearest(str(name), valid)}")
        same = [index for index, frame in enumerate(self.model.frames) if frame.name == name]
        return next((index for index in same if self.model.frames[index].type == pin.FrameType.BODY), same[0])

    def velocity_indices(self, joint: str) -> slice:
        """Slice of a joint's velocity in ``v``."""
        model = self.model.joints[self.joint_id(joint)]
        return slice(model.idx_v, model.idx_v + model.nv)

    def single_joint(self, name: str, remedy: str = "expected one") -> SingleJoint:
        """Place in q and v of a joint with one degree of freedom.

        Args:
            name: name of the joint.
            remedy: end of the message for a joint with several.

        Raises:
            ModelError: unknown joint, or one with several degrees of freedom.
        """
        joint = self.model.joints[self.joint_id(name)]
        if joint.nv != 1:
            raise ModelError(f"joint '{name}' has {joint.nv} degrees of freedom: {remedy}")
        return SingleJoint.of(joint)

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names of the movable joints, in model order."""
        return tuple(list(self.model.names)[1:])

    @property
    def velocity_names(self) -> tuple[str, ...]:
        """Names of the entries of ``v``: the joint name, with an index if the joint has several entries."""
        names: list[str] = []
        for index, name in enumerate(self.joint_names, start=1):
            size = self.model.joints[index].nv
            names += [name] if size == 1 else [f"{name}[{k}]" for k in range(size)]
        return tuple(names)

    @property
    def velocity_units(self) -> tuple[str, ...]:
        """Unit of each entry of ``v``: "rad/s" for rotation about any axis, "m/s" for translation."""
        jacobian = pin.computeJointJacobians(self.model, self.model.createData(), pin.neutral(self.model))
        turning = jacobian.reshape(6, self.nv)[3:]  # Pinocchio gives (6,) where nv is 1
        return tuple("rad/s" if column.any() else "m/s" for column in turning.T)

    def configuration(self, values: Mapping[str, JointValue] | None = None) -> np.ndarray:
        """Neutral configuration (nq,) with the given joint values.

        Args:
            values: joint name to angle [rad] or displacement [m]. A planar base takes (x, y, yaw), a free base
                (x, y, z) and a quaternion (x, y, z, w), a ball joint the quaternion.

        Raises:
            ModelError: unknown joint, or the wrong number of values for one.
        """
        return configuration(self.model, values or {})

    def joint_values(self, q: np.ndarray) -> dict[str, float | list[float]]:
        """Joint name to value(s) [rad or m] at q (nq,), the inverse of ``configuration``."""
        return values_of(self.model, q)

    def random_configuration(self, generator: np.random.Generator, spread: float = np.pi) -> np.ndarray:
        """Random configuration (nq,) from ``generator``, within joint limits and ``spread`` [rad or m] of neutral."""
        q = pin.integrate(self.model, pin.neutral(self.model), generator.uniform(-spread, spread, self.nv))
        for joint in list(self.model.joints)[1:]:
            if joint.nq == joint.nv == 1:
                low = max(self.model.lowerPositionLimit[joint.idx_q], -spread)
                high = min(self.model.upperPositionLimit[joint.idx_q], spread)
                if low < high:
                    q[joint.idx_q] = generator.uniform(low, high)
        return q
