"""Exports of ``rnc_pin.lab.mujoco``, which ``__init__.py`` imports at their first use."""

from .contact_bodies import Integrator as Integrator
from .contact_bodies import MuJoCoSettings as MuJoCoSettings
from .contact_bodies import Stance as Stance
from .mujoco_plant import MuJoCoPlant as MuJoCoPlant
