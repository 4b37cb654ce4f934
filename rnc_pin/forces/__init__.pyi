"""Exports of ``rnc_pin.forces``, which ``__init__.py`` imports at their first use."""

from .kinds import Damper as Damper
from .kinds import ForceFunction as ForceFunction
from .kinds import SmoothFriction as SmoothFriction
from .kinds import Spring as Spring
from .kinds import Wrench as Wrench
