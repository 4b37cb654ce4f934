"""Optimal control of reduced systems: plans within bounds, feedback along them, model-predictive control."""

from rnc_pin.lazy_exports import lazy_exports

__getattr__, __dir__, __all__ = lazy_exports(__name__)
