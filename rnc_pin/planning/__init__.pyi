"""Exports of ``rnc_pin.planning``, which ``__init__.py`` imports at their first use."""

from rnc_pin.motion.planning import *
