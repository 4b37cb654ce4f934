"""Draft of a first scenario from a robot's file, with a remark on each assumption."""

from rnc_pin.lazy_exports import lazy_exports

__getattr__, __dir__, __all__ = lazy_exports(__name__)
