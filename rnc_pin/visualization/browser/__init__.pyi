"""Exports of ``rnc_pin.visualization.browser``, which ``__init__.py`` imports at their first use."""

from .page import LOOPBACK as LOOPBACK
from .page import is_loopback as is_loopback
from .scene_server import ControlPanel as ControlPanel
