"""Exports of ``rnc_pin.motion.whole_body.limits``, which ``__init__.py`` imports at their first use."""

from .control_limit import AccelerationLimit as AccelerationLimit
from .control_limit import BaseSpeedLimit as BaseSpeedLimit
from .control_limit import BoundLimit as BoundLimit
from .control_limit import ControlLimit as ControlLimit
from .control_limit import JointPositionLimit as JointPositionLimit
from .control_limit import JointVelocityLimit as JointVelocityLimit
from .control_limit import LimitRows as LimitRows
from .distance_limits import CollisionAvoidance as CollisionAvoidance
from .distance_limits import RegionLimit as RegionLimit
