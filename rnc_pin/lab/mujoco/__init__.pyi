"""Exports of ``rnc_pin.lab.mujoco``, which ``__init__.py`` imports at their first use."""

from .mujoco_plant import MuJoCoPlant as MuJoCoPlant
from .settings import Integrator as Integrator
from .settings import MuJoCoSettings as MuJoCoSettings
from .settings import Stance as Stance
