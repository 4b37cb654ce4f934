"""rnc_pin: dynamics, redundancy and control of nonholonomic mechanical systems on Pinocchio.

What the package exports is listed in ``__init__.pyi`` and imported when it is first used.
"""

import lazy_loader as lazy

__getattr__, __dir__, __all__ = lazy.attach_stub(__name__, __file__)
