"""rnc_pin: dynamics, redundancy and control of nonholonomic mechanical systems on Pinocchio.

``__init__.pyi`` lists the exports. Each is imported at its first use.
"""

import lazy_loader as lazy

_export, __dir__, __all__ = lazy.attach_stub(__name__, __file__)
_FORMER = {"Plant": "simulation", "FrameSpin": "outputs"}
"""Packages that hold former exports, which warn when they are called."""


def __getattr__(name: str) -> object:
    return getattr(_export(_FORMER[name]), name) if name in _FORMER else _export(name)
