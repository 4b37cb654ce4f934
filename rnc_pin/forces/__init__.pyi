"""Exports of ``rnc_pin.forces``, which ``__init__.py`` imports at their first use."""

from .output_forces import Damper as Damper
from .output_forces import ForceLaw as ForceLaw
from .output_forces import SmoothFriction as SmoothFriction
from .output_forces import Spring as Spring
from .robot_forces import ForceFunction as ForceFunction
from .robot_forces import Wrench as Wrench
