"""Exports of ``rnc_pin.applications``, which ``__init__.py`` imports at their first use."""

from . import sweep as sweep
