"""Limits of whole-body control; one file each."""

from rnc_pin.control.whole_body.limits.acceleration_limit import AccelerationLimit
from rnc_pin.control.whole_body.limits.collision_avoidance import CollisionAvoidance
from rnc_pin.control.whole_body.limits.control_limit import BoundLimit, ControlLimit, LimitRows
from rnc_pin.control.whole_body.limits.joint_position_limit import JointPositionLimit
from rnc_pin.control.whole_body.limits.joint_velocity_limit import JointVelocityLimit
from rnc_pin.control.whole_body.limits.region_limit import RegionLimit
from rnc_pin.control.whole_body.limits.wheel_speed_limit import WheelSpeedLimit

__all__ = [
    "AccelerationLimit",
    "BoundLimit",
    "CollisionAvoidance",
    "ControlLimit",
    "JointPositionLimit",
    "JointVelocityLimit",
    "LimitRows",
    "RegionLimit",
    "WheelSpeedLimit",
]
