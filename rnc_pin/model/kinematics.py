"""The one place where Pinocchio runs for rows and dynamics: from states to arrays over leading axes.

What has been computed at a state is a type. ``Position`` has placements, Jacobians and the inertia matrix; ``Motion``
adds velocities, accelerations at zero ``vdot`` and the nonlinear effects; ``Rates`` adds time variations of Jacobians
and the Coriolis matrix. A formula that asks for one of them can read what that one has, and no more.

    position = kinematics.position(q)         # q (..., nq)
    motion = position.moving(v)               # v (..., nv)
    rates = motion.rates()

A single state reads frames straight from Pinocchio's workspace. Many states go through it once in a loop that keeps
whole blocks, ``data.J`` and ``data.dJ`` with the columns of every frame; frames follow by array algebra. ``frame`` is
an index; "world axes" are axes parallel to the world's at the frame's own origin.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable
from functools import partial
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from rnc_pin.math.components import components, cross
from rnc_pin.math.linear_algebra import apply
from rnc_pin.model.once import once
from rnc_pin.robots.robot import Robot

WORLD_AXES = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
OWN_AXES = pin.ReferenceFrame.LOCAL

_WORLD = pin.Convention.WORLD
_UNIT = np.eye(3)
_LINEAR, _ANGULAR = slice(0, 3), slice(3, 6)

Components = slice | list[int]
ALL = slice(0, 6)
"""Of a motion: linear x, y, z, then angular x, y, z."""


class Placement(NamedTuple):
    """Where a frame is in the world."""

    rotation: np.ndarray
    """(..., 3, 3)"""
    translation: np.ndarray
    """(..., 3) [m]"""


class Position(ABC):
    """What is known at configurations.

    Attributes:
        q: (..., nq).
        M: inertia matrices H* (..., nv, nv).
    """

    q: np.ndarray
    M: np.ndarray

    @abstractmethod
    def placement(self, frame: int) -> Placement:
        """Placement of a frame in the world."""

    @abstractmethod
    def rotation(self, frame: int) -> np.ndarray:
        """Its rotation alone, (..., 3, 3)."""

    @abstractmethod
    def joint_placement(self, joint: int) -> Placement:
        """Placement of the frame that moves with a joint."""

    @abstractmethod
    def jacobian(self, frame: int, axes: pin.ReferenceFrame = WORLD_AXES, rows: Components = ALL) -> np.ndarray:
        """Frame Jacobian (..., 6, nv), or some of its rows: linear ones first, about the frame's origin."""

    @abstractmethod
    def moving(self, v: np.ndarray) -> Motion:
        """The same configurations with velocities (..., nv)."""


class Motion(Position):
    """What is known at configurations and velocities.

    Attributes:
        v: (..., nv).
        bias: nonlinear effects ``C* v + g*``, (..., nv).
    """

    v: np.ndarray
    bias: np.ndarray

    @abstractmethod
    def velocity(self, frame: int) -> np.ndarray:
        """Velocity of a frame's origin and angular velocity, (..., 6), in world axes."""

    @abstractmethod
    def joint_velocity(self, joint: int) -> np.ndarray:
        """Spatial velocity (..., 6) of the body that moves with a joint, in its own axes."""

    @abstractmethod
    def acceleration(self, frame: int, axes: pin.ReferenceFrame = WORLD_AXES, rows: Components = ALL) -> np.ndarray:
        """Rate (..., 6), or some of it, of the components of the frame's velocity along these axes at zero ``vdot``."""

    @abstractmethod
    def rates(self) -> Rates:
        """The same states with the rates of what depends on the configuration."""


class Rates(Motion):
    """What is known of rates along the velocity.

    Attributes:
        C: Coriolis matrices C* (..., nv, nv), with ``Hdot* = C* + C*^T``.
    """

    C: np.ndarray

    @abstractmethod
    def jacobian_dot(self, frame: int, axes: pin.ReferenceFrame = WORLD_AXES) -> np.ndarray:
        """Time derivative of ``jacobian``, (..., 6, nv)."""


class Kinematics:
    """One model and Pinocchio's workspace for it; serves one thread at a time.

    Args:
        robot: the robot.
        joints: whose placements are asked for at many states.
    """

    def __init__(self, robot: Robot, joints: Iterable[int] = ()) -> None:
        self._robot = robot
        self.model, self.data = robot.model, robot.model.createData()
        self.nq, self.nv = robot.nq, robot.nv
        self.zero = np.zeros(robot.nv)
        self.joints = tuple(sorted({*joints} - {0}))
        # Views of Pinocchio's own memory: each call renews what they show.
        self.J, self.dJ = (self.by_columns(block) for block in (self.data.J, self.data.dJ))
        places = {joint: self.data.oMi[joint] for joint in range(robot.model.njoints)}
        self.places = {joint: Placement(place.rotation, place.translation) for joint, place in places.items()}
        self._carriers: dict[int, np.ndarray] = {}
        # The arrays at which the workspace stands; who finds another one there sets it again.
        self.q: np.ndarray | None = None
        self.v: np.ndarray | None = None
        self._rated: np.ndarray | None = None
        self._graded: np.ndarray | None = None

    def __reduce__(self) -> tuple[type[Kinematics], tuple[Robot, tuple[int, ...]]]:
        """A copy, or what comes out of a pickle, has a workspace of its own: views are of this one's memory."""
        return type(self), (self._robot, self.joints)

    def gradients(self, q: np.ndarray, v: np.ndarray) -> Gradients:
        """One state (nq,), (nv,), with its derivatives."""
        return Gradients(_OneMotion(_OnePosition(self, q), v))

    def position(self, q: np.ndarray) -> Position:
        """What is known at configurations (..., nq)."""
        return _OnePosition(self, q) if q.ndim == 1 else _ManyPositions(self, q)

    # ------------------------------------------------------------------ where the workspace stands

    def stand_at(self, q: np.ndarray) -> None:
        """Placements and joint Jacobians at q (nq,)."""
        if self.q is not q:
            pin.computeJointJacobians(self.model, self.data, q)
            self.stands(q)

    def move_at(self, q: np.ndarray, v: np.ndarray) -> None:
        """Velocities and accelerations too, at v (nv,)."""
        self.stand_at(q)
        if self.v is not v:
            pin.forwardKinematics(self.model, self.data, q, v, self.zero)
            self.v = v
            self._rated = self._graded = None  # each of the two overwrites what the other had left at another v

    def rate_at(self, q: np.ndarray, v: np.ndarray) -> None:
        """Time variations of joint Jacobians too."""
        self.move_at(q, v)
        if self._rated is not v:
            pin.computeJointJacobiansTimeVariation(self.model, self.data, q, v)
            self._rated = v

    def differentiate_at(self, q: np.ndarray, v: np.ndarray) -> None:
        """Derivatives of velocities and accelerations with respect to q too."""
        self.move_at(q, v)
        if self._graded is not v:
            pin.computeForwardKinematicsDerivatives(self.model, self.data, q, v, self.zero)
            self._graded = v

    def coriolis(self, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """The Coriolis matrix (nv, nv)."""
        self.leave()
        return pin.computeCoriolisMatrix(self.model, self.data, q, v)

    def potential_energy(self, q: np.ndarray) -> np.ndarray | float:
        """Potential energy (...) at configurations (..., nq) [J]."""
        self.leave()
        energy = over_states(partial(pin.computePotentialEnergy, self.model, self.data), (), q)
        return energy if q.ndim > 1 else float(energy)

    def leave(self) -> None:
        """Forget where the workspace stands, before it is moved in another way."""
        self.q = self.v = self._rated = self._graded = None

    def stands(self, q: np.ndarray) -> None:
        self.q = q
        self.v = self._rated = self._graded = None

    def by_columns(self, matrix: np.ndarray) -> np.ndarray:
        """Pinocchio's (6, nv), which is (6,) for a robot with one degree of freedom."""
        return matrix.reshape(6, self.nv) if self.nv == 1 else matrix

    def carriers(self, frame: int) -> np.ndarray:
        """One for entries of v whose joints carry a frame, zero for the others, (nv,)."""
        if frame not in self._carriers:
            columns = self._carriers[frame] = np.zeros(self.nv)
            for joint in self.model.supports[self.frame(frame)[0]]:
                where = self.model.joints[joint]
                columns[where.idx_v : where.idx_v + where.nv] = 1.0
        return self._carriers[frame]

    def frame(self, frame: int) -> tuple[int, pin.SE3]:
        """The joint that carries a frame, and where on it."""
        found = self.model.frames[frame]
        return found.parentJoint, found.placement


# ---------------------------------------------------------------------- one state


class _OnePosition(Position):
    def __init__(self, kinematics: Kinematics, q: np.ndarray) -> None:
        at = self._at = kinematics
        self.q = q
        # In this convention it comes with placements and joint Jacobians.
        self.M = pin.crba(at.model, at.data, q, _WORLD)
        at.stands(q)

    def placement(self, frame: int) -> Placement:
        at = self._at
        at.stand_at(self.q)
        place = pin.updateFramePlacement(at.model, at.data, frame)
        return Placement(place.rotation, place.translation)

    def rotation(self, frame: int) -> np.ndarray:
        at = self._at
        if at.q is not self.q:
            at.stand_at(self.q)
        return pin.updateFramePlacement(at.model, at.data, frame).rotation

    def joint_placement(self, joint: int) -> Placement:
        self._at.stand_at(self.q)
        place = self._at.places[joint]
        return Placement(place.rotation.copy(), place.translation.copy())

    def jacobian(self, frame: int, axes: pin.ReferenceFrame = WORLD_AXES, rows: Components = ALL) -> np.ndarray:
        at = self._at
        if at.q is not self.q:
            at.stand_at(self.q)
        jacobian = pin.getFrameJacobian(at.model, at.data, frame, axes)
        if at.nv == 1:
            jacobian = at.by_columns(jacobian)
        return jacobian if rows is ALL else jacobian[rows]

    def moving(self, v: np.ndarray) -> Motion:
        return _OneMotion(self, v)


class _OneMotion(_OnePosition, Motion):
    def __init__(self, position: _OnePosition, v: np.ndarray) -> None:
        at = self._at = position._at
        self.q, self.M, self.v = position.q, position.M, v
        self.bias = pin.nonLinearEffects(at.model, at.data, self.q, v)
        at.v = None  # that wrote velocities of its own

    def velocity(self, frame: int) -> np.ndarray:
        at = self._at
        if at.v is not self.v or at.q is not self.q:
            at.move_at(self.q, self.v)
        return pin.getFrameVelocity(at.model, at.data, frame, WORLD_AXES).vector

    def joint_velocity(self, joint: int) -> np.ndarray:
        self._at.move_at(self.q, self.v)
        return self._at.data.v[joint].vector.copy()

    def acceleration(self, frame: int, axes: pin.ReferenceFrame = WORLD_AXES, rows: Components = ALL) -> np.ndarray:
        at = self._at
        if at.v is not self.v or at.q is not self.q:
            at.move_at(self.q, self.v)
        getter = pin.getFrameClassicalAcceleration if axes == WORLD_AXES else pin.getFrameAcceleration
        acceleration: np.ndarray = getter(at.model, at.data, frame, axes).vector
        return acceleration if rows is ALL else acceleration[rows]

    def rates(self) -> Rates:
        return _OneRates(self)


class _OneRates(_OneMotion, Rates):
    def __init__(self, motion: _OneMotion) -> None:
        self._at = motion._at
        self.q, self.M, self.v, self.bias = motion.q, motion.M, motion.v, motion.bias

    @once
    def C(self) -> np.ndarray:
        return self._at.coriolis(self.q, self.v)

    def jacobian_dot(self, frame: int, axes: pin.ReferenceFrame = WORLD_AXES) -> np.ndarray:
        at = self._at
        at.rate_at(self.q, self.v)
        return at.by_columns(pin.getFrameJacobianTimeVariation(at.model, at.data, frame, axes))


class FrameGradients(NamedTuple):
    """Derivatives of a frame's motion, in world axes, along the tangent space at q, (3, nv) each."""

    velocity: np.ndarray
    spin: np.ndarray
    acceleration: np.ndarray
    angular_acceleration: np.ndarray


class Gradients(_OneRates):
    """One state with derivatives of velocities and accelerations with respect to q, v fixed and ``vdot`` zero.

    Args:
        motion: the state.
    """

    def own_acceleration_gradient(self, frame: int) -> np.ndarray:
        """Derivative of the frame's acceleration in its own axes, (6, nv)."""
        at = self._at
        at.differentiate_at(self.q, self.v)
        return at.by_columns(pin.getFrameAccelerationDerivatives(at.model, at.data, frame, OWN_AXES)[1])

    def frame_gradients(self, frame: int) -> FrameGradients:
        """Derivatives of what ``velocity`` and ``acceleration`` give in world axes.

        Pinocchio differentiates components along the frame's own axes; turning those into world axes adds the frame's
        own rotation.
        """
        at = self._at
        at.differentiate_at(self.q, self.v)
        model, data = at.model, at.data
        turn = self.placement(frame).rotation
        twist = self.jacobian(frame, OWN_AXES)[3:]  # own rotation for unit motions of the coordinates
        v = pin.getFrameVelocity(model, data, frame, OWN_AXES)
        a = pin.getFrameAcceleration(model, data, frame, OWN_AXES)
        found = pin.getFrameAccelerationDerivatives(model, data, frame, OWN_AXES)[:2]
        v_q, a_q = (at.by_columns(each) for each in found)
        # The acceleration of the origin as a point is that of the frame plus spin x velocity.
        point = a.linear + np.cross(v.angular, v.linear)
        point_q = a_q[:3] - pin.skew(v.linear) @ v_q[3:] + pin.skew(v.angular) @ v_q[:3]

        def world(vector: np.ndarray, gradient: np.ndarray) -> np.ndarray:
            return turn @ (gradient - pin.skew(vector) @ twist)

        return FrameGradients(
            world(v.linear, v_q[:3]), world(v.angular, v_q[3:]), world(point, point_q), world(a.angular, a_q[3:])
        )


# ---------------------------------------------------------------------- many states


class _ManyPositions(Position):
    def __init__(self, kinematics: Kinematics, q: np.ndarray) -> None:
        at, self.q = kinematics, q
        self._at = at
        self._frames: dict[int, Placement] = {}
        batch, n = q.shape[:-1], at.nv
        self.M, self.J = np.empty((*batch, n, n)), np.empty((*batch, 6, n))
        self._places = {joint: Placement(np.empty((*batch, 3, 3)), np.empty((*batch, 3))) for joint in at.joints}
        M, J = self.M.reshape(-1, n, n), self.J.reshape(-1, 6, n)
        kept = [
            (place.rotation.reshape(-1, 3, 3), at.places[joint].rotation) for joint, place in self._places.items()
        ] + [(place.translation.reshape(-1, 3), at.places[joint].translation) for joint, place in self._places.items()]
        at.leave()
        for i, q_i in enumerate(q.reshape(-1, at.nq)):
            M[i] = pin.crba(at.model, at.data, q_i, _WORLD)
            J[i] = at.J
            for out, view in kept:
                out[i] = view

    def joint_placement(self, joint: int) -> Placement:
        if joint not in self._places:
            self._places[joint] = self._placed(joint)
        return self._places[joint]

    def _placed(self, joint: int) -> Placement:
        """Of a joint that nobody had asked for: a loop of its own."""
        batch = self.q.shape[:-1]
        place = Placement(np.empty((*batch, 3, 3)), np.empty((*batch, 3)))
        rotation, translation = place.rotation.reshape(-1, 3, 3), place.translation.reshape(-1, 3)
        for i, q_i in enumerate(self.q.reshape(-1, self._at.nq)):
            self._at.stand_at(q_i)
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
        return (self._wrenches(frame, axes, rows) @ self.J) * self._at.carriers(frame)

    def _wrenches(self, frame: int, axes: pin.ReferenceFrame, rows: Components) -> np.ndarray:
        """Unit forces along and torques about axes at the frame's origin (..., k, 6), taken about the world's origin.

        Their power on a motion about the world's origin is that component of it.
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
        """Of a block (..., 6, nv) the columns of joints that carry a frame, zero at the others."""
        return block * self._at.carriers(frame)

    def moving(self, v: np.ndarray) -> Motion:
        return _ManyMotions(self, v)


class _ManyMotions(_ManyPositions, Motion):
    def __init__(self, positions: _ManyPositions, v: np.ndarray) -> None:
        at = self._at = positions._at
        self.q, self.M, self.J = positions.q, positions.M, positions.J
        self._places, self._frames = positions._places, positions._frames
        self.v, self.bias = v, np.empty(v.shape)
        self._velocities: dict[int, np.ndarray] = {}
        self.dJ = np.empty(self.J.shape)
        dJ, bias, model, data = self.dJ.reshape(-1, 6, at.nv), self.bias.reshape(-1, at.nv), at.model, at.data
        states = zip(self.q.reshape(-1, at.nq), v.reshape(-1, at.nv), strict=True)
        at.leave()
        for i, (q_i, v_i) in enumerate(states):
            pin.computeJointJacobiansTimeVariation(model, data, q_i, v_i)
            dJ[i] = at.dJ
            bias[i] = pin.nonLinearEffects(model, data, q_i, v_i)

    @once
    def _twists(self) -> np.ndarray:
        """What each column adds to motions about the world's origin, (..., 6, nv)."""
        return self.J * self.v[..., None, :]

    @once
    def _twist_rates(self) -> np.ndarray:
        """What each column adds to their rates at zero ``vdot``."""
        return self.dJ * self.v[..., None, :]

    def velocity(self, frame: int) -> np.ndarray:
        if frame not in self._velocities:
            twist = self._twists @ self._at.carriers(frame)
            self._velocities[frame] = apply(self._wrenches(frame, WORLD_AXES, ALL), twist)
        return self._velocities[frame]

    def joint_velocity(self, joint: int) -> np.ndarray:
        def one(q: np.ndarray, v: np.ndarray) -> np.ndarray:
            self._at.move_at(q, v)
            return self._at.data.v[joint].vector.copy()

        return over_states(one, (6,), self.q, self.v)

    def acceleration(self, frame: int, axes: pin.ReferenceFrame = WORLD_AXES, rows: Components = ALL) -> np.ndarray:
        result = apply(self._wrenches(frame, axes, rows), self._twist_rates @ self._at.carriers(frame))
        if axes == WORLD_AXES:  # of the origin as a point: it moves with the turning body
            velocity = components(self.velocity(frame))
            turned = cross(velocity[_ANGULAR], velocity[_LINEAR])
            for i, row in enumerate(range(*rows.indices(6)) if isinstance(rows, slice) else rows):
                if row < 3:
                    result[..., i] += turned[row]
        return result

    def rates(self) -> Rates:
        return _ManyRates(self)


class _ManyRates(_ManyMotions, Rates):
    def __init__(self, motions: _ManyMotions) -> None:
        self._at = motions._at
        self.q, self.M, self.J = motions.q, motions.M, motions.J
        self._places, self._frames = motions._places, motions._frames
        self.v, self.bias, self.dJ, self._velocities = motions.v, motions.bias, motions.dJ, motions._velocities

    @once
    def C(self) -> np.ndarray:
        return over_states(self._at.coriolis, self.M.shape[-2:], self.q, self.v)

    def jacobian_dot(self, frame: int, axes: pin.ReferenceFrame = WORLD_AXES) -> np.ndarray:
        place = self.placement(frame)
        J, dJ = self._columns(self.J, frame), self._columns(self.dJ, frame)
        J, dJ = _about(place.translation, J), _about(place.translation, dJ)
        twist = apply(J, self.v)[..., None]  # of the frame, about its origin
        linear, angular = twist[..., _LINEAR, :], twist[..., _ANGULAR, :]
        if axes == WORLD_AXES:  # the origin moves on
            dJ[..., _LINEAR, :] += _cross(J[..., _ANGULAR, :], linear)
            return dJ
        dJ[..., _LINEAR, :] -= _cross(angular, J[..., _LINEAR, :]) + _cross(linear, J[..., _ANGULAR, :])
        dJ[..., _ANGULAR, :] -= _cross(angular, J[..., _ANGULAR, :])
        return _along(place.rotation, dJ)


def _about(points: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """Motions (..., 6, k) about the world's origin as motions about points (..., 3)."""
    moved = columns.copy()
    moved[..., _LINEAR, :] += _cross(columns[..., _ANGULAR, :], points[..., None])
    return moved


def _along(rotations: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """Motions (..., 6, k) with components along the axes of rotations (..., 3, 3)."""
    back = rotations.mT
    return np.concatenate([back @ columns[..., _LINEAR, :], back @ columns[..., _ANGULAR, :]], axis=-2)


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Vector products of columns (..., 3, k)."""
    (ax, ay, az), (bx, by, bz) = ([each[..., i, :] for i in range(3)] for each in (a, b))
    return np.stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx], axis=-2)


def over_states(function: Callable[..., object], shape: tuple[int, ...], *arrays: np.ndarray) -> np.ndarray:
    """What a function of single states gives, (..., *shape), for arrays with one last axis each."""
    batch = arrays[0].shape[:-1]
    if not batch:
        return np.asarray(function(*arrays), dtype=float)
    out = np.empty((*batch, *shape))
    for i in np.ndindex(batch):
        out[i] = function(*(each[i] for each in arrays))
    return out
