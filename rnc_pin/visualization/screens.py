"""Choice of the visualizer of live runs: Meshcat, or the one that ``PINOCCHIO_VIEWER`` names."""

from __future__ import annotations

import os
from collections.abc import Callable

from rnc_pin.errors import ConfigurationError, nearest
from rnc_pin.visualization.live import MeshcatScreen, Screen

_NAMES = ("meshcat", "viser")


def selected_screen() -> Callable[..., Screen]:
    """Visualizer that the environment variable ``PINOCCHIO_VIEWER`` names; Meshcat by default.

    Raises:
        ConfigurationError: the name is not a supported visualizer.
    """
    name = os.environ.get("PINOCCHIO_VIEWER", "meshcat").strip().lower() or "meshcat"
    if name not in _NAMES:
        raise ConfigurationError(f"PINOCCHIO_VIEWER={name}: unknown visualizer{nearest(name, _NAMES)}")
    if name == "meshcat":
        return MeshcatScreen
    from rnc_pin.visualization.viser_screen import ViserScreen

    return ViserScreen
