"""Sweeps: many runs with drawn values, on all cores or a cluster, as a data set with one row a run."""

from rnc_pin.sweeps.run_sweep import sweep
from rnc_pin.sweeps.sweep_results import SweepResults, load_sweep

__all__ = ["SweepResults", "load_sweep", "sweep"]
