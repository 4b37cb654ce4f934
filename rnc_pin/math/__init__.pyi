"""Exports of ``rnc_pin.math``, which ``__init__.py`` imports at their first use."""

from .linear_algebra import unit_diagonal as unit_diagonal
from .linear_algebra import unit_rows as unit_rows
