"""Forces that follow from the state: springs, dampers, friction, wrenches, laws of a user; one file for each kind."""

from rnc_pin.lazy_exports import lazy_exports

__getattr__, __dir__, __all__ = lazy_exports(__name__)
