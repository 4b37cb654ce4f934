"""rnc_pin: dynamics, redundancy and control of nonholonomic mechanical systems on Pinocchio.

``__init__.pyi`` lists the exports. Each is imported at its first use (``lazy_exports``).
"""

import sys as _sys

from rnc_pin.lazy_exports import lazy_exports

__getattr__, __dir__, __all__ = lazy_exports(__name__)

if "IPython" in _sys.modules:
    from rnc_pin.tracebacks import hide_frames_in_ipython as _hide_frames

    _hide_frames()
