"""MuJoCo as the machine: the loaded robot in somebody else's simulator. Needs ``pip install 'rnc_pin[mujoco]'``.

Settings can be read and checked without it; MuJoCo is loaded with the plant.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
