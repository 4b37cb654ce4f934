"""rnc_pin: dynamics, redundancy and control of nonholonomic mechanical systems on Pinocchio.

``__init__.pyi`` lists the exports. Each is imported at its first use.
"""

import lazy_loader as lazy

__getattr__, __dir__, __all__ = lazy.attach_stub(__name__, __file__)
