"""Exports of ``rnc_pin.identification.logs``, which ``__init__.py`` imports at their first use."""

from .channel import Channel as Channel
from .log import Log as Log
from .mapping import Correction as Correction
from .mapping import LogMapping as LogMapping
from .tables import unwrapped as unwrapped
