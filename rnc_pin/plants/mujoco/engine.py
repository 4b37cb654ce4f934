"""MuJoCo itself, where it is installed."""

from __future__ import annotations

from rnc_pin.errors import ConfigurationError

try:
    import mujoco
except ImportError:
    raise ConfigurationError("MuJoCo is not installed: pip install 'rnc_pin[mujoco]'") from None

__all__ = ["mujoco"]
