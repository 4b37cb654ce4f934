"""Whole-body control within limits: tasks and limits as a quadratic program in the reduced velocities."""

from rnc_pin.lazy_exports import lazy_exports

__getattr__, __dir__, __all__ = lazy_exports(__name__)
