"""Exports of ``rnc_pin.applications.sweep``, which ``__init__.py`` imports at their first use."""

from .results import SweepResults as SweepResults
from .results import load_sweep as load_sweep
from .run_sweep import sweep as sweep
from .runs import Draws as Draws
