"""Sweeps: many runs with drawn values, on all cores or a cluster, as a data set with one row a run."""

from rnc_pin.lazy_exports import lazy_exports

__getattr__, __dir__, __all__ = lazy_exports(__name__)
