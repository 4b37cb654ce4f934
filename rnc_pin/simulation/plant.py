"""Options of the simulated plant: effects that controllers do not model."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Plant:
    """Effects of the plant that the reduced model does not include; none by default.

    Args:
        joint_damping: joints have the viscous damping of the robot's file.
        actuator_limits: inputs are clipped to the effort limits of the robot's file and of the actuators.
        joint_friction: joints have the dry friction of the robot's file, with stiction; only in ``simulate``.

    Example:
        >>> robot = rnc.Robot.from_urdf("space_robot.urdf")
        >>> system = rnc.NonholonomicSystem(robot, [rnc.MomentumConservation("platform")], robot.joint_names[1:])
        >>> reduced, push = system.reduce(), [1e4, 0.0, 0.0]
        >>> q0, plant = robot.configuration({"joint_2": 1.0}), rnc.Plant(actuator_limits=True)
        >>> rnc.free_motion(reduced, q0, np.zeros(3), 0.1, 0.1, push, plant=plant).T[0]
        array([400.,   0.,   0.])
    """

    joint_damping: bool = False
    actuator_limits: bool = False
    joint_friction: bool = False


NOTHING_BESIDE = Plant()
