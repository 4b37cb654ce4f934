"""Exports of the package. Type checkers and editors read it; ``__init__.py`` imports each name lazily from it."""

from .mujoco_plant import MuJoCoPlant as MuJoCoPlant
from .settings import MuJoCoSettings as MuJoCoSettings
