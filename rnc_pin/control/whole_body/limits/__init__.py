"""Limits of whole-body control; one file each."""

from rnc_pin.control.whole_body.limits.control_limit import BoundLimit, ControlLimit, LimitRows
from rnc_pin.control.whole_body.limits.joint_velocity_limit import JointVelocityLimit

__all__ = ["BoundLimit", "ControlLimit", "JointVelocityLimit", "LimitRows"]
