"""What a real machine has and controllers are not told."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Plant:
    """What takes part in a run beside the model itself; nothing by default.

    Args:
        joint_damping: viscous damping of the robot's file acts on its joints.
        actuator_limits: inputs are clipped to the effort limits of the robot's file, and to those of the actuators.

        joint_friction: dry friction of the robot's file acts on its joints, with stiction; in ``simulate`` only.

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
