"""Exports of ``rnc_pin.control.whole_body.limits``, which ``__init__.py`` imports at their first use."""

from .acceleration_limit import AccelerationLimit as AccelerationLimit
from .base_norm_limits import BaseAccelerationLimit as BaseAccelerationLimit
from .base_norm_limits import BaseSpeedLimit as BaseSpeedLimit
from .collision_avoidance import CollisionAvoidance as CollisionAvoidance
from .control_limit import BoundLimit as BoundLimit
from .control_limit import ControlLimit as ControlLimit
from .control_limit import LimitRows as LimitRows
from .joint_position_limit import JointPositionLimit as JointPositionLimit
from .joint_velocity_limit import JointVelocityLimit as JointVelocityLimit
from .region_limit import RegionLimit as RegionLimit
from .wheel_speed_limit import WheelSpeedLimit as WheelSpeedLimit
