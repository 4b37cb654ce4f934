"""Exports of ``rnc_pin.lab``, which ``__init__.py`` imports at their first use."""

from . import calibration as calibration
from . import logs as logs
from . import mujoco as mujoco
