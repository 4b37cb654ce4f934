"""Limits of whole-body control; one file each."""

from rnc_pin.control.whole_body.limits.collision_avoidance import CollisionAvoidance
from rnc_pin.control.whole_body.limits.control_limit import BoundLimit, ControlLimit, LimitRows
from rnc_pin.control.whole_body.limits.joint_velocity_limit import JointVelocityLimit

__all__ = ["BoundLimit", "CollisionAvoidance", "ControlLimit", "JointVelocityLimit", "LimitRows"]
