"""Import of MuJoCo, with an error that tells how to install it."""

from __future__ import annotations

from rnc_pin.errors import ConfigurationError

try:
    import mujoco
except ImportError:
    raise ConfigurationError("MuJoCo is not installed: pip install 'rnc_pin[mujoco]'") from None

__all__ = ["mujoco"]
