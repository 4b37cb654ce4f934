"""MuJoCo as the plant: the loaded robot in an independent simulator. It needs the extra ``mujoco``.

The settings do not need MuJoCo; importing the plant loads it.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
