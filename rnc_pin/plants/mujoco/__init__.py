"""MuJoCo as the machine: the loaded robot in somebody else's simulator. Needs ``pip install 'rnc_pin[mujoco]'``."""

from rnc_pin.plants.mujoco.plant import MuJoCoPlant
from rnc_pin.plants.mujoco.settings import MuJoCoSettings

__all__ = ["MuJoCoPlant", "MuJoCoSettings"]
