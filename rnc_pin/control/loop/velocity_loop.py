"""Control loop of a velocity-commanded robot: measurements in, joint velocities and the twist of the base out."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal, NamedTuple, Unpack

import numpy as np

from rnc_pin.array_shapes import Array, Float
from rnc_pin.control.actuator_velocity import ActuatorVelocityController, driven_joints, velocity_from_actuators
from rnc_pin.control.controller import KinematicController
from rnc_pin.control.loop.control_loop import ControlLoop
from rnc_pin.control.loop.options import GuardOptions, check_reduced_model
from rnc_pin.errors import check_known, place_of
from rnc_pin.model.kinematics import OWN_AXES, Kinematics
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.printing import printed

_BASES = {"JointModelPlanar": (0, 1, 2), "JointModelFreeFlyer": (0, 1, 5)}
"""Entries of v that are the twist of a base joint."""


class BaseTwist(NamedTuple):
    """Velocity of the base in its own axes."""

    forward: float
    """Along x [m/s]."""
    sideways: float
    """Along y, to the left [m/s]."""
    yaw: float
    """About z [rad/s]."""


@printed(u="rad/s or m/s", joints="rad/s or m/s")
class VelocityCommand(NamedTuple):
    """Velocities for the drives of a robot. Its arrays are copies."""

    joints: Float[Array, " j"]
    """Velocities of the loop's ``joints`` [rad/s, m/s]."""
    twist: BaseTwist | None
    """Twist of the base; None if the robot has none."""
    v: Float[Array, " nv"]
    """Velocity ``R v2 + b`` of the whole robot; passive wheels included."""
    u: Float[Array, " p"]
    """Velocities of the actuators, ``B^T v``: inputs of a plant with velocity servos."""


class VelocityInputLoop(ControlLoop):
    """Control loop whose inputs are velocities: effort limits do not apply, and "brake" lets velocities decay."""

    _has_efforts = False

    def _braking_input(self, v: Array | None) -> Array:
        """Last velocities, after a decay over one sample."""
        # The rows are linear in v: a share of an admissible velocity is admissible, without a model.
        last = self.state.T
        return np.zeros(self.reduced.p) if last is None else last * np.exp(-self.settings.brake * self.dt)


class VelocityLoop(VelocityInputLoop):
    """Run a kinematic controller on a robot that takes velocity commands.

    The guards are those of ``ControlLoop``: invalid measurements are rejected, the last command is held for
    ``timeout``, and an error of the controller leads to the safe command. ``state.fault`` has the reason as text.
    A command satisfies the constraints exactly: ``v = R v2 + b``. If it would exceed a velocity limit, v2 is scaled
    down as a whole.

    Args:
        reduced: kinematic model of the robot.
        target: kinematic controller, such as ``RedundancyController``.
        dt: nominal sampling period [s].
        velocity: "measured"; "observer" as for ``ControlLoop``; or "commanded": the last command replaces
            the measured velocity, for robots that report positions only. Integrals of the reducing velocities then
            follow from positions.
        limits: True for the velocity limits of the robot's file, False for none; or limits (nv,) of the velocity v.
        base: frame whose twist is commanded; by default the body of a planar or free base joint.
        joints: joints whose velocities are commanded; by default those that the actuators drive.
        fallback: safe command: "zero" velocities, "brake" (velocities decay), "hold" the last ones, or "raise".
        options: further options by name, as for ``ControlLoop``: ``cutoff``, ``timeout``, ``max_speed``,
            ``min_singular_value``, ``brake`` and ``deadline``.

    Attributes:
        joints: names of the commanded joints, (j,).

    Raises:
        ConfigurationError: an option is invalid, a joint is unknown, or the actuators do not determine the motion.
        ModelError: unknown frame.

    Example:
        >>> robot = rnc.Robot.from_urdf("differential_drive.urdf", base="planar")
        >>> wheels = [rnc.RollingWheel("left_wheel", 0.1), rnc.RollingWheel("right_wheel", 0.1)]
        >>> system = rnc.NonholonomicSystem(robot, wheels, ["left_wheel_joint", "right_wheel_joint"])
        >>> reduced = system.reduce([rnc.FrameSpeed("base"), rnc.FrameYaw("base")])
        >>> ahead = rnc.control.ReducingOutputController(reduced, rnc.planning.Hold([0.4, 0.0]))
        >>> loop = rnc.VelocityLoop(reduced, ahead, dt=0.02)
        >>> command = loop.step(0.0, robot.configuration(), v=np.zeros(5))
        >>> command.twist.forward, command.joints.round(3), loop.joints
        (0.8, array([8., 8.]), ('left_wheel_joint', 'right_wheel_joint'))
    """

    def __init__(
        self,
        reduced: ReducedModel,
        target: KinematicController,
        dt: float,
        *,
        velocity: Literal["measured", "observer", "commanded"] = "measured",
        limits: bool | Float[Array, " nv"] = True,
        base: str | None = None,
        joints: Sequence[str] | None = None,
        fallback: Literal["zero", "brake", "hold", "raise"] = "zero",
        **options: Unpack[GuardOptions],
    ) -> None:
        check_reduced_model(reduced)
        check_known(velocity, ("measured", "observer", "commanded"), "velocity of a loop")
        self._commanded = velocity == "commanded"
        # ``step`` passes the commanded velocity to the loop as if it were measured.
        measured = "measured" if velocity == "commanded" else velocity
        controller = ActuatorVelocityController(reduced, target, limits)
        # The controller keeps the limits, by a scale of v2: to clip single inputs would break the constraints.
        super().__init__(reduced, controller, dt, velocity=measured, limits=False, fallback=fallback, **options)
        robot = reduced.robot
        self._base = None if base is None else robot.frame_id(base)
        self._base_entries = _BASES.get(robot.model.joints[1].shortname()) if robot.model.njoints > 1 else None
        self._kinematics = Kinematics(robot)
        self.joints = driven_joints(reduced) if joints is None else tuple(joints)
        for name in self.joints:
            place_of(name, robot.single_joint_names, "no joint with one degree of freedom")
        self._entries = np.array([robot.velocity_indices(name).start for name in self.joints], dtype=int)

    def step(  # type: ignore[override]  # a command of velocities, in place of inputs
        self,
        t: float,
        q: Float[Array, " nq"],
        v: Float[Array, " nv"] | None = None,
        integrals: Float[Array, " r"] | None = None,
    ) -> VelocityCommand:
        """Return the velocity command for a measurement.

        Args:
            t: time of the measurement [s], from any monotonic clock.
            q: configuration (nq,), in Pinocchio's order.
            v: measured velocity (nv,). Ignored if the loop estimates velocity, or takes the commanded one.
            integrals: integrals (r,) of the reducing velocities since the first step; by default the loop integrates.

        Raises:
            RncError: an invalid measurement or an error of the controller, with ``fallback="raise"``.
        """
        if self._commanded:
            # What was commanded last is what the drives do now.
            v = self._velocity(self.state.T)
        return self._command(super().step(t, q, v, integrals))

    @property
    def command(self) -> VelocityCommand:
        """Last command; zero velocities before the first step."""
        u = self.state.T
        return self._command(np.zeros(self.reduced.p) if u is None else u.copy())

    def _command(self, u: Array) -> VelocityCommand:
        v = self._velocity(u)
        return VelocityCommand(v[self._entries], self._twist(v), v, u)

    def _velocity(self, u: Array | None) -> Array:
        """Velocity (nv,) of the robot with actuator velocities u, at the last valid configuration."""
        state, last = self.state, self.last
        # The command itself, where there is one: to solve for it from the inputs would add rounding.
        if last is not None and state.fault is None and last.command.v2_desired is not None:
            return np.array(last.state.configuration.velocity(last.command.v2_desired))
        if state.q is None or u is None or not u.any():
            return np.zeros(self.reduced.n)
        return velocity_from_actuators(self.reduced.at(state.q), u)

    def _twist(self, v: Array) -> BaseTwist | None:
        if self._base is None:
            # The joint of the base has its twist as velocity; only other frames have a lever.
            return None if self._base_entries is None else BaseTwist(*v[list(self._base_entries)].tolist())
        # Before a valid measurement the command is zero, and so is the twist of any frame.
        if self.state.q is None:
            return BaseTwist(0.0, 0.0, 0.0)
        velocity = self._kinematics.position(self.state.q).jacobian(self._base, OWN_AXES) @ v
        return BaseTwist(*velocity[[0, 1, 5]].tolist())
