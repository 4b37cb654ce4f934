"""Mapping of actuator inputs to forces in MuJoCo.

An actuator of a joint acts on that joint. A force or torque on a frame of a wheeled vehicle models the effect of its
wheels. It becomes the smallest wheel torques with the same effect on the admissible motion,
``R^T B_wheels tau = R^T B T`` at the current configuration. Only wheels that have no actuator take part: first those
on the body of the frame, then all. If no wheels can produce an input, it acts on the frame itself; an example is a
torque that turns a single wheel about the vertical.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
import scipy

from rnc_pin.lab.mujoco.contact_bodies import ContactBody
from rnc_pin.model.kinematics import Kinematics
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.robots.robot import Robot

_RANK_TOLERANCE = 1e-9  # relative singular value below which rows are dependent


@dataclass(frozen=True)
class Drive:
    """Driven wheel: its contact, the index of its joint in v (None for a drawn wheel), and the normal of the ground."""

    contact: ContactBody
    velocity_index: int | None
    up: np.ndarray

    def effect(self, robot: Robot, data: pin.Data) -> np.ndarray:
        """Return the generalized force (nv,) of a unit torque; needs the joint Jacobians in ``data``.

        Args:
            robot: the robot.
            data: Pinocchio data with the joint Jacobians.
        """
        if self.velocity_index is not None:
            return np.eye(robot.nv)[self.velocity_index]
        joint, radius = self.contact.joint, self.contact.radius
        placement = data.oMi[joint]
        _, lowest = self.contact.at(placement, self.up)
        jacobian = pin.getJointJacobian(robot.model, data, joint, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED)
        moving = jacobian[:3] - pin.skew(lowest - placement.translation) @ jacobian[3:]
        assert self.contact.axle is not None  # balls have no drives
        heading = np.cross(placement.rotation @ self.contact.axle, self.up)
        return np.asarray(heading @ moving / (np.linalg.norm(heading) * radius))


class ActuatorMapping:
    """Actuator inputs as joint forces and wheel torques.

    Args:
        reduced: model with the actuators.
        contacts: ground contacts of the robot.
        q: configuration (nq,) near which wheels must reproduce the inputs of frames.
        up: normal of the ground (3,).

    Attributes:
        drawn: drawn wheels without joints, in the order of the forces of ``wheel_forces``.
        wheel_driven: names of the actuators that wheels replace.
    """

    def __init__(self, reduced: ReducedModel, contacts: Sequence[ContactBody], q: np.ndarray, up: np.ndarray) -> None:
        self._robot, self._actuation, self._rows = reduced.robot, reduced.actuation, reduced.constraints
        self._data = self._robot.model.createData()
        self._kinematics = Kinematics(self._robot)
        self._drives = _drives(reduced, contacts, up)
        self._drawn = [k for k, drive in enumerate(self._drives) if drive.velocity_index is None]
        self.drawn = tuple(self._drives[k].contact.name for k in self._drawn)
        self._groups = self._assigned(q)
        """Columns of B with the drives that reproduce them."""
        self._used = sorted({drive for _, drives in self._groups for drive in drives})
        wheeled = [column for columns, _ in self._groups for column in columns]
        self.wheel_driven = tuple(self._actuation.names[column] for column in wheeled)
        self._direct = np.setdiff1d(np.arange(reduced.p), wheeled)
        fixed = self._actuation.constant
        if fixed is None and set(wheeled) == self._actuation.configured:
            at = self._kinematics.position(q)  # the other actuators act on joints
            fixed = self._actuation.matrix(at) if wheeled else None
        self._constant = None if fixed is None else fixed[:, self._direct].copy()

    def wheel_forces(self, q: np.ndarray, T: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the wheel forces of inputs: generalized forces (nv,), and forces of drawn wheels (k,) [N].

        Args:
            q: configuration (nq,).
            T: inputs (p,).
        """
        force, drawn = np.zeros(self._robot.nv), np.zeros(len(self.drawn))
        if not self._groups:
            return force, drawn
        maps, effects = self._maps(q, self._used)
        for columns, drives in self._groups:
            # Only the effect on admissible motion counts: the rest of the force is carried by the constraints.
            effect = maps[0] @ (maps[1][:, columns] @ T[columns])
            torques = np.linalg.lstsq(maps[0] @ effects[:, drives], effect, rcond=_RANK_TOLERANCE)[0]
            for drive, torque in zip(drives, torques, strict=True):
                wheel = self._drives[drive]
                if wheel.velocity_index is None:
                    drawn[self._drawn.index(drive)] += torque / wheel.contact.radius
                else:
                    force[wheel.velocity_index] += torque
        return force, drawn

    @property
    def varies(self) -> bool:
        """True if ``joint_forces`` depends on the configuration."""
        return self._constant is None

    def joint_forces(self, q: np.ndarray, T: np.ndarray) -> np.ndarray:
        """Return the generalized force (nv,) of the inputs that wheels do not replace.

        Args:
            q: configuration (nq,).
            T: inputs (p,).
        """
        matrix = self._constant
        if matrix is None:
            matrix = self._actuation.matrix(self._kinematics.position(q))[:, self._direct]
        return matrix @ T[self._direct]

    # ------------------------------------------------------------------ which wheels

    def _maps(self, q: np.ndarray, used: Sequence[int]) -> tuple[tuple[np.ndarray, np.ndarray], np.ndarray]:
        """Return a basis of admissible motion (r, nv), B (nv, p), and effects of drives (nv, k), else zero."""
        at = self._kinematics.position(q)
        rows = self._rows.jacobian(at)
        basis = scipy.linalg.null_space(rows, rcond=_RANK_TOLERANCE).T if len(rows) else np.eye(self._robot.nv)
        pin.computeJointJacobians(self._robot.model, self._data, q)
        effects = np.zeros((self._robot.nv, len(self._drives)))
        for drive in used:
            effects[:, drive] = self._drives[drive].effect(self._robot, self._data)
        return (basis, self._actuation.matrix(at)), effects

    def _assigned(self, q: np.ndarray) -> list[tuple[list[int], list[int]]]:
        if not self._drives:
            return []
        generator, model = np.random.default_rng(0), self._robot.model
        count = 3  # configurations near q: wheels that reproduce an input at all of them do so on the way
        moved = [0.3 * generator.uniform(-1, 1, self._robot.nv) for _ in range(count - 1)]
        everything = range(len(self._drives))
        samples = [self._maps(each, everything) for each in (q, *(pin.integrate(model, q, step) for step in moved))]
        groups: dict[tuple[int, ...], list[int]] = {}
        for column, frame, _ in self._actuation.frames:
            body = model.frames[frame].parentJoint
            same = tuple(k for k, drive in enumerate(self._drives) if self._carrying_joint(drive) == body)
            # The own wheels of the body first: a motor on a body drives these.
            for drives in (same, tuple(everything)):
                if drives and all(_reproduces(maps, effects, column, drives) for maps, effects in samples):
                    groups.setdefault(drives, []).append(column)
                    break
        return [(columns, list(drives)) for drives, columns in groups.items()]

    def _carrying_joint(self, drive: Drive) -> int:
        """Return the joint of the body that carries a wheel."""
        joint = drive.contact.joint
        return joint if drive.velocity_index is None else int(self._robot.model.parents[joint])


def _reproduces(maps: tuple[np.ndarray, np.ndarray], effects: np.ndarray, column: int, drives: Sequence[int]) -> bool:
    basis, matrix = maps
    effect, wheels = basis @ matrix[:, column], basis @ effects[:, list(drives)]
    missed = effect - wheels @ np.linalg.lstsq(wheels, effect, rcond=_RANK_TOLERANCE)[0]
    tolerance = 1e-6  # relative error below which wheels reproduce the effect of an actuator
    return bool(np.linalg.norm(missed) <= tolerance * np.linalg.norm(effect))


def _drives(reduced: ReducedModel, contacts: Sequence[ContactBody], up: np.ndarray) -> list[Drive]:
    model, found = reduced.robot.model, []
    for contact in contacts:
        if contact.drawn:
            found.append(Drive(contact, None, up))
        elif contact.friction in ("all", "longitudinal") and contact.axle is not None:
            joint = model.joints[contact.joint]
            if joint.nv == 1 and str(model.names[contact.joint]) not in reduced.actuation.names:
                found.append(Drive(contact, joint.idx_v, up))
    return found
