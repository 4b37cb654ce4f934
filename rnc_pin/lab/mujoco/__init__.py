"""MuJoCo as the plant: the loaded robot in an independent simulator. It needs the extra ``mujoco``.

The settings do not need MuJoCo; importing the plant loads it.
"""

from rnc_pin.lazy_exports import lazy_exports

__getattr__, __dir__, __all__ = lazy_exports(__name__)
