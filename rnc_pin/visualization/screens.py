"""Which visualizer shows a live run: Meshcat, or what ``PINOCCHIO_VIEWER`` names."""

from __future__ import annotations

import os
from collections.abc import Callable

from rnc_pin.errors import ConfigurationError, nearest
from rnc_pin.visualization.live import MeshcatScreen, Screen

_NAMES = ("meshcat", "viser")


def chosen_screen() -> Callable[..., Screen]:
    """The visualizer that the environment asks for.

    Raises:
        ConfigurationError: it is not one of those that work here.
    """
    name = os.environ.get("PINOCCHIO_VIEWER", "meshcat").strip().lower() or "meshcat"
    if name not in _NAMES:
        raise ConfigurationError(f"PINOCCHIO_VIEWER={name}: is not known here{nearest(name, _NAMES)}")
    if name == "meshcat":
        return MeshcatScreen
    from rnc_pin.visualization.viser_screen import ViserScreen

    return ViserScreen
