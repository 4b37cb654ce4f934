"""Distances between the links of a robot and to obstacles, with exact rates, by coal on Pinocchio's collision model."""

from rnc_pin.lazy_exports import lazy_exports

__getattr__, __dir__, __all__ = lazy_exports(__name__)
