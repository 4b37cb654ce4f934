"""Kinematics of many states: one loop over Pinocchio, then array algebra for the frames.

The loop stores ``data.J`` and ``data.dJ`` of every state. Their columns give the Jacobian of every frame.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from rnc_pin.math.components import components, cross
from rnc_pin.math.linear_algebra import apply
from rnc_pin.model.cached_property import cached_property
from rnc_pin.model.kinematics.quantities import (
    ALL,
    WORLD_AXES,
    Components,
    Placement,
    PositionKinematics,
    RateKinematics,
    VelocityKinematics,
    over_states,
)
from rnc_pin.model.kinematics.workspace import Workspace

_WORLD = pin.Convention.WORLD
_UNIT = np.eye(3)
_LINEAR, _ANGULAR = slice(0, 3), slice(3, 6)


class BatchPositionKinematics(PositionKinematics):
    """Kinematics at many configurations.

    Args:
        workspace: Pinocchio's model and data.
        q: (..., nq).
    """

    def __init__(self, workspace: Workspace, q: np.ndarray) -> None:
        at, self.q = workspace, q
        self._at = at
        self._frames: dict[int, Placement] = {}
        batch, n = q.shape[:-1], at.nv
        self.M, self.J = np.empty((*batch, n, n)), np.empty((*batch, 6, n))
        self._places = {joint: Placement(np.empty((*batch, 3, 3)), np.empty((*batch, 3))) for joint in at.joints}
        M, J = self.M.reshape(-1, n, n), self.J.reshape(-1, 6, n)
        kept = [
            (place.rotation.reshape(-1, 3, 3), at.places[joint].rotation) for joint, place in self._places.items()
        ] + [(place.translation.reshape(-1, 3), at.places[joint].translation) for joint, place in self._places.items()]
        at.invalidate()
        for i, q_i in enumerate(q.reshape(-1, at.nq)):
            M[i] = pin.crba(at.model, at.data, q_i, _WORLD)
            J[i] = at.J
            for out, view in kept:
                out[i] = view
        self.M.setflags(write=False)

    def joint_placement(self, joint: int) -> Placement:
        if joint not in self._places:
            self._places[joint] = self._placed(joint)
        return self._places[joint]

    def _placed(self, joint: int) -> Placement:
        """Placement of a joint that was not listed in advance, by a separate loop over the states."""
        batch = self.q.shape[:-1]
        place = Placement(np.empty((*batch, 3, 3)), np.empty((*batch, 3)))
        rotation, translation = place.rotation.reshape(-1, 3, 3), place.translation.reshape(-1, 3)
        for i, q_i in enumerate(self.q.reshape(-1, self._at.nq)):
            self._at.update_position(q_i)
            rotation[i], translation[i] = self._at.places[joint]
        return place

    def placement(self, frame: int) -> Placement:
        if frame not in self._frames:
            joint, on_joint = self._at.frame(frame)
            rotation, translation = self.joint_placement(joint)
            self._frames[frame] = Placement(rotation @ on_joint.rotation, translation + rotation @ on_joint.translation)
        return self._frames[frame]

    def rotation(self, frame: int) -> np.ndarray:
        return self.placement(frame).rotation

    def jacobian(self, frame: int, axes: pin.ReferenceFrame = WORLD_AXES, rows: Components = ALL) -> np.ndarray:
        return (self._wrenches(frame, axes, rows) @ self.J) * self._at.support(frame)

    def _wrenches(self, frame: int, axes: pin.ReferenceFrame, rows: Components) -> np.ndarray:
        """Unit forces and torques along axes at the frame's origin, (..., k, 6), as wrenches at the world's origin.

        The power of a wrench on a spatial velocity at the world's origin is the component of the frame's velocity.
        """
        rotation, (x, y, z) = self.rotation(frame), np.moveaxis(self.placement(frame).translation, -1, 0)
        chosen = range(*rows.indices(6)) if isinstance(rows, slice) else rows
        wrenches = np.zeros((*x.shape, len(chosen), 6))
        for i, row in enumerate(chosen):
            wrench = wrenches[..., i, :]
            along = _UNIT[row % 3] if axes == WORLD_AXES else rotation[..., :, row % 3]
            if row >= 3:
                wrench[..., _ANGULAR] = along
                continue
            wrench[..., _LINEAR] = along
            dx, dy, dz = along[..., 0], along[..., 1], along[..., 2]
            wrench[..., 3], wrench[..., 4], wrench[..., 5] = y * dz - z * dy, z * dx - x * dz, x * dy - y * dx
        return wrenches

    def _columns(self, block: np.ndarray, frame: int) -> np.ndarray:
        """Block (..., 6, nv) with zeros in the columns of joints that do not support the frame."""
        return block * self._at.support(frame)

    def with_velocity(self, v: np.ndarray) -> VelocityKinematics:
        return BatchVelocityKinematics(self, v)


class BatchVelocityKinematics(BatchPositionKinematics, VelocityKinematics):
    """Kinematics at many configurations and velocities.

    Args:
        positions: the configurations.
        v: (..., nv).
    """

    def __init__(self, positions: BatchPositionKinematics, v: np.ndarray) -> None:
        at = self._at = positions._at
        self.q, self.M, self.J = positions.q, positions.M, positions.J
        self._places, self._frames = positions._places, positions._frames
        self.v, self.bias = v, np.empty(v.shape)
        self._velocities: dict[int, np.ndarray] = {}
        self.dJ = np.empty(self.J.shape)
        dJ, bias, model, data = self.dJ.reshape(-1, 6, at.nv), self.bias.reshape(-1, at.nv), at.model, at.data
        states = zip(self.q.reshape(-1, at.nq), v.reshape(-1, at.nv), strict=True)
        at.invalidate()
        for i, (q_i, v_i) in enumerate(states):
            pin.computeJointJacobiansTimeVariation(model, data, q_i, v_i)
            dJ[i] = at.dJ
            bias[i] = pin.nonLinearEffects(model, data, q_i, v_i)
        self.bias.setflags(write=False)

    @cached_property
    def _twists(self) -> np.ndarray:
        """Contribution of each column to spatial velocities at the world's origin, (..., 6, nv)."""
        return self.J * self.v[..., None, :]

    @cached_property
    def _twist_rates(self) -> np.ndarray:
        """Contribution of each column to spatial accelerations at zero ``vdot``, (..., 6, nv)."""
        return self.dJ * self.v[..., None, :]

    def velocity(self, frame: int) -> np.ndarray:
        if frame not in self._velocities:
            twist = self._twists @ self._at.support(frame)
            self._velocities[frame] = apply(self._wrenches(frame, WORLD_AXES, ALL), twist)
        return self._velocities[frame]

    def joint_velocity(self, joint: int) -> np.ndarray:
        def one(q: np.ndarray, v: np.ndarray) -> np.ndarray:
            self._at.update_velocity(q, v)
            return self._at.data.v[joint].vector.copy()

        return over_states(one, (6,), self.q, self.v)

    def acceleration(self, frame: int, axes: pin.ReferenceFrame = WORLD_AXES, rows: Components = ALL) -> np.ndarray:
        result = apply(self._wrenches(frame, axes, rows), self._twist_rates @ self._at.support(frame))
        if axes == WORLD_AXES:  # classical acceleration of the origin: add angular x linear velocity
            velocity = components(self.velocity(frame))
            turned = cross(velocity[_ANGULAR], velocity[_LINEAR])
            for i, row in enumerate(range(*rows.indices(6)) if isinstance(rows, slice) else rows):
                if row < 3:
                    result[..., i] += turned[row]
        return result

    def rates(self) -> RateKinematics:
        return BatchRateKinematics(self)


class BatchRateKinematics(BatchVelocityKinematics, RateKinematics):
    """Kinematics of many states with rates along v.

    Args:
        motions: the states.
    """

    def __init__(self, motions: BatchVelocityKinematics) -> None:
        self._at = motions._at
        self.q, self.M, self.J = motions.q, motions.M, motions.J
        self._places, self._frames = motions._places, motions._frames
        self.v, self.bias, self.dJ, self._velocities = motions.v, motions.bias, motions.dJ, motions._velocities

    @cached_property
    def C(self) -> np.ndarray:
        return over_states(self._at.coriolis, self.M.shape[-2:], self.q, self.v)

    def jacobian_dot(self, frame: int, axes: pin.ReferenceFrame = WORLD_AXES) -> np.ndarray:
        place = self.placement(frame)
        J, dJ = self._columns(self.J, frame), self._columns(self.dJ, frame)
        J, dJ = _about(place.translation, J), _about(place.translation, dJ)
        twist = apply(J, self.v)[..., None]  # of the frame, about its origin
        linear, angular = twist[..., _LINEAR, :], twist[..., _ANGULAR, :]
        if axes == WORLD_AXES:  # the origin moves
            dJ[..., _LINEAR, :] += _cross(J[..., _ANGULAR, :], linear)
            return dJ
        dJ[..., _LINEAR, :] -= _cross(angular, J[..., _LINEAR, :]) + _cross(linear, J[..., _ANGULAR, :])
        dJ[..., _ANGULAR, :] -= _cross(angular, J[..., _ANGULAR, :])
        return _along(place.rotation, dJ)


def _about(points: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """Spatial motions (..., 6, k) at the world's origin, expressed at points (..., 3)."""
    moved = columns.copy()
    moved[..., _LINEAR, :] += _cross(columns[..., _ANGULAR, :], points[..., None])
    return moved


def _along(rotations: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """Spatial motions (..., 6, k) in the axes of rotations (..., 3, 3)."""
    back = rotations.mT
    return np.concatenate([back @ columns[..., _LINEAR, :], back @ columns[..., _ANGULAR, :]], axis=-2)


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Vector products of columns (..., 3, k)."""
    (ax, ay, az), (bx, by, bz) = ([each[..., i, :] for i in range(3)] for each in (a, b))
    return np.stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx], axis=-2)
