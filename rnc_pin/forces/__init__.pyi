"""Exports of ``rnc_pin.forces``, which ``__init__.py`` imports at their first use."""

from .damper import Damper as Damper
from .force_function import ForceFunction as ForceFunction
from .force_law import ForceLaw as ForceLaw
from .smooth_friction import SmoothFriction as SmoothFriction
from .spring import Spring as Spring
from .wrench import Wrench as Wrench
