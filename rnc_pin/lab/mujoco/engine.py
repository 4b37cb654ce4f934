"""Import of MuJoCo, with an error that tells how to install it."""

from __future__ import annotations

from rnc_pin.errors import ConfigurationError
from rnc_pin.extras import missing_extra

try:
    import mujoco
except ImportError:
    raise ConfigurationError(missing_extra("mujoco")) from None

__all__ = ["mujoco"]
