"""Exports of ``rnc_pin.visualization.browser``, which ``__init__.py`` imports at their first use."""

from .access import LOOPBACK as LOOPBACK
from .access import is_loopback as is_loopback
from .scene_server import ControlPanel as ControlPanel
