"""Exports of ``rnc_pin.sweeps``, which ``__init__.py`` imports at their first use."""

from .run_sweep import sweep as sweep
from .sweep_results import SweepResults as SweepResults
from .sweep_results import load_sweep as load_sweep
