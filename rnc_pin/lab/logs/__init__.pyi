"""Exports of ``rnc_pin.lab.logs``, which ``__init__.py`` imports at their first use."""

from .channel import Channel as Channel
from .channel import Correction as Correction
from .channel import LogMapping as LogMapping
from .log import Log as Log
from .log import unwrapped as unwrapped
