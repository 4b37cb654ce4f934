"""Exports of ``rnc_pin.math``, which ``__init__.py`` imports at their first use."""

from .coordinates import Coordinates as Coordinates
from .coordinates import heading_of as heading_of
from .coordinates import wrapped as wrapped
from .linear_algebra import unit_diagonal as unit_diagonal
from .linear_algebra import unit_rows as unit_rows
