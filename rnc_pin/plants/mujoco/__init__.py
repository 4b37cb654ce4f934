"""MuJoCo as the machine: the loaded robot in somebody else's simulator. Needs ``pip install 'rnc_pin[mujoco]'``."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from rnc_pin.plants.mujoco.settings import MuJoCoSettings

if TYPE_CHECKING:
    from rnc_pin.plants.mujoco.plant import MuJoCoPlant

__all__ = ["MuJoCoPlant", "MuJoCoSettings"]


def __getattr__(name: str) -> Any:
    """The plant when it is asked for: its settings can be read where MuJoCo is not installed."""
    if name == "MuJoCoPlant":
        return import_module("rnc_pin.plants.mujoco.plant").MuJoCoPlant
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
