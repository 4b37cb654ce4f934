"""What a real machine has and controllers are not told."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Plant:
    """What takes part in a run beside the model itself; nothing by default.

    Args:
        joint_damping: viscous damping of the robot's file acts on its joints.
        actuator_limits: inputs are clipped to the effort limits of the robot's file, and to those of the actuators.
    """

    joint_damping: bool = False
    actuator_limits: bool = False


NOTHING_BESIDE = Plant()
