"""Forces that follow from the state: springs, dampers, friction, wrenches, laws of a user."""

from rnc_pin.lazy_exports import lazy_exports

__getattr__, __dir__, __all__ = lazy_exports(__name__)
