"""rnc_pin: dynamics, redundancy and control of nonholonomic mechanical systems on Pinocchio.

``__init__.pyi`` lists the exports. Each is imported at its first use (``lazy_exports``).
"""

from rnc_pin.lazy_exports import lazy_exports

__getattr__, __dir__, __all__ = lazy_exports(__name__)
