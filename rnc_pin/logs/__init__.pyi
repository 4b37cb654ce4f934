"""Exports of ``rnc_pin.logs``, which ``__init__.py`` imports at their first use."""

from .channel import Channel as Channel
from .encoder import unwrapped as unwrapped
from .log import Log as Log
from .mapping import Correction as Correction
from .mapping import LogMapping as LogMapping
