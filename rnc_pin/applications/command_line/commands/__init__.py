"""Functions of the commands, imported at the first call, so that help and completion are fast.

``__init__.pyi`` lists them. Each module here imports what it needs at its top.
"""

from rnc_pin.lazy_exports import lazy_exports

__getattr__, __dir__, __all__ = lazy_exports(__name__)
