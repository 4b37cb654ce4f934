"""Exports of ``rnc_pin.optimal``, which ``__init__.py`` imports at their first use."""

from rnc_pin.motion.optimal import *
