"""Velocity commands of actuators: a kinematic controller that drives them, and odometry from them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from rnc_pin.array_shapes import Array, Float
from rnc_pin.constraints.wheeled_base import WheeledBase
from rnc_pin.control.controller import (
    Command,
    Description,
    KinematicController,
    State,
    VelocityTarget,
    check_target,
    command_towards,
    describe,
)
from rnc_pin.errors import ConfigurationError, DivergenceError, InputError
from rnc_pin.math.linear_algebra import apply, apply_transposed, null_space
from rnc_pin.model.configuration_evaluation import ConfigurationEvaluation
from rnc_pin.model.coordinates import arc_chord
from rnc_pin.model.evaluation_results import Measurement
from rnc_pin.model.input_validation import ArrayInput, admit_configuration, numbers_or_nan, vector
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.model.rows import rheonomic_names
from rnc_pin.printing import ReprMixin
from rnc_pin.robots.joint_values import known_velocity_limits

_RANK = 1e-9  # smallest relative singular value of B^T R at which actuators determine the motion


class ActuatorVelocityController(ReprMixin):
    """``u = B^T (R v2d + b)``: velocities of the actuators in the admissible motion v2d.

    u is conjugate to the inputs T: ``T^T u`` is their power. So u has the joint velocity of an actuated joint, the
    velocity of the frame for a ``FrameForce``, and its angular velocity for a ``FrameTorque``. The controller returns u
    as the input T of a plant with velocity servos.

    If the motion would exceed a velocity limit, v2d is scaled down as a whole. So the motion stays admissible and keeps
    its direction. Velocities b of moving constraints are not scaled.

    Reads from the measurement: ``q``, and the quantities that its kinematic controller reads.

    Args:
        reduced: the model; only its kinematics is used.
        target: kinematic controller that computes v2d.
        limits: True for the velocity limits of the robot's file, False for none; or limits (nv,) of the full velocity
            v [rad/s, m/s], infinity where there is none.

    Attributes:
        gives_velocities: True; ``simulate`` then requires a plant with velocity servos.

    Raises:
        ConfigurationError: the actuators do not determine the motion (rank of ``B^T R`` below r), or limits are not
            nv positive numbers.

    Example:
        >>> robot = rnc.Robot.from_urdf("differential_drive.urdf", base="planar")
        >>> wheels = [rnc.RollingWheel("left_wheel", 0.1), rnc.RollingWheel("right_wheel", 0.1)]
        >>> system = rnc.NonholonomicSystem(robot, wheels, ["left_wheel_joint", "right_wheel_joint"])
        >>> reduced = system.reduce([rnc.FrameSpeed("base"), rnc.FrameYaw("base")])
        >>> ahead = rnc.control.ReducingOutputController(reduced, rnc.planning.Hold([0.4, 0.0]))
        >>> controller = rnc.control.ActuatorVelocityController(reduced, ahead)
        >>> measurement = reduced.at(robot.configuration(), np.zeros(2)).measure(np.zeros(2))
        >>> controller.step(0.0, measurement, None)[0].T.round(3)  # 0.8 m/s on wheels of 0.1 m
        array([8., 8.])
    """

    gives_velocities = True

    def __init__(
        self, reduced: ReducedModel, target: KinematicController, limits: bool | Float[Array, " nv"] = True
    ) -> None:
        check_velocity_actuation(reduced)
        check_target(target)
        self._reduced, self.target = reduced, target
        self.limits = velocity_limits(reduced, limits)

    def describe(self) -> Description:
        """Return the finite velocity limits by name, and the kinematic controller."""
        names = self._reduced.robot.velocity_names
        limits = {name: float(limit) for name, limit in zip(names, self.limits, strict=True) if np.isfinite(limit)}
        return {"type": type(self).__name__, "limits": limits, "target": describe(self.target)}

    def initial_state(self, measurement: Measurement) -> State:
        """Return the initial state of the kinematic controller.

        Args:
            measurement: first measurement.
        """
        return self.target.initial_state(measurement)

    def step(self, t: float, measurement: Measurement, state: State) -> tuple[Command, State]:
        """Compute one sample. ``v2_desired`` of the command is v2d after scaling.

        Args:
            t: time of the sample [s].
            measurement: measurement at that time.
            state: state of the kinematic controller.

        Raises:
            InputError: the target gives forces, or a v2d of another shape.
            DivergenceError: v2d is not finite.
        """
        target, state = self.target.step(t, measurement, state)
        at = self._reduced.at(measurement.q)
        v2 = self._admitted(target)
        along = apply(at.R, v2)
        # One factor for all: the robot stays on its path, and only moves more slowly.
        scale = admissible_scale(along, at.b, self.limits)
        return command_towards(target._replace(v2=scale * v2), T=apply_transposed(at.B, scale * along + at.b)), state

    def _admitted(self, target: object) -> np.ndarray:
        """Return v2d of a target."""
        if isinstance(target, Command):
            raise InputError(
                "the controller gives forces, not velocities: expected a kinematic controller, such as the 'target' "
                "of a VelocityTracker"
            )
        if not isinstance(target, VelocityTarget):
            raise InputError(
                f"step of a kinematic controller has to return a VelocityTarget, found {type(target).__name__}"
            )
        # Servos hold the velocity: the mean over the sample moves the robot as far as the planned change.
        v2 = np.asarray(target.v2 if target.v2_held is None else target.v2_held, dtype=float)
        if v2.shape[-1:] != (self._reduced.r,):
            raise InputError(f"the v2 of a target has shape {v2.shape}, expected (..., {self._reduced.r})")
        if not np.isfinite(v2).all():
            raise DivergenceError("the velocities v2 of a target are not finite")
        return v2


def admissible_scale(along: np.ndarray, offset: np.ndarray, limits: np.ndarray) -> np.ndarray:
    """Return the largest factor s in [0, 1], (..., 1), with ``|s along + offset| <= limits``.

    Args:
        along: velocity ``R v2`` (..., nv).
        offset: velocity b (..., nv) at ``v2 = 0``. Where it exceeds a limit, s is 0.
        limits: largest velocities (nv,).
    """
    room = np.maximum(limits - np.sign(along) * offset, 0.0)
    speed = np.abs(along)
    # Only entries above their room divide: a limit that is infinite never does.
    ratio = np.divide(room, speed, out=np.ones_like(speed), where=speed > room)
    return np.minimum(ratio.min(axis=-1, keepdims=True), 1.0)


def velocity_from_actuators(at: ConfigurationEvaluation, u: np.ndarray) -> np.ndarray:
    """Return the admissible velocity (nv,) with actuator velocities u (p,); with the nearest ones if there is none.

    It does not use the outputs, so it is regular where they are singular.

    Args:
        at: evaluation at one configuration.
        u: velocities of the actuators [m/s or rad/s].
    """
    # A basis of the admissible velocities that needs no outputs: those may be singular here.
    left, values, right = np.linalg.svd(at.A)
    rank = int((values > _RANK * values[0]).sum()) if len(values) else 0
    # The least velocity with A v = mu, from the same factors; the basis adds what the rows leave free.
    offset = right[:rank].T @ ((left[:, :rank].T @ at.mu) / values[:rank])
    basis = right[rank:].T
    return offset + basis @ np.linalg.lstsq(at.B.T @ basis, u - at.B.T @ offset, rcond=_RANK)[0]


def check_velocity_actuation(reduced: ReducedModel) -> None:
    """Raise an error unless the actuators determine the motion, at sampled configurations.

    Args:
        reduced: the model.

    Raises:
        ConfigurationError: the rank of ``B^T R`` is below r, or the constraints depend on time.
    """
    if reduced.rheonomic:
        names = ", ".join(rheonomic_names(reduced.constraints))
        raise ConfigurationError(f"velocity servos: constraints that depend on time are not supported: {names}")
    generator, best = np.random.default_rng(0), 0
    samples = 5  # the rank is generic, so one regular configuration decides; some may be singular
    for _ in range(samples):
        at = reduced.at(reduced.random_configuration(generator))
        if at.regular and reduced.p:
            best = max(best, int(np.linalg.matrix_rank(at.input_matrix, rtol=_RANK)))
    if best < reduced.r:
        raise ConfigurationError(
            f"velocities of the actuators ({', '.join(reduced.actuation.names) or 'none'}) determine {best} of "
            f"{reduced.r} reduced velocities: add actuators"
        )


def velocity_limits(reduced: ReducedModel, limits: bool | np.ndarray) -> np.ndarray:
    """Return limits (nv,) of the full velocity, infinity where there is none.

    Args:
        reduced: the model.
        limits: True for the limits of the robot's file, False for none, or limits [rad/s, m/s].

    Raises:
        ConfigurationError: not a boolean and not nv positive numbers.
    """
    if isinstance(limits, bool):
        return known_velocity_limits(reduced.robot.model) if limits else np.full(reduced.n, np.inf)
    given = numbers_or_nan(limits)
    if given.shape != (reduced.n,) or not (given > 0).all():
        raise ConfigurationError(f"velocity limits have to be {reduced.n} positive numbers, found {limits!r}")
    return given


def driven_joints(reduced: ReducedModel) -> tuple[str, ...]:
    """Return the joints of one degree of freedom on which actuators act directly.

    Args:
        reduced: the model.
    """
    robot, frames = reduced.robot, reduced.actuation.configured
    # Columns of joints are constant, so any configuration shows which joints they move.
    columns = [column for column in range(reduced.p) if column not in frames]
    moved = np.abs(reduced.at(robot.configuration()).B[:, columns]).max(axis=1, initial=0.0) > 0
    joints = list(zip(robot.model.names, robot.model.joints, strict=True))[1:]
    return tuple(str(name) for name, joint in joints if joint.nv == 1 and moved[joint.idx_v])


# ------------------------------------------------------------------ odometry

_ODOMETRY_RANK = 1e-6  # smallest relative singular value of the columns of what is unknown


class OdometryStep(NamedTuple):
    """Pose after a motion of the joints."""

    pose: Float[Array, " 3"]
    """(x, y, heading) of the frame [m, m, rad]; the heading is not wrapped."""
    slip: float
    """Largest distance by which a row is not satisfied [m]: the joints' motion that no motion of the base explains."""


class OdometryIncrement(NamedTuple):
    """Motion of the frame between two configurations: a constant twist over unit time, in the axes of the frame."""

    motion: Float[Array, " 3"]
    """(forward, left, turn) [m, m, rad]."""
    slip: float
    """Largest distance by which a row is not satisfied [m]."""
    by_joints: Float[Array, "3 k"]
    """Derivatives by the motion of the measured joints."""
    by_rows: Float[Array, "3 m"]
    """Derivatives by the slip of the rows [m]."""

    def covariance(self, encoder: float, slip: float) -> Float[Array, "3 3"]:
        """Covariance of the motion, for a filter of poses, such as in ``robot_localization`` and GTSAM.

        Args:
            encoder: standard deviation of the motion of each measured joint in this step [rad or m].
            slip: standard deviation of the slip of each row in this step [m].
        """
        # Errors of encoders and of rows are independent: variances add.
        return np.asarray(encoder**2 * self.by_joints @ self.by_joints.T + slip**2 * self.by_rows @ self.by_rows.T)


class WheelOdometry(ReprMixin):
    """Pose of a frame of the base from positions of joints alone.

    The rows hold for increments: ``A (base, joints) = 0`` at the configuration halfway, by least squares if there are
    more rows than unknowns. The increment is then integrated on SE(2). It is exact while the joints' rates and steering
    angles are constant, and of second order while the steering turns. Between two steps, joints without limits turn by
    less than half a turn.

    Args:
        reduced: the model; only its kinematics is used.
        frame: frame of the base, x forward and z up.
        measured: joints with encoders; by default the joints that the actuators drive. Other joints may have any
            position, except where the rows depend on it.

    Attributes:
        measured: names of the joints that are used.

    Raises:
        ModelError: unknown frame or joint.
        ConfigurationError: as for ``TwistController``, or the measured joints do not show the motion of the base.

    Example:
        >>> robot = rnc.Robot.from_urdf("differential_drive.urdf", base="planar")
        >>> wheels = [rnc.RollingWheel("left_wheel", 0.1), rnc.RollingWheel("right_wheel", 0.1)]
        >>> system = rnc.NonholonomicSystem(robot, wheels, ["left_wheel_joint", "right_wheel_joint"])
        >>> odometry = rnc.control.WheelOdometry(system.reduce(), "base")
        >>> before = robot.configuration()
        >>> after = robot.configuration({"left_wheel_joint": 2.0, "right_wheel_joint": 2.0})
        >>> odometry.step([1.0, 0.0, np.pi / 2], before, after).pose.round(6)
        array([1.      , 0.2     , 1.570796])
    """

    def __init__(self, reduced: ReducedModel, frame: str, measured: Sequence[str] | None = None) -> None:
        check_velocity_actuation(reduced)
        self.base, self._reduced = WheeledBase(reduced, frame), reduced
        self.frame, self.measured = frame, driven_joints(reduced) if measured is None else tuple(measured)
        robot = reduced.robot
        known = [k for name in self.measured for k in range(robot.nv)[robot.velocity_indices(name)]]
        self._known = np.array(known, dtype=int)
        # Joints without encoders are unknowns beside the twist, such as those of casters.
        self._hidden = np.setdiff1d(np.arange(reduced.n), [*self.base.base, *self._known])
        generator = np.random.default_rng(0)
        most = 1e-6  # part of the base in a motion that the measured joints do not show
        # Three random configurations: at a singular one the rows show less than they do elsewhere.
        columns = [self._columns(*self.base.rows(reduced.random_configuration(generator))) for _ in range(3)]
        if max(np.abs(null_space(each, _ODOMETRY_RANK)[:3]).max(initial=0.0) for each in columns) > most:
            raise ConfigurationError(
                f"positions of {', '.join(self.measured) or 'no joint'} do not show the motion of '{frame}': expected "
                "encoders of more joints in 'measured'"
            )

    def step(self, pose: ArrayInput, before: Float[Array, " nq"], after: Float[Array, " nq"]) -> OdometryStep:
        """Return the pose after the joints have moved.

        Args:
            pose: (x, y, heading) of the frame before [m, m, rad].
            before, after: configurations (nq,) with the positions of the joints; the place of the base does not matter.

        Raises:
            InputError: an array has another shape or is not finite.
        """
        found = self.increment(before, after)
        return OdometryStep(composed(vector(pose, 3, "pose"), found.motion), found.slip)

    def increment(self, before: Float[Array, " nq"], after: Float[Array, " nq"]) -> OdometryIncrement:
        """Return the motion of the frame in its own axes, with its derivatives.

        Args:
            before, after: configurations (nq,) with the positions of the joints; the place of the base does not matter.

        Raises:
            InputError: an array has another shape or is not finite.
        """
        first, last = (admit_configuration(each, self._reduced.robot) for each in (before, after))
        model = self._reduced.robot.model
        moved = np.zeros(self._reduced.n)
        moved[self._known] = pin.difference(model, first, last)[self._known]
        # Halfway: the midpoint rule is of second order, and exact for constant rates.
        rows, to_base = self.base.rows(pin.integrate(model, first, 0.5 * moved))
        right = -rows[:, self._known] @ moved[self._known]
        unknown = self._columns(rows, to_base)
        # More rows than unknowns: the motion that fits best, and its misfit is the slip.
        inverse = np.linalg.pinv(unknown, rcond=_ODOMETRY_RANK)
        found = inverse @ right
        slip = float(np.abs(unknown @ found - right).max(initial=0.0))
        return OdometryIncrement(found[:3], slip, -inverse[:3] @ rows[:, self._known], inverse[:3])

    def _columns(self, rows: Array, to_base: Array) -> Array:
        """Columns of the twist and of the joints that are not measured."""
        return np.hstack([rows[:, self.base.base] @ to_base, rows[:, self._hidden]])


def composed(pose: Array, increment: Array) -> Array:
    """Pose (x, y, heading) after the motion with a constant twist (3,), in the axes of the frame, over unit time.

    Args:
        pose: pose before [m, m, rad].
        increment: the motion (forward, left, turn) [m, m, rad].
    """
    x, y, turn = increment
    # A constant twist drives an arc: its chord has a closed form, which no step size limits.
    along, across = arc_chord(turn)
    forward, left = along * x - across * y, across * x + along * y
    c, s = np.cos(pose[2]), np.sin(pose[2])
    return np.asarray(pose + np.array([c * forward - s * left, s * forward + c * left, turn]))
