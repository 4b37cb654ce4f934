"""Figures of results in one style: sizes, panels over time, paths from above. Matplotlib is imported at first use."""

from rnc_pin.lazy_exports import lazy_exports

__getattr__, __dir__, __all__ = lazy_exports(__name__)
